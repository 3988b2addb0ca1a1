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
from blobscript.texture import COLUMNS

__all__ = ["MANY_SAMPLES", "Need", "needs_of"]


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
    "textures": "materials that depend on the place",
    "bumps": "heights over a surface that tilt its normals",
    "suns": "parallel light",
    "lamps": "light from a place",
    "shadows": "shadow rays",
    "soft-shadows": "lights with a size, by many samples",
    "background-gradient": "the default background",
    "sky": "a sky of three colours, seen and as light",
    "environment": "a picture of all directions, seen and as light",
    "floor": "a plane below",
    "shadow-catcher": "a plane of which only its shadows are seen",
    "fading": "a plane that passes into the background",
    "fog": "fog",
    "lens": "a lens that is sharp at one distance, by many samples",
    "film-tone": "bright light compressed as by film",
    "exposure": "an exposure other than 0",
    "index": "a tree of boxes around the blobs",
}

#: Fewer blobs than this need no tree of boxes: looking at all of them is as quick.
FEW_BLOBS = 32

#: What shows only with several samples a pixel: with one, lights are points and everything is sharp.
MANY_SAMPLES = frozenset({"soft-shadows", "lens"})

_Found = dict[str, tuple["Span | None", int]]


def needs_of(scene: ir.Scene) -> tuple[Need, ...]:
    """What a (trimmed) scene needs, in the order of MEANINGS."""
    found: _Found = {}
    shown = [surface for surface in scene.surfaces if any(True for _ in leaves(surface.field))]
    for surface in shown:
        _field(surface.field, scene.spans, found)
        _paint(surface, scene.spans, found)
    _materials(scene, shown, found)
    if len(shown) > 1:
        found["several-surfaces"] = (shown[1].span, len(shown))
    _lights(scene.lights, found)
    _around(scene, found)
    counts = [sum(leaf.count for leaf in leaves(surface.field)) for surface in shown]
    if sum(counts) > FEW_BLOBS:
        found["index"] = (shown[int(np.argmax(counts))].span, sum(counts))
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


# ---- materials -----------------------------------------------------------------------------------------


def _paint(surface: ir.Surface, spans: tuple[Span, ...], found: _Found) -> None:
    if is_painted(surface):
        painted = next(leaf for leaf in leaves(surface.field) if (leaf.paint >= 0).any())
        _note(found, "paint", _span(painted, spans, int(np.argmax(painted.paint >= 0))))


def _materials(scene: ir.Scene, shown: list[ir.Surface], found: _Found) -> None:
    """What each material asks for, at the first place that wears it."""
    worn: dict[int, Span | None] = {}
    for surface in shown:
        _wear(surface, scene.spans, worn)
    if scene.floor is not None and not scene.floor.catch:
        worn.setdefault(scene.floor.material, scene.floor.span)
    for number, span in worn.items():
        for name in _material(scene.materials[number]):
            _note(found, name, span)


def _wear(surface: ir.Surface, spans: tuple[Span, ...], worn: dict[int, Span | None]) -> None:
    """Adds number of a material -> who wears it, the surface's own before paints."""
    if any((leaf.paint < 0).any() for leaf in leaves(surface.field)):
        worn.setdefault(surface.material, surface.span)
    for leaf in leaves(surface.field):
        for paint in np.unique(leaf.paint[leaf.paint >= 0]).tolist():
            worn.setdefault(paint, _span(leaf, spans, int(np.argmax(leaf.paint == paint))))


def _material(m: ir.Material) -> list[str]:
    places = {column for column, _ in m.texture.outputs} if m.texture else set[int]()

    def varies(name: str) -> bool:
        """Does it depend on the place?"""
        return not places.isdisjoint(COLUMNS[name])

    asks = {
        "reflection": m.reflection > 0.0 or m.metalness > 0.0 or m.transmission > 0.0 or varies("metalness"),
        "refraction": m.transmission > 0.0,
        "absorption": m.transmission > 0.0 and any(m.absorption),
        "emission": any(m.emission) or varies("emission"),
        "textures": bool(places - set(COLUMNS["bump"])),
        "bumps": varies("bump"),
    }
    return [name for name, needed in asks.items() if needed]


# ---- lights and what stands around -----------------------------------------------------------------------


def _lights(lights: tuple[ir.Light, ...], found: _Found) -> None:
    for light in lights:
        _note(found, "suns" if isinstance(light, ir.Sun) else "lamps", light.span)
        _note(found, "shadows", light.span)
        if (light.angle if isinstance(light, ir.Sun) else light.size) > 0.0:
            _note(found, "soft-shadows", light.span)


def _around(scene: ir.Scene, found: _Found) -> None:
    """Background, floor, fog, lens and tone."""
    background, floor, fog, camera, tone = scene.background, scene.floor, scene.fog, scene.camera, scene.tone
    asks = {
        "background-gradient": (background, background.default),
        "sky": (background, isinstance(background.light, ir.Sky)),
        "environment": (background, isinstance(background.light, ir.Environment)),
        "floor": (floor, floor is not None),
        "shadow-catcher": (floor, floor is not None and floor.catch),
        "fading": (floor, floor is not None and floor.fade > 0.0),
        "fog": (fog, fog is not None),
        "lens": (camera, camera.aperture > 0.0),
        "film-tone": (tone, tone.curve == "film"),
        "exposure": (tone, tone.exposure != 0.0),
    }
    for name, (part, needed) in asks.items():
        if part is not None and needed:
            _note(found, name, part.span)
