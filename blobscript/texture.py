"""Textures: small programs over numbers that say how a material depends on the place.

A program is straight: every instruction gives one number from numbers before it, a choice computes both
sides (`select`). So the tracer runs one instruction for many places at a time, and this file, the
specification, is NumPy over all of them. The random operations are those of `builtins`, to the bit.

A number that is none (0 / 0, the root of a negative number) makes that part of the material 0; parts
stay within their limits: shares within 0..1, colours and light from 0 up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from blobscript import ir

__all__ = [
    "BUMP",
    "COLUMNS",
    "LIMITS",
    "MOST",
    "OPERATIONS",
    "Builder",
    "evaluate",
    "evaluate_registers",
    "noise",
    "noise_edges",
    "rand",
]

Array = NDArray[np.float64]
Words = NDArray[np.uint64]

#: Column of a texture's height over the surface; those below are columns of a material row.
BUMP = 15
#: Part of a material -> its columns, in the order of field.MATERIAL_ROW.
COLUMNS: dict[str, tuple[int, ...]] = {
    "color": (0, 1, 2),
    "roughness": (3,),
    "metalness": (4,),
    "emission": (11, 12, 13),
    "bump": (BUMP,),
}
#: Largest value of a column; those without have none. Nothing is below 0 but heights.
LIMITS: dict[int, float] = {0: 1.0, 1: 1.0, 2: 1.0, 3: 1.0, 4: 1.0}

#: Most instructions of a program.
MOST = 4096

# ---- random -----------------------------------------------------------------------------------

_G = np.uint64(0x9E3779B97F4A7C15)
_EDGES = np.array(
    [
        (1, 1, 0),
        (-1, 1, 0),
        (1, -1, 0),
        (-1, -1, 0),
        (1, 0, 1),
        (-1, 0, 1),
        (1, 0, -1),
        (-1, 0, -1),
        (0, 1, 1),
        (0, -1, 1),
        (0, 1, -1),
        (0, -1, -1),
    ],
    np.float64,
)


def _mix(z: Words) -> Words:
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def _word(x: Array) -> Words:
    """Whole numbers as 64-bit words, two's complement; what has no such word is 0."""
    fits = np.abs(x) < 2.0**63
    return np.where(fits, x, 0.0).astype(np.int64).astype(np.uint64)


@np.errstate(all="ignore")
def rand(i: Array, seed: Array) -> Array:
    words = _mix(_mix(_word(seed) + _G) + (_word(i) + np.uint64(1)) * _G) >> np.uint64(11)
    return words.astype(np.float64) * 2.0**-53


@np.errstate(all="ignore")
def noise(x: Array, y: Array, z: Array, seed: Array) -> Array:
    """As `builtins.noise`; 0 where a coordinate is not finite."""
    good = np.isfinite(x) & np.isfinite(y) & np.isfinite(z)
    cells = [np.floor(np.where(good, c, 0.0)) for c in (x, y, z)]
    inner = [np.where(good, c, 0.0) - cell for c, cell in zip((x, y, z), cells, strict=True)]
    words = [_word(cell) for cell in cells]
    fx, fy, fz = [t * t * t * (t * (t * 6.0 - 15.0) + 10.0) for t in inner]
    start = _mix(_word(seed) + _G)
    corner: dict[tuple[int, int, int], Array] = {}
    for a in (0, 1):
        column = _mix(start + (words[0] + np.uint64(a)) * _G)
        for b in (0, 1):
            row = _mix(column + (words[1] + np.uint64(b)) * _G)
            for c in (0, 1):
                edge = _EDGES[((_mix(row + (words[2] + np.uint64(c)) * _G) >> np.uint64(32)) % np.uint64(12))]
                corner[a, b, c] = (
                    edge[..., 0] * (inner[0] - a) + edge[..., 1] * (inner[1] - b) + edge[..., 2] * (inner[2] - c)
                )
    along_z: list[Array] = []
    for c in (0, 1):
        near, far = [corner[0, b, c] + fx * (corner[1, b, c] - corner[0, b, c]) for b in (0, 1)]
        along_z.append(near + fy * (far - near))
    return np.where(good, 0.96 * (along_z[0] + fz * (along_z[1] - along_z[0])), 0.0)


@np.errstate(all="ignore")
def noise_edges(x: Array, y: Array, z: Array, seed: Array) -> NDArray[np.uint64]:
    """Which of the twelve edges `noise` has at corners of its lattice, whole numbers."""
    word = _mix(_word(seed) + _G)
    for c in (x, y, z):
        word = _mix(word + _word(c) * _G)
    return (word >> np.uint64(32)) % np.uint64(12)


# ---- operations -------------------------------------------------------------------------------


def _inverse(function: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """asin, acos: rounding may carry a unit vector's part just beyond 1."""
    return lambda a: function(np.where(np.abs(a) <= 1 + 1e-12, np.clip(a, -1.0, 1.0), np.nan))


def _linear(a: Array) -> Array:
    """A part of a colour, sRGB as in scripts, as linear light."""
    a = np.clip(a, 0.0, 1.0)
    return np.where(a <= 0.04045, a / 12.92, ((a + 0.055) / 1.055) ** 2.4)


def _truth(test: Callable[[Array, Array], Any]) -> Callable[[Array, Array], Array]:
    return lambda a, b: np.where(test(a, b), 1.0, 0.0)


def _smaller(a: Array, b: Array) -> Array:
    return np.where(b < a, b, a)


def _larger(a: Array, b: Array) -> Array:
    return np.where(b > a, b, a)


def _not(a: Array) -> Array:
    return np.where(a != 0, 0.0, 1.0)


def _select(c: Array, a: Array, b: Array) -> Array:
    return np.where(c != 0, a, b)


#: Name -> function of its registers. ORDER TEXTURE: the same order in tracer/texture.h.
OPERATIONS: dict[str, Callable[..., Array]] = {
    "add": np.add,
    "subtract": np.subtract,
    "multiply": np.multiply,
    "divide": np.divide,
    "negate": np.negative,
    "abs": np.abs,
    "floor": np.floor,
    "ceil": np.ceil,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": _inverse(np.arcsin),
    "acos": _inverse(np.arccos),
    "atan": np.arctan,
    "atan2": np.arctan2,
    "power": np.power,
    "mod": np.mod,
    "min": _smaller,
    "max": _larger,
    "less": _truth(np.less),
    "less_equal": _truth(np.less_equal),
    "equal": _truth(np.equal),
    "and": _truth(lambda a, b: (a != 0) & (b != 0)),
    "or": _truth(lambda a, b: (a != 0) | (b != 0)),
    "not": _not,
    "select": _select,
    "noise": noise,
    "rand": rand,
    "linear": _linear,
}


def evaluate(texture: ir.Texture, points: Array) -> Array:
    """(n, 3) places -> (n, m) the outputs in their order, within their limits."""
    values = evaluate_registers(texture, points, tuple(register for _, register in texture.outputs))
    columns = [_limited(column, values[:, i]) for i, (column, _) in enumerate(texture.outputs)]
    return np.stack(columns, axis=1) if columns else values


@np.errstate(all="ignore")
def evaluate_registers(texture: ir.Texture, points: Array, wanted: tuple[int, ...]) -> Array:
    """Some registers of a program at places: (n, 3) -> (n, len(wanted))."""
    places = np.ascontiguousarray(points, dtype=np.float64)
    if texture.matrix is not None:
        m = np.array(texture.matrix).reshape(3, 4)
        places = places @ m[:, :3].T + m[:, 3]
    registers: list[Array] = [*places.T, *(np.full(len(places), c) for c in texture.constants)]
    for name, *inputs in texture.code:
        registers.append(OPERATIONS[str(name)](*(registers[cast(int, i)] for i in inputs)))
    return np.stack([registers[i] for i in wanted], axis=1) if wanted else np.zeros((len(places), 0))


def _limited(column: int, values: Array) -> Array:
    values = np.where(np.isfinite(values), values, 0.0)
    return values if column == BUMP else np.clip(values, 0.0, LIMITS.get(column, np.inf))


# ---- making one -------------------------------------------------------------------------------


@dataclass(slots=True, eq=False)
class Builder:
    """A program while it grows. Numbers are handles: 0, 1, 2 are the place; equal computations are made
    once, and what is constant is computed here."""

    _constants: dict[bytes, int] = field(default_factory=dict[bytes, int])
    _values: dict[int, float] = field(default_factory=dict[int, float])
    _made: dict[tuple[str | int, ...], int] = field(default_factory=dict[tuple[str | int, ...], int])
    _next: int = 3

    def _handle(self) -> int:
        self._next += 1
        return self._next - 1

    def constant(self, value: float) -> int:
        key = np.float64(value).tobytes()
        if key not in self._constants:
            self._constants[key] = self._handle()
            self._values[self._constants[key]] = float(value)
        return self._constants[key]

    def value(self, handle: int) -> float | None:
        """The number if it is known."""
        return self._values.get(handle)

    @np.errstate(all="ignore")
    def apply(self, name: str, *inputs: int) -> int:
        known = [self._values.get(i) for i in inputs]
        if None not in known:
            return self.constant(float(OPERATIONS[name](*(np.array([x], np.float64) for x in known))[0]))
        key = (name, *inputs)
        if key not in self._made:
            self._made[key] = self._handle()
        return self._made[key]

    @property
    def size(self) -> int:
        return len(self._made)

    def finish(self, outputs: Sequence[tuple[int, int]]) -> ir.Texture:
        """The program with what its outputs need, registers numbered as `ir.Texture` says."""
        made = {handle: key for key, handle in self._made.items()}
        needed: set[int] = set()
        waiting = [handle for _, handle in outputs]
        while waiting:
            handle = waiting.pop()
            if handle not in needed:
                needed.add(handle)
                waiting += [cast(int, i) for i in made[handle][1:]] if handle in made else []
        constants = [h for h in sorted(needed) if h in self._values]
        code = [h for h in sorted(needed) if h in made]
        numbers = {0: 0, 1: 1, 2: 2} | {h: 3 + i for i, h in enumerate([*constants, *code])}
        return ir.Texture(
            tuple(self._values[h] for h in constants),
            tuple((made[h][0], *(numbers[cast(int, i)] for i in made[h][1:])) for h in code),
            tuple((column, numbers[h]) for column, h in outputs),
        )
