"""Script files -> `Source`."""

from __future__ import annotations

import os
from pathlib import Path

from blobscript.diagnostics import Diagnostic
from blobscript.source import Source

__all__ = ["MAX_SIZE", "read_source"]

#: Larger scripts are refused: 4 MB are about 100 000 lines, and what is larger is data (`read_points`).
MAX_SIZE = 4_000_000


def read_source(path: str | os.PathLike[str]) -> Source | Diagnostic:
    """The script in a file, or E0801 with the reason why it cannot be read."""
    shown = os.fspath(path)
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_SIZE + 1)
    except OSError as error:
        return _unreadable(shown, (error.strerror or str(error)).lower())
    except ValueError as error:  # a null byte in the path
        return _unreadable(shown, str(error))
    if len(data) > MAX_SIZE:
        return _unreadable(shown, f"it is larger than {MAX_SIZE // 1_000_000} MB; keep data in a file of its own")
    if b"\0" in data:
        return _unreadable(shown, "it is not a text")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        return _unreadable(shown, f"it is not UTF-8 (line {line})")
    return Source(shown, text, str(Path(path).absolute().parent))


def _unreadable(path: str, reason: str) -> Diagnostic:
    return Diagnostic("E0801", f"cannot read {path}: {reason}", path=path)
