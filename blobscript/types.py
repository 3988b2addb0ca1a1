"""The types of the language and how they relate.

`fits` says whether a value may stand where a type is wanted (an int fits a number, a list of ints
a list of numbers, a record with more fields a record with fewer). `join` is the type of a list or
of an `if` whose parts have different types. `match` is `fits` for the patterns of signatures,
which contain variables and alternatives.

ERROR is the type of what was reported already: it fits everywhere and everything fits it, so that
one mistake gives one message. NOTHING is the element type of the empty list.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

__all__ = [
    "ANGLE",
    "BOOL",
    "COLOR",
    "ERROR",
    "FIELD",
    "INT",
    "KERNEL",
    "NOTHING",
    "NUMBER",
    "PRIMITIVES",
    "RANGE",
    "TEXT",
    "VEC3",
    "Choice",
    "ErrorType",
    "FnOf",
    "ListOf",
    "NothingType",
    "OneOf",
    "Primitive",
    "RecordOf",
    "Type",
    "Variable",
    "article",
    "closed",
    "describe",
    "fits",
    "has_error",
    "is_open",
    "join",
    "match",
    "plural",
    "substitute",
    "variables",
]


@dataclass(frozen=True, slots=True)
class Primitive:
    name: str


@dataclass(frozen=True, slots=True)
class Choice:
    """A text that is one of these."""

    values: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ListOf:
    element: Type


@dataclass(frozen=True, slots=True)
class RecordOf:
    """Structural: two records with equal fields have one type, whatever the order."""

    fields: tuple[tuple[str, Type], ...]

    def field(self, name: str) -> Type | None:
        for own, kind in self.fields:
            if own == name:
                return kind
        return None


@dataclass(frozen=True, slots=True)
class FnOf:
    parameters: tuple[Type, ...]
    result: Type


@dataclass(frozen=True, slots=True)
class OneOf:
    """Alternatives; only in signatures."""

    options: tuple[Type, ...]


@dataclass(frozen=True, slots=True)
class Variable:
    """A type that each call chooses; only in signatures. `allowed` empty: any."""

    name: str
    allowed: tuple[Type, ...] = ()


@dataclass(frozen=True, slots=True)
class ErrorType:
    pass


@dataclass(frozen=True, slots=True)
class NothingType:
    pass


Type = Primitive | Choice | ListOf | RecordOf | FnOf | OneOf | Variable | ErrorType | NothingType

NUMBER = Primitive("number")
INT = Primitive("int")
ANGLE = Primitive("angle")
BOOL = Primitive("bool")
TEXT = Primitive("text")
VEC3 = Primitive("vec3")
COLOR = Primitive("color")
KERNEL = Primitive("kernel")
FIELD = Primitive("field")
#: Ranges of numbers and angles, which only say what is allowed (`in 0.5..2`); a range of ints is a [int].
RANGE = Primitive("range")
ERROR = ErrorType()
NOTHING = NothingType()

#: Word in a script -> type.
PRIMITIVES: dict[str, Primitive] = {
    kind.name: kind
    for kind in (
        NUMBER,
        INT,
        ANGLE,
        BOOL,
        TEXT,
        VEC3,
        COLOR,
        KERNEL,
        FIELD,
        *map(
            Primitive,
            (
                *("skeleton", "surface", "material", "light", "camera", "background", "stage", "image"),
                *("animate", "transform"),
            ),
        ),
    )
}


# ---- relations ------------------------------------------------------------------------


def fits(actual: Type, wanted: Type) -> bool:
    """May a value of the one type stand where the other is wanted?"""
    return match(wanted, actual, {})


def match(wanted: Type, actual: Type, bound: dict[str, Type]) -> bool:
    """`fits` for a pattern; binds its variables (also when the answer is no)."""
    if wanted is actual:
        return True
    match actual:
        case ErrorType() | NothingType():
            return not isinstance(wanted, Variable) or _match_variable(wanted, actual, bound)
        case OneOf(options):
            return all(match(wanted, option, bound) for option in options)
        case _:
            pass
    match wanted:
        case ErrorType():
            return True
        case NothingType():
            return False
        case Primitive():
            return _fits_primitive(actual, wanted)
        case Choice(values):
            return isinstance(actual, Choice) and set(actual.values) <= set(values)
        case ListOf(element):
            return isinstance(actual, ListOf) and match(element, actual.element, bound)
        case RecordOf():
            return _match_record(wanted, actual, bound)
        case FnOf():
            return _match_function(wanted, actual, bound)
        case OneOf(options):
            return any(match(option, actual, bound) for option in options)
        case Variable():
            return _match_variable(wanted, actual, bound)
        case _:
            assert_never(wanted)


def _fits_primitive(actual: Type, wanted: Primitive) -> bool:
    if isinstance(actual, Choice):
        return wanted == TEXT
    return actual == wanted or (wanted == NUMBER and actual == INT)


def _match_record(wanted: RecordOf, actual: Type, bound: dict[str, Type]) -> bool:
    if not isinstance(actual, RecordOf):
        return False
    for name, kind in wanted.fields:
        own = actual.field(name)
        if own is None or not match(kind, own, bound):
            return False
    return True


def _match_function(wanted: FnOf, actual: Type, bound: dict[str, Type]) -> bool:
    """A function fits if it takes what it will be given; variables bind to what it takes."""
    if not isinstance(actual, FnOf) or len(actual.parameters) != len(wanted.parameters):
        return False
    for own, given in zip(actual.parameters, wanted.parameters, strict=True):
        pattern = substitute(given, bound)
        if not (match(pattern, own, bound) if isinstance(pattern, Variable) else fits(pattern, own)):
            return False
    return match(wanted.result, actual.result, bound)


def _match_variable(wanted: Variable, actual: Type, bound: dict[str, Type]) -> bool:
    before = bound.get(wanted.name)
    joined = actual if before is None else join(before, actual)
    if joined is None:
        return False
    if not wanted.allowed or isinstance(joined, (ErrorType, NothingType)):
        bound[wanted.name] = joined
        return True
    for option in wanted.allowed:
        if fits(joined, option):
            bound[wanted.name] = option
            return True
    return False


def join(a: Type, b: Type) -> Type | None:
    """The smallest type that both fit; None if there is none."""
    if a == b or isinstance(b, (ErrorType, NothingType)):
        return a if not isinstance(b, ErrorType) else b
    if isinstance(a, (ErrorType, NothingType)):
        return a if isinstance(a, ErrorType) else b
    match a, b:
        case Choice(one), Choice(two):
            return Choice(tuple(dict.fromkeys(one + two)))
        case ListOf(one), ListOf(two):
            element = join(one, two)
            return None if element is None else ListOf(element)
        case RecordOf(), RecordOf():
            return _join_records(a, b)
        case _:
            if fits(a, b):
                return b
            return a if fits(b, a) else None


def _join_records(a: RecordOf, b: RecordOf) -> RecordOf | None:
    if {name for name, _ in a.fields} != {name for name, _ in b.fields}:
        return None
    fields: list[tuple[str, Type]] = []
    for name, kind in a.fields:
        other = b.field(name)
        joined = join(kind, other) if other is not None else None
        if joined is None:
            return None
        fields.append((name, joined))
    return RecordOf(tuple(fields))


def closed(pattern: Type, bound: dict[str, Type]) -> Type:
    """The pattern without variables: those that nothing has bound absorb."""
    kind = substitute(pattern, bound)
    return substitute(kind, _Absorbing()) if is_open(kind) else kind


class _Absorbing(dict[str, "Type"]):
    def get(self, key: str, default: object = None) -> Type:  # type: ignore[override]
        return ERROR


def substitute(pattern: Type, bound: dict[str, Type]) -> Type:
    """The pattern with its bound variables filled in."""
    match pattern:
        case Variable(name):
            return bound.get(name, pattern)
        case ListOf(element):
            return ListOf(substitute(element, bound))
        case RecordOf(fields):
            return RecordOf(tuple([(name, substitute(kind, bound)) for name, kind in fields]))
        case FnOf(parameters, result):
            return FnOf(tuple([substitute(p, bound) for p in parameters]), substitute(result, bound))
        case OneOf(options):
            return OneOf(tuple([substitute(option, bound) for option in options]))
        case _:
            return pattern


def has_error(kind: Type) -> bool:
    """Was something about this type reported already?"""
    match kind:
        case ErrorType():
            return True
        case ListOf(element):
            return has_error(element)
        case RecordOf(fields):
            return any(has_error(field) for _, field in fields)
        case FnOf(parameters, result):
            return has_error(result) or any(has_error(p) for p in parameters)
        case _:
            return False


def is_open(kind: Type) -> bool:
    """Are there variables in it?"""
    return bool(variables(kind))


def variables(kind: Type) -> frozenset[str]:
    """The names of the variables in it."""
    match kind:
        case Variable(name):
            return frozenset((name,))
        case ListOf(element):
            return variables(element)
        case RecordOf(fields):
            return frozenset[str]().union(*[variables(field) for _, field in fields])
        case FnOf(parameters, result):
            return variables(result).union(*[variables(p) for p in parameters])
        case OneOf(options):
            return frozenset[str]().union(*[variables(option) for option in options])
        case _:
            return frozenset()


# ---- in words -------------------------------------------------------------------------


def describe(kind: Type) -> str:
    """The type as one writes it in a script."""
    match kind:
        case Primitive(name):
            return name
        case Choice(values):
            return " | ".join([f'"{value}"' for value in values])
        case ListOf(element):
            return f"[{describe(element)}]"
        case RecordOf(fields):
            return "(" + ", ".join([f"{name}: {describe(field)}" for name, field in fields]) + ")"
        case FnOf(parameters, result):
            return "(" + ", ".join([describe(p) for p in parameters]) + ") -> " + describe(result)
        case OneOf(options):
            return " | ".join([describe(option) for option in options])
        case Variable(name, allowed):
            return " | ".join([describe(option) for option in allowed]) if allowed else name
        case ErrorType() | NothingType():
            return "anything"
        case _:
            assert_never(kind)


_PLURALS = {"skeleton": "skeletons", "vec3": "vectors", "text": "texts", "light": "lights", "animate": "films"}


def plural(kind: Type) -> str:
    """Many of them, in words: `numbers`, `lists of numbers`."""
    match kind:
        case Primitive(name):
            return _PLURALS.get(name, {"color": "colours", "int": "whole numbers"}.get(name, name + "s"))
        case Choice():
            return "texts"
        case ListOf(element):
            return "lists of " + plural(element)
        case RecordOf():
            return "records " + describe(kind)
        case FnOf():
            return "functions"
        case OneOf(options):
            return " or ".join([plural(option) for option in options])
        case Variable(allowed=allowed):
            return " or ".join([plural(option) for option in allowed]) if allowed else "values"
        case ErrorType() | NothingType():
            return "values"
        case _:
            assert_never(kind)


_ARTICLES = {
    "int": "a whole number",
    "vec3": "a vec3",
    "color": "a colour",
    "animate": "an animation",
    "range": "a range",
}


def article(kind: Type) -> str:
    """One of them, in words: `a number`, `an angle`, `a list of numbers`."""
    match kind:
        case Primitive(name):
            return _ARTICLES.get(name, ("an " if name[0] in "aeiou" else "a ") + name)
        case Choice(values):
            return "one of " + ", ".join([f'"{value}"' for value in values])
        case ListOf(NothingType()):
            return "an empty list"
        case ListOf(element):
            return "a list of " + plural(element)
        case RecordOf():
            return "a record " + describe(kind)
        case FnOf():
            return "a function " + describe(kind)
        case OneOf(options):
            return " or ".join([article(option) for option in options])
        case Variable(allowed=allowed):
            return " or ".join([article(option) for option in allowed]) if allowed else "a value"
        case ErrorType() | NothingType():
            return "a value"
        case _:
            assert_never(kind)
