"""The parameters of a scene: values from outside, checked against type, range and choices (E06).

A value comes as text (`--set`, read in the notation of scripts) or as plain data (a parameter file,
Python): numbers, booleans, texts, [x, y, z]. Angles and colours are texts there as well: "35deg".
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

from blobscript import ir, typed
from blobscript.builtins import FUNCTIONS
from blobscript.css import CSS_COLORS
from blobscript.diagnostics import Diagnostic, Help, Label
from blobscript.runtime import FailureError
from blobscript.setting import Setting
from blobscript.shown import show_quoted
from blobscript.suggest import closest
from blobscript.types import ANGLE, TEXT, Choice, Primitive, Type, article, describe
from blobscript.values import Color

__all__ = ["noted", "param_value", "unknown_params"]

_NUMBER = r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_INT = re.compile(r"[-+]?[0-9]{1,15}", re.ASCII)
_PLAIN = re.compile(_NUMBER, re.ASCII)
_ANGLE = re.compile(rf"({_NUMBER})(deg|rad|turn)", re.ASCII)
_COLOR = re.compile(r"#([0-9a-fA-F]{8}|[0-9a-fA-F]{6}|[0-9a-fA-F]{3})", re.ASCII)
_RADIANS = {"deg": math.pi / 180, "rad": 1.0, "turn": 2 * math.pi}
_NONE: Any = object()


def unknown_params(program: typed.Program, given: Mapping[str, object]) -> list[Diagnostic]:
    """What was given for parameters that the main script does not have."""
    known = [p.definition.name for p in _own(program)]
    path = program.main.source.path
    found: list[Diagnostic] = []
    for name in given:
        if name in known:
            continue
        near = closest(name, known)
        helps = [Help(f"did you mean `{near}`?")] if near else []
        helps.append(Help(f"`blobscript params {path}` lists all parameters and their ranges"))
        notes = ("it has " + ", ".join(f"`{own}`" for own in known),) if known else ("it has no parameters at all",)
        found.append(
            Diagnostic("E0602", f"`{path}` has no parameter `{name}`", path=path, helps=tuple(helps), notes=notes)
        )
    return found


def _own(program: typed.Program) -> list[typed.FileParam]:
    return [d for d in program.definitions if isinstance(d, typed.FileParam) and d.definition.module is program.main]


def param_value(
    param: typed.FileParam,
    default: Any,
    limits: tuple[Any, Any] | None,
    choices: list[Any] | None,
    step: Any,
    given: Mapping[str, object],
    path: str,
) -> ir.ParamInfo:
    """The parameter with its value; raises FailureError if that is not allowed."""
    name = param.definition.name
    _check(param, default, limits, choices, None, path)
    value = default
    if name in given:
        value = _read(given[name], _base(param.type))
        if value is _NONE:
            raise FailureError(_wrong_type(param, given[name], path))
        _check(param, value, limits, choices, given[name], path)
    return ir.ParamInfo(
        name,
        describe(_base(param.type)),
        default,
        value,
        limits,
        step,
        tuple(choices) if choices is not None else None,
        param.group,
        param.doc,
        param.definition.name_span,
        describe(_base(param.type)) in _EXAMPLES,
    )


def noted(info: ir.ParamInfo, kind: Type) -> ir.ParamInfo:
    """As the scene keeps it: plain data, or the notation of what only the script can give."""
    if info.settable:
        return info
    choices = None if info.choices is None else tuple(show_quoted(choice, kind) for choice in info.choices)
    shown = show_quoted(info.value, kind)
    return replace(info, default=show_quoted(info.default, kind), value=shown, choices=choices, range=None, step=None)


def _base(kind: Type) -> Type:
    return TEXT if isinstance(kind, Choice) else kind


# ---- reading values ------------------------------------------------------------------------


def _read(given: object, kind: Type) -> Any:
    """The value of this type, or _NONE."""
    if not isinstance(kind, Primitive):
        return _NONE
    return _from_text(given.strip(), kind.name) if isinstance(given, str) else _from_data(given, kind.name)


def _from_text(text: str, kind: str) -> Any:
    match kind:
        case "text":
            quoted = len(text) > 1 and text[0] == text[-1] == '"'
            return text[1:-1] if quoted else str(text)
        case "int":
            return int(text) if _INT.fullmatch(text) else _NONE
        case "number":
            return _finite(text) if _PLAIN.fullmatch(text) else _NONE
        case "bool":
            return {"true": True, "false": False}.get(text, _NONE)
        case "angle":
            found = _ANGLE.fullmatch(text)
            value = _finite(found[1]) if found else _NONE
            return _NONE if found is None or value is _NONE else value * _RADIANS[found[2]]
        case "color":
            return _color(text)
        case "vec3":
            parts = [_from_text(part.strip(), "number") for part in text.removeprefix("(").removesuffix(")").split(",")]
            return _NONE if len(parts) != 3 or _NONE in parts else tuple(parts)
        case _:
            return _NONE


def _finite(text: str) -> Any:
    value = float(text)
    return value if math.isfinite(value) else _NONE


def _color(text: str) -> Any:
    if text in CSS_COLORS:
        text = f"#{CSS_COLORS[text]:06x}"
    found = _COLOR.fullmatch(text)
    if not found:
        return _NONE
    digits = found[1] if len(found[1]) > 3 else "".join(c + c for c in found[1])
    return FUNCTIONS["rgb"](*(int(digits[i : i + 2], 16) / 255 for i in range(0, len(digits), 2)))


def _from_data(given: object, kind: str) -> Any:
    match given, kind:
        case bool(), _:
            return given if kind == "bool" else _NONE
        case int(), "int":
            return given if abs(given) <= 2**53 else _NONE
        case float(), "int":
            return int(given) if given.is_integer() and abs(given) <= 2**53 else _NONE
        case ((int() | float()), "number"):
            return float(given) if abs(given) < 1e308 else _NONE
        case Color(), "color":
            return given
        case ((list() | tuple()), "vec3"):
            items = cast("list[object] | tuple[object, ...]", given)
            parts = [_from_data(part, "number") for part in items]
            return _NONE if len(parts) != 3 or _NONE in parts else tuple(parts)
        case _:
            return _NONE


# ---- what goes wrong -------------------------------------------------------------------------


def _check(
    param: typed.FileParam,
    value: Any,
    limits: tuple[Any, Any] | None,
    choices: list[Any] | None,
    given: object | None,
    path: str,
) -> None:
    if limits is not None:
        assert param.allowed is not None
        lo, hi = limits
        if not (lo <= value < hi if param.allowed.half_open else lo <= value <= hi):
            raise FailureError(_not_allowed(param, f"lie in {param.allowed.span.text}", value, given, path))
    if choices is not None and value not in choices:
        listed = " or ".join(show_quoted(choice, _base(param.type)) for choice in choices)
        raise FailureError(_not_allowed(param, f"be {listed}", value, given, path))


def _not_allowed(param: typed.FileParam, must: str, value: Any, given: object | None, path: str) -> Diagnostic:
    name, shown = param.definition.name, show_quoted(value, _base(param.type))
    place = param.allowed or param.choices
    assert place is not None
    if given is None:
        label = Label(param.default.span, "the default")
        return Diagnostic(
            "E0601", f"`{name}` must {must}, but its default is {shown}", place.span, "allowed here", (label,)
        )
    helps = (_as_given(name, given), _lists_all(path))
    return Diagnostic("E0601", f"`{name}` must {must}, but {shown} was given", place.span, "allowed here", (), helps)


def _as_given(name: str, given: object) -> Help:
    """What was written, with a mark under the value where it was a command line."""
    if isinstance(given, Setting):
        text = f"given on the command line: --set {name}={given}"
        return Help(f"{text}\n{' ' * (len(text) - len(given))}{'^' * len(given)}")
    return Help(f"given as a parameter: {name} = {_brief(given)}")


def _brief(given: object) -> str:
    text = repr(given) if not isinstance(given, str) else f'"{given}"'
    return text if len(text) <= 40 else text[:37] + "..."


def _lists_all(path: str) -> Help:
    return Help(f"`blobscript params {path}` lists all parameters and their ranges")


_EXAMPLES = {
    "int": "7",
    "number": "0.5",
    "bool": "true or false",
    "text": "clay",
    "angle": "20deg",
    "color": "#ff8800 or coral",
    "vec3": "(1, 2, 3) on the command line, [1, 2, 3] in a file",
}


def _wrong_type(param: typed.FileParam, given: object, path: str) -> Diagnostic:
    name, kind = param.definition.name, _base(param.type)
    word = describe(kind)
    helps = [Help(f"write for example {_EXAMPLES[word]}")] if word in _EXAMPLES else []
    if kind == ANGLE and isinstance(_from_text(str(given), "number"), float):
        helps = [Help(f"write the unit: {given}deg")]
    if word not in _EXAMPLES:
        helps = [Help("a parameter of this type can only be changed in the script")]
    return Diagnostic(
        "E0603",
        f"`{name}` is {article(kind)}, but {_brief(given)} was given",
        param.definition.name_span,
        word,
        helps=(*helps, _lists_all(path)),
    )
