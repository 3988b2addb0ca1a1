"""The bodies of a scene: how large their cells are, their triangles, normals and colours."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.backends.native import Native
from blobscript.diagnostics import BlobscriptError
from blobscript.interruption import import_whole
from blobscript.meshing.grid import REFINEMENTS, around, clipped
from blobscript.meshing.looks import Look, look_of, srgb_bytes
from blobscript.meshing.mesher import Body, TooLargeError, extent, polygonize, surface_box

if TYPE_CHECKING:
    import trimesh

__all__ = ["MeshError", "Options", "Part", "bodies", "joined", "memory_limit"]

Floats = NDArray[np.float64]
Box = tuple[Floats, Floats]
Progress = Callable[[int, int], None]

#: Cells along the longest side, unless told otherwise.
_RESOLUTION = 128
#: Bricks along the longest side of a surface, to find the box that it fills; of 8 cells each.
_COARSE = 64
#: Bytes that a brick of 8 x 8 x 8 cells at the surface takes in the end, triangles, vertices and all.
_BRICK_BYTES = 15e3
#: Shares of the tolerance to aim at, one after the other, until the measured distance is small enough.
_ATTEMPTS = 6
#: With a tolerance cells may be halved that often where the surface bends, if `adaptive`.
_ADAPTIVE_LEVELS = 5


class MeshError(BlobscriptError):
    """A scene that cannot be meshed as asked. `help` says what to do about it."""

    def __init__(self, message: str, remedy: str) -> None:
        super().__init__(f"{message}\n  = help: {remedy}")


@dataclass(frozen=True, slots=True, eq=False)
class Options:
    """How to mesh. One of cell (scene units), resolution (cells along the longest side of the bounds) and tolerance
    (largest distance between triangles and surface, scene units), or none: resolution 128.

    adaptive: large cells where the surface is flat. relax: rounds of making triangles more even. clip: a box that
    solids are cut to. refine: cells may be halved that often where they may hide something. memory: bytes that may be
    used (None: three quarters of what is free).
    """

    cell: float | None = None
    resolution: int | None = None
    tolerance: float | None = None
    adaptive: bool = False
    relax: int = 0
    clip: Box | None = None
    refine: int = REFINEMENTS
    threads: int | None = None
    memory: float | None = None

    def __post_init__(self) -> None:
        given = [name for name in ("cell", "resolution", "tolerance") if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"{given[0]} and {given[1]} both say how fine the mesh is: give one of them")
        for name in given:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be a positive number, not {value}")
        if self.resolution is not None and self.resolution != int(self.resolution):
            raise ValueError(f"resolution must be a whole number, not {self.resolution}")
        if not 0 <= self.refine <= 8:
            raise ValueError(f"refine must lie in 0 to 8, not {self.refine}")
        if self.adaptive and self.tolerance is None:
            raise ValueError("adaptive has no effect without a tolerance")
        if self.relax < 0:
            raise ValueError(f"relax must be 0 or more, not {self.relax}")
        if self.threads is not None and self.threads < 1:
            raise ValueError(f"threads must be 1 or more, not {self.threads}")
        if self.clip is not None and not (np.isfinite(self.clip).all() and (self.clip[0] < self.clip[1]).all()):
            raise ValueError("clip must be two corners (lo, hi) with lo below hi along each axis")


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One surface as a body. distance: from the surface, as measured for the tolerance (else None)."""

    name: str
    surface: int
    body: Body
    look: Look
    cell: float
    distance: float | None = None

    def as_trimesh(self) -> trimesh.Trimesh:
        """With vertex normals, and colours in sRGB bytes."""
        import_whole("trimesh")
        import trimesh

        mesh = trimesh.Trimesh(self.body.vertices, self.body.triangles, vertex_normals=self.body.normals, process=False)
        colors = np.broadcast_to(srgb_bytes(self.look.color), (len(self.body.vertices), 4))
        visual: Any = mesh.visual
        visual.vertex_colors = colors
        mesh.metadata["name"] = self.name
        return mesh


def bodies(scene: ir.Scene, native: Native, options: Options, progress: Progress | None = None) -> list[Part]:
    """The surfaces that are not empty. Raises MeshError."""
    if not scene.surfaces:
        raise MeshError("the scene has no surface", "add one: surface { ball(radius = 1) }")
    boxes = [_box(scene, native, number, options) for number in range(len(scene.surfaces))]
    filled = [box for box in boxes if box is not None]
    if not filled:
        names = ", ".join(f"`{surface.name}`" for surface in scene.surfaces)
        raise MeshError(f"there is nothing to mesh: {names} proved empty (W0401)", "lower the threshold, or add blobs")
    longest = max(float((hi - lo).max()) for lo, hi in filled)
    parts = [
        _part(_Job(scene, native, number, box, longest, options, progress))
        for number, box in enumerate(boxes)
        if box is not None
    ]
    parts = [part for part in parts if len(part.body.triangles)]
    if not parts:
        raise MeshError(
            "no surface was found: what there may be is smaller than the cells", "ask for smaller cells, or --refine"
        )
    return parts


def joined(parts: list[Part]) -> trimesh.Trimesh:
    """All bodies as one mesh."""
    import_whole("trimesh")
    import trimesh

    meshes = [part.as_trimesh() for part in parts]
    if len(meshes) == 1:
        return meshes[0]
    firsts = np.cumsum([0, *(len(part.body.vertices) for part in parts)])
    mesh = trimesh.Trimesh(
        np.concatenate([part.body.vertices for part in parts]),
        np.concatenate([part.body.triangles + first for part, first in zip(parts, firsts[:-1], strict=True)]),
        vertex_normals=np.concatenate([part.body.normals for part in parts]),
        process=False,
    )
    colors: list[Any] = [one.visual for one in meshes]
    visual: Any = mesh.visual
    visual.vertex_colors = np.concatenate([one.vertex_colors for one in colors])
    mesh.metadata["name"] = " + ".join(part.name for part in parts)
    return mesh


# ---- one surface -------------------------------------------------------------------------------------


def _box(scene: ir.Scene, native: Native, number: int, options: Options) -> Box | None:
    """Where a surface is; None: proved empty."""
    surface = scene.surfaces[number]
    if surface.threshold <= 0.0 and options.clip is None:
        raise MeshError(
            f"`{surface.name}` has no end: with the threshold {surface.threshold:g}"
            " all space beyond its blobs is inside",
            "cut it: clip = ((x0, y0, z0), (x1, y1, z1)), or --clip x0,y0,z0,x1,y1,z1",
        )
    if options.clip is not None:
        lo, hi = (np.asarray(side, dtype=np.float64) for side in options.clip)
        return lo, hi
    lo, hi = extent(native, number)
    if not (lo < hi).all():
        return None
    cell = float((hi - lo).max()) / (8 * _COARSE)
    return surface_box(native, number, around((lo, hi), cell, 0))


def memory_limit() -> float:
    """Three quarters of the memory that is free."""
    try:
        with open("/proc/meminfo", encoding="ascii") as file:
            free = next(int(line.split()[1]) for line in file if line.startswith("MemAvailable"))
        return 0.75 * 1024 * free
    except (OSError, StopIteration, ValueError):
        return 0.75 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _refuse(needed: float, cell: float, limit: float, tolerance: float | None) -> MeshError:
    amount = f"about {needed / 2**30:,.1f} GiB" if math.isfinite(needed) else "far more memory than there is"
    start = f"the tolerance {tolerance:g} takes" if tolerance else "a mesh with"
    takes = "which take" if tolerance else "takes"
    return MeshError(
        f"{start} cells of {cell:.3g}{',' if tolerance else ''} {takes} {amount}, and {limit / 2**30:,.1f} GiB may be"
        " used",
        "ask for a larger tolerance" if tolerance else "ask for larger cells or a lower resolution",
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    """One surface to be meshed; longest: the longest side of the bounds of all."""

    scene: ir.Scene
    native: Native
    number: int
    box: Box
    longest: float
    options: Options
    progress: Progress | None

    @property
    def surface(self) -> ir.Surface:
        return self.scene.surfaces[self.number]


def _part(job: _Job) -> Part:
    options, distance = job.options, None
    cell = options.cell or job.longest / (options.resolution or _RESOLUTION)
    if options.tolerance is None:
        body = _body(job, cell)
    else:
        body, cell, distance = _within(job, options.tolerance)
    look = look_of(job.scene, job.native, job.number, body.vertices, options.threads)
    return Part(job.surface.name, job.number, body, look, cell, distance)


def _body(job: _Job, cell: float, tolerance: float = 0.0, levels: int = 0) -> Body:
    """Triangles with cells of one size, refined where they may hide something or are beyond the tolerance."""
    options = job.options
    limit = options.memory if options.memory is not None else memory_limit()
    _check_size(job.box, cell, limit, options.tolerance)
    depth = max(options.refine, levels)
    grid = (clipped if options.clip is not None else around)(job.box, cell, depth, tolerance)
    try:
        body = polygonize(
            job.native, job.number, grid, threads=options.threads, byte_limit=limit, progress=job.progress
        )
    except TooLargeError as error:
        raise _refuse(error.needed, cell, limit, options.tolerance) from error
    except MemoryError as error:
        raise _refuse(math.inf, cell, limit, options.tolerance) from error
    if options.relax:
        from blobscript.meshing.relax import relaxed

        body = relaxed(body, job.native, job.number, job.surface.threshold, options.relax)
    return body


def _check_size(box: Box, cell: float, limit: float, tolerance: float | None) -> None:
    """Refuses what cannot fit even where the surface is only as large as the smallest two sides of its box."""
    with np.errstate(over="ignore"):
        sides = np.sort((box[1] - box[0]) / cell)
        bricks = float(sides[0] * sides[1]) / 64.0
    needed = _BRICK_BYTES * bricks
    if not needed <= limit:
        raise _refuse(needed, cell, limit, tolerance)


# ---- a tolerance -------------------------------------------------------------------------------------------


def _within(job: _Job, tolerance: float) -> tuple[Body, float, float]:
    """Triangles no farther from the surface than the tolerance, the cell they took, the distance measured."""
    found = _even_within(job, tolerance)
    return _adaptive_within(job, tolerance, *found) if job.options.adaptive and len(found[0].triangles) else found


def _even_within(job: _Job, tolerance: float) -> tuple[Body, float, float]:
    """With cells of one size. The distance shrinks with their square, which says how small they must be next."""
    cell = min(job.longest / 32, math.sqrt(tolerance * job.longest))
    distance = math.inf
    for _ in range(_ATTEMPTS):
        body = _body(job, cell)
        distance = _distance(job, body)
        if distance <= tolerance:
            return body, cell, distance
        cell *= 0.9 * math.sqrt(max(tolerance / distance, 1e-3))
    raise MeshError(
        f"the triangles of `{job.surface.name}` stay {distance:.3g} away from it, farther than the tolerance"
        f" {tolerance:g}: it has a crease or a tip that these cells are too large for",
        "ask for a larger tolerance",
    )


def _adaptive_within(job: _Job, tolerance: float, even: Body, fine: float, far: float) -> tuple[Body, float, float]:
    """With cells of `fine` only where larger ones, 2, 4, … times that, are too far from the surface; the even cells
    where nothing is won."""
    levels = min(_ADAPTIVE_LEVELS, int(math.log2(max(job.longest / 16 / fine, 1.0))))
    aim = tolerance
    for _ in range(_ATTEMPTS if levels else 0):
        body = _body(job, fine * 2**levels, aim, levels)
        distance = _distance(job, body)
        if len(body.triangles) >= len(even.triangles):
            break
        if distance <= tolerance:
            return body, fine, distance
        aim *= 0.9 * tolerance / distance
    return even, fine, far


def _distance(job: _Job, body: Body) -> float:
    from blobscript.meshing.measure import distance_to_surface

    if not len(body.triangles):
        return 0.0
    return distance_to_surface(body, job.native, job.number, job.surface.threshold)
