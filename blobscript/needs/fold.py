"""Identical blobs as one.

Under a sum, blobs at the same place with the same kernel, reach and paint act as one of their joint weight, and blobs
whose weights cancel are gone; bounds that look at terms one by one cannot see that +1e8 and -(1e8 - 1) nearly
cancel. Under max and min equal children count once. Where a surface is painted in several materials, only weights
of one sign are joined: what blends is the positive share of each.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.needs.tree import NOTHING, joined, rows

__all__ = ["folded"]


def folded(field: ir.Field, painted: bool) -> ir.Field:
    """The same field without repetitions; the same object where there are none."""
    if isinstance(field, ir.Leaf):
        return _leaf(field, painted)
    children = [folded(child, painted) for child in field.children]
    match field.op:
        case "sum":
            distinct = _summed(children, painted)
        case "max" | "min":
            distinct = _distinct(children)
        case "smooth_max" | "smooth_min":  # a mean: what stands there twice counts twice
            distinct = children
    same = len(distinct) == len(field.children)
    if same and all(new is old for new, old in zip(distinct, field.children, strict=True)):
        return field
    return joined(field.op, distinct)


# ---- within a leaf ---------------------------------------------------------------------------------


def _leaf(leaf: ir.Leaf, painted: bool) -> ir.Field:
    """Points and lines that repeat."""
    match leaf.skeleton:
        case ir.Points(at):
            places = at
        case ir.Lines(a, b):
            places = _either_way(a, b)
        case _:
            return leaf
    sign = np.sign(leaf.weight) if painted else np.zeros(leaf.count)
    keys = np.column_stack([places, leaf.reach, leaf.paint.astype(np.float64), sign])
    groups = _groups(keys)
    return leaf if groups is None else _joined_rows(leaf, groups)


def _either_way(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Both ends (n, 6), the lesser one first: a line is the same from either end."""
    first = (a != b).argmax(axis=1)[:, None]
    turned = np.take_along_axis(a, first, axis=1) > np.take_along_axis(b, first, axis=1)
    return np.concatenate([np.where(turned, b, a), np.where(turned, a, b)], axis=1)


def _groups(keys: NDArray[np.float64]) -> NDArray[np.intp] | None:
    """Which first row each row equals, (n,); None: all differ."""
    # one number per row finds most lists without repetitions by one sort
    mixed = np.zeros(len(keys))
    for k in range(keys.shape[1]):
        mixed += math.cos(k + 1.0) * keys[:, k]
    order = np.argsort(mixed, kind="stable")
    if len(order) < 2 or not (np.diff(mixed[order]) == 0.0).any():
        return None
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    found = first[which.reshape(-1)]
    return found if len(first) < len(keys) else None


def _joined_rows(leaf: ir.Leaf, first: NDArray[np.intp]) -> ir.Field:
    weight = np.zeros(leaf.count)
    order = np.argsort(first, kind="stable")
    starts = np.flatnonzero(np.diff(first[order], prepend=-1))
    for part in np.split(order, starts[1:]):
        weight[first[part[0]]] = math.fsum(leaf.weight[part].tolist())
    keep = (weight != 0.0) & np.isfinite(weight)
    if not np.isfinite(weight).all():
        return leaf  # too large for one number: as it was
    if not keep.any():
        return NOTHING
    picked = rows(leaf, keep)
    return _with_weight(picked, weight[keep])


def _with_weight(leaf: ir.Leaf, weight: NDArray[np.float64]) -> ir.Leaf:
    return ir.Leaf(leaf.skeleton, leaf.kernel, leaf.reach, weight, leaf.paint, leaf.origin, leaf.matrix)


# ---- among children --------------------------------------------------------------------------------


def _same_place(a: ir.Leaf, b: ir.Leaf) -> bool:
    """The same densities but for the weight."""
    return (
        a.kernel == b.kernel
        and type(a.skeleton) is type(b.skeleton)
        and _equal(a.matrix, b.matrix)
        and np.array_equal(a.reach, b.reach)
        and np.array_equal(a.paint, b.paint)
        and all(_equal(getattr(a.skeleton, name), getattr(b.skeleton, name)) for name in a.skeleton.__slots__)
    )


def _equal(a: object, b: object) -> bool:
    return a is b or (a is not None and b is not None and np.array_equal(a, b))  # pyright: ignore[reportArgumentType]


def _same(a: ir.Field, b: ir.Field) -> bool:
    if isinstance(a, ir.Leaf) and isinstance(b, ir.Leaf):
        return a is b or (_same_place(a, b) and np.array_equal(a.weight, b.weight))
    if isinstance(a, ir.Node) and isinstance(b, ir.Node) and a.op == b.op and len(a.children) == len(b.children):
        return all(_same(x, y) for x, y in zip(a.children, b.children, strict=True))
    return False


#: Children of a node beyond which they are not compared with each other.
_MOST_CHILDREN = 200


def _distinct(children: list[ir.Field]) -> list[ir.Field]:
    """Of max and min."""
    if len(children) > _MOST_CHILDREN:
        return children
    kept: list[ir.Field] = []
    for child in children:
        if not any(_same(child, other) for other in kept):
            kept.append(child)
    return kept


def _summed(children: list[ir.Field], painted: bool) -> list[ir.Field]:
    """Of a sum: leaves of plain points that share kernel and map become one leaf where they meet in a place, single
    skeletons that are equal one of their joint weight."""
    if len(children) > _MOST_CHILDREN:
        return children
    kept: list[ir.Field] = []
    for child in children:
        for i, other in enumerate(kept):
            joint = _joint(other, child, painted)
            if joint is not None:
                kept[i] = joint
                break
        else:
            kept.append(child)
    return kept


def _joint(a: ir.Field, b: ir.Field, painted: bool) -> ir.Field | None:
    """Two terms of a sum as one; None: they are two."""
    if not (isinstance(a, ir.Leaf) and isinstance(b, ir.Leaf)):
        return None
    if isinstance(a.skeleton, ir.Points | ir.Lines):
        return _joint_rows(a, b, painted)
    if not _same_place(a, b) or (painted and np.sign(a.weight[0]) != np.sign(b.weight[0])):
        return None
    weight = a.weight + b.weight
    if not np.isfinite(weight[0]):
        return None
    return _with_weight(a, weight) if weight[0] != 0.0 else NOTHING


def _joint_rows(a: ir.Leaf, b: ir.Leaf, painted: bool) -> ir.Field | None:
    """Points with points, lines with lines, of one kernel and map, where they repeat each other."""
    if a.kernel != b.kernel or not _equal(a.matrix, b.matrix):
        return None
    match a.skeleton, b.skeleton:
        case ir.Points(p), ir.Points(q):
            skeleton: ir.Skeleton = ir.Points(np.concatenate([p, q]))
        case ir.Lines(p, r), ir.Lines(q, t):
            skeleton = ir.Lines(np.concatenate([p, q]), np.concatenate([r, t]))
        case _:
            return None
    both = [np.concatenate([getattr(a, name), getattr(b, name)]) for name in ("reach", "weight", "paint", "origin")]
    whole = ir.Leaf(skeleton, a.kernel, both[0], both[1], both[2], both[3], a.matrix)
    joint = _leaf(whole, painted)
    return None if joint is whole else joint
