"""Packed data as C initialisers, by the names of their fields: whatever the structs hold, their text follows.

Numbers are printed so that they are read back to the bit. Fields that are 0 are left to the compiler, and so are
pointers to nothing and members that no code reads.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

__all__ = ["Tables", "array_text", "number"]

_WIDTH = 100


def number(value: float | int) -> str:
    """A C constant."""
    if isinstance(value, float):
        if math.isinf(value):
            return "-INFINITY" if value < 0 else "INFINITY"
        return "NAN" if math.isnan(value) else repr(value)
    return str(int(value))


def _wrapped(parts: list[str], indent: str) -> str:
    """Parts behind each other, in lines."""
    lines: list[str] = []
    line = indent
    for part in parts:
        if len(line) + len(part) + 2 > _WIDTH and line.strip():
            lines.append(line.rstrip())
            line = indent
        line += part + ", "
    return "\n".join([*lines, line.rstrip()])


def array_text(kind: str, name: str, values: NDArray[Any], used: Collection[str]) -> str:
    """`static const kind name[] = {…};` for numbers or records."""
    if values.dtype.names:
        rows = [f"    {_entries(row, used)}," for row in values]
        body = "\n".join(rows)
    else:
        body = _wrapped([number(value) for value in values.ravel().tolist()], "    ")
    return f"static const {kind} {name}[{len(values.ravel())}] = {{\n{body.rstrip(',')}\n}};"


def _entries(row: Any, used: Collection[str]) -> str:
    """{.name = value, …} of a NumPy record."""
    parts: list[str] = []
    for name in row.dtype.names:
        text = _value(row[name], used)
        if name in used and text:
            parts.append(f".{name} = {text}")
    return "{" + ", ".join(parts or ["0"]) + "}"


def _value(value: Any, used: Collection[str]) -> str:
    """As an initialiser; nothing for zeros."""
    if isinstance(value, np.ndarray):
        array = cast("NDArray[Any]", value)
        flat = array.ravel().tolist()
        while flat and flat[-1] == 0 and math.copysign(1, flat[-1]) > 0:
            flat.pop()
        return "{" + ", ".join(map(number, flat)) + "}" if flat else ""
    if isinstance(value, np.void):
        return _entries(value, used)
    plain: Any = cast("Any", value).item() if isinstance(value, np.generic) else value
    return "" if plain == 0 and math.copysign(1, plain) > 0 else number(plain)


class Tables:
    """Structures with all that they point to, as constants. keep: the arrays, in whatever they are kept in; kinds:
    member -> type of what it points to; used: members that are read."""

    def __init__(self, keep: Any, kinds: Mapping[str, str], used: Collection[str]) -> None:
        self.parts: list[str] = []
        self._there = dict(_arrays(keep))
        self._kinds, self._used = kinds, used
        self._names: dict[int, str] = {}

    def record(self, kind: str, name: str, record: ctypes.Structure, prefix: str) -> None:
        """`static const kind name = {…};` behind the arrays that it points to, named after `prefix`."""
        self._point(record, prefix)
        self.parts.append(f"static const {kind} {name} = {{\n{self._fields(record, '    ')}\n}};")

    def _point(self, record: ctypes.Structure, prefix: str) -> None:
        """The arrays behind the pointers of a record that are read."""
        for name, kind, *_ in type(record)._fields_:
            value: Any = getattr(record, name)
            if name not in self._used:
                continue
            if isinstance(value, ctypes.Structure):
                self._point(value, prefix)
            elif kind is ctypes.c_void_p and value in self._there and value not in self._names:
                self._array(self._kinds[name], f"{prefix}_{name}", value)

    def _array(self, kind: str, name: str, address: int) -> None:
        values = self._there[address]
        if isinstance(values, np.ndarray):
            array = cast("NDArray[Any]", values)
            if array.size:
                self._names[address] = name
                self.parts.append(array_text(kind, name, array, self._used))
            return
        rows: list[Any] = list(values)
        for i, row in enumerate(rows):
            self._point(row, f"{name}_{i}")
        self._names[address] = name
        body = ",\n".join(f"    {{\n{self._fields(row, '        ')}\n    }}" for row in rows)
        self.parts.append(f"static const {kind} {name}[{len(rows)}] = {{\n{body}\n}};")

    def _fields(self, record: ctypes.Structure, indent: str) -> str:
        """A line for each field that is read and not 0."""
        lines: list[str] = []
        for name, kind, *_ in type(record)._fields_:
            if name not in self._used:
                continue
            text = self._field(getattr(record, name), kind, indent)
            if text:
                lines.append(f"{indent}.{name} = {text},")
        return "\n".join(lines or [f"{indent}0"])

    def _field(self, value: Any, kind: Any, indent: str) -> str:
        if isinstance(value, ctypes.Structure):
            inner = self._fields(value, indent + "    ")
            return "" if inner.strip() == "0" else "{\n" + inner + f"\n{indent}}}"
        if kind is ctypes.c_void_p:
            return self._names.get(value or 0, "")
        return _value(np.array(list(cast("Any", value))) if isinstance(value, ctypes.Array) else value, self._used)


def _arrays(keep: Any) -> Iterator[tuple[int, Any]]:
    """Address and array of everything in tuples, lists and dataclasses."""
    if isinstance(keep, np.ndarray):
        yield cast("NDArray[Any]", keep).ctypes.data, keep
    elif isinstance(keep, ctypes.Array):
        yield ctypes.addressof(cast("Any", keep)), keep
    elif isinstance(keep, (tuple, list)):
        for part in cast("list[Any]", keep):
            yield from _arrays(part)
    elif is_dataclass(keep):
        for field in fields(keep):
            yield from _arrays(getattr(keep, field.name))
