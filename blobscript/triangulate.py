"""Flat polygons: do their edges cross, and which triangles cover them.

Polygons are cut into triangles by clipping ears (Meisters, "Polygons have ears", 1975). All
decisions (which side, do edges cross) are the sign of one 2 x 2 determinant of coordinate
differences, taken in double precision with an error bound and exactly, in whole numbers, where the
bound does not decide (Shewchuk, "Adaptive precision floating-point arithmetic", 1997, gives the
bound). To keep coordinates exact, the plane is projected along an axis, not rotated. Vertices on a
straight line between their neighbours are removed first: a simple polygon without them always has
an ear, so the clipping cannot get stuck.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Triangle", "clip_ears", "first_crossing", "segments_meet", "side"]

Array = NDArray[np.float64]
Pair = tuple[float, float]
Triangle = tuple[int, int, int]
#: Corners that were left out of an edge because they lie straight between its ends.
Chains = dict[tuple[int, int], list[int]]


def first_crossing(flat: Array) -> tuple[int, int] | None:
    """Numbers of two edges of the polygon that meet elsewhere than neighbours do; None: it is simple."""
    ends = np.roll(flat, -1, axis=0)
    lo_x, lo_y = np.minimum(flat, ends).T.copy()
    hi_x, hi_y = np.maximum(flat, ends).T.copy()
    points = [_pair(p) for p in flat]
    for i in range(len(flat)):
        later = slice(i + 1, None)
        near = (lo_x[later] <= hi_x[i]) & (hi_x[later] >= lo_x[i])
        near &= (lo_y[later] <= hi_y[i]) & (hi_y[later] >= lo_y[i])
        for j in (np.flatnonzero(near) + i + 1).tolist():
            if _edges_meet(points, i, j):
                return i, j
    return None


def _edges_meet(points: list[Pair], i: int, j: int) -> bool:
    """Do the edges from vertices i < j share a point (neighbours: more than their vertex)?"""
    n = len(points)
    a, b, c, d = points[i], points[i + 1], points[j], points[(j + 1) % n]
    if j == i + 1 or (i == 0 and j == n - 1):
        common, p, q = (b, a, d) if j == i + 1 else (a, b, c)
        if n == 3 or side(p, common, q):
            return False
        return (p[0] - common[0]) * (q[0] - common[0]) > 0 or (p[1] - common[1]) * (q[1] - common[1]) > 0
    return segments_meet(a, b, c, d)


def _pair(p: Array) -> Pair:
    return float(p[0]), float(p[1])


def segments_meet(a: Pair, b: Pair, c: Pair, d: Pair) -> bool:
    """Do the closed segments ab and cd share a point? Exact."""
    c_side, d_side = side(a, b, c), side(a, b, d)
    a_side, b_side = side(c, d, a), side(c, d, b)
    if c_side * d_side < 0 and a_side * b_side < 0:
        return True
    return (
        (not c_side and _in_box(c, a, b))
        or (not d_side and _in_box(d, a, b))
        or (not a_side and _in_box(a, c, d))
        or (not b_side and _in_box(b, c, d))
    )


def _in_box(p: Pair, a: Pair, b: Pair) -> bool:
    return min(a[0], b[0]) <= p[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= p[1] <= max(a[1], b[1])


def side(a: Pair, b: Pair, c: Pair) -> int:
    """+1: c lies left of the line from a to b, -1: right, 0: exactly on it."""
    left = (a[0] - c[0]) * (b[1] - c[1])
    right = (a[1] - c[1]) * (b[0] - c[0])
    det = left - right
    bound = 4e-16 * (abs(left) + abs(right))
    if abs(det) > bound and bound > 1e-290:
        return 1 if det > 0 else -1
    if (a[0] == c[0] or b[1] == c[1]) and (b[0] == c[0] or a[1] == c[1]):
        return 0  # all on one line along an axis, the usual case of three points in line
    ax, ay, bx, by, cx, cy = _whole((*a, *b, *c))
    exact = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)
    return (exact > 0) - (exact < 0)


def _whole(values: tuple[float, ...]) -> list[int]:
    """The numbers, times a common power of two that makes them whole."""
    ratios = [x.as_integer_ratio() for x in values]
    scale = max(below for _, below in ratios)
    return [above * (scale // below) for above, below in ratios]


@dataclass(slots=True, eq=False)
class _Ring:
    """What is left of a polygon: a circle of vertices, and the reflex ones among them by x.

    `reflex` belongs to the rows of `sorted_x` and `sorted_y`, `vertices` are their numbers.
    """

    points: list[Pair]
    before: list[int]
    after: list[int]
    there: list[bool]
    size: int
    turn: int
    sorted_x: Array
    sorted_y: Array
    vertices: NDArray[np.intp]
    rank: list[int]
    reflex: NDArray[np.bool_]
    chains: Chains

    def remove(self, k: int) -> None:
        self.after[self.before[k]], self.before[self.after[k]] = self.after[k], self.before[k]
        self.there[k] = False
        self.reflex[self.rank[k]] = False
        self.size -= 1


def _ring(flat: Array) -> _Ring:
    n = len(flat)
    order = np.argsort(flat[:, 0], kind="stable")
    rank = np.empty(n, dtype=np.intp)
    rank[order] = np.arange(n)
    points = [_pair(p) for p in flat]
    return _Ring(
        points=points,
        before=[n - 1, *range(n - 1)],
        after=[*range(1, n), 0],
        there=[True] * n,
        size=n,
        turn=_turn(points),
        sorted_x=flat[order, 0],
        sorted_y=flat[order, 1],
        vertices=order,
        rank=rank.tolist(),
        reflex=np.zeros(n, dtype=np.bool_),
        chains={},
    )


def clip_ears(flat: Array, keep_straight: bool) -> list[Triangle] | None:
    """Triangles of a simple polygon, listed in its direction; None if there is no way.

    keep_straight: every point becomes a corner of a triangle, so that two faces that share a
    chain of edges fit together without slits.
    """
    ring = _ring(flat)
    _settle(ring, list(range(len(flat))))
    triangles: list[Triangle] = []
    k, tried = 0, 0
    while ring.size > 2:
        if tried > ring.size:
            return None
        while not ring.there[k]:
            k = ring.before[k]
        if not _is_ear(ring, k):
            k, tried = ring.after[k], tried + 1
            continue
        ear = (ring.before[k], k, ring.after[k])
        triangles += _split(ear, ring.chains) if keep_straight else [ear]
        ring.remove(k)
        _settle(ring, [ear[0], ear[2]])
        k, tried = ear[0], 0
    return triangles


def _settle(ring: _Ring, changed: list[int]) -> None:
    """Look again at vertices whose neighbours changed: those that lie straight between them leave
    the ring (the area stays the same), the others are reflex or not."""
    points, chains = ring.points, ring.chains
    while changed and ring.size > 2:
        here = changed.pop()
        if not ring.there[here]:
            continue
        before, after = ring.before[here], ring.after[here]
        bend = side(points[before], points[here], points[after])
        ring.reflex[ring.rank[here]] = bend != ring.turn and bend != 0
        if bend == 0:
            chains[before, after] = [*chains.pop((before, here), ()), here, *chains.pop((here, after), ())]
            ring.remove(here)
            changed += (before, after)


def _split(triangle: Triangle, chains: Chains) -> list[Triangle]:
    """The triangle, cut so that the points in the chains of its edges become corners."""
    i, j, k = triangle
    for a, b, c in ((i, j, k), (j, k, i), (k, i, j)):
        chain = chains.pop((a, b), None)
        if chain:
            middle = chain[0]
            chains[middle, b] = chain[1:]
            return _split((a, middle, c), chains) + _split((middle, b, c), chains)
    return [triangle]


def _turn(points: list[Pair]) -> int:
    """+1 counter-clockwise, -1 clockwise: the turn at the lowest, leftmost vertex that turns."""
    n = len(points)
    for k in sorted(range(n), key=points.__getitem__):
        turn = side(points[k - 1], points[k], points[(k + 1) % n])
        if turn:
            return turn
    return 0


def _is_ear(ring: _Ring, k: int) -> bool:
    """A convex vertex whose triangle holds no other vertex; a reflex one would be among them."""
    if ring.reflex[ring.rank[k]]:
        return False
    corners = (ring.before[k], k, ring.after[k])
    a, b, c = (ring.points[i] for i in corners)
    lo_y, hi_y = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
    first = int(np.searchsorted(ring.sorted_x, min(a[0], b[0], c[0]), "left"))
    last = int(np.searchsorted(ring.sorted_x, max(a[0], b[0], c[0]), "right"))
    x, y = ring.sorted_x[first:last], ring.sorted_y[first:last]
    turn = side(a, b, c)
    near = np.flatnonzero(ring.reflex[first:last] & (y >= lo_y) & (y <= hi_y))
    for p, q in ((a, b), (b, c), (c, a)):
        near = near[~_surely_beyond(p, q, x[near], y[near], turn)]
    inside: list[int] = ring.vertices[first + near].tolist()
    return not any(i not in corners and _in_triangle(ring.points[i], a, b, c, turn) for i in inside)


def _surely_beyond(a: Pair, b: Pair, x: Array, y: Array, turn: int) -> NDArray[np.bool_]:
    """Which points lie beyond the line from a to b, as far as rounding lets one say (see `side`)."""
    left = (a[0] - x) * (b[1] - y)
    right = (a[1] - y) * (b[0] - x)
    bound = 4e-16 * (np.abs(left) + np.abs(right))
    return (turn * (left - right) < -bound) & (bound > 1e-290)


def _in_triangle(p: Pair, a: Pair, b: Pair, c: Pair, turn: int) -> bool:
    return side(a, b, p) * turn >= 0 and side(b, c, p) * turn >= 0 and side(c, a, p) * turn >= 0
