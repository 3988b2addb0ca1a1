"""`blobscript compare`: a scene rendered here and with POV-Ray, and how the two differ."""

from __future__ import annotations

import argparse
import sys

from blobscript.cli.options import UsageError
from blobscript.cli.program import load_scene
from blobscript.outputs import check_ending, check_output, write_text

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    """Exit code 5 where the certified reference says that we are off."""
    from blobscript.povray import page, program
    from blobscript.povray.compare import compare

    output: str | None = arguments.output
    if output:
        check_ending(output, "report", (".html", ".htm", ".json"))
        check_output(output)
    if not output and arguments.format != "json":
        raise UsageError("missing: -o/--output\n  = help: -o report.html, or --format json for standard output")
    program.find()
    scene = load_scene(arguments)
    width, height = arguments.size or (scene.ir.width, scene.ir.height)
    found = compare(scene, arguments.file, width, height, arguments.timeout, _tell, arguments.grid)
    if output:
        write_text(output, page.as_json(found) if output.lower().endswith(".json") else page.as_html(found))
    if arguments.format == "json":
        print(page.as_json(found))
    print(page.summary(found), file=sys.stderr)
    return 0 if found.agrees else 5


def _tell(what: str) -> None:
    if sys.stderr.isatty():
        print(f"{what} …", file=sys.stderr)
