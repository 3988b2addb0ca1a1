"""Where the files beside the Python code are: grammar, standard library, examples."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import blobscript

__all__ = ["folder"]


@cache
def folder(name: str) -> Path:
    """The folder `grammar`, `stdlib` or `examples`: inside an installed package, beside it in a checkout."""
    for base in map(Path, blobscript.__path__):
        beside = base.parent / name
        if (base.parent / "pyproject.toml").is_file() and beside.is_dir():
            return beside
        if (base / name).is_dir():
            return base / name
    raise FileNotFoundError(f"the folder {name} of blobscript is missing: install the package again")
