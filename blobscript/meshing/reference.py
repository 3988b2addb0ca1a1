"""The specification of the mesher: marching cubes on a dense grid, in NumPy, without bounds or bricks.

Slow and plain; `tests/mesh` compares the tracer's meshes with it. It shares nothing with the C but the numbering of
corners: signs of all nodes, segments on faces, loops around cells.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["crossed_edges", "dense_signs", "loops"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def dense_signs(field: Callable[[Floats], Floats], threshold: float, lo: Floats, cell: Floats, cells: Floats) -> Bools:
    """Is each node (nx + 1, ny + 1, nz + 1) of a grid inside?"""
    axes = [lo[k] + cell[k] * np.arange(int(cells[k]) + 1) for k in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return (field(nodes.reshape(-1, 3)) >= threshold).reshape(nodes.shape[:3])


def crossed_edges(inside: Bools) -> int:
    """How many edges of the grid the surface crosses: the vertices of the mesh."""
    return sum(int(np.count_nonzero(np.diff(inside.astype(np.int8), axis=k))) for k in range(3))


#: Corners of faces, counter-clockwise from outside: low and high side of x, y, z.
_FACES = [
    [0, 4, 6, 2],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 2, 3, 1],
    [4, 5, 7, 6],
]


def loops(mask: int, joins: int) -> list[list[tuple[int, int]]]:
    """The closed loops of a cell, bit i of `mask`: corner i is inside, bit f of `joins`: the insides of face f hang
    together. Each is a list of edges (corner, corner), counter-clockwise seen from outside."""
    follow: dict[frozenset[int], frozenset[int]] = {}
    for number, face in enumerate(_FACES):
        leave = [i for i in range(4) if mask >> face[i] & 1 and not mask >> face[(i + 1) % 4] & 1]
        enter = [i for i in range(4) if not mask >> face[i] & 1 and mask >> face[(i + 1) % 4] & 1]
        for i in leave:
            gaps = {(j - i) % 4: j for j in enter}
            j = gaps[min(gaps) if joins >> number & 1 else max(gaps)]
            # seen from outside the cell, the inside lies to the right of the segment from i to j
            follow[_edge(face, j)] = _edge(face, i)
    found: list[list[tuple[int, int]]] = []
    while follow:
        start = min(follow, key=sorted)
        loop = [start]
        while (after := follow.pop(loop[-1])) != start:
            loop.append(after)
        found.append([(min(e), max(e)) for e in loop])
    return found


def _edge(face: list[int], i: int) -> frozenset[int]:
    return frozenset((face[i], face[(i + 1) % 4]))
