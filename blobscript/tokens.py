"""A token: the name of its terminal in the grammar, and where it stands. A mended one may be empty."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["CLOSERS", "END", "NEWLINE", "OPENERS", "Token"]

END = "$END"
NEWLINE = "_NL"

OPENERS = {"LPAR": "RPAR", "LSQB": "RSQB", "LBRACE": "RBRACE"}
CLOSERS = {closer: opener for opener, closer in OPENERS.items()}


class Token(NamedTuple):
    kind: str
    start: int
    end: int
