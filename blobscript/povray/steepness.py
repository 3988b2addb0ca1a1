"""How steep a field can be over boxes: the proved `max_gradient` of an isosurface.

The density of an element is w D(s), s = |v|^2 / R^2, with the offset v from the nearest place of its skeleton; its
gradient is w D_s(s) 2 / R^2 v. Over a box, D_s lies between the values that `kernels.slope_range` gives, and v
between v at the middle give or take the half diagonal: the offset from a convex set has Lipschitz constant 1 (for a
point it is known exactly, axis by axis). The product encloses the gradient as a vector, and sums of vectors show
what cancels, which no sum of Lipschitz constants does: those are 40 times too large for 100 points that overlap.
A field that is not one smooth piece (several simplices, max, min) has the gradient of one of those that can win.
"""

from __future__ import annotations

from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from blobscript import field, geometry, kernels
from blobscript.ir import Field, Leaf, Lines, Node, Points
from blobscript.joints import SHARPNESS, STEEPER, smooth_max_range
from blobscript.povray.text import Array

__all__ = ["felt_distance", "gradient_enclosure", "proved_gradient", "sampled_gradient", "steepness"]

Ints = NDArray[np.int64]
Vectors = tuple[Array, Array]  # lowest and highest, (m, 3)

#: Of all that is computed here; some thousand roundings would be needed to use it up.
_SLACK = 1.0 + 1e-11
#: Boxes that a search for the steepest place may hold, and its rounds of halving.
_MOST_BOXES = 4096
_ROUNDS = 40
#: A density that grows lowers the smooth maximum by at most this much.
_FALL = ((SHARPNESS - 1) / SHARPNESS) ** (SHARPNESS - 1)


def steepness(tree: Field, lo: Array, hi: Array) -> Array:
    """Bounds (m,) on the length of the gradient over boxes lo, hi (m, 3)."""
    low, high = gradient_enclosure(tree, lo, hi)
    with np.errstate(over="ignore"):
        return np.sqrt(np.sum(np.maximum(np.abs(low), np.abs(high)) ** 2, axis=1)) * _SLACK


def gradient_enclosure(tree: Field, lo: Array, hi: Array) -> Vectors:
    """The gradient over boxes lies between these two (m, 3), axis by axis."""
    match tree:
        case Leaf():
            return _of_leaf(tree, lo, hi)
        case Node("sum", children):
            parts = [gradient_enclosure(child, lo, hi) for child in children]
            nothing = np.zeros(lo.shape)
            return sum((p[0] for p in parts), nothing), sum((p[1] for p in parts), nothing)
        case Node("smooth_max" | "smooth_min", children):
            return _of_joint(tree.op, children, lo, hi)
        case Node(op, children):
            return _of_winners(op, children, lo, hi)
        case _:
            assert_never(tree)


def _of_winners(op: str, children: tuple[Field, ...], lo: Array, hi: Array) -> Vectors:
    """Hull over the children that can be the largest (smallest) somewhere in the box."""
    if not children:
        return np.zeros(lo.shape), np.zeros(lo.shape)
    values = [field.bounds(child, lo, hi) for child in children]
    if op == "max":
        best = np.max([low for low, _ in values], axis=0)
        may_win = [high >= best for _, high in values]
    else:
        best = np.min([high for _, high in values], axis=0)
        may_win = [low <= best for low, _ in values]
    low, high = np.full(lo.shape, np.inf), np.full(lo.shape, -np.inf)
    for child, here in zip(children, may_win, strict=True):
        rows = np.flatnonzero(here)
        child_low, child_high = gradient_enclosure(child, lo[rows], hi[rows])
        low[rows] = np.minimum(low[rows], child_low)
        high[rows] = np.maximum(high[rows], child_high)
    return low, high


def _of_joint(op: str, children: tuple[Field, ...], lo: Array, hi: Array) -> Vectors:
    """The sum of the children's gradients times dL/df_i = w_i (1 + m (1 - L / f_i)), see `joints`: with the powers of
    the highest and lowest densities the weight w_i lies between two others, and L between its own bounds."""
    low, high = np.zeros(lo.shape), np.zeros(lo.shape)
    if not children:
        return low, high
    values = [field.bounds(child, lo, hi) for child in children]
    if op == "smooth_min":
        values = [(-upper, -lower) for lower, upper in values]
    least, most = (np.maximum(np.stack(ends), 0.0) for ends in zip(*values, strict=True))
    for child, (lower, upper) in zip(children, _rates(least, most), strict=True):
        child_low, child_high = gradient_enclosure(child, lo, hi)
        ends = np.stack([rate[:, None] * g for rate in (lower, upper) for g in (child_low, child_high)])
        low, high = low + ends.min(axis=0), high + ends.max(axis=0)
    return low, high


def _rates(least: Array, most: Array) -> list[Vectors]:
    """Bounds on dL/df_i for densities in [least, most], (k, n) each."""
    top = np.maximum(most.max(axis=0), 1e-300)
    small, large = (least / top) ** SHARPNESS, (most / top) ** SHARPNESS
    mean_low, mean_high = smooth_max_range(least, most)
    rates: list[Vectors] = []
    for i in range(len(least)):
        weight = large[i] / np.maximum(large[i] + small.sum(axis=0) - small[i], 1e-300)
        weight = np.where(large[i] > 0.0, np.minimum(weight * _SLACK, 1.0), 0.0)
        rise = 1.0 + SHARPNESS * np.maximum(1.0 - mean_low / np.maximum(most[i], 1e-300), 0.0)
        fall = np.where(least[i] > 0.0, mean_high / np.maximum(least[i], 1e-300) - 1.0, np.inf)
        with np.errstate(invalid="ignore"):
            lower = np.minimum(weight * (1.0 - SHARPNESS * np.maximum(fall, 0.0)), 0.0)
        rates.append((np.maximum(np.nan_to_num(lower, nan=0.0), -_FALL), np.minimum(weight * rise, STEEPER) * _SLACK))
    return rates


# ---- leaves ----------------------------------------------------------------------------------


class _Boxes:
    """Boxes in the space of a leaf's skeleton: middles (m, 3), half sides (m, 3), half diagonals (m,)."""

    def __init__(self, leaf: Leaf, lo: Array, hi: Array) -> None:
        middle, half = 0.5 * lo + 0.5 * hi, (0.5 * hi - 0.5 * lo) * _SLACK
        if leaf.matrix is not None:
            middle = middle @ leaf.matrix[:, :3].T + leaf.matrix[:, 3]
            half = half @ np.abs(leaf.matrix[:, :3]).T
        self.middle = middle
        self.half = half + 1e-14 * np.abs(middle)
        self.radius = np.sqrt(np.sum(self.half**2, axis=1))


def felt_distance(leaf: Leaf) -> Array:
    """How far each element is felt at all: its reach; for Gaussians where all together are below rounding."""
    return leaf.reach * kernels.cut(leaf.kernel, 1e-18 / max(leaf.count, 1))


def _of_leaf(leaf: Leaf, lo: Array, hi: Array) -> Vectors:
    low, high = np.zeros(lo.shape), np.zeros(lo.shape)
    if leaf.count == 0 or len(lo) == 0:
        return low, high
    boxes = _Boxes(leaf, lo, hi)
    if isinstance(leaf.skeleton, Points | Lines):
        low, high = _added(leaf, boxes, len(lo))
    else:
        low, high = _hull(leaf, boxes, len(lo))
    if leaf.matrix is None:
        return low, high
    back = leaf.matrix[:, :3]  # gradients are pulled back by the transpose
    middle, half = (0.5 * low + 0.5 * high) @ back, (0.5 * high - 0.5 * low) @ np.abs(back)
    return middle - half * _SLACK, middle + half * _SLACK


def _added(leaf: Leaf, boxes: _Boxes, count: int) -> Vectors:
    """Elements that are summed."""
    corners = geometry.simplices(leaf.skeleton)
    felt = felt_distance(leaf)
    tree = geometry.build_tree(corners, felt)
    low, high = np.zeros((count, 3)), np.zeros((count, 3))
    lo, hi = boxes.middle - boxes.half, boxes.middle + boxes.half
    for query, element in geometry.pairs(tree, lo, hi, lambda _q, gap2, reach: gap2 <= reach**2):
        room = boxes.half[query] if isinstance(leaf.skeleton, Points) else boxes.radius[query, None]
        part = _of_elements(leaf, corners, element, boxes, query, element, np.broadcast_to(room, (len(query), 3)))
        for axis in range(3):
            low[:, axis] += np.bincount(query, part[0][:, axis], count)
            high[:, axis] += np.bincount(query, part[1][:, axis], count)
    return low, high


def _hull(leaf: Leaf, boxes: _Boxes, count: int) -> Vectors:
    """The nearest simplex counts: any of those that can be nearest somewhere in the box."""
    corners = geometry.simplices(leaf.skeleton)
    best = np.full(count, float(felt_distance(leaf)[0]))
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    unsigned = np.sqrt(np.sum(_nearest(leaf, boxes.middle) ** 2, axis=1))
    best = np.minimum(best, unsigned + boxes.radius) * _SLACK
    lo, hi = boxes.middle - boxes.half, boxes.middle + boxes.half
    for query, item in geometry.pairs(
        geometry.tree_of(leaf.skeleton), lo, hi, lambda q, gap2, _reach: gap2 <= best[q] ** 2
    ):
        room = np.broadcast_to(boxes.radius[query, None], (len(query), 3))
        part = _of_elements(leaf, corners, item, boxes, query, np.zeros_like(item), room)
        np.minimum.at(low, query, part[0])
        np.maximum.at(high, query, part[1])
    nothing = ~np.isfinite(low[:, 0])
    low[nothing], high[nothing] = 0.0, 0.0
    beyond = unsigned + boxes.radius >= felt_distance(leaf)[0]
    if geometry.is_solid(leaf.skeleton):
        beyond |= np.True_
    return np.where(beyond[:, None], np.minimum(low, 0.0), low), np.where(beyond[:, None], np.maximum(high, 0.0), high)


def _nearest(leaf: Leaf, points: Array) -> Array:
    """Offsets from the skeleton's simplices, inside of a solid, too."""
    corners = geometry.simplices(leaf.skeleton)
    result = np.empty_like(points)
    step = max(1, 500_000 // len(corners))
    for start in range(0, len(points), step):
        part = points[start : start + step]
        candidates = geometry.offset_to_simplices(part[:, None, :], corners[None])
        best = np.argmin(np.einsum("ijk,ijk->ij", candidates, candidates), axis=1)
        result[start : start + step] = candidates[np.arange(len(part)), best]
    return result


def _of_elements(
    leaf: Leaf, corners: Array, simplex: Ints, boxes: _Boxes, query: Ints, element: Ints, room: Array
) -> Vectors:
    """Gradients in skeleton space of pairs of boxes (`query`) and simplices: v and D_s, multiplied."""
    v = geometry.offset_to_simplices(boxes.middle[query], corners[simplex])
    low, high = v - room, v + room
    nearest = np.maximum(np.maximum(low, -high), 0.0)
    farthest = np.maximum(np.abs(low), np.abs(high))
    distance = np.sqrt(np.sum(v * v, axis=1))
    least = np.maximum(np.sqrt(np.sum(nearest**2, axis=1)), distance - boxes.radius[query])
    most = np.minimum(np.sqrt(np.sum(farthest**2, axis=1)), distance + boxes.radius[query])
    reach, weight = leaf.reach[element], leaf.weight[element]
    s_lo, s_hi = (np.maximum(least, 0.0) / reach / _SLACK) ** 2, (most / reach * _SLACK) ** 2
    steep, flat = kernels.slope_range(leaf.kernel, s_lo, s_hi)
    largest = np.abs(weight) * kernels.lipschitz(leaf.kernel) / reach * _SLACK
    with np.errstate(invalid="ignore", over="ignore"):
        factors = np.stack([steep, flat]) * (2.0 * weight / reach**2)
        ends = np.stack([f[:, None] * x for f in factors for x in (low, high)])
    ends = np.where(np.isnan(ends), 0.0, ends)  # 0 times infinity; the other ends are infinite
    return (
        np.maximum(ends.min(axis=0), -largest[:, None]),
        np.minimum(ends.max(axis=0), largest[:, None]),
    )


# ---- the steepest place ------------------------------------------------------------------------


def proved_gradient(tree: Field, lo: Array, hi: Array, excess: float = 1.1) -> float:
    """A proved bound on the gradient over one box, halved where it is steepest until the bound is at most
    `excess` times what is seen, or the work runs out."""
    boxes = lo[None].astype(np.float64), hi[None].astype(np.float64)
    settled, seen = 0.0, 0.0
    tops = steepness(tree, *boxes)
    for _ in range(_ROUNDS):
        seen = max(seen, float(_length(field.gradient(tree, 0.5 * boxes[0] + 0.5 * boxes[1])).max()))
        open_ = tops > max(excess * seen, settled)
        settled = max(settled, float(tops[~open_].max(initial=0.0)))
        if not open_.any() or np.count_nonzero(open_) > _MOST_BOXES:
            break
        boxes = _halved(boxes[0][open_], boxes[1][open_])
        tops = steepness(tree, *boxes)
    return max(settled, float(tops.max(initial=0.0)))


def sampled_gradient(tree: Field, lo: Array, hi: Array, count: int, seed: int = 0) -> float:
    """The steepest gradient at random places: a lower bound, to measure the proved one by."""
    points = np.random.default_rng(seed).uniform(lo, hi, (count, 3))
    return float(_length(field.gradient(tree, points)).max(initial=0.0))


def _halved(lo: Array, hi: Array) -> tuple[Array, Array]:
    rows, axis = np.arange(len(lo)), np.argmax(hi - lo, axis=1)
    middle = 0.5 * lo[rows, axis] + 0.5 * hi[rows, axis]
    left, right = hi.copy(), lo.copy()
    left[rows, axis], right[rows, axis] = middle, middle
    return np.concatenate([lo, right]), np.concatenate([left, hi])


def _length(vectors: Array) -> Array:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
