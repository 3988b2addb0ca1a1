from __future__ import annotations

from typing import NamedTuple

from blobscript.diagnostics import Diagnostic
from blobscript.tokens import Token

__all__ = ["mend"]


class Mended(NamedTuple):
    tokens: list[Token]
    diagnostics: list[Diagnostic]


def mend(source, tokens):
    return Mended(tokens, [])
