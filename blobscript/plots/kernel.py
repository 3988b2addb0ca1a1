"""The density D and its slope over r, several kernels at once, with threshold and radius marked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from blobscript import kernels
from blobscript.ir import Kernel
from blobscript.plots import style
from blobscript.plots.style import Axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["KernelCurve", "kernel_curve", "kernel_title", "plot_kernel"]

Array = NDArray[np.float64]

#: Samples along r: no step is seen at the size of a poster.
_SAMPLES = 1201


class KernelCurve:
    """r, D(r) and D'(r) for 0 <= r <= `end`, and the radius: the r with weight * D(r) = threshold (NaN: none)."""

    __slots__ = ("name", "r", "radius", "slope", "value")

    def __init__(self, kernel: Kernel, threshold: float, weight: float, end: float) -> None:
        self.name = kernel_title(kernel)
        self.r = np.linspace(0.0, end, _SAMPLES)
        s = self.r * self.r
        self.value = weight * kernels.value(kernel, s)
        with np.errstate(invalid="ignore", divide="ignore"):
            slope = weight * kernels.slope(kernel, s) * 2.0 * self.r
        self.slope = np.where(np.isfinite(slope), slope, np.nan)
        self.radius = float(kernels.inverse(kernel, threshold / weight))


def kernel_curve(kernel: Kernel, threshold: float = 0.5, weight: float = 1.0, end: float = 1.15) -> KernelCurve:
    """The numbers of one curve."""
    return KernelCurve(kernel, threshold, weight, end)


def kernel_title(kernel: Kernel) -> str:
    """As a script would write it."""
    return f"{kernel.name}(a = {kernel.a:g})" if kernel.name in ("gauss", "gauss_c1") else kernel.name


def plot_kernel(shown: Sequence[Kernel], threshold: float = 0.5, weight: float = 1.0) -> Figure:
    """D above, D' below, over r = distance / reach; a dot on each curve where it alone reaches the threshold."""
    end = 1.15 if all(np.isfinite(kernels.support(kernel)) for kernel in shown) else 1.6
    curves = [KernelCurve(kernel, threshold, weight, end) for kernel in shown]
    with style.styled():
        figure = style.new_figure(8.2, 6.4)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        of_weight = "" if weight == 1.0 else f", weight {weight:g}"
        style.titled(figure, _title(curves), "density over distance, and how fast it falls" + of_weight)
        _draw(upper, lower, curves)
        _mark(upper, curves, threshold, end)
        upper.set_ylabel("density D")
        lower.set_ylabel("slope D′ = dD/dr")
        lower.set_xlabel("r = distance / reach")
        lower.set_xlim(0.0, end)
        figure.align_ylabels()
        _name(upper, curves)
    return figure


def _title(curves: Sequence[KernelCurve]) -> str:
    return f"Kernel {curves[0].name}" if len(curves) == 1 else f"{len(curves)} kernels"


def _draw(upper: Axes, lower: Axes, curves: Sequence[KernelCurve]) -> None:
    for number, (curve, color) in enumerate(zip(curves, style.colors(len(curves)), strict=True)):
        dash = style.DASHES[number // len(style.PALETTE) % len(style.DASHES)]
        upper.plot(curve.r, curve.value, color=color, linestyle=dash, label=curve.name)
        lower.plot(curve.r, curve.slope, color=color, linestyle=dash)


def _mark(axes: Axes, curves: Sequence[KernelCurve], threshold: float, end: float) -> None:
    """The threshold, the radius of each curve, and the reach."""
    axes.axhline(threshold, color=style.INK, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.annotate(
        f"threshold {threshold:g}",
        (end, threshold),
        xytext=(-4, 4),
        textcoords="offset points",
        ha="right",
        fontsize=8.5,
    )
    axes.axvline(1.0, color=style.MUTED, linewidth=0.8, linestyle=(0, (1, 2)))
    axes.annotate(
        "reach", (1.0, axes.get_ylim()[1]), xytext=(3, -10), textcoords="offset points", fontsize=8.5, color=style.MUTED
    )
    floor = min(0.0, *(float(np.nanmin(curve.value)) for curve in curves))
    for curve, color in zip(curves, style.colors(len(curves)), strict=True):
        if np.isfinite(curve.radius):
            axes.vlines(curve.radius, floor, threshold, color=color, linewidth=1.0, linestyle=(0, (1, 1.5)))
            axes.plot([curve.radius], [threshold], "o", color=color, markersize=5.5, zorder=5)


def _name(axes: Axes, curves: Sequence[KernelCurve]) -> None:
    """With the radius that the threshold gives, in reaches."""
    handles, _ = axes.get_legend_handles_labels()
    told = [
        f"{name}   radius {curve.radius:.3f} reach" if np.isfinite(curve.radius) else f"{name}   no radius"
        for name, curve in zip(_told_apart([curve.name for curve in curves]), curves, strict=True)
    ]
    place, white = (0.995, 0.97), {"facecolor": "white", "edgecolor": "none", "framealpha": 0.85}
    axes.legend(handles, told, loc="upper right", bbox_to_anchor=place, handlelength=2.4, frameon=True, **white)


def _told_apart(names: list[str]) -> list[str]:
    """Kernels of the script that differ in arguments alone are counted, in its order."""
    return [f"{name} ({names[: i + 1].count(name)})" if names.count(name) > 1 else name for i, name in enumerate(names)]
