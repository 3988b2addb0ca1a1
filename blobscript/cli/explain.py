"""`blobscript explain`: the page of an error code or of a topic."""

from __future__ import annotations

import argparse

from blobscript.cli.options import UsageError
from blobscript.diagnostics import CODES

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    from blobscript import explain

    if arguments.code is None:
        print("\n".join(f"{code}  {title}" for code, title in {**CODES, **explain.TOPICS}.items()))
        return 0
    if arguments.code.lower() in explain.TOPICS:
        print(explain.page(arguments.code.lower()))
        return 0
    code = arguments.code.strip("[]").upper()
    if code not in CODES:
        close = [known for known in CODES if known[:3] == code[:3]]
        known = ", ".join(close) if close else "blobscript explain lists all codes"
        raise UsageError(f"there is no code `{arguments.code}`\n  = help: {known}")
    print(explain.page(code))
    return 0
