"""`assert`: when it fails, the note shows the values of the expressions inside the condition.

The language is pure, so the parts can simply be evaluated again.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from typing import Any

from blobscript import typed
from blobscript.diagnostics import Diagnostic
from blobscript.runtime import AbsorbedError, Compiling, FailureError, Frame, State
from blobscript.shown import show_quoted
from blobscript.types import BOOL

__all__ = ["assertion"]

_WIDEST = 60

#: For looking at the parts; enough for what a condition calls, too little to be felt.
_STEPS = 100_000


def assertion(compiler: Compiling, node: typed.Assert) -> Callable[[Frame], None]:
    condition = compiler.expr(node.condition)
    message = compiler.expr(node.message) if node.message is not None else None

    def check(frame: Frame) -> None:
        if condition(frame):
            return
        if compiler.state.explaining:  # another assertion looks at its parts; this one needs no note
            raise FailureError(Diagnostic("E0701", "assertion failed", node.condition.span))
        says = f"assertion failed: {message(frame)}" if message is not None else "assertion failed"
        with _looking(compiler.state):
            note = _values(compiler, node.condition, frame)
        raise FailureError(Diagnostic("E0701", says, node.condition.span, "false", notes=(note,) if note else ()))

    return check


@contextmanager
def _looking(state: State) -> Generator[None]:
    """The parts may fail themselves, and may take long: neither may show."""
    steps, depth, notes = state.steps, state.depth, len(state.notes)
    state.explaining, state.steps = True, min(steps, _STEPS)
    try:
        yield
    finally:
        state.explaining, state.steps, state.depth = False, steps, depth
        del state.notes[notes:]


def _values(compiler: Compiling, condition: typed.Expr, frame: Frame) -> str:
    """A line for each part: its text, aligned, and what it is."""
    rows: dict[str, str] = {}
    for part in _parts(condition):
        text = " ".join(part.span.text.split())
        if text in rows or len(text) > _WIDEST:
            continue
        depth = compiler.state.depth
        try:
            rows[text] = f"is {show_quoted(compiler.expr(part)(frame), part.type)}{_more(compiler, part, frame)}"
        except (FailureError, AbsorbedError):
            compiler.state.depth = depth
    width = max(map(len, rows), default=0)
    return "\n".join(f"{text:{width}}  {value}" for text, value in rows.items())


def _parts(node: typed.Expr) -> Iterator[typed.Expr]:
    """Names, calls and comparisons; not what is written out, and not what only joins others."""
    match node:
        case typed.And(left, right) | typed.Or(left, right):
            yield from _parts(left)
            yield from _parts(right)
        case typed.Not(operand) | typed.Convert(operand):
            yield from _parts(operand)
        case typed.Binary(left=left, right=right):
            yield from _parts(left)
            yield from _parts(right)
            if node.type == BOOL:
                yield node
        case typed.Unary(operand=operand):
            yield from _parts(operand)
        case typed.Local() | typed.Global() | typed.Field() | typed.Index():
            yield node
        case typed.CallFunction() | typed.CallValue() | typed.CallBuiltin():
            yield node
        case _:
            pass


def _more(compiler: Compiling, part: typed.Expr, frame: Frame) -> str:
    """For `inside`: the two numbers that decide."""
    match part:
        case typed.CallBuiltin("inside", arguments):
            surface = dict(arguments)["surface"]
            query = typed.CallBuiltin("field_at", arguments, part.type, part.span)
            value: Any = compiler.expr(query)(frame)
            threshold: Any = compiler.expr(surface)(frame).threshold
            return f"  (the field is {value:.6g} there, the threshold {threshold:.6g})"
        case _:
            return ""
