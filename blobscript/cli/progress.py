"""How far a long command is: a bar with the time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from typing import TextIO

__all__ = ["Progress"]

#: Seconds between two plain lines: a log of a minute's work stays a screenful.
_LINE_EVERY = 5.0
_BAR_EVERY = 0.1
_WIDTH = 30


class Progress:
    """Call it with (done, total) as often as you like; `finish` clears the bar."""

    def __init__(self, what: str, stream: TextIO | None = None) -> None:
        self._what = what
        self._stream = stream or sys.stderr
        self._on_terminal = self._stream.isatty()
        self._start = self._last = time.monotonic()
        self._drawn = False

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._last < (_BAR_EVERY if self._on_terminal else _LINE_EVERY):
            return
        self._last = now
        share = done / total if total else 1.0
        left = _clock((now - self._start) * (1 - share) / share) if share > 0 else "?"
        if self._on_terminal:
            full = round(share * _WIDTH)
            bar = "█" * full + "░" * (_WIDTH - full)
            self._write(f"\r{self._what} {bar} {share:4.0%}, {left} left \x1b[K")
            self._drawn = True
        else:
            self._write(f"{self._what}: {share:.0%}, {left} left\n")

    def finish(self) -> float:
        """Clears the bar; returns the seconds since the start."""
        if self._drawn:
            self._write("\r\x1b[K")
        return time.monotonic() - self._start

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
        except UnicodeEncodeError:
            self._stream.write(text.replace("█", "#").replace("░", "."))
        self._stream.flush()


def _clock(seconds: float) -> str:
    whole = round(seconds)
    if whole >= 3600:
        return f"{whole // 3600}:{whole // 60 % 60:02}:{whole % 60:02}"
    return f"{whole // 60}:{whole % 60:02}"
