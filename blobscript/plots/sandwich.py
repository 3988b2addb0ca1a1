"""The search for the first hit along one ray, step by step, as the tracer does it, for looking at.

Between two events (an element begins or ceases to be felt, a piece of its distance changes) each density
lies between two quadratics in t, written as Bernstein triples (c0, c1, c2) on [a, b]:

    point, segment   s is a quadratic: exactly known
    any other set    dist^2 is t^2 plus a concave function: chord - v^2 (t-a)(b-t) <= dist^2
                     <= either end's tangent + v^2 (t-end)^2, v the local speed
    kernel           falling and convex in s: below its chord over [s_min, s_max], above its tangent

Sums add triples, max and min choose among them. Then, with F = field - threshold turned so that the search
starts below 0: U < 0 on all of [a, b]: skip it. U(a) < 0: move to U's first root (and halve, if that is not
far). L >= 0 at some x: a crossing in [a, x], the bracket. Otherwise halve, left half first. (The C does the
same with a rounding bound and eight rays at once; this is for one ray and one reader.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blobscript import field, kernels
from blobscript.ir import Kernel
from blobscript.plots.elements import Element, Ray, Tree, combine, flat

__all__ = ["Search", "Step", "densities", "search", "values", "window"]

Array = NDArray[np.float64]

#: A bracket is narrow enough for the eye at this share of the window; halving stops the search here, too.
_NARROW = 1e-9
_MOST_STEPS = 400
#: A move by less than this share of the interval is followed by a look at half of the rest.
_LITTLE = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One look at [a, b]: quadratics below and above F + threshold, and what follows from them.

    outcome: "skip", "move", "bracket" or "halve"; `to`: where the search goes on, or the bracket's end.
    """

    a: float
    b: float
    lower: Array  # (3,)
    upper: Array
    outcome: str
    to: float

    def bounds(self, t: Array) -> tuple[Array, Array]:
        """Both at distances (n,) of [a, b]."""
        return _quadratic(self.lower, self._share(t)), _quadratic(self.upper, self._share(t))

    def _share(self, t: Array) -> Array:
        return (t - self.a) / (self.b - self.a)


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """events: (k,) sorted; steps in their order; t: where the crossing is (inf: none in the window)."""

    start: float
    end: float
    inside: bool
    events: Array
    steps: tuple[Step, ...]
    t: float


def _quadratic(c: Array, x: Array) -> Array:
    return (1 - x) ** 2 * c[0] + 2 * x * (1 - x) * c[1] + x * x * c[2]


# ---- values along the ray ----------------------------------------------------------------------


def values(tree: Tree, ray: Ray, t: Array) -> Array:
    """The field at distances (n,)."""
    return densities(tree, ray.at(t))


def densities(tree: Tree, points: Array) -> Array:
    """The field at points (n, 3)."""
    if isinstance(tree, Element):
        return tree.density(points)
    return combine(tree[0], [densities(child, points) for child in tree[1]], len(points))


def window(tree: Tree, ray: Ray) -> tuple[float, float] | None:
    """From where to where anything is felt along the line."""
    found = [ends for element in flat(tree) if (ends := element.interval(ray)) is not None]
    return (min(e[0] for e in found), max(e[1] for e in found)) if found else None


# ---- bounds ------------------------------------------------------------------------------------

Triple = tuple[Array, Array]  # below and above, (3,) each


def _tree_bounds(tree: Tree, ray: Ray, a: float, b: float) -> Triple:
    if isinstance(tree, Element):
        return _element_bounds(tree, ray, a, b)
    operation, children = tree
    parts = [_tree_bounds(child, ray, a, b) for child in children]
    if not parts:
        return np.zeros(3), np.zeros(3)
    lower, upper = np.stack([p[0] for p in parts]), np.stack([p[1] for p in parts])
    if operation == "sum":
        return lower.sum(axis=0), upper.sum(axis=0)
    middle = np.array([0.25, 0.5, 0.25])
    if operation == "max":
        return lower[np.argmax(lower @ middle)], upper.max(axis=0)
    if operation == "min":
        return lower.min(axis=0), upper[np.argmin(upper @ middle)]
    return _joint_bounds(operation, lower, upper)


def _joint_bounds(operation: str, lower: Array, upper: Array) -> Triple:
    """Of a smooth joint, by the ranges of its children: (k, 3) each."""
    low, high = field._smooth_bounds(operation, lower.min(axis=1)[:, None], upper.max(axis=1)[:, None])  # pyright: ignore[reportPrivateUsage]
    return np.full(3, low[0]), np.full(3, high[0])


def _element_bounds(element: Element, ray: Ray, a: float, b: float) -> Triple:
    below, above = _square_bounds(element, ray, a, b)
    s_min, s_max = max(_least(below), 0.0), max(float(above.max()), 0.0)
    if s_min >= kernels.support(element.kernel) ** 2:
        return np.zeros(3), np.zeros(3)
    lower, upper = _kernel_bounds(element, below, above, s_min, s_max)
    weight = element.weight
    return (weight * lower, weight * upper) if weight > 0.0 else (weight * upper, weight * lower)


def _square_bounds(element: Element, ray: Ray, a: float, b: float) -> Triple:
    """s between two quadratics."""
    points = ray.at(np.array([a, b]))
    v = element.offsets(points)
    rate = element.turned(ray.direction) / element.reach
    s, slope = np.einsum("ij,ij->i", v, v), 2.0 * v @ rate
    h = b - a
    if element.exact:
        exact = np.array([s[0], s[0] + slope[0] * h / 2.0, s[1]])
        return exact, exact
    bend = float(rate @ rate) * h * h
    chord = np.array([s[0], s.mean() - bend / 2.0, s[1]])
    from_a = np.array([s[0], s[0] + slope[0] * h / 2.0, s[0] + slope[0] * h + bend])
    from_b = np.array([s[1] - slope[1] * h + bend, s[1] - slope[1] * h / 2.0, s[1]])
    return chord, from_a if from_a.sum() < from_b.sum() else from_b


def _least(c: Array) -> float:
    """Of a quadratic on [0, 1]."""
    bend = c[0] - 2.0 * c[1] + c[2]
    if bend > 0.0 and 0.0 < (x := (c[0] - c[1]) / bend) < 1.0:
        return float(_quadratic(c, np.array(x)))
    return float(min(c[0], c[2]))


def _kernel_bounds(element: Element, below: Array, above: Array, s_min: float, s_max: float) -> Triple:
    """D of s, where s lies between two quadratics and D falls: between chord and tangent, or in its range
    where it is not known how the kernel bends."""
    kernel = element.kernel
    bend = _bend(kernel, s_min, s_max)
    if bend is None or s_max <= s_min:
        low, high = (float(x[0]) for x in kernels.value_range(kernel, np.array([s_min]), np.array([s_max])))
        return np.full(3, low), np.full(3, high)
    middle = 0.5 * (s_min + s_max)
    d_min, d_mid, d_max = (float(x) for x in kernels.value(kernel, np.array([s_min, middle, s_max])))
    slope = float(kernels.slope(kernel, np.array([middle]))[0])
    fall = (d_max - d_min) / (s_max - s_min)
    if bend >= 0:
        return d_mid + slope * (above - middle), d_min + fall * (below - s_min)
    return d_min + fall * (above - s_min), d_mid + slope * (below - middle)


def _bend(kernel: Kernel, s_min: float, s_max: float) -> int | None:
    """+1 where D is convex in s, -1 where it is concave, None where that is not known or D may rise."""
    if not kernel.pieces:
        return 1
    r_min, r_max = float(np.sqrt(s_min)), float(np.sqrt(s_max))
    for piece in kernel.pieces:
        if piece.r_lo <= r_min and r_max <= piece.r_hi:
            return piece.convex if piece.falling else None
    return None


# ---- the search --------------------------------------------------------------------------------


def _events(tree: Tree, ray: Ray, start: float, end: float) -> Array:
    found = [start, end]
    for element in flat(tree):
        ends = element.interval(ray)
        if ends is not None:
            found += [*ends, *_piece_changes(element, ray)]
    inside = np.unique(np.clip(found, start, end))
    keep = np.concatenate([[True], np.diff(inside) > _NARROW * (end - start)])
    return inside[keep]


def _piece_changes(element: Element, ray: Ray) -> list[float]:
    """Where the nearest place of a segment passes from an end to the side, and where it is nearest of all."""
    o, d = element.mapped(ray.origin[None])[0], element.turned(ray.direction)
    first = element.corners[0, 0]
    if not element.exact:
        return []
    if element.corners.shape[1] == 1:
        return [float((first - o) @ d / (d @ d))]
    edge = element.corners[0, 1] - first
    along = float(d @ edge)
    if along == 0.0:
        return []
    return [float((first - o) @ edge / along), float((element.corners[0, 1] - o) @ edge / along)]


def search(tree: Tree, ray: Ray, threshold: float, start: float = 0.0, end: float = np.inf) -> Search:
    """From `start` on, within the window where anything is felt."""
    found = window(tree, ray)
    if found is None or found[1] <= start or found[0] >= end:
        inside = threshold <= 0.0
        return Search(start, start, inside, np.zeros(0), (), np.inf)
    a, b = max(found[0], start), min(found[1], end)
    events = _events(tree, ray, a, b)
    inside = bool(values(tree, ray, np.array([a]))[0] >= threshold)
    walk = _Walk(tree, ray, threshold, 1.0 if inside else -1.0, _NARROW * (b - a))
    t = walk.run(events)
    return Search(a, b, inside, events, tuple(walk.steps), t)


class _Walk:
    """sign: of F at the start."""

    def __init__(self, tree: Tree, ray: Ray, threshold: float, sign: float, narrow: float) -> None:
        self.tree, self.ray, self.threshold, self.sign, self.narrow = tree, ray, threshold, sign, narrow
        self.steps: list[Step] = []

    def run(self, events: Array) -> float:
        stack = [(float(a), float(b)) for a, b in zip(events[-2::-1], events[:0:-1], strict=True)]
        while stack and len(self.steps) < _MOST_STEPS:
            a, b = stack.pop()
            step = self._look(a, b)
            self.steps.append(step)
            match step.outcome:
                case "bracket":
                    return self._root(a, step.to)
                case "move" if step.to - a < _LITTLE * (b - a):
                    middle = 0.5 * (step.to + b)
                    stack += [(middle, b), (step.to, middle)]
                case "move":
                    stack.append((step.to, b))
                case "halve":
                    stack += [(step.to, b), (a, step.to)]
                case _:
                    pass
        return np.inf

    def _look(self, a: float, b: float) -> Step:
        lower, upper = _tree_bounds(self.tree, self.ray, a, b)
        low, high = lower - self.threshold, upper - self.threshold
        if self.sign > 0.0:
            low, high = -high, -low
        outcome, to = self._verdict(low, high, a, b)
        return Step(a, b, lower, upper, outcome, to)

    def _verdict(self, low: Array, high: Array, a: float, b: float) -> tuple[str, float]:
        """low <= F <= high on [a, b], F below 0 at the start."""
        grid = np.linspace(0.0, 1.0, 257)
        above = np.flatnonzero(_quadratic(high, grid) >= 0.0)
        if len(above) == 0 or b - a <= self.narrow:
            return "skip", b
        sure = np.flatnonzero(_quadratic(low, grid) >= 0.0)
        if len(sure):
            return "bracket", a + (b - a) * float(grid[sure[0]])
        if above[0] > 1:
            return "move", a + (b - a) * float(grid[above[0] - 1])
        return "halve", 0.5 * (a + b)

    def _root(self, a: float, b: float) -> float:
        """By halving the bracket."""
        for _ in range(80):
            middle = 0.5 * (a + b)
            before = (values(self.tree, self.ray, np.array([middle]))[0] - self.threshold) * self.sign > 0.0
            a, b = (middle, b) if before else (a, middle)
        return b
