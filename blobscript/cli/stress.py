"""`blobscript stress`: stiff and extreme cases with certified answers."""

from __future__ import annotations

import argparse
import shutil
import sys

from blobscript.cli.options import UsageError
from blobscript.cli.progress import Progress
from blobscript.outputs import check_ending, check_output, write_text

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    from blobscript.stress.running import run_cases
    from blobscript.stress.tables import as_html, as_json, as_markdown, as_text

    pages = {".html": as_html, ".md": as_markdown, ".json": as_json}
    ending = ""
    if arguments.output:
        ending = check_ending(arguments.output, "report", list(pages))
        check_output(arguments.output)
    if arguments.show:
        return _show(arguments.show)
    progress = Progress("stress")
    rows = run_cases(arguments.only, bool(shutil.which("povray")) and not arguments.no_povray, progress)
    progress.finish()
    if arguments.output:
        write_text(arguments.output, pages[ending](rows))
    print(as_json(rows) if arguments.format == "json" else as_text(rows).rstrip())
    return 0 if all(row.passed for row in rows) else 5


def _show(name: str) -> int:
    """The script of one case, with what it is about: to look at, to render, to change."""
    from blobscript.stress import all_cases

    for case in all_cases():
        if name in (case.id, f"{case.group}/{case.id}"):
            sys.stdout.write(f"// {case.title}\n// {case.about}\n{case.script}\n")
            return 0
    raise UsageError(f"there is no case `{name}`\n  = help: blobscript stress lists them all")
