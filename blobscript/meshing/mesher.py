"""Triangles of one surface from the tracer (`tracer/mesh.h`): threads, progress and interruption around the C."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from blobscript.backends.library import check_status, load
from blobscript.backends.native import Native
from blobscript.meshing.grid import Grid

__all__ = ["Body", "Counts", "TooLargeError", "extent", "polygonize", "surface_box"]

Floats = NDArray[np.float64]
#: How many places of possible missed features are told.
_PLACES = 10
_TOO_LARGE = 5

_F3, _I3 = ctypes.c_double * 3, ctypes.c_int32 * 3


class _Plan(ctypes.Structure):
    """blob_mesh_plan"""

    _fields_ = [
        *[(name, ctypes.c_int32) for name in ("surface", "levels", "clip", "reserved")],
        ("lo", _F3),
        ("cell", _F3),
        ("cells", _I3),
        ("reserved2", ctypes.c_int32),
        ("clip_lo", _F3),
        ("clip_hi", _F3),
        ("tolerance", ctypes.c_double),
        ("byte_limit", ctypes.c_uint64),
        ("cancel", ctypes.c_void_p),
    ]


_NUMBERS = ("vertices", "triangles", "visited", "bricks", "refined", "cells", "undecided", "hidden", "queued")


class _Counts(ctypes.Structure):
    """blob_mesh_counts"""

    _fields_ = [*[(name, ctypes.c_uint64) for name in _NUMBERS], ("error", ctypes.c_double), ("lo", _F3), ("hi", _F3)]


class TooLargeError(MemoryError):
    """The mesh would need more memory than allowed; `needed` bytes, where that is known."""

    def __init__(self, needed: float) -> None:
        super().__init__(f"about {needed / 2**30:.1f} GiB")
        self.needed = needed


@dataclass(frozen=True, slots=True)
class Counts:
    """What meshing one surface took.

    visited: boxes whose bounds were computed; cells: not proved free of the surface; undecided: of those, without a
    change of sign at their corners; hidden: cells that may hold something smaller than they are, at `places`; bricks:
    of 8 x 8 x 8 cells; refined: of those with halved cells; error: the largest distance from the surface that was seen
    at the middle of a triangle (only with a tolerance).
    """

    visited: int
    bricks: int
    refined: int
    cells: int
    undecided: int
    hidden: int
    error: float
    places: Floats = field(repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Triangles of one surface, counter-clockwise from outside; unit normals -gradient / |gradient|."""

    vertices: Floats  # (n, 3)
    normals: Floats  # (n, 3)
    triangles: NDArray[np.int64]  # (m, 3)
    counts: Counts


_POINTER, _SIZE = ctypes.c_void_p, ctypes.c_size_t
_SIGNATURES: dict[str, tuple[type, list[type]]] = {
    "blob_mesh_extent": (ctypes.c_int32, [_POINTER, _POINTER, ctypes.c_int32, _POINTER, _POINTER]),
    "blob_mesher_new": (ctypes.c_int32, [_POINTER, _POINTER, _POINTER, _POINTER]),
    "blob_mesher_free": (ctypes.c_int32, [_POINTER]),
    "blob_mesher_work": (ctypes.c_int32, [_POINTER]),
    "blob_mesher_done": (_SIZE, [_POINTER]),
    "blob_mesher_refine": (ctypes.c_int32, [_POINTER, _POINTER]),
    "blob_mesher_finish": (ctypes.c_int32, [_POINTER]),
    "blob_mesher_count": (ctypes.c_int32, [_POINTER, _POINTER]),
    "blob_mesher_hidden": (_SIZE, [_POINTER, _SIZE, _POINTER]),
    "blob_mesher_write": (ctypes.c_int32, [_POINTER, _POINTER, _POINTER, _POINTER]),
}


def _library() -> ctypes.CDLL:
    library = load()
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


def extent(native: Native, surface: int) -> tuple[Floats, Floats]:
    """The box beyond which the field of a surface is 0; lo > hi: it has no blobs."""
    lo, hi = np.zeros(3), np.zeros(3)
    check_status(
        _library().blob_mesh_extent(
            native.scene_pointer, native.index_pointer(), surface, lo.ctypes.data, hi.ctypes.data
        )
    )
    return lo, hi


def surface_box(native: Native, surface: int, grid: Grid) -> tuple[Floats, Floats] | None:
    """A box that is proved to hold the surface, by the bricks of a coarse grid; None: there is proved to be none."""
    with _mesher(native, surface, grid, ctypes.c_int32(0), 0) as run:
        counts = run.count()
    lo, hi = np.array(counts.lo), np.array(counts.hi)
    return (lo, hi) if (lo <= hi).all() else None


def polygonize(
    native: Native,
    surface: int,
    grid: Grid,
    *,
    threads: int | None = None,
    byte_limit: float = float("inf"),
    progress: Callable[[int, int], None] | None = None,
) -> Body:
    """Triangles of one surface. The result does not depend on `threads` (None: all cores).

    progress(done, total) counts bricks of the round at hand. Raises TooLargeError before it takes more than
    `byte_limit` bytes; Ctrl-C ends all threads at their next brick.
    """
    cancel = ctypes.c_int32(0)
    workers = threads or os.cpu_count() or 1
    with _mesher(native, surface, grid, cancel, byte_limit) as run:
        more = True
        while more:
            run.check_memory(byte_limit)
            total = run.count().queued
            run.together(workers, "work", lambda total=total: progress and progress(run.done(), total))
            more = run.refine()
        check_status(run.call("finish"))
        counts = run.count()
        vertices, normals = np.empty((counts.vertices, 3)), np.empty((counts.vertices, 3))
        triangles = np.empty((counts.triangles, 3), dtype=np.int64)
        if counts.vertices:
            run.together(workers, "write", None, vertices.ctypes.data, normals.ctypes.data, triangles.ctypes.data)
        return Body(vertices, normals, triangles, run.told(counts))


class _Run:
    """A blob_mesher at work."""

    def __init__(self, library: ctypes.CDLL, pointer: ctypes.c_void_p, cancel: ctypes.c_int32) -> None:
        self._library = library
        self._pointer = pointer
        self._cancel = cancel

    def call(self, verb: str, *arguments: object) -> int:
        return getattr(self._library, f"blob_mesher_{verb}")(self._pointer, *arguments)

    def count(self) -> _Counts:
        counts = _Counts()
        check_status(self.call("count", ctypes.byref(counts)))
        return counts

    def done(self) -> int:
        return self.call("done")

    def refine(self) -> bool:
        more = ctypes.c_int32(0)
        _check(self.call("refine", ctypes.byref(more)))
        return bool(more.value)

    def check_memory(self, byte_limit: float) -> None:
        """A brick yields about 130 triangles and 65 vertices, at 24 and 48 bytes each; twice, while they are copied."""
        needed = 15e3 * self.count().bricks
        if needed > byte_limit:
            raise TooLargeError(needed)

    def told(self, counts: _Counts) -> Counts:
        places = np.empty((_PLACES, 3))
        shown = self.call("hidden", _PLACES, places.ctypes.data)
        numbers = {name: int(getattr(counts, name)) for name in Counts.__slots__ if name in _NUMBERS}
        return Counts(**numbers, error=counts.error, places=places[:shown])

    def together(self, workers: int, verb: str, watch: Callable[[], object] | None, *arguments: object) -> None:
        """One of the verbs that threads share; the main thread waits, and takes Ctrl-C to the others."""
        with ThreadPoolExecutor(workers) as pool:
            futures = [pool.submit(self.call, verb, *arguments) for _ in range(workers)]
            try:
                while wait(futures, timeout=0.1 if watch else None).not_done:
                    if watch:
                        watch()
            except BaseException:
                self._cancel.value = 1
                raise
        for future in futures:
            _check(future.result())


@contextmanager
def _mesher(native: Native, surface: int, grid: Grid, cancel: ctypes.c_int32, byte_limit: float) -> Generator[_Run]:
    library = _library()
    limit = int(min(byte_limit, 2.0**62))
    clip_lo, clip_hi = grid.clip or (np.zeros(3), np.zeros(3))
    plan = _Plan(
        surface=surface,
        levels=grid.levels,
        clip=grid.clip is not None,
        lo=_F3(*grid.lo),
        cell=_F3(*grid.cell),
        cells=_I3(*grid.cells),
        clip_lo=_F3(*clip_lo),
        clip_hi=_F3(*clip_hi),
        tolerance=grid.tolerance,
        byte_limit=limit,
        cancel=ctypes.addressof(cancel),
    )
    pointer = ctypes.c_void_p()
    place = native.index_pointer()
    _check(library.blob_mesher_new(native.scene_pointer, place, ctypes.byref(plan), ctypes.byref(pointer)))
    try:
        yield _Run(library, pointer, cancel)
    finally:
        library.blob_mesher_free(pointer)


def _check(status: int) -> None:
    if status == _TOO_LARGE:
        raise TooLargeError(float("inf"))
    check_status(status)
