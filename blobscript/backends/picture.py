"""Pictures: the scene's looks packed for `tracer/shade.h`, and tiles handed to threads.

What the light does is described in `tracer/shade.h` and `tracer/brdf.h`. Two things are decided here:

- The background lights rough surfaces at `FILL` of its radiance: it is a backdrop, and as a sky of
  full strength it would leave nothing for the lights to do. Mirrors and glass show it as it is.
- Pictures are linear light and written as plain sRGB, without a tone curve: what is brighter than
  white is cut.

Layers (`aov`), from the rays through the pixel centres, whatever the number of samples:

    depth        distance from the camera along the ray; inf where nothing is hit
    normal       unit normal, outwards; NaN where nothing is hit
    position     where the surface is hit; NaN where nothing is hit
    surface      number of the surface, from 0; -1 where nothing is hit
    evaluations  evaluations of the field for that ray; likewise the tracer's counters nodes,
                 candidates, spans, sandwiches, fallbacks
"""

from __future__ import annotations

import ctypes
import itertools
import math
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.backends.library import MATERIAL, check_status, load
from blobscript.backends.native import Native
from blobscript.diagnostics import BlobscriptError
from blobscript.framing import camera_for
from blobscript.images import Image

__all__ = ["FILL", "LAYERS", "CancelledError", "render"]

#: Share of the background's radiance that lights rough surfaces.
FILL = 0.35
#: The default background: radiance high above and far below, the height (y of the direction) where it is
#: halfway between them, and how fast it changes there. The default camera looks down by 16 degrees: it sees
#: the light part with the transition at the lower edge, and mirrors find something dark below.
ABOVE, BELOW, LEVEL, BEND = (0.84, 0.88, 0.94), (0.18, 0.2, 0.25), -0.42, 0.35

#: A background of one colour is seen so, but shines with this share of itself from below: mirrors and glass
#: in even light have no shape.
FLOOR = 0.3

#: Layer -> (numbers per pixel, their type).
LAYERS: dict[str, tuple[int, type[Any]]] = {
    "depth": (1, np.float32),
    "normal": (3, np.float32),
    "position": (3, np.float32),
    "surface": (1, np.int32),
    "evaluations": (1, np.int32),
    "nodes": (1, np.int32),
    "candidates": (1, np.int32),
    "spans": (1, np.int32),
    "sandwiches": (1, np.int32),
    "fallbacks": (1, np.int32),
}

_ABI = 1
_TILE = 64  # pixels a side: 10 to 100 ms of work
_BLOCK = 16  # what shade.h wants corners to be multiples of
_PATIENCE = 0.05  # seconds between looks at the keyboard and at `cancel`

Vector = tuple[float, float, float]
Array = NDArray[np.float64]


class CancelledError(BlobscriptError):
    """The caller's `cancel` was set before the picture was complete."""


# ---- the C side ----------------------------------------------------------------------

_Double3 = ctypes.c_double * 3


class _Light(ctypes.Structure):
    """shade_light."""

    _fields_ = [("kind", ctypes.c_int32), ("reserved", ctypes.c_int32), ("place", _Double3), ("color", _Double3)]


class _Picture(ctypes.Structure):
    """shade_picture."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in ("width", "height", "samples")),
        ("seed", ctypes.c_uint32),
        *((name, _Double3) for name in ("eye", "corner", "right", "down", "above", "below")),
        *((name, ctypes.c_double) for name in ("level", "bend")),
        ("shown", _Double3),
        *((name, _Double3) for name in ("ambient", "tilt")),
        ("fill", ctypes.c_double),
        *((name, ctypes.c_int32) for name in ("light_count", "painted", "transparent", "plain")),
        *((name, ctypes.c_void_p) for name in ("lights", "materials", "surface_material", "thresholds")),
    ]


class _Layers(ctypes.Structure):
    """shade_layers."""

    _fields_ = [(name, ctypes.c_void_p) for name in LAYERS]


@lru_cache(maxsize=1)
def _library() -> ctypes.CDLL:
    library = load()
    pointer, whole = ctypes.c_void_p, ctypes.c_int32
    library.shade_abi.restype = whole
    library.shade_tile.restype = whole
    library.shade_tile.argtypes = [pointer, pointer, pointer, pointer, whole, whole, whole, whole, pointer, pointer]
    library.shade_pattern.restype = None
    library.shade_pattern.argtypes = [ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32, whole, pointer]
    if library.shade_abi() != _ABI:
        raise BlobscriptError("the tracer belongs to another version of blobscript: install again")
    return library


# ---- packing -------------------------------------------------------------------------


@dataclass(slots=True, eq=False)
class _Packed:
    """A shade_picture and the arrays that it points into."""

    picture: _Picture
    keep: tuple[Any, ...]


def _pack(scene: ir.Scene, width: int, height: int, samples: int, seed: int) -> _Packed:
    above, below = _gradient(scene.background)
    ambient, tilt = _ambient(above, below)
    eye, corner, right, down = _view(camera_for(scene, width, height), width, height)
    lights = (_Light * max(len(scene.lights), 1))(*map(_light, scene.lights))
    materials = np.array([_row(m) for m in scene.materials], np.float64).reshape(-1, MATERIAL)
    surface_material = np.array([s.material for s in scene.surfaces], np.int32)
    thresholds = np.array([s.threshold for s in scene.surfaces], np.float64)
    picture = _Picture(
        width=width,
        height=height,
        samples=samples,
        seed=seed & 0xFFFFFFFF,
        eye=_Double3(*eye),
        corner=_Double3(*corner),
        right=_Double3(*right),
        down=_Double3(*down),
        above=_Double3(*above),
        below=_Double3(*below),
        level=LEVEL,
        bend=BEND,
        shown=_Double3(*scene.background.color),
        ambient=_Double3(*ambient),
        tilt=_Double3(*tilt),
        fill=FILL,
        light_count=len(scene.lights),
        painted=any(_painted(s.field, s.material) for s in scene.surfaces),
        transparent=bool(np.any(materials[:, 6] > 0)),
        plain=not scene.background.default,
        lights=ctypes.addressof(lights),
        materials=materials.ctypes.data,
        surface_material=surface_material.ctypes.data,
        thresholds=thresholds.ctypes.data,
    )
    return _Packed(picture, (lights, materials, surface_material, thresholds))


def _view(camera: ir.Camera, width: int, height: int) -> tuple[Array, Array, Array, Array]:
    """Eye, direction through the top left corner, and the steps of a pixel to the right and down."""
    eye = np.array(camera.at)
    ahead = _unit(np.array(camera.to) - eye)
    side = _unit(np.cross(ahead, np.array(camera.up)))
    top = np.cross(side, ahead)
    step = 2 * math.tan(camera.fov / 2) / height
    right, down = step * side, -step * top
    return eye, ahead - right * (width / 2) - down * (height / 2), right, down


def _unit(v: Array) -> Array:
    v = v / np.abs(v).max()
    return v / np.linalg.norm(v)


def _light(light: ir.Light) -> _Light:
    match light:
        case ir.Sun(toward, color):
            return _Light(0, 0, _Double3(*-_unit(np.array(toward, np.float64))), _Double3(*color))
        case ir.Lamp(at, color):
            return _Light(1, 0, _Double3(*at), _Double3(*color))


def _row(m: ir.Material) -> tuple[float, ...]:
    plain = (m.roughness, m.metalness, m.specular, m.transmission, m.ior)
    return (*m.color, *plain, *m.absorption, *m.emission, m.reflection)


def _painted(field: ir.Field, material: int) -> bool:
    """Does any blob have another material than its surface?"""
    match field:
        case ir.Leaf():
            return bool(np.any((field.paint >= 0) & (field.paint != material)))
        case ir.Node():
            return any(_painted(child, material) for child in field.children)


def _gradient(background: ir.Background) -> tuple[Vector, Vector]:
    """Radiance above and below."""
    r, g, b = background.color
    return (ABOVE, BELOW) if background.default else ((r, g, b), (FLOOR * r, FLOOR * g, FLOOR * b))


def _ambient(above: Vector, below: Vector) -> tuple[Array, Array]:
    """Irradiance / pi on a surface with normal n is the first + n.y times the second.

    That is exact for the background's projection on spherical harmonics up to order one: with <> the mean
    over the sphere, so over y in -1..1, L(y) has the mean <L> and the linear part 3 <L y> y; the irradiance of
    a constant 1 is pi, that of y is 2 pi / 3 n.y (Ramamoorthi and Hanrahan 2001).
    """
    y = (np.arange(4096) + 0.5) / 2048 - 1
    share = (1 + (y - LEVEL) / np.hypot(y - LEVEL, BEND)) / 2
    mean, slope = float(np.mean(share)), 3 * float(np.mean(share * y))
    a, b = np.array(above, np.float64), np.array(below, np.float64)
    return b + (a - b) * mean, (a - b) * slope * (2 / 3)


# ---- tiles ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Area:
    """Pixels [x0, x1) x [y0, y1)."""

    x0: int
    y0: int
    x1: int
    y1: int


def _tiles(width: int, height: int, region: _Area) -> list[_Area]:
    """Tiles of the whole picture's grid, those that the region meets, cut to the blocks it needs."""
    tiles: list[_Area] = []
    for y, x in itertools.product(range(0, height, _TILE), range(0, width, _TILE)):
        x0, y0 = max(x, region.x0 // _BLOCK * _BLOCK), max(y, region.y0 // _BLOCK * _BLOCK)
        x1, y1 = min(x + _TILE, width, _up(region.x1)), min(y + _TILE, height, _up(region.y1))
        if x0 < x1 and y0 < y1:
            tiles.append(_Area(x0, y0, x1, y1))
    return tiles


def _up(size: int) -> int:
    return -(-size // _BLOCK) * _BLOCK


class _Canvas:
    """The arrays of a picture's region, filled tile by tile."""

    def __init__(self, region: _Area, aov: Sequence[str]) -> None:
        self.region = region
        shape = (region.y1 - region.y0, region.x1 - region.x0)
        self.rgba = np.empty((*shape, 4), np.float32)
        self.aov = {name: np.empty(_shape(shape, name), LAYERS[name][1]) for name in aov}

    def put(self, tile: _Area, rgba: NDArray[np.float32], layers: dict[str, NDArray[Any]]) -> None:
        r = self.region
        x0, y0, x1, y1 = max(tile.x0, r.x0), max(tile.y0, r.y0), min(tile.x1, r.x1), min(tile.y1, r.y1)
        there = np.s_[y0 - r.y0 : y1 - r.y0, x0 - r.x0 : x1 - r.x0]
        here = np.s_[y0 - tile.y0 : y1 - tile.y0, x0 - tile.x0 : x1 - tile.x0]
        self.rgba[there] = rgba[here]
        for name, values in layers.items():
            self.aov[name][there] = values[here]


def _shape(shape: tuple[int, int], layer: str) -> tuple[int, ...]:
    numbers = LAYERS[layer][0]
    return shape if numbers == 1 else (*shape, numbers)


class _Job:
    """What the threads share: the tiles left, the canvas, and the flag that stops the C."""

    def __init__(self, native: Native, packed: _Packed, query: Any, index: str, canvas: _Canvas) -> None:
        self._native, self._packed, self._query, self._canvas = native, packed, query, canvas
        self._index = native.index_pointer(index)
        self._library = _library()
        self._stop = ctypes.c_int32(0)
        query.cancel = ctypes.addressof(self._stop)

    def stop(self) -> None:
        self._stop.value = 1

    def make(self, tile: _Area) -> int:
        """One tile, into the canvas; returns its number of pixels, 0 if stopped."""
        if self._stop.value:
            return 0
        shape = (tile.y1 - tile.y0, tile.x1 - tile.x0)
        rgba = np.empty((*shape, 4), np.float32)
        layers = {name: np.empty(_shape(shape, name), LAYERS[name][1]) for name in self._canvas.aov}
        pointers = _Layers(**{name: values.ctypes.data for name, values in layers.items()})
        status = self._library.shade_tile(
            self._native.scene_pointer,
            self._index,
            ctypes.addressof(self._query),
            ctypes.addressof(self._packed.picture),
            tile.x0,
            tile.y0,
            tile.x1,
            tile.y1,
            rgba.ctypes.data,
            ctypes.addressof(pointers) if layers else None,
        )
        if self._stop.value:
            return 0
        check_status(status)
        self._canvas.put(tile, rgba, layers)
        return shape[0] * shape[1]


def _run(
    job: _Job,
    tiles: Sequence[_Area],
    threads: int,
    progress: Callable[[int, int], None] | None,
    cancel: threading.Event | None,
) -> None:
    """All tiles on some threads; this one waits, tells, and listens for Ctrl-C and `cancel`."""
    total = sum((t.x1 - t.x0) * (t.y1 - t.y0) for t in tiles)
    done, left = 0, iter(tiles)
    with ThreadPoolExecutor(threads, "tile") as pool:
        running = _submit(pool, job, left, 2 * threads)
        try:
            while running:
                ready, running = wait(running, _PATIENCE, FIRST_COMPLETED)
                if cancel is not None and cancel.is_set():
                    raise CancelledError("the picture was cancelled")
                done += sum(future.result() for future in ready)
                running |= _submit(pool, job, left, len(ready))
                if progress is not None and ready:
                    progress(done, total)
        except BaseException:
            job.stop()
            raise


def _submit(pool: ThreadPoolExecutor, job: _Job, left: Iterator[_Area], count: int) -> set[Future[int]]:
    return {pool.submit(job.make, tile) for tile in itertools.islice(left, count)}


# ---- pictures ------------------------------------------------------------------------


def render(
    scene: ir.Scene,
    native: Native | None = None,
    *,
    width: int | None = None,
    height: int | None = None,
    samples: int = 1,
    threads: int | None = None,
    seed: int = 0,
    aov: Sequence[str] = (),
    region: tuple[int, int, int, int] | None = None,
    search: str = "sandwich",
    index: str = "bvh",
    normals: str = "analytic",
    tolerance: float | None = None,
    step: float | None = None,
    normal_step: float | None = None,
    progress: Callable[[int, int], None] | None = None,
    cancel: threading.Event | None = None,
) -> Image:
    """The picture of a scene, linear light.

    `samples` per pixel: 1 goes through the centre, more are spread over it by `seed` and averaged.
    `region` (x0, y0, x1, y1): only these pixels, row y0 on top, the same to the bit as in the whole
    picture. `progress(pixels done, pixels in all)` is called on this thread. The result does not
    depend on `threads` (None: all cores). Raises `CancelledError` soon after `cancel` is set,
    MemoryError, and ValueError for options that cannot be.
    """
    width = scene.width if width is None else width
    height = scene.height if height is None else height
    area = _checked(width, height, samples, aov, region)
    native = native or Native(scene)
    query = native.query(search, normals, tolerance, step, normal_step)
    canvas = _Canvas(area, aov)
    job = _Job(native, _pack(scene, width, height, samples, seed), query, index, canvas)
    tiles = _tiles(width, height, area)
    _run(job, tiles, min(threads or _cores(), len(tiles)), progress, cancel)
    return Image(canvas.rgba, canvas.aov)


def _checked(
    width: int, height: int, samples: int, aov: Sequence[str], region: tuple[int, int, int, int] | None
) -> _Area:
    if not (0 < width <= ir.LARGEST_SIDE and 0 < height <= ir.LARGEST_SIDE):
        raise ValueError(f"a picture has 1 to {ir.LARGEST_SIDE} pixels a side, not {width}x{height}")
    if not 0 < samples <= 1 << 16:
        raise ValueError(f"samples must lie in 1..65536, not {samples}")
    for name in aov:
        if name not in LAYERS:
            raise ValueError(f"there is no layer {name!r}; known: {', '.join(LAYERS)}")
    area = _Area(*(region or (0, 0, width, height)))
    if not (0 <= area.x0 < area.x1 <= width and 0 <= area.y0 < area.y1 <= height):
        raise ValueError(f"the region {region} does not lie in the picture of {width}x{height} pixels")
    return area


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
