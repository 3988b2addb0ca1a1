"""What a running script needs: the budget, the values of definitions, and how it stops.

A step is a call or a round of a loop (more for large bodies: one for every 32 nodes of the tree). The
budget bounds the steps, and with them time and memory: whatever costs more than a few machine
instructions spends from it, so no script runs for ever.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NoReturn, Protocol

import numpy as np

from blobscript import typed
from blobscript.diagnostics import Diagnostic, Help, Label
from blobscript.source import Span
from blobscript.values import Context, Table

if TYPE_CHECKING:
    from blobscript import typed
    from blobscript.callables import Signature
    from blobscript.resolve import Definition

__all__ = [
    "DEFAULT_BUDGET",
    "MISSING",
    "POISON",
    "AbsorbedError",
    "Code",
    "Compiling",
    "FailureError",
    "FunctionValue",
    "Origin",
    "State",
    "too_deep",
]

Frame = list[Any]
Run = Callable[[Frame], Any]

DEFAULT_BUDGET = 2_000_000
_DEPTH_PER_BUDGET = 1_000 / DEFAULT_BUDGET
_LEAST_DEPTH, _MOST_DEPTH = 1_000, 20_000

#: An argument that was left out.
MISSING: Any = object()

#: The value of a definition that failed; using it says nothing new.
POISON: Any = object()

_MOST_CALLS_SHOWN = 6
_MOST_FAILURES = 20  # of one item


class AbsorbedError(Exception):
    """Something that was reported already is needed here."""


class FailureError(Exception):
    """A mistake found while evaluating; on its way out it collects the calls that led to it.

    `others`: mistakes of other elements of the same block or list, each with its own calls so far.
    """

    def __init__(self, diagnostic: Diagnostic) -> None:
        super().__init__(diagnostic.message)
        self.diagnostic = diagnostic
        self.calls: list[tuple[Span, str]] = []
        self.others: list[FailureError] = []

    def through(self, span: Span, name: str) -> None:
        """Leaves a call."""
        self.calls.append((span, name))
        for other in self.others:
            other.calls.append((span, name))

    def join(self, other: FailureError) -> None:
        """Takes the mistakes of another along, up to a sensible number of places."""
        known = {one.diagnostic.span for one in (self, *self.others)}
        for one in (other, *other.others):
            if one.diagnostic.span not in known and len(self.others) < _MOST_FAILURES:
                known.add(one.diagnostic.span)
                self.others.append(one)

    def all_finished(self) -> list[Diagnostic]:
        return [one._finished() for one in (self, *self.others)]

    def _finished(self) -> Diagnostic:
        """With the calls as secondary labels, innermost first; long chains keep their ends."""
        own = self.diagnostic.span
        calls: list[tuple[Span, str, int]] = []
        for span, name in self.calls:
            if calls and calls[-1][0] == span:
                calls[-1] = (span, name, calls[-1][2] + 1)
            elif not (span == own and not calls):
                calls.append((span, name, 1))
        if len(calls) > _MOST_CALLS_SHOWN:
            calls = [*calls[: _MOST_CALLS_SHOWN - 1], calls[-1]]
        labels = [Label(span, f"in {name}, called here" + (f" {n} times" if n > 1 else "")) for span, name, n in calls]
        return replace(self.diagnostic, labels=(*self.diagnostic.labels, *labels))


@dataclass(slots=True, eq=False)
class State:
    """One evaluation of a program."""

    context: Context
    budget: int = DEFAULT_BUDGET
    time: float = 0.0
    phase: float = 0.0
    #: What was read, by maker and name.
    files: dict[tuple[str, str | None, str], Any] = field(default_factory=dict[tuple[str, str | None, str], Any])
    steps: int = 0  # left
    depth: int = 0
    explaining: bool = False  # a failed assertion looks at its parts
    notes: list[Diagnostic] = field(default_factory=list[Diagnostic])

    def __post_init__(self) -> None:
        self.steps = self.budget

    @property
    def depth_limit(self) -> int:
        return min(max(_LEAST_DEPTH, int(self.budget * _DEPTH_PER_BUDGET)), _MOST_DEPTH)

    def spend(self, steps: int, span: Span) -> None:
        self.steps -= steps
        if self.steps < 0:
            self.exhausted(span)

    def spend_on_list(self, values: Any, span: Span, each: int = 1) -> None:
        """What going through a list costs; arrays and tables are gone through by machine code."""
        count = len(values)
        self.spend(each * (count >> 8 if isinstance(values, (np.ndarray, Table)) else count), span)

    def exhausted(self, span: Span) -> NoReturn:
        """Ends the whole evaluation: what comes after it is not tried."""
        self.steps = -1
        raise FailureError(
            Diagnostic(
                "E0901",
                f"the budget of {self.budget} steps is used up",
                span,
                "stopped here",
                helps=(Help(f"if the scene needs more, raise it: --budget {2 * self.budget}"),),
                notes=("a step is a call or a round of a loop",),
            )
        )


def too_deep(name: str, span: Span, state: State) -> FailureError:
    helps = [Help("a function that calls itself needs a case in which it does not")]
    if state.depth_limit < _MOST_DEPTH:
        more = 2 * max(state.budget, DEFAULT_BUDGET)
        helps.append(Help(f"if the scene needs more, raise the budget: --budget {more}"))
    return FailureError(
        Diagnostic(
            "E0901",
            f"calls of {name} are nested more than {state.depth_limit} deep",
            span,
            "the call that went too deep",
            helps=tuple(helps),
        )
    )


class Compiling(Protocol):
    """What turns expressions into functions of the frame, for those that are a part of it."""

    @property
    def state(self) -> State: ...

    def expr(self, node: typed.Expr) -> Run: ...


@dataclass(slots=True, eq=False)
class Code:
    """A compiled function. A call's frame is its arguments followed by `tail`, and it costs `steps`.

    `body` is set after the functions that it calls are known, so that they may call each other.
    """

    name: str
    tail: Frame
    steps: int = 1
    body: Run = field(default=lambda frame: None)


@dataclass(frozen=True, slots=True, eq=False)
class Origin:
    """What a function value was made of, for those who follow it instead of calling it (`follow`).

    `tail`: the frame behind the arguments, with what a lambda has taken along; `cells`: the values of
    definitions. A built-in has a signature instead of a function.
    """

    function: typed.Function | None
    tail: Frame
    cells: Mapping[Definition, list[Any]]
    program: typed.Program | None
    builtin: Signature | None = None


@dataclass(slots=True, eq=False)
class FunctionValue:
    """A function as a value: `call(arguments)`. `column`: it only takes this field of a record."""

    call: Callable[[Frame], Any]
    column: str | None = None
    origin: Origin | None = None
