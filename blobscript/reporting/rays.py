"""The rays of a report: those of a small picture, and grazing ones. Seeded: the same for the same scene and seed.

Picture rays go through a random place of each pixel, in blocks of 16 x 16 as the tracer likes them. Grazing
rays pass a place of the surface along a tangent, shifted outwards or inwards by 1e-2 to 1e-9 of the scene's
unit: random rays hardly ever graze, and searches without proof fail on just these.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from blobscript import field, ir
from blobscript.framing import pixel_rays
from blobscript.ir import leaves

if TYPE_CHECKING:
    from blobscript.scene import Scene

__all__ = ["Rays", "make_rays", "unit_of"]

Array = NDArray[np.float64]

_BLOCK = 16
#: Shifts of grazing rays: 10 to the minus these, in units.
_SHIFTS = np.arange(2, 10)


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """origins, directions: (n, 3), unit length. The first `picture` of them are those of a picture of
    width x height pixels; `pixel` (picture,) is the number of each one's pixel, row by row from the top."""

    origins: Array
    directions: Array
    width: int
    height: int
    pixel: NDArray[np.int64]
    seed: int

    @property
    def picture(self) -> int:
        return len(self.pixel)

    def __len__(self) -> int:
        return len(self.origins)

    @property
    def digest(self) -> str:
        """Of all numbers, hexadecimal."""
        parts = (np.ascontiguousarray(a, dtype="<f8").tobytes() for a in (self.origins, self.directions))
        return hashlib.sha256(b"".join(parts)).hexdigest()


def unit_of(scene: ir.Scene) -> float:
    """The mean reach: what tolerances and errors of a scene are measured by."""
    parts = [leaf.reach for surface in scene.surfaces for leaf in leaves(surface.field) if leaf.count]
    return float(np.concatenate(parts).mean()) if parts else 1.0


def make_rays(scene: Scene, pixels: int, grazing: int, seed: int) -> Rays:
    """About `pixels` picture rays with the scene's aspect ratio, and up to `grazing` others."""
    rng = np.random.default_rng(seed)
    aspect = scene.ir.width / scene.ir.height
    width = max(round((pixels * aspect) ** 0.5), 1)
    height = max(-(-pixels // width), 1)
    pixel = _in_blocks(width, height)
    x, y = pixel % width + rng.uniform(-0.5, 0.5, len(pixel)), pixel // width + rng.uniform(-0.5, 0.5, len(pixel))
    origins, directions = pixel_rays(scene.ir, width, height, x, y)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    more = _grazing(scene, origins[0], grazing, rng)
    return Rays(np.concatenate([origins, more[0]]), np.concatenate([directions, more[1]]), width, height, pixel, seed)


def _in_blocks(width: int, height: int) -> NDArray[np.int64]:
    """Pixel numbers, block by block."""
    ys, xs = np.mgrid[0:height, 0:width].reshape(2, -1)
    order = np.lexsort((xs, ys, xs // _BLOCK, ys // _BLOCK))
    return (ys * width + xs)[order].astype(np.int64)


def _grazing(scene: Scene, eye: Array, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Tangents at places of the surface found from all sides."""
    at, normal = _places(scene, eye, count, rng)
    if len(at) == 0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    other = rng.normal(size=at.shape)
    tangent = np.cross(normal, other)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    unit = unit_of(scene.ir)
    shift = unit * 10.0 ** -rng.choice(_SHIFTS, len(at)) * rng.choice([-1.0, 1.0], len(at))
    distance = unit * rng.uniform(2.0, 8.0, len(at))
    return at + shift[:, None] * normal - distance[:, None] * tangent, tangent


def _places(scene: Scene, eye: Array, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Up to `count` places on the surfaces and normals there; half of them seen from the camera."""
    boxes = [field.extent(surface.field) for surface in scene.ir.surfaces]
    lo, hi = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
    size = float(np.linalg.norm(hi - lo))
    at, normal = np.zeros((0, 3)), np.zeros((0, 3))
    for _ in range(40):
        if len(at) >= count or size == 0.0:
            break
        targets = _targets(scene, 4 * count, rng)
        around = rng.normal(size=targets.shape)
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        starts = np.where(rng.random(len(targets))[:, None] < 0.5, targets + size * around, eye)
        hits = scene.first_hit(starts, targets - starts)
        good = hits.hit & np.isfinite(hits.normal).all(axis=1)
        at, normal = np.concatenate([at, hits.position[good]]), np.concatenate([normal, hits.normal[good]])
    return at[:count], normal[:count]


def _targets(scene: Scene, count: int, rng: np.random.Generator) -> Array:
    """Random places near the skeletons: boxes around elements, one element at random each."""
    from blobscript import geometry

    parts = [leaf for surface in scene.ir.surfaces for leaf in leaves(surface.field) if leaf.count]
    chosen = rng.integers(len(parts), size=count)
    targets = np.zeros((count, 3))
    for number, leaf in enumerate(parts):
        rows = np.flatnonzero(chosen == number)
        corners = geometry.simplices(leaf.skeleton)
        pick = corners[rng.integers(len(corners), size=len(rows))]
        share = rng.dirichlet(np.ones(corners.shape[1]), len(rows))
        places: Array = np.einsum("ij,ijk->ik", share, pick)
        places += rng.uniform(-0.7, 0.7, places.shape) * float(leaf.reach.mean())
        if leaf.matrix is not None:
            places = (places - leaf.matrix[:, 3]) @ np.linalg.inv(leaf.matrix[:, :3]).T
        targets[rows] = places
    return targets
