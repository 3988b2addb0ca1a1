"""Records from files: the type that their columns have, and making them what the script declares."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from blobscript.types import BOOL, ERROR, INT, NOTHING, NUMBER, TEXT, VEC3, ListOf, RecordOf, Type, join
from blobscript.values import Table

__all__ = ["type_of_table", "type_of_value"]


def type_of_table(table: Table) -> RecordOf:
    """The type of its rows."""
    return RecordOf(tuple([(name, _type_of_column(column)) for name, column in table.columns.items()]))


def _type_of_column(column: Any) -> Type:
    if isinstance(column, np.ndarray):
        array = cast("NDArray[Any]", column)
        if array.ndim == 2:
            return VEC3
        return INT if np.issubdtype(array.dtype, np.integer) else NUMBER
    return _type_of_items(column)


def type_of_value(value: Any) -> Type:
    """The type of a value as it comes from a file; ERROR if the language has none for it."""
    match value:
        case bool():
            return BOOL
        case int():
            return INT
        case float():
            return NUMBER
        case str():
            return TEXT
        case tuple():
            return VEC3
        case dict():
            record = cast("dict[str, Any]", value)
            return RecordOf(tuple([(name, type_of_value(part)) for name, part in record.items()]))
        case list():
            return ListOf(_type_of_items(cast("list[Any]", value)))
        case _:
            return ERROR


def _type_of_items(items: list[Any]) -> Type:
    kind: Type = NOTHING
    for item in items:
        kind = join(kind, type_of_value(item)) or ERROR
    return kind
