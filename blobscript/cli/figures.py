"""Writing figures: SVG or PNG by the ending, whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from blobscript.cli.output import write_bytes, write_text
from blobscript.diagnostics import Diagnostic, Help, ProgramError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["check_figure", "need_matplotlib", "write_figure"]

_ENDINGS = (".svg", ".png")


def check_figure(path: str) -> None:
    """Refuses, before any work, what could not be written. Raises E0803."""
    if Path(path).suffix.lower() not in _ENDINGS:
        raise ProgramError(
            [
                Diagnostic(
                    "E0803",
                    f"cannot write a figure to `{path}`: its ending is none of {', '.join(_ENDINGS)}",
                    helps=(Help("-o figure.svg"),),
                    path=path,
                )
            ]
        )
    need_matplotlib()


def need_matplotlib() -> None:
    """Raises MissingError (exit code 3) before any work where it is not there."""
    from blobscript.plots.style import styled

    with styled():
        pass


def write_figure(path: str, figure: Figure) -> None:
    """Raises E0802."""
    from blobscript.plots.style import png_bytes, svg_text

    if path.lower().endswith(".svg"):
        write_text(path, svg_text(figure))
    else:
        write_bytes(path, png_bytes(figure))
