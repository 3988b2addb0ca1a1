"""Formats scripts: one way to space and indent, the author's choice of lines.

Works on the tokens, so that nothing is lost: comments are tokens like the others. Line breaks stay
where the author put them, as far as they make sense (`_settled`), and lines longer than the width are
broken at their outermost bracket (`_break_long_lines`), again and again. Breaks are only ever added
inside brackets, where they mean nothing, so the meaning cannot change. What comes out is laid out the
way it was read: formatting it again changes nothing.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from blobscript.diagnostics import Diagnostic
from blobscript.lex import lex
from blobscript.parse import parse
from blobscript.source import Source
from blobscript.spacing import roles, spaced
from blobscript.tokens import CLOSERS, NEWLINE, OPENERS

__all__ = ["WIDTH", "format_source"]

WIDTH = 100
_INDENT = "  "
_REMARK = "REMARK"
_COMMENT = re.compile(r"//[^\n]*")


@dataclass(slots=True, eq=False)
class _Piece:
    """A token or a comment. `breaks`: line ends before it, 2 with a blank line. `starts`: first of an item."""

    kind: str
    role: str
    text: str
    breaks: int
    starts: bool


def format_source(source: Source, width: int = WIDTH) -> tuple[str | None, list[Diagnostic]]:
    """The formatted text; None for a script with syntax errors, which are returned."""
    _, diagnostics = parse(source)
    if diagnostics:
        return None, diagnostics
    pieces = _settled(_pieces(source))
    while _break_long_lines(pieces, width):
        pieces = _settled(pieces)
    return _text(pieces), []


# ---- reading ----------------------------------------------------------------------------------


def _pieces(source: Source) -> list[_Piece]:
    """Tokens and the comments between them."""
    text = source.text
    tokens = lex(source).tokens[:-1]
    pieces: list[_Piece] = []
    at = 1 if text.startswith("\ufeff") else 0
    before = NEWLINE
    for token, role in zip(tokens, roles(tokens), strict=True):
        if token.kind != NEWLINE:
            at = _comments(pieces, text, at, token.start)
            breaks = min(text.count("\n", at, token.start), 2)
            starts = before in (NEWLINE, "LBRACE")
            pieces.append(_Piece(token.kind, role, text[token.start : token.end], breaks, starts))
            at = token.end
        before = token.kind
    _comments(pieces, text, at, len(text))
    return pieces


def _comments(pieces: list[_Piece], text: str, start: int, end: int) -> int:
    """Append the comments of a gap; the offset behind the last one."""
    for comment in _COMMENT.finditer(text, start, end):
        breaks = min(text.count("\n", start, comment.start()), 2)
        pieces.append(_Piece(_REMARK, _REMARK, comment[0].rstrip(), breaks, False))
        start = comment.end()
    return start


# ---- where lines break --------------------------------------------------------------------------


def _settled(pieces: list[_Piece]) -> list[_Piece]:
    """The pieces with breaks that agree with each other."""
    for index, piece in enumerate(pieces):
        piece.breaks = _simple(pieces[index - 1], piece) if index else 0
    _open_brackets(pieces)
    return [piece for index, piece in enumerate(pieces) if not _is_last_comma(pieces, index)]


def _simple(before: _Piece, piece: _Piece) -> int:
    """The breaks between two pieces, as far as these two decide."""
    if before.kind == _REMARK:
        return max(piece.breaks, 1) if piece.kind not in CLOSERS else 1
    if piece.kind == "LBRACE" or (piece.kind == "ELSE" and before.kind == "RBRACE"):
        return 0
    if before.kind in OPENERS or piece.kind in CLOSERS:
        return min(piece.breaks, 1)
    return piece.breaks


def _open_brackets(pieces: list[_Piece]) -> None:
    """A bracket that breaks on one side breaks on both; a block of more than one line does on both."""
    stack: list[tuple[int, int]] = []
    breaks = 0
    for index, piece in enumerate(pieces):
        breaks += piece.breaks > 0
        if piece.kind in OPENERS:
            stack.append((index, breaks))
        elif piece.kind in CLOSERS:
            opener, outside = stack.pop()
            first = pieces[opener + 1]
            if first is piece:
                breaks -= piece.breaks > 0
                piece.breaks = 0
                continue
            remark = first.kind == _REMARK and not first.breaks
            wide = breaks > outside if piece.kind == "RBRACE" else first.breaks or piece.breaks or remark
            for side in (first, piece):
                if wide and not side.breaks and not (side is first and remark):
                    side.breaks = 1
                    breaks += 1


def _is_last_comma(pieces: list[_Piece], index: int) -> bool:
    """Whether this is a comma right before a closing bracket on its line."""
    if pieces[index].kind != "COMMA" or index + 1 == len(pieces) or pieces[index - 1].kind == _REMARK:
        return False
    after = pieces[index + 1]
    return after.kind in CLOSERS and not after.breaks


def _break_long_lines(pieces: list[_Piece], width: int) -> bool:
    """Break every line that is too long and can be broken; whether there was one."""
    changed = False
    partners, free = _partners(pieces), _free(pieces)
    for indent, start, end in _layout(pieces):
        code = end - 1 if pieces[end - 1].kind == _REMARK and end - 1 > start else end
        if len(_line(pieces, indent, start, code)) > width:
            changed |= (
                _break_definition(pieces, indent, start, code, width)
                or _break_chain(pieces, indent, start, code, width)
                or _break_bracket(pieces, partners, start, end)
                or _break_operators(pieces, free, start, end)
            )
    return changed


def _break_definition(pieces: list[_Piece], indent: int, start: int, end: int, width: int) -> bool:
    """Behind the `=` of a definition, where both halves fit then."""
    first = pieces[start]
    if (
        not first.starts
        or first.kind not in ("LET", "FN", "KERNEL", "PARAM", "TYPE")
        or pieces[end - 1].kind in OPENERS
    ):
        return False
    places = [i for i in _shallow(pieces, start, end) if pieces[i].kind == "EQUAL"]
    if not places or places[0] + 1 >= end:
        return False
    at = places[0] + 1
    if len(_line(pieces, indent, start, at)) > width or len(_line(pieces, indent + 1, at, end)) > width:
        return False
    pieces[at].breaks = 1
    return True


def _break_chain(pieces: list[_Piece], indent: int, start: int, end: int, width: int) -> bool:
    """Before the calls of a chain, `a(…).b(…).c(…)`, where its head fits then."""
    places = [i for i in _shallow(pieces, start, end) if pieces[i].kind == "DOT" and pieces[i - 1].kind in CLOSERS]
    places = [i for i in places if i > start]
    if not places or len(_line(pieces, indent, start, places[0])) > width:
        return False
    for index in places:
        pieces[index].breaks = 1
    return True


def _shallow(pieces: list[_Piece], start: int, end: int) -> list[int]:
    """The pieces of a line that stand outside of the brackets that open on it."""
    depth = 0
    found: list[int] = []
    for index in range(start, end):
        kind = pieces[index].kind
        depth = max(depth - (kind in CLOSERS), 0)
        if depth == 0:
            found.append(index)
        depth += kind in OPENERS
    return found


def _partners(pieces: list[_Piece]) -> dict[int, int]:
    stack: list[int] = []
    partners: dict[int, int] = {}
    for index, piece in enumerate(pieces):
        if piece.kind in OPENERS:
            stack.append(index)
        elif piece.kind in CLOSERS:
            opener = stack.pop()
            partners[opener] = index
            partners[index] = opener
    return partners


def _break_bracket(pieces: list[_Piece], partners: dict[int, int], start: int, end: int) -> bool:
    """Break at the outermost bracket of a line, the longest if there are several: its elements get lines."""
    longest, best = 0, None
    index = start
    while index < end:
        if pieces[index].kind in OPENERS:
            close = partners[index]
            on_line = min(close, end)
            if on_line - index > 1 and on_line - index > longest and not pieces[index + 1].breaks and index + 1 < end:
                longest, best = on_line - index, index
            index = on_line
        index += 1
    if best is None:
        return False
    _spread(pieces, partners, best)
    return True


def _spread(pieces: list[_Piece], partners: dict[int, int], opener: int) -> None:
    close = partners[opener]
    pieces[opener + 1].breaks = pieces[opener + 1].breaks or 1
    pieces[close].breaks = 1
    index = opener + 1
    while index < close:
        after = pieces[index + 1]
        if pieces[index].kind in OPENERS:
            index = partners[index]
        elif pieces[index].kind == "COMMA" and after.kind != _REMARK and not after.breaks:
            after.breaks = 1
        index += 1


#: Loosest first. Before `-` a line of its own would be a new item, unless brackets are around it.
_OPERATORS = (("OR",), ("AND",), ("COMPARE",), ("PLUS", "MINUS"), ("TIMES", "OVER"))


def _break_operators(pieces: list[_Piece], free: list[bool], start: int, end: int) -> bool:
    """Where a line has no bracket to break at: before its loosest operators."""
    for kinds in _OPERATORS:
        places = [
            i for i in range(start + 1, end) if pieces[i].role in kinds and (free[i] or pieces[i].role != "MINUS")
        ]
        if places:
            for index in places:
                pieces[index].breaks = 1
            return True
    return False


def _free(pieces: list[_Piece]) -> list[bool]:
    """For each piece, whether it is directly inside ( ) or [ ], where line ends mean nothing."""
    stack: list[str] = []
    free: list[bool] = []
    for piece in pieces:
        if piece.kind in CLOSERS:
            stack.pop()
        free.append(bool(stack) and stack[-1] != "LBRACE")
        if piece.kind in OPENERS:
            stack.append(piece.kind)
    return free


# ---- writing ----------------------------------------------------------------------------------------


def _layout(pieces: list[_Piece]) -> list[tuple[int, int, int]]:
    """(indentation, first, behind the last) of every line."""
    starts = [index for index, piece in enumerate(pieces) if piece.breaks or not index]
    lines: list[tuple[int, int, int]] = []
    stack: list[tuple[str, int]] = []
    for start, end in zip(starts, [*starts[1:], len(pieces)], strict=False):
        indent = _indentation(pieces, start, stack, lines[-1][0] if lines else 0)
        lines.append((indent, start, end))
        for piece in pieces[start:end]:
            if piece.kind in OPENERS:
                stack.append((piece.kind, indent))
            elif piece.kind in CLOSERS:
                stack.pop()
    return lines


def _indentation(pieces: list[_Piece], start: int, stack: list[tuple[str, int]], above: int) -> int:
    """Of a line, in levels: one more than the line of the bracket around it, and one more where an item or an
    element goes on; what a `for (…)` in a list makes is one deeper than it."""
    index = start
    while index < len(pieces) and pieces[index].kind == _REMARK:
        index += 1
    bracket, outside = stack[-1] if stack else ("", -1)
    if index == len(pieces):
        return outside + 1
    piece = pieces[index]
    if piece.kind in CLOSERS:
        return outside if index == start else outside + 1
    before = _before(pieces, index)
    if bracket in ("", "LBRACE"):
        goes_on = not piece.starts and not (piece.kind == "ELSE" and before.kind == "RBRACE")
    else:
        goes_on = before.kind != "COMMA" and before.kind not in OPENERS
        if before.role == "HEADER":
            return above + 1 if index == start else outside + 2
    return outside + 2 if goes_on else outside + 1


def _before(pieces: list[_Piece], index: int) -> _Piece:
    """The last token before a piece."""
    index -= 1
    while index > 0 and pieces[index].kind == _REMARK:
        index -= 1
    return pieces[index]


def _line(pieces: list[_Piece], indent: int, start: int, end: int) -> str:
    out = [_INDENT * indent]
    left = NEWLINE
    for piece in pieces[start:end]:
        if left != NEWLINE:
            out.append("  " if piece.kind == _REMARK else " " if spaced(left, piece.role) else "")
        out.append(piece.text)
        left = piece.role
    return "".join(out)


def _text(pieces: list[_Piece]) -> str:
    lines: list[str] = []
    for indent, start, end in _layout(pieces):
        if pieces[start].breaks > 1:
            lines.append("")
        lines.append(_line(pieces, indent, start, end))
    return "".join(f"{line}\n" for line in lines)
