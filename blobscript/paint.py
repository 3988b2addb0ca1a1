"""Colours of a terminal for the parts of a diagnostic; plain text where they are off."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Paint"]

_YELLOW, _BLUE, _GREEN, _BOLD = "1;33", "1;34", "32", "1"
_SEVERITIES = {"error": "1;31", "warning": _YELLOW, "note": "1;36"}


@dataclass(frozen=True, slots=True)
class Paint:
    """`severity` decides the colour of the primary mark."""

    on: bool
    severity: str = "error"

    def _in(self, code: str, text: str) -> str:
        return f"\x1b[{code}m{text}\x1b[0m" if self.on and text else text

    def title(self, text: str) -> str:
        return self._in(_SEVERITIES[self.severity], text)

    def strong(self, text: str) -> str:
        return self._in(_BOLD, text)

    def gutter(self, text: str) -> str:
        return self._in(_BLUE, text)

    def mark(self, text: str, primary: bool) -> str:
        return self.title(text) if primary else self._in(_BLUE, text)

    def edit(self, text: str) -> str:
        return self._in(_GREEN if text.startswith("+") else _YELLOW, text)
