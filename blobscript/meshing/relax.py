"""More even triangles: vertices move along the surface towards the middle of their neighbours.

Each round takes a vertex to the mean of its neighbours, without the part along the normal, and back onto the surface
by Newton's method. A vertex stays where it was if that leads away, if a triangle at it would turn over, or if the
smallest angle around it would become smaller. Topology does not change.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blobscript.backends.native import Native
from blobscript.meshing.measure import projected
from blobscript.meshing.mesher import Body

__all__ = ["relaxed"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: The share of the way to the neighbours' middle that a vertex takes.
_SHARE = 0.5
#: Rounds in which vertices that did harm are put back.
_RETREATS = 4


def relaxed(body: Body, native: Native, surface: int, threshold: float, rounds: int) -> Body:
    """The same triangles over vertices on the same surface, after so many rounds."""
    vertices, normals = body.vertices, body.normals
    for _ in range(rounds if len(body.triangles) else 0):
        goal = _middles(vertices, body.triangles) - vertices
        goal -= np.einsum("ij,ij->i", goal, normals)[:, None] * normals
        reach = 0.5 * np.maximum(np.linalg.norm(goal, axis=1), 1e-300)
        there, slope = projected(vertices + _SHARE * goal, native, surface, threshold, float(reach.max()))
        moved = np.isfinite(slope[:, 0]) & (np.linalg.norm(there - vertices - _SHARE * goal, axis=1) <= reach)
        new = np.where(moved[:, None], there, vertices)
        stays = _harmed(vertices, new, body.triangles)
        new[stays] = vertices[stays]
        changed = moved & ~stays
        with np.errstate(invalid="ignore"):
            facing = -slope / np.linalg.norm(slope, axis=1, keepdims=True)
        vertices, normals = new, np.where(changed[:, None], facing, normals)
    return replace(body, vertices=vertices, normals=normals)


def _middles(vertices: Floats, triangles: Ints) -> Floats:
    """The mean of the neighbours of each vertex."""
    total, count = np.zeros_like(vertices), np.zeros(len(vertices))
    for i in range(3):
        here, after = triangles[:, i], triangles[:, (i + 1) % 3]
        count += np.bincount(here, minlength=len(vertices))  # a closed surface: every edge is seen once each way
        for axis in range(3):
            total[:, axis] += np.bincount(here, vertices[after, axis], len(vertices))
    return total / np.maximum(count, 1.0)[:, None]


def _harmed(old: Floats, new: Floats, triangles: Ints) -> NDArray[np.bool_]:
    """Vertices to put back, until no triangle turns over or has a smaller angle than all that were around it."""
    stays = np.zeros(len(old), dtype=bool)
    before, normal = _quality(old, triangles)
    least = np.full(len(old), np.inf)
    for i in range(3):
        np.minimum.at(least, triangles[:, i], before)
    floor = least[triangles].min(axis=1)
    for _ in range(_RETREATS):
        now, turned = _quality(np.where(stays[:, None], old, new), triangles)
        bad = (now < floor * (1.0 - 1e-12)) | (np.einsum("ij,ij->i", normal, turned) <= 0.0)
        if not bad.any():
            return stays
        stays[triangles[bad].ravel()] = True
    return np.ones(len(old), dtype=bool) if _still_bad(old, new, triangles, stays, floor, normal) else stays


def _still_bad(
    old: Floats, new: Floats, triangles: Ints, stays: NDArray[np.bool_], floor: Floats, normal: Floats
) -> bool:
    now, turned = _quality(np.where(stays[:, None], old, new), triangles)
    return bool(((now < floor * (1.0 - 1e-12)) | (np.einsum("ij,ij->i", normal, turned) <= 0.0)).any())


def _quality(vertices: Floats, triangles: Ints) -> tuple[Floats, Floats]:
    """Twice the area over the squared longest side, which falls with the smallest angle; and normals."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    longest2 = np.max([np.einsum("ij,ij->i", q - p, q - p) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return np.linalg.norm(normal, axis=1) / np.maximum(longest2, 1e-300), normal
