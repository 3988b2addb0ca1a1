"""How type errors are put into words: the E03 messages of values that do not fit their place.

A `Place` says what wants the value; the value is named as the script has it (`35`, "a point",
"`size`"). Messages stand alone, labels say what the marked text is.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from blobscript import syntax
from blobscript.css import CSS_COLORS
from blobscript.diagnostics import Diagnostic, Edit, Help, Label
from blobscript.signatures import BUILTINS
from blobscript.source import Span
from blobscript.suggest import closest
from blobscript.types import (
    ANGLE,
    COLOR,
    FIELD,
    INT,
    KERNEL,
    NUMBER,
    TEXT,
    VEC3,
    FnOf,
    ListOf,
    OneOf,
    Primitive,
    RecordOf,
    Type,
    article,
    describe,
    fits,
    plural,
)

__all__ = [
    "Place",
    "argument",
    "declared",
    "element_of_block",
    "mismatch",
    "short",
    "subject",
    "top_level_item",
]


@dataclass(frozen=True, slots=True)
class Place:
    """What wants a value: `says` opens the message ("`rotate` wants"), `for_what` closes the wish (" for `y`")."""

    says: str
    for_what: str = ""
    notes: tuple[str, ...] = ()
    labels: tuple[Label, ...] = ()


def argument(callee: str, name: str, notes: tuple[str, ...] = ()) -> Place:
    return Place(f"`{callee}` wants", f" for `{name}`", notes)


def declared(name: str, span: Span) -> Place:
    return Place(f"`{name}` is declared as", "", (), (Label(span, "declared here"),))


# ---- the value in words -----------------------------------------------------------------


def short(node: object) -> str | None:
    """The text of a small literal, for messages."""
    match node:
        case syntax.Number() | syntax.Angle() | syntax.Color() | syntax.Text() | syntax.Bool():
            return node.span.text if len(node.span.text) <= 24 and "\n" not in node.span.text else None
        case syntax.Unary("-", syntax.Number() | syntax.Angle()):
            return node.span.text
        case syntax.Group(inner):
            return short(inner)
        case _:
            return None


def subject(node: object, actual: Type) -> str:
    """The value and what it is: "35 is a plain number", "a point is a skeleton", "`size` is a text"."""
    what = "a plain number" if actual in (NUMBER, INT) else article(actual)
    text = short(node)
    if text is not None:
        return f"{text} is {what}"
    match node:
        case syntax.Call(syntax.Name(name)) if isinstance(actual, Primitive) and actual.name != name:
            return f"{'an' if name[0] in 'aeiou' else 'a'} {name} is {what}"
        case syntax.Name(name):
            return f"`{name}` is {what}"
        case syntax.Member(_, syntax.Name(name)):
            return f"`{name}` is {what}"
        case syntax.Group(inner):
            return subject(inner, actual)
        case _:
            return f"this is {what}"


_SKELETON = "a place without thickness"


def label_for(actual: Type) -> str:
    """What stands under the marked value."""
    match actual:
        case Primitive("int"):
            return "number"
        case Primitive("skeleton"):
            return f"skeleton: {_SKELETON}"
        case Primitive("color"):
            return "colour"
        case ListOf():
            return article(actual).removeprefix("a ").removeprefix("an ")
        case RecordOf() | FnOf() | OneOf():
            return article(actual).removeprefix("a ")
        case _:
            return describe(actual)


# ---- E0301, E0304 -----------------------------------------------------------------------


def mismatch(node: syntax.Expr, actual: Type, wanted: Type, place: Place) -> Diagnostic:
    """A value whose type does not fit its place."""
    if fits(actual, NUMBER) and _wants(wanted, ANGLE):
        return _number_for_angle(node, actual, wanted, place)
    if fits(actual, ANGLE) and (_wants(wanted, NUMBER) or wanted == INT):
        return _angle_for_number(node, actual, wanted, place)
    return Diagnostic(
        "E0304",
        f"{place.says} {article(wanted)}{place.for_what}, but {subject(node, actual)}",
        node.span,
        label_for(actual),
        place.labels,
        _remedies(node, actual, wanted),
        (*place.notes, *_missing_fields(actual, wanted)),
    )


def _wants(wanted: Type, one: Type) -> bool:
    return fits(one, wanted)


#: Whoever writes this thinks in radians.
_PI = re.compile(r"\bpi\b|3\.14")

_UNITS = "angles are the only numbers with a unit: deg, rad or turn"


def _number_for_angle(node: syntax.Expr, actual: Type, wanted: Type, place: Place) -> Diagnostic:
    literal = short(node)
    if literal is not None and not isinstance(node, syntax.Group):
        help_ = Help("write the unit", (Edit(node.span.at_end, "deg"),))
    else:
        unit = "rad" if _PI.search(node.span.text) else "deg"
        help_ = Help("multiply by the unit: 1deg, 1rad or 1turn", (wrap(node, f" * 1{unit}"),))
    return Diagnostic(
        "E0301",
        f"{place.says} {article(wanted)}{place.for_what}, but {subject(node, actual)}",
        node.span,
        "number",
        place.labels,
        (help_,),
        (_UNITS,),
    )


def _angle_for_number(node: syntax.Expr, actual: Type, wanted: Type, place: Place) -> Diagnostic:
    return Diagnostic(
        "E0301",
        f"{place.says} {article(wanted)}{place.for_what}, but {subject(node, actual)}",
        node.span,
        "angle",
        place.labels,
        (Help("divide by a unit to get the plain number of degrees", (wrap(node, " / 1deg"),)),),
        ("an angle divided by an angle is a plain number",),
    )


def wrap(node: syntax.Expr, behind: str) -> Edit:
    """Text behind an expression, with parentheses around it where they are needed."""
    if isinstance(node, (syntax.Binary, syntax.Unary, syntax.IfExpr, syntax.Range, syntax.Lambda)):
        return Edit(node.span, f"({node.span.text}){behind}")
    return Edit(node.span.at_end, behind)


def _remedies(node: syntax.Expr, actual: Type, wanted: Type) -> tuple[Help, ...]:
    if actual == Primitive("skeleton") and (_wants(wanted, FIELD) or _wants(wanted, ListOf(FIELD))):
        return (Help("give it a radius", (wrap(node, ".blob(radius = 1)"),)),)
    if actual == NUMBER and wanted == INT:
        return (Help("round it: `round`, `floor` and `ceil` give whole numbers", (_around(node, "round"),)),)
    if isinstance(actual, RecordOf) and isinstance(wanted, RecordOf):
        return _respelt_fields(node, actual, wanted)
    if _wants(wanted, ListOf(actual)):
        return (Help("put it into a list", (Edit(node.span, f"[{node.span.text}]"),)),)
    if wanted == TEXT and isinstance(actual, Primitive) and len(node.span.text) < 60 and '"' not in node.span.text:
        return (Help("put it into a text", (Edit(node.span, f'"{{{node.span.text}}}"'),)),)
    if _wants(wanted, VEC3) and (fits(actual, ListOf(NUMBER)) or fits(actual, NUMBER)):
        return (Help("a vector is written in parentheses: (x, y, z)"),)
    if _wants(wanted, ListOf(VEC3)) and fits(actual, ListOf(ListOf(NUMBER))):
        return (Help("vectors are written in parentheses, in a list: [(x, y, z), ...]"),)
    if actual == VEC3 and _wants(wanted, ANGLE):
        return (Help("one angle for each axis: rotate(x = 10deg, y = 20deg, z = 30deg)"),)
    if _wants(wanted, COLOR):
        return _colour(node, actual)
    if wanted == Primitive("material") and isinstance(node, syntax.Text):
        return _named_material(node)
    if actual == TEXT and _wants(wanted, ListOf(VEC3)):
        return (Help("read the points of the file", (_around(node, "read_points"),)),)
    if actual == VEC3 and _wants(wanted, Primitive("skeleton")):
        return (Help("make a point of it", (_around(node, "point"),)),)
    if actual == Primitive("color") and wanted == Primitive("material"):
        return (Help("a colour and how it shines make a material", (_around(node, "clay"),)),)
    if _wants(wanted, Primitive("surface")) and actual == FIELD:
        return (Help("put it into a surface: surface { ... }"),)
    if wanted == KERNEL and isinstance(actual, FnOf):
        return (Help("a kernel is defined with `kernel name(r) = ...`, so that it can be proved"),)
    return ()


def _colour(node: syntax.Expr, actual: Type) -> tuple[Help, ...]:
    """A colour as a text or as a vector."""
    name = node.span.text.strip("\"'")
    if isinstance(node, syntax.Text) and (name in CSS_COLORS or _HEX.fullmatch(name)):
        return (Help("colours are written without quotes", (Edit(node.span, name),)),)
    if isinstance(node, syntax.Vector):
        return (Help("the parts of a colour are put together by `rgb`", (Edit(node.span, f"rgb{node.span.text}"),)),)
    if actual == VEC3:
        return (Help("the parts of a colour, each 0 to 1, are put together by `rgb`: rgb(v.x, v.y, v.z)"),)
    return ()


def _named_material(node: syntax.Text) -> tuple[Help, ...]:
    name = node.span.text.strip("\"'")
    if name in CSS_COLORS or _HEX.fullmatch(name):
        return (Help("a colour and how it shines make a material", (Edit(node.span, f"clay({name})"),)),)
    if name in BUILTINS and BUILTINS[name].kind == "material":
        return (Help("materials are written without quotes", (Edit(node.span, name),)),)
    return ()


_HEX = re.compile("#(?:[0-9a-fA-F]{3}|[0-9a-fA-F]{6}|[0-9a-fA-F]{8})")


def _around(node: syntax.Expr, function: str) -> Edit:
    return Edit(node.span, f"{function}({node.span.text})")


def _respelt_fields(node: syntax.Expr, actual: RecordOf, wanted: RecordOf) -> tuple[Help, ...]:
    """Fields that nobody asked for, whose names are near those of missing ones."""
    while isinstance(node, syntax.Group):
        node = node.inner
    if not isinstance(node, syntax.Record):
        return ()
    missing = [name for name, _ in wanted.fields if actual.field(name) is None]
    found: list[Help] = []
    for name, _ in node.fields:
        near = closest(name.text, missing) if wanted.field(name.text) is None else None
        if near:
            missing.remove(near)
            found.append(Help(f"did you mean `{near}`?", (Edit(name.span, near),)))
    return tuple(found)


def _missing_fields(actual: Type, wanted: Type) -> tuple[str, ...]:
    """Which fields of a record keep it from fitting."""
    if not (isinstance(actual, RecordOf) and isinstance(wanted, RecordOf)):
        return ()
    found: list[str] = []
    for name, kind in wanted.fields:
        own = actual.field(name)
        if own is None:
            found.append(f"it has no field `{name}`")
        elif not fits(own, kind):
            found.append(f"its field `{name}` is {article(own)}, not {article(kind)}")
    return tuple(found)


# ---- items of blocks ---------------------------------------------------------------------

#: Node that takes fields -> what it does with them.
_DOES = {
    "sum": ("sum", "adds", "the items of this block are summed"),
    "surface": ("sum", "adds", "the items of this block are summed"),
    "max": ("max", "takes the largest of", "the largest of this block's items counts"),
    "smooth_max": ("smooth_max", "joins", "the items of this block are joined smoothly"),
    "min": ("min", "takes the smallest of", "the smallest of this block's items counts"),
}


def element_of_block(node: syntax.Expr, actual: Type, wanted: Type, callee: str, header: Span) -> Diagnostic:
    """An item that its block cannot take; `header` is the call in front of the block."""
    label = Label(header, f"this block takes {plural(wanted)}")
    says = f"the block of `{callee}` takes {plural(wanted)}"
    if wanted == FIELD and callee in _DOES:
        name, does, told = _DOES[callee]
        says, label = f"`{name}` {does} fields", Label(header, told)
    return Diagnostic(
        "E0304",
        f"{says}, but {subject(node, actual)}",
        node.span,
        label_for(actual),
        (label,),
        (*_went_on(node), *_remedies(node, actual, wanted)),
    )


def _went_on(node: syntax.Expr) -> tuple[Help, ...]:
    """A line that starts with `-` is an item of its own; was it meant to go on?"""
    first: object = node
    while isinstance(first, (syntax.Binary, syntax.Range)):
        first = first.left if isinstance(first, syntax.Binary) else first.lo
    if isinstance(first, syntax.Unary) and first.op == "-":
        return (Help("a line that starts with `-` is a new item; to go on with the line above, end that one with `-`"),)
    return ()


def top_level_item(node: syntax.Expr, actual: Type) -> Diagnostic:
    """A value on a line of its own that is nothing for the scene."""
    helps = _went_on(node)
    if not helps and actual == Primitive("skeleton"):
        helps = (Help("give it a radius and a surface: surface { " + _brief(node.span.text) + ".blob(radius = 1) }"),)
    elif not helps:
        helps = (Help("give it a name with `let`, or show it with `debug`"),)
    return Diagnostic(
        "E0304",
        f"a scene is made of surfaces, lights and a camera, but {subject(node, actual)}",
        node.span,
        label_for(actual),
        helps=helps,
    )


def _brief(text: str) -> str:
    return text if len(text) <= 40 and "\n" not in text else "..."
