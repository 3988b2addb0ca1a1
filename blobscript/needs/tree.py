"""Fields without some of their elements, kept in the canonical form of the IR."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blobscript import ir

__all__ = ["NOTHING", "kept", "mapped", "rows"]

Mask = NDArray[np.bool_]

#: The field that is 0 everywhere.
NOTHING = ir.Node("sum", ())


def rows(leaf: ir.Leaf, pick: NDArray[np.intp] | Mask) -> ir.Leaf:
    """Some of the blobs of a leaf; at least one."""
    skeleton = leaf.skeleton
    match skeleton:
        case ir.Points(at):
            skeleton = ir.Points(np.ascontiguousarray(at[pick]))
        case ir.Lines(a, b):
            skeleton = ir.Lines(np.ascontiguousarray(a[pick]), np.ascontiguousarray(b[pick]))
        case _:
            pass
    parts = {name: np.ascontiguousarray(getattr(leaf, name)[pick]) for name in ("reach", "weight", "paint", "origin")}
    return replace(leaf, skeleton=skeleton, **parts)


def kept(field: ir.Field, masks: list[Mask]) -> ir.Field:
    """The field with those blobs alone whose mask is set, one mask for each of `leaves(field)`."""
    left = iter(masks)

    def pick(leaf: ir.Leaf) -> ir.Field:
        mask = next(left)
        return leaf if mask.all() else rows(leaf, mask) if mask.any() else NOTHING

    return mapped(field, pick)


def mapped(field: ir.Field, change: Callable[[ir.Leaf], ir.Field]) -> ir.Field:
    """The tree with each leaf replaced, without what then stands for nothing: zeros in sums, nodes of one child, a
    node directly below one of its kind. Nothing is copied where nothing changes."""
    if isinstance(field, ir.Leaf):
        return change(field)
    children = [mapped(child, change) for child in field.children]
    if all(new is old for new, old in zip(children, field.children, strict=True)):
        return field
    return joined(field.op, children)


def joined(op: str, children: list[ir.Field]) -> ir.Field:
    """A node in canonical form."""
    flat: list[ir.Field] = []
    for child in children:
        if isinstance(child, ir.Node) and child.op == op in ("sum", "max", "min") and child.children:
            flat += child.children
        elif not (op == "sum" and isinstance(child, ir.Node) and not child.children):
            flat.append(child)
    if op in ("max", "min", "smooth_max") and any(map(_is_nothing, flat)):
        others = [c for c in flat if not _is_nothing(c)]
        if others and all(map(ir.never_below, others)):
            flat = [] if op == "min" else others  # 0 is the least there is
    if op != "sum":
        flat = [c for i, c in enumerate(flat) if not _is_nothing(c) or not any(map(_is_nothing, flat[:i]))]
    if len(flat) == 1:
        cut = ir.cut_off(op, flat[0])
        return flat[0] if cut is None else joined(cut, [flat[0], NOTHING])
    return ir.Node(op, tuple(flat)) if flat else NOTHING  # pyright: ignore[reportArgumentType]


def _is_nothing(field: ir.Field) -> bool:
    return isinstance(field, ir.Node) and not field.children
