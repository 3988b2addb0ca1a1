"""A small picture of a scene: no pixel that is no number, no acne, no leaks, and the same bits however it is made.

Places on the surface are those that pictures use: a hit from afar is known to the last digits of its distance, and one
Newton step (`polish_places` in shade.c) brings it to those of the place itself.

Acne: a ray from a hit straight back to the eye finds something on a way that is known to be free. Leak: a ray from
a hit on into the solid does not start inside. Both are asked where the surface is not seen at a grazing angle, and
where it is known well enough for the question to have an answer: among densities of 1e10 that cancel, double
precision knows a surface to five digits, and where steep densities stand above flat ones by less than their rounding
(a `max` that passes to a flat field a hair from the surface) a place outside is no other than one inside.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.conditioning import position_error, rounding, tolerance
from blobscript.field import field_value
from blobscript.framing import pixel_rays
from blobscript.scene import Scene

__all__ = ["image_faults"]

_WIDTH, _HEIGHT = 40, 32
#: Cosine of the angle between ray and surface below which neither side is sure.
_STEEP = 1e-2
#: How well a place on the surface has to be known, relative to the lengths involved.
_KNOWN = 1e-11
#: Largest step to a place on the surface, relative to the lengths involved; as POLISH_MOST in shade.c.
_POLISH = 1e-7


def image_faults(scene: Scene) -> list[str]:
    whole = scene.render(width=_WIDTH, height=_HEIGHT, threads=1, aov=("depth", "normal"))
    faults: list[str] = []
    if not np.isfinite(whole.rgba).all():
        faults.append("picture: a pixel is no number")
    again = scene.render(width=_WIDTH, height=_HEIGHT, threads=2)
    if whole.rgba.tobytes() != again.rgba.tobytes():
        faults.append("picture: other bits with two threads")
    part = scene.render(width=_WIDTH, height=_HEIGHT, region=(5, 3, 29, 27))
    if part.rgba.tobytes() != np.ascontiguousarray(whole.rgba[3:27, 5:29]).tobytes():
        faults.append("picture: other bits in a region")
    return faults + _secondary_faults(scene)


def _secondary_faults(scene: Scene) -> list[str]:
    y, x = np.divmod(np.arange(_WIDTH * _HEIGHT, dtype=np.float64), _WIDTH)
    origins, directions = pixel_rays(scene.ir, _WIDTH, _HEIGHT, x, y)
    hits = scene.first_hit(origins, directions)
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        sure = (hits.status == 1) & (np.abs(np.einsum("ij,ij->i", unit, hits.normal)) > _STEEP)
    for number, surface in enumerate(scene.surfaces):
        mine = np.flatnonzero(sure & (hits.surface == number))
        if len(mine):
            sure[mine] = _is_known(surface, origins[mine], unit[mine], hits.t[mine])
    if not sure.any():
        return []
    places, ways = _polished(scene, hits.position[sure], hits.surface[sure], hits.t[sure]), unit[sure]
    faults: list[str] = []
    back = scene.any_hit(places, -ways, 0.0, hits.t[sure])
    if back.any():
        faults.append(f"picture: {np.count_nonzero(back)} of {len(back)} ways back to the eye are blocked")
    on = scene.first_hit(places, ways).status
    if (on == 1).any():
        faults.append(
            f"picture: {np.count_nonzero(on == 1)} of {len(on)} rays that go on into the solid enter it again"
        )
    return faults


def _is_known(
    surface: ir.Surface, origins: NDArray[np.float64], unit: NDArray[np.float64], t: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which hits (n,) are known well, with a field that is beyond its rounding on both sides of them: twice the
    conditioned error away. (That error takes the slope at the hit to go on; where it does not it says too little.)"""
    off = tolerance(surface, origins, unit, t)
    known = off <= _KNOWN * (np.linalg.norm(origins, axis=1) + t)
    at, step = origins + t[:, None] * unit, 2.0 * np.where(known, off, 0.0)[:, None] * unit
    error = rounding(surface, at, position_error(origins, t))
    before, behind = (field_value(surface.field, place) - surface.threshold for place in (at - step, at + step))
    return known & (np.minimum(np.abs(before), np.abs(behind)) > error) & (np.sign(before) != np.sign(behind))


def _polished(
    scene: Scene, places: NDArray[np.float64], surfaces: NDArray[np.int32], t: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Places (n, 3) at distances t after one step towards their surface, where that is about as short as rounding."""
    result = places.copy()
    for number, surface in enumerate(scene.surfaces):
        mine = np.flatnonzero(surfaces == number)
        slope = scene.gradient(places[mine], number)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            share = (surface.threshold - scene.field(places[mine], number)) / np.einsum("ij,ij->i", slope, slope)
            step = share[:, None] * slope
        most = _POLISH * (t[mine] + np.linalg.norm(places[mine], axis=1))
        result[mine] += np.where((np.linalg.norm(step, axis=1) <= most)[:, None], step, 0.0)
    return result
