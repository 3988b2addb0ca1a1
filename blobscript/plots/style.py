"""How all figures look: one palette that colour-blind people can tell apart, quiet axes, room to read.

Figures are made without pyplot: no global list of figures, nothing to close, safe in threads.
The palette is that of Okabe and Ito, "Color Universal Design" (2008), without its yellow.
"""

from __future__ import annotations

import io
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from itertools import cycle, islice
from typing import Any

from blobscript.diagnostics import MissingError

__all__ = [
    "BLUE",
    "DASHES",
    "Axes",
    "Drawing",
    "FAINT",
    "GREEN",
    "INK",
    "MARKERS",
    "MUTED",
    "ORANGE",
    "OTHERS",
    "PALETTE",
    "PURPLE",
    "RED",
    "SKY",
    "caption",
    "colors",
    "direct_labels",
    "new_figure",
    "png_bytes",
    "styled",
    "svg_text",
    "titled",
]

#: matplotlib's axes, and its figures and their parts: its own annotations are too open for strict checks.
Axes = Any
Drawing = Any

BLUE, RED, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
PALETTE = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)
#: Beside RED, GREEN, ORANGE and SKY that mean something already; from Paul Tol's "muted" scheme but for the first two.
OTHERS = (BLUE, PURPLE, "#332288", "#999933", "#882255", "#44AA99")
MARKERS = ("o", "s", "^", "D", "v", "P")
DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.3)), (0, (6, 2, 1, 2)))
INK, MUTED, FAINT = "#1a1a1a", "#5f6368", "#d9dce0"

_STYLE: Mapping[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.titlesize": 11.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 9.0,
    "axes.labelsize": 9.5,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "text.color": INK,
    "lines.linewidth": 1.8,
    "lines.markersize": 5.0,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "blobscript",
    "axes.unicode_minus": True,
}


@contextmanager
def styled() -> Generator[None]:
    """The style, for making figures as well as for writing them. Raises MissingError without matplotlib."""
    try:
        import matplotlib
    except ImportError as error:
        raise MissingError(
            "plots need matplotlib, which is not installed\n  = help: pip install 'blobscript[report]'"
        ) from error
    defaults: Any = matplotlib.rcParamsDefault
    settings: Any = {**defaults, **_STYLE}
    settings.pop("backend", None)
    with matplotlib.rc_context(settings):  # pyright: ignore[reportUnknownMemberType]
        yield


def new_figure(width: float, height: float) -> Drawing:
    """An empty figure, inches. To be called within `styled`."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=150, layout="constrained")


def colors(count: int, palette: tuple[str, ...] = PALETTE) -> list[str]:
    """That many colours of a palette, again from the start where they run out."""
    return list(islice(cycle(palette), count))


def titled(figure: Drawing, title: str, subtitle: str = "") -> None:
    """A title over everything, with a quieter line below it."""
    # names from scripts stand here: a $ in them is no formula
    heading = title + ("\n" if subtitle else "")
    figure.suptitle(heading, x=0.012, ha="left", fontsize=13, fontweight="bold", color=INK, parse_math=False)
    if subtitle:
        inches = figure.bbox.height / figure.dpi
        figure.text(
            0.012, 1.0 - 0.36 / inches, subtitle, ha="left", va="top", fontsize=9.5, color=MUTED, parse_math=False
        )


def caption(axes: Axes, text: str, **where: Any) -> None:
    """A quiet remark inside the axes, top right unless told."""
    place: dict[str, Any] = {"x": 0.99, "y": 0.985, "ha": "right", "va": "top", **where}
    axes.text(place.pop("x"), place.pop("y"), text, transform=axes.transAxes, fontsize=8.5, color=MUTED, **place)


def direct_labels(axes: Axes, ends: list[tuple[float, float, str, str]], gap: float = 0.05) -> None:
    """Names beside the ends (x, y, name, colour) of curves, moved apart to `gap` of the height."""
    low, high = axes.get_ylim()
    transform = axes.transData

    def height(y: float) -> float:
        return float(transform.transform((1.0, y))[1] - transform.transform((1.0, low))[1]) / (
            float(transform.transform((1.0, high))[1] - transform.transform((1.0, low))[1]) or 1.0
        )

    at = -gap
    for x, y, name, color in sorted(ends, key=lambda end: end[1]):
        at = max(height(y), at + gap)
        axes.annotate(
            name,
            xy=(x, at),
            xycoords=("data", "axes fraction"),
            xytext=(6, 0),
            textcoords="offset points",
            color=color,
            fontsize=8.5,
            va="center",
            annotation_clip=False,
        )


def svg_text(figure: Drawing) -> str:
    """The figure as SVG; the same text for the same figure."""
    buffer = io.StringIO()
    with styled():
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": "blobscript"})
    return buffer.getvalue()


def png_bytes(figure: Drawing, dpi: float = 150.0) -> bytes:
    """The figure as PNG."""
    buffer = io.BytesIO()
    with styled():
        figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": "blobscript"})
    return buffer.getvalue()
