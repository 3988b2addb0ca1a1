"""The plots of a report, each a matplotlib figure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from blobscript.plots import style
from blobscript.plots.style import Axes
from blobscript.reporting.content import Report
from blobscript.reporting.judging import RULE_OF_THREE
from blobscript.reporting.pov import PovResult
from blobscript.reporting.sampling import SamplingResult
from blobscript.reporting.searches import PROVED, Result
from blobscript.reporting.summary import best_search, pareto, setting_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "ERROR_FLOOR",
    "error_maps",
    "indexes_figure",
    "meshes_figure",
    "normals_figure",
    "povray_figure",
    "sampling_figure",
    "search_curves",
    "search_legend",
    "searches_figure",
]

Array = NDArray[np.float64]

#: Errors below are drawn here: nothing of interest is smaller, and 0 has no logarithm.
ERROR_FLOOR = 1e-17
_COLORS = {
    "sandwich": style.BLUE,
    "bernstein": style.GREEN,
    "interval": style.SKY,
    "segment": style.ORANGE,
    "sphere": style.RED,
    "march": style.PURPLE,
}
_MARKS = dict(zip(_COLORS, style.MARKERS, strict=True))


# ---- searches ----------------------------------------------------------------------------------


def searches_figure(report: Report, evaluations: bool = False) -> Figure:
    """Median, 99 % and largest error, and mistakes, against time (or evaluations) per ray; a curve per search."""
    results = report.searches
    with style.styled():
        figure = style.new_figure(10.2, 8.2)
        panels = figure.subplots(2, 2, sharey=True).ravel()
        what = "evaluations of the field" if evaluations else "run time"
        subtitle = "one curve per search, one marker per tolerance or step; best is bottom left"
        style.titled(figure, f"Error against {what}", subtitle)
        cost = _evaluations if evaluations else _micro
        errors: list[tuple[str, Callable[[Result], float]]] = [
            ("Median error", lambda r: r.judgement.errors.median),
            ("99 % of errors are below", lambda r: r.judgement.errors.p99),
            ("Largest error", lambda r: r.judgement.errors.max),
        ]
        for axes, (title, value) in zip(panels[:3], errors, strict=True):
            _error_panel(axes, results, value, cost)
            axes.set_title(title, fontsize=10)
            axes.set_xlabel("distance error over right hits (scene units)")
        _mistakes_panel(panels[3], results, cost)
        for axes in panels[::2]:
            axes.set_ylabel("evaluations per ray (field and bounds)" if evaluations else "time per ray (µs)")
        if not evaluations:
            _draw_front(panels[2], pareto(results))
        _mark_best(panels, results, cost)
        search_legend(figure, results)
    return figure


def _micro(result: Result) -> float:
    return 1e6 * result.time.least


def _evaluations(result: Result) -> float:
    return result.judgement.evaluations


def _by_search(results: Sequence[Result]) -> dict[str, list[Result]]:
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(result.method.search, []).append(result)
    return groups


def _error_panel(
    axes: Axes, results: Sequence[Result], value: Callable[[Result], float], cost: Callable[[Result], float]
) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for search, rows in _by_search(results).items():
        good = [r for r in rows if np.isfinite(value(r))]
        x, y = [max(value(r), ERROR_FLOOR) for r in good], [cost(r) for r in good]
        _curve(axes, search, x, y)
    axes.axvspan(axes.get_xlim()[0], 2.0**-52, color=style.FAINT, alpha=0.35, linewidth=0)


def _curve(axes: Axes, search: str, x: list[float], y: list[float]) -> None:
    color = _COLORS.get(search, style.INK)
    line = "-" if search in PROVED else (0, (4, 1.5))
    axes.plot(x, y, color=color, linestyle=line, linewidth=1.4, marker=_MARKS.get(search, "x"), markersize=5.5)


def _mistakes_panel(axes: Axes, results: Sequence[Result], cost: Callable[[Result], float]) -> None:
    """Missed, false and wrong hits per million rays; what made none stands at the bound that this proves."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    most = max(r.judgement.all.rays for r in results)
    floor = 1e6 * RULE_OF_THREE / max(most, 1)
    for search, rows in _by_search(results).items():
        color, mark = _COLORS.get(search, style.INK), _MARKS.get(search, "x")
        for result in rows:
            bad = result.judgement.all.bad
            x = 1e6 * (bad or RULE_OF_THREE) / max(result.judgement.all.rays, 1)
            axes.plot(
                [x], [cost(result)], marker=mark, color=color, markersize=5.5, markerfacecolor=color if bad else "white"
            )
    axes.axvline(floor, color=style.INK, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.annotate(
        "0 seen: below 3/N\n(95 % confidence)",
        (floor, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(5, -4),
        textcoords="offset points",
        va="top",
        fontsize=8,
    )
    axes.set_xlim(0.2 * floor, max(2e6, 4 * floor))
    axes.set_title("Mistakes: missed, false, another root", fontsize=10)
    axes.set_xlabel(f"per million rays (N = {most}, less where hollow marks are further right)")


def _draw_front(axes: Axes, front: Sequence[Result]) -> None:
    """Faultless and not beaten in both: nothing lies below and to the left."""
    x = [max(r.judgement.errors.max, ERROR_FLOOR) for r in front]
    y = [_micro(r) for r in front]
    if front:
        axes.plot(
            [*x[:1], *x], [*y[:1], *y], color=style.INK, linewidth=5.0, alpha=0.12, drawstyle="steps-post", zorder=1
        )
        style.caption(axes, "grey: best of the faultless ones", x=0.98, y=0.97, va="top")


def _mark_best(panels: Sequence[Axes], results: Sequence[Result], cost: Callable[[Result], float]) -> None:
    best = best_search(list(results))
    if best is None:
        return
    errors = best.judgement.errors
    for axes, x in zip(panels[:3], (errors.median, errors.p99, errors.max), strict=True):
        if np.isfinite(x):
            axes.plot(
                [max(x, ERROR_FLOOR)],
                [cost(best)],
                "o",
                markersize=12,
                markerfacecolor="none",
                markeredgecolor=style.INK,
                zorder=6,
            )


def search_curves(axes: Axes, results: Sequence[Result]) -> None:
    """Largest error against time, a curve per search."""
    _error_panel(axes, results, lambda r: r.judgement.errors.max, _micro)


def search_legend(figure: Any, results: Sequence[Result], more: Sequence[tuple[str, str]] = (("taken", "o"),)) -> None:
    """more: names and markers of what is not a search; circles are open."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D(
            [],
            [],
            color=_COLORS.get(search, style.INK),
            marker=_MARKS.get(search, "x"),
            linestyle="-" if search in PROVED else (0, (4, 1.5)),
            label=f"{search} (proved)" if search in PROVED else search,
        )
        for search in _by_search(results)
    ]
    for name, mark in more:
        face = "none" if mark == "o" else style.INK
        handles.append(
            Line2D(
                [], [], linestyle="none", marker=mark, markersize=10, markerfacecolor=face, color=style.INK, label=name
            )
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=7, fontsize=8.5)


# ---- normals, indexes --------------------------------------------------------------------------


def normals_figure(report: Report) -> Figure:
    with style.styled():
        figure = style.new_figure(10.2, 4.0)
        left, right = figure.subplots(1, 2)
        style.titled(figure, "Normals: analytic and by differences", "at the certified hits, creases left out")
        colors = {"forward": style.ORANGE, "central": style.GREEN}
        for normals, color in colors.items():
            rows = [r for r in report.normals if r.normals == normals]
            steps = [r.step for r in rows]
            left.loglog(
                steps, [max(r.errors.max, ERROR_FLOOR) for r in rows], "o-", color=color, label=f"{normals}, largest"
            )
            left.loglog(
                steps,
                [max(r.errors.median, ERROR_FLOOR) for r in rows],
                "o:",
                color=color,
                label=f"{normals}, median",
                markersize=3,
            )
            right.loglog(
                [max(r.errors.max, ERROR_FLOOR) for r in rows],
                [1e6 * r.time.least for r in rows],
                "o",
                color=color,
                label=normals,
            )
        exact = next(r for r in report.normals if r.normals == "analytic")
        left.axhline(max(exact.errors.max, ERROR_FLOOR), color=style.BLUE, label="analytic, largest")
        right.loglog(
            [max(exact.errors.max, ERROR_FLOOR)],
            [1e6 * exact.time.least],
            "s",
            color=style.BLUE,
            markersize=7,
            label="analytic",
        )
        left.set_xlabel("step of the differences (units)")
        left.set_ylabel("angle error (rad)")
        right.set_xlabel("largest angle error (rad)")
        right.set_ylabel("time per ray, trace included (µs)")
        _linear_minor(right)
        left.legend(loc="best", frameon=True, facecolor="white", edgecolor="none", framealpha=0.85)
        right.legend(loc="best")
    return figure


def _linear_minor(axes: Axes) -> None:
    """From zero: times here are close to each other."""
    axes.set_yscale("linear")
    axes.set_ylim(0.0, 1.25 * axes.get_ylim()[1])


def indexes_figure(report: Report) -> Figure:
    with style.styled():
        figure = style.new_figure(10.2, 3.3)
        build, trace, total = figure.subplots(1, 3, sharey=True)
        style.titled(figure, "Spatial indexes", "one thread; least of the runs, whiskers to the third quartile")
        names = [r.index for r in report.indexes]
        rows = list(range(len(names)))
        _bars(build, rows, [1e3 * r.build.least for r in report.indexes], [1e3 * r.build.high for r in report.indexes])
        _bars(trace, rows, [1e6 * r.trace.least for r in report.indexes], [1e6 * r.trace.high for r in report.indexes])
        _bars(total, rows, [1e3 * r.total for r in report.indexes], None)
        build.set_yticks(rows, names)
        build.invert_yaxis()
        for axes, label in (
            (build, "to build (ms)"),
            (trace, "to trace, per ray (µs)"),
            (total, "both, for 640 x 480 rays (ms)"),
        ):
            axes.set_xlabel(label)
            axes.grid(axis="y", visible=False)
    return figure


def _bars(axes: Axes, rows: list[int], values: list[float], high: list[float] | None) -> None:
    best = min(values)
    colors = [style.BLUE if v == best else style.SKY for v in values]
    whiskers = None if high is None else [[0.0] * len(values), [h - v for h, v in zip(high, values, strict=True)]]
    axes.barh(
        rows, values, height=0.62, color=colors, xerr=whiskers, error_kw={"elinewidth": 0.9, "ecolor": style.MUTED}
    )
    top = max(values if high is None else high)
    for row, value in zip(rows, values, strict=True):
        axes.annotate(
            f"{value:.3g}",
            (0.0, row),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color="white" if value > 0.25 * top else style.INK,
        )
    axes.set_xlim(0.0, 1.08 * top)


# ---- meshes, samples ---------------------------------------------------------------------------


def meshes_figure(report: Report) -> Figure:
    results = report.meshes
    with style.styled():
        figure = style.new_figure(10.2, 4.0)
        left, right = figure.subplots(1, 2, sharey=True)
        style.titled(figure, "Meshes over the cell size", "distance between mesh and surface, both ways")
        cells = [r.cell for r in results]
        curves = [
            ("surface to mesh, 99 %", [r.to_mesh.p99 for r in results], style.BLUE, "o-"),
            ("surface to mesh, median", [r.to_mesh.median for r in results], style.BLUE, "o:"),
            ("mesh to surface, 99 %", [r.to_surface.p99 for r in results], style.ORANGE, "s-"),
        ]
        for name, values, color, mark in curves:
            shown = np.maximum(np.array(values, dtype=np.float64), ERROR_FLOOR)
            left.loglog(cells, shown, mark, color=color, label=name)
            right.loglog([1e3 * r.time.least for r in results], shown, mark, color=color)
        guide = np.array([cells[0], cells[-1]])
        start = 0.35 * float(np.nanmin([results[0].to_mesh.median, results[0].to_surface.p99]))
        left.loglog(guide, start * (guide / guide[0]) ** 2, color=style.MUTED, linewidth=1.0, linestyle=(0, (2, 2)))
        left.annotate(
            "cell²",
            (guide[0], start),
            xytext=(4, -3),
            textcoords="offset points",
            fontsize=8.5,
            color=style.MUTED,
        )
        _plain_numbers(left.xaxis)
        times = [r.time.least for r in results]
        if max(times) < _NARROW * min(times):
            right.set_xscale("linear")
        else:
            _plain_numbers(right.xaxis)
        left.set_xlabel("cell (scene units)")
        left.set_ylabel("distance (scene units)")
        right.set_xlabel("time to make the mesh (ms)")
        left.legend(loc="best", frameon=True, facecolor="white", edgecolor="none", framealpha=0.85)
    return figure


#: Times that differ by less than this are shown without logarithms.
_NARROW = 4.0


def _plain_numbers(axis: Any) -> None:
    """1, 2, 5, 10: for logarithms that cover little more than a power of ten."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def sampling_figure(report: Report) -> Figure:
    sampling = report.sampling
    with style.styled():
        figure = style.new_figure(10.2, 3.8)
        left, right = figure.subplots(1, 2, sharey=True)
        size = f"{sampling.width} x {sampling.height} pixels"
        subtitle = f"against {sampling.converged} samples a pixel with another seed, {size}"
        style.titled(figure, "Antialiasing: error over samples", subtitle)
        n = np.array([r.samples for r in sampling.fixed], dtype=np.float64)
        rms = np.maximum([r.rms for r in sampling.fixed], 1e-6)
        left.loglog(n, rms, "o-", color=style.BLUE)
        for power, name in ((0.5, "1/√n"), (0.75, "n^(−3/4)")):
            guide = rms[0] * n**-power
            left.loglog(n, guide, color=style.MUTED, linewidth=0.9, linestyle=(0, (2, 2)))
            left.annotate(
                name, (n[-1], guide[-1]), xytext=(3, -3), textcoords="offset points", fontsize=8, color=style.MUTED
            )
        curves = (
            (sampling.fixed, style.BLUE, "o-", "the same number"),
            (sampling.adaptive, style.ORANGE, "s-", "as noise needs"),
        )
        for rows, color, mark, label in curves:
            heights = [max(r.rms, 1e-6) for r in rows]
            right.loglog([1e6 * r.time.least for r in rows], heights, mark, color=color, label=label)
            _name_samples(right, rows, heights, color, color == style.ORANGE)
        for axis in (left.xaxis, left.yaxis, right.xaxis):
            _plain_numbers(axis)
        right.legend(loc="best")
        for axes in (left, right):
            axes.axhline(1.0 / 255.0, color=style.INK, linewidth=0.9, linestyle=(0, (4, 3)))
        left.annotate("one step of 8 bits", (n[0], 1.0 / 255.0), xytext=(0, 3), textcoords="offset points", fontsize=8)
        left.set_xlim(right=2.6 * n[-1])
        left.set_xlabel("samples a pixel")
        left.set_ylabel("root mean square error (sRGB, 0 to 1)")
        right.set_xlabel("time per pixel (µs); labels: samples")
    return figure


def _name_samples(axes: Axes, rows: Sequence[SamplingResult], heights: list[float], color: str, below: bool) -> None:
    """Above and right of the curve, or below and left; what lies all but on the one before has no name."""
    before = (0.0, 0.0)
    for r, y in zip(rows, heights, strict=True):
        at = (1e6 * r.time.least, y)
        if abs(at[0] - before[0]) > 0.1 * at[0] or abs(y - before[1]) > 0.1 * y:
            axes.annotate(
                r.words,
                at,
                xytext=(-5, -4) if below else (5, 4),
                textcoords="offset points",
                ha="right" if below else "left",
                va="top" if below else "bottom",
                fontsize=8,
                color=color,
            )
        before = at


# ---- POV-Ray -----------------------------------------------------------------------------------


def povray_figure(report: Report) -> Figure:
    """Largest error and mistakes against time, each variant by its name; the search taken here beside them."""
    povray = report.povray
    results = povray.results if povray else []
    best = best_search(report.searches)
    with style.styled():
        figure = style.new_figure(10.2, 4.4)
        left, right = figure.subplots(1, 2, sharey=True)
        style.titled(figure, "Beside POV-Ray", "the same rays; time of its trace phase per ray, one thread")
        rays = max(report.searches[0].judgement.all.rays, 1)
        floor = 1e6 * RULE_OF_THREE / rays
        for r in results:
            y, bad = 1e6 * r.time.least, r.judgement.all.bad
            color = style.RED if r.gradient in (0.0, 1.0) else style.PURPLE
            if np.isfinite(r.judgement.errors.max):
                left.loglog([max(r.judgement.errors.max, ERROR_FLOOR)], [y], "s", color=color)
                _beside(left, max(r.judgement.errors.max, ERROR_FLOOR), y, _short(r), color, color == style.PURPLE)
            right.loglog(
                [1e6 * bad / rays if bad else floor], [y], "s", color=color, markerfacecolor=color if bad else "white"
            )
        if best is not None:
            x, y = max(best.judgement.errors.max, ERROR_FLOOR), 1e6 * best.time.least
            left.loglog([x], [y], "o", color=style.BLUE)
            _beside(left, x, y, best.method.search, style.BLUE)
            right.loglog([floor], [y], "o", color=style.BLUE, markerfacecolor="white")
        right.axvline(floor, color=style.INK, linewidth=1.0, linestyle=(0, (4, 3)))
        style.caption(right, "dashed: 0 seen, below 3/N", y=0.03, va="bottom")
        right.set_xlim(0.2 * floor, 2e6)
        left.margins(x=0.25, y=0.15)
        left.set_xlabel("largest distance error (scene units)")
        left.set_ylabel("time per ray (µs)")
        right.set_xlabel("mistakes per million rays")
    return figure


def _short(result: PovResult) -> str:
    if result.gradient not in (0.0, 1.0):
        return f"max_gradient × {result.gradient:g}"
    return f"accuracy {result.accuracy:.0e}" if result.accuracy else result.form


def _beside(axes: Axes, x: float, y: float, text: str, color: str, before: bool = False) -> None:
    """On the right of a mark, or `before` it."""
    way, side = (-7, "right") if before else (7, "left")
    axes.annotate(
        text, (x, y), xytext=(way, 0), textcoords="offset points", ha=side, va="center", fontsize=8, color=color
    )


# ---- error maps --------------------------------------------------------------------------------


def error_maps(report: Report) -> Figure:
    """Per pixel the logarithm of the distance error, of the method taken and of one of each without proof."""
    from matplotlib.colors import ListedColormap

    shown = _mapped_results(report)
    with style.styled():
        aspect = report.rays.width / report.rays.height
        width = 3.1
        figure = style.new_figure(width * len(shown) + 1.0, width / aspect + 1.5)
        panels = np.atleast_1d(figure.subplots(1, len(shown)))
        style.titled(
            figure,
            "Where the errors are",
            "distance error of each pixel's ray; red: missed, false or another root; white: certified miss",
        )
        image = None
        for axes, result in zip(panels, shown, strict=True):
            values, bad = _map(report, result)
            image = axes.imshow(values, cmap="viridis", vmin=-17, vmax=-1, interpolation="nearest")
            axes.imshow(np.where(bad, 1.0, np.nan), cmap=ListedColormap([style.RED]), interpolation="nearest")
            axes.set_title(setting_words(result).replace(", ", "\n", 1), fontsize=9)
            axes.set_xticks([])
            axes.set_yticks([])
            axes.grid(False)
            for spine in axes.spines.values():
                spine.set_visible(False)
        bar = figure.colorbar(image, ax=list(panels), shrink=0.85, pad=0.01, aspect=25)
        bar.set_label("log₁₀ of the error (scene units)")
    return figure


def _mapped_results(report: Report) -> list[Result]:
    """The method taken; of segment, sphere and march the one in the middle of its sweep."""
    best = best_search(report.searches) or report.searches[0]
    whole = max(r.judgement.all.rays for r in report.searches)
    groups = _by_search([r for r in report.searches if r.judgement.all.rays == whole])
    others = [groups[search] for search in ("sphere", "march") if search in groups and search != best.method.search]
    return [best, *(rows[len(rows) // 2 - (len(rows) > 1)] for rows in others)]


def _map(report: Report, result: Result) -> tuple[Array, NDArray[np.bool_]]:
    """(height, width) log10 of errors, NaN where there is none; and where the answer is wrong."""
    rays = report.rays
    values = np.full(rays.width * rays.height, np.nan)
    bad = np.zeros(rays.width * rays.height, dtype=np.bool_)
    error = result.judgement.error[: rays.picture]
    values[rays.pixel] = np.log10(np.maximum(error, ERROR_FLOOR))
    bad[rays.pixel] = result.judgement.bad[: rays.picture]
    shape = rays.height, rays.width
    return values.reshape(shape), bad.reshape(shape)
