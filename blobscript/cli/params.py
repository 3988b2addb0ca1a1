"""`blobscript params`: the parameters of a script, for people or as a JSON schema."""

from __future__ import annotations

import argparse
import json

from blobscript import ir
from blobscript.cli.program import load_scene
from blobscript.notation import as_json, show

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
        value = "" if param.value == param.default else f", now {_shown(param.value, param)}"
        lines.append(f"  {param.name}: {param.type} = {_shown(param.default, param)}{_allowed(param)}{value}")
        lines.extend(f"      {line}" for line in param.doc.splitlines())
    return lines


def _allowed(param: ir.ParamInfo) -> str:
    if param.choices is not None:
        return " in [" + ", ".join(_shown(choice, param) for choice in param.choices) + "]"
    if param.range is None:
        return ""
    lo, hi = (show(end, param.type) for end in param.range)
    return f" in {lo}..{hi}" + (f" step {show(param.step, param.type)}" if param.step is not None else "")


def _shown(value: object, param: ir.ParamInfo) -> str:
    return show(value, param.type) if param.settable else str(value)


# ---- JSON schema ---------------------------------------------------------------------------

_NUMBER = r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?"
_TYPES: dict[str, dict[str, object]] = {
    "number": {"type": "number"},
    "int": {"type": "integer"},
    "bool": {"type": "boolean"},
    "text": {"type": "string"},
    "angle": {"type": "string", "pattern": rf"^{_NUMBER}(deg|rad|turn)$"},
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
    if not param.settable:
        entry: dict[str, object] = {"readOnly": True, "x-type": param.type, "x-default": param.default}
    else:
        entry = {**_TYPES[param.type], "default": as_json(param.default, param.type)}
    if param.doc:
        entry["description"] = param.doc
    if param.choices is not None:
        entry["enum"] = [as_json(choice, param.type) for choice in param.choices]
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
        entry["x-value"] = as_json(param.value, param.type)
    return entry
