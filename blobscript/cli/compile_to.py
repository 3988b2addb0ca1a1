"""`blobscript compile`: the scene in another form."""

from __future__ import annotations

import argparse
import sys

from blobscript.cli.program import load_scene, report_diagnostics
from blobscript.outputs import write_text
from blobscript.scene import Scene

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    forms = {"json": Scene.to_json, "pov": _pov, "c": Scene.to_c}
    text = forms[arguments.to](load_scene(arguments))
    if arguments.output and arguments.output != "-":
        write_text(arguments.output, text)
    else:
        sys.stdout.write(text)
    return 0


def _pov(scene: Scene) -> str:
    """What is not exact there is said on the terminal, too."""
    from blobscript.povray import document

    made = document(scene.trimmed.scene)
    report_diagnostics(made.diagnostics, "text")
    return made.text
