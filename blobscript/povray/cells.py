"""An isosurface cut into boxes that hold only what is felt there.

POV-Ray evaluates the whole function at every step along a ray, and its steps are as short as the steepest place of
the container demands. So the surface is given as many small isosurfaces instead of one: boxes that are proved to be
all inside or all outside are left out, and each of the others has the terms that are felt in it, and a bound on the
gradient that is proved for it. The union of the pieces is the surface; boxes overlap a little, so that a crossing in
a wall between two of them is found at least once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from blobscript import field, geometry, kernels
from blobscript.enclosure import blob_count, surface_box
from blobscript.ir import Field, Leaf, Lines, Mesh, Node, Points, Polyhedron, Skeleton, Surface, leaves
from blobscript.povray.steepness import felt_distance, steepness
from blobscript.povray.text import Array

__all__ = ["Cell", "Group", "Single", "Terms", "Tree", "cells_of", "whole"]

Ints = NDArray[np.int64]

#: Boxes of one surface: this many, and for large ones so many for each blob, up to the most (measured: twice as many
#: make a picture of few blobs 5 % quicker, half as many 20 to 40 % slower).
_FEW, _EACH, _MOST = 64, 6, 6000
#: Joints in which a density of 0 is as none at all; from so many children on they are looked at where they are felt,
#: in blocks of about so many boxes.
_DROPPING, _MANY, _TOGETHER = ("sum", "smooth_max", "smooth_min"), 32, 64
#: Each piece is looked at in this many parts along a side, for its bound and for what it can do without.
_PARTS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Terms:
    """Elements of a leaf (points, lines) that are felt in a cell, summed."""

    leaf: Leaf
    elements: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Single:
    """A leaf that is one blob of many simplices: those that may be nearest in a cell.

    side: for solids, whether the cell lies "inside" or "outside" of it, or "both".
    """

    leaf: Leaf
    simplices: tuple[int, ...]
    side: str = "outside"


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    op: str
    children: tuple[Tree, ...]


Tree = Terms | Single | Group


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """A container, the terms felt in it, and a proved bound on the gradient of their sum."""

    lo: Array
    hi: Array
    tree: Tree
    max_gradient: float


def cells_of(surface: Surface, overlap: float) -> list[Cell]:
    """The pieces of a surface; none if it is proved empty. `overlap`: how far neighbours reach into each other."""
    box = surface_box(surface, precision=1 / 16) if surface.threshold > 0 else field.extent(surface.field)
    if box is None:
        return []
    margin = 4.0 * overlap
    lo, hi = _divided(surface, box[0] - margin, box[1] + margin)
    if not len(lo):
        return []
    lo, hi = _tightened(surface, lo, hi)
    lo, hi = _rounded(lo - overlap, hi + overlap)
    steep = _steepest(surface, lo, hi)
    trees = _Felt(lo, hi).trees(surface.field)
    return [Cell(lo[i], hi[i], trees[i], float(steep[i])) for i in range(len(lo))]


def whole(surface: Surface) -> Tree:
    """All of a surface's field."""
    lo, hi = field.extent(surface.field)
    return _Felt(lo[None], hi[None]).trees(surface.field)[0]


# ---- boxes ---------------------------------------------------------------------------------


def _divided(surface: Surface, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Boxes that the surface may cross; those that would cost a ray most are halved first."""
    most = min(_MOST, max(_FEW, _EACH * blob_count(surface.field)))
    lo, hi = lo[None], hi[None]
    for _ in range(60):
        keep = _crossed(surface, lo, hi)
        lo, hi = lo[keep], hi[keep]
        room = most - len(lo)
        if not len(lo) or room <= 0:
            break
        cost = np.prod(hi - lo, axis=1) * (1.0 + _felt_count(surface.field, lo, hi))
        # all that are not much cheaper than the dearest, so that a round does not split one by one
        chosen = np.argsort(-cost, kind="stable")[:room]
        chosen = chosen[cost[chosen] >= 0.3 * cost.max()]
        split = np.zeros(len(lo), dtype=np.bool_)
        split[chosen] = True
        left_lo, left_hi = _halved(lo[split], hi[split])
        lo, hi = np.concatenate([lo[~split], left_lo]), np.concatenate([hi[~split], left_hi])
    order = np.lexsort(lo.T)
    return lo[order], hi[order]


def _crossed(surface: Surface, lo: Array, hi: Array) -> NDArray[np.bool_]:
    low, high = np.zeros(len(lo)), np.zeros(len(lo))
    for tree, rows in _blocks(surface.field, lo, hi):
        low[rows], high[rows] = field.bounds(tree, lo[rows], hi[rows])
    return (low <= surface.threshold) & (high >= surface.threshold)


def _tightened(surface: Surface, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Each box drawn in around its parts that the surface may cross."""
    part_lo, part_hi = _parts(lo, hi)
    crossed = _crossed(surface, part_lo, part_hi).reshape(len(lo), -1, 1)
    part_lo, part_hi = part_lo.reshape(len(lo), -1, 3), part_hi.reshape(len(lo), -1, 3)
    new_lo = np.where(crossed, part_lo, np.inf).min(axis=1)
    new_hi = np.where(crossed, part_hi, -np.inf).max(axis=1)
    keep = np.isfinite(new_lo[:, 0])
    return new_lo[keep], new_hi[keep]


def _rounded(lo: Array, hi: Array) -> tuple[Array, Array]:
    """Outwards, to numbers that are short to write: a thousandth of the smallest side does no harm."""
    if not len(lo):
        return lo, hi
    step = 10.0 ** math.floor(math.log10(float((hi - lo).min()) * 1e-2))
    return np.round(np.floor(lo / step) * step, 12), np.round(np.ceil(hi / step) * step, 12)


def _steepest(surface: Surface, lo: Array, hi: Array) -> Array:
    """A bound on the gradient over each box, from its parts."""
    part_lo, part_hi = _parts(lo, hi)
    steep = np.zeros(len(part_lo))
    for tree, rows in _blocks(surface.field, part_lo, part_hi):
        steep[rows] = steepness(tree, part_lo[rows], part_hi[rows])
    return np.maximum(steep.reshape(len(lo), -1).max(axis=1) * (1.0 + 1e-9), 1e-30)


def _blocks(tree: Field, lo: Array, hi: Array) -> Iterator[tuple[Field, Ints]]:
    """The numbers of boxes that lie together, and what of the field is felt there: of many blobs, few are."""
    if not (isinstance(tree, Node) and tree.op in _DROPPING and len(tree.children) >= _MANY and len(lo) >= _TOGETHER):
        yield tree, np.arange(len(lo))
        return
    first, last = _extents(tree)
    sides = min(8, max(1, round((len(lo) / _TOGETHER) ** (1 / 3))))
    middle: Array = 0.5 * lo + 0.5 * hi
    share = (middle - middle.min(axis=0)) / np.maximum(np.ptp(middle, axis=0), 1e-300)
    block = np.minimum((share * sides).astype(np.int64), sides - 1) @ np.array([1, sides, sides * sides])
    order = np.argsort(block, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(block[order])) + 1):
        felt = ((first <= hi[rows].max(axis=0)) & (last >= lo[rows].min(axis=0))).all(axis=1)
        yield Node(tree.op, tuple(tree.children[i] for i in np.flatnonzero(felt).tolist())), rows


@lru_cache(maxsize=4)
def _extents(tree: Node) -> tuple[Array, Array]:
    """Of each child, the box in which it is felt: all of space for Gaussians."""
    boxes = [field.extent(child) for child in tree.children]
    ends = np.array([lo for lo, _ in boxes]), np.array([hi for _, hi in boxes])
    endless = [any(not np.isfinite(kernels.support(leaf.kernel)) for leaf in leaves(child)) for child in tree.children]
    ends[0][endless], ends[1][endless] = -np.inf, np.inf
    return ends


def _parts(lo: Array, hi: Array) -> tuple[Array, Array]:
    steps: Array = np.array(list(product(range(_PARTS), repeat=3)), dtype=np.float64)
    side = (hi - lo)[:, None] / _PARTS
    part = lo[:, None] + steps[None] * side
    return part.reshape(-1, 3), (part + side).reshape(-1, 3)


def _halved(lo: Array, hi: Array) -> tuple[Array, Array]:
    rows, axis = np.arange(len(lo)), np.argmax(hi - lo, axis=1)
    middle: Array = 0.5 * lo[rows, axis] + 0.5 * hi[rows, axis]
    left, right = hi.copy(), lo.copy()
    left[rows, axis], right[rows, axis] = middle, middle
    return np.concatenate([lo, right]), np.concatenate([left, hi])


# ---- what is felt where ------------------------------------------------------------------------


def _felt_count(tree: Field, lo: Array, hi: Array) -> Array:
    """How many elements, or simplices, are felt in boxes."""
    if isinstance(tree, Node):
        count = np.zeros(len(lo))
        for part, rows in _blocks(tree, lo, hi):
            assert isinstance(part, Node)
            for child in part.children:
                count[rows] += _felt_count(child, lo[rows], hi[rows])
        return count
    query, _ = _Felt(lo, hi).near(tree)
    return np.bincount(query, minlength=len(lo)).astype(np.float64)


class _Felt:
    """Prunes a field to what matters in each of some boxes."""

    def __init__(self, lo: Array, hi: Array) -> None:
        self.lo, self.hi = lo, hi

    def trees(self, tree: Field) -> list[Tree]:
        match tree:
            case Leaf(skeleton=Points() | Lines()):
                return self._terms(tree)
            case Leaf():
                return self._singles(tree)
            case Node(op, children):
                return self._groups(op, children)
            case _:
                assert_never(tree)

    def _mapped(self, leaf: Leaf) -> tuple[Array, Array]:
        middle, half = 0.5 * self.lo + 0.5 * self.hi, 0.5 * self.hi - 0.5 * self.lo
        if leaf.matrix is not None:
            middle = middle @ leaf.matrix[:, :3].T + leaf.matrix[:, 3]
            half = half @ np.abs(leaf.matrix[:, :3]).T
        return middle, half * (1.0 + 1e-12) + 1e-13 * np.abs(middle)

    def near(self, leaf: Leaf) -> tuple[Ints, Ints]:
        """Pairs of boxes and simplices: of points and lines those within reach, of others those that may be nearest."""
        middle, half = self._mapped(leaf)
        corners, felt = geometry.simplices(leaf.skeleton), felt_distance(leaf)
        radius = np.sqrt(np.sum(half**2, axis=1))
        many = isinstance(leaf.skeleton, Points | Lines)
        tree = geometry.build_tree(corners, felt if many else np.full(len(corners), felt[0]))
        limit = np.full(len(middle), np.inf)
        if not many:
            nearest = np.sqrt(np.sum(geometry.offsets(bare(leaf.skeleton), middle, felt[0] + radius) ** 2, axis=1))
            limit = (nearest + radius) * (1.0 + 1e-12)
        lists = list(
            geometry.pairs(
                tree, middle - half, middle + half, lambda q, gap2, reach: gap2 <= np.minimum(reach, limit[q]) ** 2
            )
        )
        query = np.concatenate([np.zeros(0, np.int64), *(q for q, _ in lists)])
        item = np.concatenate([np.zeros(0, np.int64), *(e for _, e in lists)])
        # boxes only touch boxes so far: now the distance from the middle itself
        gap = np.sqrt(np.sum(geometry.offset_to_simplices(middle[query], corners[item]) ** 2, axis=1)) - radius[query]
        keep = gap <= np.minimum(felt[item if many else np.zeros_like(item)], limit[query]) * (1.0 + 1e-12)
        query, item = query[keep], item[keep]
        order = np.lexsort((item, query))
        return query[order], item[order]

    def _lists(self, query: Ints, item: Ints) -> list[tuple[int, ...]]:
        ends = np.searchsorted(query, np.arange(len(self.lo) + 1))
        items = item.tolist()
        return [tuple(items[a:b]) for a, b in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)]

    def _terms(self, leaf: Leaf) -> list[Tree]:
        return [Terms(leaf, elements) for elements in self._lists(*self.near(leaf))]

    def _singles(self, leaf: Leaf) -> list[Tree]:
        lists = self._lists(*self.near(leaf))
        if not geometry.is_solid(leaf.skeleton):
            return [Single(leaf, simplices) for simplices in lists]
        middle, half = self._mapped(leaf)
        radius = np.sqrt(np.sum(half**2, axis=1))
        clear = np.sum(geometry.offsets(bare(leaf.skeleton), middle) ** 2, axis=1) > (radius * (1.0 + 1e-9)) ** 2
        inside = geometry.inside(leaf.skeleton, middle)
        sides = np.where(clear, np.where(inside, "inside", "outside"), "both").tolist()
        return [Single(leaf, simplices, side) for simplices, side in zip(lists, sides, strict=True)]

    def _groups(self, op: str, children: tuple[Field, ...]) -> list[Tree]:
        parts = [self.trees(child) for child in children]
        if op == "sum" or not children:
            return [Group(op, tuple(p for p in cell if not _is_nothing(p))) for cell in zip(*parts, strict=True)] or [
                Group(op, ()) for _ in self.lo
            ]
        keep = _counting(op, [field.bounds(child, self.lo, self.hi) for child in children])
        return [
            Group(op, tuple(part[i] for part, wins in zip(parts, keep, strict=True) if wins[i]))
            for i in range(len(self.lo))
        ]


def _counting(op: str, values: list[tuple[Array, Array]]) -> NDArray[np.bool_]:
    """(k, m) which children count in each box: those that can win, and all positive ones of a smooth joint."""
    low, high = np.array([value[0] for value in values]), np.array([value[1] for value in values])
    match op:
        case "max":
            return high >= low.max(axis=0)
        case "min":
            return low <= high.min(axis=0)
        case "smooth_max":
            return high > 0
        case _:
            return low < 0


@lru_cache(maxsize=32)
def bare(skeleton: Skeleton) -> Skeleton:
    """A skeleton whose distance is that to its simplices: of a solid, its skin."""
    if isinstance(skeleton, Polyhedron | Mesh):
        return Mesh(skeleton.points, skeleton.triangles, False)
    return skeleton


def _is_nothing(tree: Tree) -> bool:
    match tree:
        case Terms(_, elements):
            return not elements
        case Single(_, simplices, side):
            return not simplices and side != "inside"
        case Group(op, children):
            return not children or (op == "sum" and all(map(_is_nothing, children)))
