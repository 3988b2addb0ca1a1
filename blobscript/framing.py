"""Where surfaces are, and a camera that shows all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from blobscript import field, ir
from blobscript.enclosure import Box, surface_box

__all__ = [
    "Extents",
    "Fit",
    "camera_for",
    "corners",
    "default_camera",
    "default_fit",
    "pixel_rays",
    "view_axes",
    "view_rays",
]

Array = NDArray[np.float64]
Vec3 = tuple[float, float, float]

_FROM = np.array([0.4, 0.3, 1.0])
_FOV = math.radians(40)
#: Everything fits with this much room around it.
_MARGIN = 1.06
#: So many surfaces get a close box, at some milliseconds each.
_MOST_CLOSE = 16


class Extents:
    """Boxes around the inside of each surface, found when first asked for.

    A box is proved to hold the surface; None: the surface is proved empty.
    """

    def __init__(self, surfaces: Sequence[ir.Surface]) -> None:
        self._surfaces = surfaces
        self._found: dict[int, Box | None] = {}

    def box(self, number: int) -> Box | None:
        """Of the surface with this number."""
        if number not in self._found:
            self._found[number] = surface_box(self._surfaces[number], precision=1 / 16)
        return self._found[number]

    def boxes(self) -> list[Box]:
        """Of all surfaces that are not proved empty; of many, only the outermost are looked at
        closely, and the others have the box that their blobs lie in."""
        outer = [field.extent(surface.field) for surface in self._surfaces]
        close = self._outermost(outer)
        found = [self.box(i) if i in close or i in self._found else box for i, box in enumerate(outer)]
        return [box for box in found if box is not None]

    def _outermost(self, boxes: list[Box]) -> set[int]:
        """Numbers of the boxes that come closest to a side of the box around all of them."""
        lo, hi = np.array([box[0] for box in boxes]), np.array([box[1] for box in boxes])
        gaps = np.concatenate([lo - lo.min(axis=0), hi.max(axis=0) - hi], axis=1).min(axis=1)
        return set(np.argsort(gaps, kind="stable")[:_MOST_CLOSE].tolist())


def corners(box: Box) -> Array:
    """The (8, 3) corners of a box."""
    lo, hi = box
    pick = np.array([[(k >> axis) & 1 for axis in range(3)] for k in range(8)], dtype=bool)
    return np.where(pick, hi, lo)


def view_axes(camera: ir.Camera) -> tuple[Array, Array, Array]:
    """Unit vectors of a camera: right, up, and the way it looks."""
    forward = np.subtract(camera.to, camera.at)
    forward = forward / np.abs(forward).max()
    forward /= np.linalg.norm(forward)
    up = np.array(camera.up) / np.abs(camera.up).max()
    right = cast("Array", np.cross(forward, up))
    right /= np.linalg.norm(right)
    return right, cast("Array", np.cross(right, forward)), forward


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Where the default camera stands: at centre + d unit, with the least d that is at least `least` and
    max(side / (tangent aspect), height) - along for each corner of the bounds (n,)."""

    centre: Array
    unit: Array
    side: Array
    height: Array
    along: Array
    tangent: float
    least: float

    def distance(self, aspect: float) -> float:
        across = np.maximum(self.side / (self.tangent * aspect), self.height)
        return max(float((across - self.along).max()), self.least) or 1.0


def default_fit(boxes: Sequence[Box]) -> Fit:
    """Looks from direction (0.4, 0.3, 1) at the centre of the bounds, everything in view.

    A point p is in view if |right . (p - from)| <= aspect tan(fov / 2) forward . (p - from), and
    likewise for up; with from = centre - d forward each corner gives the least d.
    """
    shown = boxes or [(np.full(3, -1.0), np.full(3, 1.0))]
    points = np.concatenate([corners(box) for box in shown])
    lo, hi = points.min(axis=0), points.max(axis=0)
    centre = 0.5 * lo + 0.5 * hi
    unit = _FROM / np.linalg.norm(_FROM)
    looking = ir.Camera(_triple(unit), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), _FOV)
    right, up, forward = view_axes(looking)
    offsets = (points - centre) * _MARGIN
    tangent = math.tan(_FOV / 2)
    # where the surface is tiny beside its distance from the origin, the camera still has to move
    least = 1e-12 * float(np.abs(centre).max())
    side, height = np.abs(offsets @ right), np.abs(offsets @ up) / tangent
    return Fit(centre, unit, side, height, offsets @ forward, tangent, least)


def default_camera(boxes: Sequence[Box], aspect: float) -> ir.Camera:
    """The camera of a scene that has none."""
    fit = default_fit(boxes)
    at = fit.centre + fit.distance(aspect) * fit.unit
    return ir.Camera(_triple(at), _triple(fit.centre), (0.0, 1.0, 0.0), _FOV)


def camera_for(scene: ir.Scene, width: int, height: int) -> ir.Camera:
    """The scene's camera for a picture of another size: the default one still shows everything."""
    if scene.camera.span is not None or width * scene.height == height * scene.width:
        return scene.camera
    return default_camera(Extents(scene.surfaces).boxes(), width / height)


def pixel_rays(scene: ir.Scene, width: int, height: int, x: Array, y: Array) -> tuple[Array, Array]:
    """Origins and directions (n, 3) of the rays through the middles of pixels (n,), (n,) of a picture of that size;
    (0, 0) is the top left one, fractions lie between the middles."""
    camera = camera_for(scene, width, height)
    right, up, forward = view_axes(camera)
    step = 2.0 * math.tan(camera.fov / 2) / height
    across, above = (x + 0.5 - width / 2) * step, (height / 2 - y - 0.5) * step
    directions = forward + across[:, None] * right + above[:, None] * up
    return np.broadcast_to(np.array(camera.at), directions.shape).copy(), directions


def view_rays(camera: ir.Camera, width: int, height: int) -> tuple[Array, Array]:
    """Origin (3,) and directions (h, w, 3) through the pixel centres, of no particular length."""
    right, up, forward = view_axes(camera)
    step = 2.0 * np.tan(camera.fov / 2) / height
    x = (np.arange(width) + 0.5 - width / 2) * step
    y = (height / 2 - np.arange(height) - 0.5) * step
    return np.array(camera.at), forward + x[None, :, None] * right + y[:, None, None] * up


def _triple(p: Array) -> Vec3:
    return float(p[0]), float(p[1]), float(p[2])
