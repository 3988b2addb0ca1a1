"""`blobscript compile`: the scene in another form."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from pathlib import Path

from blobscript.cli.options import UsageError
from blobscript.cli.program import load_scene, report_diagnostics
from blobscript.outputs import check_output, pending, write_text
from blobscript.scene import Scene

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    if arguments.grid is not None and arguments.to != "pov":
        raise UsageError("--grid is for --to pov: how finely POV-Ray gets a field that is too large for functions")
    output = arguments.output if arguments.output != "-" else None
    if output:
        check_output(output)
    scene = load_scene(arguments)
    if arguments.to == "pov":
        _write_pov(scene, output, arguments.grid)
        return 0
    text = scene.to_json() if arguments.to == "json" else scene.to_c()
    if output:
        write_text(output, text)
    else:
        sys.stdout.write(text)
    return 0


def _write_pov(scene: Scene, output: str | None, grid: int | None) -> None:
    """What is not exact there is said on the terminal, too. On standard output there is no place for files beside."""
    made = scene.pov_document(stem=Path(output).stem if output else None, grid=grid)
    report_diagnostics(made.diagnostics, "text")
    if not output:
        sys.stdout.write(made.text)
        return
    folder = Path(os.path.realpath(output)).parent
    with contextlib.ExitStack() as stack:  # all are written before the first takes its place
        stack.enter_context(pending(output)).write_text(made.text, encoding="ascii")
        for name, data in made.files.items():
            stack.enter_context(pending(folder / name)).write_bytes(data)
