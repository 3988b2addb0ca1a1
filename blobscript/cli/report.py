"""`blobscript report`: error against run time of a scene."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from blobscript.cli.figures import need_matplotlib
from blobscript.cli.program import load_scene
from blobscript.cli.progress import Progress
from blobscript.outputs import check_ending, check_output, write_text

if TYPE_CHECKING:
    from blobscript.reporting import Report

__all__ = ["ENDINGS", "by_ending", "check_report", "run", "stages"]

ENDINGS = (".html", ".json", ".md")


def run(arguments: argparse.Namespace) -> int:
    check_report(arguments.output)
    scene = load_scene(arguments)
    from blobscript.reporting import make_report
    from blobscript.reporting.summary import search_sentences

    bars: list[Progress] = []
    report = make_report(
        scene,
        arguments.file,
        quick=arguments.quick,
        seed=arguments.seed,
        workers=arguments.threads,
        stage=stages(bars),
    )
    for bar in bars:
        bar.finish()
    write_text(arguments.output, _text(report, arguments.output))
    told = search_sentences(report.searches)
    if arguments.format == "json":
        print(json.dumps({"diagnostics": [], "files": [arguments.output], "summary": told}, ensure_ascii=False))
    else:
        print("\n".join(told))
        print(f"{arguments.output}: report", file=sys.stderr)
    return 0


def check_report(path: str) -> None:
    """Refuses, before any work, what could not be written or drawn. Raises FormatError, WriteError, MissingError."""
    check_ending(path, "report", ENDINGS)
    check_output(path)
    need_matplotlib()


def stages(bars: list[Progress]) -> Callable[[str], Callable[[int, int], None]]:
    """A bar for each part of the work; a new one ends the one before."""

    def stage(what: str) -> Callable[[int, int], None]:
        if bars:
            bars[-1].finish()
        bars.append(Progress(what))
        return bars[-1]

    return stage


def by_ending(path: str, *, json: Callable[[], str], markdown: Callable[[], str], html: Callable[[], str]) -> str:
    """The text that a file of this name wants, of `ENDINGS`."""
    return {".json": json, ".md": markdown}.get(Path(path).suffix.lower(), html)()


def _text(report: Report, path: str) -> str:
    from blobscript import reporting as forms

    return by_ending(
        path,
        json=lambda: forms.report_json(report),
        markdown=lambda: forms.markdown(report),
        html=lambda: forms.page(report),
    )
