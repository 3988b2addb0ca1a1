"""`blobscript import-pov`: the blobs of a POV-Ray scene as a script."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from blobscript.cli.options import UsageError
from blobscript.cli.program import report_diagnostics
from blobscript.diagnostics import Diagnostic, ProgramError
from blobscript.files import MAX_SIZE
from blobscript.outputs import write_text
from blobscript.source import Source

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    from blobscript.formatter import format_source
    from blobscript.povray.sdl import imported

    source = _read(arguments.file)
    text, notes = imported(source, _declared(arguments.declared))
    text = format_source(Source("<import>", text))[0] or text
    report_diagnostics(notes, arguments.format)
    if arguments.output and arguments.output != "-":
        write_text(arguments.output, text)
    else:
        sys.stdout.write(text)
    return 0


def _declared(settings: list[str]) -> dict[str, float]:
    names: dict[str, float] = {}
    for setting in settings:
        name, _, value = setting.partition("=")
        try:
            names[name.strip()] = float(value)
        except ValueError:
            message = f"--declare wants name=number, not `{setting}`\n  = help: --declare frame_number=2"
            raise UsageError(message) from None
    return names


def _read(name: str) -> Source:
    """Old scenes are in Latin-1."""
    try:
        data = Path(name).read_bytes()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise ProgramError([Diagnostic("E0801", f"cannot read {name}: {reason}", path=name)]) from error
    if len(data) > MAX_SIZE or b"\0" in data:
        reason = "it is not a text" if b"\0" in data else f"it is larger than {MAX_SIZE // 1_000_000} MB"
        raise ProgramError([Diagnostic("E0801", f"cannot read {name}: {reason}", path=name)])
    try:
        return Source(name, data.decode("utf-8-sig"))
    except UnicodeDecodeError:
        return Source(name, data.decode("latin-1"))
