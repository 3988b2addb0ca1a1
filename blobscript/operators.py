"""The operators: which types they take, what they give, and what they do.

`BINARY` and `UNARY` are the whole definition for the checker; the first row that fits is taken, so
ints stay ints. `and`, `or`, `not`, `==` and `!=` are not in the tables: the former take bools and
may skip their right side, the latter compare any two values of one kind.

Whole numbers stay within +-2^53, where doubles hold all of them; beyond it is an error, so no
program can make numbers whose digits take all the time there is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from blobscript.types import (
    ANGLE,
    BOOL,
    COLOR,
    FIELD,
    INT,
    NUMBER,
    TEXT,
    VEC3,
    Choice,
    ListOf,
    RecordOf,
    Type,
    fits,
)

__all__ = [
    "BINARY",
    "IMPLEMENTATIONS",
    "LARGEST_INT",
    "UNARY",
    "BadNumberError",
    "Row",
    "comparable",
    "equal",
    "find",
    "plain",
]

LARGEST_INT = 2**53


class BadNumberError(Exception):
    """There is no result; `what` says why."""

    def __init__(self, what: str, code: str = "E0405") -> None:
        super().__init__(what)
        self.what = what
        self.code = code


@dataclass(frozen=True, slots=True)
class Row:
    left: Type
    right: Type
    result: Type
    implementation: str


BINARY: dict[str, tuple[Row, ...]] = {
    "+": (
        Row(INT, INT, INT, "add_int"),
        Row(NUMBER, NUMBER, NUMBER, "add"),
        Row(ANGLE, ANGLE, ANGLE, "add"),
        Row(VEC3, VEC3, VEC3, "add_vec3"),
        Row(FIELD, FIELD, FIELD, "add_field"),
    ),
    "-": (
        Row(INT, INT, INT, "subtract_int"),
        Row(NUMBER, NUMBER, NUMBER, "subtract"),
        Row(ANGLE, ANGLE, ANGLE, "subtract"),
        Row(VEC3, VEC3, VEC3, "subtract_vec3"),
        Row(FIELD, FIELD, FIELD, "subtract_field"),
    ),
    "*": (
        Row(INT, INT, INT, "multiply_int"),
        Row(NUMBER, NUMBER, NUMBER, "multiply"),
        Row(NUMBER, ANGLE, ANGLE, "multiply"),
        Row(ANGLE, NUMBER, ANGLE, "multiply"),
        Row(NUMBER, VEC3, VEC3, "scale_vec3_left"),
        Row(VEC3, NUMBER, VEC3, "scale_vec3"),
        Row(NUMBER, FIELD, FIELD, "scale_field_left"),
        Row(FIELD, NUMBER, FIELD, "scale_field"),
    ),
    "/": (
        Row(NUMBER, NUMBER, NUMBER, "divide"),
        Row(ANGLE, ANGLE, NUMBER, "divide"),
        Row(ANGLE, NUMBER, ANGLE, "divide"),
        Row(VEC3, NUMBER, VEC3, "divide_vec3"),
        Row(FIELD, NUMBER, FIELD, "divide_field"),
    ),
    "^": (Row(NUMBER, NUMBER, NUMBER, "power"),),
    "<": (Row(NUMBER, NUMBER, BOOL, "less"), Row(ANGLE, ANGLE, BOOL, "less")),
    "<=": (Row(NUMBER, NUMBER, BOOL, "less_equal"), Row(ANGLE, ANGLE, BOOL, "less_equal")),
    ">": (Row(NUMBER, NUMBER, BOOL, "greater"), Row(ANGLE, ANGLE, BOOL, "greater")),
    ">=": (Row(NUMBER, NUMBER, BOOL, "greater_equal"), Row(ANGLE, ANGLE, BOOL, "greater_equal")),
}

#: The operand stands in `right`.
UNARY: dict[str, tuple[Row, ...]] = {
    "-": (
        Row(INT, INT, INT, "negate"),
        Row(NUMBER, NUMBER, NUMBER, "negate"),
        Row(ANGLE, ANGLE, ANGLE, "negate"),
        Row(VEC3, VEC3, VEC3, "negate_vec3"),
        Row(FIELD, FIELD, FIELD, "negate_field"),
    ),
}

_PLAIN = (NUMBER, INT, ANGLE, BOOL, TEXT, VEC3, COLOR)


def find(rows: tuple[Row, ...], left: Type, right: Type) -> Row | None:
    for row in rows:
        if fits(left, row.left) and fits(right, row.right):
            return row
    return None


def comparable(kind: Type) -> bool:
    """Can values of this type be told apart with `==`?"""
    match kind:
        case ListOf(element):
            return comparable(element)
        case RecordOf(fields):
            return all(comparable(field) for _, field in fields)
        case Choice():
            return True
        case _:
            return any(fits(kind, plain) for plain in _PLAIN)


def equal(a: Any, b: Any) -> bool:
    """`a == b` for two values of one type; lists and records are equal if their parts are."""
    if isinstance(a, dict):
        record = cast("dict[str, Any]", a)
        return all(equal(value, b[name]) for name, value in record.items() if name in b)
    if isinstance(a, (str, int, float, bool)) or (a.__class__ is tuple and b.__class__ is tuple):
        return a == b
    return len(a) == len(b) and all(equal(x, y) for x, y in zip(plain(a), plain(b), strict=True))


def plain(values: Any) -> Any:
    """A list to go through one by one: rows of arrays become plain numbers and vectors."""
    if isinstance(values, np.ndarray):
        return [tuple(row) for row in values.tolist()] if values.ndim == 2 else values.tolist()
    return values


# ---- what they do -----------------------------------------------------------------------


def _whole(value: int) -> int:
    if -LARGEST_INT <= value <= LARGEST_INT:
        return value
    raise BadNumberError("this whole number is too large (the limit is 2^53)")


def _add_int(a: int, b: int) -> int:
    return _whole(a + b)


def _subtract_int(a: int, b: int) -> int:
    return _whole(a - b)


def _multiply_int(a: int, b: int) -> int:
    return _whole(a * b)


def _divide(a: float, b: float) -> float:
    if b == 0:
        raise BadNumberError("this divides by zero")
    return a / b


def _power(a: float, b: float) -> float:
    try:
        return math.pow(a, b)
    except OverflowError:
        raise BadNumberError("this power is too large") from None
    except ValueError:
        reason = "0 has no negative powers" if a == 0 else "a negative number has only whole powers"
        raise BadNumberError(reason) from None


def _power_int(a: int, b: int) -> int:
    if b > 53 and abs(a) > 1:
        raise BadNumberError("this whole number is too large (the limit is 2^53)")
    return _whole(a**b)


Vector = tuple[float, float, float]


def _add_vec3(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _subtract_vec3(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _scale_vec3(a: Vector, k: float) -> Vector:
    return (a[0] * k, a[1] * k, a[2] * k)


def _divide_vec3(a: Vector, k: float) -> Vector:
    if k == 0:
        raise BadNumberError("this divides by zero")
    return (a[0] / k, a[1] / k, a[2] / k)


def _fields() -> Any:
    """The field algebra; imported when a script first uses it."""
    from blobscript import values

    return values


_OF_TWO: dict[str, Callable[[Any, Any], Any]] = {
    "add": lambda a, b: a + b,
    "add_int": _add_int,
    "add_vec3": _add_vec3,
    "add_field": lambda a, b: _fields().add_fields(a, b),
    "subtract": lambda a, b: a - b,
    "subtract_int": _subtract_int,
    "subtract_vec3": _subtract_vec3,
    "subtract_field": lambda a, b: _fields().subtract_fields(a, b),
    "multiply": lambda a, b: a * b,
    "multiply_int": _multiply_int,
    "scale_vec3": _scale_vec3,
    "scale_vec3_left": lambda k, a: (a[0] * k, a[1] * k, a[2] * k),
    "scale_field": lambda a, k: _fields().scale_field(a, k),
    "scale_field_left": lambda k, a: _fields().scale_field(a, k),
    "divide": _divide,
    "divide_vec3": _divide_vec3,
    "divide_field": lambda a, k: _fields().scale_field(a, _divide(1.0, k)),
    "power": _power,
    "power_int": _power_int,
    "equal": equal,
    "not_equal": lambda a, b: not equal(a, b),
    "less": lambda a, b: a < b,
    "less_equal": lambda a, b: a <= b,
    "greater": lambda a, b: a > b,
    "greater_equal": lambda a, b: a >= b,
}

_OF_ONE: dict[str, Callable[[Any], Any]] = {
    "negate": lambda a: -a,
    "negate_vec3": lambda a: (-a[0], -a[1], -a[2]),
    "negate_field": lambda a: _fields().scale_field(a, -1.0),
}

#: Name in the tables -> function of the operands.
IMPLEMENTATIONS: dict[str, Callable[..., Any]] = {**_OF_TWO, **_OF_ONE}
