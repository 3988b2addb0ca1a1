"""Meshes of a peer: scikit-image's marching cubes over a sampled field, beside ours with cells of the same size."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from blobscript.reporting.meshes import MeshResult, Triangles, bounds, certified_places, judge_mesh
from blobscript.reporting.rays import Rays
from blobscript.reporting.reference import Reference
from blobscript.reporting.timing import REPEATS, measure

if TYPE_CHECKING:
    from blobscript.scene import Scene

__all__ = ["MeshPair", "measure_mesh_pair", "scikit_image_version"]

Array = NDArray[np.float64]

_RESOLUTION = 64


@dataclass(frozen=True, slots=True)
class MeshPair:
    """The same cell; theirs: None where scikit-image is not installed or finds nothing."""

    ours: MeshResult
    theirs: MeshResult | None


@dataclass(frozen=True, slots=True, eq=False)
class _Triangles:
    vertices: Array
    faces: NDArray[np.int32]


def scikit_image_version() -> str | None:
    """None where it is not installed."""
    from importlib import metadata

    try:
        return metadata.version("scikit-image")
    except metadata.PackageNotFoundError:
        return None


def measure_mesh_pair(scene: Scene, rays: Rays, reference: Reference) -> MeshPair | None:
    """None for an empty scene. Sampling the field counts for both, on one thread; both fields are our tracer's."""
    lo, hi = bounds(scene.ir)
    cell = float((hi - lo).max()) / _RESOLUTION
    made: dict[str, list[Triangles]] = {"ours": [], "theirs": []}
    runs: dict[str, Callable[[], object]] = {"ours": _keeping(made["ours"], lambda: scene.mesh(cell=cell, threads=1))}
    if scikit_image_version() is not None:
        runs["theirs"] = _keeping(made["theirs"], lambda: _marching_cubes(scene, lo, hi, cell))
    times = measure(runs, REPEATS, rays.seed)
    hits = certified_places(rays, reference)
    found = {
        name: judge_mesh(scene, cell, made[name][0], hits, times[name])
        for name in runs
        if made[name] and len(made[name][0].faces)
    }
    return MeshPair(found["ours"], found.get("theirs")) if "ours" in found else None


def _keeping(kept: list[Triangles], make: Callable[[], Triangles]) -> Callable[[], object]:
    def run() -> None:
        kept[:] = [make()]

    return run


def _marching_cubes(scene: Scene, lo: Array, hi: Array, cell: float) -> Triangles:
    """Surface by surface over one grid with a layer to spare; samples on the threshold are moved off it."""
    from importlib import import_module

    cubes: Any = import_module("skimage.measure").marching_cubes
    low = lo - 1.5 * cell
    counts = [math.ceil(float(hi[k] + 1.5 * cell - low[k]) / cell) + 1 for k in range(3)]
    starts: list[float] = low.tolist()
    axes = [np.linspace(starts[k], starts[k] + cell * (counts[k] - 1), counts[k]) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    vertices, faces, first = [np.zeros((0, 3))], [np.zeros((0, 3), np.int32)], 0
    for number, surface in enumerate(scene.surfaces):
        volume = scene.field(points, number).reshape(counts) - surface.threshold
        volume[volume == 0.0] = 1e-12 * abs(surface.threshold)
        if volume.min() >= 0.0 or volume.max() <= 0.0:
            continue
        found: tuple[Any, ...] = cubes(volume, level=0.0, spacing=(cell,) * 3)
        at, triangles = np.asarray(found[0], np.float64), np.asarray(found[1], np.int32)
        vertices.append(at + low)
        faces.append(triangles + first)
        first += len(at)
    return _Triangles(np.concatenate(vertices), np.concatenate(faces))
