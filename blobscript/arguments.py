"""Checks of argument values that their type cannot express, with the words to report them in."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blobscript.diagnostics import Help
from blobscript.values import MakerError, Vec3

__all__ = [
    "HEAVIEST",
    "LARGEST",
    "SHORTEST_REACH",
    "count_text",
    "direction",
    "limits",
    "not_negative",
    "number",
    "numbers",
    "positive",
    "show",
    "vector",
    "vectors",
]

Array = NDArray[np.float64]

#: Numbers of a script lie below this, and sizes above its inverse: then squares of quotients, and
#: products of six factors, stay well within the range of double precision.
LARGEST = 1e40
#: Weights and short reaches go further: of those, only squares and a weight over a square are formed.
HEAVIEST = 1e60
SHORTEST_REACH = 1e-110


def limits(argument: str) -> tuple[float, float]:
    """Least size above 0, and largest."""
    smallest = SHORTEST_REACH if argument == "reach" else 1 / LARGEST
    return smallest, HEAVIEST if argument == "weight" else LARGEST


_FINITE = (Help("look for a division by something near zero, or for a power that grows too fast"),)


def show(value: float | Sequence[float] | Array) -> str:
    """A number or vector as the script would write it."""
    if isinstance(value, (Sequence, np.ndarray)):
        return "(" + ", ".join(show(float(x)) for x in value) + ")"
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value) if abs(value) < 10**15 else f"{value:.6g}" if abs(value) < 10**300 else "huge"
    x = float(value)
    if math.isnan(x):
        return "not a number"
    if math.isinf(x):
        return "infinite" if x > 0 else "minus infinite"
    return f"{x:.15g}" if len(f"{x:.15g}") <= 8 else f"{x:.6g}"


def count_text(n: int, noun: str) -> str:
    """`1 point`, `2 points`."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def number(value: float, argument: str) -> float:
    """A finite number of a size that can be squared."""
    x = _float(value)
    if not abs(x) <= limits(argument)[1]:
        raise MakerError(
            "E0405",
            f"`{argument}` must be a finite number, but it is {show(x)}"
            if not math.isfinite(x)
            else f"`{argument}` is too large: {show(x)}",
            argument=argument,
            label=f"{show(x)}",
            helps=_FINITE,
        )
    return x


def positive(value: float, argument: str) -> float:
    """A finite number above 0."""
    x = number(value, argument)
    if not x > 0:
        size = argument in ("radius", "reach")
        advice = "to cut something away, give a reach and a negative weight" if size else "give a number above 0"
        raise MakerError(
            "E0405", f"`{argument}` must be positive, but it is {show(x)}", argument, show(x), (Help(advice),)
        )
    smallest, _ = limits(argument)
    if x < smallest:
        helps = (Help(f"the smallest allowed is {smallest:g}"),)
        raise MakerError("E0405", f"`{argument}` is too small: {show(x)}", argument, show(x), helps)
    return x


def not_negative(value: float, argument: str, advice: str) -> float:
    """A finite number from 0 up."""
    x = number(value, argument)
    if x < 0:
        message = f"`{argument}` must not be negative, but it is {show(x)}"
        raise MakerError("E0405", message, argument, show(x), (Help(advice),))
    return x


def vector(value: Sequence[float], argument: str) -> Vec3:
    """Three finite numbers."""
    x, y, z = _float(value[0]), _float(value[1]), _float(value[2])
    if not (abs(x) <= LARGEST and abs(y) <= LARGEST and abs(z) <= LARGEST):
        problem = "too large" if all(map(math.isfinite, (x, y, z))) else "not finite"
        raise MakerError(
            "E0405",
            f"`{argument}` is {problem}: {show((x, y, z))}",
            argument=argument,
            label=f"{show((x, y, z))}",
            helps=_FINITE,
        )
    return x, y, z


def direction(value: Sequence[float], argument: str) -> Vec3:
    """Three finite numbers that are not all zero."""
    x, y, z = vector(value, argument)
    if x == y == z == 0:
        helps = (Help("for example (0, 1, 0) points up"),)
        raise MakerError("E0405", f"`{argument}` must not be (0, 0, 0): it has no direction", argument, "", helps)
    return x, y, z


def numbers(values: Sequence[float] | Array) -> Array:
    """(n,) numbers; integers beyond double precision are infinite."""
    try:
        return np.ascontiguousarray(values, dtype=np.float64)
    except OverflowError:
        return np.array([_float(x) for x in values], dtype=np.float64)


def _float(x: float) -> float:
    try:
        return float(x)
    except OverflowError:
        return math.inf


def vectors(value: Sequence[Vec3] | Array, argument: str) -> Array:
    """(n, 3) finite numbers; arrays of that shape are taken as they are."""
    try:
        points = np.ascontiguousarray(value, dtype=np.float64).reshape(-1, 3)
    except OverflowError:
        points = np.array([[_float(x) for x in point] for point in value], dtype=np.float64)
    wrong = ~(np.abs(points) <= LARGEST)
    if wrong.any():
        i = int(np.argmax(wrong.any(axis=1)))
        raise MakerError(
            "E0405",
            f"point {i} of `{argument}` is not finite: {show(points[i])}",
            argument=argument,
            label=f"[{i}] is {show(points[i])} (counted from 0)",
            helps=_FINITE,
        )
    return points
