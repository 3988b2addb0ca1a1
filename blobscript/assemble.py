"""From placed values to the scene: everything that depends on what stands around a value.

Each surface's field is flattened (`flatten`), solved with its threshold and merged into leaves
(`leaves`); materials are gathered into one table; what the script leaves out is filled in (camera,
lights, background); then `warnings` looks for what would give an empty or puzzling picture.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from blobscript import framing, ir, values, warnings
from blobscript.diagnostics import Diagnostic, Help, Label, has_errors
from blobscript.field import forget
from blobscript.flatten import TooBigError, flatten
from blobscript.gather import Misfit
from blobscript.leaves import build_field
from blobscript.solve import explain_problem
from blobscript.source import Source, Span

__all__ = [
    "DEFAULT_BACKGROUND",
    "DEFAULT_KERNEL",
    "DEFAULT_LIGHTS",
    "Placed",
    "Unplaced",
    "assemble",
    "lower_surface",
    "misfits",
]

T = TypeVar("T")

DEFAULT_KERNEL = ir.Kernel("wyvill")

#: A warm key light from the upper left front, a cool soft fill from the right, a rim light from behind.
DEFAULT_LIGHTS: tuple[ir.Light, ...] = (
    ir.Sun((0.8, -0.8, -0.45), (3.1, 2.95, 2.7)),
    ir.Sun((-0.9, -0.05, -0.5), (0.32, 0.38, 0.5)),
    ir.Sun((-0.45, -0.6, 0.75), (0.8, 0.82, 0.86)),
)
#: The colour is that of the gradient's middle; the gradient itself belongs to the picture.
DEFAULT_BACKGROUND = ir.Background((0.72, 0.76, 0.82), default=True)

#: A value on a line of its own, its `let` name, and where it stands.
Placed = tuple[object, "str | None", "Span | None"]
#: A scene value that was defined but not placed: its name, what it is, and where it is named.
Unplaced = tuple[str, str, Span]

_MOST_REPORTS = 20


@dataclass(slots=True, eq=False)
class _Materials:
    """The table of materials, each once."""

    rows: list[ir.Material] = field(default_factory=list[ir.Material])
    numbers: dict[ir.Material, int] = field(default_factory=dict[ir.Material, int])

    def number(self, look: ir.Material) -> int:
        found = self.numbers.get(look)
        if found is None:
            found = self.numbers[look] = len(self.rows)
            self.rows.append(look)
        return found


class _Painter:
    """Numbers of the paints in one surface; -1 is the surface's own material."""

    def __init__(self, materials: _Materials, own: values.Material) -> None:
        self._materials = materials
        self._own = own
        self.number = materials.number(own.look)
        self._known: dict[int, int] = {}
        self._keep: list[object] = []  # keeps the ids in `_known` valid

    def __call__(self, paint: values.Paint | tuple[values.Paint, ...] | None) -> int | NDArray[np.int32]:
        if paint is None:
            return -1
        if type(paint) is tuple:
            return np.array([self(p) for p in paint], dtype=np.int32)
        found = self._known.get(id(paint))
        if found is None:
            assert isinstance(paint, (values.Color, values.Material))
            look = self._own.tinted(paint) if isinstance(paint, values.Color) else paint
            found = self._materials.number(look.look)
            found = self._known[id(paint)] = -1 if found == self.number else found
            self._keep.append(paint)
        return found


# ---- surfaces ------------------------------------------------------------------------


def lower_surface(
    surface: values.Surface,
    name: str,
    materials: _Materials | None = None,
    spans: Sequence[Span] = (),
    limit: int = 2_000_000,
) -> tuple[ir.Surface, list[Diagnostic]]:
    """One surface with its field solved; also for queries about a surface that is not placed."""
    paint = _Painter(materials or _Materials(), surface.material.moved(surface.matrix))
    try:
        group, idle = flatten(surface.field, surface.matrix, surface.kernel or DEFAULT_KERNEL, limit)
    except TooBigError as error:
        span = spans[error.origin] if 0 <= error.origin < len(spans) else surface.span
        nothing = ir.Surface(name, ir.Node("sum", ()), surface.threshold, paint.number, surface.span)
        return nothing, [Diagnostic("E0901", error.message, span, "too many from here on")]
    tree, misfits, more_idle = build_field(group, surface.threshold, paint)
    result = ir.Surface(name, tree, float(surface.threshold), paint.number, surface.span)
    found = [*_report_misfits(misfits, surface, spans), *warnings.without_effect(idle + more_idle, spans)]
    return result, found


def _report_misfits(misfits: list[Misfit], surface: values.Surface, spans: Sequence[Span]) -> list[Diagnostic]:
    """One report for each place in the script and kind of problem."""
    first: dict[tuple[int, int], Misfit] = {}
    for misfit in misfits:
        first.setdefault((misfit.origin, misfit.problem), misfit)
    result: list[Diagnostic] = []
    for misfit in list(first.values())[:_MOST_REPORTS]:
        message, label, helps = explain_problem(
            misfit.problem, misfit.kernel, surface.threshold, misfit.radius, misfit.reach, misfit.weight
        )
        span = spans[misfit.origin] if 0 <= misfit.origin < len(spans) else surface.span
        place = surface.span
        labels = (Label(place, f"in this surface, with threshold {surface.threshold:g}"),) if place else ()
        result.append(Diagnostic("E0406", message, span, label, labels, helps))
    return result


def misfits(placed: Sequence[Placed], context: values.Context) -> list[Diagnostic]:
    """What is wrong (E0406) with the surfaces that were placed, where something else went wrong, too."""
    surfaces = [value for value, _, _ in _flat(placed) if isinstance(value, values.Surface)]
    found = [one for surface in surfaces[:_MOST_REPORTS] for one in lower_surface(surface, "", None, context.spans)[1]]
    return [one for one in found if one.code == "E0406"]


# ---- the rest of the scene -----------------------------------------------------------


def _flat(placed: Iterable[Placed]) -> Iterable[Placed]:
    """Lists of items count as their items."""
    for value, name, span in placed:
        if isinstance(value, list):
            items = cast("list[Any]", value)
            yield from _flat((item, name, span) for item in items)
        else:
            yield value, name, span


_WORDS: dict[type, str] = {values.Floor: "floor", ir.Fog: "fog", ir.Tone: "tone"}


def _only(items: list[Placed], kind: type[T], found: list[Diagnostic]) -> T | None:
    """The scene's one item of a kind."""
    mine = [(value, span) for value, _, span in items if isinstance(value, kind)]
    for _, span in mine[1:]:
        word = _WORDS.get(kind) or values.kind_name(mine[0][0])
        first = mine[0][1]
        labels = (Label(first, "the first one"),) if first else ()
        article = "an" if word in ("image", "animate") else "a"
        found.append(
            Diagnostic(
                "E0402",
                f"there is {article} {word} already: a scene has one",
                span,
                "the second one",
                labels,
                (Help("keep one of them; `if` can choose"),),
            )
        )
    return mine[0][0] if mine else None


def _no_surface(source: Source | None, items: list[Placed], unplaced: Sequence[Unplaced]) -> Diagnostic:
    span = items[-1][2] if items else Span(source, len(source.text), len(source.text)) if source else None
    aside = [name for name, kind, _ in unplaced if kind == "surface"]
    help_text = (
        f"`{aside[0]}` is defined; write its name on a line of its own to place it"
        if aside
        else "write for example: surface(threshold = 0.5) { ball(radius = 1) }"
    )
    return Diagnostic("E0401", "this scene has no surface, so there is nothing to see", span, helps=(Help(help_text),))


def assemble(
    placed: Sequence[Placed],
    context: values.Context,
    *,
    source: Source | None = None,
    params: tuple[ir.ParamInfo, ...] = (),
    unplaced: Sequence[Unplaced] = (),
    sources: Sequence[tuple[str, str]] = (),
    limit: int = 2_000_000,
) -> tuple[ir.Scene | None, list[Diagnostic]]:
    """The scene of all placed values, with errors and warnings; None if there are errors.

    `unplaced`: scene values that the main script defines and never uses; `sources`: the scripts
    that were read (data files come from the context); `limit`: most parts of a surface.
    """
    items = list(_flat(placed))
    found: list[Diagnostic] = []
    materials = _Materials()
    surfaces: list[ir.Surface] = []
    thresholds: list[Span | None] = []
    for value, name, span in items:
        if isinstance(value, values.Surface):
            title = name or f"surface {len(surfaces) + 1}"
            surface, problems = lower_surface(value, title, materials, context.spans, limit)
            surfaces.append(surface if surface.span else _with_span(surface, span))
            thresholds.append(value.threshold_span)
            found += problems
    camera = _only(items, values.Camera, found)
    background = _only(items, values.Background, found)
    floor = _only(items, values.Floor, found)
    fog = _only(items, ir.Fog, found)
    tone = _only(items, ir.Tone, found)
    image = _only(items, values.Image, found) or values.Image(640, 480)
    animate = _only(items, values.Animate, found)
    if not surfaces:
        found.append(_no_surface(source, items, unplaced))
    if has_errors(found):
        return None, found
    extents = framing.Extents(surfaces)
    plane = _floor(floor, materials, _place(floor, items)) if floor else None
    scene = ir.Scene(
        tuple(surfaces),
        tuple(materials.rows),
        _camera(camera) if camera else framing.default_camera(extents.boxes(), image.width / image.height),
        tuple(_lights(items)) or (() if background and background.light else DEFAULT_LIGHTS),
        _background(background, _place(background, items)) if background else DEFAULT_BACKGROUND,
        image.width,
        image.height,
        ir.Animate(animate.seconds, animate.fps) if animate else None,
        params,
        tuple(context.spans),
        (*sources, *context.sources),
        plane,
        replace(fog, span=_place(fog, items)) if fog else None,
        replace(tone, span=_place(tone, items)) if tone else ir.Tone(),
    )
    found += warnings.scene_warnings(scene, extents, thresholds, unplaced)
    forget()  # the questions above are answered; a million points need the room
    # a surface in a loop has its say once
    return scene, list(dict.fromkeys(found))


def _place(value: object, items: list[Placed]) -> Span | None:
    """Where a value is placed first."""
    return next((span for item, _, span in items if item is value), None)


def _with_span(surface: ir.Surface, span: Span | None) -> ir.Surface:
    return ir.Surface(surface.name, surface.field, surface.threshold, surface.material, span)


def _lights(items: list[Placed]) -> Iterator[ir.Light]:
    for value, _, span in items:
        if isinstance(value, values.Sun):
            yield ir.Sun(value.toward, value.color, value.angle, span)
        elif isinstance(value, values.Lamp):
            yield ir.Lamp(value.at, value.color, value.size, span)


def _camera(camera: values.Camera) -> ir.Camera:
    return ir.Camera(camera.at, camera.to, camera.up, camera.fov, camera.span, camera.aperture, camera.focus)


def _background(background: values.Background, span: Span | None) -> ir.Background:
    return ir.Background(background.color, False, background.light, background.shown, span)


def _floor(floor: values.Floor, materials: _Materials, span: Span | None) -> ir.Floor:
    return ir.Floor(floor.height, materials.number(floor.material.look), floor.catch, floor.fade, span)
