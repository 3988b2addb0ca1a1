"""What a scene of many points costs: the promise is less than 300 bytes a point, all told."""

from __future__ import annotations

import gc
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript import field

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


def test_nothing_of_a_scene_stays_behind() -> None:
    """The reference evaluator keeps trees for the fields that it was asked about last."""
    blobscript.compile("surface { ball(radius = 1) }")
    assert field._element_tree.cache_info().currsize == 0


def test_packing_leaves_the_scene_as_it_is() -> None:
    """Points at one place act as one in the tracer; in the scene, each keeps its own weight."""
    scene = blobscript.compile("surface { balls([(0, 0, 0), (0, 0, 0)], reach = 2, weight = [0.75, -0.25]) }")
    assert scene.field([[0.0, 0.0, 0.0]])[0] == 0.5
    assert scene.ir.surfaces[0].field.weight.tolist() == [0.75, -0.25]  # type: ignore[union-attr]
