"""blobscript: a small language for implicit surfaces, its compiler and its tracer.

    text ── parse ──> syntax ── resolve ──> names ── check ──> types ── lower ──> values ── assemble ──> scene IR
            grammar/  syntax.py resolve.py           check.py  typed.py lower.py  makers.py assemble.py  ir.py

    scene IR ── verify ──> what every scene must satisfy
             ── field ───> density, gradient and bounds in NumPy, the specification of the tracer
             ── pack ────> flat arrays ── tracer/ (C) ──> first hits ── backends/picture ──> images

`driver` calls the passes in order, `scene.Scene` is what comes out, `cli` is the command `blobscript`.

What must never happen: a back end reads syntax; the tracer knows of Python; a pass prints; an
error of the user's script raises anything but `ProgramError`; a hit is missed for being thin.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from blobscript.diagnostics import BlobscriptError, Diagnostic, ProgramError
    from blobscript.driver import compile, load  # noqa: A004 - the public name is the verb
    from blobscript.scene import Scene

__all__ = ["BlobscriptError", "Diagnostic", "ProgramError", "Scene", "__version__", "compile", "load"]

__version__ = "0.1.0"

#: Public name -> module. Loaded on first use: `import blobscript` and `blobscript --help` stay quick.
_HOME = {
    "BlobscriptError": "diagnostics",
    "Diagnostic": "diagnostics",
    "ProgramError": "diagnostics",
    "Scene": "scene",
    "compile": "driver",
    "load": "driver",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'blobscript' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"blobscript.{_HOME[name]}"), name)
