"""Make every bracket match, and report those that did not, with the layout as witness.

Where all brackets match nothing is done. Otherwise indentation tells which one is at fault: a
bracket is unclosed when a later line, not indented deeper than the bracket's own, starts something
new; a `}` at the start of a line belongs to the `{` whose line is indented the same. The brackets
that are missing are put in and those too many left out, so that what follows can be read.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

from blobscript.diagnostics import Diagnostic, Edit, Help, Label
from blobscript.signatures import BUILTINS
from blobscript.source import Source, Span
from blobscript.tokens import CLOSERS, END, NEWLINE, OPENERS, Token

__all__ = ["Mended", "mend"]

#: After so many findings the rest of the text is left out.
_MOST = 200

#: An edit that closes more brackets than this at one place is not written out.
_LONGEST = 50

#: A line that starts with one of these goes on with the line before, whatever its indentation.
_GOES_ON = frozenset(["PLUS", "TIMES", "OVER", "POWER", "COMPARE", "RANGE", "AND", "OR", "COMMA", "DOT", "ELSE"])


_CLOSING = {"(": ")", "[": "]", "{": "}"}

#: What is called without a block.
_PLAIN_CALLS = frozenset(name for name, row in BUILTINS.items() if not any("(children" in s for s in row.signatures))


class Mended(NamedTuple):
    tokens: list[Token]
    diagnostics: list[Diagnostic]


def mend(source: Source, tokens: list[Token]) -> Mended:
    """The tokens with matching brackets; the same list where they match already."""
    if _match(tokens):
        return Mended(tokens, [])
    return _Mender(source, tokens).run()


def _match(tokens: list[Token]) -> bool:
    stack: list[str] = []
    for token in tokens:
        if token.kind in OPENERS:
            stack.append(token.kind)
        elif token.kind in CLOSERS and (not stack or stack.pop() != CLOSERS[token.kind]):
            return False
    return not stack


@dataclass(slots=True)
class _Open:
    """An open bracket: its token, the number and indentation of its line, the `{` that ends this line inside it."""

    token: Token
    line: int
    indent: int
    block: int | None = None


class _Row(NamedTuple):
    """A line of tokens: indentation, index of its first token, and of the NEWLINE or END behind its last."""

    indent: int
    first: int
    last: int


@dataclass(slots=True)
class _Mender:
    source: Source
    tokens: list[Token]
    rows: list[_Row] = field(default_factory=list[_Row])
    stack: list[_Open] = field(default_factory=list[_Open])
    found: list[Diagnostic] = field(default_factory=list[Diagnostic])
    #: Index -> brackets to put in before this token; tokens to leave out.
    inserts: dict[int, list[Token]] = field(default_factory=dict[int, list[Token]])
    dropped: dict[int, Token | None] = field(default_factory=dict[int, Token | None])
    merge: tuple[int, int] = (-1, -1)

    def run(self) -> Mended:
        self.rows = _rows(self.source, self.tokens)
        for number, row in enumerate(self.rows):
            self._layout(number, row)
            for index in range(row.first, row.last):
                kind = self.tokens[index].kind
                if kind in OPENERS:
                    self._open(number, index)
                elif kind in CLOSERS:
                    self._close(number, index)
                if len(self.found) >= _MOST:
                    return self._give_up(index)
        last = len(self.tokens) - 1
        while self.stack:
            self._unclosed(self.stack.pop(), last, None)
        return Mended(self._result(), _one_per_line(self.found))

    def _give_up(self, index: int) -> Mended:
        """Too many findings: what follows is left out, what is open is closed without a word."""
        found = self.found
        self.tokens = [*self.tokens[: index + 1], self.tokens[-1]]
        place = self.tokens[-1].start
        closing = [Token(OPENERS[entry.token.kind], place, place) for entry in reversed(self.stack)]
        self.inserts.setdefault(index + 1, []).extend(closing)
        return Mended(self._result(), _one_per_line(found))

    def _result(self) -> list[Token]:
        out: list[Token] = []
        for index, token in enumerate(self.tokens):
            out += self.inserts.get(index, ())
            kept = self.dropped.get(index, token) if index in self.dropped else token
            if kept is not None:
                out.append(kept)
        return out

    # ---- the three cases ----------------------------------------------------------------

    def _layout(self, number: int, row: _Row) -> None:
        """A line that starts something new, not deeper than an open bracket's line: that bracket is unclosed."""
        token = self.tokens[row.first]
        if token.kind in CLOSERS or token.kind in _GOES_ON:
            return
        while self.stack and self.stack[-1].line < number and self.stack[-1].indent >= row.indent:
            if token.kind == "LBRACE" and self.stack[-1].token.kind != "LBRACE":
                return
            self._unclosed(self.stack.pop(), self.rows[number - 1].last, token)

    def _open(self, number: int, index: int) -> None:
        """Note a `{` that ends the line of the parentheses it stands in, or that cannot belong to the call before
        it, as in `clay(red) {`: an unclosed one should end before it."""
        token = self.tokens[index]
        if token.kind == "LBRACE" and (self.tokens[index + 1].kind in (NEWLINE, END) or self._takes_no_block(index)):
            for outer in reversed(self.stack):
                if outer.line != number or outer.token.kind == "LBRACE":
                    break
                outer.block = index if outer.block is None else outer.block
        self.stack.append(_Open(token, number, self.rows[number].indent))

    def _takes_no_block(self, index: int) -> bool:
        """Is the `{` at `index` behind the arguments of something that is not known to take a block?"""
        depth = 0
        for at in range(index - 1, 0, -1):
            kind = self.tokens[at].kind
            depth += (kind in CLOSERS) - (kind in OPENERS)
            if depth == 0:
                name = self.tokens[at - 1]
                return kind == "LPAR" and name.kind == "NAME" and self._span(name).text in _PLAIN_CALLS
        return False

    def _close(self, number: int, index: int) -> None:
        token, row = self.tokens[index], self.rows[number]
        opener = CLOSERS[token.kind]
        first = index == row.first
        if not any(entry.token.kind == opener for entry in self.stack):
            self._stray(number, index)
            return
        top = self.stack[-1]
        if top.token.kind == opener:
            if first and row.indent > top.indent and self._better_follows(number, top.indent, token.kind):
                self._stray(number, index)
                return
            partner = self._partner(opener, row.indent) if first and top.indent > row.indent else None
            while partner and self.stack[-1] is not partner:
                self._unclosed(self.stack.pop(), self.rows[number - 1].last, token)
            self.stack.pop()
            return
        if top.line == number and self._fits(index, OPENERS[top.token.kind]):
            self._wrong(index)
            return
        partner = next(entry for entry in reversed(self.stack) if entry.token.kind == opener)
        between = self.stack[self.stack.index(partner) + 1 :]
        aligned = first and partner.indent == row.indent
        if not aligned and any(e.token.kind == "LBRACE" and e.line < number for e in between):
            self._stray(number, index)
            return
        while self.stack[-1] is not partner:
            at = self.rows[number - 1].last if first else index
            self._unclosed(self.stack.pop(), at, token if first else None)
        self.stack.pop()

    def _better_follows(self, number: int, indent: int, closer: str) -> bool:
        """Whether the next line that is not deeper starts with the closer that an opener of this indent wants."""
        for row in self.rows[number + 1 :]:
            if row.indent <= indent:
                return row.indent == indent and self.tokens[row.first].kind == closer
        return False

    def _partner(self, opener: str, indent: int) -> _Open | None:
        """The innermost open bracket of a kind whose line is indented like the closer's, or less."""
        return next((e for e in reversed(self.stack) if e.token.kind == opener and e.indent <= indent), None)

    def _fits(self, index: int, closer: str) -> bool:
        """Whether the rest of the line matches if the closer at `index` is read as another one."""
        stack = [entry.token.kind for entry in self.stack]
        line = self.stack[-1].line
        outside = sum(entry.line < line or entry.token.kind == "LBRACE" for entry in self.stack)
        kinds = [closer]
        for token in self.tokens[index + 1 : index + 100]:
            if token.kind in (NEWLINE, END):
                break
            kinds.append(token.kind)
        for kind in kinds:
            if kind in OPENERS:
                stack.append(kind)
            elif kind in CLOSERS and (not stack or stack.pop() != CLOSERS[kind]):
                return False
        return len([kind for kind in stack if kind != "LBRACE"]) <= outside

    # ---- findings -------------------------------------------------------------------------

    def _span(self, token: Token) -> Span:
        return Span(self.source, token.start, token.end)

    def _unclosed(self, entry: _Open, at: int, next_token: Token | None) -> None:
        """E0101. `at` is the index of the token before which it ends at the latest."""
        closer = OPENERS[entry.token.kind]
        block = entry.block if entry.token.kind != "LBRACE" else None
        at = at if block is None else block
        if block is None and self.tokens[at - 1].kind == "COMMA" and self._in_list(entry):
            at -= 1
        place = self.tokens[at - 1].end if at else 0
        self.inserts.setdefault(at, []).append(Token(closer, place, place))
        edit = self._closing_edit(entry, at, place)
        if self.merge[0] == at and self.merge[1] == len(self.found) - 1:
            self._also(edit)
            return
        self.merge = (at, len(self.found))
        sign = self._span(entry.token).text
        labels, advice = (), "close it here"
        if block is not None:
            label = "a block starts here, so the arguments should end before it"
            labels, advice = (Label(self._span(self.tokens[block]), label),), "close it before the block"
        elif next_token is not None:
            labels = (Label(self._span(next_token), "this is not indented deeper, so it should end before"),)
        message = f"this `{sign}` is never closed"
        help_ = Help(advice, (edit,))
        notes = self._commented(entry.token)
        self.found.append(Diagnostic("E0101", message, self._span(entry.token), "opened here", labels, (help_,), notes))

    def _commented(self, opener: Token) -> tuple[str, ...]:
        """What closes it may stand behind a `//` that was meant to divide."""
        _, slashes, rest = self.source.text[opener.end :].partition("\n")[0].partition("//")
        if not slashes or _CLOSING[self._span(opener).text] not in rest:
            return ()
        return ("`//` starts a comment: the rest of the line is not read. A whole quotient is floor(a / b)",)

    def _in_list(self, entry: _Open) -> bool:
        """Whether the bracket stands on a line of its own inside another list: the comma there belongs outside."""
        return bool(self.stack) and self.stack[-1].token.kind != "LBRACE"

    def _closing_edit(self, entry: _Open, at: int, place: int) -> Edit:
        text = self._span(entry.token).text
        sign = _CLOSING[text]
        alone = sign == "}" and self.tokens[at].kind in (NEWLINE, END)
        if alone and self.source.position(entry.token.start)[0] < self.source.position(place)[0]:
            sign = "\n" + " " * entry.indent + sign
        elif sign == "}":
            sign = " " + sign
        return Edit(Span(self.source, place, place), sign)

    def _also(self, edit: Edit) -> None:
        """One more bracket that ends at the place of the last finding."""
        last = self.found[-1]
        old = last.helps[0].edits[0]
        if len(old.replacement) > _LONGEST:
            return
        both = Edit(old.span, old.replacement + edit.replacement)
        self.found[-1] = replace(last, helps=(replace(last.helps[0], edits=(both,)),))

    def _wrong(self, index: int) -> None:
        """A closer of the wrong kind, where the right one makes the line match."""
        token, entry = self.tokens[index], self.stack.pop()
        sign, right = self._span(token).text, _CLOSING[self._span(entry.token).text]
        self.dropped[index] = Token(OPENERS[entry.token.kind], token.start, token.end)
        self.found.append(
            Diagnostic(
                "E0102",
                f"`{sign}` cannot close this `{self._span(entry.token).text}`",
                self._span(token),
                f"`{right}` belongs here",
                (Label(self._span(entry.token), "opened here"),),
                (Help(f"close it with `{right}`", (Edit(self._span(token), right),)),),
            )
        )

    def _stray(self, number: int, index: int) -> None:
        """A closer without opener: one of the wrong kind, or its opener is missing, or it is too many."""
        token, row = self.tokens[index], self.rows[number]
        if self.stack and self.stack[-1].line == number and self.stack[-1].token.kind != "LBRACE":
            self._wrong(index)
            return
        header = self._header(number) if token.kind == "RBRACE" and index == row.first else None
        if header is not None:
            self._headless(header, token)
            return
        self.dropped[index] = None
        if index - 1 in self.dropped:
            return
        sign = self._span(token).text
        self.found.append(
            Diagnostic(
                "E0102",
                f"this `{sign}` closes nothing",
                self._span(token),
                "no bracket of its kind is open here",
                helps=(Help("leave it out", (Edit(self._span(token), ""),)),),
            )
        )

    def _header(self, number: int) -> _Row | None:
        """The line that lost its `{`: indented like the `}`, above deeper lines, with no bracket open since."""
        indent = self.rows[number].indent
        above = number - 1
        while above >= 0 and self.rows[above].indent > indent:
            above -= 1
        if above < 0 or above == number - 1 or self.rows[above].indent != indent:
            return None
        row = self.rows[above]
        inside = self.stack[-1].token.start if self.stack else -1
        ends_open = self.tokens[row.last - 1].kind in (*OPENERS, *CLOSERS) and self.tokens[row.last - 1].kind != "RPAR"
        return None if ends_open or inside > self.tokens[row.first].start else row

    def _headless(self, header: _Row, closer: Token) -> None:
        place = self.tokens[header.last - 1].end
        self.inserts.setdefault(header.last, []).append(Token("LBRACE", place, place))
        line = Span(self.source, self.tokens[header.first].start, place)
        self.found.append(
            Diagnostic(
                "E0102",
                "a `{` is missing at the end of this line",
                line,
                "a block should start behind this",
                (Label(self._span(closer), "this `}` closes nothing else"),),
                (Help("open the block", (Edit(Span(self.source, place, place), " {"),)),),
            )
        )


def _one_per_line(found: list[Diagnostic]) -> list[Diagnostic]:
    """Brackets that miss each other on one line are one mistake."""
    lines: dict[int, Diagnostic] = {}
    for diagnostic in found:
        lines.setdefault(diagnostic.line, diagnostic)
    return list(lines.values())


def _rows(source: Source, tokens: list[Token]) -> list[_Row]:
    rows: list[_Row] = []
    first = 0
    for index, token in enumerate(tokens):
        if token.kind not in (NEWLINE, END):
            continue
        if index > first:
            rows.append(_Row(_indent(source, tokens[first]), first, index))
        first = index + 1
    return rows


def _indent(source: Source, token: Token) -> int:
    return token.start - (source.text.rfind("\n", 0, token.start) + 1)
