"""The scene IR as JSON: `blobscript compile --to json` and `Scene.to_json`.

Every dataclass of `ir.py` becomes an object with its fields in their order; where a field may
hold one of several classes, `kind` names it (`"points"`, `"sum"`, `"sun"`). Arrays become nested
lists, a span its place. Floats are written with all their digits: reading them back gives the
same bits. The same scene gives the same text.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from typing import Any, cast

import numpy as np

from blobscript import ir
from blobscript.source import Span

__all__ = ["plain", "scene_json"]

_VERSION = 1

#: Classes that stand where others could stand too.
_ALTERNATIVES = (*ir.Skeleton.__args__, *ir.Light.__args__, ir.Leaf, ir.Node, ir.Sky, ir.Environment)


def scene_json(scene: ir.Scene) -> str:
    """One line per entry of the scene, so that a diff of two files tells something."""
    return "".join(_lines(scene))


def _lines(scene: ir.Scene) -> Iterator[str]:
    yield f'{{\n "blobscript_ir": {_VERSION}'
    for field in dataclasses.fields(scene):
        value = getattr(scene, field.name)
        if isinstance(value, tuple) and value:
            entries = ",\n  ".join(_text(plain(entry)) for entry in cast("tuple[Any, ...]", value))
            yield f',\n "{field.name}": [\n  {entries}\n ]'
        else:
            yield f',\n "{field.name}": {_text(plain(value))}'
    yield "\n}\n"


def _text(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def plain(value: Any) -> Any:
    """Any value of the IR as what JSON knows."""
    match value:
        case np.ndarray() | np.generic():
            return cast("list[Any] | float", value.tolist())
        case Span():
            return _place(value)
        case ir.Node():
            return {"kind": value.op, "children": [plain(child) for child in value.children]}
        case tuple() | list():
            return [plain(part) for part in cast("tuple[Any, ...] | list[Any]", value)]
        case dict():
            table = cast("dict[Any, Any]", value)
            return {str(key): plain(entry) for key, entry in table.items()}
        case _:
            pass
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        entries = {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return {"kind": type(value).__name__.lower(), **entries} if isinstance(value, _ALTERNATIVES) else entries
    return value


def _place(span: Span) -> dict[str, object]:
    end_line, end_column = span.end_position
    return {
        "path": span.source.path,
        "line": span.line,
        "column": span.column,
        "end_line": end_line,
        "end_column": end_column,
    }
