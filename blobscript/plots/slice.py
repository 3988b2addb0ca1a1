"""Filled contours of the field in an axis-parallel plane, with the threshold line, skeletons and reaches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from blobscript import kernels
from blobscript.enclosure import Box, surface_box
from blobscript.field import extent
from blobscript.framing import view_axes
from blobscript.plots import style
from blobscript.plots.elements import Element, elements_of
from blobscript.plots.style import Axes, Drawing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from blobscript.scene import Scene

__all__ = ["Plane", "default_plane", "plot_slice"]

Array = NDArray[np.float64]

_AXES = "xyz"
#: Points along the longer side of the picture.
_GRID = 480
#: Skeletons and reaches of more elements than this are not drawn one by one.
_MOST_DRAWN = 300
_LEVELS = 9


@dataclass(frozen=True, slots=True)
class Plane:
    """The plane where coordinate `axis` (0, 1, 2 for x, y, z) has the value `at`."""

    axis: int
    at: float

    @property
    def across(self) -> tuple[int, int]:
        """The axes drawn to the right and up: y up where it can be."""
        return {0: (2, 1), 1: (0, 2), 2: (0, 1)}[self.axis]

    @property
    def words(self) -> str:
        return f"{_AXES[self.axis]} = {self.at:g}"


def default_plane(scene: Scene) -> Plane:
    """Across the way the camera looks, through the middle of what there is to see."""
    lo, hi = _bounds(scene, range(len(scene.surfaces)))
    axis = int(np.argmax(np.abs(view_axes(scene.ir.camera)[2])))
    middle, size = float(0.5 * (lo[axis] + hi[axis])), float((hi - lo).max())
    unit = 10.0 ** (math.floor(math.log10(max(size, 1e-300))) - 2)
    return Plane(axis, unit * round(middle / unit) + 0.0)


def _bounds(scene: Scene, numbers: Sequence[int]) -> Box:
    """Around the inside of these surfaces, else around their blobs."""
    boxes = [surface_box(scene.ir.surfaces[n], precision=1 / 16) for n in numbers]
    found = [box for box in boxes if box is not None] or [extent(scene.ir.surfaces[n].field) for n in numbers]
    return np.min([box[0] for box in found], axis=0), np.max([box[1] for box in found], axis=0)


def plot_slice(scene: Scene, plane: Plane | None = None, surface: int | None = None) -> Figure:
    """Of one surface its field; of all (None, where there are several) the largest of field - threshold."""
    plane = plane or default_plane(scene)
    numbers = list(range(len(scene.surfaces))) if surface is None else [surface]
    across, up = _grid(scene, plane, numbers)
    fields = [scene.field(_points(plane, across, up), n).reshape(len(up), len(across)) for n in numbers]
    with style.styled():
        width, height = _size(across, up)
        figure = style.new_figure(width, height)
        axes = figure.subplots()
        _fill(figure, axes, (across, up), scene, fields, numbers)
        elements = [e for n in numbers for e in elements_of(scene.ir, n, _MOST_DRAWN + 1)]
        drawn = len(elements) <= _MOST_DRAWN
        if drawn:
            _reaches(axes, plane, (across, up), elements)
            _skeletons(axes, plane, elements, 0.5 * (across[1] - across[0]))
        _finish(figure, axes, scene, plane, numbers, drawn)
    return figure


def _grid(scene: Scene, plane: Plane, numbers: list[int]) -> tuple[Array, Array]:
    """Around the surfaces, with room for what lies just outside of them."""
    lo, hi = _bounds(scene, numbers)
    first, second = plane.across
    margin = 0.22 * max(hi[first] - lo[first], hi[second] - lo[second])
    sides = [(lo[k] - margin, hi[k] + margin) for k in (first, second)]
    longest = max(b - a for a, b in sides)
    across, up = (_samples(a, b, longest) for a, b in sides)
    return across, up


def _samples(a: float, b: float, longest: float) -> Array:
    return np.linspace(a, b, max(int(_GRID * (b - a) / longest), 60))


def _points(plane: Plane, across: Array, up: Array) -> Array:
    first, second = plane.across
    points = np.empty((len(up), len(across), 3))
    points[..., plane.axis] = plane.at
    points[..., first] = across[None, :]
    points[..., second] = up[:, None]
    return points.reshape(-1, 3)


def _size(across: Array, up: Array) -> tuple[float, float]:
    """Inches: the axes as large as fits into 9 by 7."""
    aspect = (across[-1] - across[0]) / (up[-1] - up[0])
    width = min(7.6, 5.4 * aspect)
    return max(width + 1.9, 5.4), width / aspect + 1.5


# ---- what is drawn -----------------------------------------------------------------------------


def _fill(
    figure: Drawing, axes: Axes, grid: tuple[Array, Array], scene: Scene, fields: list[Array], numbers: list[int]
) -> None:
    """Outside in blues, inside in oranges: where the colour changes is the surface."""
    thresholds = [scene.surfaces[n].threshold for n in numbers]
    single = len(numbers) == 1
    level = thresholds[0] if single else 0.0
    shown = fields[0] if single else np.max([f - t for f, t in zip(fields, thresholds, strict=True)], axis=0)
    nothing = 0.0 if single else -min(thresholds)
    levels, shades = _contours(float(shown.min()), float(shown.max()), nothing, level)
    filled = axes.contourf(*grid, shown, levels=levels, colors=shades)
    filled.set_edgecolor("face")
    axes.contour(*grid, shown, levels=levels[1:-1], colors=style.INK, linewidths=0.25, alpha=0.3)
    for field, threshold in zip(fields, thresholds, strict=True):
        if field.min() < threshold < field.max():
            axes.contour(*grid, field, levels=[threshold], colors=style.INK, linewidths=2.0)
    bar = figure.colorbar(filled, ax=axes, shrink=0.92, pad=0.015, aspect=30, spacing="uniform")
    bar.set_label("density" if single else "largest of density − threshold")
    ticks = [levels[0], *levels[2:-2:2], level, levels[-1]]
    bar.set_ticks(sorted({float(t) for t in ticks if t == level or abs(t - level) > 1e-9}))
    bar.ax.yaxis.set_major_formatter(_shown_number)
    bar.ax.axhline(level, color=style.INK, linewidth=2.0)


def _shown_number(value: float, _position: int) -> str:
    return f"{value:.3g}".replace("-", "−")


def _contours(low: float, high: float, nothing: float, level: float) -> tuple[Array, Array]:
    """Levels with the threshold among them, and the colours between: white where nothing is felt, blue up to the
    threshold, orange above it, purple where negative weights rule."""
    from matplotlib import colormaps

    parts: list[tuple[Array, str, float, float]] = []
    floor = min(nothing, level - 1e-9)
    if low < floor - 1e-9 * (high - low):
        parts.append((np.linspace(low, floor, 5), "Purples", 0.75, 0.15))
    parts.append((np.linspace(floor, level, _LEVELS), "Blues", 0.0, 0.68))
    parts.append((np.linspace(level, max(high, level + 1e-9), _LEVELS), "Oranges", 0.22, 0.95))
    levels = np.concatenate([parts[0][0][:1], *(part[0][1:] for part in parts)])
    shades = [colormaps[name](np.linspace(a, b, len(values) - 1)) for values, name, a, b in parts]
    return levels, np.concatenate(shades)


def _reaches(axes: Axes, plane: Plane, grid: tuple[Array, Array], elements: list[Element]) -> None:
    """Where each element's reach cuts the plane."""
    points = _points(plane, *grid)
    step = max(1, len(points) * len(elements) // 20_000_000)
    across, up = grid[0][::step], grid[1][::step]
    points = _points(plane, across, up)
    faint = 0.9 if len(elements) <= 40 else 0.3
    for element in elements:
        square = element.square(points).reshape(len(up), len(across))
        if square.min() < 1.0 < square.max():
            dash = "dotted" if np.isfinite(kernels.support(element.kernel)) else "dashdot"
            color = style.BLUE if element.weight > 0 else style.RED
            axes.contour(across, up, square, levels=[1.0], colors=color, linewidths=0.8, linestyles=dash, alpha=faint)


def _skeletons(axes: Axes, plane: Plane, elements: list[Element], near: float) -> None:
    """Seen at right angles to the plane: in it in full colour, before and behind it pale."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgba

    first, second = plane.across
    for element in elements:
        color = style.INK if element.weight > 0 else style.RED
        corners = _in_scene(element)
        sides = corners[..., plane.axis] - plane.at
        cut = (sides.min(axis=1) <= near) & (sides.max(axis=1) >= -near)
        shades = [to_rgba(color, 0.9 if here else 0.25) for here in cut]
        flat = corners[..., [first, second]]
        if corners.shape[1] == 1:
            axes.scatter(flat[:, 0, 0], flat[:, 0, 1], s=11, c=shades, linewidths=0, zorder=5)
        else:
            closed = np.concatenate([flat, flat[:, :1]], axis=1) if corners.shape[1] == 3 else flat
            width = 0.5 if len(flat) > 12 else 1.6
            axes.add_collection(LineCollection(list(closed), colors=shades, linewidths=width, zorder=5))


def _in_scene(element: Element) -> Array:
    """(m, k, 3) corners of its skeleton in scene space."""
    matrix = element.leaf.matrix
    if matrix is None:
        return element.corners
    return (element.corners - matrix[:, 3]) @ np.linalg.inv(matrix[:, :3]).T


def _finish(figure: Drawing, axes: Axes, scene: Scene, plane: Plane, numbers: list[int], drawn: bool) -> None:
    from matplotlib.lines import Line2D

    what = scene.surfaces[numbers[0]].name if len(numbers) == 1 else f"{len(numbers)} surfaces"
    threshold = f"threshold {scene.surfaces[numbers[0]].threshold:g}" if len(numbers) == 1 else "each at its threshold"
    style.titled(figure, f"Slice at {plane.words} through {what}", f"{threshold}; orange is inside, blue outside")
    first, second = plane.across
    axes.set_xlabel(f"{_AXES[first]} (scene units)")
    axes.set_ylabel(f"{_AXES[second]} (scene units)")
    axes.set_aspect("equal")
    axes.grid(False)
    if first == 2:
        axes.invert_xaxis()
    handles = [Line2D([], [], color=style.INK, linewidth=2.0, label="surface")]
    if drawn:
        handles += [
            Line2D([], [], color=style.INK, marker="o", markersize=3.2, linestyle="none", label="skeleton"),
            Line2D([], [], color=style.BLUE, linewidth=0.8, linestyle="dotted", label="reach"),
        ]
    axes.legend(handles=handles, loc="upper left", ncols=3, frameon=True, facecolor="white", edgecolor="none")
