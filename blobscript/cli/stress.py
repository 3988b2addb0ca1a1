"""`blobscript stress`: stiff and extreme cases with certified answers."""

from __future__ import annotations

import argparse
import shutil
import sys

from blobscript.cli.options import UsageError
from blobscript.cli.progress import Progress
from blobscript.cli.report import ENDINGS, by_ending
from blobscript.outputs import check_ending, check_output, write_text

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    from blobscript.stress.running import run_cases
    from blobscript.stress.tables import as_html, as_json, as_markdown, as_text

    if arguments.output:
        check_ending(arguments.output, "report", ENDINGS)
        check_output(arguments.output)
    if arguments.show:
        return _show(arguments.show)
    progress = Progress("stress")
    rows = run_cases(arguments.only, bool(shutil.which("povray")) and not arguments.no_povray, progress)
    progress.finish()
    if arguments.output:
        text = by_ending(
            arguments.output,
            json=lambda: as_json(rows),
            markdown=lambda: as_markdown(rows),
            html=lambda: as_html(rows),
        )
        write_text(arguments.output, text)
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
