"""Textures as functions of POV-Ray: what of a material depends on the place.

A texture is a straight program (`texture`); a function of POV-Ray is one expression without variables. So each number
that is used twice becomes the argument of another function, which does the rest: function by function down the program.
The lattice of `noise` comes from a hash of whole numbers, which POV-Ray cannot compute: the part of it that the scene
needs goes into a file, one byte a corner, and the interpolation is done as it is here. `rand` has no counterpart.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from blobscript import ir
from blobscript.field import MATERIAL_ROW, material_row
from blobscript.povray.beside import Beside
from blobscript.povray.looks import Local
from blobscript.povray.text import Array, comment, number
from blobscript.texture import BUMP, evaluate, evaluate_registers, noise_edges

__all__ = ["Pixels", "Textures"]

#: Corners of a lattice at most, and operations of a program; functions of POV-Ray have 56 parameters at most.
_MOST_CORNERS, _MOST_STEPS, _MOST_PARAMETERS = 30_000_000, 1500, 50

_HELPERS = """\
// for textures: remainder, a part of a colour as linear light, and noise between the corners of a lattice
#declare FMOD = function(a,b) { a-b*floor(a/b) }
#declare LIN = function(a) { select(a-0.04045, a/12.92, pow((max(a,0.04045)+0.055)/1.055,2.4)) }
#declare FADE = function(q) { q*q*q*(q*(q*6-15)+10) }
#declare MIX = function(a,b,q) { a+q*(b-a) }
#declare EDGE = function(k,x,y,z) {
  (1-2*mod(k,2))*select(k-7.5,x,y)+(1-2*mod(floor(k/2),2))*select(k-3.5,y,z) }"""

#: Amount of POV-Ray's `normal` for a pattern whose slope is meant.
_SLOPE = 7.5

#: Period of the saw that carries slopes, as a part of a pixel there, POV-Ray's step as a part of that, and the steepest
#: slope that fits between 0 and 1.
_SAW, _TOOTH, _STEEPEST = 0.01, 1e-6, 20.0

#: Operation -> expression of its registers.
_TEXTS: dict[str, str] = {
    "add": "({0}+{1})",
    "subtract": "({0}-{1})",
    "multiply": "({0}*{1})",
    "divide": "({0}/{1})",
    "negate": "(-{0})",
    "abs": "abs({0})",
    "floor": "floor({0})",
    "ceil": "ceil({0})",
    "sqrt": "sqrt({0})",
    "exp": "exp({0})",
    "log": "ln({0})",
    "sin": "sin({0})",
    "cos": "cos({0})",
    "tan": "tan({0})",
    "asin": "asin(min(1,max(-1,{0})))",
    "acos": "acos(min(1,max(-1,{0})))",
    "atan": "atan2({0},1)",
    "atan2": "atan2({0},{1})",
    "power": "pow({0},{1})",
    "mod": "FMOD({0},{1})",
    "min": "min({0},{1})",
    "max": "max({0},{1})",
    "less": "({0}<{1})",
    "less_equal": "({0}<={1})",
    "equal": "({0}={1})",
    "and": "(({0}!=0)&({1}!=0))",
    "or": "(({0}!=0)|({1}!=0))",
    "not": "({0}=0)",
    "select": "select(-abs({0}),{1},{2})",
    "linear": "LIN(min(1,max(0,{0})))",
}


class _InexpressibleError(Exception):
    """Something in a program has no counterpart; the text says what."""


@dataclass(frozen=True, slots=True)
class Pixels:
    """How large a pixel is at a place: its tangent times the distance from the eye, which is in units of the script.
    level: the material whose normals all point up, if there is one."""

    eye: Array
    tangent: float
    level: int | None

    def at(self, places: Array) -> Array:
        return self.tangent * np.linalg.norm(places - self.eye, axis=1)


class Textures:
    """Declares the textures of a scene; `lines` is the text so far, `notes` what could not be said.

    places: material -> where it is seen (n, 3), in units of the script; the lattices of noise cover that. lost: how
    colours change where another material takes the place of one.
    """

    def __init__(
        self,
        unit: float,
        places: dict[int, Array],
        pixels: Pixels,
        beside: Beside | None,
        lost: Callable[[int, ir.Material], str],
    ) -> None:
        self.lines: list[str] = []
        self.notes: list[str] = []
        self._unit, self._all, self._beside, self._pixels, self._lost = unit, places, beside, pixels, lost
        self._places = np.zeros((1, 3))
        self._count = 0

    def local(self, number_: int, material: ir.Material) -> tuple[ir.Material, Local]:
        """The material with means in the place of what POV-Ray cannot vary, and what it can."""
        texture, seen = material.texture, self._all.get(number_, np.zeros((0, 3)))
        self._places = seen if len(seen) else np.zeros((1, 3))
        eye = self._over(seen) if number_ == self._pixels.level else None
        if texture is None:
            return material, Local(eye=eye)
        mean = _with_means(material, texture, self._places)
        name = material.name or "material"
        registers = dict(texture.outputs)
        colors, normal = None, ""
        try:
            if set(registers) & {0, 1, 2}:
                colors = self._colors(material, texture, registers)
            if BUMP in registers:
                normal = self._bump(texture, registers[BUMP], "xz" if number_ == self._pixels.level else "xyz")
        except _InexpressibleError as error:
            flat = replace(mean, texture=None)
            self.notes.append(
                f"{name}: {error} has no counterpart in POV-Ray: the mean of the texture stands for it, which changes "
                f"colours by {self._lost(number_, flat)}"
            )
        else:
            if set(registers) - {0, 1, 2, BUMP}:
                kept = tuple(output for output in texture.outputs if output[0] in (0, 1, 2, BUMP))
                part = replace(mean, texture=replace(texture, outputs=kept) if kept else None)
                self.notes.append(
                    f"{name}: roughness, metalness and emission do not depend on the place in POV-Ray, which changes "
                    f"colours by {self._lost(number_, part)}"
                )
        return mean, Local(colors, normal, eye)

    def _over(self, seen: Array) -> tuple[str, float, float]:
        """The y of the unit vector to the eye, as a function of POV-Ray, and between what it lies."""
        way = self._pixels.eye - seen
        heights = way[:, 1] / np.linalg.norm(way, axis=1) if len(seen) else np.array([0.0, 1.0])
        low, high = float(heights.min()), float(heights.max())
        return f"({number(self._pixels.eye[1] * self._unit)}-y)/sqrt({self._away()})", low, max(high, low + 1e-3)

    def _away(self) -> str:
        """The square of the distance from the eye, in POV-Ray's units."""
        eye = (self._pixels.eye * self._unit).tolist()
        return "+".join(f"pow({c}-({number(e)}),2)" for c, e in zip("xyz", eye, strict=True))

    def _colors(self, material: ir.Material, texture: ir.Texture, registers: dict[int, int]) -> tuple[str, str, str]:
        texts = [
            f"min(1,max(0,{self._function(texture, registers[c])}(x,y,z)))"
            if c in registers
            else number(material.color[c])
            for c in range(3)
        ]
        return texts[0], texts[1], texts[2]

    def _bump(self, texture: ir.Texture, register: int, axes: str) -> str:
        """The slope over a pixel along some axes, as it is taken here. POV-Ray turns the normal by 2/15 of the amount
        times the slope of a pattern (measured), over a step that is the same everywhere: so the pattern is a saw of a
        very short period along each axis, as steep as is meant there."""
        sizes = self._pixels.at(self._places)
        self._places = np.concatenate([self._places, *(self._places + sizes[:, None] * e for e in np.eye(3))])
        height = self._function(texture, register)
        self._count += 1
        name, k = f"T{self._count}", self._unit
        period = _SAW * max(float(sizes.min()), 1e-6 * float(sizes.max())) * k
        share = 0.3 / (period * _STEEPEST)
        pixel = f"{number(self._pixels.tangent)}*sqrt({self._away()})"
        steps = {"x": "x+s,y,z", "y": "x,y+s,z", "z": "x,y,z+s"}
        rises = "+".join(f"({height}({steps[c]})-h)*{name}S({c})" for c in axes)
        self.lines += [
            comment("slopes over a pixel of the picture, as blobscript takes them: those of another size differ"),
            f"#declare {name}S = function(a) {{ a-{number(period)}*(floor(a/{number(period)})+0.5) }}",
            f"#declare {name}P = function(x,y,z) {{ max({number(period)},{pixel}) }}",
            f"#declare {name}B = function(x,y,z,s,h) {{ min(1,max(0,0.5+{number(share * k)}/s*({rises}))) }}",
            f"#declare {name} = function(x,y,z) {{ {name}B(x,y,z,{name}P(x,y,z),{height}(x,y,z)) }}",
        ]
        return f"normal {{ function {{ {name}(x,y,z) }} {number(_SLOPE / share)} accuracy {number(_TOOTH * period)} }}"

    # ---- programs -------------------------------------------------------------------------------

    def _function(self, texture: ir.Texture, register: int) -> str:
        """The name of a function that gives one number of the program."""
        program = _Program(texture, register, self)
        self._start()
        self._count += 1
        name = f"T{self._count}"
        text = program.text(name)
        self.lines += [*program.lines, f"#declare {name} = function(x,y,z) {{ {text} }}"]
        return name

    def _start(self) -> None:
        if not self.lines:
            self.lines += _HELPERS.split("\n")

    def lattice(self, texture: ir.Texture, inputs: tuple[int, ...]) -> str:
        """The name of a function like `noise`, for what these four registers are at the scene's places."""
        if self._beside is None:
            raise _InexpressibleError("noise without a file of its own (`-o scene.pov` gives it one)")
        values = evaluate_registers(texture, self._places, inputs)
        seed = values[:, 3]
        if np.ptp(seed) != 0.0:
            raise _InexpressibleError("noise whose seed depends on the place")
        corners = np.floor(values[:, :3][np.isfinite(values[:, :3]).all(axis=1)])
        lo, hi = corners.min(axis=0) - 2, corners.max(axis=0) + 3
        counts = (hi - lo + 1).astype(np.int64)
        if np.prod(counts.astype(np.float64)) > _MOST_CORNERS or counts.max() > 65535:
            raise _InexpressibleError("noise over so many places")
        x, y, z = (lo[k] + np.arange(counts[k], dtype=np.float64) for k in range(3))
        edges = noise_edges(x[None, None], y[None, :, None], z[:, None, None], seed[:1]).astype(np.uint8)
        file = self._beside.add("noise", "df3", struct.pack(">3H", *counts.tolist()) + edges.tobytes())
        return self._noise(file, lo, counts)

    def _noise(self, file: str, lo: Array, counts: np.ndarray[Any, Any]) -> str:
        """A corner's edge, then the eight corners of a cell, then the cell of a place."""
        self._start()
        self._count += 1
        k = self._count
        at = ",".join(
            f"({name}-({number(float(start))})+0.5)/{int(count)}"
            for name, start, count in zip("xyz", lo, counts, strict=True)
        )
        corner = "N{k}E(i+{a},j+{b},l+{c},u-{a},v-{b},w-{c})"
        x_pairs = {
            (b, c): f"MIX({corner.format(k=k, a=0, b=b, c=c)},{corner.format(k=k, a=1, b=b, c=c)},FADE(u))"
            for b in (0, 1)
            for c in (0, 1)
        }
        y_pairs = [f"MIX({x_pairs[0, c]},{x_pairs[1, c]},FADE(v))" for c in (0, 1)]
        self.lines += [
            f'#declare N{k}D = function {{ pattern {{ density_file df3 "{file}" interpolate 0 }} }}',
            f"#declare N{k}K = function(x,y,z) {{ floor(255*N{k}D({at})+0.5) }}",
            f"#declare N{k}E = function(i,j,l,u,v,w) {{ EDGE(N{k}K(i,j,l),u,v,w) }}",
            f"#declare N{k}C = function(i,j,l,u,v,w) {{ 0.96*MIX({y_pairs[0]},\n  {y_pairs[1]},FADE(w)) }}",
            f"#declare N{k} = function(x,y,z) {{ N{k}C(floor(x),floor(y),floor(z),x-floor(x),y-floor(y),z-floor(z)) }}",
        ]
        return f"N{k}"

    @property
    def unit(self) -> float:
        return self._unit


class _Program:
    """One number of a texture's program as functions."""

    def __init__(self, texture: ir.Texture, register: int, textures: Textures) -> None:
        self.lines: list[str] = []
        self._texture, self._textures = texture, textures
        self._first = 3 + len(texture.constants)
        self._last = register
        self._needed = self._needs()
        if len(self._needed) > _MOST_STEPS:
            raise _InexpressibleError("a texture of so many operations")
        uses = Counter(i for r in self._needed for i in self._inputs(r))
        self._shared = [r for r in self._needed if uses[r] > 1 and r != register]

    def _inputs(self, register: int) -> tuple[int, ...]:
        return tuple(int(i) for i in self._texture.code[register - self._first][1:])

    def _needs(self) -> list[int]:
        needed: set[int] = set()
        waiting = [self._last]
        while waiting:
            r = waiting.pop()
            if r >= self._first and r not in needed:
                needed.add(r)
                waiting += self._inputs(r)
        return sorted(needed)

    def text(self, name: str) -> str:
        """The expression in x, y, z; `lines` declares the functions that it calls, the last one first."""
        place = self._place()
        stages = [*self._shared, self._last]
        called = ""
        for k in range(len(stages) - 1, -1, -1):
            known = self._live(stages, k)
            inner = self._expression(stages[k], set(known))
            if called:
                after = self._live(stages, k + 1)
                inner = f"{called}({','.join(['x', 'y', 'z', *(inner if r == stages[k] else f'r{r}' for r in after)])})"
            if len(known) > _MOST_PARAMETERS:
                raise _InexpressibleError("a texture with so many numbers at once")
            called = f"{name}_{k}"
            self.lines.append(
                f"#declare {called} = function({','.join(['x', 'y', 'z', *(f'r{r}' for r in known)])}) {{ {inner} }}"
            )
        return f"{called}({place})"

    def _live(self, stages: list[int], k: int) -> list[int]:
        """Shared numbers that are known before stage k and needed in it or later."""
        wanted: set[int] = set()
        for r in stages[k:]:
            wanted |= self._direct(r)
        return [r for r in stages[:k] if r in wanted]

    def _direct(self, register: int) -> set[int]:
        """The shared numbers that a stage's expression names."""
        found: set[int] = set()
        waiting = list(self._inputs(register)) if register >= self._first else []
        while waiting:
            r = waiting.pop()
            if r in self._shared:
                found.add(r)
            elif r >= self._first:
                waiting += self._inputs(r)
        return found

    def _expression(self, register: int, known: set[int]) -> str:
        if register < 3:
            return "xyz"[register]
        if register < self._first:
            value = self._texture.constants[register - 3]
            if not np.isfinite(value):
                raise _InexpressibleError("a number that is not finite")
            return f"({number(value)})" if value < 0 else number(value)
        if register in known:
            return f"r{register}"
        step = self._texture.code[register - self._first]
        operation = str(step[0])
        if operation == "noise":
            lattice = self._textures.lattice(self._texture, self._inputs(register))
            return f"{lattice}({','.join(self._expression(i, known) for i in self._inputs(register)[:3])})"
        if operation not in _TEXTS:
            raise _InexpressibleError(f"`{operation}`")
        return _TEXTS[operation].format(*(self._expression(i, known) for i in self._inputs(register)))

    def _place(self) -> str:
        scale = 1.0 / self._textures.unit
        if self._texture.matrix is None:
            return ",".join(f"{c}*{number(scale)}" for c in "xyz")
        rows = np.array(self._texture.matrix).reshape(3, 4)
        return ",".join(
            "+".join(f"{c}*({number(float(f) * scale)})" for c, f in zip("xyz", row[:3], strict=True))
            + f"+({number(float(row[3]))})"
            for row in rows
        )


def _with_means(material: ir.Material, texture: ir.Texture, places: Array) -> ir.Material:
    """The material with the means of what its texture says."""
    means = evaluate(texture, places).mean(axis=0)
    row = material_row(material)
    for (column, _), mean in zip(texture.outputs, means.tolist(), strict=True):
        if column < len(row):
            row[column] = mean
    parts = {name: row[where] for name, where in MATERIAL_ROW.items()}
    values = {name: float(v[0]) if len(v) == 1 else tuple(v.tolist()) for name, v in parts.items()}
    return replace(material, **cast("dict[str, Any]", values))
