"""Room for deep recursion: trees as deep as scripts can be written, calls as deep as the budget allows.

CPython's default limit of 1 000 frames is far less than the depth of a long sum or of a recursive
function of a script. Calls from Python code to Python code take no C stack (since CPython 3.11),
so the limit can be raised safely for code that recurses in Python only: no `sorted(key=...)`,
`any(...)` or `tuple(... for ...)` on the way down.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TypeVar

__all__ = ["deeply"]

_FRAMES = 400_000

#: Words of the stack of Python frames that one frame claims. It gets a piece of memory twice as large (a power
#: of two), and what it calls shares it: some 10 000 calls deep. Only what is used is ever touched.
_ROOM = (1 << 22) + 1

T = TypeVar("T")


def deeply(function: Callable[[], T]) -> T:
    """What the function returns, which may recurse deeply."""
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(max(before, _FRAMES))
    try:
        return _with_room(function)
    finally:
        sys.setrecursionlimit(before)


def _with_room(function: Callable[[], T]) -> T:
    return function()


# Frames lie in pieces of 16 kB that are mapped and unmapped as calls come and go: a loop whose depth is just at the
# end of a piece spends more than half of its time there. One frame that claims a large stack has a large piece.
_with_room.__code__ = _with_room.__code__.replace(co_stacksize=_ROOM)
