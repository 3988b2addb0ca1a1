"""The reference evaluator: density, gradient, bounds and paint of a field, in NumPy.

This is the specification of the C tracer, which is tested against it. Inside means
field >= threshold; the normal is -gradient / |gradient|. An element beyond its reach has density 0
and takes part in `max` and `min` as 0. Where `max` or `min` switch (a crease), the gradient is
that of the first of the winners.

With offset v = M p - q from the nearest place q of the skeleton, density is w D(s), s = |v|^2 /
reach^2, and its gradient w D'(s) 2 M^T v / reach^2, since q does not move to first order.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache, reduce
from typing import assert_never

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blobscript import geometry, kernels
from blobscript.ir import Field, Leaf, Lines, Material, Node, Points, Scene, Surface, leaves
from blobscript.joints import SmoothMax, smooth_max, smooth_max_range

__all__ = [
    "MATERIAL_ROW",
    "bounds",
    "extent",
    "field_value",
    "forget",
    "gradient",
    "level_extent",
    "material",
    "material_row",
    "value_and_gradient",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_EPS = float(np.finfo(np.float64).eps)
_CHUNK = 16384

# Places beyond this are taken for places there: as far from everything, but without overflow.
_FAR = 1e140

# A Gaussian is left out where its density is below this fraction of the smallest weight of its
# leaf (and of 1), divided by the number of elements: far below the rounding of any sum that matters.
_NOTHING = 1e-40

# ---- points in skeleton space, and the pairs of points and elements that matter --------------


def _mapped(leaf: Leaf, points: Array) -> Array:
    return points if leaf.matrix is None else points @ leaf.matrix[:, :3].T + leaf.matrix[:, 3]


def _pulled_back(leaf: Leaf, vectors: Array) -> Array:
    return vectors if leaf.matrix is None else vectors @ leaf.matrix[:, :3]


@lru_cache(maxsize=16)
def _effective_reach(leaf: Leaf) -> Array:
    """Distance from each element beyond which its density is left out."""
    if np.isfinite(kernels.support(leaf.kernel)):
        return leaf.reach
    weight = np.abs(leaf.weight)
    epsilon = _NOTHING * min(1.0, float(weight.min())) / leaf.count / weight
    return leaf.reach * np.sqrt(-np.log(np.maximum(epsilon, 1e-307)) / leaf.kernel.a)


@lru_cache(maxsize=16)
def _element_tree(leaf: Leaf) -> geometry.Tree:
    return geometry.build_tree(geometry.simplices(leaf.skeleton), _effective_reach(leaf))


def forget() -> None:
    """Drops the trees that are kept for fields that may be asked about again: some 60 bytes a point."""
    _effective_reach.cache_clear()
    _element_tree.cache_clear()
    geometry.forget()


def _is_many(leaf: Leaf) -> bool:
    """Points and lines are separate elements; the simplices of the others are one."""
    return isinstance(leaf.skeleton, Points | Lines)


def _offset_pairs(leaf: Leaf, points: Array) -> Iterator[tuple[Ints, Ints, Array]]:
    """(query, element, offset / reach) of all elements that may be felt at mapped points (n, 3).
    Offsets longer than numbers go are infinite."""
    if leaf.count == 0 or len(points) == 0:
        return
    if not _is_many(leaf):
        v = geometry.offsets(leaf.skeleton, points, _effective_reach(leaf)[0]) / leaf.reach[0]
        yield np.arange(len(points)), np.zeros(len(points), dtype=np.int64), v
        return
    corners = geometry.simplices(leaf.skeleton)
    tree = _element_tree(leaf)
    for query, element in geometry.pairs(tree, points, points, lambda _q, gap2, reach: gap2 <= reach**2):
        v = geometry.offset_to_simplices(points[query], corners[element]) / leaf.reach[element, None]
        yield query, element, v


def _densities(leaf: Leaf, points: Array) -> Iterator[tuple[Ints, Ints, Array]]:
    """(query, element, density) at scene points."""
    for query, element, v in _offset_pairs(leaf, _mapped(leaf, points)):
        yield query, element, leaf.weight[element] * kernels.value(leaf.kernel, np.einsum("ij,ij->i", v, v))


# ---- value and gradient --------------------------------------------------------------------------


@np.errstate(over="ignore", invalid="ignore")
def field_value(field: Field, points: ArrayLike) -> Array:
    """Combined density (n,) at points (n, 3)."""
    return np.concatenate([np.zeros(0), *(_value(field, part) for part in _chunks(points))])


def gradient(field: Field, points: ArrayLike) -> Array:
    """Gradient (n, 3) of the combined density at points (n, 3); that of the winner at creases."""
    return value_and_gradient(field, points)[1]


@np.errstate(over="ignore", invalid="ignore")
def value_and_gradient(field: Field, points: ArrayLike) -> tuple[Array, Array]:
    """Both at once: (n,) and (n, 3)."""
    parts = [_with_gradient(field, part) for part in _chunks(points)]
    values = np.concatenate([np.zeros(0), *(value for value, _ in parts)])
    return values, np.concatenate([np.zeros((0, 3)), *(slope for _, slope in parts)])


def _chunks(points: ArrayLike) -> Iterator[Array]:
    array = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
    for start in range(0, len(array), _CHUNK):
        yield np.clip(array[start : start + _CHUNK], -_FAR, _FAR)


def _value(field: Field, points: Array) -> Array:
    match field:
        case Leaf():
            total = np.zeros(len(points))
            for query, _, density in _densities(field, points):
                total += np.bincount(query, density, len(points))
            return total
        case Node(op, children):
            return _combine(op, [_value(child, points) for child in children], len(points))
        case _:
            assert_never(field)


def _combine(op: str, values: list[Array], count: int) -> Array:
    if not values:
        return np.zeros(count)
    match op:
        case "smooth_max":
            return smooth_max(np.stack(values)).value
        case "smooth_min":
            return -smooth_max(-np.stack(values)).value
        case _:
            return reduce({"sum": np.add, "max": np.maximum, "min": np.minimum}[op], values)


def _with_gradient(field: Field, points: Array) -> tuple[Array, Array]:
    match field:
        case Leaf():
            return _leaf_with_gradient(field, points)
        case Node(op, children):
            parts = [_with_gradient(child, points) for child in children]
            value = _combine(op, [v for v, _ in parts], len(points))
            if op == "sum" or not parts:
                return value, np.sum([np.zeros((len(points), 3)), *(g for _, g in parts)], axis=0)
            if op in _SMOOTH:
                return value, _mixed(_smooth(op, [v for v, _ in parts]).rates, [g for _, g in parts])
            return value, _of_winner(op, [v for v, _ in parts], [g for _, g in parts])
        case _:
            assert_never(field)


_SMOOTH = ("smooth_max", "smooth_min")


def _smooth(op: str, values: list[Array]) -> SmoothMax:
    """As if for smooth_max: shares and rates are the same where all signs change."""
    return smooth_max(np.stack(values) if op == "smooth_max" else -np.stack(values))


def _mixed(shares: Array, rows: list[Array]) -> Array:
    """Sum of share * row, (k, n) and k of (n, m) -> (n, m)."""
    return np.einsum("kn,knm->nm", shares, np.stack(rows))


def _of_winner(op: str, values: list[Array], rows: list[Array]) -> Array:
    """Row by row, that of the child with the largest (max) or smallest (min) value."""
    choose = np.argmax if op == "max" else np.argmin
    winner = choose(np.stack(values), axis=0)
    return np.stack(rows)[winner, np.arange(len(winner))]


def _leaf_with_gradient(leaf: Leaf, points: Array) -> tuple[Array, Array]:
    total, slope = np.zeros(len(points)), np.zeros((len(points), 3))
    for query, element, v in _offset_pairs(leaf, _mapped(leaf, points)):
        s = np.einsum("ij,ij->i", v, v)
        weight = leaf.weight[element]
        total += np.bincount(query, weight * kernels.value(leaf.kernel, s), len(points))
        # a crease at the skeleton has an infinite slope there, but no direction
        v = np.where(s[:, None] < np.inf, v, 0.0)
        factor = np.where(s > 0.0, kernels.slope(leaf.kernel, s), 0.0) * 2.0 * weight / leaf.reach[element]
        for axis in range(3):
            slope[:, axis] += np.bincount(query, factor * v[:, axis], len(points))
    return total, _pulled_back(leaf, slope)


# ---- bounds over boxes ------------------------------------------------------------------------


@np.errstate(over="ignore", invalid="ignore")
def bounds(field: Field, lo: ArrayLike, hi: ArrayLike) -> tuple[Array, Array]:
    """An enclosure of the field over the boxes lo, hi (m, 3): proved, rounding included."""
    lows, highs = [np.zeros(0)], [np.zeros(0)]
    for part_lo, part_hi in zip(_chunks(lo), _chunks(hi), strict=True):
        low, high = _bounds(field, part_lo, part_hi)
        lows.append(low)
        highs.append(high)
    return np.concatenate(lows), np.concatenate(highs)


def _bounds(field: Field, lo: Array, hi: Array) -> tuple[Array, Array]:
    match field:
        case Leaf():
            return _leaf_bounds(field, lo, hi)
        case Node(op, children):
            parts = [_bounds(child, lo, hi) for child in children]
            if op in _SMOOTH and parts:
                return _smooth_bounds(op, np.stack([part[0] for part in parts]), np.stack([part[1] for part in parts]))
            low = _combine(op, [part[0] for part in parts], len(lo))
            high = _combine(op, [part[1] for part in parts], len(lo))
            slack = np.zeros(len(lo))
            if op == "sum":
                slack = len(parts) * _EPS * _combine("sum", [np.maximum(abs(a), abs(b)) for a, b in parts], len(lo))
            return low - slack, high + slack
        case _:
            assert_never(field)


def _smooth_bounds(op: str, low: Array, high: Array) -> tuple[Array, Array]:
    if op == "smooth_max":
        return smooth_max_range(low, high)
    least, most = smooth_max_range(-high, -low)
    return -most, -least


def _leaf_bounds(leaf: Leaf, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Every element's density over its range of distances, summed, widened by the sum's rounding."""
    low, high, size, terms = (np.zeros(len(lo)) for _ in range(4))
    if leaf.count == 0:
        return low, high
    box_lo, box_hi, corners = _mapped_box(leaf, lo, hi)
    for query, element, d_min, d_max in _distance_ranges(leaf, box_lo, box_hi, corners):
        reach = leaf.reach[element]
        s_min, s_max = (d_min / reach) ** 2 * (1.0 - 4.0 * _EPS), (d_max / reach) ** 2 * (1.0 + 4.0 * _EPS)
        d_lo, d_hi = kernels.value_range(leaf.kernel, s_min, s_max)
        weight = leaf.weight[element]
        ends = np.stack([weight * d_lo, weight * d_hi])
        low += np.bincount(query, ends.min(axis=0), len(lo))
        high += np.bincount(query, ends.max(axis=0), len(lo))
        size += np.bincount(query, np.abs(ends).max(axis=0), len(lo))
        terms += np.bincount(query, minlength=len(lo))
    slack = (terms + 2.0) * _EPS * size + _left_out(leaf)
    return low - slack, high + slack


def _left_out(leaf: Leaf) -> float:
    """What the cut Gaussians of a leaf can add up to."""
    return 0.0 if np.isfinite(kernels.support(leaf.kernel)) else _NOTHING * min(1.0, float(np.min(np.abs(leaf.weight))))


def _mapped_box(leaf: Leaf, lo: Array, hi: Array) -> tuple[Array, Array, Array]:
    """Image of boxes in skeleton space: a box around it, and its eight corners (m, 8, 3)."""
    pick = np.array([[(k >> axis) & 1 for axis in range(3)] for k in range(8)], dtype=bool)
    corners = np.where(pick[None], hi[:, None, :], lo[:, None, :])
    if leaf.matrix is None:
        return lo, hi, corners
    matrix = leaf.matrix
    rounding = 8.0 * _EPS * (np.abs(corners).max(axis=1) @ np.abs(matrix[:, :3]).T + np.abs(matrix[:, 3]))
    image = corners @ matrix[:, :3].T + matrix[:, 3]
    return image.min(axis=1) - rounding, image.max(axis=1) + rounding, image


def _distance_ranges(leaf: Leaf, lo: Array, hi: Array, corners: Array) -> Iterator[tuple[Ints, Ints, Array, Array]]:
    """(query, element, least distance, greatest distance) over boxes, for all elements within reach."""
    if not _is_many(leaf):
        query = np.arange(len(lo))
        yield query, np.zeros(len(lo), dtype=np.int64), *_lipschitz_range(leaf, lo, hi, corners)
        return
    tree = _element_tree(leaf)
    ranges = _point_range if isinstance(leaf.skeleton, Points) else _line_range
    for query, element in geometry.pairs(tree, lo, hi, lambda _q, gap2, reach: gap2 <= reach**2):
        simplices = geometry.simplices(leaf.skeleton)[element]
        yield query, element, *ranges(lo[query], hi[query], corners[query], simplices)


def _point_range(lo: Array, hi: Array, _corners: Array, simplices: Array) -> tuple[Array, Array]:
    """Exact but for the last bits."""
    at = simplices[:, 0]
    far = np.maximum(np.abs(at - lo), np.abs(at - hi))
    least, greatest = np.sqrt(geometry.box_gap2(lo, hi, at, at)), np.sqrt(np.einsum("ij,ij->i", far, far))
    return least * (1.0 - 4.0 * _EPS), greatest * (1.0 + 4.0 * _EPS)


def _line_range(lo: Array, hi: Array, corners: Array, simplices: Array) -> tuple[Array, Array]:
    """Distance to a segment is convex: greatest at a corner; least by its Lipschitz constant 1
    from the middle, and by the segment's box."""
    at_corners = _length(geometry.offset_to_simplices(corners, simplices[:, None]))
    middle = 0.5 * lo + 0.5 * hi
    half = 0.5 * _length(hi - lo)
    near = _length(geometry.offset_to_simplices(middle, simplices)) - half
    gap = np.sqrt(geometry.box_gap2(lo, hi, simplices.min(axis=1), simplices.max(axis=1)))
    slack = 64.0 * _EPS * (np.maximum(abs(lo), abs(hi)).max(axis=1) + np.abs(simplices).max(axis=(1, 2)))
    return np.maximum(np.maximum(near, gap) - slack, 0.0), at_corners.max(axis=1) + slack


def _lipschitz_range(leaf: Leaf, lo: Array, hi: Array, corners: Array) -> tuple[Array, Array]:
    """Distance to any set has Lipschitz constant 1: that at the middle, give or take half the box."""
    middle = 0.5 * lo + 0.5 * hi
    half = _length(corners - middle[:, None]).max(axis=1)
    at_middle = _length(geometry.offsets(leaf.skeleton, middle, _effective_reach(leaf)[0] + half))
    box_lo, box_hi = geometry.box(leaf.skeleton)
    gap = np.zeros(len(lo))
    if not geometry.is_solid(leaf.skeleton):
        gap = np.sqrt(geometry.box_gap2(lo, hi, box_lo, box_hi))
    slack = 64.0 * _EPS * (np.maximum(abs(lo), abs(hi)).max(axis=1) + max(-box_lo.min(), box_hi.max()))
    return np.maximum(np.maximum(at_middle - half, gap) - slack, 0.0), at_middle + half + slack


def _length(vectors: Array) -> Array:
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))


# ---- where a field is ------------------------------------------------------------------------------


def extent(field: Field) -> tuple[Array, Array]:
    """A box outside which all densities are 0 (Gaussians: below 2^-53 of their weight, all
    together). Zeros for a field without elements."""
    cuts = [
        (leaf, kernels.cut(leaf.kernel, 2.0**-53 / leaf.count) * leaf.reach) for leaf in leaves(field) if leaf.count
    ]
    boxes = [_leaf_extent(leaf, cut) for leaf, cut in cuts]
    if not boxes:
        return np.zeros(3), np.zeros(3)
    return np.min([lo for lo, _ in boxes], axis=0), np.max([hi for _, hi in boxes], axis=0)


def level_extent(leaf: Leaf, threshold: float) -> tuple[Array, Array]:
    """A box around all places where a single blob, which must fall with the distance, reaches a threshold above 0:
    as tight as the skeleton's own box, but for rounding."""
    # the kernel's own rounding, and that of its inverse
    level = threshold / float(leaf.weight[0]) * (1.0 - 1e-9) if leaf.weight[0] > 0.0 else np.inf
    radius = float(kernels.inverse(leaf.kernel, np.array(level))) * (1.0 + 1e-12)
    if not np.isfinite(radius):
        return extent(leaf)
    return _leaf_extent(leaf, radius * leaf.reach)


def _leaf_extent(leaf: Leaf, cut: Array) -> tuple[Array, Array]:
    """Around all places at most `cut` (n,) away from each blob's skeleton."""
    places, cuts = geometry.hull_points(leaf.skeleton), cut if _is_many(leaf) else cut[0]
    if leaf.matrix is None:
        grow = np.reshape(cuts, (-1, 1))
        return np.min([(p - grow).min(axis=0) for p in places], axis=0), np.max(
            [(p + grow).max(axis=0) for p in places], axis=0
        )
    back = np.linalg.inv(leaf.matrix[:, :3])
    # a ball maps to an ellipsoid, this is its box
    size = np.reshape(cuts, (-1, 1)) * np.sqrt(np.sum(back * back, axis=1))
    mapped = [(p - leaf.matrix[:, 3]) @ back.T for p in places]
    slack = 1e-12 * (max(float(np.abs(p).max()) for p in mapped) + size.max())
    lo, hi = [(p - size).min(axis=0) for p in mapped], [(p + size).max(axis=0) for p in mapped]
    return np.min(lo, axis=0) - slack, np.max(hi, axis=0) + slack


# ---- paint -----------------------------------------------------------------------------------------

#: Layout of a material row: name -> columns. ORDER material: as BLOB_MATERIAL in tracer/blob.h.
MATERIAL_ROW: dict[str, slice] = {
    "color": slice(0, 3),
    "roughness": slice(3, 4),
    "metalness": slice(4, 5),
    "specular": slice(5, 6),
    "transmission": slice(6, 7),
    "ior": slice(7, 8),
    "absorption": slice(8, 11),
    "emission": slice(11, 14),
    "reflection": slice(14, 15),
}


def material_row(material: Material) -> Array:
    """The numbers of a material, as in MATERIAL_ROW."""
    return np.concatenate([np.atleast_1d(getattr(material, name)) for name in MATERIAL_ROW]).astype(np.float64)


@np.errstate(over="ignore", invalid="ignore")
def material(surface: Surface, points: ArrayLike, scene: Scene) -> Array:
    """Blended material rows (n, 15) at points on the surface.

    The terms of a sum (its elements one by one, and its nodes) blend by positive contribution, the
    sum of max(0, v) m over the sum of max(0, v); a sum without any takes the term with the largest
    density among those that are felt there. max and min take the winner's, smooth_max blends by its shares.
    """
    rows = np.stack([material_row(m) for m in scene.materials])
    parts = [_Paint(part, rows, surface.material).resolved(surface.field)[1] for part in _chunks(points)]
    return np.concatenate([np.zeros((0, rows.shape[1])), *parts])


class _Paint:
    """One evaluation of the paint of a tree at some points."""

    def __init__(self, points: Array, rows: Array, own: int) -> None:
        self.points, self.rows, self.own = points, rows, own

    def resolved(self, field: Field) -> tuple[Array, Array]:
        """Value and material of a field on its own."""
        if isinstance(field, Node) and field.op != "sum" and field.children:
            parts = [self.resolved(child) for child in field.children]
            values = [value for value, _ in parts]
            if field.op in _SMOOTH:
                return self._joint(field.op, values, [rows for _, rows in parts])
            return _combine(field.op, values, len(self.points)), _of_winner(field.op, values, [m for _, m in parts])
        value, positive, mixed, _, largest = self.as_terms(field)
        blended = mixed / np.where(positive > 0.0, positive, 1.0)[:, None]
        return value, np.where((positive > 0.0)[:, None], blended, largest)

    def _joint(self, op: str, values: list[Array], rows: list[Array]) -> tuple[Array, Array]:
        """Materials blended by shares; where these are 0, that of the largest density which is felt there."""
        joint = _smooth(op, values)
        own = self._nothing()[4]
        felt = [np.full(len(self.points), -np.inf), *(np.where(v != 0.0, v, -np.inf) for v in values)]
        largest = _of_winner("max", felt, [own, *rows])
        mixed = np.where((joint.value > 0.0)[:, None], _mixed(joint.shares, rows), largest)
        return _combine(op, values, len(self.points)), mixed

    def as_terms(self, field: Field) -> tuple[Array, Array, Array, Array, Array]:
        """Of the terms of a sum: total, sum of max(0, v), sum of max(0, v) m, max v, its m."""
        match field:
            case Leaf():
                return self._elements(field)
            case Node("sum", children):
                return self._joined([self.as_terms(child) for child in children])
            case Node():
                value, rows = self.resolved(field)
                positive = np.maximum(value, 0.0)
                felt = np.where(value != 0.0, value, -np.inf)
                return value, positive, positive[:, None] * rows, felt, rows
            case _:
                assert_never(field)

    def _nothing(self) -> tuple[Array, Array, Array, Array, Array]:
        count = len(self.points)
        own = np.broadcast_to(self.rows[self.own], (count, self.rows.shape[1]))
        return np.zeros(count), np.zeros(count), np.zeros(own.shape), np.full(count, -np.inf), own.copy()

    def _joined(
        self, terms: list[tuple[Array, Array, Array, Array, Array]]
    ) -> tuple[Array, Array, Array, Array, Array]:
        value, positive, mixed, largest, rows = self._nothing()
        for term in terms:
            value, positive, mixed = value + term[0], positive + term[1], mixed + term[2]
            rows = np.where((term[3] > largest)[:, None], term[4], rows)
            largest = np.maximum(largest, term[3])
        return value, positive, mixed, largest, rows

    def _elements(self, leaf: Leaf) -> tuple[Array, Array, Array, Array, Array]:
        value, positive, mixed, largest, rows = self._nothing()
        paint = np.where(leaf.paint < 0, self.own, leaf.paint)
        for query, element, density in _densities(leaf, self.points):
            count = len(self.points)
            part = np.maximum(density, 0.0)
            value += np.bincount(query, density, count)
            positive += np.bincount(query, part, count)
            for column in range(self.rows.shape[1]):
                mixed[:, column] += np.bincount(query, part * self.rows[paint[element], column], count)
            order = np.lexsort((-np.where(density != 0.0, density, -np.inf), query))
            best = order[np.flatnonzero(np.diff(query[order], prepend=-1))]
            best = best[(density[best] != 0.0) & (density[best] > largest[query[best]])]
            largest[query[best]] = density[best]
            rows[query[best]] = self.rows[paint[element[best]]]
        return value, positive, mixed, largest, rows
