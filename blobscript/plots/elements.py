"""The blobs of a surface one by one: what each adds at points, and where along a ray each is felt.

A ray is P(t) = o + t d with |d| = 1, t in scene units. An element's s(t) = dist(M P(t), skeleton)^2 / reach^2,
and its density weight * D(sqrt s).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blobscript import field, geometry, kernels
from blobscript.ir import Field, Kernel, Leaf, Lines, Node, Points, Scene, Surface, leaves
from blobscript.source import Span

__all__ = ["Element", "Ray", "Tree", "combine", "elements_of", "flat", "near_line", "tree_along", "tree_at"]

Array = NDArray[np.float64]

#: Gaussians are looked at as far as they exceed this share of the threshold, all together.
_NEGLIGIBLE = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Ray:
    """origin, direction: (3,), the direction of unit length."""

    origin: Array
    direction: Array

    def at(self, t: Array) -> Array:
        """(n,) -> (n, 3)."""
        return self.origin + np.asarray(t)[:, None] * self.direction


@dataclass(frozen=True, eq=False)
class Element:
    """One blob; `number` counts through the surface, `place` is the piece of script that made it."""

    number: int
    leaf: Leaf
    index: int
    place: Span | None
    felt: float  # distance (in skeleton space) within which it matters

    @property
    def kernel(self) -> Kernel:
        return self.leaf.kernel

    @property
    def weight(self) -> float:
        return float(self.leaf.weight[self.index])

    @property
    def reach(self) -> float:
        return float(self.leaf.reach[self.index])

    @property
    def kind(self) -> str:
        """Of its skeleton, in the script's word."""
        names = {"Points": "point", "Lines": "line"}
        name = type(self.leaf.skeleton).__name__
        return names.get(name, name.lower())

    @cached_property
    def corners(self) -> Array:
        """(m, k, 3) simplices in skeleton space."""
        corners = geometry.simplices(self.leaf.skeleton)
        return corners[self.index : self.index + 1] if _is_many(self.leaf) else corners

    @property
    def exact(self) -> bool:
        """Its squared distance is a quadratic between the ends and the side of one point or segment."""
        return len(self.corners) == 1 and self.corners.shape[1] <= 2

    def mapped(self, points: Array) -> Array:
        """Scene -> skeleton space, (n, 3)."""
        matrix = self.leaf.matrix
        return points if matrix is None else points @ matrix[:, :3].T + matrix[:, 3]

    def turned(self, direction: Array) -> Array:
        """A direction in skeleton space, (3,); its length is the local speed."""
        matrix = self.leaf.matrix
        return direction if matrix is None else matrix[:, :3] @ direction

    def offsets(self, points: Array) -> Array:
        """From the nearest place of the skeleton to mapped points, in reaches, (n, 3)."""
        p = self.mapped(points)
        if _is_many(self.leaf):
            return geometry.offset_to_simplices(p, self.corners[0]) / self.reach
        return geometry.offsets(self.leaf.skeleton, p) / self.reach

    def square(self, points: Array) -> Array:
        """s at scene points, (n,)."""
        v = self.offsets(points)
        return np.einsum("ij,ij->i", v, v)

    def density(self, points: Array) -> Array:
        """At scene points, (n,)."""
        return self.weight * kernels.value(self.kernel, self.square(points))

    def interval(self, ray: Ray) -> tuple[float, float] | None:
        """The stretch of t (of all of the line) where it is felt; for several simplices the hull of theirs."""
        matrix_ray = self.mapped(ray.origin[None])[0], self.turned(ray.direction)
        ends = _felt(*matrix_ray, self.corners, self.felt)
        return None if ends is None else (float(ends[0].min()), float(ends[1].max()))


def _is_many(leaf: Leaf) -> bool:
    """Points and lines are separate elements; the simplices of the others are one."""
    return isinstance(leaf.skeleton, Points | Lines)


#: A field with elements as leaves: an element, or an operation and what it joins.
Tree = Element | tuple[str, "list[Tree]"]


def flat(tree: Tree) -> list[Element]:
    """The elements in the order of the scene."""
    if isinstance(tree, Element):
        return [tree]
    return [element for child in tree[1] for element in flat(child)]


def combine(operation: str, values: list[Array], count: int) -> Array:
    """Of the children's values (n,) each."""
    return field._combine(operation, values, count)  # pyright: ignore[reportPrivateUsage]


def elements_of(scene: Scene, surface: int, most: int | None = None) -> list[Element]:
    """All elements of a surface, at most `most` of them."""
    found: list[Element] = []
    for element in _every(scene, scene.surfaces[surface]):
        if most is not None and len(found) >= most:
            break
        found.append(element)
    return found


def _every(scene: Scene, surface: Surface) -> Iterator[Element]:
    number = 0
    for leaf in leaves(surface.field):
        for index in range(leaf.count):
            yield _element(scene, leaf, index, number + index, _felt_distance(leaf, surface.threshold)[index])
        number += leaf.count


def _element(scene: Scene, leaf: Leaf, index: int, number: int, felt: float) -> Element:
    span = int(leaf.origin[index])
    return Element(number, leaf, index, scene.spans[span] if 0 <= span < len(scene.spans) else None, float(felt))


def _felt_distance(leaf: Leaf, threshold: float) -> Array:
    """(n,) the reach; of a Gaussian, where it has become negligible beside the threshold."""
    if np.isfinite(kernels.support(leaf.kernel)):
        return leaf.reach
    epsilon = _NEGLIGIBLE * (abs(threshold) or 1.0) / leaf.count / np.abs(leaf.weight)
    return leaf.reach * np.array([kernels.cut(leaf.kernel, min(float(e), 1.0)) for e in epsilon])


# ---- along a ray, at a point -------------------------------------------------------------------


def tree_along(scene: Scene, surface: int, ray: Ray) -> Tree:
    """The elements of a surface that the line of the ray comes near, in their tree."""
    return _Pruning(scene, scene.surfaces[surface].threshold, ray).tree(scene.surfaces[surface].field)


def tree_at(scene: Scene, surface: int, point: Array) -> Tree:
    """The elements that are felt at one point (3,), in their tree."""
    return tree_along(scene, surface, Ray(point, np.zeros(3)))


class _Pruning:
    """A walk over a field that keeps what a ray comes near; numbers go on counting what is left out."""

    def __init__(self, scene: Scene, threshold: float, ray: Ray) -> None:
        self.scene, self.threshold, self.ray = scene, threshold, ray
        self.number = 0

    def tree(self, part: Field) -> Tree:
        match part:
            case Node(op, children):
                return op, [self.tree(child) for child in children]
            case Leaf():
                found = self._elements(part)
                return found[0] if len(found) == part.count == 1 else ("sum", list(found))

    def _elements(self, leaf: Leaf) -> list[Element]:
        felt = _felt_distance(leaf, self.threshold)
        first, self.number = self.number, self.number + leaf.count
        return [
            _element(self.scene, leaf, int(i), first + int(i), felt[i])
            for i in np.flatnonzero(near_line(leaf, self.ray, felt))
        ]


def near_line(leaf: Leaf, ray: Ray, felt: Array) -> NDArray[np.bool_]:
    """(n,) may the line come within `felt` of element i? By balls around the skeletons."""
    if leaf.count == 0:
        return np.zeros(0, np.bool_)
    corners = geometry.simplices(leaf.skeleton)
    corners = corners if _is_many(leaf) else corners.reshape(1, -1, 3)
    middle = corners.mean(axis=1)
    radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    matrix = np.eye(3, 4) if leaf.matrix is None else leaf.matrix
    o, d = matrix[:, :3] @ ray.origin + matrix[:, 3], matrix[:, :3] @ ray.direction
    speed = float(d @ d)
    v = middle - o
    foot = (v @ d / speed)[:, None] * d if speed > 0.0 else 0.0
    return np.linalg.norm(v - foot, axis=1) <= (radius + felt) * (1.0 + 1e-9)


def _felt(o: Array, d: Array, corners: Array, limit: float) -> tuple[Array, Array] | None:
    """Where a line is within `limit` of each simplex that it comes so near: distance to a convex set is
    convex along a line, so the nearest place is found by sections and both ends by halving."""
    middle = corners.mean(axis=1)
    radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1) + limit
    speed = float(np.linalg.norm(d))
    at = (middle - o) @ d / speed**2
    lo: Array = at - 1.001 * radius / speed
    hi: Array = at + 1.001 * radius / speed

    def distance(t: Array) -> Array:
        return np.linalg.norm(geometry.offset_to_simplices(o + t[:, None] * d, corners), axis=1)

    a, b = lo, hi
    for _ in range(100):
        third = (b - a) / 3.0
        left = distance(a + third) <= distance(b - third)
        a, b = a + np.where(left, 0.0, third), b - np.where(left, third, 0.0)
    nearest: Array = 0.5 * (a + b)
    good = distance(nearest) < limit
    if not np.any(good):
        return None
    first, last = _halved(distance, lo, nearest, limit), _halved(distance, hi, nearest, limit)
    return first[good], last[good]


def _halved(distance: Callable[[Array], Array], far: Array, near: Array, limit: float) -> Array:
    for _ in range(60):
        middle = 0.5 * (far + near)
        inside = distance(middle) < limit
        far, near = np.where(inside, far, middle), np.where(inside, middle, near)
    return near
