"""The command `blobscript`: arguments in, calls of the API, text and exit codes out.

Only the modules of this package print and set exit codes (language.md, section 5):
0 fine, 1 the program has errors, 2 wrong usage, 3 a file cannot be read or written or a
program is missing, 4 a render failed, 5 a comparison is out of tolerance, 130 interrupted,
and 70 for a mistake in blobscript itself.
"""

from __future__ import annotations

import atexit
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from typing import NoReturn

from blobscript.cli.options import UsageError, parse_arguments
from blobscript.diagnostics import BlobscriptError, MissingError, ProgramError

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns its exit code."""
    sys.setrecursionlimit(max(sys.getrecursionlimit(), 5000))
    try:
        code = _run(sys.argv[1:] if argv is None else list(argv))
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        if argv is None:
            _leave(130)
        return 130
    except BrokenPipeError:  # the reader of our output went away: `blobscript info x.blob | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _leave(code: int) -> NoReturn:
    """Ends the process at once. Everything that had something to undo has done so on the way here; taking down a
    million objects one by one can take longer than anyone who presses Ctrl-C waits. Only what was
    shared with other processes has to be given back."""
    if "multiprocessing.util" in sys.modules:
        atexit._run_exitfuncs()  # pyright: ignore[reportPrivateUsage]
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


def _run(argv: list[str]) -> int:
    form = "text"
    try:
        arguments = parse_arguments(argv)
        form = getattr(arguments, "format", form)
        return import_module(f"blobscript.cli.{arguments.module}").run(arguments)
    except UsageError as mistake:
        print(f"error: {mistake}", file=sys.stderr)
        return 2
    except MissingError as mistake:
        print(f"error: {mistake}", file=sys.stderr)
        return 3
    except ProgramError as mistake:
        from blobscript.cli.program import exit_code, report_diagnostics

        report_diagnostics(mistake.diagnostics, form)
        return exit_code(mistake.diagnostics)
    except BrokenPipeError:
        raise
    except MemoryError:
        print("error: not enough memory\n  = help: render a smaller picture or fewer primitives", file=sys.stderr)
        return 4
    except BlobscriptError as mistake:
        print(f"error: {mistake}", file=sys.stderr)
        return 4
    except Exception:
        import traceback

        traceback.print_exc()
        print("error: this is a mistake in blobscript, not in your script; please report it", file=sys.stderr)
        return 70
