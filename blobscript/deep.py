"""Room for deep recursion: trees as deep as scripts can be written, calls as deep as the budget allows.

CPython's default limit of 1 000 frames is far less than the depth of a long sum or of a recursive
function of a script. Calls from Python code to Python code take no C stack (since CPython 3.11),
so the limit can be raised safely for code that recurses in Python only: no `sorted(key=...)`,
`any(...)` or `tuple(... for ...)` on the way down.
"""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager

__all__ = ["deep_recursion"]

_FRAMES = 400_000


@contextmanager
def deep_recursion() -> Generator[None]:
    """Raises the limit of frames for the time being."""
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(max(before, _FRAMES))
    try:
        yield
    finally:
        sys.setrecursionlimit(before)
