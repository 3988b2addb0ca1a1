"""The blobs of one surface as columns: solved with its threshold, painted, and their maps sorted out.

A map that keeps angles (moves, turns, mirrors, equal scales) scales the reach and moves the
skeleton; any other stays at its blob. A cloud is one row here, its columns are `cloud_columns`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.flatten import Row
from blobscript.solve import solve
from blobscript.values import Blob, Cloud, Paint

__all__ = ["Columns", "Misfit", "Setting", "cloud_columns", "gather", "similarity"]

Array = NDArray[np.float64]
Ints = NDArray[np.int32]
Indices = NDArray[np.intp]
PaintIndex = Callable[["Paint | tuple[Paint, ...] | None"], "int | Ints"]

#: A map counts as angle-keeping when its columns are orthogonal and equally long to this part.
_SIMILAR = 1e-12

#: Of what is wrong in a surface, so much is kept: enough to see every place in the script.
_MOST_KEPT = 100


@dataclass(frozen=True, slots=True)
class Misfit:
    """A blob whose numbers have no solution: a `solve.Problem` and the numbers as given."""

    problem: int
    origin: int
    kernel: ir.Kernel
    radius: float
    reach: float
    weight: float


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """What the surface gives to its blobs, and what is found out about them (the two lists)."""

    threshold: float
    paint_index: PaintIndex
    misfits: list[Misfit] = field(default_factory=list[Misfit])
    idle: list[int] = field(default_factory=list[int])


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """One entry for each row. `number` counts the kernels; `stays`: rows whose map does not keep
    angles. `mapped` (ascending) are the rows with a map, `matrices` (k, 3, 4) their maps."""

    rows: list[Row]
    kernels: list[ir.Kernel]
    number: Ints
    reach: Array
    weight: Array
    paint: Ints
    origin: Ints
    scale: Array
    stays: frozenset[int]
    mapped: Indices
    matrices: Array


def gather(rows: list[Row], setting: Setting) -> Columns:
    """The columns of all rows; those of clouds hold nothing yet but kernel, origin and scale."""
    kernels, number = _number_kernels(rows)
    origin = np.array([row[0].origin for row in rows], dtype=np.int32)
    is_cloud = np.array([type(row[0].skeleton) is Cloud for row in rows], dtype=bool)
    reach, weight = _solve_rows(rows, np.flatnonzero(~is_cloud), kernels, number, origin, setting)
    mapped = np.array([i for i, row in enumerate(rows) if row[1] is not None], dtype=np.intp)
    matrices = np.array([rows[i][1] for i in mapped], dtype=np.float64).reshape(-1, 3, 4)
    factor, similar = similarity(matrices)
    scale = np.ones(len(rows))
    scale[mapped] = np.where(similar, factor, 1.0)
    paint = [0 if type(row[0].skeleton) is Cloud else setting.paint_index(row[3]) for row in rows]
    return Columns(
        rows,
        kernels,
        number,
        reach * scale,
        weight,
        np.array(paint, dtype=np.int32),
        origin,
        scale,
        frozenset(mapped[~similar].tolist()),
        mapped,
        matrices,
    )


def _number_kernels(rows: list[Row]) -> tuple[list[ir.Kernel], Ints]:
    """Equal kernels get equal numbers; comparing them by identity first saves most of the work."""
    kernels: list[ir.Kernel] = []
    same: dict[int, int] = {}
    equal: dict[ir.Kernel, int] = {}
    result = np.empty(len(rows), dtype=np.int32)
    for i, row in enumerate(rows):
        kernel = row[4]
        number = same.get(id(kernel))
        if number is None:
            number = same[id(kernel)] = equal.setdefault(kernel, len(kernels))
            if number == len(kernels):
                kernels.append(kernel)
        result[i] = number
    return kernels, result


def _solve_rows(
    rows: list[Row], plain: Indices, kernels: list[ir.Kernel], number: Ints, origin: Ints, setting: Setting
) -> tuple[Array, Array]:
    """Reach and weight (with its factor) of the rows that are no clouds."""
    reach, weight = np.ones(len(rows)), np.ones(len(rows))
    blobs: list[Blob] = [rows[i][0] for i in plain]
    radii = np.array([blob.radius for blob in blobs], dtype=np.float64)
    reaches = np.array([blob.reach for blob in blobs], dtype=np.float64)
    weights = np.array([blob.weight for blob in blobs], dtype=np.float64)
    factors = np.array([rows[i][2] for i in plain], dtype=np.float64)
    for k, kernel in enumerate(kernels):
        here = np.flatnonzero(number[plain] == k)
        solved = _solved(kernel, radii[here], reaches[here], weights[here], origin[plain[here]], setting)
        reach[plain[here]] = solved[0]
        weight[plain[here]] = solved[1] * factors[here]
    return reach, weight


def _solved(
    kernel: ir.Kernel, radius: Array, reach: Array, weight: Array, origin: Ints, setting: Setting
) -> tuple[Array, Array]:
    solved_reach, solved_weight, problem = solve(kernel, setting.threshold, radius, reach, weight)
    for i in np.flatnonzero(problem)[:_MOST_KEPT]:
        given = float(radius[i]), float(reach[i]), float(weight[i])
        setting.misfits.append(Misfit(int(problem[i]), int(origin[i]), kernel, *given))
    return solved_reach, solved_weight


def cloud_columns(columns: Columns, i: int, setting: Setting) -> tuple[Array, Array, Ints, Ints]:
    """Reach, weight, paint and origin of the balls of row i."""
    blob, _, factor, paint, kernel = columns.rows[i]
    assert isinstance(blob.skeleton, Cloud)
    n = len(blob.skeleton.at)
    origin = np.full(n, blob.origin, dtype=np.int32)
    radius, reach, weight = (
        np.full(n, np.nan if x is None else x, dtype=np.float64) for x in (blob.radius, blob.reach, blob.weight)
    )
    reach, weight = _solved(kernel, radius, reach, weight, origin, setting)
    found = setting.paint_index(paint)
    paints = np.full(n, found, dtype=np.int32) if isinstance(found, int) else found
    return reach * columns.scale[i], weight * factor, paints, origin


def similarity(matrices: Array) -> tuple[Array, NDArray[np.bool_]]:
    """(scale factor, keeps angles?) of (n, 3, 4) maps."""
    linear = matrices[:, :, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        gram = np.einsum("nki,nkj->nij", linear, linear)
        square = gram[:, 0, 0]
        scale = np.sqrt(square)
        scale = np.where(np.abs(scale - 1) < 1e-15, 1.0, scale)
        error = np.abs(gram - square[:, None, None] * np.eye(3)).max(axis=(1, 2), initial=0.0)
        return scale, error <= _SIMILAR * square
