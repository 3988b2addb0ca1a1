"""Go on after a mistake: several findings per run, one per item.

When the parser is stuck, `snags` says why and how to mend it. A mended item is read on (or again)
with the changed tokens. An item that cannot be mended, or is stuck for the third time, is dropped:
the parser's stack is cut back to where the item began, an `Error` (or the names that the item would
have defined, with `Error` values) takes its place, and reading goes on behind it. The blocks of
a dropped item are items too: they are read on their own, for their mistakes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

from blobscript import snags
from blobscript import syntax as s
from blobscript.diagnostics import Diagnostic
from blobscript.machine import Machine, Make
from blobscript.source import Source, Span
from blobscript.tokens import CLOSERS, END, NEWLINE, OPENERS, Token

__all__ = ["Recovery"]

#: Stuck so often in one item, it is dropped; stuck so often at all, the whole script is.
_TRIES, _MOST = 3, 400

#: Dropped blocks within dropped blocks are looked into so deep.
_DEEPEST = 4


class _Item(NamedTuple):
    """Where the item that is stuck began: on the stack, in the tokens, and as what it goes onto the stack."""

    level: int
    first: int
    symbol: str


class Recovery:
    """Runs a machine to its end whatever the tokens are. Findings go to `diagnostics`."""

    def __init__(
        self, source: Source, make: dict[str, Make], known: list[Diagnostic], note_mistake: Callable[[int], None]
    ) -> None:
        self._note_mistake = note_mistake
        self.diagnostics: list[Diagnostic] = []
        self._source = source
        self._make = make
        self._known = sorted(d.span.start for d in known if d.span)
        self._stuck: Counter[int] = Counter()

    def run(self, machine: Machine, depth: int = 0) -> Any:
        """The value of the start symbol; None if even dropping items did not help."""
        while not machine.run():
            if self._stuck.total() >= _MOST or not self._go_on(machine, depth):
                return None
        return machine.values[-1] if machine.values else None

    def _go_on(self, machine: Machine, depth: int) -> bool:
        machine.settle()
        item = _locate(machine)
        if item is None:
            return False
        place = machine.tokens[item.first].start
        self._stuck[place] += 1
        self._note_mistake(machine.tokens[machine.at].start)
        if machine.at > item.first:
            self._note_mistake(machine.tokens[machine.at - 1].end)
        if self._is_known(place, machine.tokens[machine.at]):
            return self._drop(machine, item, depth)
        snag = snags.diagnose(machine, self._source, item.first)
        if self._stuck[place] == 1:
            self._report(snag.diagnostic)
        if snag.repairs and self._stuck[place] <= _TRIES:
            _mend(machine, item, snag.repairs)
            return True
        return self._drop(machine, item, depth)

    def _report(self, diagnostic: Diagnostic) -> None:
        """One finding for a line: what a mend has cut into several items is still one mistake."""
        if not self.diagnostics or self.diagnostics[-1].line != diagnostic.line:
            self.diagnostics.append(diagnostic)

    def _is_known(self, start: int, token: Token) -> bool:
        """Whether the lexer has already found a mistake in this item: on the same line, or the line before."""
        line = self._source.position(token.start)[0]
        near = (self._source.position(offset)[0] for offset in self._known if offset >= start)
        return any(line - 1 <= number <= line for number in near)

    def _drop(self, machine: Machine, item: _Item, depth: int) -> bool:
        tokens = machine.tokens
        whole_body = item.symbol == "expr"
        end = max(_end(tokens, item.first, whole_body), machine.at)
        complete = machine.accepts("RBRACE" if whole_body else tokens[end].kind)
        if depth < _DEEPEST:
            self._look_inside(tokens, machine.at, end, depth)
        if not complete:
            lost = self._lost(tokens, item, end)
            stop = tokens[end - 1].end if end > item.first else tokens[item.first].start
            machine.cut(item.level)
            machine.push(item.symbol, lost, tokens[item.first].start, max(stop, tokens[item.first].start))
        moved = machine.at < end
        machine.at = end
        if tokens[end].kind == "RBRACE" and item.symbol == "stmt":
            place = tokens[end].start
            hole = Token("NAME", place, place)
            tokens[end:end] = [Token(NEWLINE, place, place), Token("RETURN", place, place), hole]
            return True
        if not moved and self._stuck[tokens[item.first].start] > _TRIES + 2:
            if tokens[end].kind == END:
                return False
            machine.at += 1
        return True

    def _look_inside(self, tokens: list[Token], first: int, end: int, depth: int) -> None:
        """Report the mistakes in the blocks of what is dropped."""
        index = first
        while index < end:
            if tokens[index].kind != "LBRACE":
                index += 1
                continue
            close = _closer(tokens, index)
            inner = tokens[index : close + 1]
            if not any(token.kind == "RETURN" for token in inner):
                stop = inner[-1].end
                self.run(Machine(self._source, [*inner, Token(END, stop, stop)], "lone_block", self._make), depth + 1)
            index = close + 1

    def _lost(self, tokens: list[Token], item: _Item, end: int) -> Any:
        """What stands for a dropped item: its names, defined as errors, or an error."""
        start = tokens[item.first].start
        span = Span(self._source, start, max(tokens[end - 1].end, start) if end else start)
        if item.symbol == "expr":
            return s.Error(span)
        names = _defined(tokens[item.first : end])
        if names and names[0][0] == "TYPE" and item.symbol == "top":
            return s.TypeAlias(self._name(names[0][1]), s.Error(span), "", span)
        lets = [s.Let(self._name(token), None, s.Error(span), "", span) for _, token in names]
        return lets or s.Error(span)

    def _name(self, token: Token) -> s.Name:
        span = Span(self._source, token.start, token.end)
        return s.Name(span.text, span)


def _locate(machine: Machine) -> _Item | None:
    """The innermost item (or result of a function) that the parser is in."""
    for level in range(len(machine.values), -1, -1):
        symbol = next((name for name in ("top", "item", "stmt") if machine.goes_to(level, name)), None)
        last = machine.values[level - 1] if level else None
        if symbol is None and isinstance(last, Token) and last.kind == "RETURN":
            symbol = "expr"
        if symbol is not None:
            return _Item(level, _index_after(machine, level), symbol)
    return None


def _index_after(machine: Machine, level: int) -> int:
    """The index of the first token that is not in the first `level` values."""
    if level == len(machine.values):
        return machine.at
    start = machine.places[level][0]
    index = machine.at
    while index > 0 and machine.tokens[index - 1].start >= start and machine.tokens[index - 1].kind != NEWLINE:
        index -= 1
    return index


def _mend(machine: Machine, item: _Item, repairs: tuple[snags.Repair, ...]) -> None:
    """Change the tokens (from behind forwards); if one before the stuck token changes, read the item again."""
    for repair in sorted(repairs, key=lambda r: r.place, reverse=True):
        machine.tokens[repair.place : repair.place + repair.removed] = repair.tokens
    if min(repair.place for repair in repairs) < machine.at:
        machine.cut(item.level)
        machine.at = item.first


def _end(tokens: list[Token], first: int, whole_body: bool) -> int:
    """The index of the line end, closing bracket or END behind an item (`whole_body`: past line ends)."""
    depth = 0
    for index in range(first, len(tokens)):
        kind = tokens[index].kind
        if depth == 0 and (kind == END or kind in CLOSERS or (kind == NEWLINE and not whole_body)):
            return index
        depth += (kind in OPENERS) - (kind in CLOSERS)
    return len(tokens) - 1


def _closer(tokens: list[Token], opener: int) -> int:
    depth = 0
    for index in range(opener, len(tokens)):
        kind = tokens[index].kind
        depth += (kind in OPENERS) - (kind in CLOSERS)
        if depth == 0:
            return index
    return len(tokens) - 1


def _defined(tokens: list[Token]) -> list[tuple[str, Token]]:
    """(kind of definition, name) of what an item begins to define, attributes skipped."""
    index = 0
    while index < len(tokens) and tokens[index].kind == "AT":
        index = _line_end(tokens, index) + 1
    line = tokens[index : _line_end(tokens, index)]
    if not line:
        return []
    kind = line[0].kind
    if kind == "IMPORT":
        return _imported(line[1:])
    names = [token for token in line[: _head(line)] if token.kind == "NAME"]
    if kind in ("LET", "PARAM", "FN", "KERNEL", "TYPE"):
        return [(kind, name) for name in names[:1]]
    defines = kind == "NAME" and len(line) > 1 and line[1].kind == "EQUAL"
    return [("LET", line[0])] if defines else []


def _line_end(tokens: list[Token], index: int) -> int:
    while index < len(tokens) and tokens[index].kind != NEWLINE:
        index += 1
    return index


def _head(line: list[Token]) -> int:
    """Behind the name in a definition's line."""
    ends = (i for i, token in enumerate(line) if token.kind in ("EQUAL", "COLON", *OPENERS))
    return next(ends, len(line))


def _imported(tokens: list[Token]) -> list[tuple[str, Token]]:
    kinds = [token.kind for token in tokens]
    if "AS" in kinds:
        tokens = tokens[kinds.index("AS") :]
    elif "FROM" in kinds:
        tokens = tokens[: kinds.index("FROM")]
    return [("IMPORT", token) for token in tokens if token.kind == "NAME"]
