"""`blobscript fmt`: formats scripts in place, or standard input."""

from __future__ import annotations

import argparse
import difflib
import sys
from pathlib import Path

from blobscript.cli.program import exit_code, read_script, report_diagnostics
from blobscript.diagnostics import ProgramError
from blobscript.outputs import write_text

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    """Goes on after a file with errors; returns the worst exit code."""
    worst = 0
    for name in arguments.files:
        try:
            worst = max(worst, _one(name, check=arguments.check, diff=arguments.diff))
        except ProgramError as mistake:
            report_diagnostics(mistake.diagnostics, "text")
            worst = max(worst, exit_code(mistake.diagnostics))
    return worst


def _one(name: str, *, check: bool, diff: bool) -> int:
    from blobscript.formatter import format_source

    source = read_script(name)
    formatted, found = format_source(source)
    if formatted is None:
        raise ProgramError(found)
    changed = formatted != source.text
    if diff:
        sys.stdout.writelines(_difference(source.path, source.text, formatted))
    if check:
        if changed:
            print(f"{source.path} would change", file=sys.stderr)
        return 1 if changed else 0
    if diff:
        return 0
    if name == "-":
        sys.stdout.write(formatted)
    elif changed:
        write_text(Path(name), formatted)
        print(f"formatted {name}", file=sys.stderr)
    return 0


def _difference(path: str, old: str, new: str) -> list[str]:
    lines = difflib.unified_diff(old.splitlines(True), new.splitlines(True), path, f"{path} (formatted)")
    return [line if line.endswith("\n") else f"{line}\n" for line in lines]
