"""The tracer from Python: a packed scene, its indexes, and queries over arrays of points and rays.

The C is single-threaded and pure; rays are handed out in fixed chunks to a thread pool (the call
releases the GIL), so results do not depend on the number of threads, to the bit.
"""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blobscript import ir
from blobscript.backends.library import INDEXES, MATERIAL, NORMALS, SEARCHES, BlobHits, BlobQuery, check_status, load
from blobscript.pack import pack

__all__ = ["COUNTERS", "ENTER", "EXIT", "GRAZE", "INVALID", "MISS", "Hits", "Native", "StepError"]

MISS, ENTER, EXIT, GRAZE, INVALID = range(5)
#: What the tracer counts per ray besides `evaluations`.
COUNTERS = ("nodes", "candidates", "spans", "sandwiches", "fallbacks")
_FAR = 64.0  # radii of the scene: rays from further away have positions polished
_POLISH = 1e-7  # longest step of that, as a share of the distances: far above their rounding
_LEAST_STEP = 1e-9  # radii of the scene: a ray takes seconds for them, and hours for much shorter ones
_FEW = 64  # rays: not worth a thread
_CHUNK = 8192  # rays per call: a multiple of the block in engine.h, about a millisecond of work

Floats = NDArray[np.float64]


class StepError(ValueError):
    """A step so short that no ray would ever arrive."""


@dataclass(slots=True, eq=False)
class Hits:
    """First crossings of n rays. Distances are along the normalised direction, in scene units."""

    status: NDArray[np.int8]  # (n,) MISS ENTER EXIT GRAZE INVALID
    t: Floats  # (n,) +inf unless ENTER or EXIT
    normal: Floats  # (n, 3) unit -gradient, never flipped; NaN unless ENTER or EXIT
    surface: NDArray[np.int32]  # (n,) -1 unless ENTER or EXIT
    evaluations: NDArray[np.int32]  # (n,) point and bound evaluations of the whole field
    #: Each of COUNTERS (n,), where asked for.
    counters: dict[str, NDArray[np.int32]] = field(default_factory=dict[str, NDArray[np.int32]])
    _origins: Floats = field(default_factory=lambda: np.zeros((0, 3)), repr=False)
    _directions: Floats = field(default_factory=lambda: np.zeros((0, 3)), repr=False)
    _native: Native | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.status)

    @property
    def hit(self) -> NDArray[np.bool_]:
        """(n,) ENTER or EXIT."""
        return self.surface >= 0

    @property
    def position(self) -> Floats:
        """(n, 3) o + t d/|d|, computed on access; NaN unless ENTER or EXIT.

        Of rays from afar, where that is off by much more than what rounding makes of a place in the scene, it is
        brought back to the surface: a ray that starts there sees no shadow of its own surface.
        """
        with np.errstate(all="ignore"):
            largest = np.abs(self._directions).max(axis=1, keepdims=True, initial=0.0)
            unit = self._directions / np.where(largest > 0.0, largest, 1.0)
            unit /= np.linalg.norm(unit, axis=1, keepdims=True)
            position = self._origins + self.t[:, None] * unit
            far = self.hit & (np.abs(self._origins).max(axis=1, initial=0.0) + self.t > self._far())
        if self._native is not None and far.any():
            position[far] = self._native.polished(position[far], self.surface[far], self.t[far])
        position[~self.hit] = np.nan
        return position

    def _far(self) -> float:
        return _FAR * self._native.radius if self._native is not None else np.inf


class Native:
    """A scene in the tracer's memory. Safe to use from several threads at once."""

    def __init__(self, scene: ir.Scene, library: ctypes.CDLL | None = None) -> None:
        """library: a tracer compiled for this scene; the bundled one without."""
        self._library = library or load()
        self.packed = pack(scene)
        self._thresholds = [surface.threshold for surface in scene.surfaces]
        self._indexes: dict[str, ctypes.c_void_p] = {}
        self._lock = threading.Lock()
        check_status(load().blob_check(self.scene_pointer))

    def __del__(self) -> None:
        for pointer in getattr(self, "_indexes", {}).values():
            self._library.blob_index_free(pointer)

    @property
    def library(self) -> ctypes.CDLL:
        """Where the rays are traced."""
        return self._library

    @property
    def scene_pointer(self) -> ctypes._Pointer[ctypes.Structure]:  # pyright: ignore[reportPrivateUsage]
        return ctypes.pointer(self.packed.scene)

    def index_pointer(self, index: str = "bvh") -> ctypes.c_void_p:
        """The named index, built at first use."""
        with self._lock:
            if index not in self._indexes:
                pointer = ctypes.c_void_p()
                status = self._library.blob_index_build(
                    self.scene_pointer, _number(INDEXES, index, "index"), ctypes.byref(pointer)
                )
                check_status(status)
                self._indexes[index] = pointer
            return self._indexes[index]

    # ---- points --------------------------------------------------------------------------------

    def field(self, points: ArrayLike, surface: int = 0) -> Floats:
        """(n, 3) -> (n,) combined density of one surface."""
        return self._field(points, surface, None)

    def gradient(self, points: ArrayLike, surface: int = 0) -> Floats:
        """(n, 3) -> (n, 3) analytic gradient of the field."""
        p = _triples(points, "points")
        gradient = np.empty_like(p)
        self._field(p, surface, gradient)
        return gradient

    def _field(self, points: ArrayLike, surface: int, gradient: Floats | None) -> Floats:
        p = _triples(points, "points")
        if not 0 <= surface < self.packed.scene.surface_count:
            raise IndexError(f"there is no surface {surface}")
        values = np.empty(len(p))
        status = self._library.blob_field(
            self.scene_pointer,
            self.index_pointer(),
            surface,
            len(p),
            p.ctypes.data,
            values.ctypes.data,
            gradient.ctypes.data if gradient is not None else None,
        )
        check_status(status)
        return values

    @property
    def radius(self) -> float:
        """Half the diagonal of the box around all elements, in scene units."""
        scene = self.packed.scene
        return 0.5 * float(np.linalg.norm(np.subtract(scene.hi, scene.lo))) / scene.scale

    def polished(self, places: Floats, surface: NDArray[np.int32], distance: Floats) -> Floats:
        """Places that rounding has moved off surfaces seen from that far, brought back by Newton's method: (n, 3)."""
        places = places.copy()
        for number in np.unique(surface):
            of = surface == number
            for _ in range(2):
                places[of] = self._nearer(places[of], int(number), distance[of])
        return places

    def _nearer(self, places: Floats, surface: int, distance: Floats) -> Floats:
        gradient = np.empty_like(places)
        below = self._thresholds[surface] - self._field(places, surface, gradient)
        with np.errstate(all="ignore"):
            step = (below / np.einsum("ij,ij->i", gradient, gradient))[:, None] * gradient
            small = np.linalg.norm(step, axis=1) <= _POLISH * (distance + np.linalg.norm(places, axis=1))
        return np.where(small[:, None], places + step, places)

    def paint(self, points: ArrayLike, surface: ArrayLike, materials: Floats) -> Floats:
        """Material rows blended at points: (n, 3), (n,), (m, MATERIAL) -> (n, MATERIAL)."""
        p = _triples(points, "points")
        which = np.ascontiguousarray(surface, dtype=np.int32)
        rows = np.ascontiguousarray(materials, dtype=np.float64)
        out = np.empty((len(p), MATERIAL))
        status = self._library.blob_paint(
            self.scene_pointer,
            self.index_pointer(),
            len(p),
            p.ctypes.data,
            which.ctypes.data,
            rows.ctypes.data,
            out.ctypes.data,
        )
        check_status(status)
        return out

    # ---- rays ----------------------------------------------------------------------------------

    def first_hit(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        search: str = "sandwich",
        index: str = "bvh",
        normals: str = "analytic",
        tolerance: float | None = None,
        step: float | None = None,
        normal_step: float | None = None,
        threads: int | None = None,
        counters: bool = False,
    ) -> Hits:
        """First crossing in (t_min, t_max] of each ray; see `Hits`. counters: fill `Hits.counters`, too.

        origins, directions: (n, 3), directions of any length; t_min, t_max: a number or (n,).
        """
        o, d, lo, hi = _rays(origins, directions, t_min, t_max)
        query = self.query(search, normals, tolerance, step, normal_step)
        fields = _FIELDS | (dict.fromkeys(COUNTERS, (np.dtype(np.int32), 1)) if counters else {})
        arrays = _room(len(o), fields)
        places = [(name, a.ctypes.data, a.strides[0]) for name, a in arrays.items()]

        def answer(first: int) -> object:
            return ctypes.byref(BlobHits(**{name: place + first * stride for name, place, stride in places}))

        self._trace(self._library.blob_first_hit, (o, d, lo, hi), query, index, threads, answer)
        counted = {name: arrays.pop(name) for name in COUNTERS} if counters else {}
        return Hits(**arrays, counters=counted, _origins=o, _directions=d, _native=self)

    def any_hit(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
        *,
        index: str = "bvh",
        threads: int | None = None,
    ) -> NDArray[np.bool_]:
        """(n,) whether there is a crossing in (t_min, t_max]."""
        rays = _rays(origins, directions, t_min, t_max)
        out = np.empty(len(rays[0]), np.uint8)
        self._trace(
            self._library.blob_any_hit, rays, self.query(), index, threads, lambda first: out.ctypes.data + first
        )
        return out.astype(bool)

    def _trace(
        self,
        function: Callable[..., int],
        rays: tuple[Floats, Floats, Floats, Floats],
        query: BlobQuery,
        index: str,
        threads: int | None,
        answer: Callable[[int], object],
    ) -> None:
        """One of the C queries over all rays, in chunks; answer(first) is where those from `first` on go."""
        scene, place = self.scene_pointer, self.index_pointer(index)
        inputs = [(a.ctypes.data, a.strides[0] if len(a) == len(rays[0]) else 0) for a in rays]

        def run(first: int, count: int, query: BlobQuery) -> int:
            ours = (start + first * stride for start, stride in inputs)
            return function(scene, place, ctypes.byref(query), count, *ours, answer(first))

        _in_chunks(run, len(rays[0]), query, threads)

    def query(
        self,
        search: str = "sandwich",
        normals: str = "analytic",
        tolerance: float | None = None,
        step: float | None = None,
        normal_step: float | None = None,
    ) -> BlobQuery:
        """The C form of the search options; lengths in scene units, None is the default.

        tolerance: how wide a proved crossing may stay (sandwich, bernstein, interval: a few ulp), the step at which
        segment and sphere stop (1e-9 mean reaches of the surface), how far march bisects (a few ulp). step: of march
        (a twentieth of the mean reach). normal_step: of the differences (1e-8 mean reaches forward, 1e-6 central).
        Raises ValueError for names and numbers that cannot be, and for a step that would have no effect; StepError,
        which is one, for a step below 1e-9 of the scene's radius.
        """
        for name, value in (("tolerance", tolerance), ("step", step), ("normal_step", normal_step)):
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be a positive number, not {value}")
        if step is not None and search != "march":
            raise ValueError(f"step belongs to the search 'march'; {search!r} has none")
        if step is not None and step < _LEAST_STEP * self.radius:
            raise StepError(f"{step:g} is too short for this scene: {_LEAST_STEP * self.radius:.2g} at least")
        if normal_step is not None and normals == "analytic":
            raise ValueError("normal_step belongs to the normals 'forward' and 'central'; 'analytic' has none")
        return BlobQuery(
            _number(SEARCHES, search, "search"),
            _number(NORMALS, normals, "normals"),
            tolerance or 0.0,
            step or 0.0,
            normal_step or 0.0,
            None,
        )


def _in_chunks(run: Callable[[int, int, BlobQuery], int], n: int, query: BlobQuery, threads: int | None) -> None:
    """run(first, count, query) over [0, n); Ctrl-C stops all threads at their next packet of rays."""
    if threads is not None and threads < 1:
        raise ValueError(f"threads must be at least 1 (None: all cores), not {threads}")
    cancel = ctypes.c_int32(0)
    query.cancel = ctypes.addressof(cancel)
    firsts = range(0, n, _CHUNK)
    workers = min(threads or os.cpu_count() or 1, len(firsts))
    # Ctrl-C reaches the main thread only, and not while it is in C: it waits there for others to do the work
    if workers == 0 or n <= _FEW or (workers == 1 and threading.current_thread() is not threading.main_thread()):
        for first in firsts:
            check_status(run(first, min(_CHUNK, n - first), query))
        return
    statuses: list[int] = []
    todo = iter(firsts)
    lock = threading.Lock()

    def work() -> None:
        while True:
            with lock:
                first = next(todo, None)
            if first is None or cancel.value:
                return
            statuses.append(run(first, min(_CHUNK, n - first), query))

    with ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(work) for _ in range(workers)]
        try:
            wait(futures)
        except BaseException:
            cancel.value = 1
            raise
        for future in futures:
            future.result()
    for status in statuses:
        check_status(status)


def _number(names: tuple[str, ...], name: str, what: str) -> int:
    if name not in names:
        raise ValueError(f"{what} must be one of {', '.join(names)}, not {name!r}")
    return names.index(name)


def _triples(values: ArrayLike, what: str) -> Floats:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{what} must have the shape (n, 3), not {array.shape}")
    return array


def _rays(
    origins: ArrayLike, directions: ArrayLike, t_min: ArrayLike, t_max: ArrayLike
) -> tuple[Floats, Floats, Floats, Floats]:
    """As the C wants them. A window that all rays share is written down for one chunk only."""
    o, d = _triples(origins, "origins"), _triples(directions, "directions")
    if len(o) != len(d):
        raise ValueError(f"as many origins as directions, please: {len(o)} and {len(d)}")
    return o, d, _ends(t_min, "t_min", len(o)), _ends(t_max, "t_max", len(o))


def _ends(values: ArrayLike, what: str, n: int) -> Floats:
    """(n,), or (_CHUNK,) for one number where there are more rays."""
    array = np.asarray(values, dtype=np.float64)
    if array.size == 1 and array.ndim <= 1:
        return np.full(min(n, _CHUNK), array.item())
    if array.shape != (n,):
        raise ValueError(f"{what} must be a number or one per ray, shape ({n},), not {array.shape}")
    return np.ascontiguousarray(array)


#: Results that are always written: name -> type, numbers per ray.
_FIELDS: dict[str, tuple[np.dtype[Any], int]] = {
    "normal": (np.dtype(np.float64), 3),
    "t": (np.dtype(np.float64), 1),
    "surface": (np.dtype(np.int32), 1),
    "evaluations": (np.dtype(np.int32), 1),
    "status": (np.dtype(np.int8), 1),
}


def _room(n: int, fields: dict[str, tuple[np.dtype[Any], int]]) -> dict[str, NDArray[Any]]:
    """Arrays for n rays in one piece of memory: large pieces come in large pages, and come back sooner when freed."""
    sizes = [-(-n * kind.itemsize * numbers // 64) * 64 for kind, numbers in fields.values()]
    memory = np.empty(sum(sizes), np.uint8)
    arrays: dict[str, NDArray[Any]] = {}
    begin = 0
    for (name, (kind, numbers)), size in zip(fields.items(), sizes, strict=True):
        array = memory[begin : begin + n * kind.itemsize * numbers].view(kind)
        arrays[name] = array.reshape(n, numbers) if numbers > 1 else array
        begin += size
    return arrays
