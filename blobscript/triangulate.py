"""Flat polygons: do their edges cross, and which triangles cover them.

Polygons are cut into triangles by clipping ears (Meisters, "Polygons have ears", 1975). All
decisions (which side, do edges cross) are the sign of one 2 x 2 determinant of coordinate
differences, taken in double precision with an error bound and exactly, in fractions, where the
bound does not decide (Shewchuk, "Adaptive precision floating-point arithmetic", 1997, gives the
bound). To keep coordinates exact, the plane is projected along an axis, not rotated. Vertices on a
straight line between their neighbours are removed first: a simple polygon without them always has
an ear, so the clipping cannot get stuck.
"""

from __future__ import annotations

from fractions import Fraction

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
    n = len(flat)
    for i in range(n):
        a, b = flat[i], flat[(i + 1) % n]
        later = np.arange(i + 1, n)
        c, d = flat[later], flat[(later + 1) % n]
        near = np.all(np.minimum(c, d) <= np.maximum(a, b), axis=1)
        near &= np.all(np.maximum(c, d) >= np.minimum(a, b), axis=1)
        for j in later[near].tolist():
            if _edges_meet(flat, i, j):
                return i, j
    return None


def _edges_meet(flat: Array, i: int, j: int) -> bool:
    """Do the edges from vertices i < j share a point (neighbours: more than their vertex)?"""
    n = len(flat)
    a, b, c, d = (_pair(flat[k % n]) for k in (i, i + 1, j, j + 1))
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
    ax, ay, bx, by, cx, cy = map(Fraction, (*a, *b, *c))
    exact = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)
    return (exact > 0) - (exact < 0)


def clip_ears(flat: Array, keep_straight: bool) -> list[Triangle] | None:
    """Triangles of a simple polygon, listed in its direction; None if there is no way.

    keep_straight: every point becomes a corner of a triangle, so that two faces that share a
    chain of edges fit together without slits.
    """
    points = [_pair(p) for p in flat]
    ring = list(range(len(points)))
    turn = _turn(points, ring)
    reflex: set[int] = set()
    chains: Chains = {}
    _settle(points, ring, list(ring), turn, reflex, chains)
    triangles: list[Triangle] = []
    k = tried = 0
    while len(ring) > 2:
        if tried > len(ring):
            return None
        k %= len(ring)
        if not _is_ear(points, ring, k, reflex):
            k, tried = k + 1, tried + 1
            continue
        ear = (ring[k - 1], ring[k], ring[(k + 1) % len(ring)])
        triangles += _split(ear, chains) if keep_straight else [ear]
        del ring[k]
        _settle(points, ring, [ear[0], ear[2]], turn, reflex, chains)
        k, tried = max(k - 1, 0), 0
    return triangles


def _settle(
    points: list[Pair], ring: list[int], changed: list[int], turn: int, reflex: set[int], chains: Chains
) -> None:
    """Look again at vertices whose neighbours changed: those that lie straight between them leave
    the ring (the area stays the same), the others are reflex or not."""
    while changed and len(ring) > 2:
        here = changed.pop()
        if here not in ring:
            continue
        k = ring.index(here)
        before, after = ring[k - 1], ring[(k + 1) % len(ring)]
        bend = side(points[before], points[here], points[after])
        reflex.discard(here)
        if bend == 0:
            chains[before, after] = [*chains.pop((before, here), ()), here, *chains.pop((here, after), ())]
            del ring[k]
            changed += (before, after)
        elif bend != turn:
            reflex.add(here)


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


def _turn(points: list[Pair], ring: list[int]) -> int:
    """+1 counter-clockwise, -1 clockwise: the turn at the lowest, leftmost vertex that turns."""
    n = len(ring)
    order = sorted(range(n), key=lambda k: points[ring[k]])
    for k in order:
        turn = side(points[ring[k - 1]], points[ring[k]], points[ring[(k + 1) % n]])
        if turn:
            return turn
    return 0


def _is_ear(points: list[Pair], ring: list[int], k: int, reflex: set[int]) -> bool:
    """A convex vertex whose triangle holds no other vertex; a reflex one would be among them."""
    corners = (ring[k - 1], ring[k], ring[(k + 1) % len(ring)])
    if corners[1] in reflex:
        return False
    a, b, c = (points[i] for i in corners)
    lo_x, hi_x = min(a[0], b[0], c[0]), max(a[0], b[0], c[0])
    lo_y, hi_y = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
    turn = side(a, b, c)
    for i in reflex:
        x, y = points[i]
        if lo_x <= x <= hi_x and lo_y <= y <= hi_y and i not in corners and _in_triangle((x, y), a, b, c, turn):
            return False
    return True


def _in_triangle(p: Pair, a: Pair, b: Pair, c: Pair, turn: int) -> bool:
    return side(a, b, p) * turn >= 0 and side(b, c, p) * turn >= 0 and side(c, a, p) * turn >= 0
