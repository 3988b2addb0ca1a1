"""Room for deep recursion: trees as deep as scripts can be written, calls as deep as the budget allows.

CPython's default limit of 1 000 frames is far less than the depth of a long sum or of a recursive
function of a script. Calls from Python code to Python code take no C stack (since CPython 3.11),
so the limit can be raised safely for code that recurses in Python only: no `sorted(key=...)`,
`any(...)` or `tuple(... for ...)` on the way down.

Passes over the tree of a scene may do that: its depth is bounded (`flatten`), and the C stack holds it.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import TypeVar

__all__ = ["deeply", "make_room"]

_FRAMES = 400_000

#: Frames that a pass over a tree may take for each level of it, and others below and above the pass.
_PER_LEVEL, _BESIDE = 8, 1_000

#: Words of the stack of Python frames that one frame claims. It gets a piece of memory twice as large (a power
#: of two), and what it calls shares it: some 10 000 calls deep. Only what is used is ever touched.
_ROOM = (1 << 22) + 1

T = TypeVar("T")


class _Limit:
    """The limit is one for all threads: raised while any of them is inside `deeply`."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.inside = 0
        self.after = 0

    def enter(self) -> None:
        with self.lock:
            before = sys.getrecursionlimit()
            if not self.inside:
                self.after = before
            self.inside += 1
            sys.setrecursionlimit(max(before, _FRAMES))

    def leave(self) -> None:
        with self.lock:
            self.inside -= 1
            if not self.inside:
                sys.setrecursionlimit(self.after)

    def need(self, frames: int) -> None:
        with self.lock:
            self.after = max(self.after, frames)
            if sys.getrecursionlimit() < frames:
                sys.setrecursionlimit(frames)


_limit = _Limit()


def deeply(function: Callable[[], T]) -> T:
    """What the function returns, which may recurse deeply."""
    _limit.enter()
    try:
        return _with_room(function)
    finally:
        _limit.leave()


def make_room(levels: int) -> None:
    """For scenes whose trees are so deep: from here on, as there is no telling who will walk through them."""
    frames = _PER_LEVEL * levels + _BESIDE
    if frames > 2 * _BESIDE:
        _limit.need(frames)


def _with_room(function: Callable[[], T]) -> T:
    return function()


# Frames lie in pieces of 16 kB that are mapped and unmapped as calls come and go: a loop whose depth is just at the
# end of a piece spends more than half of its time there. One frame that claims a large stack has a large piece.
_with_room.__code__ = _with_room.__code__.replace(co_stacksize=_ROOM)
