"""A scene without what cannot matter: the pass from `ir.Scene` to `ir.Scene` before every back end.

Definitions that nothing reaches and terms of weight 0 never get into a scene. Here go: blobs that repeat others
(`fold`), blobs that cannot touch a surface, proved by bounds (`reach`), materials and lights that nothing shows
(`looks`), and with the blobs their kernels. Surfaces keep their numbers, so one without blobs stays as an empty one.
First hits stay what they are within the conditioned error; the field elsewhere does not.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

from blobscript import ir
from blobscript.ir import leaves
from blobscript.needs.fold import folded
from blobscript.needs.looks import is_painted, needed_lights, needed_materials
from blobscript.needs.reach import idle
from blobscript.needs.tree import kept
from blobscript.source import Span

__all__ = ["LeftOut", "Trimmed", "trimmed"]


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Something that a scene has and does not need. what: a name in the plural; span: a place in a script that made
    some of it, where that is known."""

    what: str
    count: int
    why: str
    span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Trimmed:
    """What is left (the scene itself where all of it is needed), and what is not."""

    scene: ir.Scene
    left_out: tuple[LeftOut, ...]


def trimmed(scene: ir.Scene) -> Trimmed:
    """The scene without what cannot change any first hit or any light on it."""
    surfaces = tuple(_surface(surface) for surface in scene.surfaces)
    less = needed_materials(replace(scene, surfaces=surfaces))
    less = replace(less, lights=needed_lights(less))
    same = all(new is old for new, old in zip(less.surfaces, scene.surfaces, strict=True))
    if same and len(less.materials) == len(scene.materials) and len(less.lights) == len(scene.lights):
        return Trimmed(scene, ())
    return Trimmed(less, tuple(_left_out(scene, surfaces, less)))


def _surface(surface: ir.Surface) -> ir.Surface:
    tree = folded(surface.field, is_painted(surface))
    once = surface if tree is surface.field else replace(surface, field=tree)
    masks = idle(once)
    return once if masks is None else replace(once, field=kept(once.field, masks))


# ---- what to say about it ------------------------------------------------------------------------------


def _left_out(scene: ir.Scene, surfaces: tuple[ir.Surface, ...], less: ir.Scene) -> list[LeftOut]:
    found: list[LeftOut] = []
    for before, after in zip(scene.surfaces, surfaces, strict=True):
        found += _blobs(before, after, scene.spans)
    found += _fewer("materials", "nothing wears them", len(scene.materials) - len(less.materials))
    found += _fewer("kernels", "no blob that matters has them", len(_kernels(scene)) - len(_kernels(less)))
    found += _fewer("lights", "they light nothing, or are one with another", len(scene.lights) - len(less.lights))
    return found


def _fewer(what: str, why: str, count: int) -> list[LeftOut]:
    return [LeftOut(what, count, why)] if count else []


def _kernels(scene: ir.Scene) -> set[ir.Kernel]:
    return {leaf.kernel for surface in scene.surfaces for leaf in leaves(surface.field)}


def _blobs(before: ir.Surface, after: ir.Surface, spans: tuple[Span, ...]) -> list[LeftOut]:
    """Blobs that went, one entry for each place in the script."""
    repeats = folded(before.field, is_painted(before))
    once, twice, last = (_origins(tree) for tree in (before.field, repeats, after.field))
    reasons = ((once - twice, "they repeat others"), (twice - last, "they touch no surface"))
    return [
        LeftOut("blobs", count, why, spans[origin] if 0 <= origin < len(spans) else None)
        for counts, why in reasons
        for origin, count in sorted(counts.items())
    ]


def _origins(tree: ir.Field) -> Counter[int]:
    return Counter(origin for leaf in leaves(tree) for origin in leaf.origin.tolist())
