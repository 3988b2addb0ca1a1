"""Apply the edits that diagnostics offer: `check --fix`, and `--ask` for the guesses."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from blobscript.diagnostics import Diagnostic, Edit, Help
from blobscript.source import Source

__all__ = ["Fixed", "apply_edits", "fixable"]


class Fixed(NamedTuple):
    """`text` after the edits of `applied`; helps whose edits overlap earlier ones were left out."""

    text: str
    applied: tuple[Help, ...]


def fixable(source: Source, diagnostics: Iterable[Diagnostic], certainty: str) -> list[tuple[Diagnostic, Help]]:
    """The helps of one certainty ("safe" or "guess") that edit this source and no other."""
    return [
        (diagnostic, help_)
        for diagnostic in diagnostics
        for help_ in diagnostic.helps
        if help_.edits and help_.certainty == certainty and all(e.span.source is source for e in help_.edits)
    ]


def apply_edits(source: Source, helps: Iterable[Help], certainty: str | None = None) -> Fixed:
    """The text of the source after the edits of these helps (only those of one certainty, if it is given)."""
    taken: list[Edit] = []
    applied: list[Help] = []
    for help_ in helps:
        fits = help_.edits and all(edit.span.source is source for edit in help_.edits)
        if not fits or certainty not in (None, help_.certainty):
            continue
        if not any(_overlap(edit, other) for edit in help_.edits for other in taken):
            taken += help_.edits
            applied.append(help_)
    text = source.text
    for edit in sorted(taken, key=lambda e: e.span.start, reverse=True):
        text = text[: edit.span.start] + edit.replacement + text[edit.span.end :]
    return Fixed(text, tuple(applied))


def _overlap(one: Edit, other: Edit) -> bool:
    """Two insertions at the same place overlap: their order would be a guess."""
    if one.span.start == other.span.start:
        return True
    return one.span.start < other.span.end and other.span.start < one.span.end
