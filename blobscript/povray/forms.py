"""Which object of POV-Ray means the same as a field and its threshold.

Skin      all that lies within a distance of a skeleton, from spheres, cylinders and triangles: a blob alone, of
          any falling kernel, since w D(d / R) >= T says d <= R D^-1(T / w)
Blob      POV-Ray's own: points and lines of the kernel soft2, summed
Joined    the union (max) or intersection (min) of such: max(f, g) >= T where f >= T or g >= T
Iso       everything else: isosurfaces of functions, see `cells`
Nothing   proved empty
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blobscript import ir, kernels
from blobscript.ir import Field, Leaf, Lines, Node, Points

__all__ = ["Blob", "Form", "Iso", "Joined", "Nothing", "Skin", "form_of", "leaves"]


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    leaf: Leaf
    radius: float


@dataclass(frozen=True, slots=True, eq=False)
class Blob:
    """`negated`: for thresholds below zero, all signs are turned: the surface stays where it is."""

    leaves: tuple[Leaf, ...]
    threshold: float
    negated: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """op "max": union, "min": intersection."""

    op: str
    parts: tuple[Form, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Iso:
    field: Field
    threshold: float


@dataclass(frozen=True, slots=True)
class Nothing:
    pass


Form = Skin | Blob | Joined | Iso | Nothing


def form_of(field: Field, threshold: float) -> Form:
    """The best form that means exactly {field >= threshold} (its boundary, where the threshold is negative)."""
    if threshold <= 0:
        summands = _blob_leaves(field) if threshold < 0 else None
        return Blob(summands, -threshold, True) if summands else Iso(field, threshold)
    match field:
        case Leaf() if field.count == 1 and _falls(field):
            return _skin(field, threshold)
        case Node("max", children):
            return _joined("max", [form_of(child, threshold) for child in children])
        case Node("min", children):
            return _intersection(field, [form_of(child, threshold) for child in children], threshold)
        case _:
            summands = _blob_leaves(field)
            return Blob(summands, threshold) if summands else Iso(field, threshold)


def leaves(field: Field) -> list[Leaf]:
    """Those that are not empty."""
    return [leaf for leaf in ir.leaves(field) if leaf.count]


def _falls(leaf: Leaf) -> bool:
    return leaf.weight[0] > 0 and leaf.kernel.falls


def _skin(leaf: Leaf, threshold: float) -> Form:
    level = threshold / float(leaf.weight[0])
    if level >= 1.0:
        return Nothing()
    radius = float(kernels.inverse(leaf.kernel, np.array([level]))[0]) * float(leaf.reach[0])
    return Skin(leaf, radius) if np.isfinite(radius) and radius > 0 else Iso(leaf, threshold)


def _blob_leaves(field: Field) -> tuple[Leaf, ...] | None:
    """The leaves of a sum that POV-Ray's blob can take; None for others."""
    if isinstance(field, Node) and field.op != "sum":
        return None
    found = leaves(field)
    flat = isinstance(field, Leaf) or all(isinstance(child, Leaf) for child in field.children)
    fit = all(leaf.kernel.name == "soft2" and not leaf.kernel.pieces for leaf in found)
    if not found or not flat or not fit or not all(isinstance(leaf.skeleton, Points | Lines) for leaf in found):
        return None
    return tuple(found)


def _joined(op: str, parts: list[Form]) -> Form:
    """Unions of unions are one."""
    flat: list[Form] = []
    for part in parts:
        flat += part.parts if isinstance(part, Joined) and part.op == op else [part]
    shown = [part for part in flat if not isinstance(part, Nothing)]
    if not shown:
        return Nothing()
    return shown[0] if len(shown) == 1 else Joined(op, tuple(shown))


def _intersection(field: Node, parts: list[Form], threshold: float) -> Form:
    """Of solids; the others are one isosurface of the minimum."""
    if any(isinstance(part, Nothing) for part in parts):
        return Nothing()
    if parts and all(map(_is_solid, parts)):
        return parts[0] if len(parts) == 1 else Joined("min", tuple(parts))
    return Iso(field, threshold)


def _is_solid(form: Form) -> bool:
    """Does POV-Ray know what is inside?"""
    match form:
        case Blob():
            return True
        case Skin(leaf):
            return isinstance(leaf.skeleton, Points | Lines)
        case Joined(_, parts):
            return all(map(_is_solid, parts))
        case _:
            return False
