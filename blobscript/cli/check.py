"""`blobscript check`: everything that is wrong with a script, and the fixes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence

from blobscript.cli.options import UsageError
from blobscript.cli.program import exit_code, given_parameters, read_script, report_diagnostics
from blobscript.diagnostics import Diagnostic, Help, has_errors
from blobscript.outputs import write_text
from blobscript.source import Source

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    """The report goes to standard output; what was done about it to standard error."""
    if arguments.ask and not arguments.fix:
        raise UsageError("--ask goes with --fix: blobscript check --fix --ask")
    if arguments.fix and arguments.file == "-":
        raise UsageError("--fix wants a file that it can change, not -")
    given = given_parameters(arguments)
    source = read_script(arguments.file)
    found = _diagnose(source, given, arguments)
    if arguments.fix and _fix(source, found, ask=arguments.ask):
        found = _diagnose(read_script(arguments.file), given, arguments)
    report_diagnostics(found, arguments.format, sys.stdout)
    if arguments.format == "text" and not has_errors(found):
        print(f"{source.path}: no errors", file=sys.stderr)
    return exit_code(found)


def _diagnose(source: Source, given: dict[str, object], arguments: argparse.Namespace) -> Sequence[Diagnostic]:
    from blobscript.driver import check_source

    return check_source(source, given, arguments.budget, arguments.time, arguments.phase)


def _fix(source: Source, found: Sequence[Diagnostic], *, ask: bool) -> bool:
    """Changes this script only, never a file that it imports."""
    from blobscript.fixes import apply_edits, fixable

    helps = [help_ for _, help_ in fixable(source, found, "safe")]
    if ask:
        helps += _confirmed(source, found)
    fixed = apply_edits(source, helps)
    if fixed.text == source.text:
        return False
    write_text(source.path, fixed.text)
    count = len(fixed.applied)
    print(f"{source.path}: applied {count} {'fix' if count == 1 else 'fixes'}", file=sys.stderr)
    return True


def _confirmed(source: Source, found: Sequence[Diagnostic]) -> Iterator[Help]:
    """The guesses that the user says yes to, one diagnostic at a time; at most one for each."""
    from blobscript.fixes import fixable

    settled: set[int] = set()
    for diagnostic, help_ in fixable(source, found, "guess"):
        if id(diagnostic) in settled:
            continue
        report_diagnostics([diagnostic], "text", sys.stderr)
        print(f"{help_.text}: apply this? [y/N] ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() in ("y", "yes"):
            settled.add(id(diagnostic))
            yield help_
