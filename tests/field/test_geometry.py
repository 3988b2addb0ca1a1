"""Distances against brute force, exact cases and each other."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from random_scenes import NOTCH, NOTCH_TRIANGLES, OCTAHEDRON, prism, random_skeleton, rotation, sphere

from blobscript import geometry
from blobscript.ir import Lines, Mesh, Points, Polygon, Polyhedron, Polyline, Skeleton


def distance(skeleton, points) -> np.ndarray:
    return np.linalg.norm(geometry.offsets(skeleton, np.asarray(points, dtype=float)), axis=1)


def line(a, b) -> Lines:
    return Lines(np.array([a], dtype=float), np.array([b], dtype=float))


def triangle(*corners) -> Mesh:
    return Mesh(np.array(corners, dtype=float), np.array([[0, 1, 2]], dtype=np.int32), False)


def sampled_triangle(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance to a fine barycentric grid of the triangle: at most its spacing too long."""
    i, j = np.meshgrid(np.arange(101), np.arange(101))
    u, v = i[i + j <= 100] / 100, j[i + j <= 100] / 100
    places = corners[0] + u[:, None] * (corners[1] - corners[0]) + v[:, None] * (corners[2] - corners[0])
    return np.linalg.norm(points[:, None] - places[None], axis=2).min(axis=1)


def test_line_has_two_round_ends_and_a_side():
    points = [(-3, 4, 0), (0.25, 0, 2), (5, 0, -3), (1, 0, 0)]
    assert distance(line((0, 0, 0), (1, 0, 0)), points).tolist() == [5, 2, 5, 0]


def test_line_of_length_zero_is_a_point():
    assert distance(line((1, 1, 1), (1, 1, 1)), [(1, 1, 4)])[0] == 3.0


def test_open_and_closed_polyline():
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], dtype=float)
    middle = [(0.5, 0.5, 0)]
    assert distance(Polyline(corners, False), middle)[0] == 0.5
    assert distance(Polyline(corners, True), middle)[0] == 0.0


def test_triangles_against_samples():
    rng = np.random.default_rng(5)
    for _ in range(30):
        corners = rng.normal(size=(3, 3)) * np.array([1, rng.choice([1, 0.05]), 1])
        points = rng.normal(size=(60, 3))
        exact, sampled = distance(triangle(*corners), points), sampled_triangle(corners, points)
        assert np.all(exact <= sampled + 1e-12)
        assert np.all(exact >= sampled - 0.05)


@pytest.mark.parametrize("height", [0.0, 1e-12, 1e-9, 1e-6])
def test_slivers_are_as_good_as_their_longest_edge(height: float):
    """Everywhere within `height` of that edge, so distances agree to that, in any orientation."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        turn = rotation(rng)
        corners = np.array([[0, 0, 0], [1, 0, 0], [rng.uniform(), height, 0]]) @ turn.T + rng.normal(size=3)
        points = corners[0] + rng.normal(size=(50, 3))
        edge = line(corners[0], corners[1])
        assert np.all(distance(triangle(*corners), points) <= distance(edge, points) + 1e-14)
        assert np.all(distance(triangle(*corners), points) >= distance(edge, points) - height - 1e-14)


def test_distance_above_a_sliver_is_well_conditioned():
    """The height over the face of a sliver, where its normal is only good to 1e-4."""
    rng = np.random.default_rng(7)
    for _ in range(50):
        turn, shift = rotation(rng), rng.normal(size=3)
        corners = np.array([[0, 0, 0], [1, 0, 0], [0.4, 1e-12, 0]]) @ turn.T + shift
        above = np.array([[0.4, 3e-13, 0.7]]) @ turn.T + shift
        assert distance(triangle(*corners), above)[0] == pytest.approx(0.7, abs=1e-15)


def test_concave_polygon_has_a_notch():
    notch = Polygon(np.column_stack([NOTCH, np.zeros(5)]), np.array(NOTCH_TRIANGLES, dtype=np.int32))
    assert distance(notch, [(0, -0.7, 0.25)])[0] == 0.25
    # the notch's side runs from (0, -0.4) to (1, 1)
    assert distance(notch, [(0, 0.5, 0)])[0] == pytest.approx(0.9 / np.hypot(1.0, 1.4), rel=1e-15)


def test_convex_solid_is_zero_inside_and_exact_outside():
    solid = Polyhedron(*OCTAHEDRON, True)
    assert np.all(distance(solid, [(0, 0, 0), (0.3, 0.3, 0.3), (0.5, 0, -0.4)]) == 0.0)
    assert distance(solid, [(1, 1, 1)])[0] == pytest.approx(2 / np.sqrt(3), rel=1e-15)
    assert distance(solid, [(3, 0, 0)])[0] == 2.0


def test_concave_solid_knows_its_notch():
    points, faces = prism(NOTCH, NOTCH_TRIANGLES, 0.5)
    solid = Polyhedron(points, faces, False)
    assert distance(solid, [(0, -0.7, 0.0)])[0] == 0.0
    assert distance(solid, [(0, 0.5, 0.0)])[0] > 0.4
    assert distance(solid, [(0, -0.7, 1.5)])[0] == 1.0


@pytest.mark.parametrize("kind", ["octahedron", "prism", "ball"])
def test_inside_is_watertight_where_the_ray_meets_edges_and_corners(kind: str):
    """Points on a lattice through all vertices: rays towards +x run along edges and into corners."""
    points, faces = {
        "octahedron": OCTAHEDRON,
        "prism": prism(NOTCH * [1, 0.5], NOTCH_TRIANGLES, 0.5),
        "ball": sphere(3),
    }[kind]
    solid = Mesh(points, faces, True)
    ticks = np.linspace(-1.25, 1.25, 21)
    lattice = np.stack(np.meshgrid(ticks, ticks, ticks), axis=-1).reshape(-1, 3)
    clear = np.linalg.norm(geometry.offsets(Mesh(points, faces, False), lattice), axis=1) > 1e-12
    found = geometry.inside(solid, lattice[clear])
    x, y, z = lattice[clear].T
    match kind:
        case "octahedron":
            expected = np.abs(x) + np.abs(y) + np.abs(z) < 1
        case "prism":
            expected = (np.abs(x) < 1) & (np.abs(z) < 0.5) & (y > -0.5) & (y < -0.2 + 0.7 * np.abs(x))
        case _:
            winding = solid_angle(points[faces], lattice[clear])
            expected = winding > 0.5
    assert np.array_equal(found, expected)


def solid_angle(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Winding number by van Oosterom and Strackee 1983, eq. 8: an independent method."""
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    volume = np.einsum("...i,...i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("...i,...i", p, q) for p, q in ((a, b), (b, c), (c, a)))
    return np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum(axis=1) / (2 * np.pi)


def test_random_solids_agree_with_solid_angles():
    rng = np.random.default_rng(8)
    for kind in ("polyhedron", "solid_mesh") * 6:
        skeleton = random_skeleton(rng, kind)
        points = rng.uniform(-1.5, 1.5, (400, 3))
        expected = solid_angle(skeleton.points[skeleton.triangles], points) > 0.5
        assert np.array_equal(geometry.inside(skeleton, points), expected)


def test_the_walk_through_a_large_mesh_finds_the_nearest_triangle():
    points, faces = sphere(4)
    rng = np.random.default_rng(9)
    places = rng.normal(size=(200, 3))
    for limit in (np.inf, 0.4):
        found = np.linalg.norm(geometry.offsets(Mesh(points, faces, False), places, limit), axis=1)
        each = geometry.offset_to_simplices(places[:, None], points[faces][None])
        expected = np.linalg.norm(each, axis=2).min(axis=1)
        near = expected <= limit
        assert near.any()
        assert np.allclose(found[near], expected[near], rtol=1e-14, atol=0)
        assert np.all(found[~near] > limit)


def test_pairs_are_all_elements_within_reach():
    rng = np.random.default_rng(10)
    at, reach = rng.uniform(size=(3000, 3)), rng.uniform(0.01, 0.2, 3000)
    tree = geometry.build_tree(at[:, None], reach)
    places = rng.uniform(size=(300, 3))
    found = set()
    for query, item in geometry.pairs(tree, places, places, lambda _q, gap2, r: gap2 <= r**2):
        found |= set(zip(query.tolist(), item.tolist(), strict=True))
    within = np.linalg.norm(places[:, None] - at[None], axis=2) <= reach
    assert found >= set(map(tuple, np.argwhere(within).tolist()))
    assert len(found) <= within.sum() * 1.01


def test_offsets_work_at_every_scale():
    for scale in (1e-100, 1e-9, 1.0, 1e9, 1e100):
        skeleton = Points(np.array([[scale, 0, 0]]))
        assert distance(skeleton, [(scale, 3 * scale, 4 * scale)])[0] == pytest.approx(5 * scale, rel=1e-15)
        bar = line((0, 0, 0), (scale, 0, 0))
        assert distance(bar, [(0.5 * scale, 2 * scale, 0)])[0] == pytest.approx(2 * scale, rel=1e-15)


@pytest.mark.parametrize("kind", ["solid", "mesh", "polyline", "lines"])
def test_the_first_questions_to_very_many_simplices_are_answered_as_all_others(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a scan of all simplices, without a tree."""
    rng = np.random.default_rng(0)
    ball = trimesh.creation.icosphere(subdivisions=3)
    corners, triangles = np.ascontiguousarray(ball.vertices), ball.faces.astype(np.int32)
    skeleton: Skeleton = {
        "solid": Mesh(corners, triangles, True),
        "mesh": Mesh(corners, triangles, False),
        "polyline": Polyline(rng.normal(size=(2000, 3)), True),
        "lines": Lines(rng.normal(size=(2000, 3)), rng.normal(size=(2000, 3))),
    }[kind]
    points = rng.uniform(-1.3, 1.3, (40, 3))
    expected = geometry.offsets(skeleton, points)
    monkeypatch.setattr(geometry, "_SCANNED", 10)
    monkeypatch.setattr(geometry, "_SCANS", 1000)
    monkeypatch.setattr(geometry, "_PART", 512)
    np.testing.assert_allclose(geometry.offsets(skeleton, points), expected, rtol=0, atol=1e-15)
