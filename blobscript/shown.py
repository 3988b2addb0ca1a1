"""Values as a script would write them: for texts, `debug`, and the notes of failed assertions.

Numbers are written with the fewest digits that give them back, angles in degrees, colours as
#rrggbb. What has no notation is called by its type.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from blobscript.operators import plain
from blobscript.types import Choice, ListOf, Primitive, RecordOf, Type, article

__all__ = ["show", "show_quoted"]

_MOST_ELEMENTS = 20
_LONGEST = 10_000


def show(value: Any, kind: Type) -> str:
    """As `"{value}"` has it: a text stands for itself."""
    match kind:
        case Primitive("text") | Choice():
            return str(value)
        case Primitive("angle"):
            return f"{_number(math.degrees(value), 12)}deg"
        case Primitive("bool"):
            return "true" if value else "false"
        case Primitive("number" | "int"):
            return _number(value)
        case Primitive("vec3"):
            return "(" + ", ".join([_number(x) for x in value]) + ")"
        case Primitive("color"):
            return _color(value)
        case Primitive("kernel"):
            return str(value.name)
        case ListOf(element):
            return _list(value, element)
        case RecordOf(fields):
            return "(" + ", ".join([f"{name} = {show_quoted(value[name], own)}" for name, own in fields]) + ")"
        case _:
            return article(kind)


def show_quoted(value: Any, kind: Type) -> str:
    """As it stands in a script: texts in quotes."""
    return f'"{value}"' if kind == Primitive("text") or isinstance(kind, Choice) else show(value, kind)


def _number(value: float, digits: int = 17) -> str:
    if isinstance(value, int) or not math.isfinite(value):
        return str(value)
    text = repr(float(value)) if digits == 17 else f"{value:.{digits}g}"
    return text.removesuffix(".0").replace("-0", "0") if value == 0.0 else text.removesuffix(".0")


def _color(value: Sequence[float]) -> str:
    """Back to sRGB, in eight bits; alpha only where it is not 1."""
    parts = [_srgb(c) for c in value[:3]] + ([value[3]] if value[3] != 1 else [])
    return "#" + "".join([f"{round(255 * min(max(c, 0), 1)):02x}" for c in parts])


def _srgb(linear: float) -> float:
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055


def _list(values: Any, element: Type) -> str:
    shown = [show_quoted(value, element) for value in plain(values[:_MOST_ELEMENTS])]
    more = [f"... {len(values)} in all"] if len(values) > _MOST_ELEMENTS else []
    return "[" + ", ".join([*shown, *more])[:_LONGEST] + "]"
