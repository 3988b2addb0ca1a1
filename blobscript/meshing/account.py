"""The report of a mesh: how far from the surface, how it converges, what it took; as page, Markdown or JSON.

Beside the mesh itself, coarser ones are made with a half, a quarter, … of its cells along a side: volume and area of
three in a row give their order of convergence, distances and times the plot of error against run time.
"""

from __future__ import annotations

import html
import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from blobscript.meshing.build import MeshError, Options, Part, bodies
from blobscript.meshing.measure import (
    Shape,
    Topology,
    distance_from_surface,
    distance_to_surface,
    residual,
    shape_of,
    topology,
)
from blobscript.outputs import check_ending, check_output

if TYPE_CHECKING:
    from blobscript.scene import Scene

__all__ = ["Account", "Step", "account_of", "check_report", "plot_convergence", "report_text"]

_ENDINGS = (".html", ".md", ".json")
#: How many coarser meshes are made, and how few cells the coarsest may have along its longest side.
_COARSER, _FEWEST = 4, 10
#: Times that a mesh is made, by turns: the least time counts. One that takes longer than _LONG seconds is made once.
_REPEATS, _LONG = 3, 1.0
#: Where an order of convergence may lie: 2 on smooth surfaces, 1 at creases.
_ORDERS = (0.5, 3.5)


@dataclass(frozen=True, slots=True)
class Step:
    """One mesh of all surfaces at one size of cells. Distances in scene units: the largest of all bodies."""

    cell: float
    triangles: int
    to_surface: float
    from_surface: float
    volume: float
    area: float
    seconds: float


@dataclass(frozen=True, slots=True)
class BodyAccount:
    """One body of the mesh asked for. residual: the largest |F| / |grad F| at a vertex, scene units."""

    name: str
    vertices: int
    triangles: int
    residual: float
    to_surface: float
    from_surface: float
    topology: Topology
    shape: Shape
    visited: int
    cells: int
    undecided: int
    hidden: int
    refined: int


@dataclass(frozen=True, slots=True)
class Account:
    """steps: from coarse to fine, the last is the mesh asked for; orders: of volume and area, None where they cannot be
    told."""

    size: float
    bodies: tuple[BodyAccount, ...]
    steps: tuple[Step, ...]
    volume_order: float | None
    area_order: float | None


def check_report(path: str | Path) -> None:
    """Refuses what could not be written. Raises FormatError, WriteError."""
    check_ending(path, "report", _ENDINGS)
    check_output(path)


def report_text(path: str | Path, account: Account) -> str:
    """The report for a file of this ending. Raises MissingError (a page without matplotlib)."""
    match Path(path).suffix.lower():
        case ".json":
            return json.dumps(asdict(account), indent=2) + "\n"
        case ".md":
            return _markdown(account)
        case _:
            return _page(account)


def account_of(scene: Scene, parts: list[Part], options: Options, seconds: float) -> Account:
    """Measures a mesh, and the coarser ones that tell how it converges. seconds: what the mesh took."""
    corners = np.concatenate([part.body.vertices for part in parts])
    size = float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))
    made = [_Made(options, parts, seconds), *_coarser(scene, options, max(part.cell for part in parts), size)]
    _time(scene, made)
    steps = [_step(scene, one.parts, one.seconds) for one in reversed(made)]
    return Account(
        size,
        tuple(_body(scene, part) for part in parts),
        tuple(steps),
        _order([step.volume for step in steps]),
        _order([step.area for step in steps]),
    )


@dataclass(slots=True)
class _Made:
    """A mesh, and the seconds that it took at least."""

    options: Options
    parts: list[Part]
    seconds: float


def _coarser(scene: Scene, options: Options, cell: float, size: float) -> list[_Made]:
    """Meshes with cells of twice the size, four times, …, as long as there are enough of them."""
    found: list[_Made] = []
    for i in range(1, _COARSER + 1):
        coarse = replace(options, cell=cell * 2**i, resolution=None, tolerance=None, adaptive=False, refine=0)
        if size < _FEWEST * cell * 2**i:
            break
        start = time.perf_counter()
        try:
            parts = _mesh(scene, coarse)
        except MeshError:
            break
        found.append(_Made(coarse, parts, time.perf_counter() - start))
    return found


def _mesh(scene: Scene, options: Options) -> list[Part]:
    return bodies(scene.ir, scene._native, options)  # pyright: ignore[reportPrivateUsage]


def _time(scene: Scene, made: list[_Made]) -> None:
    """Makes them again, by turns; not what took long, nor what was made in several attempts."""
    short = [one for one in made if one.seconds <= _LONG and one.options.tolerance is None]
    for _ in range(_REPEATS - 1):
        for one in short:
            start = time.perf_counter()
            _mesh(scene, one.options)
            one.seconds = min(one.seconds, time.perf_counter() - start)


def _threshold(scene: Scene, part: Part) -> float:
    return scene.surfaces[part.surface].threshold


def _step(scene: Scene, parts: list[Part], seconds: float) -> Step:
    shapes = [shape_of(part.body.vertices, part.body.triangles) for part in parts]
    return Step(
        cell=max(part.cell for part in parts),
        triangles=sum(len(part.body.triangles) for part in parts),
        to_surface=max(_to_surface(scene, part) for part in parts),
        from_surface=max(_from_surface(scene, part) for part in parts),
        volume=sum(shape.volume for shape in shapes),
        area=sum(shape.area for shape in shapes),
        seconds=seconds,
    )


def _to_surface(scene: Scene, part: Part) -> float:
    native = scene._native  # pyright: ignore[reportPrivateUsage]
    return distance_to_surface(part.body, native, part.surface, _threshold(scene, part))


def _from_surface(scene: Scene, part: Part) -> float:
    native = scene._native  # pyright: ignore[reportPrivateUsage]
    return distance_from_surface(part.body, native, part.surface)


def _body(scene: Scene, part: Part) -> BodyAccount:
    native = scene._native  # pyright: ignore[reportPrivateUsage]
    body, counts = part.body, part.body.counts
    return BodyAccount(
        name=part.name,
        vertices=len(body.vertices),
        triangles=len(body.triangles),
        residual=float(residual(body.vertices, native, part.surface, _threshold(scene, part)).max()),
        to_surface=_to_surface(scene, part),
        from_surface=_from_surface(scene, part),
        topology=topology(body.triangles, len(body.vertices)),
        shape=shape_of(body.vertices, body.triangles),
        visited=counts.visited,
        cells=counts.cells,
        undecided=counts.undecided,
        hidden=counts.hidden,
        refined=counts.refined,
    )


def _order(values: list[float]) -> float | None:
    """log2 of how much smaller a step changes a number than the step before it, each with cells of half the size. None
    where that is no order (yet): coarse meshes miss parts, and then far more, or less, changes than the order says."""
    if len(values) < 3:
        return None
    before, last = values[-2] - values[-3], values[-1] - values[-2]
    order = math.log2(before / last) if before * last > 0.0 else math.inf
    return order if _ORDERS[0] < order < _ORDERS[1] else None


# ---- as text -------------------------------------------------------------------------------------------

_BODY_ROWS: tuple[tuple[str, Callable[[BodyAccount], str]], ...] = (
    ("triangles", lambda b: f"{b.triangles:,}"),
    ("vertices", lambda b: f"{b.vertices:,}"),
    ("components", lambda b: f"{b.topology.components}"),
    ("Euler characteristic", lambda b: f"{b.topology.euler}"),
    ("boundary edges", lambda b: f"{b.topology.boundary}"),
    ("non-manifold edges", lambda b: f"{b.topology.nonmanifold}"),
    ("edges against the orientation", lambda b: f"{b.topology.misoriented}"),
    ("vertex residual", lambda b: f"{b.residual:.2g}"),
    ("mesh to surface, largest", lambda b: f"{b.to_surface:.3g}"),
    ("surface to mesh, largest", lambda b: f"{b.from_surface:.3g}"),
    ("volume", lambda b: f"{b.shape.volume:.8g}"),
    ("area", lambda b: f"{b.shape.area:.8g}"),
    ("smallest angle", lambda b: f"{b.shape.least_angle:.2g}°"),
    ("boxes visited", lambda b: f"{b.visited:,}"),
    ("cells not proved empty", lambda b: f"{b.cells:,}"),
    ("of those without a crossing", lambda b: f"{b.undecided:,}"),
    ("of those that may hide something", lambda b: f"{b.hidden:,}"),
    ("bricks of smaller cells", lambda b: f"{b.refined:,}"),
)

_STEP_COLUMNS: tuple[tuple[str, Callable[[Step], str]], ...] = (
    ("cell", lambda s: f"{s.cell:.3g}"),
    ("triangles", lambda s: f"{s.triangles:,}"),
    ("mesh to surface", lambda s: f"{s.to_surface:.3g}"),
    ("surface to mesh", lambda s: f"{s.from_surface:.3g}"),
    ("volume", lambda s: f"{s.volume:.7g}"),
    ("area", lambda s: f"{s.area:.7g}"),
    ("seconds", lambda s: f"{s.seconds:.3f}"),
)


def _tables(account: Account) -> list[tuple[str, list[list[str]]]]:
    """Titles and rows, the first row is the header."""
    head = ["", *(body.name for body in account.bodies)]
    bodies_rows = [head, *([name, *(tell(body) for body in account.bodies)] for name, tell in _BODY_ROWS)]
    step_rows = [[name for name, _ in _STEP_COLUMNS], *([t(step) for _, t in _STEP_COLUMNS] for step in account.steps)]
    return [("The mesh", bodies_rows), ("Error against run time", step_rows)]


def _orders(account: Account) -> str:
    told = [
        f"{what} of order {order:.2f}"
        for what, order in (("volume", account.volume_order), ("area", account.area_order))
        if order is not None
    ]
    if not told:
        return "Neither volume nor area has an order of convergence yet: coarser cells miss too much of the surface."
    return f"Convergence: {' and '.join(told)} in the size of the cells."


_NOTES = (
    "Lengths are in units of the script. Mesh to surface: from the middles of triangles and of their sides, along the"
    " gradient (Newton); surface to mesh: from first hits of random rays to the nearest triangle."
    " Vertices lie on the surface to rounding, so the distance is the bulge of the surface over each triangle."
)


def _markdown(account: Account) -> str:
    lines = ["# A mesh and its surface", ""]
    for title, rows in _tables(account):
        lines += [f"## {title}", "", "| " + " | ".join(rows[0]) + " |", "|" + "---|" * len(rows[0])]
        lines += ["| " + " | ".join(row) + " |" for row in rows[1:]] + [""]
    lines += [_orders(account), "", _NOTES, ""]
    return "\n".join(lines)


_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:52rem;margin:2rem auto;padding:0 1rem;color:#1a1a1a}"
    "table{border-collapse:collapse;margin:1rem 0}td,th{padding:.25rem .8rem;text-align:right;"
    "border-bottom:1px solid #d9dce0;font-variant-numeric:tabular-nums}td:first-child,th:first-child{text-align:left}"
    "svg{max-width:100%;height:auto}p{color:#5f6368}"
)


def _page(account: Account) -> str:
    from blobscript.plots.style import svg_text

    parts = [
        f"<!doctype html><html lang='en'><meta charset='utf-8'><title>A mesh and its surface</title><style>{_STYLE}"
    ]
    parts.append("</style><h1>A mesh and its surface</h1>")
    for title, rows in _tables(account):
        parts.append(f"<h2>{title}</h2>")
        if title == "Error against run time":
            drawing = svg_text(plot_convergence(account))
            parts.append(drawing[drawing.index("<svg") :])
        head, *body = rows
        parts.append("<table><tr>" + "".join(f"<th>{html.escape(cell)}</th>" for cell in head) + "</tr>")
        parts += ["<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in body]
        parts.append("</table>")
    parts.append(f"<p>{_orders(account)}</p><p>{_NOTES}</p></html>\n")
    return "".join(parts)


def plot_convergence(account: Account) -> Any:
    """Error against run time, and against the size of cells beside the slope of the second order: a figure."""
    from blobscript.plots.style import BLUE, MUTED, RED, new_figure, styled

    with styled():
        figure = new_figure(9.0, 3.9)
        timed, sized = figure.subplots(1, 2, sharey=True)
        for axes, place in ((timed, [s.seconds for s in account.steps]), (sized, [s.cell for s in account.steps])):
            for name, color, marker in (("to_surface", BLUE, "o"), ("from_surface", RED, "s")):
                words = {"to_surface": "mesh to surface", "from_surface": "surface to mesh"}[name]
                axes.loglog(place, [getattr(s, name) for s in account.steps], color=color, marker=marker, label=words)
        finest = account.steps[-1]
        cells = np.array([step.cell for step in account.steps])
        sized.loglog(cells, finest.to_surface * (cells / finest.cell) ** 2, color=MUTED, ls=":", lw=1, label="order 2")
        _mark(timed, sized, cells)
        timed.set(xlabel="seconds", ylabel="largest distance", title="Error against run time")
        sized.set(xlabel="size of cells", title="Error against the size of cells")
        sized.legend()
    return figure


def _mark(timed: Any, sized: Any, cells: NDArray[np.float64]) -> None:
    """Round numbers of seconds; the sizes of cells themselves."""
    from matplotlib.ticker import FixedLocator, LogLocator, NullLocator, StrMethodFormatter

    timed.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    timed.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    sized.xaxis.set_major_locator(FixedLocator(cells.tolist()))
    sized.xaxis.set_major_formatter(StrMethodFormatter("{x:.3g}"))
    for axes in (timed, sized):
        axes.xaxis.set_minor_locator(NullLocator())
