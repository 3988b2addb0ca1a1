"""The density of each element and their sum along one ray, with spans, bounds and the hit: how span search works."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from blobscript.plots import style
from blobscript.plots.elements import Element, Ray, Tree, flat, tree_along
from blobscript.plots.sandwich import Search, Step, densities, search, window
from blobscript.plots.style import Axes, Drawing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from blobscript.backends.native import Hits
    from blobscript.scene import Scene

__all__ = ["Along", "along", "draw_along", "name_of", "plot_ray", "telling_surface"]

Array = NDArray[np.float64]

_SAMPLES = 1600
#: More elements than this share one grey, and get no row of their own.
_MOST_NAMED = 10
#: How much is shown behind a hit, times the way from where something is felt to the hit.
_BEHIND = 4.0
#: Where there is a hit, nothing is shown above so many thresholds.
_ABOVE = 3.0
#: Behind this share of the axes a hit has its words on its left.
_LATE = 0.75
_FILL = {"skip": style.SKY, "move": style.GREEN, "halve": style.ORANGE, "bracket": style.RED}
_WORDS = {
    "skip": "no root: skip",
    "move": "none before here: move on",
    "halve": "undecided: halve",
    "bracket": "root proved: bracket",
}


@dataclass(frozen=True, slots=True, eq=False)
class Along:
    """What lies along a ray of one surface. `hit`: the tracer's own answer (None: it misses this surface)."""

    scene: Scene
    surface: int
    ray: Ray
    tree: Tree
    search: Search
    hit: float | None
    hits: Hits

    @property
    def elements(self) -> list[Element]:
        """Those that are felt somewhere along the line, by where they begin."""
        felt = [(ends[0], e.number, e) for e in flat(self.tree) if (ends := e.interval(self.ray)) is not None]
        return [e for _, _, e in sorted(felt, key=lambda entry: entry[:2])]

    @property
    def threshold(self) -> float:
        return self.scene.surfaces[self.surface].threshold


def along(scene: Scene, origin: Array, direction: Array, surface: int | None = None) -> Along:
    """Everything about the ray; surface None: the one that is hit, else the one that comes nearest to it."""
    d = np.asarray(direction, dtype=np.float64)
    d = d / np.abs(d).max()
    ray = Ray(np.asarray(origin, dtype=np.float64), d / np.linalg.norm(d))
    hits = scene.first_hit(ray.origin[None], ray.direction[None])
    number = telling_surface(scene, ray, int(hits.surface[0])) if surface is None else surface
    tree = tree_along(scene.ir, number, ray)
    threshold = scene.surfaces[number].threshold
    hit = float(hits.t[0]) if int(hits.surface[0]) == number else None
    return Along(scene, number, ray, tree, search(tree, ray, threshold), hit, hits)


def telling_surface(scene: Scene, ray: Ray, hit: int) -> int:
    """The surface that is hit; else the one whose field comes nearest to its threshold along the ray."""
    if hit >= 0:
        return hit
    best, nearest = 0, -np.inf
    for number, surface in enumerate(scene.surfaces):
        tree = tree_along(scene.ir, number, ray)
        ends = window(tree, ray)
        if ends is None or ends[1] <= 0.0:
            continue
        t = np.linspace(max(ends[0], 0.0), ends[1], 257)
        close = float((densities(tree, ray.at(t)) - surface.threshold).max()) / (abs(surface.threshold) or 1.0)
        if close > nearest:
            best, nearest = number, close
    return best


def name_of(element: Element) -> str:
    """Kind, number in its surface, and line of the script: `point 3, line 12`."""
    where = "" if element.place is None else f", line {element.place.line}"
    return f"{element.kind} {element.number + 1}{where}"


# ---- the figure --------------------------------------------------------------------------------


def plot_ray(scene: Scene, origin: Array, direction: Array, surface: int | None = None, what: str = "") -> Figure:
    """Three rows over t: densities and their sum with the bounds; where each element is felt; the search's steps.

    origin, direction: (3,); `what` says in the title which ray it is."""
    found = along(scene, origin, direction, surface)
    with style.styled():
        figure = style.new_figure(9.6, 6.6)
        draw_along(figure, found, what or _ray_words(found.ray))
    return figure


def _ray_words(ray: Ray) -> str:
    o, d = (", ".join(f"{x:.4g}" for x in v) for v in (ray.origin, ray.direction))
    return f"from ({o}) towards ({d})"


def draw_along(figure: Drawing, found: Along, what: str) -> None:
    """Into a figure or a part of one."""
    elements = [e for e in found.elements if _begins(e, found)]
    rows = min(len(elements), _MOST_NAMED)
    heights = (4.2, 0.5 + 0.17 * max(rows, 2), 0.4 + 0.09 * _strip_rows(len(found.search.steps)))
    main, spans, steps = figure.subplots(3, 1, sharex=True, height_ratios=heights)
    effort = f"{what}; the tracer took {int(found.hits.evaluations[0])} evaluations"
    style.titled(figure, f"The field of {found.scene.surfaces[found.surface].name} along a ray", effort)
    main.set_ylabel("density")
    steps.set_xlabel("distance t along the ray (scene units)")
    if not elements:
        style.caption(main, "nothing is felt along this ray", x=0.5, y=0.5, ha="center", va="center")
    else:
        _draw_densities(main, found, elements)
        _draw_steps(main, steps, found)
    _draw_spans(spans, found, elements)
    _mark_hit(main, (spans, steps), found)
    _limits(main, found, elements)
    for axes in (spans, steps):
        axes.grid(False)
        axes.spines["left"].set_visible(False)
        axes.tick_params(axis="y", length=0)
    figure.align_ylabels() if hasattr(figure, "align_ylabels") else None


def _begins(element: Element, found: Along) -> bool:
    """Within what is shown?"""
    ends, (lo, hi) = element.interval(found.ray), _shown(found)
    return ends is not None and ends[0] < hi and ends[1] > lo


def _draw_densities(axes: Axes, found: Along, elements: list[Element]) -> None:
    t = _distances(found)
    points = found.ray.at(t)
    for element, color in zip(elements, _shades(elements), strict=True):
        axes.plot(t, element.density(points), color=color, linewidth=1.1)
    axes.plot(t, densities(found.tree, points), color=style.INK, linewidth=2.0, label=_sum_word(found.tree), zorder=4)
    axes.axhline(found.threshold, color=style.INK, linewidth=1.0, linestyle=(0, (4, 3)), zorder=3)
    axes.annotate(
        f"threshold {found.threshold:g}",
        (1.0, found.threshold),
        xycoords=("axes fraction", "data"),
        xytext=(-2, 4),
        textcoords="offset points",
        ha="right",
        fontsize=8.5,
    )


def _shades(elements: list[Element]) -> list[str]:
    """A colour for each."""
    count = len(elements)
    return style.colors(count, style.OTHERS) if count <= _MOST_NAMED else [style.MUTED] * count


def _sum_word(tree: Tree) -> str:
    mixed = not isinstance(tree, Element) and any(not isinstance(child, Element) for child in tree[1])
    return "field" if mixed or (not isinstance(tree, Element) and tree[0] != "sum") else "sum"


def _distances(found: Along) -> Array:
    lo, hi = _shown(found)
    return np.unique(np.concatenate([np.linspace(lo, hi, _SAMPLES), found.search.events]))


def _shown(found: Along) -> tuple[float, float]:
    """The window; where there is a hit, no farther behind it than makes the search look small."""
    start, end = found.search.start, found.search.end
    if found.hit is not None and np.isfinite(found.hit):
        end = min(end, found.hit + _BEHIND * max(found.hit - start, 0.02 * (end - start)))
    margin = 0.05 * ((end - start) or 1.0)
    return start - margin, end + margin


def _draw_steps(main: Axes, strip: Axes, found: Along) -> None:
    """Bounds of every step in the upper axes; its stretch and outcome in the strip."""
    seen: set[str] = set()
    for step in found.search.steps:
        color = _FILL[step.outcome]
        t = np.linspace(step.a, step.b, 65)
        low, high = step.bounds(t)
        main.fill_between(t, low, high, color=color, alpha=0.22, linewidth=0.0, zorder=2)
        main.plot(t, high, color=color, linewidth=0.9, zorder=3)
        main.plot(t, low, color=color, linewidth=0.9, zorder=3)
        seen.add(step.outcome)
    _draw_strip(strip, found.search.steps)
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Line2D([], [], color=style.INK, linewidth=2.0, label=_sum_word(found.tree))]
    handles += [Patch(color=_FILL[o], alpha=0.5, label=_WORDS[o]) for o in _FILL if o in seen]
    main.legend(handles=handles, loc="lower left", bbox_to_anchor=(-0.01, 0.99), ncols=5, columnspacing=1.4)


def _draw_strip(strip: Axes, steps: tuple[Step, ...]) -> None:
    """One bar per step, one below the other until they have to start again."""
    rows = _strip_rows(len(steps))
    for number, step in enumerate(steps):
        row = rows - 1 - number % rows
        strip.barh(row, step.b - step.a, left=step.a, height=0.8, color=_FILL[step.outcome], alpha=0.75, linewidth=0)
    strip.set_ylim(-0.6, rows - 0.4)
    strip.set_yticks([])
    word = "step" if len(steps) == 1 else "steps"
    strip.set_ylabel(f"{len(steps)} {word}", rotation=0, ha="right", va="center")


def _strip_rows(steps: int) -> int:
    return min(max(steps, 3), 16)


def _draw_spans(axes: Axes, found: Along, elements: list[Element]) -> None:
    """Where each element is felt; spans between events shaded by how many are."""
    many = len(elements) > _MOST_NAMED
    for row, (element, color) in enumerate(zip(elements, _shades(elements), strict=True)):
        ends = element.interval(found.ray)
        if ends is not None:
            axes.barh(row, ends[1] - ends[0], left=ends[0], height=0.62, color=color, linewidth=0)
    axes.set_ylim(max(len(elements), 1) - 0.4, -0.6)
    if many:
        axes.set_yticks([])
        axes.set_ylabel(f"{len(elements)} elements", rotation=0, ha="right", va="center")
    else:
        axes.set_yticks(range(len(elements)), [name_of(element) for element in elements])
    events = found.search.events
    for number, (a, b) in enumerate(pairwise(events.tolist())):
        if number % 2 == 0:
            axes.axvspan(a, b, color=style.FAINT, alpha=0.45, linewidth=0, zorder=0)


def _mark_hit(main: Axes, others: tuple[Axes, Axes], found: Along) -> None:
    if found.hit is None:
        style.caption(main, "no hit on this surface")
        return
    for axes in (main, *others):
        axes.axvline(found.hit, color=style.RED, linewidth=1.1, zorder=5)
    main.plot([found.hit], [found.threshold], "o", color=style.RED, markersize=7, zorder=6)
    lo, hi = _shown(found)
    is_late = found.hit > lo + _LATE * (hi - lo)
    # above the curves: `_limits` leaves room there
    main.annotate(
        f"hit at t = {found.hit:.6g}",
        (found.hit, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(-7 if is_late else 7, -5),
        textcoords="offset points",
        ha="right" if is_late else "left",
        va="top",
        color=style.RED,
        fontsize=9.5,
        fontweight="bold",
        zorder=7,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5},
    )


def _limits(axes: Axes, found: Along, elements: list[Element]) -> None:
    """The values decide the height, not the bounds: those of long steps go far beyond."""
    if not elements:
        axes.set_xlim(0.0, 1.0)
        return
    axes.set_xlim(*_shown(found))
    points = found.ray.at(_distances(found))
    drawn = [densities(found.tree, points), *(e.density(points) for e in elements[:200])]
    low, high = min(float(v.min()) for v in drawn), max(float(v.max()) for v in drawn)
    low, high = min(low, 0.0, found.threshold), max(high, found.threshold)
    if found.hit is not None and found.threshold > 0.0:
        high = min(high, _ABOVE * found.threshold)
    axes.set_ylim(low - 0.08 * (high - low), high + 0.22 * (high - low))
