"""Functions of the script as texture programs: the typed tree, followed with numbers that are not known yet.

What depends on the place becomes instructions; everything else is computed at once: constants, names
from around the function, lists and loops over them, choices whose condition is known. A choice that
depends on the place computes both sides. Functions are followed into their calls.

Non-goals: loops whose length depends on the place, texts, and things of the scene; they are E0407.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NoReturn, cast

import numpy as np

from blobscript import ir, typed
from blobscript.diagnostics import Diagnostic, Help
from blobscript.runtime import MISSING, POISON, AbsorbedError, FailureError, Frame, FunctionValue, Origin
from blobscript.source import Span
from blobscript.texture import COLUMNS, MOST, Builder
from blobscript.values import Color

__all__ = ["texture"]

_DEEPEST = 100
_LONGEST_LIST = 1000
_MOST_CHOICES = 64


@dataclass(frozen=True, slots=True)
class _Number:
    """A number of the program: a handle of the builder."""

    handle: int


Vector = tuple[Any, Any, Any]


def texture(parts: Mapping[str, FunctionValue]) -> ir.Texture:
    """The program of a material's parts, each a function of the place."""
    build = Builder()
    outputs: list[tuple[int, int]] = []
    for name, function in parts.items():
        follower = _Follower(build)
        place = tuple(_Number(i) for i in range(3))
        result = follower.call(function, [place], None)
        columns = COLUMNS[name]
        values = [result] if len(columns) == 1 else list(result)[: len(columns)]
        outputs += [(column, follower.handle(value)) for column, value in zip(columns, values, strict=True)]
    return build.finish(outputs)


@dataclass(slots=True, eq=False)
class _Follower:
    build: Builder
    depth: int = 0
    cells: Mapping[Any, list[Any]] = field(default_factory=dict[Any, list[Any]])
    program: typed.Program | None = None

    # ---- numbers ----------------------------------------------------------------------------

    def handle(self, value: Any) -> int:
        if isinstance(value, _Number):
            return value.handle
        return self.build.constant(float(value))

    def op(self, name: str, *values: Any) -> Any:
        """One instruction, or its value if all that it takes is known."""
        made = self.build.apply(name, *[self.handle(value) for value in values])
        known = self.build.value(made)
        return _Number(made) if known is None else known

    def select(self, condition: Any, yes: Any, no: Any, span: Span) -> Any:
        if yes is no:
            return yes
        if isinstance(yes, tuple):
            pairs = zip(cast("tuple[Any, ...]", yes), cast("tuple[Any, ...]", no), strict=True)
            parts = [self.select(condition, a, b, span) for a, b in pairs]
            return Color(*parts) if isinstance(yes, Color) else tuple(parts)
        if isinstance(yes, dict):
            record = cast("dict[str, Any]", yes)
            return {name: self.select(condition, value, no[name], span) for name, value in record.items()}
        if not isinstance(yes, (int, float, _Number)) or not isinstance(no, (int, float, _Number)):
            _refuse("this choice depends on the place, but it is not between numbers, vectors or colours", span)
        return self.op("select", condition, yes, no)

    # ---- calls ------------------------------------------------------------------------------

    def call(self, function: Any, arguments: list[Any], span: Span | None) -> Any:
        """A function value with arguments in order."""
        origin: Origin | None = function.origin
        if origin is None:
            _refuse("this function is not one of the script", span)
        if origin.builtin is not None:
            names = [p.name for p in origin.builtin.positional]
            given = dict(zip(names, arguments, strict=False))
            return self.builtin(origin.builtin.name, given, span)
        assert origin.function is not None
        before = self.cells, self.program
        self.cells, self.program = origin.cells, origin.program
        result = self.enter(origin.function, arguments, origin.tail, span)
        self.cells, self.program = before
        return result

    def enter(self, function: typed.Function, arguments: list[Any], tail: Frame, span: Span | None) -> Any:
        self.depth += 1
        if self.depth > _DEEPEST:
            _refuse("its calls are nested too deeply, or never end because their end depends on the place", span)
        missing = [MISSING] * (len(function.parameters) - len(arguments))
        frame: Frame = [*arguments, *missing, *tail]
        for slot, parameter in enumerate(function.parameters):
            if frame[slot] is MISSING and parameter.default is not None:
                frame[slot] = self.expr(parameter.default, frame)
        for statement in function.body.statements:
            self.statement(statement, frame)
        result = self.expr(function.body.result, frame)
        self.depth -= 1
        return result

    def statement(self, node: typed.Statement, frame: Frame) -> None:
        match node:
            case typed.Let(slot, _, value):
                frame[slot] = self.expr(value, frame)
            case typed.Assert(_, _, span):
                _refuse("assertions cannot depend on the place", span)
            case typed.Debug(_, span):
                _refuse("`debug` cannot show what depends on the place", span)

    # ---- expressions ------------------------------------------------------------------------

    def expr(self, node: typed.Expr, frame: Frame) -> Any:
        if self.build.size > MOST:
            _refuse(f"it needs more than {MOST} steps for each place", node.span)
        match node:
            case typed.Constant(value):
                return value
            case typed.Local(slot):
                return frame[slot]
            case typed.Global(definition):
                value = self.cells[definition][0]
                if value is POISON:
                    raise AbsorbedError
                return value
            case typed.Vector(x, y, z):
                return (self.expr(x, frame), self.expr(y, frame), self.expr(z, frame))
            case typed.Record(fields):
                return {name: self.expr(value, frame) for name, value in fields}
            case typed.Field(target, name):
                value = self.expr(target, frame)
                if isinstance(value, dict):
                    return cast("dict[str, Any]", value)[name]
                return value["xyz".index(name)]
            case typed.Unary(_, implementation, operand):
                return self.operator(implementation, [self.expr(operand, frame)], node.span)
            case typed.Binary(_, implementation, left, right):
                return self.operator(implementation, [self.expr(left, frame), self.expr(right, frame)], node.span)
            case typed.And(left, right):
                return self.both("and", self.expr(left, frame), lambda: self.expr(right, frame))
            case typed.Or(left, right):
                return self.both("or", self.expr(left, frame), lambda: self.expr(right, frame))
            case typed.Not(operand):
                value = self.expr(operand, frame)
                return self.op("not", value) if isinstance(value, _Number) else not value
            case typed.If(condition, then, otherwise):
                return self.choice(self.expr(condition, frame), then, otherwise, frame, node.span)
            case typed.Range(lo, hi, half_open):
                return self.range(self.expr(lo, frame), self.expr(hi, frame), half_open, node.span)
            case typed.List(elements):
                return self.elements(elements, frame)
            case typed.Index(target, index):
                return self.index(self.expr(target, frame), self.expr(index, frame), node.span)
            case typed.Convert(value):
                return self.expr(value, frame)
            case typed.Lambda():
                return self.closure(node, frame)
            case typed.FunctionValue(definition, builtin):
                function = self.program.functions[definition] if definition and self.program else None
                tail: Frame = [None] * (function.size - len(function.parameters)) if function else []
                return FunctionValue(_never, origin=Origin(function, tail, self.cells, self.program, builtin))
            case typed.CallFunction(definition, arguments):
                assert self.program is not None
                function = self.program.functions[definition]
                values = [MISSING if a is None else self.expr(a, frame) for a in arguments]
                tail = [None] * (function.size - len(function.parameters))
                return self.enter(function, values, tail, node.span)
            case typed.CallValue(callee, arguments):
                return self.call(self.expr(callee, frame), [self.expr(a, frame) for a in arguments], node.span)
            case typed.CallBuiltin(name, arguments):
                return self.builtin(name, {own: self.expr(value, frame) for own, value in arguments}, node.span)
            case typed.Text() | typed.CallKernel() | typed.Failed():
                _refuse("texts and kernels have no place here", node.span)
        return None

    def both(self, name: str, first: Any, second: Callable[[], Any]) -> Any:
        if not isinstance(first, _Number):
            return second() if bool(first) == (name == "and") else first
        return self.op(name, first, second())

    def choice(self, condition: Any, then: typed.Expr, otherwise: typed.Expr, frame: Frame, span: Span) -> Any:
        if not isinstance(condition, _Number):
            return self.expr(then if condition else otherwise, frame)
        return self.select(condition, self.expr(then, frame), self.expr(otherwise, frame), span)

    def closure(self, node: typed.Lambda, frame: Frame) -> FunctionValue:
        function = node.function
        tail: Frame = [None] * (function.size - len(function.parameters))
        for outer, inner in node.captured:
            tail[inner - len(function.parameters)] = frame[outer]
        return FunctionValue(_never, origin=Origin(function, tail, self.cells, self.program, None))

    # ---- lists ------------------------------------------------------------------------------

    def range(self, lo: Any, hi: Any, half_open: bool, span: Span) -> range:
        if isinstance(lo, _Number) or isinstance(hi, _Number):
            _refuse("this range depends on the place", span)
        made = range(int(lo), int(hi) + (not half_open))
        if len(made) > _LONGEST_LIST:
            _refuse(f"this loop has more than {_LONGEST_LIST} rounds", span)
        return made

    def elements(self, elements: Sequence[typed.Element], frame: Frame) -> list[Any]:
        made: list[Any] = []
        for element in elements:
            match element:
                case typed.Item(value):
                    made.append(self.expr(value, frame))
                case typed.Spread(value, span):
                    made += self.plain(self.expr(value, frame), span)
                case typed.For(index_slot, slot, iterable, body, span):
                    for i, value in enumerate(self.plain(self.expr(iterable, frame), span)):
                        frame[slot] = value
                        if index_slot is not None:
                            frame[index_slot] = i
                        made += self.elements(body, frame)
                case typed.IfElements(condition, then, otherwise, span):
                    test = self.expr(condition, frame)
                    if isinstance(test, _Number):
                        _refuse("what a list holds cannot depend on the place", span)
                    made += self.elements(then if test else otherwise, frame)
                case _:
                    self.statement(element, frame)
        return made

    def plain(self, values: Any, span: Span | None) -> list[Any]:
        if len(values) > _LONGEST_LIST:
            _refuse(f"this list has more than {_LONGEST_LIST} elements", span)
        if isinstance(values, np.ndarray):
            rows = cast("list[Any]", values.tolist())
            return [tuple(cast("list[Any]", row)) if isinstance(row, list) else row for row in rows]
        return list(values)

    def index(self, values: Any, at: Any, span: Span) -> Any:
        items = self.plain(values, span)
        if not isinstance(at, _Number):
            if not 0 <= at < len(items):
                _refuse(f"there is no element {at}", span)
            return items[int(at)]
        if not 0 < len(items) <= _MOST_CHOICES:
            _refuse(f"a list that is looked up by place has 1 to {_MOST_CHOICES} elements", span)
        result = items[-1]
        for i in reversed(range(len(items) - 1)):
            result = self.select(self.op("less", at, i + 0.5), items[i], result, span)
        return result

    # ---- operators --------------------------------------------------------------------------

    def operator(self, name: str, values: list[Any], span: Span) -> Any:
        if name in ("equal", "not_equal"):
            same = self.equal(values[0], values[1], span)
            if name == "equal":
                return same
            return self.op("not", same) if isinstance(same, _Number) else not same
        base = name.removesuffix("_int")
        if base.endswith("_vec3") or base == "scale_vec3_left":
            return self.vector_operator(base, values)
        if base.endswith("_field") or base == "scale_field_left":
            _refuse("fields have no place here", span)
        if base in ("greater", "greater_equal"):
            return self.op("less" + base.removeprefix("greater"), values[1], values[0])
        return self.op(base, *values)

    def vector_operator(self, name: str, values: list[Any]) -> Vector:
        match name:
            case "scale_vec3_left":
                return self.each("multiply", values[1], values[0])
            case "scale_vec3":
                return self.each("multiply", values[0], values[1])
            case "divide_vec3":
                return self.each("divide", values[0], values[1])
            case "negate_vec3":
                x, y, z = values[0]
                return (self.op("negate", x), self.op("negate", y), self.op("negate", z))
            case _:
                pairs = zip(values[0], values[1], strict=True)
                x, y, z = [self.op(name.removesuffix("_vec3"), a, b) for a, b in pairs]
                return (x, y, z)

    def each(self, name: str, v: Vector, k: Any) -> Vector:
        return (self.op(name, v[0], k), self.op(name, v[1], k), self.op(name, v[2], k))

    def equal(self, a: Any, b: Any, span: Span) -> Any:
        if isinstance(a, tuple):
            result: Any = True
            for x, y in zip(cast("tuple[Any, ...]", a), b, strict=True):
                result = self.both("and", result, lambda x=x, y=y: self.equal(x, y, span))
            return result
        if isinstance(a, _Number) or isinstance(b, _Number):
            return self.op("equal", a, b)
        return a == b

    # ---- built-ins --------------------------------------------------------------------------

    def builtin(self, name: str, given: dict[str, Any], span: Span | None) -> Any:
        values = list(given.values())
        if name in _OPERATIONS:
            return self.op(_OPERATIONS[name], *values)
        if name in _METHODS:
            return _METHODS[name](self, given, span)
        if name in ("pi", "time", "phase"):
            _refuse(f"give `{name}` a name outside of the function", span) if name != "pi" else None
            return math.pi
        return _refuse(f"`{name}` cannot be computed at every place of a surface", span)

    def dot(self, a: Vector, b: Vector) -> Any:
        x, y, z = [self.op("multiply", p, q) for p, q in zip(a, b, strict=True)]
        return self.op("add", self.op("add", x, y), z)


def _never(frame: Frame) -> NoReturn:
    raise AssertionError("a followed function is not run")


def _refuse(reason: str, span: Span | None) -> NoReturn:
    raise FailureError(
        Diagnostic(
            "E0407",
            "this function cannot give a material its looks: " + reason,
            span,
            "cannot be followed",
            helps=(Help("use arithmetic, choices, `noise` and the other functions of numbers and vectors"),),
        )
    )


# ---- built-ins by name --------------------------------------------------------------------------

#: Built-ins that are one instruction.
_OPERATIONS: Mapping[str, str] = {
    name: name for name in ("abs", "floor", "ceil", "mod", "sqrt", "exp", "log", "sin", "cos", "tan", "asin")
} | {"acos": "acos", "atan": "atan", "atan2": "atan2"}

Method = Callable[[_Follower, dict[str, Any], "Span | None"], Any]


def _sign(f: _Follower, given: dict[str, Any], span: Span | None) -> Any:
    x = given["x"]
    return f.op("subtract", f.op("less", 0.0, x), f.op("less", x, 0.0))


def _round(f: _Follower, given: dict[str, Any], span: Span | None) -> Any:
    size = f.op("abs", given["x"])
    down = f.op("floor", size)
    up = f.op("less_equal", 0.5, f.op("subtract", size, down))
    return f.op("multiply", f.op("add", down, up), _sign(f, given, span))


def _clamp(f: _Follower, given: dict[str, Any], span: Span | None) -> Any:
    return f.op("min", f.op("max", given["x"], given["lo"]), given["hi"])


def _lerp(f: _Follower, given: dict[str, Any], span: Span | None) -> Any:
    a, b, t = given["a"], given["b"], given["t"]
    if isinstance(a, tuple):
        pairs = zip(cast("tuple[Any, ...]", a), b, strict=True)
        parts = [_lerp(f, {"a": x, "b": y, "t": t}, span) for x, y in pairs]
        return Color(*parts) if isinstance(a, Color) else tuple(parts)
    return f.op("add", f.op("multiply", f.op("subtract", 1.0, t), a), f.op("multiply", t, b))


def _extreme(name: str) -> Method:
    def method(f: _Follower, given: dict[str, Any], span: Span | None) -> Any:
        values = [given["first"], *given.get("rest", [])] if "first" in given else f.plain(given["list"], span)
        if not values:
            _refuse(f"an empty list has no {name}", span)
        result = values[0]
        for value in values[1:]:
            result = f.op(name, result, value)
        return result

    return method


def _dot(f: _Follower, given: dict[str, Any], span: Span | None) -> Any:
    return f.dot(given["a"], given["b"])


def _cross(f: _Follower, given: dict[str, Any], span: Span | None) -> Vector:
    a, b = given["a"], given["b"]
    x, y, z = [
        f.op("subtract", f.op("multiply", a[i], b[j]), f.op("multiply", a[j], b[i]))
        for i, j in ((1, 2), (2, 0), (0, 1))
    ]
    return (x, y, z)


def _length(f: _Follower, given: dict[str, Any], span: Span | None) -> Any:
    return f.op("sqrt", f.dot(given["v"], given["v"]))


def _normalize(f: _Follower, given: dict[str, Any], span: Span | None) -> Vector:
    return f.each("divide", given["v"], _length(f, given, span))


def _noise(f: _Follower, given: dict[str, Any], span: Span | None) -> Any:
    x, y, z = given["p"]
    return f.op("noise", x, y, z, given.get("seed", 0))


def _rand(f: _Follower, given: dict[str, Any], span: Span | None) -> Any:
    return f.op("rand", given["i"], given.get("seed", 0))


def _unit(f: _Follower, x: Any) -> Any:
    return f.op("min", f.op("max", x, 0.0), 1.0)


def _color(parts: list[Any]) -> Color:
    return Color(parts[0], parts[1], parts[2])


def _rgb(f: _Follower, given: dict[str, Any], span: Span | None) -> Color:
    return _color([f.op("linear", given[name]) for name in "rgb"])


def _hsl(f: _Follower, given: dict[str, Any], span: Span | None) -> Color:
    """As in builtins."""
    h, s, l = given["h"], _unit(f, given["s"]), _unit(f, given["l"])  # noqa: E741
    turn = f.op("mod", f.op("multiply", h, 12 / math.tau), 12.0)
    half = f.op("multiply", s, f.op("min", l, f.op("subtract", 1.0, l)))
    parts: list[Any] = []
    for n in (0, 8, 4):
        k = f.op("mod", f.op("add", turn, float(n)), 12.0)
        rise = f.op("min", f.op("min", f.op("subtract", k, 3.0), f.op("subtract", 9.0, k)), 1.0)
        parts.append(f.op("linear", f.op("subtract", l, f.op("multiply", half, f.op("max", rise, -1.0)))))
    return _color(parts)


def _oklch(f: _Follower, given: dict[str, Any], span: Span | None) -> Color:
    from blobscript.builtins import LMS_TO_RGB, OKLAB_TO_LMS

    u = f.op("multiply", given["c"], f.op("cos", given["h"]))
    v = f.op("multiply", given["c"], f.op("sin", given["h"]))
    lms: list[Any] = []
    for row in OKLAB_TO_LMS:
        x = f.dot((_unit(f, given["l"]), u, v), row)
        lms.append(f.op("multiply", x, f.op("multiply", x, x)))
    return _color([_unit(f, f.dot(row, (lms[0], lms[1], lms[2]))) for row in LMS_TO_RGB])


def _len(f: _Follower, given: dict[str, Any], span: Span | None) -> int:
    return len(next(iter(given.values())))


def _map(f: _Follower, given: dict[str, Any], span: Span | None) -> list[Any]:
    return [f.call(given["with"], [value], span) for value in f.plain(given["list"], span)]


def _fold(f: _Follower, given: dict[str, Any], span: Span | None) -> Any:
    result = given["start"]
    for value in f.plain(given["list"], span):
        result = f.call(given["with"], [result, value], span)
    return result


_METHODS: Mapping[str, Method] = {
    "sign": _sign,
    "round": _round,
    "clamp": _clamp,
    "lerp": _lerp,
    "max": _extreme("max"),
    "min": _extreme("min"),
    "dot": _dot,
    "cross": _cross,
    "length": _length,
    "normalize": _normalize,
    "noise": _noise,
    "rand": _rand,
    "rgb": _rgb,
    "hsl": _hsl,
    "oklch": _oklch,
    "len": _len,
    "map": _map,
    "fold": _fold,
}
