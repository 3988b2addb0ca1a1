"""What the functions on numbers, vectors, colours and lists do.

`FUNCTIONS[name](...)` takes the arguments in the order of the signature. A result that would be no
number raises BadNumberError. The random functions are specified to the bit:

    mix(z):  z ^= z >> 30;  z *= 0xBF58476D1CE4E5B9;  z ^= z >> 27;  z *= 0x94D049BB133111EB;  z ^= z >> 31
    G = 0x9E3779B97F4A7C15;  all arithmetic is modulo 2^64, negative numbers count as two's complement

    rand(i, seed) = (mix(mix(seed + G) + (i + 1) * G) >> 11) / 2^53

which is element i of a SplitMix64 stream (Steele, Lea, Flood: "Fast splittable pseudorandom number
generators", 2014) that starts at mix(seed + G). `noise` is described at its definition.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from blobscript.operators import LARGEST_INT, BadNumberError, plain
from blobscript.values import Color

__all__ = ["FUNCTIONS", "LIST_FUNCTIONS", "LMS_TO_RGB", "OKLAB_TO_LMS"]

Vec3 = tuple[float, float, float]

# ---- numbers ----------------------------------------------------------------------------


def _rounded(function: Callable[[float], int]) -> Callable[[float], int]:
    """A way to round, within the whole numbers that there are."""

    def checked(x: float) -> int:
        if abs(x) <= LARGEST_INT:
            return function(x)
        raise BadNumberError("this is too large for a whole number (the limit is 2^53)")

    return checked


def _half_away(x: float) -> int:
    """The nearest whole number; halves go away from 0. (floor(|x| + 0.5) is wrong just below 0.5.)"""
    down = math.floor(abs(x))
    size = down + (abs(x) - down >= 0.5)
    return -size if x < 0 else size


def _mod(x: float, by: float) -> float:
    if by == 0:
        raise BadNumberError("this divides by zero")
    if not math.isfinite(x) or not math.isfinite(by):
        raise BadNumberError("this is not a finite number")
    return x % by


def _sqrt(x: float) -> float:
    if x < 0:
        raise BadNumberError("negative numbers have no square root")
    return math.sqrt(x)


def _exp(x: float) -> float:
    try:
        return math.exp(x)
    except OverflowError:
        raise BadNumberError("this power of e is too large") from None


def _log(x: float) -> float:
    if not x > 0:
        raise BadNumberError("only positive numbers have a logarithm")
    return math.log(x)


def _sign(x: float) -> int:
    return (x > 0) - (x < 0)


def _clamp(x: float, lo: float, hi: float) -> float:
    if lo > hi:
        raise BadNumberError("`lo` is above `hi`")
    return lo if x < lo else hi if x > hi else x


_BRIGHTEST = 1e6  # part of a colour


def _lerp(a: Any, b: Any, t: float) -> Any:
    """(1 - t) a + t b: exact at both ends, and monotone."""
    if isinstance(a, tuple):
        parts = cast("tuple[float, ...]", a)
        mixed = [(1 - t) * x + t * y for x, y in zip(parts, b, strict=True)]
        return _color_of(mixed, t) if isinstance(a, Color) else tuple(mixed)
    return (1 - t) * a + t * b


def _color_of(parts: list[float], t: float) -> Color:
    """What is mixed of two colours; beyond them no part is negative."""
    if not all(part <= _BRIGHTEST for part in parts):
        raise BadNumberError(f"there is no colour {t:g} of the way from one to another")
    r, g, b, a = (max(part, 0.0) for part in parts)
    return Color(r, g, b, min(a, 1.0))


def _finite(function: Callable[[float], float]) -> Callable[[float], float]:
    """Sine and its kin: infinity has none."""

    def checked(x: float) -> float:
        if not math.isfinite(x):
            raise BadNumberError("this angle is not finite")
        return function(x)

    return checked


def _inverse(function: Callable[[float], float], name: str) -> Callable[[float], float]:
    """asin, acos: rounding may carry a unit vector's part just beyond 1."""

    def checked(x: float) -> float:
        if not abs(x) <= 1 + 1e-12:
            raise BadNumberError(f"`{name}` takes numbers from -1 to 1")
        return function(min(max(x, -1.0), 1.0))

    return checked


def _largest(name: str) -> Callable[..., Any]:
    """max, min of numbers: of a list, or of arguments."""
    choose, choose_array = (max, np.max) if name == "max" else (min, np.min)

    def function(values: Any) -> Any:
        if len(values) == 0:
            raise BadNumberError(f"an empty list has no {name}")
        if isinstance(values, np.ndarray):
            return choose_array(cast("NDArray[Any]", values)).item()
        return choose(values)

    return function


# ---- vectors ------------------------------------------------------------------------------


def _dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vec3, b: Vec3) -> Vec3:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _length(v: Vec3) -> float:
    return math.hypot(v[0], v[1], v[2])


def _normalize(v: Vec3) -> Vec3:
    size = max(abs(v[0]), abs(v[1]), abs(v[2]))
    if size == 0 or not math.isfinite(size):
        raise BadNumberError("this vector has no direction")
    x, y, z = v[0] / size, v[1] / size, v[2] / size
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length)


# ---- colours ------------------------------------------------------------------------------


def _unit(x: float, name: str) -> float:
    """A part of a colour; rounding may carry it a little out."""
    if not -1e-9 <= x <= 1 + 1e-9:
        if 1 < x <= 255:
            raise BadNumberError(f"`{name}` must lie in 0..1, but it is {x:g}; of 255 that is {x:g} / 255")
        raise BadNumberError(f"`{name}` must lie in 0..1, but it is {x:g}")
    return min(max(x, 0.0), 1.0)


def _rgb(r: float, g: float, b: float, a: float = 1.0) -> Color:
    return Color.from_srgb(_unit(r, "r"), _unit(g, "g"), _unit(b, "b"), _unit(a, "a"))


def _hsl(h: float, s: float, l: float, a: float = 1.0) -> Color:  # noqa: E741 - the notation of CSS
    """CSS Color Module Level 4, section 7.1."""
    s, l = _unit(s, "s"), _unit(l, "l")  # noqa: E741
    degrees = math.degrees(h) % 360 if math.isfinite(h) else 0.0

    def part(n: int) -> float:
        k = (n + degrees / 30) % 12
        return l - s * min(l, 1 - l) * max(-1.0, min(k - 3, 9 - k, 1.0))

    return Color.from_srgb(part(0), part(8), part(4), _unit(a, "a"))


def _oklch(l: float, c: float, h: float, a: float = 1.0) -> Color:  # noqa: E741
    """Ottosson, "A perceptual color space for image processing", 2020; parts out of sRGB are cut off."""
    l = _unit(l, "l")  # noqa: E741
    if not (math.isfinite(c) and c >= 0 and math.isfinite(h)):
        raise BadNumberError("`c` must not be negative")
    u, v = c * math.cos(h), c * math.sin(h)
    lms = [_dot((l, u, v), row) ** 3 for row in OKLAB_TO_LMS]
    parts = [_dot(row, (lms[0], lms[1], lms[2])) for row in LMS_TO_RGB]
    r, g, b = (min(max(part, 0.0), 1.0) for part in parts)
    return Color(r, g, b, _unit(a, "a"))


OKLAB_TO_LMS: tuple[Vec3, ...] = (
    (1.0, 0.3963377774, 0.2158037573),
    (1.0, -0.1055613458, -0.0638541728),
    (1.0, -0.0894841775, -1.2914855480),
)
LMS_TO_RGB: tuple[Vec3, ...] = (
    (4.0767416621, -3.3077115913, 0.2309699292),
    (-1.2684380046, 2.6097574011, -0.3413193965),
    (-0.0041960863, -0.7034186147, 1.7076147010),
)

# ---- random -------------------------------------------------------------------------------

_MASK = (1 << 64) - 1
_G = 0x9E3779B97F4A7C15


def _mix(z: int) -> int:
    """The finaliser of SplitMix64 on 64-bit words."""
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & _MASK
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB & _MASK
    return z ^ (z >> 31)


def _rand(i: int, seed: int = 0) -> float:
    return (_mix((_mix((seed + _G) & _MASK) + (i + 1) * _G) & _MASK) >> 11) * 2.0**-53


#: Directions to the middles of a cube's edges (Perlin, "Improving noise", 2002).
_EDGES: tuple[Vec3, ...] = (
    (1, 1, 0), (-1, 1, 0), (1, -1, 0), (-1, -1, 0),
    (1, 0, 1), (-1, 0, 1), (1, 0, -1), (-1, 0, -1),
    (0, 1, 1), (0, -1, 1), (0, 1, -1), (0, -1, -1),
)  # fmt: skip

#: Improved noise reaches 1.0364 at most; this keeps it within [-1, 1].
_NOISE_SCALE = 0.96


def _noise(p: Vec3, seed: int = 0) -> float:
    """Gradient noise: 0 at whole coordinates, smooth to second order, within [-1, 1].

    Corner (i, j, k) of the lattice has the direction number
    (mix(mix(mix(mix(seed + G) + i * G) + j * G) + k * G) >> 32) mod 12 of the cube's edges in the
    order of `_EDGES`. The eight dot products with the way from the corner are interpolated with
    f(t) = t^3 (t (6 t - 15) + 10) along x, then y, then z, as a + f(t) (b - a), and scaled by 0.96.
    """
    if not all(map(math.isfinite, p)):
        raise BadNumberError("this point is not finite")
    (i, x), (j, y), (k, z) = [(math.floor(c), c - math.floor(c)) for c in p]
    fx, fy, fz = [t * t * t * (t * (t * 6 - 15) + 10) for t in (x, y, z)]
    start = _mix((seed + _G) & _MASK)
    along_z: list[float] = []
    columns = [_mix((start + (i + a) * _G) & _MASK) for a in (0, 1)]
    rows = [[_mix((column + (j + b) * _G) & _MASK) for b in (0, 1)] for column in columns]
    for c in (0, 1):
        along_y: list[float] = []
        for b in (0, 1):
            near, far = [
                _dot(_EDGES[(_mix((rows[a][b] + (k + c) * _G) & _MASK) >> 32) % 12], (x - a, y - b, z - c))
                for a in (0, 1)
            ]
            along_y.append(near + fx * (far - near))
        along_z.append(along_y[0] + fy * (along_y[1] - along_y[0]))
    return _NOISE_SCALE * (along_z[0] + fz * (along_z[1] - along_z[0]))


# ---- lists --------------------------------------------------------------------------------


def _find(values: Sequence[Any], where: Any) -> Any:
    call = where.call
    for value in plain(values):
        if call([value]):
            return value
    raise BadNumberError(f"`find` found nothing: none of the {len(values)} elements fits", "E0701")


def _filter(values: Sequence[Any], where: Any) -> list[Any]:
    call = where.call
    return [value for value in plain(values) if call([value])]


def _map(values: Sequence[Any], with_: Any) -> Any:
    column = getattr(values, "column", None)
    if with_.column is not None and column is not None:
        return column(with_.column)
    call = with_.call
    return [call([value]) for value in plain(values)]


def _fold(values: Sequence[Any], start: Any, with_: Any) -> Any:
    call = with_.call
    for value in plain(values):
        start = call([start, value])
    return start


#: Name -> function of the arguments in the order of the signature.
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": abs,
    "sign": _sign,
    "floor": _rounded(math.floor),
    "ceil": _rounded(math.ceil),
    "round": _rounded(_half_away),
    "mod": _mod,
    "sqrt": _sqrt,
    "exp": _exp,
    "log": _log,
    "clamp": _clamp,
    "lerp": _lerp,
    "sin": _finite(math.sin),
    "cos": _finite(math.cos),
    "tan": _finite(math.tan),
    "asin": _inverse(math.asin, "asin"),
    "acos": _inverse(math.acos, "acos"),
    "atan": math.atan,
    "atan2": math.atan2,
    "dot": _dot,
    "cross": _cross,
    "length": _length,
    "normalize": _normalize,
    "rgb": _rgb,
    "hsl": _hsl,
    "oklch": _oklch,
    "rand": _rand,
    "noise": _noise,
    "len": len,
}

#: These go through their first argument, a list, and so cost as many steps as it is long.
LIST_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "max": _largest("max"),
    "min": _largest("min"),
    "find": _find,
    "filter": _filter,
    "map": _map,
    "fold": _fold,
}
