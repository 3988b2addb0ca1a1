"""Fields that are too large for functions, as samples on a grid: POV-Ray's `density_file` (df3).

The field is sampled where its surface may be; bounds prove that the rest lies inside or outside. POV-Ray
interpolates by Catmull and Rom's cubic along each axis, `interpolate 2` (sample i at the share i / n of the side;
measured). Sampled is x / sqrt(1 + x^2) with x = (density - threshold) / (8 |threshold|), which has the same surface, is
hardly bent near it, and lies between -1 and 1: high peaks do not cost digits, nor make the interpolation swing over
the threshold. How far the surface is off is measured against the field itself, in both directions: places of
the one on the other.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from blobscript import field, ir
from blobscript.backends.native import Native
from blobscript.enclosure import surface_box
from blobscript.povray.text import Array

__all__ = ["Grid", "Piece", "sampled"]

Words = NDArray[np.int64]

#: Samples beyond the box of the surface on each side: what interpolation needs, and a little.
_MARGIN = 4
#: Sides of the boxes that bounds decide about, and of the containers of POV-Ray's isosurfaces, in steps.
_BLOCK, _PIECE = 8, 16
#: Places by which the error is measured, in each direction.
_PLACES = 4000
#: Points evaluated at once.
_CHUNK = 1 << 18
#: Densities that differ from the threshold by so many times the threshold are bent by a third.
_BEND = 8.0
#: Interpolation along two axes multiplies a slope along the third by at most (5/4)^2.
_SPREAD = 1.5625


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A container and a proved bound on the interpolation's gradient there."""

    lo: Array
    hi: Array
    max_gradient: float


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """samples (nz, ny, nx): 0..1, the surface is where the interpolation is 1/2, at `lo` + i `step`.

    median, most: how far the surface is off at places on both; lost: the share of them that have no counterpart
    within a few steps. Lengths are those of the surface that was sampled.
    """

    lo: Array
    step: float
    samples: NDArray[np.uint32]
    pieces: tuple[Piece, ...]
    median: float
    most: float
    lost: float

    @property
    def counts(self) -> tuple[int, int, int]:
        nz, ny, nx = self.samples.shape
        return nx, ny, nz

    def data(self) -> bytes:
        """The file: three sizes, then the samples, x fastest, highest byte first."""
        return struct.pack(">3H", *self.counts) + self.samples.astype(">u4").tobytes()


def sampled(surface: ir.Surface, count: int) -> Grid | None:
    """With `count` samples along the longest side; None where the surface is proved empty."""
    box = surface_box(surface, precision=1 / 16)
    if box is None:
        return None
    step = float((box[1] - box[0]).max()) / max(count - 2 * _MARGIN - 1, 1)
    lo = box[0] - _MARGIN * step
    sizes = [int(n) + 2 * _MARGIN + 2 for n in np.ceil((box[1] - box[0]) / step).tolist()]
    native = Native(_alone(surface))
    blocks, values = _values(surface, native, lo, step, (sizes[2], sizes[1], sizes[0]))
    crossed = _crossed_cells(values, surface.threshold)
    if not crossed.any():
        return None
    samples = np.round(_shares(values, surface.threshold) * (2.0**32 - 1)).astype(np.uint32)
    shares = samples / (2.0**32 - 1)
    median, most, lost = _errors(surface, native, lo, step, shares, crossed)
    return Grid(lo, step, samples, tuple(_pieces(lo, step, shares, blocks)), median, most, lost)


def _alone(surface: ir.Surface) -> ir.Scene:
    camera = ir.Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0)
    materials = tuple(ir.Material((1.0, 1.0, 1.0)) for _ in range(_materials(surface)))
    return ir.Scene((surface,), materials, camera, (), ir.Background((0.0, 0.0, 0.0)))


def _materials(surface: ir.Surface) -> int:
    paints = [int(leaf.paint.max(initial=-1)) for leaf in ir.leaves(surface.field)]
    return 1 + max([surface.material, *paints])


# ---- samples ------------------------------------------------------------------------------------


def _values(
    surface: ir.Surface, native: Native, lo: Array, step: float, shape: tuple[int, int, int]
) -> tuple[list[tuple[int, int, int]], Array]:
    """The blocks (z, y, x of their first sample) that the surface may cross, and the field: exact in them and
    two steps around, elsewhere within its bounds, and 0 if it may be."""
    values = np.zeros(shape)
    wanted = np.zeros(shape, np.bool_)
    blocks = _blocks(surface, lo, step, shape, values)
    for z, y, x in blocks:
        wanted[tuple(slice(max(a - 2, 0), a + _BLOCK + 3) for a in (z, y, x))] = True
    places = np.flatnonzero(wanted)
    for start in range(0, len(places), _CHUNK):
        part = places[start : start + _CHUNK]
        index = np.stack(np.unravel_index(part, shape)[::-1], axis=1)
        values.reshape(-1)[part] = native.field(lo + step * index)
    return blocks, values


def _blocks(
    surface: ir.Surface, lo: Array, step: float, shape: tuple[int, int, int], values: Array
) -> list[tuple[int, int, int]]:
    """Halved from large to small; those decided are written into `values`."""
    side = _BLOCK
    while side < max(shape):
        side *= 2
    corners = np.zeros((1, 3), np.int64)  # z, y, x
    while True:
        first = lo + step * corners[:, ::-1]
        low, high = field.bounds(surface.field, first, first + step * side)
        crossed = (low <= surface.threshold) & (high >= surface.threshold)
        within = np.clip(0.0, low, high)
        for i in np.flatnonzero(~crossed & (within != 0.0)).tolist():
            z, y, x = corners[i].tolist()
            values[z : z + side, y : y + side, x : x + side] = within[i]
        corners = corners[crossed]
        if side == _BLOCK:
            return [(int(z), int(y), int(x)) for z, y, x in corners]
        side //= 2
        halves = np.array(list(product((0, side), repeat=3)))
        corners = (corners[:, None] + halves[None]).reshape(-1, 3)
        corners = corners[(corners < np.array(shape)).all(axis=1)]


def _crossed_cells(values: Array, threshold: float) -> NDArray[np.bool_]:
    """Cells, by their first sample, whose corners are not all on one side."""
    inside = values >= threshold
    some, every = np.zeros(np.subtract(values.shape, 1), np.bool_), np.ones(np.subtract(values.shape, 1), np.bool_)
    for shift in product((0, 1), repeat=3):
        corner = inside[_from(values.shape, shift, 1)]
        some |= corner
        every &= corner
    return some & ~every


def _from(shape: tuple[int, ...], shift: tuple[int, ...], less: int) -> tuple[slice, ...]:
    return tuple(slice(a, n - less + a) for a, n in zip(shift, shape, strict=True))


def _shares(values: Array, threshold: float) -> Array:
    """0..1, and 1/2 on the surface."""
    x = np.clip((values - threshold) / (_BEND * abs(threshold)), -1e9, 1e9)
    return 0.5 + 0.5 * x / np.sqrt(1.0 + x * x)


# ---- the interpolation, as POV-Ray's --------------------------------------------------------------


def _weights(t: Array) -> Array:
    """Catmull and Rom (1974), (n,) -> (4, n)."""
    return np.stack(
        [
            ((-0.5 * t + 1.0) * t - 0.5) * t,
            (1.5 * t - 2.5) * t * t + 1.0,
            ((-1.5 * t + 2.0) * t + 0.5) * t,
            (0.5 * t - 0.5) * t * t,
        ]
    )


def _interpolated(shares: Array, at: Array) -> Array:
    """At places (n, 3) in steps from the first sample, x y z."""
    most = np.array(shares.shape[::-1]) - 3
    cell = np.clip(np.floor(at).astype(np.int64), 1, most)
    weights = [_weights(t) for t in (at - cell).T]
    total = np.zeros(len(at))
    for (i, wx), (j, wy), (k, wz) in product(*(enumerate(w) for w in weights)):
        total += wx * wy * wz * shares[cell[:, 2] + k - 1, cell[:, 1] + j - 1, cell[:, 0] + i - 1]
    return total


def _pieces(lo: Array, step: float, shares: Array, blocks: list[tuple[int, int, int]]) -> Iterator[Piece]:
    """Containers around the blocks, with the steepest slope of their cells: along an axis the slope of the cubic lies
    between the three Bezier ordinates of its derivative, and the other two axes blend such slopes."""
    many: dict[tuple[int, ...], list[tuple[int, int, int]]] = {}
    for block in blocks:
        many.setdefault(tuple(a // _PIECE for a in block), []).append(block)
    for group in many.values():
        first = np.maximum(np.min(group, axis=0), 2)
        last = np.minimum(np.max(group, axis=0) + _BLOCK, np.array(shares.shape) - 3)
        around = shares[tuple(slice(a - 2, b + 3) for a, b in zip(first.tolist(), last.tolist(), strict=True))]
        slopes = [_steepest(np.moveaxis(around, axis, 0)) for axis in range(3)]
        steep = _SPREAD * float(np.linalg.norm(slopes)) / step
        # a little into the next cells, so that no crossing is lost in a wall
        yield Piece(lo + step * (first[::-1] - 0.01), lo + step * (last[::-1] + 0.01), max(steep, 1e-30) * 1.000001)


def _steepest(v: Array) -> float:
    """Along the first axis, per step."""
    central = 0.5 * np.abs(v[2:] - v[:-2])
    middle = np.abs(3.0 * (v[2:-1] - v[1:-2]) - 0.5 * (v[2:-1] - v[:-3]) - 0.5 * (v[3:] - v[1:-2]))
    return float(max(central.max(initial=0.0), middle.max(initial=0.0)))


# ---- how far it is off ---------------------------------------------------------------------------


def _errors(
    surface: ir.Surface,
    native: Native,
    lo: Array,
    step: float,
    shares: Array,
    crossed: NDArray[np.bool_],
) -> tuple[float, float, float]:
    """Median and largest distance, and the share of places whose counterpart is farther than three steps."""
    rng = np.random.default_rng(0)
    there = _places_there(surface, native, rng)
    here = lo + step * _places_here(shares, crossed, rng)
    apart = np.concatenate(
        [
            2.0
            * _BEND
            * abs(surface.threshold)
            * np.abs(_interpolated(shares, (there - lo) / step) - 0.5)
            / _steep(native, there),
            np.abs(native.field(here) - surface.threshold) / _steep(native, here),
        ]
    )
    far = ~(apart <= 3.0 * step)
    near = apart[~far]
    if not len(near):
        return float("inf"), float("inf"), 1.0
    return float(np.median(near)), float(near.max()), float(far.mean())


def _steep(native: Native, places: Array) -> Array:
    return np.maximum(np.linalg.norm(native.gradient(places), axis=1), 1e-300)


def _places_there(surface: ir.Surface, native: Native, rng: np.random.Generator) -> Array:
    """On the surface itself: where rays through the field's box meet it."""
    lo, hi = field.extent(surface.field)
    middle, radius = 0.5 * (lo + hi), 0.5 * float(np.linalg.norm(hi - lo))
    ends = rng.normal(size=(_PLACES, 3))
    origins = middle + 1.01 * radius * ends / np.linalg.norm(ends, axis=1, keepdims=True)
    found = native.first_hit(origins, rng.uniform(lo, hi, (_PLACES, 3)) - origins)
    return found.position[found.hit]


def _places_here(shares: Array, crossed: NDArray[np.bool_], rng: np.random.Generator) -> Array:
    """On the interpolated one, in steps: crossings of lines between opposite corners of cells, by bisection."""
    cells = np.argwhere(crossed[1:-2, 1:-2, 1:-2])[:, ::-1] + 1.0
    cells = cells[rng.permutation(len(cells))[:_PLACES]]
    turn = rng.integers(0, 2, cells.shape).astype(np.float64)
    a, b = cells + turn, cells + 1.0 - turn
    inside = [_interpolated(shares, p) >= 0.5 for p in (a, b)]
    a, b = a[inside[0] != inside[1]], b[inside[0] != inside[1]]
    first = _interpolated(shares, a) >= 0.5
    for _ in range(40):
        middle = 0.5 * (a + b)
        same = (_interpolated(shares, middle) >= 0.5) == first
        a, b = np.where(same[:, None], middle, a), np.where(same[:, None], b, middle)
    return 0.5 * (a + b)
