"""From the arguments of a verb to a scene; diagnostics and the exit code they mean."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, TextIO, cast

from blobscript.cli.options import UsageError
from blobscript.diagnostics import Diagnostic, Help, ProgramError
from blobscript.setting import Setting
from blobscript.source import Source

if TYPE_CHECKING:
    from blobscript.scene import Scene

__all__ = ["exit_code", "given_parameters", "load_scene", "read_script", "report_diagnostics"]

#: Codes that mean a file outside the program when they stand at no place in a script.
_FILE_CODES = {"E0801": 3, "E0802": 3, "E0803": 2, "E1003": 4, "E1004": 3}


def exit_code(diagnostics: Sequence[Diagnostic]) -> int:
    """0 without errors; else 1, or the code of a file that could not be read or written."""
    errors = [d for d in diagnostics if d.severity == "error"]
    if not errors:
        return 0
    outside = [_FILE_CODES[d.code] for d in errors if d.span is None and d.code in _FILE_CODES]
    return max(outside) if len(outside) == len(errors) else 1


def report_diagnostics(diagnostics: Sequence[Diagnostic], form: str, stream: TextIO | None = None) -> None:
    """JSON and SARIF go to standard output, text to `stream` (default: standard error)."""
    from blobscript import report

    if form == "json":
        print(report.to_json(diagnostics))
    elif form == "sarif":
        print(report.to_sarif(diagnostics))
    elif diagnostics:
        out = stream or sys.stderr
        out.write(report.render_all(diagnostics, color=_colored(out)))


def _colored(stream: TextIO) -> bool:
    """On terminals, unless the user's environment says otherwise (no-color.org)."""
    return stream.isatty() and not os.environ.get("NO_COLOR")


def read_script(name: str) -> Source:
    """The script in a file, or on standard input for `-`."""
    from blobscript.files import read_source

    if name == "-":
        return Source("<stdin>", sys.stdin.read(), os.getcwd())
    source = read_source(name)
    if isinstance(source, Diagnostic):
        raise ProgramError([source])
    return source


def load_scene(arguments: argparse.Namespace, *, warn: bool = True) -> Scene:
    """The compiled scene of the script; its warnings go to standard error."""
    given = given_parameters(arguments)
    source = read_script(arguments.file)
    from blobscript.driver import scene_of

    scene = scene_of(source, given, arguments.budget, arguments.time, arguments.phase)
    if warn and scene.diagnostics:
        report_diagnostics(scene.diagnostics, "text")
    return scene


def given_parameters(arguments: argparse.Namespace) -> dict[str, object]:
    """`--params` first, then each `--set` over it; values of `--set` keep their text for messages."""
    given = _read_params(arguments.params) if arguments.params else {}
    for text in arguments.sets:
        name, equals, value = text.partition("=")
        if not equals or not name.strip() or not value.strip():
            raise UsageError(f"--set wants name=value, not `{text}`\n  = help: --set drops=12")
        given[name.strip()] = Setting(value.strip())
    return given


def _read_params(path: str) -> dict[str, object]:
    try:
        with open(path, encoding="utf-8") as file:
            values = json.load(file)
    except OSError as error:
        raise ProgramError([_unreadable(path, (error.strerror or str(error)).lower())]) from error
    except (ValueError, RecursionError) as error:
        raise ProgramError([_unreadable(path, f"it is not JSON ({error})")]) from error
    if not isinstance(values, dict):
        raise ProgramError([_unreadable(path, "it holds no object")])
    return cast("dict[str, object]", values)


def _unreadable(path: str, reason: str) -> Diagnostic:
    return Diagnostic(
        "E0801",
        f"cannot read the parameters in `{path}`: {reason}",
        helps=(Help('a parameter file is a JSON object such as {"drops": 12}'),),
        path=path,
    )
