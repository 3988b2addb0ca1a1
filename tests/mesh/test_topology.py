"""Closed, manifold, oriented: whatever the signs, the levels of cells, the threads."""

from __future__ import annotations

import numpy as np
import pytest
from mesh import campaigns

import blobscript
from blobscript.backends.native import Native
from blobscript.meshing import Options, bodies
from blobscript.meshing.grid import Grid, around
from blobscript.meshing.measure import component_count, topology
from blobscript.meshing.mesher import polygonize
from blobscript.meshing.reference import dense, loops


@pytest.mark.parametrize("seed", range(30))
def test_random_scenes_are_closed(seed: int) -> None:
    """Three in two hundred of the campaign, on coarser cells."""
    assert campaigns.closed(seed, resolution=8) == []


@pytest.mark.parametrize("seed", [227, 344])
def test_both_halves_of_a_split_edge_are_crossed(seed: int) -> None:
    """Found by the campaign: a cell beside finer ones with a loop of two vertices."""
    assert campaigns.closed(seed, resolution=8) == []


def test_no_ball_of_half_a_cell_is_lost() -> None:
    found, part = campaigns.tiny_balls(0, 1000)
    assert found == 1000
    assert part.body.counts.hidden == 0
    assert part.body.counts.refined > 0


def test_without_refinement_they_are_reported() -> None:
    """Half of such balls have no node of the grid inside: the cells that may hide them are counted."""
    rng = np.random.default_rng(5)
    items = "\n".join(
        f"ball(({x}, {y}, {z}), radius = 0.25)" for x, y, z in (rng.uniform(0, 0.5, (4, 3)) + 2.0).tolist()
    )
    scene = blobscript.compile(f"surface {{\n{items}\nball(({1.25!r}, 0.77, 0.77), radius = 0.1)\n}}")
    part = bodies(scene.ir, Native(scene.ir), Options(cell=0.5, refine=0))[0]
    assert part.body.counts.hidden > 0
    assert len(part.body.counts.places) > 0


def _random_grid(rng: np.random.Generator) -> tuple[blobscript.Scene, Grid]:
    """Balls of about a cell, so that ambiguous faces abound."""
    items = "\n".join(
        f"ball(({x}, {y}, {z}), radius = {r}, weight = {w})"
        for x, y, z, r, w in np.column_stack(
            [rng.uniform(-1, 1, (60, 3)), rng.uniform(0.08, 0.25, 60), rng.uniform(0.6, 1.5, 60)]
        ).tolist()
    )
    return blobscript.compile(f"surface {{\n{items}\n}}"), around((np.full(3, -1.5), np.full(3, 1.5)), 0.16, 0)


@pytest.mark.parametrize("seed", range(8))
def test_as_the_dense_specification_says(seed: int) -> None:
    """The same vertices and the same Euler characteristic, ambiguous faces included."""
    scene, grid = _random_grid(np.random.default_rng([seed, 3]))
    body = polygonize(Native(scene.ir), 0, grid)
    want = dense(scene.field, scene.surfaces[0].threshold, grid.lo, grid.cell, grid.cells)
    have = topology(body.triangles, len(body.vertices))
    assert want.ambiguous > 0
    assert have.is_closed
    assert have.euler == want.euler
    assert want.vertices <= len(body.vertices) <= want.vertices + want.ambiguous


def test_every_kind_of_cell_has_loops() -> None:
    """Of the specification: a crossed edge is in one loop, for all signs and all decisions."""
    for mask in range(256):
        crossed = sum(
            (mask >> a & 1) != (mask >> (a | 1 << k) & 1) for a in range(8) for k in range(3) if not a >> k & 1
        )
        for joins in (0, 63, 21, 42):
            edges = [edge for loop in loops(mask, joins) for edge in loop]
            assert len(edges) == len(set(edges)) == crossed


GRID = 0.125


@pytest.mark.parametrize(
    "items",
    [
        "ball((0, 0, 0), radius = 1)",
        "polygon([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]).blob(radius = 0.5)",
        "line((-1, 0, 0), (1, 0, 0)).blob(radius = 0.5)",
        "for (x in 0..1) for (y in 0..1) ball((x, y, 0), radius = 0.5)",
    ],
    ids=["ball", "plate", "rod", "touching balls"],
)
def test_values_exactly_at_the_threshold(items: str) -> None:
    """Nodes of the grid lie on the surface, in a plate's case thousands of them: no edge is left open, and no two
    vertices fall together."""
    item = items if not items.startswith("for") else "ball((0, 0, 0), radius = 0.5)\nball((1, 0, 0), radius = 0.5)"
    scene = blobscript.compile(f"surface(max {{\n{item}\n}})")
    grid = Grid(np.full(3, -2.0), np.full(3, GRID), (32, 32, 32))
    nodes = np.stack(np.meshgrid(*[np.arange(-2.0, 2.0 + GRID, GRID)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    assert np.count_nonzero(abs(scene.field(nodes) - 0.5) < 1e-15) > 0
    body = polygonize(Native(scene.ir), 0, grid)
    shape = topology(body.triangles, len(body.vertices))
    assert shape.is_closed
    rounded = np.unique(body.vertices.astype(np.float32), axis=0)
    assert len(rounded) == len(body.vertices)


def test_threads_do_not_matter() -> None:
    scene = blobscript.compile("surface {\nball(radius = 1)\nball((1.2, 0.3, 0.1), radius = 0.05)\n}")
    one, two = (
        polygonize(Native(scene.ir), 0, around((np.full(3, -2.0), np.full(3, 2.0)), 0.15, 2), threads=n) for n in (1, 3)
    )
    assert one.counts.refined > 0
    for name in ("vertices", "normals", "triangles"):
        assert np.array_equal(getattr(one, name), getattr(two, name))


def test_cost_follows_the_surface() -> None:
    """Twice the resolution: four times the boxes and cells, not eight."""
    scene = blobscript.compile("surface {\nball(radius = 1)\n}")
    counts = [
        polygonize(Native(scene.ir), 0, around((np.full(3, -1.0), np.full(3, 1.0)), h, 0)).counts for h in (0.04, 0.02)
    ]
    for name in ("visited", "bricks", "cells"):
        assert getattr(counts[1], name) < 5.0 * getattr(counts[0], name)
    assert counts[1].cells < 0.02 * 100**3 * 8


def test_components_are_counted() -> None:
    triangles = np.array([[0, 1, 2], [2, 1, 3], [5, 4, 6]])
    assert component_count(triangles, 8) == 2
    shape = topology(triangles, 8)
    assert (shape.boundary, shape.nonmanifold, shape.misoriented) == (7, 0, 0)


def test_what_lies_far_from_a_set_is_proved_empty() -> None:
    """Found by the campaign: the distance from a set was told to its reach only, so that no cell beyond it was proved
    empty, and cells were halved all over the scene (27 s instead of half a second)."""
    scene = campaigns.random_scene(17)
    counts = bodies(scene, Native(scene), Options(resolution=16, refine=0))[0].body.counts
    assert counts.cells < 4 * 16**2
    assert counts.hidden < counts.cells / 10


def test_creases_hide_nothing() -> None:
    """Across a crease of less than a right angle the field rises in some direction on both sides, if along no axis."""
    scene = blobscript.compile(
        "surface(threshold = 0.5) { max {\nball((0.4, 0.3, 0.2), radius = 1)\nball((-0.3, -0.5, -0.4), radius = 1)\n} }"
    )
    counts = bodies(scene.ir, Native(scene.ir), Options(resolution=24, refine=0))[0].body.counts
    assert counts.cells > 1000
    assert counts.hidden == 0
