"""On the surface, with its normals and colours, as far from it as was asked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript.meshing import MeshError, Options, bodies
from blobscript.meshing.measure import (
    distance_from_surface,
    distance_to_surface,
    residual,
    shape_of,
    topology,
)
from blobscript.meshing.nearest import distance_to_triangles

TWO = "surface {\nball((-0.8, 0, 0), radius = 1)\nball((0.9, 0.1, 0), radius = 0.7)\n}"
KERNELS = ("soft2", "soft3", "wyvill", "gauss(4)", "gauss_c1(4)", "metaball")


@pytest.fixture(scope="module")
def two() -> blobscript.Scene:
    return blobscript.compile(TWO)


def make(scene: blobscript.Scene, **options: object):
    return bodies(scene.ir, scene._native, Options(**options))[0].body


@pytest.mark.parametrize("kernel", KERNELS)
def test_vertices_lie_on_the_surface(kernel: str) -> None:
    scene = blobscript.compile(
        f"surface(sum(kernel = {kernel}) {{\nball((-0.7, 0, 0), radius = 0.8)\n"
        "line((0, 0, 0), (1, 0.5, 0)).blob(radius = 0.3)\nball((0.3, 0.6, 0.2), reach = 0.5, weight = -0.4)\n})"
    )
    body = make(scene, resolution=24)
    assert residual(body.vertices, scene._native, 0, 0.5).max() < 1e-12 * 3.0
    gradient = scene.gradient(body.vertices)
    normal = -gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    assert np.abs(normal - body.normals).max() < 1e-9


def test_ball() -> None:
    """Volume and area of the unit ball, off by the square of the cell."""
    scene = blobscript.compile("surface { ball(radius = 1) }")
    errors = []
    for resolution in (16, 32):
        body = make(scene, resolution=resolution)
        assert np.abs(np.linalg.norm(body.vertices, axis=1) - 1.0).max() < 4e-16 * 4
        shape = shape_of(body.vertices, body.triangles)
        errors.append((4 / 3 * np.pi - shape.volume, 4 * np.pi - shape.area))
    assert np.log2(np.divide(*errors)) == pytest.approx([2.0, 2.0], abs=0.2)


def test_distances_both_ways(two: blobscript.Scene) -> None:
    """The unit ball: its octahedron is 1 - 1/sqrt(3) away, both ways."""
    ball = blobscript.compile("surface { ball(radius = 1) }")
    body = make(ball, resolution=32)
    far = distance_to_surface(body, ball._native, 0, 0.5)
    middles = body.vertices[body.triangles].mean(axis=1)
    assert far >= 1.0 - np.linalg.norm(middles, axis=1).min() - 1e-12
    back = distance_from_surface(body, ball._native, 0, count=4000)
    assert 0.5 * far < back <= 1.2 * far


def test_nearest_triangles() -> None:
    rng = np.random.default_rng(2)
    vertices = rng.normal(size=(60, 3))
    triangles = rng.integers(0, 60, (80, 3))
    points = rng.normal(size=(50, 3)) * 2.0
    from blobscript.geometry import offset_to_simplices

    want = [np.linalg.norm(offset_to_simplices(np.tile(p, (80, 1)), vertices[triangles]), axis=1).min() for p in points]
    assert distance_to_triangles(points, vertices, triangles) == pytest.approx(want)


@pytest.mark.parametrize("adaptive", [False, True])
def test_a_tolerance_is_met(adaptive: bool, two: blobscript.Scene) -> None:
    part = bodies(two.ir, two._native, Options(tolerance=4e-3, adaptive=adaptive))[0]
    assert part.distance is not None
    assert part.distance <= 4e-3
    assert distance_from_surface(part.body, two._native, 0, count=3000) <= 4e-3
    assert topology(part.body.triangles, len(part.body.vertices)).is_closed


def test_adaptive_cells_save_triangles() -> None:
    """A large ball with a small one on it: small cells there only."""
    scene = blobscript.compile("surface {\nball(radius = 2)\nball((2.1, 0, 0), radius = 0.12)\n}")
    even, adaptive = (
        bodies(scene.ir, scene._native, Options(tolerance=3e-2, adaptive=a))[0].body for a in (False, True)
    )
    assert len(adaptive.triangles) < 0.7 * len(even.triangles)
    shape = topology(adaptive.triangles, len(adaptive.vertices))
    assert shape.is_closed
    assert shape.euler == 2


def test_relaxed_triangles_are_more_even(two: blobscript.Scene) -> None:
    before, after = make(two, resolution=20), make(two, resolution=20, relax=5)
    angles = [shape_of(body.vertices, body.triangles).least_angle for body in (before, after)]
    assert angles[1] > 3.0 * angles[0]
    assert np.array_equal(before.triangles, after.triangles)
    assert residual(after.vertices, two._native, 0, 0.5).max() < 1e-12
    gradient = two.gradient(after.vertices)
    facing = -gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    assert np.abs(facing - after.normals).max() < 1e-6


def test_clipped_and_capped() -> None:
    """Half a ball, and all space around a hole."""
    scene = blobscript.compile("surface { ball(radius = 1) }")
    body = make(scene, resolution=40, clip=(np.full(3, -2.0), np.array([2.0, 2.0, 0.0])))
    shape = shape_of(body.vertices, body.triangles)
    assert shape.volume == pytest.approx(2 / 3 * np.pi, rel=0.02)
    assert body.vertices[:, 2].max() == 0.0
    assert topology(body.triangles, len(body.vertices)).is_closed
    cap = body.vertices[:, 2] == 0.0
    assert np.array_equal(body.normals[cap], np.tile([0.0, 0.0, 1.0], (np.count_nonzero(cap), 1)))

    hole = blobscript.compile("surface(threshold = -0.2) { ball(reach = 1, weight = -1) }")
    with pytest.raises(MeshError, match="has no end"):
        hole.mesh()
    mesh = hole.mesh(resolution=24, clip=((-1, -1, -1), (1, 1, 1.5)))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(10.0 - 4 / 3 * np.pi * 0.72**3, rel=0.02)


def test_scene_mesh_is_a_trimesh() -> None:
    scene = blobscript.compile(
        "surface {\nball((-0.6, 0, 0), radius = 0.5).paint(#ff0000)\n"
        "ball((0.6, 0, 0), radius = 0.5).paint(#0000ff)\n}\n"
        "let stone_ball = surface { ball((0, 2, 0), radius = 0.5) }\nstone_ball"
    )
    mesh = scene.mesh(cell=0.1)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert np.linalg.norm(mesh.vertex_normals, axis=1) == pytest.approx(1.0)
    colors = np.asarray(mesh.visual.vertex_colors)
    low = mesh.vertices[:, 1] < 1.0
    left, right = low & (mesh.vertices[:, 0] < -0.9), low & (mesh.vertices[:, 0] > 0.9)
    assert (colors[left] == [255, 0, 0, 255]).all()
    assert (colors[right] == [0, 0, 255, 255]).all()
    assert len(scene.mesh(resolution=32).triangles) != len(mesh.triangles)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cell": 0.1, "resolution": 20}, "give one of them"),
        ({"cell": 0.0}, "positive"),
        ({"cell": float("nan")}, "positive"),
        ({"resolution": 0}, "positive"),
        ({"resolution": -3}, "positive"),
        ({"tolerance": -1.0}, "positive"),
        ({"adaptive": True}, "without a tolerance"),
        ({"clip": ((0, 0, 0), (1, 0, 1))}, "two corners"),
        ({"refine": 99}, "refine"),
        ({"threads": 0}, "threads"),
    ],
)
def test_what_cannot_be(two: blobscript.Scene, options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        two.mesh(**options)


def test_more_than_memory_is_refused_with_the_estimate(two: blobscript.Scene) -> None:
    with pytest.raises(MeshError, match=r"takes about [\d,.]+ GiB, and [\d,.]+ GiB may be used"):
        two.mesh(resolution=1_000_000)
    with pytest.raises(MeshError, match="may be used"):
        two.mesh(cell=1e-300)


def test_an_empty_surface() -> None:
    with pytest.raises(MeshError, match="W0401"):
        blobscript.compile("surface(threshold = 3) { ball(reach = 1, weight = 1) }").mesh()


def test_ctrl_c_ends_the_work(two: blobscript.Scene) -> None:
    def stop(_done: int, _total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        two.mesh(resolution=1200, threads=2, progress=stop)


def test_no_triangle_is_flat_where_cells_are_halved() -> None:
    """Beside finer cells a triangle whose corners lie on one side of a cell would have next to no area."""
    pearls = "\n".join(f"ball(({x}, 0.31, {z}), radius = 0.03)" for x in (-0.6, 0.1, 0.7) for z in (-0.5, 0.2))
    plate = "polygon([(-1, -0.2, -1), (1, -0.3, -1), (1, 0.0, 1), (-1, 0.1, 1)]).blob(radius = 0.13)"
    body = make(blobscript.compile(f"surface {{\n{plate}\n{pearls}\n}}"), resolution=20)
    assert body.counts.refined > 0
    assert shape_of(body.vertices, body.triangles).least_angle > 0.2


def test_distances_at_a_crease_are_no_larger_than_triangles() -> None:
    """Newton's method along the gradient of one part may go far to meet the other: corners are nearer."""
    scene = blobscript.load(Path(__file__).parents[2] / "examples" / "gecko.blob")
    part = bodies(scene.ir, scene._native, Options(resolution=128))[0]
    corners = part.body.vertices[part.body.triangles]
    longest = max(float(np.linalg.norm(corners[:, i] - corners[:, i - 1], axis=1).max()) for i in range(3))
    assert distance_to_surface(part.body, scene._native, part.surface, 0.35) <= 0.58 * longest
