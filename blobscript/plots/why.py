"""The figure of `why`: the picture with the pixel marked, the terms at the hit, and the field along the ray."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from blobscript.images import srgb_encode
from blobscript.plots import style
from blobscript.plots.pixel import Pixel, Term
from blobscript.plots.ray import along, draw_along, name_of
from blobscript.plots.style import Axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot_why"]

#: Pixels of the picture's longer side, and terms with a bar of their own.
_THUMBNAIL = 360
_MOST_BARS = 10


def plot_why(pixel: Pixel) -> Figure:
    """Of what `explain_pixel` found."""
    found = along(pixel.scene, pixel.ray.origin, pixel.ray.direction, pixel.surface)
    with style.styled():
        figure = style.new_figure(9.6, 9.4)
        top, below = figure.subfigures(2, 1, height_ratios=(3.3, 6.0))
        picture, terms = top.subplots(1, 2, width_ratios=(1.0, 1.25))
        top.suptitle(
            f"Why pixel {pixel.x},{pixel.y} looks as it does", x=0.012, ha="left", fontsize=13, fontweight="bold"
        )
        _draw_picture(picture, pixel)
        _draw_terms(terms, pixel)
        draw_along(below, found, f"through pixel {pixel.x},{pixel.y} of {pixel.width}x{pixel.height}")
    return figure


def _draw_picture(axes: Axes, pixel: Pixel) -> None:
    scale = min(1.0, _THUMBNAIL / max(pixel.width, pixel.height))
    width, height = max(round(pixel.width * scale), 1), max(round(pixel.height * scale), 1)
    image = pixel.scene.render(width=width, height=height, samples=4)
    axes.imshow(np.clip(srgb_encode(image.rgba[..., :3]), 0.0, 1.0), interpolation="nearest")
    x, y = (pixel.x + 0.5) * width / pixel.width - 0.5, (pixel.y + 0.5) * height / pixel.height - 0.5
    for color, size in (("white", 17.0), (style.RED, 13.0)):
        axes.plot([x], [y], "o", markersize=size, markerfacecolor="none", markeredgecolor=color, markeredgewidth=1.8)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _draw_terms(axes: Axes, pixel: Pixel) -> None:
    """Bars of the largest terms; those that lose in a max or min are pale."""
    shown = pixel.elements[:_MOST_BARS]
    axes.set_title("Terms at the hit" if pixel.is_hit else "Terms where the ray comes nearest", fontsize=10)
    if not shown:
        style.caption(axes, "nothing is felt along this ray", x=0.5, y=0.5, ha="center", va="center")
        axes.set_xticks([])
        axes.set_yticks([])
        return
    for row, term in enumerate(shown):
        color = style.BLUE if term.value > 0 else style.RED
        axes.barh(row, term.value, height=0.68, color=color, alpha=1.0 if term.counts else 0.3)
    axes.set_yticks(range(len(shown)), [_name(term) for term in shown])
    axes.set_ylim(max(len(shown), 3) - 0.4, -0.6)
    axes.axvline(pixel.threshold, color=style.INK, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.axvline(0.0, color=style.MUTED, linewidth=0.8)
    left_out = len(pixel.elements) - len(shown)
    more = f"; {left_out} smaller ones" if left_out else ""
    axes.set_xlabel(f"density (dashed: threshold {pixel.threshold:g}{more})")
    axes.grid(axis="y", visible=False)


def _name(term: Term) -> str:
    return "" if term.element is None else name_of(term.element)
