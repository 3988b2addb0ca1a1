"""The names of what a scene needs, each with the place in the script that causes it.

The vocabulary of `Scene.needs`, of `info --needs`, and of the parts of the tracer that an emitted C scene
contains. What every scene needs (sums, a camera, a background) has no name.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blobscript import ir
from blobscript.ir import leaves
from blobscript.needs.looks import is_painted
from blobscript.source import Span

__all__ = ["Need", "needs_of"]


@dataclass(frozen=True, slots=True)
class Need:
    """name: as in `Scene.needs`. meaning: in words. span: the first place that causes it; None: a default. count: how
    many blobs, nodes, materials or lights ask for it."""

    name: str
    meaning: str
    span: Span | None
    count: int = 1


#: Name -> what it is, in the order of a listing.
MEANINGS: dict[str, str] = {
    "kernel-soft2": "the kernel soft2, (1 - r^2)^2",
    "kernel-soft3": "the kernel soft3, (1 - r^2)^3",
    "kernel-wyvill": "the kernel wyvill",
    "kernel-gauss": "the Gaussian",
    "kernel-gauss_c1": "the Gaussian with an end",
    "kernel-metaball": "the kernel metaball",
    "kernel-user": "kernels of the script, as polynomials",
    "points": "distances to points",
    "lines": "distances to lines",
    "triangles": "distances to triangles",
    "meshes": "nearest points of meshes, with a tree of their triangles",
    "solids": "the inside of solids",
    "maps": "transformed fields: rays are mapped to the space of a skeleton",
    "negative-weights": "blobs that take away",
    "max": "the larger of densities",
    "min": "the smaller of densities",
    "smooth_max": "the smooth maximum of densities",
    "smooth_min": "the smooth minimum of densities below 0",
    "several-surfaces": "more than one surface: the nearest hit wins",
    "paint": "several materials on one surface, blended",
    "reflection": "mirror images",
    "refraction": "light that goes through",
    "absorption": "colour that grows with the way through",
    "emission": "surfaces that shine by themselves",
    "suns": "parallel light",
    "lamps": "light from a place",
    "shadows": "shadow rays",
    "background-gradient": "the default background",
    "index": "a tree of boxes around the blobs",
}

#: Fewer blobs than this need no tree of boxes: looking at all of them is as quick.
FEW_BLOBS = 32

_Found = dict[str, tuple["Span | None", int]]


def needs_of(scene: ir.Scene) -> tuple[Need, ...]:
    """What a (trimmed) scene needs, in the order of MEANINGS."""
    found: _Found = {}
    shown = [surface for surface in scene.surfaces if any(True for _ in leaves(surface.field))]
    for surface in shown:
        _field(surface.field, scene.spans, found)
        _look(surface, scene, found)
    if len(shown) > 1:
        found["several-surfaces"] = (shown[1].span, len(shown))
    for light in scene.lights:
        _note(found, "suns" if isinstance(light, ir.Sun) else "lamps", light.span)
        _note(found, "shadows", light.span)
    if scene.background.default:
        _note(found, "background-gradient", None)
    most = max((sum(leaf.count for leaf in leaves(s.field)) for s in shown), default=0)
    if most > FEW_BLOBS:
        found["index"] = (shown[0].span, most)
    return tuple(Need(name, MEANINGS[name], *found[name]) for name in MEANINGS if name in found)


def _note(found: _Found, name: str, span: Span | None, count: int = 1) -> None:
    before = found.get(name)
    found[name] = (span if before is None else before[0], count + (0 if before is None else before[1]))


def _field(tree: ir.Field, spans: tuple[Span, ...], found: _Found) -> None:
    stack = [tree]
    while stack:
        top = stack.pop()
        if isinstance(top, ir.Node):
            stack.extend(reversed(top.children))
            if top.op != "sum":
                _note(found, top.op, _first_span(top, spans))
            continue
        _leaf(top, spans, found)


def _first_span(tree: ir.Field, spans: tuple[Span, ...]) -> Span | None:
    return next((_span(leaf, spans) for leaf in leaves(tree)), None)


def _span(leaf: ir.Leaf, spans: tuple[Span, ...], row: int = 0) -> Span | None:
    origin = int(leaf.origin[row])
    return spans[origin] if 0 <= origin < len(spans) else None


def _leaf(leaf: ir.Leaf, spans: tuple[Span, ...], found: _Found) -> None:
    span, n = _span(leaf, spans), leaf.count
    _note(found, "kernel-user" if leaf.kernel.pieces else f"kernel-{leaf.kernel.name}", span, n)
    for name in _skeleton(leaf.skeleton):
        _note(found, name, span, n)
    if leaf.matrix is not None:
        _note(found, "maps", span, n)
    negative = np.flatnonzero(leaf.weight < 0.0)
    if len(negative):
        _note(found, "negative-weights", _span(leaf, spans, int(negative[0])), len(negative))


def _skeleton(skeleton: ir.Skeleton) -> tuple[str, ...]:
    match skeleton:
        case ir.Points():
            return ("points",)
        case ir.Lines() | ir.Polyline():
            return ("lines",)
        case ir.Polygon():
            return ("triangles",)
        case ir.Polyhedron():
            return "meshes", "solids"
        case ir.Mesh(solid=solid):
            return ("meshes", "solids") if solid else ("meshes",)


def _look(surface: ir.Surface, scene: ir.Scene, found: _Found) -> None:
    if is_painted(surface):
        painted = next(leaf for leaf in leaves(surface.field) if (leaf.paint >= 0).any())
        _note(found, "paint", _span(painted, scene.spans, int(np.argmax(painted.paint >= 0))))
    worn: dict[int, Span | None] = {}
    for leaf in leaves(surface.field):
        for paint in np.unique(leaf.paint).tolist():
            worn.setdefault(paint, _span(leaf, scene.spans, int(np.argmax(leaf.paint == paint))))
    for paint in sorted(worn):  # -1, the surface's own, comes first
        material = scene.materials[paint if paint >= 0 else surface.material]
        for name in _material(material):
            if name not in found:
                _note(found, name, surface.span if paint < 0 else worn[paint])


def _material(m: ir.Material) -> list[str]:
    asks = {
        "reflection": m.reflection > 0.0 or m.metalness > 0.0 or m.transmission > 0.0,
        "refraction": m.transmission > 0.0,
        "absorption": m.transmission > 0.0 and any(m.absorption),
        "emission": any(m.emission),
    }
    return [name for name, needed in asks.items() if needed]
