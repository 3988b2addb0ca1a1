"""Do the faces of a closed surface pass through each other? Where they do, there is no one inside.

Pairs of triangles whose boxes meet come from the tree of `geometry`; in each pair, the edges of one are tried on the
other, and the other way round. An edge that shares a point with the triangle touches it and does not count, and one
that ends on it within rounding does not pass through it, so neighbours and faces that merely touch are left alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blobscript import geometry

__all__ = ["first_overlap"]

Array = NDArray[np.float64]
Ints = NDArray[np.int32]
Indices = NDArray[np.int64]

#: An edge passes through a triangle if both its ends and the triangle's edges are clear of each other by this part
#: of the volumes that they span.
_CLEAR = 1e-10
#: Triangles whose boxes are looked up at once.
_CHUNK = 20_000


def first_overlap(points: Array, triangles: Ints) -> tuple[int, int] | None:
    """Numbers of two triangles that pass through each other, if there are any."""
    corners = points[triangles]
    lo, hi = corners.min(axis=1), corners.max(axis=1)
    tree = geometry.build_tree(corners)
    for start in range(0, len(triangles), _CHUNK):
        part = slice(start, start + _CHUNK)
        for query, item in geometry.pairs(tree, lo[part], hi[part], lambda _query, gap2, _reach: gap2 == 0.0):
            a, b = query + start, item
            apart = a != b
            a, b = a[apart], b[apart]
            hit = np.flatnonzero(_pierces(points, triangles[a], triangles[b]))
            if len(hit):
                return int(a[hit[0]]), int(b[hit[0]])
    return None


def _pierces(points: Array, a: Ints, b: Ints) -> NDArray[np.bool_]:
    """Does an edge of triangle a (n, 3) pass through triangle b?"""
    result = np.zeros(len(a), dtype=np.bool_)
    for i in range(3):
        ends = a[:, [i, (i + 1) % 3]]
        strange = ~(ends[:, :, None] == b[:, None, :]).any(axis=(1, 2))
        rows = np.flatnonzero(strange & ~result)
        result[rows] = _passes(points[ends[rows]], points[b[rows]])
    return result


def _passes(edge: Array, corners: Array) -> NDArray[np.bool_]:
    """Does the edge (n, 2, 3) pass through the inside of the triangle (n, 3, 3)? By the signs of five volumes."""
    p, q = edge[:, 0], edge[:, 1]
    along = q - p
    sides = [_volume(along, corners[:, i] - p, corners[:, (i + 1) % 3] - p) for i in range(3)]
    spans = [corners[:, i] - corners[:, 0] for i in (1, 2)]
    below, above = (_volume(end - corners[:, 0], *spans) for end in (p, q))
    size = np.linalg.norm(along, axis=1) * np.linalg.norm(spans[0], axis=1) * np.linalg.norm(spans[1], axis=1)
    clear = _CLEAR * size
    opposite = (np.minimum(below, above) < -clear) & (np.maximum(below, above) > clear)
    inner = (np.min(sides, axis=0) > clear) | (np.max(sides, axis=0) < -clear)
    return opposite & inner


def _volume(a: Array, b: Array, c: Array) -> Array:
    return np.einsum("ij,ij->i", a, np.cross(b, c))
