"""Kernels that were waived from proof: polynomials in s through samples, as smooth as they come.

The kernel is then what these pieces say, and what the tracer relies on is exact for them: where a
polynomial is monotone, convex or concave is decided in rational arithmetic. Only how well they
follow the written formula is measured instead of proved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np

from blobscript import exact, syntax
from blobscript.formulas import Formula, Labelled, arguments_of, call_parts, callees, lambda_of, named
from blobscript.ir import Kernel, KernelPiece
from blobscript.kernel_pieces import lipschitz_bound

__all__ = ["sampled_kernel"]

_POINTS = 13
_CLOSE = 2e-14
_NARROW = 2.0**-40
_MOST_PARTS = 128


class _ValueError(Exception):
    """No number at some r."""


def sampled_kernel(
    name: str,
    body: syntax.Expr,
    variable: str,
    values: Mapping[str, float | int],
    formulas: Mapping[str, Formula] | None = None,
) -> tuple[Kernel | None, str]:
    """The kernel, or why there is none."""
    scope = _Scope(values, formulas or {})

    def density(s: float) -> float:
        result = _number(body, scope.extended({variable: math.sqrt(s)}))
        if not math.isfinite(result):
            raise _ValueError(f"D({math.sqrt(s):.3g}) is not finite")
        return result

    try:
        first, last = density(0.0), density(1.0)
        if abs(first - 1.0) > 1e-12 or abs(last) > 1e-12:
            return None, f"D(0) = {first:.4g} and D(1) = {last:.4g}"
        pieces, error = _pieces(density)
    except _ValueError as failure:
        return None, str(failure)
    except (ValueError, ZeroDivisionError, OverflowError):
        return None, "it has no value at some r"
    return Kernel(name, pieces=tuple(pieces), lipschitz=lipschitz_bound(pieces), error=error), ""


# ---- pieces -----------------------------------------------------------------------------------------


def _pieces(density: Callable[[float], float]) -> tuple[list[KernelPiece], float]:
    parts: list[tuple[list[float], float, float]] = []
    stack, error = [(0.0, 1.0)], 0.0
    while stack:
        lo, hi = stack.pop()
        coefficients, own = _interpolated(density, lo, hi)
        if own > _CLOSE and hi - lo > _NARROW:
            middle = 0.5 * (lo + hi)
            stack += [(middle, hi), (lo, middle)]
            continue
        if own > 1e-6:
            raise _ValueError(f"it jumps near r = {math.sqrt(lo):.3g}")
        error = max(error, own)
        parts.append((coefficients, lo, hi))
        if len(parts) > _MOST_PARTS:
            raise _ValueError("it needs too many polynomial pieces")
    return [piece for part in parts for piece in _cut(*part)], error + _CLOSE


def _interpolated(density: Callable[[float], float], lo: float, hi: float) -> tuple[list[float], float]:
    """Through Chebyshev points in s, in x = (s - centre) / half; the largest error between them."""
    centre, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
    count = _POINTS if hi - lo > _NARROW else 2
    nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count) if count > 2 else np.array([-1.0, 1.0])
    samples = np.array([density(centre + half * float(x)) for x in nodes])
    series = np.polynomial.chebyshev.Chebyshev.fit(nodes, samples, count - 1, domain=[-1, 1])
    coefficients = series.convert(kind=np.polynomial.Polynomial).coef.tolist()
    probes = np.linspace(-1.0, 1.0, 4 * count + 1)
    exact_values = np.array([density(min(max(centre + half * float(x), lo), hi)) for x in probes])
    return coefficients, float(np.max(np.abs(np.polynomial.polynomial.polyval(probes, coefficients) - exact_values)))


def _cut(coefficients: list[float], lo: float, hi: float) -> list[KernelPiece]:
    """At the extrema and inflections of the polynomial, found exactly."""
    p = exact.trimmed([Fraction(c) for c in coefficients])
    slope = exact.signs(exact.derivative(p), Fraction(-1), Fraction(1))
    bend = exact.signs(exact.derivative(exact.derivative(p)), Fraction(-1), Fraction(1))
    places = sorted({x for part in slope + bend for x in part[:2]})
    centre, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
    pieces: list[KernelPiece] = []
    for a, b in pairwise(places):
        r_lo, r_hi = (math.sqrt(max(centre + half * float(x), 0.0)) for x in (a, b))
        if r_lo < r_hi:
            convex = next(s for u, v, s in bend if u <= (a + b) / 2 <= v)
            falling = next(s for u, v, s in slope if u <= (a + b) / 2 <= v) <= 0
            piece = KernelPiece(r_lo, r_hi, "s", centre, half, tuple(coefficients), convex, falling)  # pyright: ignore[reportArgumentType]
            pieces.append(piece)
    return pieces


# ---- the formula in floating point ------------------------------------------------------------------------


def _sign(x: float) -> int:
    return (x > 0) - (x < 0)


def _half_away(x: float) -> float:
    return math.copysign(math.floor(abs(x) + 0.5), x)


def _mod(x: float, by: float) -> float:
    return x - by * math.floor(x / by)


def _clamp(x: float, lo: float, hi: float) -> float:
    return min(max(x, lo), hi)


def _lerp(a: float, b: float, t: float) -> float:
    return a + (b - a) * t


_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": abs,
    "sign": _sign,
    "floor": math.floor,
    "ceil": math.ceil,
    "round": _half_away,
    "mod": _mod,
    "sqrt": math.sqrt,
    "exp": math.exp,
    "log": math.log,
    "clamp": _clamp,
    "lerp": _lerp,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "atan2": math.atan2,
    "min": min,
    "max": max,
}

_OPERATORS: Mapping[str, Callable[[float, float], float]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "^": math.pow,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "==": lambda a, b: a == b,
    "!=": lambda a, b: a != b,
}


@dataclass(frozen=True, slots=True)
class _Closure:
    """A function, and what names mean in its body."""

    parameters: tuple[syntax.Parameter, ...]
    statements: tuple[syntax.Let | syntax.Assert | syntax.Debug, ...]
    body: syntax.Expr
    scope: _Scope


@dataclass(frozen=True, slots=True)
class _Scope:
    values: Mapping[str, Any]
    formulas: Mapping[str, Formula]

    def extended(self, values: Mapping[str, Any]) -> _Scope:
        return _Scope({**self.values, **values}, self.formulas)


def _number(node: syntax.Expr, scope: _Scope) -> float:
    value = _evaluated(node, scope)
    if isinstance(value, _Closure):
        raise _ValueError("it is a function, not a number")
    return value


def _evaluated(node: syntax.Expr, scope: _Scope) -> Any:
    """A number, 0 or 1 for a condition, or a function."""
    values = scope.values
    match node:
        case syntax.Number(value) | syntax.Bool(value):
            return float(value)
        case syntax.Angle(value, unit):
            return value * {"deg": math.pi / 180.0, "rad": 1.0, "turn": 2.0 * math.pi}[unit]
        case syntax.Name(text) if text in values:
            return values[text] if isinstance(values[text], _Closure) else float(values[text])
        case syntax.Member(syntax.Name(module), name) if f"{module}.{name.text}" in values:
            return float(values[f"{module}.{name.text}"])
        case syntax.Name("pi"):
            return math.pi
        case syntax.Group(inner):
            return _evaluated(inner, scope)
        case syntax.Unary(op, operand):
            inner = _number(operand, scope)
            return -inner if op == "-" else float(not inner)
        case syntax.IfExpr(condition, then, otherwise):
            return _evaluated(then if _number(condition, scope) else otherwise, scope)
        case syntax.Binary("and" | "or" as op, left, right):
            first = _number(left, scope)
            return first if bool(first) == (op == "or") else _number(right, scope)
        case syntax.Binary(op, left, right):
            return float(_OPERATORS[op](_number(left, scope), _number(right, scope)))
        case syntax.Call(_, _, None):
            return _call(node, scope)
        case _:
            closure = _closure(node, scope)
            if closure is None:
                raise _ValueError("it uses more than numbers and functions of numbers")
            return closure


def _call(node: syntax.Call, scope: _Scope) -> Any:
    for callee, given in callees(node):
        closure = _closure(callee, scope)
        if closure is not None:
            return _called(closure, given, scope)
    name, given = call_parts(node)
    if name not in _FUNCTIONS:
        raise _ValueError("it uses more than numbers and functions of numbers")
    return float(_FUNCTIONS[name](*(_number(argument, scope) for _, argument in given)))


def _closure(node: syntax.Expr, scope: _Scope) -> _Closure | None:
    """The function of the script that an expression is."""
    own = lambda_of(node)
    if own is not None:
        return _Closure(own.parameters, (), own.body, scope)
    if isinstance(node, syntax.Name) and node.text in scope.values:
        known = scope.values[node.text]
        return known if isinstance(known, _Closure) else None
    formula = named(node, scope.formulas)
    if formula is None:
        return None
    if formula.recursive:
        raise _ValueError(f"`{formula.name}` calls itself")
    return _Closure(formula.parameters, formula.statements, formula.body, _Scope(formula.values, formula.formulas))


def _called(closure: _Closure, given: list[Labelled], outer: _Scope) -> Any:
    inner = closure.scope
    for parameter, argument in arguments_of(closure.parameters, given):
        node, scope = (argument, outer) if argument is not None else (parameter.default, inner)
        assert node is not None
        inner = inner.extended({parameter.name.text: _evaluated(node, scope)})
    for statement in closure.statements:
        if isinstance(statement, syntax.Let):
            inner = inner.extended({statement.name.text: _evaluated(statement.value, inner)})
        elif isinstance(statement, syntax.Assert) and not _number(statement.condition, inner):
            raise _ValueError("an assertion in it fails")
    return _evaluated(closure.body, inner)
