"""Words of POV-Ray's scene language, with their places."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from blobscript.diagnostics import Diagnostic, Help, ProgramError
from blobscript.source import Source, Span

__all__ = ["Word", "refused", "words_of"]

Kind = Literal["number", "name", "text", "directive", "sign", "end"]

_WORD = re.compile(
    r"(?P<number>(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)"
    r"|(?P<directive>#\s*[A-Za-z_]+)"
    r"|(?P<name>[A-Za-z_]\w*)"
    r'|(?P<text>"(\\.|[^"\\])*")'
    r"|(?P<sign><=|>=|!=|[-+*/<>(){}\[\],;=.?:!&|])"
)
_GAP = re.compile(r"\s+|//[^\n]*")


@dataclass(frozen=True, slots=True)
class Word:
    """`text` is as written; of a directive it is the name without # and blanks."""

    kind: Kind
    text: str
    span: Span


def refused(message: str, span: Span, *helps: str) -> ProgramError:
    """E1002 at a place."""
    return ProgramError([Diagnostic("E1002", message, span, helps=tuple(Help(text) for text in helps))])


def words_of(source: Source) -> list[Word]:
    """All of a text; the last one is of the kind "end"."""
    text, at, found = source.text, 0, list[Word]()
    while at < len(text):
        if gap := _GAP.match(text, at):
            at = gap.end()
        elif text.startswith("/*", at):
            at = _comment_end(source, at)
        elif word := _WORD.match(text, at):
            found.append(_word(source, word))
            at = word.end()
        else:
            raise refused(f"`{text[at]}` means nothing here", Span(source, at, at + 1))
    found.append(Word("end", "the end of the file", Span(source, len(text), len(text))))
    return found


_KINDS: tuple[Kind, ...] = ("number", "directive", "name", "text", "sign")


def _word(source: Source, match: re.Match[str]) -> Word:
    kind: Kind = "sign"
    for known in _KINDS:
        if match[known] is not None:
            kind = known
    text = match[0].lstrip("# \t") if kind == "directive" else match[0]
    return Word(kind, text, Span(source, match.start(), match.end()))


def _comment_end(source: Source, start: int) -> int:
    """Comments nest."""
    depth, at = 0, start
    marks = re.compile(r"/\*|\*/")
    while mark := marks.search(source.text, at):
        depth += 1 if mark[0] == "/*" else -1
        at = mark.end()
        if depth == 0:
            return at
    raise refused("this comment does not end", Span(source, start, start + 2))
