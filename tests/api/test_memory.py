"""What a scene of many points costs: the promise is less than 300 bytes a point, all told."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript import field, framing, ir
from blobscript.pack import pack

POINTS = 100_000
#: The index, which C allocates: its copy of the points with reach and order, and its nodes.
INDEX = 90 * POINTS


@pytest.fixture
def many(tmp_path: Path) -> Path:
    points = np.random.default_rng(1).uniform(-10, 10, (POINTS, 3))
    np.savetxt(tmp_path / "points.csv", points, "%.4f", delimiter=",", header="x,y,z", comments="")
    path = tmp_path / "many.blob"
    path.write_text('surface { balls(read_points("points.csv"), radius = 0.1) }\n', encoding="utf-8")
    blobscript.load(path)  # what is imported at first use does not count
    return path


def test_bytes_per_point(many: Path) -> None:
    gc.collect()
    tracemalloc.start()
    try:
        scene = blobscript.load(many)
        kept, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()  # that of loading holds room that is never touched
        scene.any_hit([[0.0, 0.0, 30.0]], [[0.0, 0.0, -1.0]])
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 80 * POINTS
    assert peak + INDEX < 300 * POINTS


#: More than have a tree in the reference evaluator at once.
SEGMENTS = 120_000


def test_bytes_per_segment() -> None:
    """A polyline's million segments take less than 400 MB: neither framing nor packing makes copies of all of them."""
    turns = np.linspace(0.0, 600.0, SEGMENTS + 1)
    points = np.stack([np.cos(turns), turns / 300.0 - 1.0, np.sin(turns)], axis=1)
    framing.Extents([_line(points[:3])]).boxes()  # imports
    assert _peak(lambda: framing.Extents([_line(points)]).boxes()) < 40 * SEGMENTS
    assert _peak(lambda: field.field_value(_line(points).field, points[:2])) < 40 * SEGMENTS + 5_000_000
    scene = replace(blobscript.compile("surface { ball(radius = 1) }").ir, surfaces=(_line(points),))
    assert _peak(lambda: pack(scene)) < 230 * SEGMENTS + 12_000_000


def _line(points: np.ndarray) -> ir.Surface:
    one = np.ones(1)
    leaf = ir.Leaf(
        ir.Polyline(points, False), ir.Kernel("soft3"), 0.02 * one, one, np.full(1, -1, np.int32), np.zeros(1, np.int32)
    )
    return ir.Surface("line", leaf, 0.5, 0, None)


def _peak(work: Callable[[], object]) -> int:
    """Bytes that were held at most, what stays included."""
    field.forget()
    gc.collect()
    tracemalloc.start()
    try:
        kept = work()
        assert kept is not None
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        field.forget()


def test_nothing_of_a_scene_stays_behind() -> None:
    """The reference evaluator keeps trees for the fields that it was asked about last."""
    blobscript.compile("surface { ball(radius = 1) }")
    assert field._element_tree.cache_info().currsize == 0


def test_packing_leaves_the_scene_as_it_is() -> None:
    """Points at one place act as one in the tracer; in the scene, each keeps its own weight."""
    scene = blobscript.compile("surface { balls([(0, 0, 0), (0, 0, 0)], reach = 2, weight = [0.75, -0.25]) }")
    assert scene.field([[0.0, 0.0, 0.0]])[0] == 0.5
    assert scene.ir.surfaces[0].field.weight.tolist() == [0.75, -0.25]  # type: ignore[union-attr]
