"""The syntax tree: a script as written, every node with its span.

Made by `parse.parse`, read by `resolve` and `check` (and by the formatter). The grammar,
`grammar/blobscript.lark`, is the reference for what can be written.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from blobscript.source import Source, Span


@dataclass(frozen=True, slots=True)
class Error:
    """What could not be parsed and was reported; absorbs what follows from it."""

    span: Span


# ---- types as written -------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class NamedType:
    name: str
    span: Span


@dataclass(frozen=True, slots=True)
class ListType:
    element: TypeSyntax
    span: Span


@dataclass(frozen=True, slots=True)
class RecordType:
    fields: tuple[tuple[Name, TypeSyntax], ...]
    span: Span


@dataclass(frozen=True, slots=True)
class FnType:
    parameters: tuple[TypeSyntax, ...]
    result: TypeSyntax
    span: Span


TypeSyntax = NamedType | ListType | RecordType | FnType | Error

# ---- expressions ------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Name:
    """A use of a name; also the name part of a definition, a member or a label."""

    text: str
    span: Span


@dataclass(frozen=True, slots=True)
class Number:
    """`value` is an int for a literal without point and exponent, else a float."""

    value: int | float
    span: Span


@dataclass(frozen=True, slots=True)
class Angle:
    """`value` in the written `unit`, as it stands in the script."""

    value: float
    unit: Literal["deg", "rad", "turn"]
    span: Span


@dataclass(frozen=True, slots=True)
class Color:
    """sRGB as written, each 0..1 (`#ff8800` is 1, 0.533, 0), and alpha."""

    rgba: tuple[float, float, float, float]
    span: Span


@dataclass(frozen=True, slots=True)
class Text:
    """Pieces of plain text (escapes resolved) and `{expressions}` in turn."""

    parts: tuple[str | Expr, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Bool:
    value: bool
    span: Span


@dataclass(frozen=True, slots=True)
class Vector:
    """`(x, y, z)`: two or more expressions; checking asks for three."""

    items: tuple[Expr, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Record:
    fields: tuple[tuple[Name, Expr], ...]
    span: Span


@dataclass(frozen=True, slots=True)
class List:
    items: tuple[Element, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Group:
    """`(e)`; kept for the formatter and for spans."""

    inner: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class Unary:
    op: Literal["-", "not"]
    operand: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class Binary:
    """Arithmetic, comparison and logic; `op_span` is the operator itself."""

    op: Literal["+", "-", "*", "/", "^", "==", "!=", "<", "<=", ">", ">=", "and", "or"]
    left: Expr
    right: Expr
    op_span: Span
    span: Span


@dataclass(frozen=True, slots=True)
class Range:
    """`lo..hi` (closed) or `lo..<hi` (half open)."""

    lo: Expr
    hi: Expr
    half_open: bool
    span: Span


@dataclass(frozen=True, slots=True)
class IfExpr:
    condition: Expr
    then: Expr
    otherwise: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class Lambda:
    parameters: tuple[Parameter, ...]
    result: TypeSyntax | None
    body: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class Argument:
    """Positional where `label` is None."""

    label: Name | None
    value: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class Call:
    """`callee(arguments) { block }`; `arguments` is None in `name { … }`.

    `callee` may be a Member: `x.f(a)` is decided by the checker (field of x, or f(x, a)).
    """

    callee: Expr
    arguments: tuple[Argument, ...] | None
    block: Block | None
    span: Span


@dataclass(frozen=True, slots=True)
class Member:
    """`target.name`; with a block and no parentheses it is a Call around this."""

    target: Expr
    name: Name
    span: Span


@dataclass(frozen=True, slots=True)
class Index:
    target: Expr
    index: Expr
    span: Span


Expr = (
    Name
    | Number
    | Angle
    | Color
    | Text
    | Bool
    | Vector
    | Record
    | List
    | Group
    | Unary
    | Binary
    | Range
    | IfExpr
    | Lambda
    | Call
    | Member
    | Index
    | Error
)

# ---- elements of lists: [a, ...b, for (x in xs) e, if (c) e] -------------------------


@dataclass(frozen=True, slots=True)
class Spread:
    """`...list`, in lists and in blocks."""

    value: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class Binder:
    """`x` or `i, x` in a `for` header."""

    index: Name | None
    value: Name
    span: Span


@dataclass(frozen=True, slots=True)
class ForElement:
    binder: Binder
    iterable: Expr
    body: Element
    span: Span


@dataclass(frozen=True, slots=True)
class IfElement:
    condition: Expr
    then: Element
    span: Span


# ---- items of blocks and of the top level ----------------------------------------------


@dataclass(frozen=True, slots=True)
class Let:
    """`doc` is the text of the `///` lines before it."""

    name: Name
    type: TypeSyntax | None
    value: Expr
    doc: str
    span: Span


@dataclass(frozen=True, slots=True)
class Assert:
    condition: Expr
    message: Expr | None
    span: Span


@dataclass(frozen=True, slots=True)
class Debug:
    value: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class For:
    binder: Binder
    iterable: Expr
    body: Block
    span: Span


@dataclass(frozen=True, slots=True)
class If:
    condition: Expr
    then: Block
    otherwise: Block | If | None
    span: Span


@dataclass(frozen=True, slots=True)
class Block:
    items: tuple[Item, ...]
    span: Span


Item = Let | Assert | Debug | For | If | Spread | Expr

Element = Expr | Spread | ForElement | IfElement | For | If

# ---- declarations, top level only -------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Attribute:
    """`@name(arguments)` before a declaration."""

    name: Name
    arguments: tuple[Argument, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a function, kernel or lambda. `named_only`: it stands after `*`."""

    name: Name
    type: TypeSyntax | None
    default: Expr | None
    named_only: bool
    span: Span


@dataclass(frozen=True, slots=True)
class ImportNames:
    """`import a, b from "file.blob"` (`path` is the text) or `from module.sub` (dotted)."""

    names: tuple[Name, ...]
    path: str
    is_file: bool
    path_span: Span
    span: Span


@dataclass(frozen=True, slots=True)
class ImportModule:
    path: str
    is_file: bool
    alias: Name
    path_span: Span
    span: Span


@dataclass(frozen=True, slots=True)
class TypeAlias:
    name: Name
    type: TypeSyntax
    doc: str
    span: Span


@dataclass(frozen=True, slots=True)
class Param:
    """`param name = default in allowed step s`; `allowed` is a Range or a List of choices."""

    name: Name
    type: TypeSyntax | None
    default: Expr
    allowed: Expr | None
    step: Expr | None
    attributes: tuple[Attribute, ...]
    doc: str
    span: Span


@dataclass(frozen=True, slots=True)
class Fn:
    """`statements` are the `let`, `assert` and `debug` before `return` (empty for `= e`)."""

    name: Name
    parameters: tuple[Parameter, ...]
    result: TypeSyntax | None
    statements: tuple[Let | Assert | Debug, ...]
    body: Expr
    attributes: tuple[Attribute, ...]
    doc: str
    span: Span


@dataclass(frozen=True, slots=True)
class KernelDecl:
    name: Name
    parameters: tuple[Parameter, ...]
    body: Expr
    attributes: tuple[Attribute, ...]
    doc: str
    span: Span


Declaration = ImportNames | ImportModule | TypeAlias | Param | Fn | KernelDecl
TopItem = Declaration | Item


@dataclass(frozen=True, slots=True)
class Script:
    """One file. `edition` is None without a header."""

    source: Source
    edition: int | None
    items: tuple[TopItem, ...]
