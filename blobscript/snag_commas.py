"""Rules for commas and line ends between items and elements."""

from __future__ import annotations

from blobscript.diagnostics import Diagnostic, Edit, Help
from blobscript.stuck import ITEM_STARTS, VALUE_STARTS, Repair, Snag, Stuck
from blobscript.tokens import CLOSERS, END, NEWLINE, OPENERS, Token

__all__ = [
    "comma_in_block",
    "missing_comma",
    "missing_times",
    "two_items",
]


def comma_in_block(s: Stuck) -> Snag | None:
    """A comma between the items of a block; all commas at line ends of the same block go along."""
    if s.token.kind != "COMMA" or s.inside() not in ("", "LBRACE"):
        return None
    if not s.machine.accepts(NEWLINE) and not s.machine.accepts("RBRACE"):
        return None
    edits: list[Edit] = []
    repairs: list[Repair] = []
    for index in _commas(s):
        edit, tokens = _without_comma(s, index)
        edits.append(edit)
        repairs.insert(0, Repair(index, 1, tokens))
    where = "in a block" if s.inside() else "between items"
    diagnostic = Diagnostic(
        "E0105",
        f"no comma {where}: the end of a line ends an item",
        s.span(s.token),
        "not needed",
        helps=(Help("leave it out" if len(edits) == 1 else "leave them out", tuple(edits), "safe"),),
    )
    return Snag(diagnostic, tuple(repairs))


def _commas(s: Stuck) -> list[int]:
    """The stuck comma and those behind it that end a line of the same block."""
    found = [s.at]
    depth = 0
    for index in range(s.at + 1, len(s.tokens) - 1):
        kind = s.tokens[index].kind
        if depth == 0 and kind in CLOSERS:
            break
        depth += (kind in OPENERS) - (kind in CLOSERS)
        if depth == 0 and kind == "COMMA" and len(found) < 20 and _ends_line(s, index):
            found.append(index)
    return found


def _ends_line(s: Stuck, index: int) -> bool:
    after = s.tokens[index + 1]
    return after.kind != "STRING" and s.line(after) > s.line(s.tokens[index])


def _without_comma(s: Stuck, index: int) -> tuple[Edit, tuple[Token, ...]]:
    comma, after = s.tokens[index], s.tokens[index + 1]
    if after.kind in (NEWLINE, END, "RBRACE"):
        return s.replaced(comma, ""), ()
    newline = (Token(NEWLINE, comma.start, comma.end),)
    if s.line(after) > s.line(comma):
        return s.replaced(comma, ""), newline
    return Edit(s.place(comma.start, after.start), "\n" + _indent(s)), newline


def _indent(s: Stuck) -> str:
    line = s.source.line(s.line(s.tokens[s.item]))
    return line[: len(line) - len(line.lstrip())]


def two_items(s: Stuck) -> Snag | None:
    """E0104: an item that starts where another one has just ended."""
    if not s.on_same_line() or s.token.kind not in ITEM_STARTS - {"AT"} or s.inside() not in ("", "LBRACE"):
        return None
    if not s.machine.accepts(NEWLINE):
        return None
    gap = s.place(s.before.end, s.token.start)
    diagnostic = Diagnostic(
        "E0104",
        "two items stand on one line",
        s.span(s.token),
        "a new item starts here",
        helps=(Help("put it on a line of its own", (Edit(gap, "\n" + _indent(s)),)),),
    )
    return Snag(diagnostic, (Repair(s.at, 0, (Token(NEWLINE, s.token.start, s.token.start),)),))


def missing_times(s: Stuck) -> Snag | None:
    """`2 x`."""
    if s.before.kind not in ("NUMBER", "ANGLE") or s.token.kind not in ("NAME", "LPAR") or not s.on_same_line():
        return None
    if not s.machine.accepts("TIMES") or s.after.kind == "EQUAL":
        return None
    found = s.snag(
        "`*` is missing between these two", s.place(s.before.start, s.token.end), "to multiply, write *",
        Help("write", (Edit(s.place(s.before.end, s.token.start), " * "),)),
    )  # fmt: skip
    return Snag(found.diagnostic, (Repair(s.at, 0, (Token("TIMES", s.before.end, s.before.end),)),))


def missing_comma(s: Stuck) -> Snag | None:
    """Two values next to each other inside ( ) or [ ]."""
    if s.inside() not in ("LPAR", "LSQB") or s.token.kind not in VALUE_STARTS | {"SPREAD", "FOR"}:
        return None
    if not s.machine.accepts("COMMA"):
        return None
    found = s.snag(
        "a comma is missing", s.span(s.token), "before this",
        Help("write", (s.insert(s.before.end, ","),)),
    )  # fmt: skip
    return Snag(found.diagnostic, (Repair(s.at, 0, (Token("COMMA", s.before.end, s.before.end),)),))
