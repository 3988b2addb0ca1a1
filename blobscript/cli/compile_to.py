"""`blobscript compile`: the scene in another form."""

from __future__ import annotations

import argparse
import sys

from blobscript.cli.options import UsageError
from blobscript.cli.output import write_text
from blobscript.cli.program import load_scene
from blobscript.scene import Scene

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    forms = {"json": Scene.to_json, "c": Scene.to_c}
    if arguments.to not in forms:
        raise UsageError(f"compile --to {arguments.to} is not in this version yet\n  = help: --to json writes the IR")
    text = forms[arguments.to](load_scene(arguments))
    if arguments.output and arguments.output != "-":
        write_text(arguments.output, text)
    else:
        sys.stdout.write(text)
    return 0
