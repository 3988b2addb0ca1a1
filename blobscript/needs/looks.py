"""Materials and lights that nothing shows.

A material that no blob and no surface wears is gone; a floor that only catches shadows shows none. Paint that says
what the surface says anyway is gone, too. A light without strength lights nothing, nor does a lamp within the only
surface, where that lets no light through; lights that differ in colour alone are one of their joint colour.
"""

from __future__ import annotations

import bisect
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blobscript import field, ir
from blobscript.ir import leaves
from blobscript.needs.tree import mapped

__all__ = ["is_painted", "needed_lights", "needed_materials"]


# ---- materials ---------------------------------------------------------------------------------------


def is_painted(surface: ir.Surface) -> bool:
    """Does any blob wear another material than its surface?"""
    return any(((leaf.paint >= 0) & (leaf.paint != surface.material)).any() for leaf in leaves(surface.field))


def needed_materials(scene: ir.Scene) -> ir.Scene:
    """The scene with the materials alone that something wears, in their old order."""
    plain = tuple(_plainly_painted(surface) for surface in scene.surfaces)
    used = {number for surface in plain for number in _worn(surface)}
    floor = scene.floor
    if floor is not None and not floor.catch:
        used.add(floor.material)
    kept = sorted(used) or [plain[0].material]
    if floor is not None and floor.catch:
        floor = _caught_by_any(floor, scene.materials, kept)
    if len(kept) == len(scene.materials):
        return replace(scene, surfaces=plain)
    numbers = np.full(len(scene.materials) + 1, -1, dtype=np.int32)  # paint -1, the surface's own, stays -1
    numbers[kept] = np.arange(len(kept), dtype=np.int32)
    surfaces = tuple(_renumbered(surface, numbers) for surface in plain)
    less = replace(scene, surfaces=surfaces, materials=tuple(scene.materials[i] for i in kept))
    return replace(less, floor=replace(floor, material=int(numbers[floor.material]))) if floor is not None else less


def _caught_by_any(floor: ir.Floor, materials: tuple[ir.Material, ...], kept: list[int]) -> ir.Floor:
    """What only catches shadows shows no material: any without bumps, which would tilt it. Else its own is kept."""
    material = next((number for number in kept if materials[number].texture is None), floor.material)
    if material not in kept:
        bisect.insort(kept, material)
    return replace(floor, material=material)


def _worn(surface: ir.Surface) -> set[int]:
    """An empty surface wears nothing."""
    worn: set[int] = set()
    for leaf in leaves(surface.field):
        seen = _is_seen(surface, leaf)
        worn.update(np.where(leaf.paint < 0, surface.material, leaf.paint)[seen].tolist())
    return worn


def _is_seen(surface: ir.Surface, leaf: ir.Leaf) -> NDArray[np.bool_]:
    """Which blobs may show their material: what takes away never does, where something is above a positive
    threshold. (A kernel of the script may be below 0 itself.)"""
    return (leaf.weight > 0.0) | (surface.threshold <= 0.0) | bool(leaf.kernel.pieces)


def _plainly_painted(surface: ir.Surface) -> ir.Surface:
    """Where all blobs wear one material it is the surface's, and no paint is left; -1 instead of the surface's own.
    (With a threshold that is not positive the surface is there without blobs, in its own material.)"""
    worn = _worn(surface)
    material = next(iter(worn)) if len(worn) == 1 and surface.threshold > 0.0 else surface.material

    def plain(leaf: ir.Leaf) -> ir.Leaf:
        paint = np.where(leaf.paint < 0, surface.material, leaf.paint).astype(np.int32)
        paint[(paint == material) | ~_is_seen(surface, leaf)] = -1
        return leaf if np.array_equal(paint, leaf.paint) else replace(leaf, paint=paint)

    changed = mapped(surface.field, plain)
    if material == surface.material and changed is surface.field:
        return surface
    return replace(surface, field=changed, material=material)


def _renumbered(surface: ir.Surface, numbers: NDArray[np.int32]) -> ir.Surface:
    def change(leaf: ir.Leaf) -> ir.Leaf:
        return replace(leaf, paint=numbers[leaf.paint]) if (leaf.paint >= 0).any() else leaf

    material = max(int(numbers[surface.material]), 0)
    return replace(surface, field=mapped(surface.field, change), material=material)


# ---- lights ----------------------------------------------------------------------------------------


def needed_lights(scene: ir.Scene) -> tuple[ir.Light, ...]:
    """The lights that may reach a point of a surface, equal ones as one."""
    shown = [surface for surface in scene.surfaces if any(True for _ in leaves(surface.field))]
    lights: list[ir.Light] = []
    for light in scene.lights:
        if not any(light.color) or not (shown or scene.floor) or _is_buried(light, shown, scene):
            continue
        same = next((i for i, other in enumerate(lights) if _but_for_color(other) == _but_for_color(light)), None)
        if same is None:
            lights.append(light)
        else:
            r, g, b = (x + y for x, y in zip(lights[same].color, light.color, strict=True))
            lights[same] = replace(lights[same], color=(r, g, b))
    return tuple(lights) if len(lights) < len(scene.lights) else scene.lights


def _but_for_color(light: ir.Light) -> ir.Light:
    return replace(light, color=(0.0, 0.0, 0.0))


def _is_buried(light: ir.Light, shown: list[ir.Surface], scene: ir.Scene) -> bool:
    """Is it a lamp proved to lie within the only surface, whose materials let no light through, seen from outside?"""
    if not isinstance(light, ir.Lamp) or light.size > 0.0 or len(shown) != 1:
        return False
    if any(m.transmission or m.texture for m in scene.materials):
        return False
    surface, at, eye = shown[0], np.array([light.at]), np.array([scene.camera.at])
    if surface.threshold <= 0.0 or field.field_value(surface.field, eye)[0] >= surface.threshold:
        return False
    return bool(field.bounds(surface.field, at, at)[0][0] > surface.threshold * (1.0 + 1e-6))
