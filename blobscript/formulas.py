"""Functions of the script as the bodies of kernels use them: their formulas, and what names mean in those.

A kernel is proved, not evaluated, so its body stays as written; so do the functions that it calls.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from blobscript import syntax

__all__ = ["Formula", "Labelled", "arguments_of", "call_parts", "callees", "lambda_of", "named"]

#: An argument and its label.
Labelled = tuple["str | None", syntax.Expr]


@dataclass(frozen=True, slots=True, eq=False)
class Formula:
    """A function, and the numbers and functions that names mean in its body. `recursive`: it calls itself.

    A name from a module imported as a whole is written as in the script: `module.name`.
    """

    name: str
    parameters: tuple[syntax.Parameter, ...]
    statements: tuple[syntax.Let | syntax.Assert | syntax.Debug, ...]
    body: syntax.Expr
    recursive: bool = False
    values: Mapping[str, float | int] = field(default_factory=dict[str, "float | int"])
    formulas: Mapping[str, Formula] = field(default_factory=dict[str, "Formula"])


def lambda_of(node: syntax.Expr) -> syntax.Lambda | None:
    """The lambda that an expression is."""
    while isinstance(node, syntax.Group):
        node = node.inner
    return node if isinstance(node, syntax.Lambda) else None


def named(node: syntax.Expr, formulas: Mapping[str, Formula]) -> Formula | None:
    """The function of the script that a name means."""
    match node:
        case syntax.Name(text):
            return formulas.get(text)
        case syntax.Member(syntax.Name(module), name):
            return formulas.get(f"{module}.{name.text}")
        case _:
            return None


def callees(node: syntax.Call) -> Iterator[tuple[syntax.Expr, list[Labelled]]]:
    """What may be called, with the arguments that it then has: `x.f(a)` is `f` of a module x, or f(x, a)."""
    given = [(a.label.text if a.label else None, a.value) for a in node.arguments or ()]
    yield node.callee, given
    if isinstance(node.callee, syntax.Member):
        yield node.callee.name, [(None, node.callee.target), *given]


def call_parts(node: syntax.Call) -> tuple[str, list[Labelled]]:
    """The name that a call names, "" where it names none, and its arguments."""
    name, given = "", list[Labelled]()
    for callee, arguments in callees(node):
        if isinstance(callee, syntax.Name):
            name, given = callee.text, arguments
    return name, given


def arguments_of(
    parameters: Sequence[syntax.Parameter], given: Sequence[Labelled]
) -> Iterator[tuple[syntax.Parameter, syntax.Expr | None]]:
    """Each parameter with its argument, None where its default counts. The checker has seen that they fit."""
    positional = iter([value for label, value in given if label is None])
    labelled = {label: value for label, value in given if label is not None}
    for parameter in parameters:
        if parameter.name.text in labelled:
            yield parameter, labelled[parameter.name.text]
        else:
            yield parameter, None if parameter.named_only else next(positional, None)
