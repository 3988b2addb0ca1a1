"""Distances from points to the nearest of many triangles: a grid of buckets, searched in rings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blobscript.geometry import offset_to_simplices

__all__ = ["distance_to_triangles"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_CHUNK = 1 << 18


def distance_to_triangles(points: Floats, vertices: Floats, triangles: Ints) -> Floats:
    """(n, 3) -> (n,) distance to the nearest triangle (m, 3) over vertices.

    Triangles are in the buckets that their boxes touch; buckets are as large as the largest triangle, so a triangle
    nearer than a bucket's side lies in one of the 27 buckets around a point. Points farther than that, if there are
    any, are compared with all triangles.
    """
    corners = vertices[triangles]
    lo, hi = corners.min(axis=1), corners.max(axis=1)
    side = float((hi - lo).max())
    start = lo.min(axis=0)
    first, last = _bucket(lo, start, side), _bucket(hi, start, side)
    keys, members = _buckets(first, last)
    distance = np.full(len(points), np.inf)
    at = _bucket(points, start, side)
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            for dz in (-1, 0, 1):
                _compare(points, _key(at + np.array((dx, dy, dz))), keys, members, corners, distance)
    far = np.flatnonzero(distance > side)
    for i in far:
        v = offset_to_simplices(np.broadcast_to(points[i], (len(corners), 3)), corners)
        distance[i] = np.sqrt(np.einsum("ij,ij->i", v, v).min())
    return distance


def _bucket(places: Floats, start: Floats, side: float) -> Ints:
    return np.floor((places - start) / side).astype(np.int64)


def _key(at: Ints) -> Ints:
    """One number for a bucket; those beyond 2^20 buckets from the first share numbers, which is slower but right."""
    wrapped = (at + 1) & 0xFFFFF
    return (wrapped[:, 0] << 40) | (wrapped[:, 1] << 20) | wrapped[:, 2]


def _buckets(first: Ints, last: Ints) -> tuple[Ints, Ints]:
    """Sorted keys of buckets, and beside each a triangle in it: at most eight of a triangle's."""
    keys: list[Ints] = []
    members: list[Ints] = []
    number = np.arange(len(first))
    for corner in range(8):
        pick = np.array([corner >> k & 1 for k in range(3)], dtype=bool)
        new = np.all((last > first) | ~pick, axis=1)
        keys.append(_key(np.where(pick, last, first)[new]))
        members.append(number[new])
    key, member = np.concatenate(keys), np.concatenate(members)
    order = np.argsort(key, kind="stable")
    return key[order], member[order]


def _compare(points: Floats, at: Ints, keys: Ints, members: Ints, corners: Floats, distance: Floats) -> None:
    """Lowers `distance` to what the triangles in the buckets `at` say."""
    begin, end = np.searchsorted(keys, at, "left"), np.searchsorted(keys, at, "right")
    count = end - begin
    step = max(1, _CHUNK // max(1, int(count.max(initial=1))))
    for first in range(0, len(points), step):
        part = count[first : first + step]
        query = np.repeat(np.arange(first, first + len(part)), part)
        if not len(query):
            continue
        offset = np.arange(len(query)) - np.repeat(np.cumsum(part) - part, part)
        triangle = members[np.repeat(begin[first : first + step], part) + offset]
        v = offset_to_simplices(points[query], corners[triangle])
        np.minimum.at(distance, query, np.sqrt(np.einsum("ij,ij->i", v, v)))
