"""Lengths that suit POV-Ray: the scene magnified by a power of ten.

POV-Ray has absolute tolerances. A blob is not seen nearer than 0.01 to where a ray starts, shadows start 0.001 off,
components of a radius of 1e-4 and less are solved badly, and nothing farther away than 1e7 is seen at all. So the
smallest blob should have a reach of some hundred, and the whole scene fewer than a million.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from blobscript import field, ir
from blobscript.enclosure import Box
from blobscript.povray.forms import leaves

__all__ = ["magnified", "scene_box", "unit_for"]

#: Reach that the smallest blob gets, and the extent that the whole scene must not pass.
_SMALLEST, _LARGEST = 100.0, 1e6


def unit_for(scene: ir.Scene, camera: ir.Camera) -> float:
    """A power of ten: one unit of the script in POV-Ray."""
    found = [leaf for surface in scene.surfaces for leaf in leaves(surface.field)]
    if not found:
        return 1.0
    lo, hi = scene_box(scene)
    far = float(np.max(np.abs(np.stack([lo, hi, np.array(camera.at)]))))
    smallest = min(float(leaf.reach.min()) / _stretch(leaf) for leaf in found)
    wanted = math.ceil(math.log10(_SMALLEST / smallest) - 1e-9)
    allowed = math.floor(math.log10(_LARGEST / max(far, 1e-300)) + 1e-9)
    return 10.0 ** max(-300, min(wanted, allowed, 300))


def _stretch(leaf: ir.Leaf) -> float:
    """How much the map to skeleton space may lengthen."""
    return 1.0 if leaf.matrix is None else float(np.linalg.norm(leaf.matrix[:, :3], 2))


def scene_box(scene: ir.Scene) -> Box:
    boxes = [field.extent(surface.field) for surface in scene.surfaces]
    return np.min([lo for lo, _ in boxes], axis=0), np.max([hi for _, hi in boxes], axis=0)


def magnified(scene: ir.Scene, unit: float) -> ir.Scene:
    """All lengths times `unit`."""
    surfaces = tuple(replace(surface, field=_field(surface.field, unit)) for surface in scene.surfaces)
    return replace(scene, surfaces=surfaces)


def _field(tree: ir.Field, unit: float) -> ir.Field:
    if isinstance(tree, ir.Node):
        return replace(tree, children=tuple(_field(child, unit) for child in tree.children))
    matrix = tree.matrix
    if matrix is not None:
        matrix = np.column_stack([matrix[:, :3], matrix[:, 3] * unit])
    return replace(tree, skeleton=_skeleton(tree.skeleton, unit), reach=tree.reach * unit, matrix=matrix)


def _skeleton(skeleton: ir.Skeleton, unit: float) -> ir.Skeleton:
    match skeleton:
        case ir.Points(at):
            return ir.Points(at * unit)
        case ir.Lines(a, b):
            return ir.Lines(a * unit, b * unit)
        case ir.Polyline() | ir.Polygon() | ir.Polyhedron() | ir.Mesh():
            return replace(skeleton, points=skeleton.points * unit)
