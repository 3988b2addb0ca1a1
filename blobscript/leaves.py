"""From groups of blobs to IR fields: the second half of assembly.

All blobs of a surface are gathered into columns, solved together (`solve`), mapped together, and
merged: under a sum, points of equal kernel become one `Leaf`, and so do lines. A map that keeps
angles (moves, turns, mirrors, equal scales) is applied to the skeleton and the reach; any other
stays at its leaf as a matrix from the scene to the skeleton.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.flatten import Group, Row
from blobscript.solve import LARGEST, Problem, solve
from blobscript.transforms import map_skeleton
from blobscript.values import Affine, Blob, Cloud, Dot, Paint, Segment

__all__ = ["Misfit", "build_field"]

Array = NDArray[np.float64]
Ints = NDArray[np.int32]
Key = tuple[int, int, Affine | None]  # class of skeleton, kernel number, matrix that stays

#: A map counts as angle-keeping when its columns are orthogonal and equally long to this part.
_SIMILAR = 1e-12

_OTHER, _POINT, _LINE = 0, 1, 2


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
class _Part:
    """Blobs with equal key, ready to be merged; `points` are (n, 3) or (n, 6) for lines."""

    key: Key
    skeleton: ir.Skeleton | None
    points: Array
    reach: Array
    weight: Array
    paint: Ints
    origin: Ints


PaintIndex = Callable[["Paint | tuple[Paint, ...] | None"], "int | Ints"]


class _Builder:
    """State of one surface's build: its blobs by number, and what was wrong with them."""

    def __init__(self, rows: list[Row], threshold: float, paint_index: PaintIndex) -> None:
        self.kernels: list[ir.Kernel] = []
        self.threshold = threshold
        self.misfits: list[Misfit] = []
        self.idle: list[int] = []
        self.paint_index = paint_index
        self.rows = rows
        self._numbers = self._number_kernels()
        self._columns()
        self._solve_all()
        self._map_all()

    # -- columns: one value per row, NaN where absent or where the row is a cloud

    def _number_kernels(self) -> Ints:
        numbers: dict[int, int] = {}
        equal: dict[ir.Kernel, int] = {}
        result = np.empty(len(self.rows), dtype=np.int32)
        for i, row in enumerate(self.rows):
            kernel = row[4]
            number = numbers.get(id(kernel))
            if number is None:
                number = equal.setdefault(kernel, len(self.kernels))
                numbers[id(kernel)] = number
                if number == len(self.kernels):
                    self.kernels.append(kernel)
            result[i] = number
        return result

    def _columns(self) -> None:
        blobs = [row[0] for row in self.rows]
        self.clouds = {i for i, b in enumerate(blobs) if type(b.skeleton) is Cloud}
        plain = [_NO_SIZES if i in self.clouds else b for i, b in enumerate(blobs)] if self.clouds else blobs
        self.radius = np.array([b.radius for b in plain], dtype=np.float64)
        self.given_reach = np.array([b.reach for b in plain], dtype=np.float64)
        self.given_weight = np.array([b.weight for b in plain], dtype=np.float64)
        self.factor = np.array([row[2] for row in self.rows], dtype=np.float64)
        self.origin = np.array([b.origin for b in blobs], dtype=np.int32)
        paints = [0 if i in self.clouds else self.paint_index(row[3]) for i, row in enumerate(self.rows)]
        self.paint = np.array(paints, dtype=np.int32)

    def _solve_all(self) -> None:
        self.reach = np.ones(len(self.rows))
        self.weight = np.ones(len(self.rows))
        is_plain = np.ones(len(self.rows), dtype=bool)
        is_plain[list(self.clouds)] = False
        for number, kernel in enumerate(self.kernels):
            here = np.flatnonzero(is_plain & (self._numbers == number))
            if len(here):
                given = self.radius[here], self.given_reach[here], self.given_weight[here]
                reach, weight = self._solve(kernel, *given, self.origin[here])
                self.reach[here] = reach
                self.weight[here] = weight * self.factor[here]

    def _solve(
        self, kernel: ir.Kernel, radius: Array, reach: Array, weight: Array, origin: Ints
    ) -> tuple[Array, Array]:
        solved_reach, solved_weight, problem = solve(kernel, self.threshold, radius, reach, weight.copy())
        for i in np.flatnonzero(problem)[:100]:
            self.misfits.append(
                Misfit(int(problem[i]), int(origin[i]), kernel, float(radius[i]), float(reach[i]), float(weight[i]))
            )
        return solved_reach, solved_weight

    # -- maps

    def _map_all(self) -> None:
        """Which maps keep angles, and by how much they scale."""
        self.scale = np.ones(len(self.rows))
        self.stays: set[int] = set()
        mapped = [i for i, row in enumerate(self.rows) if row[1] is not None]
        self.mapped = np.array(mapped, dtype=np.intp)
        matrices = np.array([self.rows[i][1] for i in mapped], dtype=np.float64).reshape(-1, 3, 4)
        self.matrices = matrices
        scale, similar = similarity(matrices)
        self.scale[self.mapped] = np.where(similar, scale, 1.0)
        self.stays = set(self.mapped[~similar].tolist())
        self.reach = self.reach * self.scale

    def key(self, i: int) -> Key:
        blob, matrix, *_ = self.rows[i]
        match blob.skeleton:
            case Dot() | Cloud():
                kind = _POINT
            case Segment():
                kind = _LINE
            case _:
                kind = _OTHER
        return kind, int(self._numbers[i]), matrix if i in self.stays else None

    # -- parts

    def parts(self, numbers: Iterable[int]) -> list[_Part]:
        """One part for each cloud and each other skeleton; points and lines by equal key."""
        groups: dict[Key, list[int]] = {}
        result: list[_Part] = []
        for i in numbers:
            key = self.key(i)
            if i in self.clouds:
                result.append(self._cloud(i, key))
            elif key[0] == _OTHER:
                result.append(self._single(i, key))
            else:
                groups.setdefault(key, []).append(i)
        result += [self._many(key, np.array(members)) for key, members in groups.items()]
        return result

    def _many(self, key: Key, members: NDArray[np.intp]) -> _Part:
        skeletons = [self.rows[i][0].skeleton for i in members]
        if key[0] == _POINT:
            points = np.array([s.at for s in skeletons], dtype=np.float64).reshape(-1, 3)  # type: ignore[union-attr]
        else:
            points = np.array([s.a + s.b for s in skeletons], dtype=np.float64)  # type: ignore[union-attr]
        if key[2] is None:
            self._move(points, members)
        return _Part(
            key, None, points, self.reach[members], self.weight[members], self.paint[members], self.origin[members]
        )

    def _move(self, points: Array, members: NDArray[np.intp]) -> None:
        """Apply the members' maps to their points, in place."""
        at = np.searchsorted(self.mapped, members)
        found = np.flatnonzero(at < len(self.mapped))
        found = found[self.mapped[at[found]] == members[found]]
        matrices = self.matrices[at[found]]
        for k in range(0, points.shape[1], 3):
            part = points[found, k : k + 3]
            points[found, k : k + 3] = np.einsum("nij,nj->ni", matrices[:, :, :3], part) + matrices[:, :, 3]

    def _single(self, i: int, key: Key) -> _Part:
        skeleton = self.rows[i][0].skeleton
        matrix = self.rows[i][1]
        if matrix is not None and key[2] is None:
            skeleton = map_skeleton(skeleton, matrix)
        m = slice(i, i + 1)
        nothing = np.empty((0, 3))
        return _Part(key, skeleton, nothing, self.reach[m], self.weight[m], self.paint[m], self.origin[m])  # type: ignore[arg-type]

    def _cloud(self, i: int, key: Key) -> _Part:
        blob, matrix, factor, paint, kernel = self.rows[i]
        assert isinstance(blob.skeleton, Cloud)
        skeleton = blob.skeleton
        if matrix is not None and key[2] is None:
            skeleton = map_skeleton(skeleton, matrix)
        points: Array = skeleton.at  # type: ignore[union-attr]
        n = len(points)
        origin = np.full(n, blob.origin, dtype=np.int32)
        reach, weight = self._solve(
            kernel, _column(blob.radius, n), _column(blob.reach, n), _column(blob.weight, n), origin
        )
        found = self.paint_index(paint)
        paints = np.full(n, found, dtype=np.int32) if isinstance(found, int) else found
        return _Part(key, None, points, reach * self.scale[i], weight * factor, paints, origin)

    # -- leaves

    def leaves(self, parts: list[_Part]) -> list[ir.Leaf]:
        """Parts of equal key merged into one leaf each."""
        groups: dict[Key, list[_Part]] = {}
        result: list[ir.Leaf] = []
        for part in map(self._without_zeros, parts):
            if part.skeleton is not None:
                if len(part.weight):
                    result.append(self._leaf(part, part.skeleton))
            else:
                groups.setdefault(part.key, []).append(part)
        for members in groups.values():
            part = _merge(members)
            if len(part.weight):
                result.append(self._leaf(part, _bulk(part)))
        return result

    def _without_zeros(self, part: _Part) -> _Part:
        """Blobs that vanish (weight 0 in a list, or an underflow) are left out."""
        there = part.weight != 0
        if there.all():
            return part
        self.idle += part.origin[~there].tolist()[:100]
        return replace(
            part,
            points=part.points[there] if part.skeleton is None else part.points,
            reach=part.reach[there],
            weight=part.weight[there],
            paint=part.paint[there],
            origin=part.origin[there],
        )

    def _leaf(self, part: _Part, skeleton: ir.Skeleton) -> ir.Leaf:
        matrix = None if part.key[2] is None else _inverse(part.key[2])
        self._check_range(part, skeleton, matrix)
        return ir.Leaf(
            skeleton,
            self.kernels[part.key[1]],
            np.ascontiguousarray(part.reach),
            np.ascontiguousarray(part.weight),
            np.ascontiguousarray(part.paint),
            np.ascontiguousarray(part.origin),
            matrix,
        )

    def _check_range(self, part: _Part, skeleton: ir.Skeleton, matrix: Array | None) -> None:
        """Factors and maps may have carried a number out of the range of double precision."""
        if self.misfits:
            return  # numbers without solution are out of range, too
        fine = (np.abs(part.weight) <= LARGEST) & (part.reach <= LARGEST) & (part.reach >= 1 / LARGEST)
        arrays = [matrix] if matrix is not None else []
        arrays += [x for x in (getattr(skeleton, name, None) for name in ("at", "a", "b", "points")) if x is not None]
        if not all(bool((np.abs(x) <= LARGEST).all()) for x in arrays):
            fine[:] = False
        if matrix is not None and not abs(np.linalg.det(matrix[:, :3])) >= LARGEST**-3:
            fine[:] = False
        for i in np.flatnonzero(~fine)[:1]:
            kernel, origin = self.kernels[part.key[1]], int(part.origin[i])
            reach, weight = float(part.reach[i]), float(part.weight[i])
            self.misfits.append(Misfit(Problem.RANGE, origin, kernel, np.nan, reach, weight))


def _inverse(matrix: Affine) -> Array:
    """From the scene to the skeleton; not a number where the map flattens beyond all precision."""
    square = np.vstack((np.array(matrix).reshape(3, 4), (0.0, 0.0, 0.0, 1.0)))
    try:
        return np.ascontiguousarray(np.linalg.inv(square)[:3])
    except np.linalg.LinAlgError:
        return np.full((3, 4), np.nan)


_NO_SIZES = Blob(Dot((0.0, 0.0, 0.0)), None, None, None, None, None, -1)


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


def _column(value: float | Array | None, n: int) -> Array:
    return np.full(n, np.nan if value is None else value, dtype=np.float64)


def _bulk(part: _Part) -> ir.Skeleton:
    if part.key[0] == _POINT:
        return ir.Points(np.ascontiguousarray(part.points))
    return ir.Lines(np.ascontiguousarray(part.points[:, :3]), np.ascontiguousarray(part.points[:, 3:]))


def _merge(parts: list[_Part]) -> _Part:
    if len(parts) == 1:
        return parts[0]
    return replace(
        parts[0],
        points=np.concatenate([p.points for p in parts]),
        reach=np.concatenate([p.reach for p in parts]),
        weight=np.concatenate([p.weight for p in parts]),
        paint=np.concatenate([p.paint for p in parts]),
        origin=np.concatenate([p.origin for p in parts]),
    )


# ---- the tree ------------------------------------------------------------------------


def build_field(group: Group, threshold: float, paint_index: PaintIndex) -> tuple[ir.Field, list[Misfit], list[int]]:
    """The IR of a group; the blobs without solution; the origins of blobs without effect."""
    rows: list[Row] = []
    plan = _collect(group, rows)
    builder = _Builder(rows, threshold, paint_index)
    return _build(plan, builder), builder.misfits, builder.idle


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """A group whose blobs are numbers into the builder's rows."""

    group: Group
    start: int
    end: int
    inner: tuple[_Plan, ...]


def _collect(group: Group, rows: list[Row]) -> _Plan:
    start = len(rows)
    rows += group.rows
    end = len(rows)
    return _Plan(group, start, end, tuple(_collect(inner, rows) for inner in group.groups))


_NOTHING = ir.Node("sum", ())


def _build(plan: _Plan, builder: _Builder) -> ir.Field:
    numbers = range(plan.start, plan.end)
    if plan.group.op == "sum":
        children: list[ir.Field] = [*builder.leaves(builder.parts(numbers))]
    else:
        children = [_one(builder, i) for i in numbers]
    children += [_build(inner, builder) for inner in plan.inner]
    if plan.group.has_zero:
        children.append(_NOTHING)
    return _node(plan.group.op, children)


def _one(builder: _Builder, i: int) -> ir.Field:
    """A child of max or min; a cloud is one child, the sum of its balls."""
    leaves = builder.leaves(builder.parts([i]))
    return leaves[0] if leaves else _NOTHING


def _node(op: str, children: list[ir.Field]) -> ir.Field:
    """A node in canonical form."""
    flat: list[ir.Field] = []
    for child in children:
        if isinstance(child, ir.Node) and child.op == op:
            flat += child.children
        else:
            flat.append(child)
    if op != "sum" and any(child is _NOTHING for child in flat):
        flat = [child for child in flat if child is not _NOTHING] + [_NOTHING]
    if not flat:
        return _NOTHING
    return flat[0] if len(flat) == 1 else ir.Node(op, tuple(flat))  # type: ignore[arg-type]
