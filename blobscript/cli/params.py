"""`blobscript params`: the parameters of a script, for people or as a JSON schema."""

from __future__ import annotations

import argparse
import json

from blobscript import ir
from blobscript.cli.program import load_scene

__all__ = ["parameter_lines", "run", "schema"]


def run(arguments: argparse.Namespace) -> int:
    params = load_scene(arguments, warn=False).ir.params
    if arguments.format == "json":
        print(json.dumps(schema(params, arguments.file), indent=1, ensure_ascii=False))
    elif params:
        print("\n".join(parameter_lines(params)))
    else:
        print(f"{arguments.file} has no parameters")
    return 0


def parameter_lines(params: tuple[ir.ParamInfo, ...]) -> list[str]:
    """One line per parameter, its doc below, groups under their names."""
    lines: list[str] = []
    group = ""
    for param in sorted(params, key=lambda p: p.group):
        if param.group != group:
            group = param.group
            lines.append(f"{group}:")
        value = "" if param.value == param.default else f", now {show(param.value, param.type)}"
        lines.append(f"  {param.name}: {param.type} = {show(param.default, param.type)}{_allowed(param)}{value}")
        lines.extend(f"      {line}" for line in param.doc.splitlines())
    return lines


def _allowed(param: ir.ParamInfo) -> str:
    if param.choices is not None:
        return " in [" + ", ".join(show(choice, param.type) for choice in param.choices) + "]"
    if param.range is None:
        return ""
    lo, hi = (show(end, param.type) for end in param.range)
    return f" in {lo}..{hi}" + (f" step {show(param.step, param.type)}" if param.step is not None else "")


def show(value: object, kind: str) -> str:
    """A value as the script would write it; angles in degrees, colours as they are on the web."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value, ensure_ascii=False)
        case int() | float() if kind == "angle":
            return f"{_short(value * 180 / 3.141592653589793)}deg"
        case int() | float():
            return _short(value)
        case (float(), float(), float(), float()) if kind == "color":
            return "#" + "".join(f"{_coded(part):02x}" for part in value[:3])
        case tuple() | list():
            return "(" + ", ".join(show(part, "number") for part in value) + ")"
    return str(value)


def _short(value: float) -> str:
    return f"{value:.12g}"


def _coded(linear: float) -> int:
    """Linear 0..1 to sRGB 0..255."""
    low = linear <= 0.0031308
    return round(255 * min(1.0, max(0.0, 12.92 * linear if low else 1.055 * linear ** (1 / 2.4) - 0.055)))


# ---- JSON schema ---------------------------------------------------------------------------

_TYPES: dict[str, dict[str, object]] = {
    "number": {"type": "number"},
    "int": {"type": "integer"},
    "bool": {"type": "boolean"},
    "text": {"type": "string"},
    "angle": {"type": "string", "pattern": r"^-?[0-9]+(\.[0-9]+)?(deg|rad|turn)$"},
    "color": {"type": "string", "pattern": "^(#[0-9a-fA-F]{3,8}|[a-z]+)$"},
    "vec3": {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
}


def schema(params: tuple[ir.ParamInfo, ...], title: str) -> dict[str, object]:
    """What a file for `--params` may hold (JSON Schema, draft 2020-12); sliders can be made from it."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        "type": "object",
        "additionalProperties": False,
        "properties": {param.name: _property(param) for param in params},
    }


def _property(param: ir.ParamInfo) -> dict[str, object]:
    entry: dict[str, object] = {**_TYPES.get(param.type, {}), "default": _json_value(param.default, param.type)}
    if param.doc:
        entry["description"] = param.doc
    if param.choices is not None:
        entry["enum"] = [_json_value(choice, param.type) for choice in param.choices]
    if param.range is not None:
        lo, hi = param.range
        if param.type == "angle":  # a text with a unit: the ends cannot be `minimum` and `maximum`
            entry["x-range"] = [show(lo, "angle"), show(hi, "angle")]
        else:
            entry |= {"minimum": lo, "maximum": hi}
    if param.step is not None:
        entry["x-step"] = show(param.step, param.type) if param.type == "angle" else param.step
    if param.group:
        entry["x-group"] = param.group
    if param.value != param.default:
        entry["x-value"] = _json_value(param.value, param.type)
    return entry


def _json_value(value: object, kind: str) -> object:
    """As `--params` reads it back: angles and colours are texts."""
    if kind in ("angle", "color"):
        return show(value, kind)
    return list(value) if isinstance(value, tuple) else value
