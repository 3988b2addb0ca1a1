"""Where surfaces are, and a camera that shows all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blobscript import field, ir
from blobscript.values import Vec3

__all__ = ["Box", "Extents", "blob_count", "corners", "default_camera", "halved", "surface_box", "view_axes"]

Array = NDArray[np.float64]
Box = tuple[Array, Array]

_FROM = np.array([0.4, 0.3, 1.0])
_FOV = math.radians(40)
#: Everything fits with this much room around it.
_MARGIN = 1.06

#: Surfaces of more blobs are framed by where their blobs end, which is close enough then.
_MOST_BLOBS = 20_000
#: What may be spent on one surface, at 8 for each box and 0.1 for each of its blobs: about 20 ms.
_WORK = 30_000


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
        """Of all surfaces that are not proved empty."""
        return [box for box in map(self.box, range(len(self._surfaces))) if box is not None]


def surface_box(surface: ir.Surface, precision: float, effort: float = 1.0) -> Box | None:
    """A box that is proved to hold the inside of a surface; None: it is proved empty.

    The field's extent is halved again and again; boxes where the field stays below the threshold
    are dropped, and so are those within the box around the points that are seen to be inside: they
    cannot make it larger. The sides are too long by at most `precision` of the largest, unless the
    work runs out (`effort` multiplies what is allowed). All of the field's extent where a threshold is not positive.
    """
    lo, hi = field.extent(surface.field)
    count = blob_count(surface.field)
    if surface.threshold <= 0 or count > _MOST_BLOBS:
        return lo, hi
    seen_lo, seen_hi = np.full(3, np.inf), np.full(3, -np.inf)
    lo, hi = _grid(lo, hi, 4)
    work, cost = 0.0, 8 + 0.1 * count
    while True:
        work += len(lo) * cost
        keep = field.bounds(surface.field, lo, hi)[1] >= surface.threshold
        lo, hi = lo[keep], hi[keep]
        if not len(lo) and not (seen_lo <= seen_hi).all():
            return None
        middle = 0.5 * lo + 0.5 * hi
        inside = middle[field.field_value(surface.field, middle) >= surface.threshold]
        seen_lo = np.minimum(seen_lo, inside.min(axis=0, initial=np.inf))
        seen_hi = np.maximum(seen_hi, inside.max(axis=0, initial=-np.inf))
        within = np.all((lo >= seen_lo) & (hi <= seen_hi), axis=1)
        lo, hi = lo[~within], hi[~within]
        all_lo = np.minimum(seen_lo, lo.min(axis=0, initial=np.inf))
        all_hi = np.maximum(seen_hi, hi.max(axis=0, initial=-np.inf))
        slack = max(float((seen_lo - all_lo).max()), float((all_hi - seen_hi).max()))
        if (
            not len(lo)
            or slack <= precision * float((all_hi - all_lo).max())
            or work + 2 * cost * len(lo) > _WORK * effort
        ):
            return all_lo, all_hi
        lo, hi = halved(lo, hi)


def _grid(lo: Array, hi: Array, n: int) -> Box:
    """The n^3 equal parts of a box."""
    steps = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    edges = lo + (hi - lo) * np.arange(n + 1)[:, None] / n
    axes = np.arange(3)
    return edges[steps, axes], edges[steps + 1, axes]


def blob_count(tree: ir.Field) -> int:
    """How many blobs a field has."""
    return tree.count if isinstance(tree, ir.Leaf) else sum(map(blob_count, tree.children))


def halved(lo: Array, hi: Array) -> Box:
    """Both halves of each box, cut across its longest side."""
    rows, axis = np.arange(len(lo)), np.argmax(hi - lo, axis=1)
    middle = 0.5 * lo[rows, axis] + 0.5 * hi[rows, axis]
    left, right = hi.copy(), lo.copy()
    left[rows, axis] = middle
    right[rows, axis] = middle
    return np.concatenate([lo, right]), np.concatenate([left, hi])


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
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward


def default_camera(boxes: Sequence[Box], aspect: float) -> ir.Camera:
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
    across = np.maximum(np.abs(offsets @ right) / (tangent * aspect), np.abs(offsets @ up) / tangent)
    distance = float((across - offsets @ forward).max()) or 1.0
    return ir.Camera(_triple(centre + distance * unit), _triple(centre), (0.0, 1.0, 0.0), _FOV)


def _triple(p: Array) -> Vec3:
    return float(p[0]), float(p[1]), float(p[2])
