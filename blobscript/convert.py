"""Where an int stands for a number: at any depth, the value becomes a float."""

from __future__ import annotations

from blobscript import typed
from blobscript.types import INT, NUMBER, FnOf, ListOf, OneOf, RecordOf, Type, fits

__all__ = ["converted", "needs_conversion"]


def converted(expr: typed.Expr, wanted: Type) -> typed.Expr:
    """The expression as a value of the wanted type, which it fits."""
    if isinstance(wanted, OneOf):
        wanted = _fitting(expr.type, wanted)
    if not needs_conversion(expr.type, wanted):
        return expr
    if isinstance(expr, typed.Constant) and expr.type == INT:
        return typed.Constant(float(expr.value), NUMBER, expr.span)
    return typed.Convert(expr, wanted, expr.span)


def _fitting(actual: Type, wanted: OneOf) -> Type:
    """The alternative that is meant: the exact one, or the first that fits."""
    exact = [option for option in wanted.options if option == actual]
    near = [option for option in wanted.options if fits(actual, option)]
    return (exact or near or [actual])[0]


def needs_conversion(actual: Type, wanted: Type) -> bool:
    match actual, wanted:
        case _ if actual == wanted:
            return False
        case (_, _) if actual == INT:
            return wanted == NUMBER
        case ListOf(own), ListOf(element):
            return needs_conversion(own, element)
        case RecordOf(), RecordOf(fields):
            return any(needs_conversion(own, kind) for name, kind in fields if (own := actual.field(name)) is not None)
        case FnOf(own, result), FnOf(parameters, wanted_result):
            return needs_conversion(result, wanted_result) or any(
                needs_conversion(given, taken) for taken, given in zip(own, parameters, strict=False)
            )
        case _:
            return False
