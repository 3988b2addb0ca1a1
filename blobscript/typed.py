"""The typed tree: what the checker makes of a script that has no errors, ready to be evaluated.

Names have become places: a slot of the frame of the function around (`Local`), a definition of a
file (`Global`), or a built-in. Members are fields or calls, arguments stand where the callee
wants them, blocks are lists, and an int that stands for a number is converted (`Convert`).

Frames: the parameters of a function come first, then its local names and what a lambda has
captured. `size` is how many slots a function needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from blobscript.callables import Signature
from blobscript.resolve import Definition, Module
from blobscript.source import Source, Span
from blobscript.types import FnOf, Type

__all__ = [
    "And",
    "Assert",
    "Binary",
    "Body",
    "CallBuiltin",
    "CallFunction",
    "CallKernel",
    "CallValue",
    "Constant",
    "Convert",
    "Debug",
    "Element",
    "Expr",
    "Failed",
    "Field",
    "FileParam",
    "For",
    "FormulaFunction",
    "Function",
    "FunctionValue",
    "Global",
    "If",
    "IfElements",
    "Index",
    "Item",
    "KernelFamily",
    "Lambda",
    "Let",
    "List",
    "Local",
    "Not",
    "Or",
    "Parameter",
    "Placed",
    "Program",
    "Range",
    "Record",
    "Spread",
    "Text",
    "Unary",
    "Unplaced",
    "Value",
    "Vector",
]

# ---- expressions ------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Constant:
    """A value that is known: a literal, a colour name."""

    value: Any
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Failed:
    """Reported already; a program with one of these is never evaluated."""

    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Local:
    slot: int
    name: str
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Global:
    """The value of a `let` or `param` of a file."""

    definition: Definition
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class FunctionValue:
    """A function of a file or a built-in, used as a value; takes its arguments in order."""

    definition: Definition | None
    builtin: Signature | None
    type: FnOf
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Text:
    """Constant pieces and expressions, joined."""

    parts: tuple[str | Expr, ...]
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Vector:
    x: Expr
    y: Expr
    z: Expr
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    fields: tuple[tuple[str, Expr], ...]
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class List:
    """A list, or the block behind a call."""

    elements: tuple[Element, ...]
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Unary:
    """`implementation` is a key of the table of operators."""

    op: str
    implementation: str
    operand: Expr
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Binary:
    op: str
    implementation: str
    left: Expr
    right: Expr
    op_span: Span
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class And:
    left: Expr
    right: Expr
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Or:
    left: Expr
    right: Expr
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Not:
    operand: Expr
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Range:
    """A list of whole numbers, or (of numbers and angles) the limits of a parameter."""

    lo: Expr
    hi: Expr
    half_open: bool
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class If:
    condition: Expr
    then: Expr
    otherwise: Expr
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Lambda:
    """`captured`: (slot in the frame around, slot in its own) of every name that it takes along."""

    function: Function
    captured: tuple[tuple[int, int], ...]
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class CallFunction:
    """A function of a file; None stands for an argument that was left out."""

    definition: Definition
    arguments: tuple[Expr | None, ...]
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class CallValue:
    """A function value, which takes its arguments in order."""

    callee: Expr
    arguments: tuple[Expr, ...]
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class CallBuiltin:
    """`name` alone tells makers and functions apart; absent arguments are left out."""

    name: str
    arguments: tuple[tuple[str, Expr], ...]
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class CallKernel:
    """A kernel of a file, with its parameters."""

    definition: Definition
    arguments: tuple[tuple[str, Expr], ...]
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """`.x .y .z` of a vector, or a field of a record."""

    target: Expr
    name: str
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Index:
    target: Expr
    index: Expr
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Convert:
    """A value of one type where another is wanted that it fits: ints become numbers, at any depth."""

    value: Expr
    type: Type
    span: Span


Expr = (
    Constant
    | Failed
    | Local
    | Global
    | FunctionValue
    | Text
    | Vector
    | Record
    | List
    | Unary
    | Binary
    | And
    | Or
    | Not
    | Range
    | If
    | Lambda
    | CallFunction
    | CallValue
    | CallBuiltin
    | CallKernel
    | Field
    | Index
    | Convert
)

# ---- elements of lists and blocks ---------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    value: Expr
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    value: Expr
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class For:
    """`index_slot` is None in `for (x in xs)`."""

    index_slot: int | None
    slot: int
    iterable: Expr
    body: tuple[Element, ...]
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class IfElements:
    condition: Expr
    then: tuple[Element, ...]
    otherwise: tuple[Element, ...]
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Let:
    slot: int
    name: str
    value: Expr
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Assert:
    condition: Expr
    message: Expr | None
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Debug:
    value: Expr
    span: Span


Statement = Let | Assert | Debug
Element = Item | Spread | For | IfElements | Statement

# ---- functions and definitions --------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Parameter:
    """`default` is evaluated in the frame of the function, so it may use earlier parameters."""

    name: str
    type: Type
    default: Expr | None


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    statements: tuple[Statement, ...]
    result: Expr


@dataclass(frozen=True, slots=True, eq=False)
class Function:
    name: str
    parameters: tuple[Parameter, ...]
    body: Body
    size: int
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Value:
    """`let name = value` of a file. `size`: slots that evaluating it needs."""

    definition: Definition
    value: Expr
    size: int


@dataclass(frozen=True, slots=True, eq=False)
class FileParam:
    """`param name = default in allowed step s`; `choices` is a list of all that is allowed."""

    definition: Definition
    type: Type
    default: Expr
    allowed: Range | None
    choices: Expr | None
    step: Expr | None
    group: str
    doc: str
    size: int


@dataclass(frozen=True, slots=True, eq=False)
class FormulaFunction:
    """A function that the body of a kernel calls, as it is written. `constants`, `formulas`: what names in
    its own body mean, empty for a recursive one."""

    definition: Definition
    constants: tuple[tuple[str, Expr], ...]
    formulas: tuple[tuple[str, FormulaFunction], ...]


@dataclass(frozen=True, slots=True, eq=False)
class KernelFamily:
    """`kernel name(r, k = 3) = body`; the body stays as written, it is proved and not evaluated.

    `constants`, `formulas`: the values and functions of the file that the body uses. `waivers`: words of
    its `@allow`.
    """

    definition: Definition
    variable: str
    parameters: tuple[Parameter, ...]
    constants: tuple[tuple[str, Expr], ...]
    formulas: tuple[tuple[str, FormulaFunction], ...]
    waivers: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A top-level item of a file: a scene item, a loop over them, an assertion."""

    element: Element
    size: int


@dataclass(frozen=True, slots=True, eq=False)
class Unplaced:
    """A thing for the scene that has a name but is in no item (W0402)."""

    name: str
    type: Type
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """Everything in the order of evaluation. Items of imported files are their assertions only."""

    modules: tuple[Module, ...]  # imported ones first, the main script last
    definitions: tuple[Value | FileParam | KernelFamily, ...]
    functions: dict[Definition, Function]
    items: tuple[Placed, ...]
    unplaced: tuple[Unplaced, ...] = ()

    @property
    def main(self) -> Module:
        return self.modules[-1]

    @property
    def sources(self) -> tuple[Source, ...]:
        return tuple([module.source for module in self.modules])
