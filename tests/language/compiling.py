"""Runs scripts through all passes, for the tests of the language."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from blobscript import ir
from blobscript.check import check
from blobscript.diagnostics import Diagnostic, has_errors
from blobscript.lower import lower
from blobscript.parse import parse
from blobscript.resolve import resolve
from blobscript.source import Source

__all__ = ["errors_of", "evaluate", "notes_of", "run"]


def run(
    text: str,
    *,
    name: str = "test.blob",
    folder: Path | str | None = None,
    params: Mapping[str, object] | None = None,
    budget: int | None = None,
    phase: float = 0.0,
    time: float = 0.0,
) -> tuple[ir.Scene | None, list[Diagnostic]]:
    """The scene of a script (None with errors) and everything that was said."""
    script, found = parse(Source(name, text, str(folder) if folder is not None else None))
    program, more = resolve(script)
    found = [*found, *more]
    typed, more = check(program)
    found += more
    if has_errors(found):
        return None, found
    scene, more = lower(typed, params, budget, phase=phase, time=time)
    return scene, [*found, *more]


SURFACE = "\nsurface { ball(radius = 1) }\n"


def errors_of(text: str, **options: object) -> list[tuple[str, int]]:
    """Codes and lines of what is wrong with a script; a surface is added, so that nothing is missing."""
    _, found = run(text + SURFACE, **options)  # type: ignore[arg-type]
    return [(d.code, d.line) for d in found if d.severity == "error"]


def notes_of(text: str, **options: object) -> list[str]:
    """What `debug` shows, as the script would write the values; fails on errors."""
    _, found = run(text + SURFACE, **options)  # type: ignore[arg-type]
    assert not has_errors(found), [f"{d.line}: {d.code} {d.message}" for d in found]
    return [d.label.partition(": ")[2] for d in found if d.severity == "note"]


def evaluate(expression: str, before: str = "", **options: object) -> str:
    """The value of one expression, as the script would write it."""
    (shown,) = notes_of(f"{before}\ndebug {expression}", **options)
    return shown
