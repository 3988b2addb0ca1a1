"""`blobscript compile`: the scene in another form."""

from __future__ import annotations

import argparse
import sys

from blobscript.cli.options import UsageError
from blobscript.cli.output import write_text
from blobscript.cli.program import load_scene

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    if arguments.to != "json":
        raise UsageError(f"compile --to {arguments.to} is not in this version yet\n  = help: --to json writes the IR")
    text = load_scene(arguments).to_json()
    if arguments.output and arguments.output != "-":
        write_text(arguments.output, text)
    else:
        sys.stdout.write(text)
    return 0
