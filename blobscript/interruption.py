"""Ctrl-C where it must wait for a moment: while other processes start, while packages are imported that swallow it."""

from __future__ import annotations

import importlib
import signal
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager

__all__ = ["held", "import_whole"]


@contextmanager
def held() -> Generator[None]:
    """Ctrl-C waits for the end of this, and processes that start here never hear of it."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    pressed: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: pressed.append(number))  # another thread may be told
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
    if pressed:
        raise KeyboardInterrupt


def import_whole(name: str) -> None:
    """Imports a package that tries what else is installed and takes any exception, Ctrl-C too, for a no."""
    if name not in sys.modules:
        with held():
            importlib.import_module(name)
