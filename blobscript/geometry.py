"""Distance to skeletons: the vector from the nearest place of a skeleton to a point, in NumPy.

A skeleton is a set of simplices: points, segments or triangles, given by their corners (m, k, 3),
k = 1, 2, 3. Its distance is the least over them, and 0 inside a solid. Offsets are computed as
p - q for a place q of the simplex itself, so that an ill-conditioned q (slivers, flat triangles)
can only give a distance that is too long by the square of its error.

Many simplices are kept in a tree of boxes (eight neighbours along a Morton curve per node), which
is walked breadth first for all queries at once, as arrays of (query, node) pairs. Queries are
boxes; a point is a box of size 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import count

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blobscript.ir import Lines, Mesh, Points, Polygon, Polyhedron, Polyline, Skeleton

__all__ = [
    "Tree",
    "box_gap2",
    "box",
    "build_tree",
    "hull_points",
    "forget",
    "inside",
    "is_solid",
    "offset_to_simplices",
    "offsets",
    "pairs",
    "simplex_count",
    "simplices",
    "tree_of",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_FAN = 8
# Pairs held at once: bounds the memory of a walk to some 50 MB; fewer only adds loop overhead.
_PAIRS = 250_000
# Up to so many simplices, all of them are tried; from there on a walk is quicker.
_FEW = 64
# A tree of more simplices than _SCANNED takes more memory than the scene. The first few questions, of up to _SCANS
# points each and in all, are answered by looking at all simplices, _PART of them at a time.
_SCANNED, _SCANS, _PART = 100_000, 16, 16_384

# ---- simplices ------------------------------------------------------------------------------


@lru_cache(maxsize=16)
def simplices(skeleton: Skeleton) -> Array:
    """Corners (m, k, 3) of what the skeleton consists of; triangles start with their longest edge."""
    match skeleton:
        case Points(at):
            return at[:, None, :]
        case Lines(a, b):
            return np.stack([a, b], axis=1)
        case Polyline(points, closed):
            ends = np.roll(points, -1, axis=0)
            both = np.stack([points, ends], axis=1)
            return both if closed else both[:-1]
        case Polygon() | Polyhedron() | Mesh():
            return _longest_edge_first(skeleton.points[skeleton.triangles])


def simplex_count(skeleton: Skeleton) -> int:
    """How many simplices `simplices` would list."""
    match skeleton:
        case Points(at):
            return len(at)
        case Lines(a):
            return len(a)
        case Polyline(points, closed):
            return len(points) if closed else len(points) - 1
        case Polygon() | Polyhedron() | Mesh():
            return len(skeleton.triangles)


def hull_points(skeleton: Skeleton) -> tuple[Array, ...]:
    """Places (m, 3) whose hull holds the skeleton, in rows of one for each blob where there are many."""
    match skeleton:
        case Points(at):
            return (at,)
        case Lines(a, b):
            return a, b
        case Polyline(points):
            return (points,)
        case Polygon() | Polyhedron() | Mesh():
            return (_used_points(skeleton),)


def box(skeleton: Skeleton) -> tuple[Array, Array]:
    """Around all simplices; a mesh may have points that no triangle uses."""
    places = hull_points(skeleton)
    lo, hi = [p.min(axis=0) for p in places], [p.max(axis=0) for p in places]
    return np.min(lo, axis=0), np.max(hi, axis=0)


def _used_points(skeleton: Polygon | Polyhedron | Mesh) -> Array:
    """The points that triangles use, without a copy where that is all of them."""
    used = np.zeros(len(skeleton.points), dtype=np.bool_)
    used[skeleton.triangles] = True
    return skeleton.points if used.all() else skeleton.points[used]


def _by_parts(skeleton: Skeleton) -> Iterator[Array]:
    """The simplices of one skeleton, some at a time, and none of them kept."""
    for start in range(0, simplex_count(skeleton), _PART):
        some = slice(start, start + _PART)
        match skeleton:
            case Points(at):
                yield at[some, None]
            case Lines(a, b):
                yield np.stack([a[some], b[some]], axis=1)
            case Polyline(points):
                starts = np.arange(start, min(start + _PART, simplex_count(skeleton)))
                yield np.stack([points[starts], points[(starts + 1) % len(points)]], axis=1)
            case Polygon() | Polyhedron() | Mesh():
                yield _longest_edge_first(skeleton.points[skeleton.triangles[some]])


def is_solid(skeleton: Skeleton) -> bool:
    return isinstance(skeleton, Polyhedron) or (isinstance(skeleton, Mesh) and skeleton.solid)


def _longest_edge_first(corners: Array) -> Array:
    """Rotates each triangle (its orientation stays) so that edge 0-1 is the longest."""
    edges = np.roll(corners, -1, axis=1) - corners
    first = np.argmax(np.einsum("ijk,ijk->ij", edges, edges), axis=1)
    order = (first[:, None] + np.arange(3)) % 3
    return np.ascontiguousarray(np.take_along_axis(corners, order[:, :, None], axis=1))


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)


def _ratio(numerator: Array, denominator: Array) -> Array:
    """numerator / denominator, 0 where the denominator is."""
    good = denominator > 0.0
    return np.where(good, numerator / np.where(good, denominator, 1.0), 0.0)


def _offset_to_segment(p: Array, a: Array, b: Array) -> Array:
    """From the nearer end, so that places near either end keep their relative accuracy."""
    edge = b - a
    along = np.clip(_ratio(_dot(p - a, edge), _dot(edge, edge)), 0.0, 1.0)[..., None]
    return np.where(along < 0.5, (p - a) - along * edge, (p - b) + (1.0 - along) * edge)


def _offset_to_triangle(p: Array, a: Array, b: Array, c: Array) -> Array:
    """The shortest of the offsets to the three edges and, above the face, to the face.

    With e = b - a (the longest edge) and m the part of c - a perpendicular to it, a + x e + v m
    is the foot; it lies in the face if v > 0 and its coordinates along e and c - a allow it.
    """
    e, g, w = b - a, c - a, p - a
    ee = _dot(e, e)
    m = g - _ratio(_dot(g, e), ee)[..., None] * e
    m = m - _ratio(_dot(m, e), ee)[..., None] * e
    v = _ratio(_dot(w, m), _dot(m, m))
    x = _ratio(_dot(w, e), ee)
    u = x - v * _ratio(_dot(g, e), ee)
    best = w - x[..., None] * e - v[..., None] * m
    above = (v > 0.0) & (u > 0.0) & (u + v < 1.0)
    length = np.where(above, _dot(best, best), np.inf)
    for first, second in ((a, b), (b, c), (c, a)):
        other = _offset_to_segment(p, first, second)
        shorter = _dot(other, other) < length
        best = np.where(shorter[..., None], other, best)
        length = np.where(shorter, _dot(other, other), length)
    return best


def offset_to_simplices(p: Array, corners: Array) -> Array:
    """p - q with q the place of each simplex nearest to p: (..., 3) and (..., k, 3) -> (..., 3)."""
    match corners.shape[-2]:
        case 1:
            return p - corners[..., 0, :]
        case 2:
            return _offset_to_segment(p, corners[..., 0, :], corners[..., 1, :])
        case _:
            return _offset_to_triangle(p, corners[..., 0, :], corners[..., 1, :], corners[..., 2, :])


# ---- trees of boxes ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Tree:
    """`order` lists the items along the curve; `levels` go from the items' own boxes (in that
    order) up to at most _FAN boxes. A level is (lo (k, 3), hi (k, 3), reach (k,)): the box and
    the largest reach of the items below."""

    order: Ints
    levels: list[tuple[Array, Array, Array]]


def build_tree(corners: Array, reach: Array | None = None) -> Tree:
    lo, hi = corners.min(axis=1), corners.max(axis=1)
    order = np.argsort(_morton(0.5 * lo + 0.5 * hi), kind="stable")
    reaches = np.zeros(len(lo)) if reach is None else reach
    levels = [(lo[order], hi[order], reaches[order])]
    while len(levels[-1][0]) > _FAN:
        lo, hi, reaches = levels[-1]
        starts = np.arange(0, len(lo), _FAN)
        levels.append(
            (
                np.minimum.reduceat(lo, starts, axis=0),
                np.maximum.reduceat(hi, starts, axis=0),
                np.maximum.reduceat(reaches, starts),
            )
        )
    return Tree(order, levels)


@lru_cache(maxsize=16)
def tree_of(skeleton: Skeleton) -> Tree:
    return build_tree(simplices(skeleton))


def forget() -> None:
    """Drops what is kept for skeletons that may be asked about again."""
    simplices.cache_clear()
    tree_of.cache_clear()
    _asked.cache_clear()


def _morton(points: Array) -> Ints:
    """Position along a Morton curve through the points' box, 21 bits per axis."""
    lo = points.min(axis=0)
    size = float(np.max(points.max(axis=0) - lo))
    cells = ((points - lo) * ((2**21 - 1) / size if size > 0.0 else 0.0)).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for axis in range(3):
        code |= _spread(cells[:, axis]) << np.uint64(axis)
    return code.astype(np.int64)


def _spread(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Two zero bits between any two bits of a 21-bit number."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | (x << np.uint64(shift))) & np.uint64(mask)
    return x


def box_gap2(lo: Array, hi: Array, other_lo: Array, other_hi: Array) -> Array:
    """Squared distance between two boxes, 0 where they touch."""
    gap = np.maximum(np.maximum(other_lo - hi, lo - other_hi), 0.0)
    return _dot(gap, gap)


Keep = Callable[[Ints, Array, Array], NDArray[np.bool_]]


def pairs(tree: Tree, lo: Array, hi: Array, keep: Keep) -> Iterator[tuple[Ints, Ints]]:
    """Arrays of (query, item) that `keep(query, gap2, reach)` lets through on every level.

    A query's pairs come in one array, in rising order of queries.
    """
    yield from _walk(tree, lo, hi, keep, np.arange(len(lo)))


def _walk(tree: Tree, lo: Array, hi: Array, keep: Keep, queries: Ints) -> Iterator[tuple[Ints, Ints]]:
    top = len(tree.levels[-1][0])
    query = np.repeat(queries, top)
    node = np.tile(np.arange(top), len(queries))
    for depth in range(len(tree.levels) - 1, -1, -1):
        if len(query) > _PAIRS and len(queries) > 1:
            half = len(queries) // 2
            yield from _walk(tree, lo, hi, keep, queries[:half])
            yield from _walk(tree, lo, hi, keep, queries[half:])
            return
        node_lo, node_hi, reach = tree.levels[depth]
        gap2 = box_gap2(lo[query], hi[query], node_lo[node], node_hi[node])
        good = keep(query, gap2, reach[node])
        query, node = query[good], node[good]
        if depth > 0:
            query, node = _children(query, node, len(tree.levels[depth - 1][0]))
    yield query, tree.order[node]


def _children(query: Ints, node: Ints, count: int) -> tuple[Ints, Ints]:
    query = np.repeat(query, _FAN)
    node = (node[:, None] * _FAN + np.arange(_FAN)).ravel()
    there = node < count
    return query[there], node[there]


# ---- the offset to a whole skeleton ---------------------------------------------------------


def offsets(skeleton: Skeleton, points: Array, limit: ArrayLike = np.inf) -> Array:
    """From the nearest place of the skeleton to each point (n, 3); 0 inside a solid. Where that is
    farther away than `limit`, some vector at least as long."""
    limits = np.broadcast_to(np.asarray(limit, dtype=np.float64), len(points))
    outside = np.flatnonzero(~inside(skeleton, points)) if is_solid(skeleton) else np.arange(len(points))
    result = np.zeros_like(points)
    if _scans(skeleton, len(outside)):
        for row in outside:
            result[row] = _nearest_by_scan(skeleton, points[row])
        return result
    few = simplex_count(skeleton) <= _FEW
    chunk = _PAIRS // (4 * _FEW)
    for start in range(0, len(outside), chunk):
        rows = outside[start : start + chunk]
        part = points[rows]
        result[rows] = _nearest_in_all(skeleton, part) if few else _nearest_in_tree(skeleton, part, limits[rows])
    return result


def _nearest_in_all(skeleton: Skeleton, points: Array) -> Array:
    candidates = offset_to_simplices(points[:, None, :], simplices(skeleton)[None])
    best = np.argmin(_dot(candidates, candidates), axis=1)
    return candidates[np.arange(len(points)), best]


def _nearest_in_tree(skeleton: Skeleton, points: Array, limit: Array) -> Array:
    """A greedy descent finds some simplex and with it a bound, the walk all that could be nearer."""
    tree, corners = tree_of(skeleton), simplices(skeleton)
    item = tree.order[_greedy(tree, points)]
    best = offset_to_simplices(points, corners[item])
    bound = np.minimum(_dot(best, best) * (1.0 + 1e-12), limit**2)
    for query, items in pairs(tree, points, points, lambda query, gap2, _reach: gap2 <= bound[query]):
        if not len(query):
            continue
        found = offset_to_simplices(points[query], corners[items])
        order = np.lexsort((_dot(found, found), query))
        winners = order[np.flatnonzero(np.diff(query[order], prepend=-1))]
        best[query[winners]] = found[winners]
    return best


@lru_cache(maxsize=16)
def _asked(_skeleton: Skeleton) -> count[int]:
    """Counts the questions that scans have answered."""
    return count()


def _scans(skeleton: Skeleton, questions: int) -> bool:
    """Is this one of the first few questions to very many simplices?"""
    if simplex_count(skeleton) <= _SCANNED or questions > _SCANS:
        return False
    return all(next(_asked(skeleton)) < _SCANS for _ in range(questions))


def _nearest_by_scan(skeleton: Skeleton, point: Array) -> Array:
    """The shortest offset, looked for only where the box of a simplex is nearer than the shortest so far."""
    best, least = np.full(3, np.inf), np.inf
    for corners in _by_parts(skeleton):
        gap2 = box_gap2(point, point, corners.min(axis=1), corners.max(axis=1))
        near = corners[gap2 <= least]
        if len(near):
            found = offset_to_simplices(point, near)
            length = _dot(found, found)
            first = int(np.argmin(length))
            if length[first] < least:
                best, least = found[first], float(length[first]) * (1.0 + 1e-12)
    return best


def _greedy(tree: Tree, points: Array) -> Ints:
    """Index along the curve of an item near to each point: the nearest box on each level."""
    node = np.zeros(len(points), dtype=np.int64)
    rows = np.arange(len(points))
    for depth in range(len(tree.levels) - 1, -1, -1):
        lo, hi, _ = tree.levels[depth]
        below = np.minimum(node[:, None] * _FAN + np.arange(_FAN), len(lo) - 1)
        gap2 = box_gap2(points[:, None], points[:, None], lo[below], hi[below])
        node = below[rows, np.argmin(gap2, axis=1)]
    return node


# ---- inside a solid ---------------------------------------------------------------------------


def inside(skeleton: Skeleton, points: Array) -> NDArray[np.bool_]:
    """Winding number above 0, counted along the ray towards +x: each face that it leaves through
    adds 1, each that it enters through takes 1 away. A closed surface has no gap for the ray to
    slip through, since the two faces at an edge decide by the same numbers (`_turns`)."""
    lo, hi = box(skeleton)
    candidates = np.flatnonzero(np.all((points >= lo) & (points <= hi), axis=1))
    origin = points[candidates]
    end = np.column_stack([np.full(len(origin), hi[0]), origin[:, 1:]])
    result = np.zeros(len(points), dtype=np.bool_)
    result[candidates] = _winding(skeleton, origin, end) > 0.5
    return result


def _winding(skeleton: Skeleton, origin: Array, end: Array) -> Array:
    """How often the rays from the origins to the ends leave through triangles, less how often they enter."""
    if _scans(skeleton, len(origin)):
        return np.array([_winding_by_scan(skeleton, p, q) for p, q in zip(origin, end, strict=True)])
    number, corners = np.zeros(len(origin)), simplices(skeleton)
    for query, item in pairs(tree_of(skeleton), origin, end, lambda _q, gap2, _reach: gap2 == 0.0):
        number += np.bincount(query, _crossings(origin[query], corners[item]), len(origin))
    return number


def _winding_by_scan(skeleton: Skeleton, origin: Array, end: Array) -> float:
    number = 0.0
    for corners in _by_parts(skeleton):
        near = corners[box_gap2(origin, end, corners.min(axis=1), corners.max(axis=1)) == 0.0]
        number += float(_crossings(np.broadcast_to(origin, (len(near), 3)), near).sum())
    return number


def _crossings(p: Array, corners: Array) -> Array:
    """+1, -1 or 0: the ray from p towards +x leaves through the triangle, enters, or misses it."""
    a, b, c = (corners[:, k] for k in range(3))
    turns = sum(_turns(p, first, second) for first, second in ((a, b), (b, c), (c, a)))
    ahead = turns * _dot(np.cross(b - a, c - a), a - p) > 0.0
    return np.where(ahead, turns, 0.0)


def _turns(p: Array, first: Array, second: Array) -> Array:
    """The edge's part in the winding number of its triangle about p, seen along x: +1 if it passes
    upwards on the one side, -1 downwards. Computed from the lower end, whichever way the edge runs."""
    upwards = (first[:, 1] <= p[:, 1]) & (second[:, 1] > p[:, 1])
    downwards = (second[:, 1] <= p[:, 1]) & (first[:, 1] > p[:, 1])
    low, high = np.where(upwards[:, None], first, second), np.where(upwards[:, None], second, first)
    side = (high[:, 1] - low[:, 1]) * (p[:, 2] - low[:, 2]) - (high[:, 2] - low[:, 2]) * (p[:, 1] - low[:, 1])
    return np.where(side > 0.0, upwards.astype(np.float64) - downwards, 0.0)
