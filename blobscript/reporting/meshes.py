"""Meshes over the cell size: distance both ways between mesh and surface, topology, time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from blobscript import field, geometry, ir
from blobscript.enclosure import surface_box
from blobscript.reporting.judging import Errors, error_stats
from blobscript.reporting.rays import Rays
from blobscript.reporting.reference import Reference
from blobscript.reporting.timing import REPEATS, Timing, measure, once

if TYPE_CHECKING:
    from blobscript.scene import Scene

__all__ = ["MeshResult", "Triangles", "bounds", "certified_places", "judge_mesh", "measure_meshes"]

Array = NDArray[np.float64]

_RESOLUTIONS = (12, 16, 24, 32, 48, 64, 96, 128, 192)
_QUICK = (16, 32, 64)
#: Processor seconds that a mesh may be expected to take: it is made eleven times. Halving cells makes four times
#: as many triangles.
_LONG = 1.0
#: Places of mesh and surface that are looked at.
_PLACES = 3000


class Triangles(Protocol):
    """vertices (n, 3), faces (m, 3)."""

    @property
    def vertices(self) -> Any: ...
    @property
    def faces(self) -> Any: ...


@dataclass(frozen=True, slots=True)
class MeshResult:
    """Lengths in scene units. to_surface: from vertices and middles of triangles to the surface, along the
    gradient; to_mesh: from certified hits to the mesh."""

    cell: float
    triangles: int
    to_surface: Errors
    to_mesh: Errors
    open_edges: int
    euler: int
    time: Timing


def measure_meshes(
    scene: Scene,
    rays: Rays,
    reference: Reference,
    quick: bool,
    progress: Callable[[int, int], None] | None = None,
) -> list[MeshResult]:
    """The mesh of every cell size in turn, until one takes too long."""
    lo, hi = bounds(scene.ir)
    size = float((hi - lo).max())
    made: list[tuple[float, Any]] = []
    once(_mesher(scene, size / 8, []))  # what is done but once in a process is no part of the time
    seconds, before = 0.0, 1
    for resolution in _QUICK if quick else _RESOLUTIONS:
        if seconds * (resolution / before) ** 2 > _LONG:
            break
        cell, before = size / resolution, resolution
        meshes: list[Any] = []
        seconds = once(_mesher(scene, cell, meshes))
        made.append((cell, meshes[0]))
    runs = {str(i): _mesher(scene, cell, []) for i, (cell, _) in enumerate(made)}
    times = measure(runs, REPEATS, rays.seed, progress)
    hits = certified_places(rays, reference)
    return [judge_mesh(scene, cell, mesh, hits, times[str(i)]) for i, (cell, mesh) in enumerate(made)]


def _mesher(scene: Scene, cell: float, kept: list[Any]) -> Callable[[], object]:
    def run() -> None:
        kept[:] = [scene.mesh(cell=cell, threads=1)]

    return run


def bounds(scene: ir.Scene) -> tuple[Array, Array]:
    """A box around all surfaces."""
    boxes = [surface_box(surface, precision=1 / 16) for surface in scene.surfaces]
    found = [box for box in boxes if box is not None] or [field.extent(s.field) for s in scene.surfaces]
    return np.min([box[0] for box in found], axis=0), np.max([box[1] for box in found], axis=0)


def certified_places(rays: Rays, reference: Reference) -> Array:
    """Certified places on the surfaces (n, 3)."""
    rows = np.flatnonzero(reference.hit & (reference.kind == 1))[:_PLACES]
    return rays.origins[rows] + reference.t[rows, None] * rays.directions[rows]


def judge_mesh(scene: Scene, cell: float, mesh: Triangles, hits: Array, time: Timing) -> MeshResult:
    """Against certified places on the surface (n, 3), and along the gradient from the mesh."""
    points = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    step = max(1, len(faces) // _PLACES)
    middles = points[faces[::step]].mean(axis=1)
    places = np.concatenate([points[:: max(1, len(points) // _PLACES)], middles])
    there = ir.Mesh(points, faces, False)
    to_mesh = np.linalg.norm(geometry.offsets(there, hits), axis=1) if len(faces) and len(hits) else np.zeros(0)
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    return MeshResult(
        cell,
        len(faces),
        error_stats(_to_surface(scene.ir, places)),
        error_stats(to_mesh),
        int(np.count_nonzero(counts == 1)),
        len(np.unique(faces)) - len(unique) + len(faces),
        time,
    )


def _to_surface(scene: ir.Scene, places: Array) -> Array:
    """Distance to the nearest of the surfaces, by Newton's steps along the gradient (three of them)."""
    best = np.full(len(places), np.inf)
    for surface in scene.surfaces:
        at = places.copy()
        for _ in range(3):
            value, slope = field.value_and_gradient(surface.field, at)
            square = np.einsum("ij,ij->i", slope, slope)
            with np.errstate(divide="ignore", invalid="ignore"):
                at = at - np.where(square > 0.0, (value - surface.threshold) / square, np.inf)[:, None] * slope
        moved = np.linalg.norm(at - places, axis=1)
        best = np.fmin(best, np.where(np.isfinite(moved), moved, np.inf))
    return best[np.isfinite(best)]
