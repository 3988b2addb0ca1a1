"""Text -> tokens: words, brackets that match, and line ends only where they end an item.

Three steps. `_scan` cuts the text by the terminals of the grammar. `brackets.mend` makes every
bracket match (and reports those that did not). `_filter` drops the line ends that end nothing:
the rule is at the top of `grammar/blobscript.lark`.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from blobscript import brackets, tables
from blobscript.diagnostics import Diagnostic
from blobscript.source import Source
from blobscript.tokens import CLOSERS, END, NEWLINE, OPENERS, Token

__all__ = ["TooLongError", "lex", "lex_part"]

#: A line that ends with one of these goes on.
_OPEN_END = frozenset(
    """PLUS MINUS TIMES OVER POWER COMPARE RANGE SPREAD AND OR NOT IN STEP ELSE RETURN
    EQUAL COMMA COLON ARROW LPAR LSQB LBRACE""".split()  # noqa: SIM905 - reads better than a list of texts
)

#: A line that starts with one of these continues the one before.
_OPEN_START = frozenset(
    """PLUS TIMES OVER POWER COMPARE RANGE AND OR ELSE COMMA DOT LBRACE
    RPAR RSQB RBRACE $END""".split()  # noqa: SIM905
)

#: After so many unknown signs the rest of the text is left out.
_MOST = 200

#: Scripts with more words are refused: they are data, and would take more than a few seconds.
MAX_TOKENS = 1_200_000

_SKIPPED = frozenset(("WS", "COMMENT"))


class TooLongError(Exception):
    """More than MAX_TOKENS tokens; caught in `parse`."""


_PATTERN = re.compile("|".join(f"(?P<{name}>{pattern})" for name, pattern in tables.load().terminals))


class Lexed(NamedTuple):
    """`tokens` end with one of kind END."""

    tokens: list[Token]
    diagnostics: list[Diagnostic]


def lex(source: Source) -> Lexed:
    """All tokens of a file, whose brackets match."""
    scanned = _scan(source, 1 if source.text.startswith("\ufeff") else 0, len(source.text))
    mended = brackets.mend(source, scanned.tokens)
    return Lexed(_filter(mended.tokens), scanned.diagnostics + mended.diagnostics)


def lex_part(source: Source, start: int, end: int) -> Lexed:
    """The tokens of a piece of a line: what stands between `{ }` in a text."""
    scanned = _scan(source, start, end)
    mended = brackets.mend(source, scanned.tokens)
    return Lexed(mended.tokens, scanned.diagnostics + mended.diagnostics)


def _scan(source: Source, position: int, stop: int) -> Lexed:
    """Cut the text; what fits no terminal is reported, and replaced where one can guess what was meant."""
    text = source.text
    match = _PATTERN.match
    words = tables.load().words
    tokens: list[Token] = []
    diagnostics: list[Diagnostic] = []
    opened: list[str] = []
    before = NEWLINE
    while position < stop:
        found = match(text, position, stop)
        if found is None:
            if len(diagnostics) >= _MOST:
                break
            from blobscript import strays  # right scripts do not need it

            stray = strays.diagnose(source, position, stop, before == NEWLINE)
            diagnostics.append(stray.diagnostic)
            while stray.tokens and tokens and tokens[-1].start >= stray.tokens[0].start:
                tokens.pop()
            tokens += stray.tokens
            position = stray.end
            before = tokens[-1].kind if tokens else NEWLINE
            continue
        end = found.end()
        kind: str = found.lastgroup  # type: ignore[assignment]
        if kind not in _SKIPPED:
            if kind == "NAME":
                word = found.group()
                if word in words and _is_reserved(text, word, end, tokens, bool(opened) and opened[-1] != "LBRACE"):
                    kind = words[word]
            elif kind in OPENERS:
                opened.append(kind)
            elif kind in CLOSERS and opened:
                opened.pop()
            tokens.append(Token(kind, position, end))
            before = kind
            if len(tokens) > MAX_TOKENS:
                raise TooLongError(position)
        position = end
    tokens.append(Token(END, position, position))
    return Lexed(tokens, diagnostics)


_LABEL = re.compile(r"(?:[ \t\f\r\n]|//[^\n]*)*(?::|=(?!=))")
_NEXT_NAME = re.compile(r"[ \t]*[A-Za-z_]")
_NEXT_NUMBER = re.compile(r"[ \t]*[0-9]")


def _is_reserved(text: str, word: str, end: int, tokens: list[Token], in_parentheses: bool) -> bool:
    """Whether this use of a reserved word, which `tokens` stand before, is the reserved one (see the grammar)."""
    new_line = not tokens or tokens[-1].kind == NEWLINE
    before = next((token.kind for token in reversed(tokens) if token.kind != NEWLINE), NEWLINE)
    if before == "DOT":
        return new_line and not in_parentheses
    if before in ("LPAR", "COMMA"):
        return not _LABEL.match(text, end)
    if word == "kernel":
        return _NEXT_NAME.match(text, end) is not None
    if word == "blobscript":
        return not tokens or (new_line and _NEXT_NUMBER.match(text, end) is not None)
    return True


def _filter(tokens: list[Token]) -> list[Token]:
    """Drop the line ends that end no item, and runs of them."""
    kept: list[Token] = []
    open_brackets = [NEWLINE]
    before = NEWLINE
    waiting: Token | None = None
    for token, after in zip(tokens, [*tokens[1:], tokens[-1]], strict=True):
        kind = token.kind
        if kind == NEWLINE:
            if before not in _OPEN_END and before != NEWLINE and open_brackets[-1] not in ("LPAR", "LSQB"):
                waiting = token if waiting is None else Token(NEWLINE, waiting.start, token.end)
            continue
        if waiting is not None:
            if kind not in _OPEN_START or (kind == "OVER" and after.kind == "TIMES"):  # `/*` divides nothing
                kept.append(waiting)
            waiting = None
        if kind in ("LPAR", "LSQB", "LBRACE"):
            open_brackets.append(kind)
        elif kind in ("RPAR", "RSQB", "RBRACE") and len(open_brackets) > 1:
            open_brackets.pop()
        kept.append(token)
        before = kind
    return kept
