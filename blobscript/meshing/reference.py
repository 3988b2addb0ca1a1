"""The specification of the mesher: marching cubes on a dense grid, in NumPy, without bounds or bricks.

Slow and plain; `tests/mesh` compares the tracer's meshes with it. Signs of all nodes, segments on all faces, loops
around all cells: these say how many vertices, components and handles there are, whatever the triangles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Dense", "dense", "loops"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Field = Callable[[Floats], Floats]

#: Corners of faces, counter-clockwise from outside: low and high side of x, y, z. Corner i lies at the bits of i.
_FACES = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
#: A saddle nearer to a side of its face than this is taken for the middle.
_EDGE = 0.01


@dataclass(frozen=True, slots=True)
class Dense:
    """vertices: edges of the grid that the surface crosses; segments: on faces; loops: around cells, each a disk;
    ambiguous: faces with two segments."""

    vertices: int
    segments: int
    loops: int
    ambiguous: int

    @property
    def euler(self) -> int:
        return self.vertices - self.segments + self.loops


def dense(field: Field, threshold: float, lo: Floats, cell: Floats, cells: tuple[int, int, int]) -> Dense:
    """The surface of a field (n, 3) -> (n,) on a grid of cells from the corner `lo` on."""
    axes = [lo[k] + cell[k] * np.arange(cells[k] + 1) for k in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    value = field(nodes.reshape(-1, 3)).reshape(nodes.shape[:3]) - threshold
    inside = value >= 0.0
    crossed = sum(int(np.count_nonzero(np.diff(inside.astype(np.int8), axis=k))) for k in range(3))
    segments, ambiguous = 0, 0
    joined: list[Bools] = []
    for axis in range(3):
        pairs, places, joins = _faces(field, threshold, value, nodes, axis, cell)
        segments += pairs
        ambiguous += len(places)
        joined.append(joins)
    return Dense(crossed, segments, _loop_count(inside, joined), ambiguous)


def _faces(
    field: Field, threshold: float, value: Floats, nodes: Floats, axis: int, cell: Floats
) -> tuple[int, Floats, Bools]:
    """Of the faces across an axis: how many segments, the saddles of ambiguous ones, and, for each face by its lowest
    node, whether its insides are joined."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    a, b, c, d = (_corner(value, axis, i, j) for i, j in ((0, 0), (1, 0), (0, 1), (1, 1)))
    signs = [x >= 0.0 for x in (a, b, d, c)]
    changes = np.sum([signs[i] != signs[(i + 1) % 4] for i in range(4)], axis=0, dtype=np.int64)
    both: Bools = changes == 4
    across = (a - b) + (d - c)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = [(a - c) / across, (a - b) / across]
    low = _corner(nodes, axis, 0, 0)
    at = low[both]
    for k, share in zip((u, v), shares, strict=True):
        within = (share[both] > _EDGE) & (share[both] < 1.0 - _EDGE)
        at[:, k] += np.where(within, share[both], 0.5) * cell[k]
    joins = np.zeros(both.shape, dtype=bool)
    if len(at):
        joins[both] = field(at) >= threshold
    return int(changes.sum()) // 2, at, joins


def _corner(array: Floats, axis: int, i: int, j: int) -> Floats:
    """The corner (i, j) of all faces across an axis, along the two axes behind it."""
    index: list[slice] = [slice(None)] * array.ndim
    for k, step in (((axis + 1) % 3, i), ((axis + 2) % 3, j)):
        index[k] = slice(step, array.shape[k] - 1 + step)
    return array[tuple(index)]


def _loop_count(inside: Bools, joined: list[Bools]) -> int:
    shape = tuple(n - 1 for n in inside.shape)
    mask = np.zeros(shape, dtype=np.int64)
    joins = np.zeros(shape, dtype=np.int64)
    for corner in range(8):
        part = tuple(slice(corner >> k & 1, inside.shape[k] - 1 + (corner >> k & 1)) for k in range(3))
        mask |= inside[part].astype(np.int64) << corner
    for face in range(6):
        axis, side = face // 2, face % 2
        part = tuple(slice(side, shape[k] + side) if k == axis else slice(None) for k in range(3))
        joins |= joined[axis][part].astype(np.int64) << face
    kinds, counts = np.unique(mask * 64 + joins, return_counts=True)
    return sum(len(loops(int(kind) // 64, int(kind) % 64)) * int(n) for kind, n in zip(kinds, counts, strict=True))


def loops(mask: int, joins: int) -> list[list[tuple[int, int]]]:
    """The closed loops of a cell, bit i of `mask`: corner i is inside, bit f of `joins`: the insides of face f hang
    together. Each is a list of edges (corner, corner)."""
    follow: dict[frozenset[int], frozenset[int]] = {}
    for number, face in enumerate(_FACES):
        leave = [i for i in range(4) if mask >> face[i] & 1 and not mask >> face[(i + 1) % 4] & 1]
        enter = [i for i in range(4) if not mask >> face[i] & 1 and mask >> face[(i + 1) % 4] & 1]
        for i in leave:
            gaps = {(j - i) % 4: j for j in enter}
            j = gaps[min(gaps) if joins >> number & 1 else max(gaps)]
            follow[_edge(face, i)] = _edge(face, j)
    found: list[list[tuple[int, int]]] = []
    while follow:
        start = min(follow, key=sorted)
        loop = [start]
        while (after := follow.pop(loop[-1])) != start:
            loop.append(after)
        found.append([(min(e), max(e)) for e in loop])
    return found


def _edge(face: tuple[int, ...], i: int) -> frozenset[int]:
    return frozenset((face[i], face[(i + 1) % 4]))
