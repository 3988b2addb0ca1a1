"""Source -> syntax tree, and everything that is wrong with the writing of it."""

from __future__ import annotations

from blobscript import syntax as s
from blobscript.build import Builder
from blobscript.diagnostics import Diagnostic
from blobscript.files import read_source
from blobscript.lex import lex, lex_part
from blobscript.machine import Machine
from blobscript.source import Source, Span

__all__ = ["parse", "read_source"]


def parse(source: Source) -> tuple[s.Script, list[Diagnostic]]:
    builder = Builder(source, lambda start, end: part(start, end))
    make = builder.actions()

    def part(start: int, end: int) -> s.Expr:
        lexed = lex_part(source, start, end)
        machine = Machine(lexed.tokens, "lone_expr", make)
        if machine.run():
            return machine.values[-1]
        return s.Error(Span(source, start, end))

    lexed = lex(source)
    machine = Machine(lexed.tokens, "start", make)
    diagnostics = list(lexed.diagnostics)
    while not machine.run():
        token = machine.tokens[machine.at]
        span = Span(source, token.start, token.end)
        diagnostics.append(Diagnostic("E0103", f"`{span.text}` does not fit here", span))
        return s.Script(source, None, (s.Error(Span(source, 0, len(source.text))),)), diagnostics
    return machine.values[-1], sorted(diagnostics + builder.diagnostics, key=lambda d: d.span.start)
