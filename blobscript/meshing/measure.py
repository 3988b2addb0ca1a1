"""How good a mesh is: closed or not, in how many pieces, how far from the surface, which volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blobscript.backends.native import Native
from blobscript.meshing.mesher import Body

__all__ = [
    "Shape",
    "Topology",
    "component_count",
    "distance_from_surface",
    "distance_to_surface",
    "residual",
    "shape_of",
    "topology",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_STEPS = 30
_CHUNK = 1 << 17


# ---- topology ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Topology:
    """boundary: edges of one triangle; nonmanifold: of more than two; misoriented: whose two triangles run the same
    way along them. All are 0 for a closed surface. euler: V - E + F, 2 - 2 (handles) for each component."""

    components: int
    euler: int
    boundary: int
    nonmanifold: int
    misoriented: int

    @property
    def is_closed(self) -> bool:
        return not (self.boundary or self.nonmanifold or self.misoriented)


def topology(triangles: Ints, vertex_count: int) -> Topology:
    """Counts of a triangle list (m, 3) over `vertex_count` vertices."""
    if not len(triangles):
        return Topology(0, 0, 0, 0, 0)
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    low, high = ends.min(axis=1), ends.max(axis=1)
    keys, which, counts = np.unique(low * np.int64(vertex_count) + high, return_inverse=True, return_counts=True)
    along = np.bincount(which, ends[:, 0] < ends[:, 1], len(keys))
    used = len(np.unique(triangles))
    return Topology(
        components=component_count(triangles, vertex_count),
        euler=used - len(keys) + len(triangles),
        boundary=int(np.count_nonzero(counts == 1)),
        nonmanifold=int(np.count_nonzero(counts > 2)),
        misoriented=int(np.count_nonzero((counts == 2) & (along != 1))),
    )


def component_count(triangles: Ints, vertex_count: int) -> int:
    """Connected components: each vertex takes the smallest label around it, and the label of its label."""
    label = np.arange(vertex_count)
    a = np.concatenate([triangles[:, 0], triangles[:, 1]])
    b = np.concatenate([triangles[:, 1], triangles[:, 2]])
    while len(a):
        one, other = label[a], label[b]
        apart = one != other
        a, b = a[apart], b[apart]
        np.minimum.at(label, np.maximum(one, other)[apart], np.minimum(one, other)[apart])
        while not np.array_equal(shorter := label[label], label):
            label = shorter
    return len(np.unique(label[np.unique(triangles)]))


# ---- sizes ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Shape:
    """Volume inside and area, scene units; least_angle: the smallest angle of all triangles, in degrees."""

    volume: float
    area: float
    least_angle: float


def shape_of(vertices: Floats, triangles: Ints) -> Shape:
    if not len(triangles):
        return Shape(0.0, 0.0, 0.0)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))  # or the volume would cancel far from the origin
    a, b, c = (vertices[triangles[:, i]] - middle for i in range(3))
    normal = np.cross(b - a, c - a)
    sides = np.stack([np.linalg.norm(q - p, axis=1) for p, q in ((b, c), (c, a), (a, b))])
    double = np.linalg.norm(normal, axis=1)
    least = double / np.maximum(np.prod(sides, axis=0) / sides.min(axis=0), 1e-300)  # sine: opposite the shortest side
    return Shape(
        float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0),
        float(0.5 * double.sum()),
        float(np.degrees(np.arcsin(np.clip(least.min(), 0.0, 1.0)))),
    )


# ---- distances --------------------------------------------------------------------------------------------


def residual(points: Floats, native: Native, surface: int, threshold: float) -> Floats:
    """|F| / |grad F|: the distance from the surface, to first order. (n, 3) -> (n,)"""
    value, slope = _field(points, native, surface, threshold)
    return np.abs(value) / np.maximum(np.linalg.norm(slope, axis=1), 1e-300)


def _field(points: Floats, native: Native, surface: int, threshold: float) -> tuple[Floats, Floats]:
    values, slopes = np.empty(len(points)), np.empty((len(points), 3))
    for first in range(0, len(points), _CHUNK):
        part = slice(first, first + _CHUNK)
        values[part] = native.field(points[part], surface)
        slopes[part] = native.gradient(points[part], surface)
    return values - threshold, slopes


def projected(points: Floats, native: Native, surface: int, threshold: float, reach: float) -> tuple[Floats, Floats]:
    """Where Newton's method along the gradient takes points to, and the gradient there. Those that it would take
    farther than `reach` away stay where they are: (n, 3) places and slopes, NaN slopes for those."""
    at = points.copy()
    slope = np.full_like(at, np.nan)
    todo = np.arange(len(points))
    for _ in range(_STEPS):
        value, g = _field(at[todo], native, surface, threshold)
        size2 = np.einsum("ij,ij->i", g, g)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = -(value / size2)[:, None] * g
        length = np.linalg.norm(step, axis=1)
        fine = np.isfinite(length) & (length <= 1e-15 * (np.abs(at[todo]).max(axis=1) + reach))
        slope[todo[fine]] = g[fine]
        moved = at[todo] + np.where((np.isfinite(length) & ~fine)[:, None], step, 0.0)
        near = np.linalg.norm(moved - points[todo], axis=1) <= reach
        going = np.isfinite(length) & ~fine & near
        at[todo[going]] = moved[going]
        slope[todo[going]] = g[going]
        lost = ~fine & ~going
        at[todo[lost]], slope[todo[lost]] = points[todo[lost]], np.nan
        todo = todo[going]
        if not len(todo):
            break
    return at, slope


def _middles(body: Body) -> tuple[Floats, Floats]:
    """Of triangles and of their sides: where triangles are farthest from the surface that their corners lie on. And how
    far they are from the nearest corner."""
    a, b, c = (body.vertices[body.triangles[:, i]] for i in range(3))
    middle = (a + b + c) / 3.0
    near = np.min([np.linalg.norm(corner - middle, axis=1) for corner in (a, b, c)], axis=0)
    halves = [0.5 * np.linalg.norm(q - p, axis=1) for p, q in ((a, b), (b, c), (c, a))]
    return np.concatenate([middle, 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)]), np.concatenate([near, *halves])


def distance_to_surface(body: Body, native: Native, surface: int, threshold: float) -> float:
    """One half of the Hausdorff distance, from triangles to surface: over their middles and those of their sides, by
    Newton's method along the gradient (to first order where that leads away). No farther than a corner of their own,
    which lies on the surface: across a crease the gradient may lead to another part of it."""
    points, corner = _middles(body)
    reach = 2.0 * _longest_side(body)
    at, slope = projected(points, native, surface, threshold, reach)
    found = np.isfinite(slope[:, 0])
    distance = np.linalg.norm(at - points, axis=1)
    if not found.all():
        distance[~found] = np.minimum(residual(points[~found], native, surface, threshold), reach)
    return float(np.minimum(distance, corner).max())


def _longest_side(body: Body) -> float:
    a, b, c = (body.vertices[body.triangles[:, i]] for i in range(3))
    return max(float(np.linalg.norm(q - p, axis=1).max()) for p, q in ((a, b), (b, c), (c, a)))


def distance_from_surface(body: Body, native: Native, surface: int, *, count: int = 20_000, seed: int = 0) -> float:
    """The other half, from surface to triangles: over first hits of `count` random rays with the surface, to the
    nearest triangle among those near the nearest vertices."""
    from blobscript.meshing.nearest import distance_to_triangles

    lo, hi = body.vertices.min(axis=0), body.vertices.max(axis=0)
    middle, radius = 0.5 * (lo + hi), 0.6 * float(np.linalg.norm(hi - lo))
    random = np.random.default_rng(seed)
    ends = random.normal(size=(2, count, 3))
    ends *= radius / np.linalg.norm(ends, axis=2, keepdims=True)
    hits = native.first_hit(middle + ends[0], ends[1] - ends[0])
    points = hits.position[hits.surface == surface]
    return float(distance_to_triangles(points, body.vertices, body.triangles).max(initial=0.0))
