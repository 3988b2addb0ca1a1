"""JSON: points and records from a list of lists or objects."""

from __future__ import annotations

import json
import re
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from blobscript.csvfiles import field_names
from blobscript.datafiles import unreadable
from blobscript.values import Table

__all__ = ["json_points", "json_records", "refuse_deep_json"]

Array = NDArray[np.float64]

#: JSON becomes Python objects, ten times as large as the text.
MAX_JSON_SIZE = 40_000_000

#: Lists in lists; more is no table, and no model either.
_DEEPEST = 500


def _json(file: str, text: str) -> list[Any]:
    if len(text) > MAX_JSON_SIZE:
        raise unreadable(file, f"JSON may have {MAX_JSON_SIZE // 1_000_000} MB at most", "large tables fit into CSV")
    refuse_deep_json(file, text)
    try:
        found = json.loads(text, parse_constant=_no_constant)
    except json.JSONDecodeError as error:
        message = f"line {error.lineno}, column {error.colno}: {error.msg[:1].lower()}{error.msg[1:]}"
        raise unreadable(file, message, label=f"line {error.lineno}") from None
    except ValueError as error:
        raise unreadable(file, str(error)) from None
    if not isinstance(found, list):
        raise unreadable(file, "it holds no list", "the file must be a list: [ ... ]")
    return cast("list[Any]", found)


_STRING = re.compile(r'"(?:[^"\\]|\\.)*"?', re.DOTALL)


def refuse_deep_json(file: str, text: str) -> None:
    """Python's reader of JSON takes C stack for every level, and scripts run with a limit of recursion far beyond
    what that holds."""
    if _nesting(text) > _DEEPEST and _nesting(_STRING.sub("", text)) > _DEEPEST:
        raise unreadable(file, "it nests too deep", f"lists and objects may nest {_DEEPEST} levels deep")


def _nesting(text: str) -> int:
    """How deep brackets nest, those in strings counted, too."""
    letters = np.frombuffer(text.encode("utf-8", "replace"), dtype=np.uint8) | 32  # [ ] and { } differ in that bit
    steps = (letters == ord("{")).astype(np.int8) - (letters == ord("}")).astype(np.int8)
    return int(np.cumsum(steps, dtype=np.int32).max(initial=0))


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number that JSON allows")


def json_points(file: str, text: str) -> Array:
    found = _json(file, text)
    points = [_json_point(file, k, item) for k, item in enumerate(found)]
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def _json_point(file: str, k: int, item: Any) -> tuple[float, float, float]:
    if isinstance(item, dict):
        record = cast("dict[str, Any]", item)
        item = record["at"] if "at" in record else [record.get(name) for name in "xyz"]
    point = _vec3(item)
    if point is None:
        raise unreadable(
            file, f"item {k} (counted from 0) is not a point", 'a point is [1, 2, 3] or {"x": 1, "y": 2, "z": 3}'
        )
    return point


def _vec3(item: Any) -> tuple[float, float, float] | None:
    if not isinstance(item, list) or len(cast("list[Any]", item)) != 3:
        return None
    parts = [_json_number(part) for part in cast("list[Any]", item)]
    if None in parts:
        return None
    return cast("tuple[float, float, float]", tuple(parts))


def _json_number(item: Any) -> float | None:
    if isinstance(item, bool) or not isinstance(item, (int, float)):
        return None
    try:
        return float(item)
    except OverflowError:
        return float("inf")


def json_records(file: str, text: str) -> Table:
    found = _json(file, text)
    for k, item in enumerate(found):
        if not isinstance(item, dict):
            raise unreadable(file, f"item {k} (counted from 0) is no record", 'a record is {"name": value, ...}')
        if item.keys() != found[0].keys():
            differing = sorted(item.keys() ^ found[0].keys())[0]
            raise unreadable(
                file,
                f"item {k} (counted from 0) and item 0 have different fields: `{differing}`",
                "all records need the same fields",
            )
    names = field_names(file, list(found[0])) if found else []
    columns = zip(names, found[0] if found else (), strict=True)
    return Table({name: _json_column([item[key] for item in found]) for name, key in columns}, len(found))


def _json_column(items: list[Any]) -> Any:
    if all(type(item) is int and abs(item) < 2**62 for item in items):
        return np.array(items, dtype=np.int64)
    numbers = [_json_number(item) for item in items]
    if None not in numbers:
        return np.array(numbers, dtype=np.float64)
    vectors = [_vec3(item) for item in items]
    if None not in vectors:
        return np.array(vectors, dtype=np.float64)
    return [_json_value(item) for item in items]


def _json_value(item: Any) -> Any:
    """JSON as values of the language: records, lists, vectors."""
    if isinstance(item, dict):
        return {str(name): _json_value(value) for name, value in cast("dict[str, Any]", item).items()}
    if isinstance(item, list):
        vector = _vec3(item)
        return vector if vector else [_json_value(part) for part in cast("list[Any]", item)]
    return item
