from __future__ import annotations

from typing import NamedTuple

from blobscript.diagnostics import Diagnostic
from blobscript.source import Span
from blobscript.tokens import Token


class Stray(NamedTuple):
    diagnostic: Diagnostic
    tokens: list[Token]
    end: int


def diagnose(source, position, stop, before):
    return Stray(Diagnostic("E0109", "unknown character", Span(source, position, position + 1)), [], position + 1)
