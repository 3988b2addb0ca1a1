"""Writing figures: SVG or PNG by the ending, whole or not at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blobscript.outputs import check_ending, check_output, write_bytes, write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["check_figure", "need_matplotlib", "write_figure"]

_ENDINGS = (".svg", ".png")


def check_figure(path: str) -> None:
    """Refuses, before any work, what could not be written. Raises FormatError, WriteError, MissingError."""
    check_ending(path, "figure", _ENDINGS)
    check_output(path)
    need_matplotlib()


def need_matplotlib() -> None:
    """Raises MissingError (exit code 3) before any work where it is not there."""
    from blobscript.plots.style import styled

    with styled():
        pass


def write_figure(path: str, figure: Figure) -> None:
    """Raises WriteError."""
    from blobscript.plots.style import png_bytes, svg_text

    if path.lower().endswith(".svg"):
        write_text(path, svg_text(figure))
    else:
        write_bytes(path, png_bytes(figure))
