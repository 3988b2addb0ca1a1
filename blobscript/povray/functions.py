"""Densities as functions of POV-Ray: kernels, distances, and the trees of a cell.

A kernel is a function of q = (distance / reach)^2. Squared distances are functions of the place; `SEG2` and its like
are written once (`LIBRARY`), because a function of POV-Ray has no local variables: what is used twice is the argument
of a helper. `select(a, b, c)` is b where a < 0, else c, and does not mind what the other one is.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from itertools import pairwise

import numpy as np

from blobscript import geometry, ir, kernels
from blobscript.ir import Kernel, KernelPiece, Leaf
from blobscript.joints import SHARPNESS
from blobscript.povray.cells import Group, Single, Terms, Tree
from blobscript.povray.text import Array, comment, joined, number, place

__all__ = ["LIBRARY", "Functions", "kernel_text"]

#: Helpers that every scene with functions starts with.
LIBRARY = """\
// squared distances, the place relative to one end: P2 of a point, SEG2 of a segment with direction d, il = 1/|d|^2
#declare P2 = function(x,y,z) { x*x+y*y+z*z }
#declare CL = function(k) { min(1,max(0,k)) }
#declare SGK = function(x,y,z,dx,dy,dz,k) { P2(x-k*dx,y-k*dy,z-k*dz) }
#declare SEG2 = function(x,y,z,dx,dy,dz,il) { SGK(x,y,z,dx,dy,dz,CL((x*dx+y*dy+z*dz)*il)) }
#declare DOT3 = function(x,y,z,dx,dy,dz) { x*dx+y*dy+z*dz }"""

#: What may stand in any term as it is: a number, a name, a call of one at the place.
_ATOM = re.compile(r"[\w.]+(\(x,y,z\))?")

#: Half the solid angle of a triangle seen from the origin (van Oosterom and Strackee 1983).
_SOLID_ANGLE = """\
// half the solid angle of a triangle: the sum over a closed surface is 2 pi inside and 0 outside
#declare DET3 = function(ax,ay,az,bx,by,bz,cx,cy,cz) { ax*(by*cz-bz*cy)+ay*(bz*cx-bx*cz)+az*(bx*cy-by*cx) }
#declare SAL = function(ax,ay,az,bx,by,bz,cx,cy,cz,u,v,w) {
  atan2(DET3(ax,ay,az,bx,by,bz,cx,cy,cz),
        u*v*w+DOT3(ax,ay,az,bx,by,bz)*w+DOT3(bx,by,bz,cx,cy,cz)*u+DOT3(cx,cy,cz,ax,ay,az)*v) }
#declare SA = function(ax,ay,az,bx,by,bz,cx,cy,cz) {
  SAL(ax,ay,az,bx,by,bz,cx,cy,cz,sqrt(P2(ax,ay,az)),sqrt(P2(bx,by,bz)),sqrt(P2(cx,cy,cz))) }"""


# ---- kernels -------------------------------------------------------------------------------


def kernel_text(kernel: Kernel) -> str:
    """The kernel as an expression in q."""
    if kernel.pieces:
        return _pieces(kernel.pieces)
    a = number(kernel.a)
    match kernel.name:
        case "soft2":
            return "pow(max(0,1-q),2)"
        case "soft3":
            return "pow(max(0,1-q),3)"
        case "wyvill":
            return "select(1-q,0,(1-q)*(1-q)*(9-4*q)/9)"
        case "metaball":
            return "select(1-q,0,select(1/9-q,1.5*pow(1-sqrt(q),2),1-3*q))"
        case "gauss":
            return f"exp(-{a}*q)"
        case _:
            return _gauss_c1(kernel.a)


def _gauss_c1(a: float) -> str:
    """As in `kernels`: u^2 e^(-a q) Q(a u) / Q(a), Q by its series for small a."""
    if a >= 1.0:
        tail = math.exp(-a)
        norm = -math.expm1(-a) - a * tail
        return f"select(1-q,0,(exp(-{number(a)}*q)-{number(tail)}*(1+{number(a)}*(1-q)))/{number(norm)})"
    series = "1"
    for k in range(16, 2, -1):
        series = f"1+{number(a)}*(1-q)/{k}*({series})"
    at_zero = 1.0
    for k in range(16, 2, -1):
        at_zero = 1.0 + a * at_zero / k
    # e^(-a q) e^(-a (1 - q)) / e^(-a) = 1: only the series are left
    return f"select(1-q,0,(1-q)*(1-q)*({series})/{number(at_zero)})"


def _pieces(pieces: tuple[KernelPiece, ...]) -> str:
    """Nested choices from the outermost piece inwards."""
    text = _polynomial(pieces[0])
    for before, piece in pairwise(pieces):
        text = f"select({number(before.r_hi**2)}-q,{_polynomial(piece)},{text})"
    return f"select(1-q,0,{text})"


def _polynomial(piece: KernelPiece) -> str:
    variable = "q" if piece.variable == "s" else "sqrt(q)"
    centred = variable if piece.centre == 0.0 else f"({_minus(variable, piece.centre)})"
    x = centred if piece.half == 1.0 else f"({centred}/{number(piece.half)})"
    coefficients = list(piece.coefficients)
    while len(coefficients) > 1 and coefficients[-1] == 0.0:
        coefficients.pop()
    text = number(coefficients[-1])
    for c in reversed(coefficients[:-1]):
        text = f"{number(c)}+{x}*({text})"
    return f"({text})"


def _minus(name: str, x: float) -> str:
    if x == 0.0:
        return name
    return f"{name}-{number(x)}" if x > 0.0 else f"{name}+{number(-x)}"


def _arguments(p: Array) -> str:
    """The place relative to p."""
    return ",".join(_minus(name, float(x)) for name, x in zip("xyz", p, strict=True))


def _numbers(v: Array) -> str:
    return ",".join(map(number, v.tolist()))


# ---- squared distances ---------------------------------------------------------------------


def _distance_text(corners: Array) -> str:
    """Of a point, segment or triangle with these corners (k, 3)."""
    if len(corners) == 1:
        return f"P2({_arguments(corners[0])})"
    if len(corners) == 2:
        return _segment(corners[0], corners[1])
    return _triangle(corners)


def _segment(a: Array, b: Array) -> str:
    d = b - a
    square = float(d @ d)
    if square < 1e-290:
        return f"P2({_arguments(a)})"
    return f"SEG2({_arguments(a)},{_numbers(d)},{number(1.0 / square)})"


def _triangle(corners: Array) -> str:
    edges = np.roll(corners, -1, axis=0) - corners
    sides = "min(" + ",".join(_segment(a, b) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)) + ")"
    normal = np.cross(edges[0], edges[1])
    length = float(np.linalg.norm(normal))
    longest = float(np.sqrt(np.max(np.sum(edges**2, axis=1))))
    if length <= 1e-12 * longest**2:
        return sides
    normal = normal / length
    outward = np.cross(edges, normal) / longest
    beyond = ",".join(f"DOT3({_arguments(a)},{_numbers(e)})" for a, e in zip(corners, outward, strict=True))
    return f"select(max({beyond}),pow(DOT3({_arguments(corners[0])},{_numbers(normal)}),2),{sides})"


def _inside_text(skeleton: ir.Polyhedron | ir.Mesh) -> str:
    """Below zero inside of the solid."""
    corners = geometry.simplices(skeleton)
    if isinstance(skeleton, ir.Polyhedron) and skeleton.convex:
        parts = [f"DOT3({_arguments(p)},{_numbers(n)})" for p, n in _planes(corners)]
        return "max(" + ",".join(parts) + ")"
    parts = [f"SA({','.join(_away(p) for p in triangle)})" for triangle in corners]
    return "pi-(" + "+".join(parts) + ")"


def _planes(corners: Array) -> list[tuple[Array, Array]]:
    """A place and the outward normal of each plane that faces lie in, once."""
    found: dict[tuple[float, ...], tuple[Array, Array]] = {}
    for a, b, c in corners:
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length > 1e-12 * float(np.sum((b - a) ** 2)):
            normal = normal / length
            found.setdefault(tuple(np.round([*normal, normal @ a], 9).tolist()), (a, normal))
    return list(found.values())


def _away(p: Array) -> str:
    return ",".join(f"{number(float(c))}-{name}" for name, c in zip("xyz", p, strict=True))


# ---- names ------------------------------------------------------------------------------------


class Functions:
    """Declares what is asked for once, and hands out the names. `lines` is the text so far."""

    def __init__(self, scene: ir.Scene) -> None:
        self.lines: list[str] = []
        self._scene = scene
        self._kernels: dict[tuple[object, ...], str] = {}
        self._names: dict[tuple[int, str, int], str] = {}
        self._leaves: list[Leaf] = []  # keeps the ids of `_names` alive
        self._densities: dict[str, str] = {}
        self._shorthands: dict[str, str] = {}
        self._has_shares = False
        self._has_angles = False

    # ---- declarations ----

    def _start(self) -> None:
        if not self.lines:
            self.lines += LIBRARY.split("\n")

    def kernel(self, kernel: Kernel) -> str:
        key = (kernel.name, kernel.a, kernel.pieces)
        if key not in self._kernels:
            self._start()
            name = f"K{len(self._kernels) + 1}"
            shown = f"{kernel.name}(a = {number(kernel.a)})" if kernel.a else kernel.name
            self.lines += [comment(f"kernel {shown} of q = (distance / reach)^2")]
            self.lines += [f"#declare {name} = function(q) {{ {kernel_text(kernel)} }}"]
            self._kernels[key] = name
        return self._kernels[key]

    def _declare(self, leaf: Leaf, kind: str, index: int, text: str, remark: str = "") -> str:
        self._start()
        name = f"{kind}{len(self._names) + 1}"
        lines = joined(text.split(" "), " ", 150)
        body = " ".join(lines) if len(lines) == 1 else "\n  ".join(lines)
        self.lines.append(f"#declare {name} = function(x,y,z) {{ {body} }}" + (f"  {remark}" if remark else ""))
        self._names[id(leaf), kind, index] = name
        self._leaves.append(leaf)
        return name

    def element(self, leaf: Leaf, index: int) -> str:
        """The density of one point or line."""
        if name := self._names.get((id(leaf), "B", index)):
            return name
        kernel = self.kernel(leaf.kernel)
        if leaf.matrix is None:
            distance = _distance_text(geometry.simplices(leaf.skeleton)[index])
        else:
            distance = f"{self._distance(leaf, index)}({_map_text(leaf.matrix)})"
        text = self._scaled(leaf, index, kernel, distance)
        return self._declare(leaf, "B", index, text, comment(place(self._span(leaf, index))))

    def _distance(self, leaf: Leaf, index: int) -> str:
        """The squared distance to one simplex, in the space of the skeleton."""
        if name := self._names.get((id(leaf), "Q", index)):
            return name
        return self._declare(leaf, "Q", index, _distance_text(geometry.simplices(leaf.skeleton)[index]))

    def _scaled(self, leaf: Leaf, index: int, kernel: str, distance: str) -> str:
        weight, reach = float(leaf.weight[index]), float(leaf.reach[index])
        factor = "" if weight == 1.0 else f"{number(weight)}*"
        return f"{factor}{kernel}({distance}*{number(1.0 / reach**2)})"

    def _span(self, leaf: Leaf, index: int):
        origin = int(leaf.origin[index]) if len(leaf.origin) > index else -1
        return self._scene.spans[origin] if 0 <= origin < len(self._scene.spans) else None

    # ---- the trees of a cell ----

    def value(self, tree: Tree) -> str:
        """The density that a cell's tree stands for."""
        match tree:
            case Terms(leaf, elements):
                return "+".join(f"{self.element(leaf, i)}(x,y,z)" for i in elements) or "0"
            case Single():
                return self._single(tree)
            case Group("sum", children):
                return "+".join(map(self.value, children)) or "0"
            case Group("smooth_max" | "smooth_min", children):
                return self._joint(tree.op, [self.value(child) for child in children])
            case Group(op, children):
                parts = [self.value(child) for child in children]
                return parts[0] if len(parts) == 1 else f"{op}({','.join(parts)})" if parts else "0"

    def _joint(self, op: str, values: list[str]) -> str:
        """The mean of the positive densities, weighted by their powers; see `joints`."""
        sign = "" if op == "smooth_max" else "-"
        names = [self._named(value) for value in values]
        shares = [self._share(sign, name) for name in names]
        weighted = "+".join(f"{w}*max(0,{sign}{v})" for w, v in zip(shares, names, strict=True)) or "0"
        return f"{sign}({weighted})/max(1e-300,{'+'.join(shares) or '0'})"

    def _share(self, sign: str, name: str) -> str:
        if not self._has_shares:
            self._start()
            self.lines += [comment("what a density weighs in a smooth joint")]
            self.lines += [f"#declare SHARE = function(f) {{ pow(max(0,f),{SHARPNESS}) }}"]
            self._has_shares = True
        return f"SHARE({sign}{name})"

    def _named(self, text: str) -> str:
        """A function for what is needed more than once, unless it is short: then in brackets, if it needs them."""
        if len(text) <= 12:
            return text if _ATOM.fullmatch(text) else f"({text})"
        if text not in self._shorthands:
            name = f"S{len(self._shorthands) + 1}"
            self.lines.append(f"#declare {name} = function(x,y,z) {{ {self._broken(text)} }}")
            self._shorthands[text] = f"{name}(x,y,z)"
        return self._shorthands[text]

    def _broken(self, text: str) -> str:
        """Over several lines where it is long."""
        return "\n  ".join(joined(text.replace("+B", " +B").replace(",B", ", B").split(" "), "", 120))

    def density(self, tree: Tree, threshold: float) -> str:
        """The name of threshold - density, which is below zero inside; declared once."""
        text = f"{number(threshold)}-({self.value(tree)})"
        if text not in self._densities:
            self._start()
            name = f"D{len(self._densities) + 1}"
            self.lines.append(f"#declare {name} = function(x,y,z) {{ {self._broken(text)} }}")
            self._densities[text] = name
        return self._densities[text]

    def _single(self, tree: Single) -> str:
        leaf = tree.leaf
        if tree.side == "inside":
            return number(float(leaf.weight[0]) * float(kernels.value(leaf.kernel, np.zeros(1))[0]))
        if not tree.simplices:
            return "0"
        here = "x,y,z" if leaf.matrix is None else _map_text(leaf.matrix)
        parts = [f"{self._distance(leaf, i)}({here})" for i in tree.simplices]
        distance = parts[0] if len(parts) == 1 else f"min({','.join(parts)})"
        if tree.side == "both":
            distance = f"select({self._inside(leaf)}({here}),0,{distance})"
        return self._scaled(leaf, 0, self.kernel(leaf.kernel), distance)

    def _inside(self, leaf: Leaf) -> str:
        assert isinstance(leaf.skeleton, ir.Polyhedron | ir.Mesh)
        if not self._has_angles and not (isinstance(leaf.skeleton, ir.Polyhedron) and leaf.skeleton.convex):
            self._start()
            self.lines += _SOLID_ANGLE.split("\n")
            self._has_angles = True
        return self._names.get((id(leaf), "I", 0)) or self._declare(leaf, "I", 0, _inside_text(leaf.skeleton))

    # ---- paint ----

    def mixture(self, tree: Tree, own: int) -> dict[int, str]:
        """Material -> what it contributes: the positive parts of the densities of its terms."""
        match tree:
            case Terms(leaf, elements):
                return self._terms_mixture(leaf, elements, own)
            case Single(leaf):
                return self._positive(self._paint(leaf, 0, own), leaf, 0, self._single(tree))
            case Group("sum", children):
                return _merged([self.mixture(child, own) for child in children])
            case Group(_, children):
                return self._winners(tree, [self.mixture(child, own) for child in children])

    def _paint(self, leaf: Leaf, index: int, own: int) -> int:
        paint = int(leaf.paint[index])
        return own if paint < 0 else paint

    def _terms_mixture(self, leaf: Leaf, elements: tuple[int, ...], own: int) -> dict[int, str]:
        return _merged(
            [self._positive(self._paint(leaf, i, own), leaf, i, f"{self.element(leaf, i)}(x,y,z)") for i in elements]
        )

    def _positive(self, material: int, leaf: Leaf, index: int, text: str) -> dict[int, str]:
        never_negative = leaf.kernel.falls
        if never_negative:
            return {material: text} if leaf.weight[index] > 0 else {}
        return {material: f"max(0,{text})"}

    def _winners(self, tree: Group, mixtures: list[dict[int, str]]) -> dict[int, str]:
        """Each child counts where it wins (by its share in a smooth joint), with the whole of the node's density."""
        materials = {m for mixture in mixtures for m in mixture}
        value = self._named(self.value(tree))
        if len(materials) <= 1:
            return dict.fromkeys(materials, f"max(0,{value})")
        values = [self._named(self.value(child)) for child in tree.children]
        counts = self._shares(tree.op, values)
        parts = [
            {m: f"{count}*max(0,{value})*({w})/max(1e-300,{'+'.join(mixture.values())})" for m, w in mixture.items()}
            for count, mixture in zip(counts, mixtures, strict=True)
        ]
        return _merged(parts)

    def _shares(self, op: str, values: list[str]) -> list[str]:
        """What each child counts: 1 for the winner and 0 for the others, or its share."""
        if op.startswith("smooth"):
            shares = [self._share("" if op == "smooth_max" else "-", value) for value in values]
            return [f"{share}/max(1e-300,{'+'.join(shares)})" for share in shares]
        sign = ">=" if op == "max" else "<="
        return [
            "*".join(f"({value}{sign}{other})" for k, other in enumerate(values) if k != i) or "1"
            for i, value in enumerate(values)
        ]


def _merged(parts: list[dict[int, str]]) -> dict[int, str]:
    result: dict[int, str] = {}
    for part in parts:
        for material, text in part.items():
            result[material] = f"{result[material]}+{text}" if material in result else text
    return result


@lru_cache(maxsize=64)
def _map_rows(data: bytes) -> str:
    rows = np.frombuffer(data).reshape(3, 4)
    return ",".join(_map_row(row.tolist()) for row in rows)


def _map_text(map_: Array) -> str:
    """The place in the space of the skeleton."""
    return _map_rows(np.ascontiguousarray(map_, dtype=np.float64).tobytes())


def _map_row(row: list[float]) -> str:
    text = ""
    for factor, name in zip(row[:3], "xyz", strict=True):
        if factor == 0.0:
            continue
        term = name if abs(factor) == 1.0 else f"{number(abs(factor))}*{name}"
        text += ("-" if factor < 0 else "+" if text else "") + term
    if row[3] != 0.0 or not text:
        text += ("-" if row[3] < 0 else "+" if text else "") + number(abs(row[3]))
    return text
