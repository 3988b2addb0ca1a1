"""How far a hit may be off in double precision: the conditioned error of a first hit.

A tracer that makes no mistake but rounding finds a zero of F + e with |e| <= E, so its distance differs
from the exact one by about E / |dF/dt|, and by the rounding of the position along the ray:

    E   = 8 eps (sum |w| (|D| + |D_s| s) + |T|) + 2 eps |o'| sum |w| |dD/dr| |M| / R
    tol = min(E / |F'|, 2 sqrt(2 E / |F''|)) + 4 eps (|o| + t)

An error of one `tol` or less is backward stable: no better answer can be asked of double precision.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from blobscript import field as reference
from blobscript import kernels
from blobscript.ir import Field, Leaf, Surface, leaves
from blobscript.joints import STEEPER

__all__ = ["EPS", "leaves", "magnitude", "position_error", "rounding", "steepness", "tolerance"]

Array = NDArray[np.float64]

EPS = 2.0**-52


def _with_factors(tree: Field, times: float = 1.0) -> Iterator[tuple[Leaf, float]]:
    """All leaves, and how much steeper than one of them the field may be by smooth nodes above it."""
    if isinstance(tree, Leaf):
        yield tree, times
        return
    for child in tree.children:
        yield from _with_factors(child, times * (STEEPER if tree.op in ("smooth_max", "smooth_min") else 1.0))


def _sums(tree: Field, points: Array) -> tuple[Array, Array]:
    """sum |w| (|D| + |D_s| s) and sum |w| |dD/dr| |M| / R over all elements, (n,) each."""
    size, steep = np.zeros(len(points)), np.zeros(len(points))
    for leaf, times in _with_factors(tree):
        stretch = 1.0 if leaf.matrix is None else float(np.linalg.norm(leaf.matrix[:, :3], 2))
        mapped = reference._mapped(leaf, points)  # pyright: ignore[reportPrivateUsage]
        for query, element, v in reference._offset_pairs(leaf, mapped):  # pyright: ignore[reportPrivateUsage]
            s = np.einsum("ij,ij->i", v, v)
            with np.errstate(all="ignore"):
                slope = np.where(s > 0.0, np.abs(kernels.slope(leaf.kernel, s)), 0.0)
            weight = times * np.abs(leaf.weight[element])
            value = np.abs(kernels.value(leaf.kernel, s))
            size += np.bincount(query, weight * (value + slope * s), len(points))
            each = weight * slope * 2.0 * np.sqrt(s) * stretch / leaf.reach[element]
            steep += np.bincount(query, each, len(points))
    return size, steep


def magnitude(tree: Field, points: Array) -> Array:
    """What the rounding of the terms of a field is relative to, (n,)."""
    return _sums(tree, points)[0]


def steepness(tree: Field, points: Array) -> Array:
    """What moving a point by 1 can at most do to the field there, (n,)."""
    return _sums(tree, points)[1]


def position_error(origins: Array, t: Array) -> Array:
    """4 eps (|o| + t)."""
    return 4.0 * EPS * (np.linalg.norm(origins, axis=1) + np.abs(t))


def rounding(surface: Surface, points: Array, position: Array) -> Array:
    """E above, where `position` is how far rounding may move the point."""
    size, steep = _sums(surface.field, points)
    return 8.0 * EPS * (size + abs(surface.threshold)) + 0.5 * position * steep


def tolerance(surface: Surface, origins: Array, directions: Array, t: Array) -> Array:
    """tol above for hits (n,) at distances t along the normalised directions."""
    scaled = directions / np.abs(directions).max(axis=1, keepdims=True)
    unit = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    position = position_error(origins, t)
    at = origins + t[:, None] * unit
    error = rounding(surface, at, position)
    reach = max(float(leaf.reach.min()) for leaf in leaves(surface.field))
    step = 1e-5 * reach

    def rate(shift: float) -> Array:
        return np.einsum("ij,ij->i", reference.gradient(surface.field, at + shift * unit), unit)

    slope, bend = np.abs(rate(0.0)), np.abs(rate(step) - rate(-step)) / (2.0 * step)
    with np.errstate(divide="ignore", invalid="ignore"):
        straight = np.where(slope > 0.0, error / slope, np.inf)
        curved = np.where(bend > 0.0, 2.0 * np.sqrt(2.0 * error / bend), np.inf)
    return np.minimum(straight, curved) + position
