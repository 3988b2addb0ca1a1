"""Source -> syntax tree, and everything that is wrong with the writing of it.

The passes: `lex` cuts the text and mends its brackets, `machine` runs the LALR tables over the tokens,
`build` makes the nodes, `recover` and `snags` deal with what does not fit. The tree is always whole:
what could not be read is an `Error` in it.
"""

from __future__ import annotations

import gc
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace

from blobscript import syntax as s
from blobscript.build import Builder
from blobscript.diagnostics import Diagnostic, Help
from blobscript.files import MAX_SIZE, read_source
from blobscript.lex import TooLongError, lex, lex_part
from blobscript.machine import Machine
from blobscript.source import Source, Span

__all__ = ["MOST_SHOWN", "parse", "read_source"]

#: More syntax errors than this are only counted.
MOST_SHOWN = 20


def parse(source: Source) -> tuple[s.Script, list[Diagnostic]]:
    """The script and its syntax errors in order of place."""
    if len(source.text) > MAX_SIZE:
        return _too_long(source)
    try:
        with _uncollected():
            return _parse(source)
    except TooLongError:
        return _too_long(source)


@contextmanager
def _uncollected() -> Generator[None]:
    """A tree has no cycles; looking for them takes half of the time of a long script. What was made meanwhile counts
    as old afterwards, or the collector would look through all of it at once: Ctrl-C would wait for that."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            if not gc.get_freeze_count():
                gc.freeze()
                gc.unfreeze()
            gc.enable()


def _parse(source: Source) -> tuple[s.Script, list[Diagnostic]]:
    found: list[Diagnostic] = []

    def part(start: int, end: int) -> s.Expr:
        """The expression between { } in a text. One that is wrong is an error of its own."""
        lexed = lex_part(source, start, end)
        machine = Machine(source, lexed.tokens, "lone_expr", make)
        fits = machine.run()
        found.extend(lexed.diagnostics + machine.diagnostics)
        if fits:
            return machine.values[-1]
        if not lexed.diagnostics:
            found.append(_part_error(source, machine, start, end))
        return s.Error(Span(source, start, end))

    builder = Builder(source, part)
    make = builder.actions()
    lexed = lex(source)
    for diagnostic in lexed.diagnostics:
        builder.note_mistake(diagnostic.span.start if diagnostic.span else 0)
    machine = Machine(source, lexed.tokens, "start", make)
    if machine.run():
        script: s.Script = machine.values[-1]
    else:
        script, more = _recovered(source, machine, builder, lexed.diagnostics)
        found += more
    found += lexed.diagnostics + builder.diagnostics + machine.diagnostics
    return script, _first(found)


def _recovered(
    source: Source, machine: Machine, builder: Builder, known: list[Diagnostic]
) -> tuple[s.Script, list[Diagnostic]]:
    """What a stuck machine can still make of the script, and what was wrong."""
    from blobscript.recover import Recovery  # 10 ms that right scripts do not need

    recovery = Recovery(source, builder.actions(), known, builder.note_mistake)
    script = recovery.run(machine)
    return script or s.Script(source, None, (s.Error(Span(source, 0, len(source.text))),)), recovery.diagnostics


def _part_error(source: Source, machine: Machine, start: int, end: int) -> Diagnostic:
    token = machine.tokens[machine.at]
    span = Span(source, token.start, token.end) if token.end > token.start else Span(source, start, end)
    return Diagnostic(
        "E0103",
        "between { } in a text stands one expression",
        span,
        "does not fit",
        notes=("braces that are meant as such are written \\{ and \\}",),
    )


def _first(diagnostics: list[Diagnostic]) -> list[Diagnostic]:
    """In order of place, each once; of those beyond the limit only the number, as a note on the last one."""
    places: dict[tuple[int, str], Diagnostic] = {}
    for diagnostic in diagnostics:
        if diagnostic.span:
            places.setdefault((diagnostic.span.start, diagnostic.code), diagnostic)
    ordered = [places[key] for key in sorted(places)]
    more = len(ordered) - MOST_SHOWN
    if more <= 0:
        return ordered
    note = f"{more} more syntax error{'s' if more > 1 else ''} not shown"
    last = ordered[MOST_SHOWN - 1]
    return [*ordered[: MOST_SHOWN - 1], replace(last, notes=(*last.notes, note))]


def _too_long(source: Source) -> tuple[s.Script, list[Diagnostic]]:
    span = Span(source, 0, 0)
    diagnostic = Diagnostic(
        "E0801",
        "this script is too long to be written by hand",
        span,
        "not read",
        helps=(Help('keep data in a file of its own: balls(read_points("points.csv"), radius = 1)'),),
        notes=(f"the limit is {MAX_SIZE // 1_000_000} million characters, or 1.2 million words and signs",),
    )
    return s.Script(source, None, (s.Error(span),)), [diagnostic]
