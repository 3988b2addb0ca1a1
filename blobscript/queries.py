"""Questions that a script may ask about a surface while it is evaluated."""

from __future__ import annotations

from typing import Any

import numpy as np

from blobscript import enclosure, field, ir
from blobscript.arguments import vector
from blobscript.diagnostics import has_errors
from blobscript.values import Context, MakerError, Surface, Vec3

__all__ = ["bounds", "field_at", "inside"]


def _lowered(ctx: Context, surface: Surface) -> ir.Surface:
    """The surface with its field solved, remembered while the script runs."""
    from blobscript.assemble import lower_surface  # assemble stands above the makers

    known = ctx.memory.get(id(surface))
    if known is None:
        result, found = lower_surface(surface, "surface", spans=ctx.spans)
        if has_errors(found):
            first = next(d for d in found if d.severity == "error")
            raise MakerError(first.code, first.message, "surface", first.label, first.helps)
        known = ctx.memory[id(surface)] = (surface, result)
    return known[1]


def field_at(ctx: Context, surface: Surface, at: Vec3) -> float:
    """The combined density at a point."""
    points = np.array([vector(at, "at")])
    return float(field.field_value(_lowered(ctx, surface).field, points)[0])


def inside(ctx: Context, surface: Surface, at: Vec3) -> bool:
    """Does the field reach the threshold there?"""
    return field_at(ctx, surface, at) >= surface.threshold


def bounds(ctx: Context, surface: Surface) -> dict[str, Any]:
    """A box that holds the surface; from (0, 0, 0) to (0, 0, 0) if the surface is empty."""
    box = enclosure.surface_box(_lowered(ctx, surface), precision=1 / 64, effort=4)
    lo, hi = box if box is not None else (np.zeros(3), np.zeros(3))
    return {"lo": tuple(map(float, lo)), "hi": tuple(map(float, hi))}
