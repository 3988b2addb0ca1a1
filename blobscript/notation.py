"""Values of parameters outside of scripts: for people, and as `--params` reads them back.

`kind` is the `type` of an `ir.ParamInfo`. Angles and colours are texts in JSON, as in scripts.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import cast

from blobscript import ir

__all__ = ["as_json", "settings", "show"]


def show(value: object, kind: str) -> str:
    """A value as the script would write it; angles in degrees, colours as they are on the web."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value, ensure_ascii=False)
        case int() | float() if kind == "angle":
            return f"{_short(math.degrees(value))}deg"
        case int() | float():
            return _short(value)
        case tuple() if kind == "color":
            color = cast("tuple[float, ...]", value)
            alpha = () if color[3] == 1 else (_byte(color[3]),)
            return "#" + "".join(f"{part:02x}" for part in (*map(_coded, color[:3]), *alpha))
        case tuple() | list():
            parts = cast("tuple[object, ...] | list[object]", value)
            return "(" + ", ".join(show(part, "number") for part in parts) + ")"
        case _:
            return str(value)


def as_json(value: object, kind: str) -> object:
    """A value as a file for `--params` has it; reading it gives the same bits back, colours in 8 bits."""
    match value:
        case int() | float() if kind == "angle":
            return _angle(value)
        case tuple() if kind == "color":
            color = cast("tuple[float, ...]", value)
            return show(color, kind)
        case tuple():
            parts = cast("tuple[object, ...]", value)
            return list(parts)
        case _:
            return value


def settings(params: Iterable[ir.ParamInfo]) -> str:
    """The values that a scene was made with, as a file for `--params`; what cannot be set is left out."""
    given = {param.name: as_json(param.value, param.type) for param in params if param.settable}
    return json.dumps(given, ensure_ascii=False)


def _angle(radians: float) -> str:
    """In degrees where they give the same bits back."""
    for degrees in (_short(math.degrees(radians)), repr(math.degrees(radians))):
        if float(degrees) * (math.pi / 180) == radians:
            return f"{degrees}deg"
    return f"{radians!r}rad"


def _short(value: float) -> str:
    return f"{value:.12g}"


def _coded(linear: float) -> int:
    """Linear 0..1 to sRGB 0..255."""
    return _byte(12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055)


def _byte(part: float) -> int:
    return round(255 * min(1.0, max(0.0, part)))
