"""Pictures: the scene's looks packed for `tracer/shade.h`, and tiles handed to threads.

What the light does is described in `tracer/shade.h` and `tracer/brdf.h`. Decided here:

- A background that is no light of its own (the default, a colour) lights rough surfaces at `FILL` of its
  radiance: it is a backdrop, and as a sky of full strength it would leave nothing for the lights to do.
  Mirrors and glass show it as it is. `sky` and `environment` are light, and shine as they are.
- With one sample a pixel nothing is left to chance: the light from everywhere is even, lights are points,
  the lens is a pinhole. With more, rays look for it (`indirect`).
- Pictures are linear light. The exposure and the tone curve are applied where a picture becomes integers.

Layers (`aov`) from the rays through the pixel centres, whatever the number of samples:

    depth        distance from the camera along the ray; inf where nothing is hit
    normal       unit normal, outwards; NaN where nothing is hit
    position     where the surface is hit; NaN where nothing is hit
    surface      number of the surface, from 0; -1 where none is hit
    albedo       colour of the material, linear; 0 where nothing is hit
    evaluations  evaluations of the field for that ray; likewise the tracer's counters nodes,
                 candidates, spans, sandwiches, fallbacks

and from the samples:

    direct       light that came straight or by way of one surface; with `indirect` it is the picture
    indirect     all other light
    samples      how many were taken
"""

from __future__ import annotations

import ctypes
import itertools
import math
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.backends.library import MATERIAL, check_status, load
from blobscript.backends.native import Native
from blobscript.diagnostics import BlobscriptError
from blobscript.framing import camera_for
from blobscript.images import Image
from blobscript.texture import OPERATIONS

__all__ = [
    "FILL",
    "INDIRECT",
    "LAYERS",
    "MOST_SAMPLES",
    "CancelledError",
    "Indirect",
    "pack_plain",
    "pack_sky",
    "render",
    "single_reflections",
]

Indirect = Literal["even", "occlusion", "bounce"]
#: ORDER INDIRECT: as in shade.h.
INDIRECT: tuple[Indirect, ...] = ("even", "occlusion", "bounce")
_CURVES = ("linear", "film")

#: Samples of a pixel at most where the noise decides, and at least.
MOST_SAMPLES, _LEAST_SAMPLES = 256, 8

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
    "albedo": (3, np.float32),
    "direct": (3, np.float32),
    "indirect": (3, np.float32),
    "samples": (1, np.int32),
}

_ABI = 3
_TILE = 64  # pixels a side: 10 to 100 ms of work
_MOST = 1 << 17  # samples at most of a band, which goes all across the picture
_BLOCK = 16  # what shade.h wants corners to be multiples of
_PATIENCE = 0.05  # seconds between looks at the keyboard and at `cancel`

Vector = tuple[float, float, float]
Array = NDArray[np.float64]


class CancelledError(BlobscriptError):
    """The caller's `cancel` was set before the picture was complete."""


# ---- the C side ----------------------------------------------------------------------

_Double3 = ctypes.c_double * 3
_INT, _DOUBLE, _POINTER = ctypes.c_int32, ctypes.c_double, ctypes.c_void_p


def _named(kind: Any, names: str) -> list[tuple[str, Any]]:
    return [(name, kind) for name in names.split()]


class _Light(ctypes.Structure):
    """shade_light."""

    _fields_ = [*_named(_INT, "kind reserved"), *_named(_Double3, "place color"), ("size", _DOUBLE)]


class _Sky(ctypes.Structure):
    """shade_sky."""

    _fields_ = [
        *_named(_INT, "kind width height table_width table_height reserved"),
        *_named(_Double3, "above below horizon"),
        *_named(_DOUBLE, "level bend"),
        ("turn", _DOUBLE * 2),
        ("ambient", _Double3),
        ("tilt", _DOUBLE * 9),
        ("fill", _DOUBLE),
        *_named(_POINTER, "pixels rows columns"),
    ]


class _Texture(ctypes.Structure):
    """shade_texture."""

    _fields_ = [
        *_named(_INT, "constant_begin constant_count code_begin code_count output_begin output_count mapped reserved"),
        ("matrix", _DOUBLE * 12),
    ]


class _Picture(ctypes.Structure):
    """shade_picture."""

    _fields_ = [
        *_named(_INT, "width height samples least"),
        ("noise", _DOUBLE),
        ("seed", ctypes.c_uint32),
        ("indirect", _INT),
        *_named(_Double3, "eye corner right down"),
        ("lens", _DOUBLE * 6),
        ("focus", _DOUBLE),
        ("shown", _Double3),
        ("exposure", _DOUBLE),
        *_named(_INT, "curve light_count painted transparent plain floor floor_material material_count"),
        *_named(_INT, "texture_count mark_count clear reserved"),
        ("floor_height", _DOUBLE),
        ("floor_fade", _Double3),
        ("fog", _DOUBLE * 4),
        ("sky", _Sky),
        *_named(_POINTER, "lights materials surface_material thresholds textures constants code outputs marks"),
    ]


class _Layers(ctypes.Structure):
    """shade_layers."""

    _fields_ = [(name, ctypes.c_void_p) for name in LAYERS]


@lru_cache(maxsize=8)
def _library(library: ctypes.CDLL | None = None) -> ctypes.CDLL:
    library = library or load()
    pointer, whole = ctypes.c_void_p, ctypes.c_int32
    library.shade_abi.restype = whole
    library.shade_tile.restype = whole
    library.shade_tile.argtypes = [*[pointer] * 4, *[whole] * 4, *[pointer] * 3]
    library.shade_pattern.restype = None
    library.shade_pattern.argtypes = [ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32, whole, pointer]
    size = ctypes.c_size_t
    for name, arguments in (
        ("shade_evaluate", [pointer, whole, size, pointer, pointer]),
        ("shade_respond", [pointer, size, pointer, pointer, pointer]),
        ("shade_lobe", [pointer, pointer, size, pointer, pointer]),
        ("shade_sky_look", [pointer, size, pointer, pointer]),
        ("shade_sky_draw", [pointer, size, pointer, pointer]),
    ):
        getattr(library, name).restype = None
        getattr(library, name).argtypes = arguments
    if library.shade_abi() != _ABI:
        raise BlobscriptError("the tracer belongs to another version of blobscript: install again")
    return library


def single_reflections(roughness: float, cosines: NDArray[np.float64]) -> NDArray[np.float64]:
    """What facets of a metal that reflect everything return of light from everywhere after a single reflection, by the
    cosines towards the eye (n,) in (0, 1]: the reciprocal of the gain in brdf.h."""
    eyes = np.column_stack([np.sqrt(1 - cosines**2), np.zeros_like(cosines), cosines])
    lights = np.ascontiguousarray(np.broadcast_to((0.0, 0.0, 1.0), eyes.shape))
    answers = np.empty((2, len(eyes), 2, 3))
    metal = ir.Material((1.0, 1.0, 1.0), roughness=roughness, metalness=1.0)
    for material, out in zip((replace(metal, metalness=0.0, specular=1 / 0.08), metal), answers, strict=True):
        row = np.array(_row(material))
        _library().shade_respond(row.ctypes.data, len(eyes), eyes.ctypes.data, lights.ctypes.data, out.ctypes.data)
    return answers[0, :, 1, 0] / answers[1, :, 1, 0]


# ---- packing -------------------------------------------------------------------------


@dataclass(slots=True, eq=False)
class _Packed:
    """A shade_picture and the arrays that it points into."""

    picture: _Picture
    keep: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class _Sampling:
    samples: int
    noise: float
    seed: int
    indirect: Indirect
    transparent: bool = False


def _pack(scene: ir.Scene, width: int, height: int, sampling: _Sampling, tone: ir.Tone) -> _Packed:
    camera = camera_for(scene, width, height)
    eye, corner, right, down = _view(camera, width, height)
    lens, focus = _lens(camera)
    lights = (_Light * max(len(scene.lights), 1))(*map(_light, scene.lights))
    materials = np.array([_row(m) for m in scene.materials], np.float64).reshape(-1, MATERIAL)
    textures = _textures(scene.materials)
    surface_material = np.array([s.material for s in scene.surfaces], np.int32)
    thresholds = np.array([s.threshold for s in scene.surfaces], np.float64)
    sky, image = pack_sky(scene.background)
    picture = _Picture(
        width=width,
        height=height,
        samples=sampling.samples,
        least=min(_LEAST_SAMPLES, sampling.samples),
        noise=sampling.noise,
        seed=sampling.seed & 0xFFFFFFFF,
        indirect=INDIRECT.index(sampling.indirect),
        eye=_Double3(*eye),
        corner=_Double3(*corner),
        right=_Double3(*right),
        down=_Double3(*down),
        lens=(_DOUBLE * 6)(*lens),
        focus=focus,
        shown=_Double3(*scene.background.color),
        exposure=2.0**tone.exposure,
        curve=_CURVES.index(tone.curve),
        light_count=len(scene.lights),
        painted=any(_painted(s.field, s.material) for s in scene.surfaces),
        transparent=bool(np.any(materials[:, 6] > 0)),
        plain=not scene.background.default and (scene.background.light is None or scene.background.shown),
        floor=0 if scene.floor is None else 2 if scene.floor.catch else 1,
        floor_material=scene.floor.material if scene.floor else 0,
        material_count=len(scene.materials),
        texture_count=len(textures.programs),
        mark_count=len(textures.marks),
        clear=sampling.transparent,
        floor_height=scene.floor.height if scene.floor else 0.0,
        floor_fade=_Double3(camera.to[0], camera.to[2], scene.floor.fade if scene.floor else 0.0),
        fog=(_DOUBLE * 4)(*((1 / scene.fog.distance, *scene.fog.color) if scene.fog else (0.0,) * 4)),
        sky=sky,
        lights=ctypes.addressof(lights),
        materials=materials.ctypes.data,
        surface_material=surface_material.ctypes.data,
        thresholds=thresholds.ctypes.data,
        textures=textures.programs.ctypes.data,
        constants=textures.constants.ctypes.data,
        code=textures.code.ctypes.data,
        outputs=textures.outputs.ctypes.data,
        marks=textures.marks.ctypes.data,
    )
    tables = (textures.programs, textures.constants, textures.code, textures.outputs, textures.marks)
    return _Packed(picture, (lights, materials, surface_material, thresholds, *tables, *image))


def pack_plain(scene: ir.Scene, width: int, height: int) -> _Packed:
    """For one sample a pixel."""
    return _pack(scene, width, height, _sampling(1, None, 0, None), scene.tone)


def _view(camera: ir.Camera, width: int, height: int) -> tuple[Array, Array, Array, Array]:
    """Eye, direction through the top left corner, and the steps of a pixel to the right and down."""
    eye = np.array(camera.at)
    ahead = _unit(np.array(camera.to) - eye)
    side = _unit(np.cross(ahead, np.array(camera.up)))
    top = np.cross(side, ahead)
    step = 2 * math.tan(camera.fov / 2) / height
    right, down = step * side, -step * top
    return eye, ahead - right * (width / 2) - down * (height / 2), right, down


def _lens(camera: ir.Camera) -> tuple[list[float], float]:
    """Radius times the lens's axes, and how far away things are sharp; 0: everywhere."""
    if not camera.aperture:
        return [0.0] * 6, 0.0
    eye = np.array(camera.at)
    ahead = _unit(np.array(camera.to) - eye)
    side = _unit(np.cross(ahead, np.array(camera.up)))
    radius, target = camera.aperture / 2, camera.focus if camera.focus is not None else camera.to
    axes = np.concatenate([radius * side, radius * np.cross(side, ahead)])
    return axes.tolist(), float(np.dot(np.array(target) - eye, ahead))


def _unit(v: Array) -> Array:
    v = v / np.abs(v).max()
    return v / np.linalg.norm(v)


def _light(light: ir.Light) -> _Light:
    match light:
        case ir.Sun(toward, color, angle):
            height = 2 * math.sin(angle / 4) ** 2  # 1 - cos(angle / 2)
            return _Light(0, 0, _Double3(*-_unit(np.array(toward, np.float64))), _Double3(*color), height)
        case ir.Lamp(at, color, size):
            return _Light(1, 0, _Double3(*at), _Double3(*color), size / 2)


def _row(m: ir.Material) -> list[float]:
    plain = (m.roughness, m.metalness, m.specular, m.transmission, m.ior)
    row = [*m.color, *plain, *m.absorption, *m.emission, m.reflection]
    for column, _ in m.texture.outputs if m.texture else ():
        if column < len(row):
            row[column] = 0.0
    return row


@dataclass(slots=True, eq=False)
class _Textures:
    """The textures of the materials that have one, as shade_picture has them. `marks` (groups, m, MATERIAL): 1
    where material m has texture number group * MATERIAL + column."""

    programs: NDArray[Any]
    constants: Array
    code: NDArray[np.int32]
    outputs: NDArray[np.int32]
    marks: Array


def _textures(materials: Sequence[ir.Material]) -> _Textures:
    having = [(i, m.texture) for i, m in enumerate(materials) if m.texture is not None]
    marks = np.zeros((-(-len(having) // MATERIAL), len(materials), MATERIAL))
    programs = np.zeros(len(having), np.dtype(_Texture))
    constants: list[float] = []
    code: list[list[int]] = []
    outputs: list[tuple[int, int]] = []
    for number, (material, texture) in enumerate(having):
        marks[number // MATERIAL, material, number % MATERIAL] = 1.0
        row = programs[number]
        row["constant_begin"], row["constant_count"] = len(constants), len(texture.constants)
        row["code_begin"], row["code_count"] = len(code), len(texture.code)
        row["output_begin"], row["output_count"] = len(outputs), len(texture.outputs)
        row["mapped"], row["matrix"] = texture.matrix is not None, texture.matrix or (0.0,) * 12
        constants += texture.constants
        code += map(_instruction, texture.code)
        outputs += texture.outputs
    return _Textures(
        programs,
        np.array(constants, np.float64),
        np.array(code, np.int32).reshape(-1, 6),
        np.array(outputs, np.int32).reshape(-1, 2),
        marks,
    )


def _instruction(step: tuple[str | int, ...]) -> list[int]:
    """A row of shade_picture.code."""
    name, *registers = step
    return [_OPERATIONS[str(name)], *map(int, registers), *[0] * (5 - len(registers))]


_OPERATIONS = {name: i for i, name in enumerate(OPERATIONS)}


def _painted(field: ir.Field, material: int) -> bool:
    """Does any blob have another material than its surface?"""
    match field:
        case ir.Leaf():
            return bool(np.any((field.paint >= 0) & (field.paint != material)))
        case ir.Node():
            return any(_painted(child, material) for child in field.children)


# ---- the sky -------------------------------------------------------------------------


def pack_sky(background: ir.Background) -> tuple[_Sky, tuple[Any, ...]]:
    """A shade_sky, and the arrays that it points into."""
    match background.light:
        case ir.Environment():
            return _image_sky(background.light)
        case ir.Sky(zenith, horizon, ground):
            sky = _Sky(kind=1, above=_Double3(*zenith), horizon=_Double3(*horizon), below=_Double3(*ground), fill=1.0)
            _set_ambient(sky, *_ambient_of_heights(lambda y: sky_colors(background.light, y)))
            return sky, ()
        case None:
            above, below = _gradient(background)
            sky = _Sky(kind=0, above=_Double3(*above), below=_Double3(*below), level=LEVEL, bend=BEND, fill=FILL)
            _set_ambient(sky, *_ambient(above, below))
            return sky, ()


def _set_ambient(sky: _Sky, mean: Array, rise: Array) -> None:
    """mean (3,) and rise (3,), the part that follows n.y, or (3, 3) by colour and axis."""
    tilt = np.zeros((3, 3))
    tilt[:, 1] = rise if rise.ndim == 1 else 0.0
    sky.ambient = _Double3(*mean)
    sky.tilt = (_DOUBLE * 9)(*(tilt if rise.ndim == 1 else rise).ravel())


def sky_colors(sky: Any, y: Array) -> Array:
    """Radiance (n, 3) of an ir.Sky at the heights y (n,) of unit directions."""
    zenith, horizon, ground = (np.array(c) for c in (sky.zenith, sky.horizon, sky.ground))
    up = ((1 - np.clip(y, 0, 1)) ** 3)[:, None]
    x = np.clip(-y / 0.12, 0, 1)
    down = (x * x * (3 - 2 * x))[:, None]
    return np.where((y >= 0)[:, None], zenith + (horizon - zenith) * up, horizon + (ground - horizon) * down)


def _ambient_of_heights(radiance: Callable[[Array], Array]) -> tuple[Array, Array]:
    """As `_ambient`, for any sky that depends on the height alone."""
    y = (np.arange(4096) + 0.5) / 2048 - 1
    light = radiance(y)
    return light.mean(axis=0), 3 * (light * y[:, None]).mean(axis=0) * (2 / 3)


#: Columns and rows of the table by which environments are sampled, at most.
_TABLE = (512, 256)


def _image_sky(environment: ir.Environment) -> tuple[_Sky, tuple[Any, ...]]:
    pixels = np.ascontiguousarray(environment.pixels, np.float32)
    height, width = pixels.shape[:2]
    edges = np.cos(np.linspace(0, math.pi, height + 1))
    solid = (edges[:-1] - edges[1:]) * (2 * math.pi / width)  # of a pixel, by row
    rows, columns = _table(pixels, solid)
    mean, tilt = _moments(pixels.astype(np.float64), solid, environment.turn)
    sky = _Sky(
        kind=2,
        width=width,
        height=height,
        table_width=columns.shape[1] - 1,
        table_height=len(columns),
        turn=(_DOUBLE * 2)(math.cos(environment.turn), math.sin(environment.turn)),
        fill=1.0,
        pixels=pixels.ctypes.data,
        rows=rows.ctypes.data,
        columns=columns.ctypes.data,
    )
    _set_ambient(sky, mean, tilt)
    return sky, (pixels, rows, columns)


def _table(pixels: NDArray[np.float32], solid: Array) -> tuple[Array, Array]:
    """Cumulative shares of the light: by row (h + 1,), and within each row (h, w + 1). A tenth is spread
    evenly, so that no direction with light is left out."""
    light = (pixels.max(axis=2) * solid[:, None]).astype(np.float64)
    light = _coarser(light, _TABLE[1], _TABLE[0])
    edges = np.cos(np.linspace(0, math.pi, len(light) + 1))
    even = np.repeat((edges[:-1] - edges[1:])[:, None], light.shape[1], axis=1)
    total = light.sum()
    share = 0.9 * light / total + 0.1 * even / even.sum() if total > 0 else even / even.sum()
    rows = np.concatenate([[0.0], np.cumsum(share.sum(axis=1))])
    columns = np.concatenate([np.zeros((len(share), 1)), np.cumsum(share, axis=1)], axis=1)
    columns /= columns[:, -1:]
    return rows / rows[-1], np.ascontiguousarray(columns)


def _coarser(light: Array, rows: int, columns: int) -> Array:
    """Sums over blocks of cells, as many as it takes; what cells there are must divide into them."""
    height, width = light.shape
    down, across = -(-height // rows), -(-width // columns)
    while height % down:
        down += 1
    while width % across:
        across += 1
    return light.reshape(height // down, down, width // across, across).sum(axis=(1, 3))


def _moments(pixels: Array, solid: Array, turn: float) -> tuple[Array, Array]:
    """Mean radiance (3,), and by colour and axis what a normal's part along the axis adds (3, 3); see `_ambient`."""
    height, width = pixels.shape[:2]
    theta = (np.arange(height, dtype=np.float64) + 0.5) * (math.pi / height)
    phi = ((np.arange(width, dtype=np.float64) + 0.5) / width - 0.5) * (2 * math.pi)
    x, z = np.sin(phi), -np.cos(phi)
    ring = np.stack([math.cos(turn) * x + math.sin(turn) * z, -math.sin(turn) * x + math.cos(turn) * z])
    by_row = pixels.sum(axis=1) * solid[:, None]
    level = np.einsum("hwc,aw,h->ca", pixels, ring, solid * np.sin(theta))
    rise = (by_row * np.cos(theta)[:, None]).sum(axis=0)
    linear = np.stack([level[:, 0], rise, level[:, 1]], axis=1) / (4 * math.pi)
    return by_row.sum(axis=0) / (4 * math.pi), 3 * linear * (2 / 3)


def _gradient(background: ir.Background) -> tuple[Vector, Vector]:
    """Radiance above and below."""
    r, g, b = background.color
    return (ABOVE, BELOW) if background.default else ((r, g, b), (FLOOR * r, FLOOR * g, FLOOR * b))


@lru_cache(maxsize=16)
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


def _band(width: int, height: int, sampling: _Sampling, threads: int) -> int:
    """Rows of a band: few calls and pixels that need no copy, but some bands for each thread. 0: squares do better,
    as where rays go on, and blocks take long."""
    rows = min(_MOST // (width * sampling.samples), height // (4 * threads)) // _BLOCK * _BLOCK
    return rows if sampling.indirect == "even" else 0


def _tiles(width: int, height: int, region: _Area, band: int = 0) -> list[_Area]:
    """Tiles of the whole picture's grid, those that the region meets, cut to the blocks it needs."""
    across, down = (width, band) if band else (_TILE, _TILE)
    tiles: list[_Area] = []
    for y, x in itertools.product(range(0, height, down), range(0, width, across)):
        x0, y0 = max(x, region.x0 // _BLOCK * _BLOCK), max(y, region.y0 // _BLOCK * _BLOCK)
        x1, y1 = min(x + across, width, _up(region.x1)), min(y + down, height, _up(region.y1))
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

    def room(self, tile: _Area) -> NDArray[np.float32]:
        """Where the tile's pixels go: their rows of the canvas, if it has these and no others, else other memory."""
        r = self.region
        if (tile.x0, tile.x1) == (r.x0, r.x1) and r.y0 <= tile.y0 and tile.y1 <= r.y1:
            return self.rgba[tile.y0 - r.y0 : tile.y1 - r.y0]
        return np.empty((tile.y1 - tile.y0, tile.x1 - tile.x0, 4), np.float32)

    def put(self, tile: _Area, rgba: NDArray[np.float32], layers: dict[str, NDArray[Any]]) -> None:
        r = self.region
        x0, y0, x1, y1 = max(tile.x0, r.x0), max(tile.y0, r.y0), min(tile.x1, r.x1), min(tile.y1, r.y1)
        there = np.s_[y0 - r.y0 : y1 - r.y0, x0 - r.x0 : x1 - r.x0]
        here = np.s_[y0 - tile.y0 : y1 - tile.y0, x0 - tile.x0 : x1 - tile.x0]
        if rgba.base is not self.rgba:
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
        self._library = _library(native.library)
        self._stop = ctypes.c_int32(0)
        self._lock = threading.Lock()
        self.seconds = np.zeros(2)  # processor time of the tracer's queries, and of all
        self.done = 0  # pixels
        query.cancel = ctypes.addressof(self._stop)

    def stop(self) -> None:
        self._stop.value = 1

    def work(self, left: Iterator[_Area]) -> None:
        """Tiles, one after the other, until there are none left or it is stopped."""
        for tile in left:
            if self._stop.value:
                return
            self._make(tile)

    def _make(self, tile: _Area) -> None:
        """One tile, into the canvas."""
        shape = (tile.y1 - tile.y0, tile.x1 - tile.x0)
        rgba = self._canvas.room(tile)
        layers = {name: np.empty(_shape(shape, name), LAYERS[name][1]) for name in self._canvas.aov}
        pointers = _Layers(**{name: values.ctypes.data for name, values in layers.items()})
        seconds = np.zeros(2)
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
            seconds.ctypes.data,
        )
        if self._stop.value:
            return
        check_status(status)
        self._canvas.put(tile, rgba, layers)
        with self._lock:
            self.seconds += seconds
            self.done += shape[0] * shape[1]


def _run(
    job: _Job,
    tiles: Sequence[_Area],
    threads: int,
    progress: Callable[[int, int], None] | None,
    cancel: threading.Event | None,
) -> None:
    """All tiles on some threads; this one waits, tells, and listens for Ctrl-C and `cancel`."""
    total = sum((t.x1 - t.x0) * (t.y1 - t.y0) for t in tiles)
    told, left = 0, iter(tiles)
    with ThreadPoolExecutor(threads, "tile") as pool:
        running = {pool.submit(job.work, left) for _ in range(threads)}
        try:
            while running:
                ready, running = wait(running, _PATIENCE, FIRST_COMPLETED)
                if cancel is not None and cancel.is_set():
                    raise CancelledError("the picture was cancelled")
                for future in ready:
                    future.result()
                if progress is not None and job.done > told:
                    told = job.done
                    progress(told, total)
        except BaseException:
            job.stop()
            raise


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
    noise: float | None = None,
    indirect: Indirect | None = None,
    tone: ir.Tone | None = None,
    transparent: bool = False,
    progress: Callable[[int, int], None] | None = None,
    cancel: threading.Event | None = None,
) -> Image:
    """The picture of a scene, linear light.

    `samples` per pixel: 1 goes through the centre, more are spread over it by `seed` and averaged. With
    `noise`, a cell of 4 x 4 pixels gets as many as it takes for the error of its pixels to fall below it (root
    mean square, as they will be shown, white is 1): 8 to `samples`, or to MOST_SAMPLES if that is 1.
    `indirect`: how light from everywhere is found: "even" is free of noise and occlusion, and what one sample
    gets by default; "occlusion" and "bounce" follow one more ray per sample (tracer/shade.h).
    `tone`: instead of the scene's. `transparent`: the background is left out, alpha tells what hides it; of a floor
    that catches shadows only they are left.
    `region` (x0, y0, x1, y1): only these pixels, row y0 on top, the same to the bit as in the whole
    picture. `progress(pixels done, pixels in all)` is called on this thread. The result does not
    depend on `threads` (None: all cores). Raises `CancelledError` soon after `cancel` is set,
    MemoryError, and ValueError for options that cannot be.
    """
    width = scene.width if width is None else width
    height = scene.height if height is None else height
    area = _checked(width, height, samples, aov, region)
    sampling = replace(_sampling(samples, noise, seed, indirect), transparent=transparent)
    shown = tone or scene.tone
    start = time.perf_counter()
    if threads is not None and threads < 1:
        raise ValueError(f"threads must be at least 1 (None: all cores), not {threads}")
    native = native or Native(scene)
    native.index_pointer(index)
    indexed = time.perf_counter()
    query = native.query(search, normals, tolerance, step, normal_step)
    canvas = _Canvas(area, aov)
    job = _Job(native, _pack(scene, width, height, sampling, shown), query, index, canvas)
    threads = threads or _cores()
    tiles = _tiles(width, height, area, _band(width, height, sampling, threads))
    _run(job, tiles, min(threads, len(tiles)), progress, cancel)
    hits, all_of_it = job.seconds.tolist()
    timing = {"index": indexed - start, "hits": hits, "shading": all_of_it - hits}
    return Image(canvas.rgba, canvas.aov, {}, shown.curve, shown.exposure, timing)


def _sampling(samples: int, noise: float | None, seed: int, indirect: Indirect | None) -> _Sampling:
    if noise is not None and not 0 < noise < 1:
        raise ValueError(f"noise must lie between 0 and 1, not {noise}")
    if indirect is not None and indirect not in INDIRECT:
        raise ValueError(f"indirect must be one of {', '.join(INDIRECT)}, not {indirect!r}")
    if noise is not None and samples == 1:
        samples = MOST_SAMPLES
    return _Sampling(samples, noise or 0.0, seed, indirect or ("even" if samples == 1 else "bounce"))


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
