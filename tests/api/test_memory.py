"""What a scene of many points costs: the promise is less than 300 bytes a point, all told."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

import blobscript
from blobscript import datafiles, field, framing, ir, meshfiles
from blobscript.pack import pack
from blobscript.source import Source, Span
from blobscript.values import Context

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


TRIANGLES = 79_202


@pytest.mark.parametrize("ending", ["stl", "ply"])
def test_bytes_per_triangle_of_a_file(tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An STL file repeats each point in every triangle; its million triangles are read in less than 200 MB."""
    monkeypatch.setattr(datafiles, "MAX_SIZE", 5_000_000)  # room for as much is taken, and never touched
    mesh = _wave(200)
    mesh.export(tmp_path / f"wave.{ending}")
    context = Context(Span(Source("wave.blob", ""), 0, 0), str(tmp_path))
    points, faces = meshfiles.read_mesh(context, f"wave.{ending}")
    assert (len(points), len(faces)) == (200 * 200, TRIANGLES)
    corners = np.asarray(points)[np.asarray(faces)]
    assert np.array_equal(corners, np.asarray(mesh.triangles).astype(np.float32))
    assert _peak(lambda: meshfiles.read_mesh(context, f"wave.{ending}")) < 180 * TRIANGLES


def _wave(side: int) -> trimesh.Trimesh:
    """A surface over a square, of two triangles for each cell."""
    x, z = np.meshgrid(*[np.linspace(-1.0, 1.0, side)] * 2)
    points = np.stack([x, 0.1 * np.sin(9.0 * x) * np.cos(7.0 * z), z], axis=-1).reshape(-1, 3)
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    return trimesh.Trimesh(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]), process=False)


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
