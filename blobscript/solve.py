"""Which reach and weight a blob has: any two of radius, reach and weight give the third.

The condition is weight * D(radius / reach) = threshold: alone, the blob's surface lies at `radius`.
Radius alone means reach = 2 * radius, reach alone means weight = 1. Everything is vectorised;
an absent number is NaN.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from blobscript import ir, kernels
from blobscript.arguments import SHORTEST_REACH, show
from blobscript.diagnostics import Help

__all__ = ["LARGEST", "Problem", "explain_problem", "in_range", "solve"]

Array = NDArray[np.float64]

#: Solved and mapped numbers may be this large (and reaches this small): their squares, and squares
#: of their quotients, are still numbers.
LARGEST = 1e60


class Problem(IntEnum):
    """Why three numbers do not fit."""

    NONE = 0
    THRESHOLD = 1  # a radius needs a positive threshold
    BEYOND_END = 2  # the kernel has ended before the radius
    TOO_LIGHT = 3  # the weight alone does not reach the threshold
    RANGE = 4  # the answer is too large or too small for a number


def solve(
    kernel: ir.Kernel, threshold: float, radius: Array, reach: Array, weight: Array
) -> tuple[Array, Array, NDArray[np.int8]]:
    """(reach, weight, problem) of n blobs with equal kernel; the numbers are (n,), NaN if absent."""
    reach = np.where(np.isnan(reach) & np.isnan(weight), 2.0 * radius, reach)
    has_radius = ~np.isnan(radius)
    by_reach = has_radius & ~np.isnan(reach)
    by_weight = has_radius & np.isnan(reach)
    problem = np.where(has_radius & (threshold <= 0), Problem.THRESHOLD, Problem.NONE).astype(np.int8)
    weight = np.where(~has_radius & np.isnan(weight), 1.0, weight)
    if threshold > 0 and by_reach.any():
        found, bad = _weights(kernel, threshold, radius[by_reach], reach[by_reach])
        weight[by_reach] = found
        problem[by_reach] = bad
    if threshold > 0 and by_weight.any():
        found, bad = _reaches(kernel, threshold, radius[by_weight], weight[by_weight])
        reach[by_weight] = found
        problem[by_weight] = bad
    problem[(problem == Problem.NONE) & ~in_range(reach, weight)] = Problem.RANGE
    return reach, weight, problem


def in_range(reach: Array, weight: Array) -> NDArray[np.bool_]:
    """Which of n blobs double precision holds; not those whose reach or weight is NaN."""
    with np.errstate(invalid="ignore"):
        return (np.abs(weight) <= LARGEST) & (reach <= LARGEST) & (reach >= SHORTEST_REACH)


def _weights(kernel: ir.Kernel, threshold: float, radius: Array, reach: Array) -> tuple[Array, NDArray[np.int8]]:
    r = radius / reach
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        density = kernels.value(kernel, r * r)
        weight = threshold / density
    beyond = (r >= kernels.support(kernel)) | ~(density > 0)
    return weight, np.where(beyond, Problem.BEYOND_END, Problem.NONE).astype(np.int8)


def _reaches(kernel: ir.Kernel, threshold: float, radius: Array, weight: Array) -> tuple[Array, NDArray[np.int8]]:
    light = ~(weight > threshold)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        r = kernels.inverse(kernel, threshold / np.where(light, 2 * threshold, weight))
        reach = radius / r
    return reach, np.where(light, Problem.TOO_LIGHT, Problem.NONE).astype(np.int8)


def explain_problem(
    problem: int, kernel: ir.Kernel, threshold: float, radius: float, reach: float, weight: float
) -> tuple[str, str, tuple[Help, ...]]:
    """Message, label and helps for one blob with a problem; the numbers are those given."""
    match Problem(problem):
        case Problem.THRESHOLD:
            return (
                f"a radius means nothing here: the threshold of the surface is {show(threshold)}, not positive",
                "has a radius",
                (Help("give reach and weight instead, or a threshold above 0"),),
            )
        case Problem.BEYOND_END:
            end = kernels.support(kernel) * reach
            where = f"ends at {show(end)}" if np.isfinite(end) else "is 0 there in double precision"
            return (
                f"radius {show(radius)} lies where this blob has no density: its kernel `{kernel.name}` {where}",
                f"radius {show(radius)}, reach {show(reach)}",
                (Help(f"give a reach above {show(radius)}, for example reach = {show(2 * radius)}"),),
            )
        case Problem.TOO_LIGHT:
            return (
                f"weight {show(weight)} does not exceed the threshold {show(threshold)}, "
                "so this blob alone has no surface and no radius",
                f"at most {show(max(weight, 0.0))} anywhere",
                (
                    Help(
                        "give reach and weight for a blob that only cuts or dents"
                        if weight < 0
                        else f"give a weight above {show(threshold)}, or reach instead of radius"
                    ),
                ),
            )
        case _:
            return (
                "the solved reach and weight of this blob are too large or too small to compute with",
                f"radius {show(radius)}, reach {show(reach)}, weight {show(weight)}",
                (Help("bring radius, reach and weight closer together"),),
            )
