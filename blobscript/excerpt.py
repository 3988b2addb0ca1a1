"""Pieces of source text with marks beneath: the pictures inside a diagnostic.

A line is shown as columns of a terminal, not characters: tabs go to the next multiple of four, wide
characters take two columns, combining ones none, and what cannot be shown is replaced. `Line` knows
where each character went. Very long lines are cut to a window around their marks.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import accumulate

from blobscript.diagnostics import Edit
from blobscript.paint import Paint
from blobscript.source import Source, Span

__all__ = ["Mark", "edited_lines", "marked_lines"]

_TAB = 4
#: Lines wider than this are cut; what is left of the first mark in the window.
_WIDEST, _BEFORE = 200, 60


@dataclass(frozen=True, slots=True)
class Mark:
    """Something to point at. The primary one has `^` beneath, others `-`."""

    span: Span
    text: str
    primary: bool


class Line:
    """A source line as shown: `text`, and `column(i)`, the column where its character i begins."""

    def __init__(self, raw: str) -> None:
        shown: list[str] = []
        at = 0
        for sign in raw:
            piece, width = _shown(sign, at)
            shown.append(piece)
            at += width
        self.text = "".join(shown)
        self.length = len(raw)
        self._columns = [0, *accumulate(_width(piece) for piece in shown)]

    def column(self, index: int) -> int:
        """Beyond the end of the line each character counts one column."""
        last = len(self._columns) - 1
        return self._columns[index] if index <= last else self._columns[last] + index - last


def _shown(sign: str, at: int) -> tuple[str, int]:
    if sign == "\t":
        width = _TAB - at % _TAB
        return " " * width, width
    if unicodedata.category(sign) in ("Cc", "Cs", "Zl", "Zp", "Co", "Cn"):
        return "�", 1
    if unicodedata.category(sign) == "Cf":
        return "", 0
    return sign, _width(sign)


def _width(text: str) -> int:
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(sign) or sign == "\u200d" else 2 if unicodedata.east_asian_width(sign) in "WF" else 1
        for sign in text
    )


# ---- marked source lines ----------------------------------------------------------------


def marked_lines(marks: Sequence[Mark], gutter: int, paint: Paint) -> list[str]:
    """The lines of one source that bear marks, in order, each with its marks beneath."""
    by_line: dict[int, list[Mark]] = {}
    for mark in marks:
        by_line.setdefault(mark.span.line, []).append(mark)
    out: list[str] = []
    before: int | None = None
    for number in sorted(by_line):
        out += _between(before, number, marks[0].span.source, gutter, paint)
        out += _one_line(by_line[number], number, gutter, paint)
        before = number
    return out


def _between(before: int | None, number: int, source: Source, gutter: int, paint: Paint) -> list[str]:
    """What stands between two marked lines: a single line itself, more as dots."""
    if before is None or number == before + 1:
        return []
    if number == before + 2:
        return [_numbered(before + 1, Line(_cropped(source.line(before + 1), 0)[0]).text, gutter, paint)]
    return [paint.gutter("...")]


def _numbered(number: int, text: str, gutter: int, paint: Paint) -> str:
    margin = paint.gutter(f"{number:>{gutter}} |")
    return f"{margin} {text}".rstrip()


@dataclass(frozen=True, slots=True)
class _Placed:
    """A mark as columns of its line: [start, end)."""

    start: int
    end: int
    mark: Mark


def _one_line(marks: list[Mark], number: int, gutter: int, paint: Paint) -> list[str]:
    source = marks[0].span.source
    raw = source.line(number)
    primary = next((mark for mark in marks if mark.primary), marks[0])
    text, shift = _cropped(raw, primary.span.column - 1)
    line = Line(text)
    placed = [_place(mark, raw, shift, line) for mark in marks]
    placed = sorted((p for p in placed if p is not None), key=lambda p: (p.start, p.end, p.mark.primary))
    margin = paint.gutter(f"{'':{gutter}} |")
    rows = [_numbered(number, line.text, gutter, paint)]
    rows += [f"{margin} {row}" for row in _marks_beneath(placed, paint)]
    return rows


def _cropped(raw: str, first: int) -> tuple[str, int]:
    """A long line cut to a window around its character `first`, and what to take off an index into it."""
    if len(raw) <= _WIDEST:
        return raw, 0
    left = max(0, first - _BEFORE)
    head = "..." if left else ""
    tail = "..." if left + _WIDEST < len(raw) else ""
    return head + raw[left : left + _WIDEST] + tail, left - len(head)


def _place(mark: Mark, raw: str, shift: int, line: Line) -> _Placed | None:
    """A span that goes on below is marked to the end of its first line; one outside of the window not at all."""
    span = mark.span
    first = span.column - 1
    last = min(first + span.end - span.start, max(len(raw), first + 1)) - shift
    first -= shift
    if last < 0 or first > line.length:
        return None
    start = line.column(max(first, 0))
    return _Placed(start, max(line.column(min(last, max(line.length, first + 1))), start + 1), mark)


def _marks_beneath(placed: list[_Placed], paint: Paint) -> list[str]:
    """The row of marks with the last label beside it, then the other labels hanging below, last first."""
    if not placed:
        return []
    row = _canvas_row(placed)
    hanging = [p for p in placed if p.mark.text]
    beside = ""
    if hanging and hanging[-1].end >= max(p.end for p in placed):
        last = hanging.pop()
        beside = " " + paint.mark(last.mark.text, last.mark.primary)
    rows = [_painted_marks(row, paint) + beside]
    while hanging:
        columns = sorted({p.start for p in hanging})
        rows.append(_at_columns([(column, "|") for column in columns], hanging, paint))
        last = hanging.pop()
        bars = [(column, "|") for column in columns if column < last.start]
        rows.append(_at_columns([*bars, (last.start, last.mark.text)], [*hanging, last], paint))
    return rows


def _canvas_row(placed: Iterable[_Placed]) -> str:
    placed = sorted(placed, key=lambda p: p.mark.primary)
    row = [" "] * max(p.end for p in placed)
    for p in placed:
        row[p.start : p.end] = ("^" if p.mark.primary else "-") * (p.end - p.start)
    return "".join(row)


def _painted_marks(row: str, paint: Paint) -> str:
    if not paint.on:
        return row
    return "".join(paint.mark(sign, sign == "^") if sign != " " else sign for sign in row)


def _at_columns(pieces: list[tuple[int, str]], placed: list[_Placed], paint: Paint) -> str:
    primary = {p.start for p in placed if p.mark.primary}
    out, at = "", 0
    for column, text in pieces:
        out += " " * (column - at) + paint.mark(text, column in primary)
        at = column + _width(text)
    return out


# ---- lines after an edit --------------------------------------------------------------------


def edited_lines(edits: Sequence[Edit], gutter: int, paint: Paint) -> list[str]:
    """The lines as they are after the edits: `+` under what is new, `~` under what changed."""
    ordered = sorted(edits, key=lambda e: (e.span.start, e.span.end))
    source = ordered[0].span.source
    first = source.position(ordered[0].span.start)[0]
    text, changes = _after(source, first, ordered)
    out: list[str] = []
    offset = 0
    before = first - 1
    for number, raw in enumerate(text.split("\n"), first):
        end = offset + len(raw)
        touching = [change for change in changes if change[0] <= end and change[1] >= offset]
        if touching:
            if number > before + 1:
                out.append(paint.gutter("..."))
            here = [(max(a, offset) - offset, min(b, end) - offset, sign) for a, b, sign in touching]
            marks = [mark for mark, (a, b, _) in zip(here, touching, strict=True) if mark[0] < mark[1] or a == b]
            out += _edited_line(raw.rstrip("\r"), number, marks, gutter, paint)
            before = number
        offset = end + 1
    return out


#: Half-open range of offsets in the new text, and the sign under it. Nothing is marked under a mere line end.
_Change = tuple[int, int, str]


def _after(source: Source, first: int, edits: list[Edit]) -> tuple[str, list[_Change]]:
    """The text of the touched lines after the edits, and where it changed."""
    start = edits[0].span.start - (source.position(edits[0].span.start)[1] - 1)
    last = max(edit.span.end for edit in edits)
    stop = source.text.find("\n", last)
    stop = len(source.text) if stop < 0 else stop
    out, at = "", start
    changes: list[_Change] = []
    for edit in edits:
        out += source.text[at : edit.span.start]
        changes.append(_change(edit, len(out)))
        out += edit.replacement
        at = max(at, edit.span.end)
    return out + source.text[at:stop], changes


def _change(edit: Edit, at: int) -> _Change:
    """What the edit really changes: common beginning and end of old and new are left out."""
    old, new = edit.span.text, edit.replacement
    head = 0
    while head < min(len(old), len(new)) and old[head] == new[head]:
        head += 1
    tail = 0
    while tail < min(len(old), len(new)) - head and old[-1 - tail] == new[-1 - tail]:
        tail += 1
    start, end = at + head, at + len(new) - tail
    return start, max(end, start), "+" if len(old) == head + tail else "~"


def _edited_line(raw: str, number: int, changes: list[_Change], gutter: int, paint: Paint) -> list[str]:
    raw, shift = _cropped(raw, changes[0][0] if changes else 0)
    line = Line(raw)
    row: list[str] = []
    for start, end, sign in changes:
        if start - shift <= line.length:
            left = line.column(start - shift)
            right = max(line.column(min(end - shift, line.length)), left + 1)
            row += [" "] * (left - len(row))
            row[left:right] = [sign] * (right - left)
    rows = [_numbered(number, line.text, gutter, paint)]
    if row:
        signs = "".join(paint.edit(sign) if sign != " " else sign for sign in row)
        rows.append(paint.gutter(f"{'':{gutter}} |") + f" {signs}")
    return rows
