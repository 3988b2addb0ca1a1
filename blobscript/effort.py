"""How much a proof may cost: a budget of work, counted, not timed, so that its end is always the same.

A unit is about one multiplication of intervals, 1.5 microseconds. `spend` costs nothing outside
`limited`. The count is a context variable: proofs in several threads do not share it.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from contextvars import ContextVar

__all__ = ["UndecidedError", "limited", "spend"]

_left: ContextVar[list[int] | None] = ContextVar("left", default=None)


class UndecidedError(Exception):
    """A question that stays open, or whose answer costs too much."""


@contextmanager
def limited(units: int) -> Generator[None]:
    token = _left.set([units])
    try:
        yield
    finally:
        _left.reset(token)


def spend(units: int) -> None:
    left = _left.get()
    if left is not None:
        left[0] -= units
        if left[0] < 0:
            raise UndecidedError("more than the budget of the proof is needed")
