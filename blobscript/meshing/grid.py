"""Where the cells of a mesh lie: the box of a surface, the size of cells, what that takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["REFINEMENTS", "Grid", "around", "clipped", "estimate"]

Floats = NDArray[np.float64]
Box = tuple[Floats, Floats]

#: Cells may be halved that often where they may hide something.
REFINEMENTS = 2
#: How far the first nodes within a clip box are from its sides, in cells: close enough for sharp edges.
_INSET = 0.02
#: Cells beyond a box on either side.
_MARGIN = 1.37
#: Most cells along a side, as many as the tracer numbers.
LARGEST = 1 << 24


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Cells of the size `cell` (3,) from the corner `lo` on, scene units; `cells` (3,) of them along each axis.

    They may be halved `levels` times, where they may hide something or where triangles are farther than `tolerance`
    from the surface (0: never for that). `clip`: a box that the solid is cut to.
    """

    lo: Floats
    cell: Floats
    cells: tuple[int, int, int]
    levels: int = 0
    tolerance: float = 0.0
    clip: Box | None = None


def around(box: Box, cell: float, levels: int = REFINEMENTS, tolerance: float = 0.0) -> Grid:
    """Cubic cells around a box, with more than a cell beyond each side.

    The margin is no whole number of cells: scripts like round numbers, and so fewer nodes lie exactly on surfaces.
    """
    lo, hi = box
    start = lo - _MARGIN * cell
    cells = np.ceil((hi - start) / cell + 1.0)
    x, y, z = (int(n) for n in cells)
    return Grid(start, np.full(3, cell), (x, y, z), levels, tolerance)


def clipped(box: Box, cell: float, levels: int = REFINEMENTS, tolerance: float = 0.0) -> Grid:
    """Cells, at most of size `cell`, whose nodes come close to the sides of the box from both sides."""
    lo, hi = box
    inner = np.maximum(np.ceil((hi - lo) / cell), 2.0)
    size = (hi - lo) / (inner + 2.0 * _INSET)
    x, y, z = (int(n) + 2 for n in inner)
    return Grid(lo + (_INSET - 1.0) * size, size, (x, y, z), levels, tolerance, (lo, hi))


def estimate(grid: Grid) -> float:
    """Bytes that a mesh takes whose surface is about as large as the sides of its grid."""
    x, y, z = (float(n) for n in grid.cells)
    cells = 1.5 * (x * y + y * z + z * x)
    return 230.0 * cells if math.isfinite(cells) else math.inf
