"""Certified first hits: interval branch and bound in ball arithmetic (python-flint).

An answer that shares no line with the tracer. Along a ray, the squared distance to a simplex is a
convex C1 function made of quadratics, so values and slopes at both ends of an interval enclose it;
kernels are enclosed at the ends of their argument (built in: falling and convex) or by their mean
value form (pieces of user kernels: no flag is believed). Intervals whose enclosure of
F = field - threshold has no zero are skipped, monotone ones with a sign change hold exactly one
crossing, the rest is halved, left half first, down to 2^-150 of the ray.

What remains undecided there is a touch: F reaches zero to within that precision, without crossing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from flint import arb, ctx
from numpy.typing import ArrayLike, NDArray

from blobscript import geometry, kernels
from blobscript.field import extent
from blobscript.ir import Field, Kernel, KernelPiece, Leaf, Lines, Node, Points, Scene, Surface, leaves
from blobscript.joints import SHARPNESS, STEEPER

__all__ = ["Answer", "UndecidedError", "certain_hit", "first_hit"]

PRECISION = 256
_TINY = 105
_BUDGET = 20_000
_EPS = 2.0**-52

Array = NDArray[np.float64]
Range = tuple[arb, arb]


class UndecidedError(Exception):
    """The budget ran out: F is zero over a whole stretch of the ray, say."""


@dataclass(frozen=True)
class Answer:
    """status: "hit", "miss" or "touch" (contact without a crossing, and none behind it).

    t: enclosure of the distance along the normalised direction. kind: "enter" or "exit".
    touches: distances of contacts before the hit. stable: a change of the threshold by the
    rounding of double precision does not change the status, and t only by `tolerance`.
    """

    status: str
    t: arb | None = None
    kind: str = ""
    surface: int = -1
    start: str = "out"
    touches: tuple[float, ...] = ()
    stable: bool = True
    tolerance: float = 0.0

    @property
    def distance(self) -> float:
        return math.inf if self.t is None else float(self.t.mid())


# ---- balls -------------------------------------------------------------------------------------------


def _ball(lo: arb, hi: arb) -> arb:
    return lo.union(hi)


def _dot(a: list[arb], b: list[arb]) -> arb:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: list[arb], b: list[arb]) -> list[arb]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _sub(a: list[arb], b: list[arb]) -> list[arb]:
    return [x - y for x, y in zip(a, b, strict=True)]


def _vector(v: ArrayLike) -> list[arb]:
    return [arb(float(x)) for x in np.asarray(v, dtype=np.float64)]


def _product(a: Range, b: Range) -> Range:
    ends = [x * y for x in a for y in b]
    return _least(ends), _greatest(ends)


def _least(values: list[arb]) -> arb:
    result = values[0].lower()
    for v in values[1:]:
        result = result.min(v.lower())
    return result.lower()


def _greatest(values: list[arb]) -> arb:
    result = values[0].upper()
    for v in values[1:]:
        result = result.max(v.upper())
    return result.upper()


# ---- squared distance along the ray ----------------------------------------------------------------------


class Quadratic:
    """|v + t d|^2 without the part along some directions: c + b t + a t^2."""

    __slots__ = ("a", "b", "c")

    def __init__(self, v: list[arb], d: list[arb]) -> None:
        self.a, self.b, self.c = _dot(d, d), 2 * _dot(v, d), _dot(v, v)

    def at(self, t: arb) -> tuple[arb, arb]:
        return (self.a * t + self.b) * t + self.c, 2 * self.a * t + self.b


class PointDistance:
    __slots__ = ("quadratic",)

    def __init__(self, o: list[arb], d: list[arb], corners: Array) -> None:
        self.quadratic = Quadratic(_sub(o, _vector(corners[0])), d)

    def at(self, t: arb) -> tuple[arb, arb]:
        return self.quadratic.at(t)


class SegmentDistance:
    """Three quadratics; which one holds is told by the projection u + v t, 0 to 1 in the middle."""

    __slots__ = ("ends", "flat", "middle", "u", "v")

    def __init__(self, o: list[arb], d: list[arb], corners: Array) -> None:
        a, b = _vector(corners[0]), _vector(corners[1])
        self.ends = Quadratic(_sub(o, a), d), Quadratic(_sub(o, b), d)
        edge, v = _sub(b, a), _sub(o, a)
        square = _dot(edge, edge)
        self.flat = bool(square.contains(0))
        if self.flat:
            return
        self.u, self.v = _dot(v, edge) / square, _dot(d, edge) / square
        across = [x - self.u * e for x, e in zip(v, edge, strict=True)]
        turn = [x - self.v * e for x, e in zip(d, edge, strict=True)]
        self.middle = Quadratic(across, turn)

    def at(self, t: arb) -> tuple[arb, arb]:
        if self.flat:
            return self.ends[0].at(t)
        along = self.u + self.v * t
        if along < 0:
            return self.ends[0].at(t)
        if along > 1:
            return self.ends[1].at(t)
        result = self.middle.at(t)
        if not along > 0:
            result = _joined(result, self.ends[0].at(t))
        if not along < 1:
            result = _joined(result, self.ends[1].at(t))
        return result


def _joined(first: tuple[arb, arb], second: tuple[arb, arb]) -> tuple[arb, arb]:
    return first[0].union(second[0]), first[1].union(second[1])


class TriangleDistance:
    """The face above it, else the nearest of the edges."""

    __slots__ = ("edges", "face", "flat", "sides")

    def __init__(self, o: list[arb], d: list[arb], corners: Array) -> None:
        a, b, c = map(_vector, corners)
        pairs = ((0, 1), (1, 2), (2, 0))
        self.edges = [SegmentDistance(o, d, corners[[i, j]]) for i, j in pairs]
        normal = _cross(_sub(b, a), _sub(c, a))
        square = _dot(normal, normal)
        self.flat = bool(square.contains(0))
        if self.flat:
            return
        length = square.sqrt()
        unit = [x / length for x in normal]
        height, rate = _dot(_sub(o, a), unit), _dot(d, unit)
        self.face = Quadratic([height, arb(0), arb(0)], [rate, arb(0), arb(0)])
        self.sides: list[tuple[arb, arb]] = []
        for p, q in ((a, b), (b, c), (c, a)):
            inward = _cross(normal, _sub(q, p))
            self.sides.append((_dot(_sub(o, p), inward), _dot(d, inward)))

    def at(self, t: arb) -> tuple[arb, arb]:
        above = None if self.flat else [u + v * t for u, v in self.sides]
        if above and all(x > 0 for x in above):
            return self.face.at(t)
        result = _nearest([edge.at(t) for edge in self.edges])
        if above and not any(x < 0 for x in above):
            result = _joined(result, self.face.at(t))
        return result


def _nearest(values: list[tuple[arb, arb]]) -> tuple[arb, arb]:
    best = values[0]
    for value in values[1:]:
        if value[0] < best[0]:
            best = value
        elif not value[0] > best[0]:
            best = best[0].min(value[0]), best[1].union(value[1])
    return best


Simplex = PointDistance | SegmentDistance | TriangleDistance
_KINDS = {1: PointDistance, 2: SegmentDistance, 3: TriangleDistance}


# ---- kernels ------------------------------------------------------------------------------------------------


def _gauss_c1_parts(a: arb) -> tuple[arb, arb]:
    tail = (-a).exp()
    return tail, 1 - tail * (1 + a)


def _built_in(kernel: Kernel, s: arb) -> tuple[arb, arb]:
    """D and dD/ds at s >= 0, as the language's table writes them; s is a thin ball."""
    u = (1 - s).max(arb(0))
    a = arb(kernel.a)
    match kernel.name:
        case "soft2":
            return u**2, -2 * u
        case "soft3":
            return u**3, -3 * u**2
        case "wyvill":
            return u**2 * (1 - 4 * s / 9), -arb(2) / 9 * u * (11 - 6 * s)
        case "gauss":
            return (-a * s).exp(), -a * (-a * s).exp()
        case "gauss_c1":
            tail, norm = _gauss_c1_parts(a)
            inside = ((a * u - a).exp() - tail * (1 + a * u)) / norm
            return inside, -a * ((a * u - a).exp() - tail) / norm
        case _:
            return _metaball(s)


def _metaball(s: arb) -> tuple[arb, arb]:
    inner = 1 - 3 * s, arb(-3)
    if s < arb(1) / 9:
        return inner
    r = s.max(arb(1) / 10).sqrt()
    rim = (1 - r).max(arb(0))
    outer = arb(3) / 2 * rim**2, -arb(3) / 2 * rim / r
    return outer if s > arb(1) / 9 else _joined(inner, outer)


class BuiltIn:
    """Falling and convex in s, so both ends enclose value and slope."""

    def __init__(self, kernel: Kernel) -> None:
        self.kernel = kernel
        self.compact = kernel.name != "gauss"

    def at(self, s: arb) -> arb:
        return _built_in(self.kernel, s)[0]

    def over(self, lo: arb, hi: arb) -> tuple[Range, Range | None]:
        (top, steep), (bottom, flat) = _built_in(self.kernel, lo), _built_in(self.kernel, hi)
        return (bottom.lower(), top.upper()), (steep.lower(), flat.upper())


class Pieces:
    """User kernels: each polynomial by its mean value form over a ball."""

    def __init__(self, kernel: Kernel) -> None:
        self.pieces = kernel.pieces
        self.compact = True

    def at(self, s: arb) -> arb:
        lo, hi = self.over(s, s)[0]
        return _ball(lo, hi)

    def over(self, lo: arb, hi: arb) -> tuple[Range, Range | None]:
        r = _ball(lo.max(arb(0)).sqrt().lower(), hi.max(arb(0)).sqrt().upper())
        values: list[arb] = []
        slopes: list[arb] = []
        known = True
        if not r < 1:
            values.append(arb(0))
            slopes.append(arb(0))
        for piece in self.pieces:
            if r < piece.r_lo or r > piece.r_hi:
                continue
            value, slope = _piece_over(piece, r.intersection(_ball(arb(piece.r_lo), arb(piece.r_hi))))
            values.append(value)
            known = known and slope is not None
            if slope is not None:
                slopes.append(slope)
        return (_least(values), _greatest(values)), (_least(slopes), _greatest(slopes)) if known else None


def _piece_over(piece: KernelPiece, r: arb) -> tuple[arb, arb | None]:
    """Enclosures of D and dD/ds over a ball of r within a piece."""
    x = ((r * r if piece.variable == "s" else r) - arb(piece.centre)) / arb(piece.half)
    middle = arb(x.mid())
    derivative = _horner([k * arb(c) for k, c in enumerate(piece.coefficients)][1:], x)
    value = _horner(list(map(arb, piece.coefficients)), middle) + derivative * (x - middle)
    half = arb(piece.half)
    if piece.variable == "s":
        return value, derivative / half
    if r > 0:
        return value, derivative / (2 * half * r)
    if piece.centre == 0.0 and (len(piece.coefficients) < 2 or piece.coefficients[1] == 0.0):
        return value, _horner([k * arb(c) for k, c in enumerate(piece.coefficients)][2:], x) / (2 * half * half)
    return value, None


def _horner(coefficients: list[arb], x: arb) -> arb:
    total = arb(0)
    for c in reversed(coefficients):
        total = total * x + c
    return total


# ---- the field along the ray ---------------------------------------------------------------------------------


class Element:
    """One blob: its simplices along the ray, kernel, weight and 1 / reach^2."""

    def __init__(self, leaf: Leaf, same: list[int], o: list[arb], d: list[arb], corners: Array) -> None:
        self.kernel = Pieces(leaf.kernel) if leaf.kernel.pieces else BuiltIn(leaf.kernel)
        self.weight = sum((arb(float(leaf.weight[i])) for i in same), arb(0))
        self.scale = 1 / arb(float(leaf.reach[same[0]])) ** 2
        self.simplices: list[Simplex] = [_KINDS[corners.shape[1]](o, d, c) for c in corners]
        self.solid = leaf.skeleton if geometry.is_solid(leaf.skeleton) else None
        self.line = (np.array([float(x.mid()) for x in o]), np.array([float(x.mid()) for x in d]))
        self.size = float(np.abs(corners).max()) + 1e-300

    def is_inside(self, t: float) -> bool:
        return bool(geometry.inside(self.solid, (self.line[0] + t * self.line[1])[None])[0])  # pyright: ignore[reportArgumentType]


@dataclass
class Active:
    """What of an element matters on an interval: its nearest simplices; for solids, whether the
    interval lies inside or outside as a whole (None: not known)."""

    element: Element
    simplices: list[Simplex]
    inside: bool | None = None


@dataclass
class Group:
    """A node, of the children that matter on an interval."""

    op: str
    children: list[ActiveField]


ActiveField = Active | Group
#: Enclosures of value and slope (None: not known), and what is active.
Part = tuple[Range, Range | None, ActiveField]


class Ray:
    """F and dF/dt along one ray, over intervals and at points."""

    def __init__(self, surface: Surface, threshold: arb, origin: Array, direction: Array) -> None:
        self.threshold = threshold
        o, d = _vector(origin), _vector(direction)
        length = _dot(d, d).sqrt()
        self.o, self.d = o, [x / length for x in d]
        self.whole = self._active(surface.field)
        self.evaluations = 0

    def _active(self, tree: Field) -> ActiveField:
        if isinstance(tree, Node):
            return Group(tree.op, [self._active(child) for child in tree.children])
        return Group("sum", [Active(element, element.simplices) for element in self._elements(tree)])

    def _elements(self, leaf: Leaf) -> Iterator[Element]:
        o, d = self.o, self.d
        if leaf.matrix is not None:
            rows = [_vector(row[:3]) for row in leaf.matrix]
            o = [_dot(row, o) + arb(float(shift)) for row, shift in zip(rows, leaf.matrix[:, 3], strict=True)]
            d = [_dot(row, d) for row in rows]
        corners = geometry.simplices(leaf.skeleton)
        solid = geometry.is_solid(leaf.skeleton)
        for same in _folded(leaf, corners):
            own = corners[same[:1]] if isinstance(leaf.skeleton, Points | Lines) else corners
            if leaf.kernel.name != "gauss" and not solid:
                own = own[_may_be_near(o, d, own, float(leaf.reach[same[0]]))]
            if len(own):
                yield Element(leaf, same, o, d, own)

    # ---- one point ----

    def at(self, t: arb, tree: ActiveField | None = None) -> arb:
        """Enclosure of F(t)."""
        self.evaluations += 1
        return self._at(t, self.whole if tree is None else tree) - self.threshold

    def _at(self, t: arb, tree: ActiveField) -> arb:
        if isinstance(tree, Active):
            q = _nearest([simplex.at(t) for simplex in tree.simplices])[0].max(arb(0))
            if tree.element.solid is not None:
                q = self._solid(tree, q, t)
            return tree.element.weight * tree.element.kernel.at(q * tree.element.scale)
        return _fold(tree.op, [self._at(t, child) for child in tree.children])

    def _solid(self, tree: Active, q: arb, t: arb) -> arb:
        if tree.inside is not None:
            return arb(0) if tree.inside else q
        if q > (1e-9 * tree.element.size) ** 2:
            return arb(0) if tree.element.is_inside(float(t.mid())) else q
        return _ball(arb(0), q)

    # ---- an interval ----

    def over(self, a: arb, b: arb, tree: ActiveField) -> Part:
        """Enclosures of F and dF/dt over [a, b], and what is active there."""
        self.evaluations += 1
        value, slope, active = self._over(a, b, tree)
        return (value[0] - self.threshold, value[1] - self.threshold), slope, active

    def _over(self, a: arb, b: arb, tree: ActiveField) -> Part:
        if isinstance(tree, Active):
            return self._leaf_over(a, b, tree)
        parts = [self._over(a, b, child) for child in tree.children]
        match tree.op:
            case "sum":
                return self._sum_over(parts)
            case "max" | "min":
                return self._extremum_over(tree.op, parts)
            case "smooth_max":
                return self._joint_over(parts)
            case _:
                value, slope, active = self._joint_over([(_negated(p[0]), _negated_or_not(p[1]), p[2]) for p in parts])
                return _negated(value), _negated_or_not(slope), Group(tree.op, _children(active))

    def _sum_over(self, parts: list[Part]) -> Part:
        zero = arb(0)
        value = sum((p[0][0] for p in parts), zero), sum((p[0][1] for p in parts), zero)
        slopes = _slopes(parts)
        slope = None if slopes is None else (sum((s[0] for s in slopes), zero), sum((s[1] for s in slopes), zero))
        return value, slope, Group("sum", [p[2] for p in parts if not _is_zero(p)])

    def _extremum_over(self, op: str, parts: list[Part]) -> Part:
        if not parts:
            return (arb(0), arb(0)), (arb(0), arb(0)), Group("sum", [])
        if op == "max":
            best = _greatest([p[0][0] for p in parts])
            parts = [p for p in parts if not p[0][1] < best]
            value = best, _greatest([p[0][1] for p in parts])
        else:
            best = _least([p[0][1] for p in parts])
            parts = [p for p in parts if not p[0][0] > best]
            value = _least([p[0][0] for p in parts]), best
        slopes = _slopes(parts)
        slope = None if slopes is None else (_least([s[0] for s in slopes]), _greatest([s[1] for s in slopes]))
        return value, slope, Group(op, [p[2] for p in parts])

    def _joint_over(self, parts: list[Part]) -> Part:
        """A mean with shares p / sum of all p, p = f^m: it lies within the values; its slope is that of every part
        times share + m * (share / f) * (f - mean)."""
        parts = [p for p in parts if not p[0][1] <= 0]
        if not parts:
            return (arb(0), arb(0)), (arb(0), arb(0)), Group("sum", [])
        active = Group("smooth_max", [p[2] for p in parts])
        zero, one, m = arb(0), arb(1), SHARPNESS
        values = [(p[0][0].max(zero).lower(), p[0][1].upper()) for p in parts]
        powers = [(low**m, high**m) for low, high in values]
        most, least = sum((p[1] for p in powers), zero), sum((p[0] for p in powers), zero)
        shares = [(_share(low, most - high), _share(high, least - low)) for low, high in powers]
        top = _greatest([high for _, high in values])
        given = sum((share[0] for share in shares), zero)
        bottom = sum((share[0] * low for share, (low, _) in zip(shares, values, strict=True)), zero).lower()
        high = sum((share[0] * high for share, (_, high) in zip(shares, values, strict=True)), zero)
        value = bottom, (high + (one - given).max(zero) * top).min(top).upper()
        slopes = _slopes(parts)
        if slopes is None or not least > 0:
            return value, None, active
        total = zero, zero
        for (low, high), share, slope in zip(values, shares, slopes, strict=True):
            per_value = (low ** (m - 1) / most).lower(), (high ** (m - 1) / least).upper()
            above = (low - value[1], high - value[0])
            inner = (one - share[1]).max(zero), (one - share[0]).max(zero)
            limited = _product(inner, (low - top, high))
            gap = above[0].max(limited[0]), above[1].min(limited[1])
            rate = _product(per_value, gap)
            part = _product((share[0] + m * rate[0], share[1] + m * rate[1]), slope)
            total = total[0] + part[0], total[1] + part[1]
        return value, total, active

    def _leaf_over(self, a: arb, b: arb, tree: Active) -> Part:
        q, rate, tree = self._distance_over(a, b, tree)
        element = tree.element
        value, slope = element.kernel.over((q[0] * element.scale).lower(), (q[1] * element.scale).upper())
        weighted = _product((element.weight, element.weight), value)
        if slope is None:
            return weighted, None, tree
        factor = element.weight * element.scale
        return weighted, _product((factor, factor), _product(slope, rate)), tree

    def _distance_over(self, a: arb, b: arb, tree: Active) -> tuple[Range, Range, Active]:
        spans = [(simplex, *_convex_range(a, b, simplex.at(a), simplex.at(b))) for simplex in tree.simplices]
        top = spans[0][1][1]
        for _, q, _ in spans[1:]:
            top = top.min(q[1])
        top = top.upper()
        spans = [span for span in spans if not span[1][0] > top]
        q = _least([span[1][0] for span in spans]), top
        rate = _least([span[2][0] for span in spans]), _greatest([span[2][1] for span in spans])
        active = Active(tree.element, [span[0] for span in spans], tree.inside)
        if tree.element.solid is None:
            return q, rate, active
        return self._solid_over(a, b, q, rate, active)

    def _solid_over(self, a: arb, b: arb, q: Range, rate: Range, active: Active) -> tuple[Range, Range, Active]:
        zero = arb(0)
        if active.inside is None and q[0] > (1e-9 * active.element.size) ** 2:
            active.inside = active.element.is_inside(float(((a + b) / 2).mid()))
        if active.inside is None:
            return (zero, q[1]), (_least([rate[0], zero]), _greatest([rate[1], zero])), active
        return ((zero, zero), (zero, zero), active) if active.inside else (q, rate, active)


def _slopes(parts: list[Part]) -> list[Range] | None:
    """Those of all parts, None if one is not known."""
    slopes = [p[1] for p in parts if p[1] is not None]
    return slopes if len(slopes) == len(parts) else None


def _is_zero(part: Part) -> bool:
    """Nothing of it is felt, and no sub-interval will feel more."""
    value, slope, _ = part
    return bool(value[0] == 0 and value[1] == 0 and slope is not None and slope[0] == 0 and slope[1] == 0)


def _negated(values: Range) -> Range:
    return -values[1], -values[0]


def _negated_or_not(values: Range | None) -> Range | None:
    return None if values is None else _negated(values)


def _children(tree: ActiveField) -> list[ActiveField]:
    return tree.children if isinstance(tree, Group) else [tree]


def _share(part: arb, rest: arb) -> arb:
    """part / (part + rest) of numbers that are not negative; 1 at most, where both may be 0, too."""
    whole = part + rest.max(arb(0))
    return (part / whole).min(arb(1)) if whole > 0 else arb(1) if part > 0 else arb(0)


def _smooth_max(values: list[arb]) -> arb:
    positive = [value.max(arb(0)) for value in values]
    total = sum((value**SHARPNESS for value in positive), arb(0))
    if not total > 0:
        return _ball(arb(0), _greatest(positive).upper())
    return sum((value ** (SHARPNESS + 1) for value in positive), arb(0)) / total


def _fold(op: str, values: list[arb]) -> arb:
    if op == "sum" or not values:
        return sum(values, arb(0))
    if op == "smooth_max":
        return _smooth_max(values)
    if op == "smooth_min":
        return -_smooth_max([-value for value in values])
    result = values[0]
    for value in values[1:]:
        result = result.max(value) if op == "max" else result.min(value)
    return result


def _convex_range(a: arb, b: arb, at_a: tuple[arb, arb], at_b: tuple[arb, arb]) -> tuple[Range, Range]:
    """Range of a convex function and of its slope from values and slopes at both ends: the least
    value is where the tangents meet, or at an end."""
    (qa, da), (qb, db) = at_a, at_b
    top = qa.max(qb).upper()
    if da >= 0:
        bottom = qa.lower()
    elif db <= 0:
        bottom = qb.lower()
    elif db > da:
        meet = (qb - qa + da * a - db * b) / (da - db)
        bottom = (qa + da * (meet - a)).lower().max(arb(0))
    else:
        bottom = arb(0)
    return (bottom.max(arb(0)), top), (da.lower(), db.upper())


def _folded(leaf: Leaf, corners: Array) -> list[list[int]]:
    """Elements at one place with one reach are one element with the sum of their weights: no
    bound that looks at them one by one could see how they cancel."""
    if not isinstance(leaf.skeleton, Points | Lines):
        return [[0]]
    groups: dict[bytes, list[int]] = {}
    for i in range(leaf.count):
        groups.setdefault(corners[i].tobytes() + leaf.reach[i].tobytes(), []).append(i)
    return list(groups.values())


def _may_be_near(o: list[arb], d: list[arb], corners: Array, reach: float) -> NDArray[np.bool_]:
    """In float64 with a wide margin: the infinite line passes the simplex's ball within reach."""
    start, along = np.array([float(x.mid()) for x in o]), np.array([float(x.mid()) for x in d])
    middle = corners.mean(axis=1)
    radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    v = middle - start
    foot = (v @ along / (along @ along))[:, None] * along
    margin = 1e-9 * (np.abs(corners).max() + np.abs(start).max() + reach)
    return np.linalg.norm(v - foot, axis=1) <= (radius + reach) * (1.0 + 1e-9) + margin


# ---- the search ---------------------------------------------------------------------------------------------


@dataclass
class _Search:
    """First change of sign of F on [a, b], which starts with the given state."""

    ray: Ray
    sign: int  # -1: F < 0 at the start (outside), +1: F > 0
    width: arb
    touches: list[float] = field(default_factory=list[float])

    def run(self, a: arb, b: arb) -> arb | None:
        stack = [(a, b, self.ray.whole)]
        while stack:
            if self.ray.evaluations > _BUDGET:
                raise UndecidedError(f"{len(stack)} intervals left")
            lo, hi, tree = stack.pop()
            outcome = self._step(lo, hi, tree)
            if isinstance(outcome, arb):
                return outcome
            stack.extend(outcome)
        return None

    def _towards(self, values: Range) -> Range:
        """Turned so that the start is below zero."""
        return values if self.sign < 0 else (-values[1], -values[0])

    def _at(self, t: arb, tree: ActiveField) -> arb:
        return -self.sign * self.ray.at(t, tree)

    def _step(self, a: arb, b: arb, tree: ActiveField) -> arb | list[tuple[arb, arb, ActiveField]]:
        value, slope, tree = self.ray.over(a, b, tree)
        if self._towards(value)[1] < 0:
            return []
        if slope is not None:
            middle = (a + b) / 2
            middle = arb(middle.mid())
            slope = self._towards(slope)
            centre, half = self._at(middle, tree), (b - a).upper() / 2
            steepest = slope[0].abs_upper().max(slope[1].abs_upper())
            if centre + half * steepest < 0:
                return []
            if slope[1] <= 0:
                return []  # it starts below zero and falls
            if slope[0] >= 0:
                end = self._at(b, tree)
                if end < 0:
                    return []
                if end > 0:
                    return self._polish(a, b, tree)
        if b - a < self.width:
            return self._tiny(a, b)
        middle = arb(((a + b) / 2).mid())
        return [(middle, b, tree), (a, middle, tree)]

    def _tiny(self, a: arb, b: arb) -> arb | list[tuple[arb, arb, ActiveField]]:
        """Too short to halve: a crossing if F is beyond zero behind it, else a touch."""
        behind = arb((b + 4 * (b - a)).mid())
        if self.ray.at(behind) * -self.sign > 0:
            return _ball(a, behind)
        self.touches.append(float(a.mid()))
        return []

    def _polish(self, a: arb, b: arb, tree: ActiveField) -> arb:
        """One crossing in [a, b], F monotone: bisection with Newton's interval step."""
        while b - a > self.width and not _thin(a, b):
            middle = arb(((a + b) / 2).mid())
            centre = self._at(middle, tree)
            _, slope, _ = self.ray.over(a, b, tree)
            if slope is not None and (rate := _ball(*self._towards(slope))) > 0:
                step = middle - centre / rate
                a, b = a.max(step.lower()).lower(), b.min(step.upper()).upper()
                if not b > a:
                    break
                middle = arb(((a + b) / 2).mid())
                centre = self._at(middle, tree)
            if centre > 0:
                b = middle
            elif centre < 0:
                a = middle
            else:
                break
        return _ball(a, b)


def _thin(a: arb, b: arb) -> bool:
    return bool((b - a).abs_upper() < (a.abs_upper() + b.abs_upper()) * 2.0**-110)


def _window(surface: Surface, origin: Array, direction: Array) -> tuple[float, float] | None:
    """Part of the ray outside which the sign of F is that of -threshold: no compact element is
    felt, and all Gaussians together stay below half of |threshold|."""
    unit = direction / np.abs(direction).max()
    unit = unit / np.linalg.norm(unit)
    present = list(leaves(surface.field))
    count = sum(leaf.count for leaf in present)
    ends: list[tuple[float, float]] = []
    for leaf in present:
        ends.extend(_felt(leaf, origin, unit, abs(surface.threshold) / 2.0 / max(count, 1)))
    if not ends:
        return None
    lo, hi = min(e[0] for e in ends), max(e[1] for e in ends)
    margin = 1e-6 * (hi - lo) + 1e-9 * (abs(lo) + abs(hi))
    return lo - margin, hi + margin


def _felt(leaf: Leaf, origin: Array, unit: Array, share: float) -> Iterator[tuple[float, float]]:
    matrix = np.eye(3, 4) if leaf.matrix is None else leaf.matrix
    start, along = matrix[:, :3] @ origin + matrix[:, 3], matrix[:, :3] @ unit
    speed = float(np.linalg.norm(along))
    corners = geometry.simplices(leaf.skeleton)
    if not isinstance(leaf.skeleton, Points | Lines):
        corners = corners.reshape(1, -1, 3)
    for i in range(leaf.count):
        middle = corners[i].mean(axis=0)
        weight = abs(float(leaf.weight[i]))
        cut = kernels.cut(leaf.kernel, max(min(share / weight, 1.0), 1e-300))
        radius = float(np.linalg.norm(corners[i] - middle, axis=1).max()) + float(leaf.reach[i]) * max(cut, 1e-3)
        at = float((middle - start) @ along) / speed**2
        yield at - radius / speed, at + radius / speed


def _steepening(tree: Field, leaf: Leaf) -> float:
    """How much steeper than a leaf the field may be for it: smooth nodes above it."""
    if isinstance(tree, Leaf):
        return 1.0 if tree is leaf else 0.0
    below = max((_steepening(child, leaf) for child in tree.children), default=0.0)
    return below * (STEEPER if tree.op in ("smooth_max", "smooth_min") else 1.0)


def rounding(surface: Surface, origin: Array, distance: float) -> float:
    """What double precision may get wrong in F, over the whole ray: the terms' rounding, and that
    of the position times the steepest gradient. Generous: it only marks rays as not stable."""
    total, steep = abs(surface.threshold), 0.0
    for leaf in leaves(surface.field):
        speed = 1.0 if leaf.matrix is None else float(np.linalg.norm(leaf.matrix[:, :3], 2))
        times = _steepening(surface.field, leaf)
        total += times * float(np.sum(np.abs(leaf.weight))) * 2.0 * max(map(abs, kernels.peak(leaf.kernel)))
        steep += times * float(np.sum(np.abs(leaf.weight) / leaf.reach)) * kernels.lipschitz(leaf.kernel) * speed
    return 8.0 * _EPS * total + 4.0 * _EPS * steep * (float(np.linalg.norm(origin)) + distance)


def _one_surface(
    surface: Surface, shift: float, origin: Array, direction: Array, t_min: float, t_max: float, slack: float
) -> Answer:
    window = _window(surface, origin, direction)
    start = "in" if surface.threshold < 0 else "out"
    if window is None:
        return Answer("miss", start=start)
    lo, hi = max(t_min, window[0]), min(t_max, window[1])
    if not hi > lo:
        return Answer("miss", start=start)
    depth = _depth(surface, hi - lo)
    ctx.prec = PRECISION + 2 * depth
    ray = Ray(surface, arb(surface.threshold) + arb(shift), origin, direction)
    a, sign = _start(ray, arb(lo), arb(hi), slack)
    search = _Search(ray, sign, arb(hi - lo) / arb(2) ** (_TINY + depth))
    t = search.run(a, arb(hi))
    state = "in" if sign > 0 else "out"
    touches = tuple(search.touches)
    if t is None or t > t_max:
        return Answer("touch" if touches else "miss", start=state, touches=touches)
    return Answer("hit", t, "exit" if sign > 0 else "enter", start=state, touches=touches)


def _depth(surface: Surface, length: float) -> int:
    """Bits between the length of the search and the smallest reach."""
    smallest = min((float(leaf.reach.min()) for leaf in leaves(surface.field) if leaf.count), default=length)
    return max(0, math.ceil(math.log2(length / smallest)))


def _start(ray: Ray, a: arb, b: arb, slack: float) -> tuple[arb, int]:
    """Where the search starts and the state there. Within `slack` of zero (on the surface) F
    decides as soon as it has left zero monotonely; if it never does, where it first is clear."""
    at_start = ray.at(a)
    if at_start > slack:
        return a, 1
    if at_start < -slack:
        return a, -1
    last = None
    for k in range(120):
        end = arb((a + (b - a) / 2**k).mid())
        value = ray.at(end)
        if value.contains(0) or abs(value) <= slack:
            _, slope, _ = ray.over(end, end, ray.whole)
            if slope is not None and (slope[0] * (end - a) > 8 * slack or slope[1] * (end - a) < -8 * slack):
                continue  # not on the surface still, but crossing it again farther on
            break
        last = end, (1 if value > 0 else -1)
        _, slope, _ = ray.over(a, end, ray.whole)
        if slope is not None and ((slope[0] > 0 and value > 0) or (slope[1] < 0 and value < 0)):
            return last
    return last if last is not None else (a, -1)


def first_hit(
    scene: Scene,
    origin: ArrayLike,
    direction: ArrayLike,
    t_min: float = 0.0,
    t_max: float = math.inf,
    *,
    shift: float = 0.0,
    slack: float = 0.0,
) -> Answer:
    """First crossing in (t_min, t_max] of any surface, distances along the normalised direction.

    shift is added to the thresholds; a start with |F| <= slack counts as lying on the surface.
    Raises UndecidedError where F is zero over a stretch of the ray.
    """
    o, d = np.asarray(origin, dtype=np.float64), np.asarray(direction, dtype=np.float64)
    before, ctx.prec = ctx.prec, PRECISION
    try:
        answers = [_one_surface(s, shift, o, d, t_min, t_max, slack) for s in scene.surfaces]
    finally:
        ctx.prec = before
    hits = [(a.distance, i, a) for i, a in enumerate(answers) if a.status == "hit"]
    if hits:
        _, i, best = min(hits, key=lambda entry: entry[:2])
        return Answer("hit", best.t, best.kind, i, best.start, best.touches)
    touched = [a for a in answers if a.status == "touch"]
    return touched[0] if touched else (answers[0] if answers else Answer("miss"))


def certain_hit(
    scene: Scene, origin: ArrayLike, direction: ArrayLike, t_min: float = 0.0, t_max: float = math.inf
) -> Answer:
    """`first_hit`, and whether a tracer in double precision must agree: the thresholds are shifted
    both ways by the rounding of F, and the answers compared."""
    o = np.asarray(origin, dtype=np.float64)
    distance = float(np.linalg.norm(o)) + sum(float(np.linalg.norm(_size(s.field))) for s in scene.surfaces)
    slack = max((rounding(s, o, distance) for s in scene.surfaces), default=0.0)
    exact = first_hit(scene, origin, direction, t_min, t_max, slack=slack)
    low = first_hit(scene, origin, direction, t_min, t_max, shift=-slack, slack=2 * slack)
    high = first_hit(scene, origin, direction, t_min, t_max, shift=slack, slack=2 * slack)
    same = len({(a.status, a.kind, a.surface) for a in (exact, low, high)}) == 1 and exact.status != "touch"
    spread = max(abs(low.distance - exact.distance), abs(high.distance - exact.distance)) if same else math.inf
    spread = 0.0 if exact.status == "miss" else spread
    position = 8.0 * _EPS * (float(np.linalg.norm(o)) + (exact.distance if exact.status == "hit" else 0.0))
    stable = same and (exact.status != "hit" or spread < 1e-4 * max(1.0, exact.distance))
    return Answer(
        exact.status, exact.t, exact.kind, exact.surface, exact.start, exact.touches, stable, 2.0 * spread + position
    )


def _size(tree: Field) -> Array:
    lo, hi = extent(tree)
    return hi - lo + np.abs(lo) + np.abs(hi)
