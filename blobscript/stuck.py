"""The stuck parser as the rules of the `snag_` modules see it, and what they answer."""

from __future__ import annotations

from typing import NamedTuple

from blobscript.diagnostics import Diagnostic, Edit, Help
from blobscript.machine import Machine
from blobscript.source import Source, Span
from blobscript.tokens import CLOSERS, END, NEWLINE, OPENERS, Token
from blobscript.words import RESERVED

__all__ = [
    "DEFINERS",
    "ENDS",
    "ITEM_STARTS",
    "KEYWORDS",
    "LITERALS",
    "OPERATORS",
    "VALUE_STARTS",
    "Repair",
    "Snag",
    "Stuck",
]


class Repair(NamedTuple):
    """Put `tokens` in the place of `removed` tokens at `place` (before the stuck one: the item is read again)."""

    place: int
    removed: int
    tokens: tuple[Token, ...]


class Snag(NamedTuple):
    diagnostic: Diagnostic
    repairs: tuple[Repair, ...] = ()


KEYWORDS = frozenset(word.upper() for word in RESERVED)
LITERALS = frozenset(["NUMBER", "ANGLE", "COLOR", "STRING", "TRUE", "FALSE"])
VALUE_STARTS = LITERALS | {"NAME", "LPAR", "LSQB", "NOT", "FN", "IF"}
ITEM_STARTS = VALUE_STARTS | {
    "LET", "ASSERT", "DEBUG", "FOR", "SPREAD", "IMPORT", "TYPE", "PARAM", "KERNEL", "AT", "RETURN", "BLOBSCRIPT",
}  # fmt: skip
OPERATORS = frozenset(["PLUS", "MINUS", "TIMES", "OVER", "POWER", "COMPARE", "RANGE", "AND", "OR"])
ENDS = frozenset([NEWLINE, END, "RPAR", "RSQB", "RBRACE", "COMMA"])
DEFINERS = {"LET": "let", "PARAM": "param", "FN": "fn", "KERNEL": "kernel", "TYPE": "type"}


class Stuck:
    """The stuck parser with names for what surrounds the stuck token."""

    def __init__(self, machine: Machine, source: Source, item: int) -> None:
        self.machine = machine
        self.source = source
        self.tokens = machine.tokens
        self.at = machine.at
        self.item = item
        self.token = self.tokens[self.at]
        self.before = self.tokens[self.at - 1] if self.at > item else Token(NEWLINE, self.token.start, self.token.start)
        self.after = self.tokens[min(self.at + 1, len(self.tokens) - 1)]

    def kind(self, index: int) -> str:
        """The kind of a token of this item; NEWLINE before it and END behind everything."""
        if index < self.item:
            return NEWLINE
        return self.tokens[index].kind if index < len(self.tokens) else END

    def text(self, token: Token) -> str:
        return self.source.text[token.start : token.end]

    def span(self, token: Token) -> Span:
        return Span(self.source, token.start, token.end)

    def place(self, start: int, end: int) -> Span:
        return Span(self.source, start, end)

    def insert(self, offset: int, text: str) -> Edit:
        return Edit(Span(self.source, offset, offset), text)

    def replaced(self, token: Token, text: str) -> Edit:
        return Edit(self.span(token), text)

    def line(self, token: Token) -> int:
        return self.source.position(token.start)[0]

    def inside(self) -> str:
        """The kind of the innermost open bracket, "" at the top level."""
        closed = 0
        for value in reversed(self.machine.values):
            kind = value.kind if isinstance(value, Token) else ""
            if kind in CLOSERS:
                closed += 1
            elif kind in OPENERS and closed:
                closed -= 1
            elif kind in OPENERS:
                return kind
        return ""

    def on_same_line(self) -> bool:
        return self.at > self.item and self.line(self.token) == self.source.position(self.before.end)[0]

    def block_ahead(self) -> int | None:
        """The index of the `{` that ends this line, at the depth of the stuck token."""
        depth = 0
        for index in range(self.at, len(self.tokens)):
            kind = self.tokens[index].kind
            if kind == "LBRACE" and depth == 0:
                return index
            depth += (kind in OPENERS) - (kind in CLOSERS)
            if depth < 0 or kind in (NEWLINE, END):
                return None
        return None

    def item_end(self) -> int:
        """The index of the NEWLINE, closing bracket or END behind this item."""
        depth = 0
        for index in range(self.item, len(self.tokens)):
            kind = self.tokens[index].kind
            if depth == 0 and (kind in (NEWLINE, END) or kind in CLOSERS):
                return index
            depth += (kind in OPENERS) - (kind in CLOSERS)
        return len(self.tokens) - 1

    def hole(self) -> Token:
        """Stands for a value that is missing; becomes an `Error`."""
        return Token("NAME", self.before.end, self.before.end)

    def snag(self, message: str, span: Span, label: str, *helps: Help, code: str = "E0103") -> Snag:
        return Snag(Diagnostic(code, message, span, label, helps=helps))

    def line_end(self, start: int | None = None) -> int:
        """The index behind the tokens from `start` up to the end of the line or of the bracket around."""
        depth = 0
        for index in range(self.at if start is None else start, len(self.tokens)):
            kind = self.tokens[index].kind
            depth += (kind in OPENERS) - (kind in CLOSERS)
            if depth < 0 or kind in (NEWLINE, END):
                return index
        return len(self.tokens) - 1

    def opener(self, closer: int) -> int:
        """The index of the bracket that a closing one belongs to."""
        depth = 0
        for index in range(closer, -1, -1):
            kind = self.tokens[index].kind
            depth += (kind in CLOSERS) - (kind in OPENERS)
            if depth == 0:
                return index
        return closer
