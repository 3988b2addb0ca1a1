"""From groups of blobs to IR fields: the second half of assembly.

The blobs of a surface come as columns (`gather`). Under a sum, points of equal kernel and map
become one `Leaf`, and so do lines; everything else is a leaf of its own. A map that does not keep
angles stays at its leaf as a matrix from the scene to the skeleton.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.flatten import FOLDS, Group, Op, Row
from blobscript.gather import Columns, Misfit, PaintIndex, Setting, cloud_columns, gather
from blobscript.solve import LARGEST, Problem, in_range
from blobscript.transforms import map_skeleton
from blobscript.values import Affine, Cloud, Dot, Segment, Skeleton

__all__ = ["build_field"]

Array = NDArray[np.float64]
Ints = NDArray[np.int32]
Key = tuple[int, int, Affine | None]  # class of skeleton, kernel number, matrix that stays

_OTHER, _POINT, _LINE = 0, 1, 2

# ---- parts: blobs with equal key -----------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Blobs with equal key, ready to be merged; `points` are (n, 3), (n, 6) for lines, and empty
    where the part has a `skeleton` of its own."""

    key: Key
    skeleton: ir.Skeleton | None
    points: Array
    reach: Array
    weight: Array
    paint: Ints
    origin: Ints


def _parts(columns: Columns, setting: Setting, numbers: Iterable[int]) -> list[_Part]:
    """One part for each cloud and each other skeleton; points and lines by equal key."""
    groups: dict[Key, list[int]] = {}
    result: list[_Part] = []
    for i in numbers:
        blob, matrix, *_ = columns.rows[i]
        key = (_class(blob.skeleton), int(columns.number[i]), matrix if i in columns.stays else None)
        if isinstance(blob.skeleton, Cloud):
            result.append(_cloud(columns, setting, i, key))
        elif key[0] == _OTHER:
            result.append(_single(columns, i, key))
        else:
            groups.setdefault(key, []).append(i)
    return result + [_many(columns, np.array(members), key) for key, members in groups.items()]


def _class(skeleton: Skeleton) -> int:
    match skeleton:
        case Dot() | Cloud():
            return _POINT
        case Segment():
            return _LINE
        case _:
            return _OTHER


def _many(columns: Columns, members: NDArray[np.intp], key: Key) -> _Part:
    """Points or lines from their own values."""
    numbers: list[int] = members.tolist()
    skeletons = [columns.rows[i][0].skeleton for i in numbers]
    if key[0] == _POINT:
        points = np.array([s.at for s in skeletons if isinstance(s, Dot)], dtype=np.float64)
    else:
        points = np.array([s.a + s.b for s in skeletons if isinstance(s, Segment)], dtype=np.float64)
    if key[2] is None:
        _move(columns, points, members)
    c = columns
    return _Part(key, None, points, c.reach[members], c.weight[members], c.paint[members], c.origin[members])


def _move(columns: Columns, points: Array, members: NDArray[np.intp]) -> None:
    """Apply the maps of those members that have one to their points, in place."""
    moved = np.flatnonzero(np.isin(members, columns.mapped))
    matrices = columns.matrices[np.searchsorted(columns.mapped, members[moved])]
    for k in range(0, points.shape[1], 3):
        part = points[moved, k : k + 3]
        points[moved, k : k + 3] = np.einsum("nij,nj->ni", matrices[:, :, :3], part) + matrices[:, :, 3]


def _placed_skeleton(columns: Columns, i: int) -> Skeleton:
    """The skeleton of a row where it stands in the scene, unless its map stays."""
    blob, matrix, *_ = columns.rows[i]
    return blob.skeleton if matrix is None or i in columns.stays else map_skeleton(blob.skeleton, matrix)


def _single(columns: Columns, i: int, key: Key) -> _Part:
    skeleton = _placed_skeleton(columns, i)
    assert not isinstance(skeleton, (Dot, Segment, Cloud))
    one = slice(i, i + 1)
    c = columns
    return _Part(key, skeleton, np.empty((0, 3)), c.reach[one], c.weight[one], c.paint[one], c.origin[one])


def _cloud(columns: Columns, setting: Setting, i: int, key: Key) -> _Part:
    skeleton = _placed_skeleton(columns, i)
    assert isinstance(skeleton, Cloud)
    return _Part(key, None, skeleton.at, *cloud_columns(columns, i, setting))


def _merged(parts: list[_Part]) -> _Part:
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


# ---- leaves --------------------------------------------------------------------------


def _leaves(columns: Columns, setting: Setting, numbers: Iterable[int]) -> list[ir.Leaf]:
    """The rows with these numbers, parts of equal key merged into one leaf each."""
    groups: dict[Key, list[_Part]] = {}
    ready: list[_Part] = []
    for part in _parts(columns, setting, numbers):
        part = _without_zeros(part, setting)
        if part.skeleton is None:
            groups.setdefault(part.key, []).append(part)
        else:
            ready.append(part)
    ready += [_merged(members) for members in groups.values()]
    return [_leaf(columns, setting, part) for part in ready if len(part.weight)]


def _without_zeros(part: _Part, setting: Setting) -> _Part:
    """Blobs that vanish (weight 0 in a list, or an underflow) are left out."""
    there = part.weight != 0
    if there.all():
        return part
    setting.idle.extend(part.origin[~there].tolist()[:100])
    return replace(
        part,
        points=part.points[there] if part.skeleton is None else part.points,
        reach=part.reach[there],
        weight=part.weight[there],
        paint=part.paint[there],
        origin=part.origin[there],
    )


def _leaf(columns: Columns, setting: Setting, part: _Part) -> ir.Leaf:
    skeleton = _bulk(part) if part.skeleton is None else part.skeleton
    leaf = ir.Leaf(
        skeleton,
        columns.kernels[part.key[1]],
        np.ascontiguousarray(part.reach),
        np.ascontiguousarray(part.weight),
        np.ascontiguousarray(part.paint),
        np.ascontiguousarray(part.origin),
        None if part.key[2] is None else _inverse(part.key[2]),
    )
    if not setting.misfits:  # numbers without solution are out of range, too
        setting.misfits.extend(_out_of_range(leaf))
    return leaf


def _bulk(part: _Part) -> ir.Skeleton:
    if part.key[0] == _POINT:
        return ir.Points(np.ascontiguousarray(part.points))
    return ir.Lines(np.ascontiguousarray(part.points[:, :3]), np.ascontiguousarray(part.points[:, 3:]))


def _inverse(matrix: Affine) -> Array:
    """From the scene to the skeleton; not a number where the map flattens beyond all precision."""
    square = np.vstack((np.array(matrix).reshape(3, 4), (0.0, 0.0, 0.0, 1.0)))
    try:
        return np.ascontiguousarray(np.linalg.inv(square)[:3])
    except np.linalg.LinAlgError:
        return np.full((3, 4), np.nan)


def _out_of_range(leaf: ir.Leaf) -> list[Misfit]:
    """Factors and maps may have carried a number out of the range of double precision."""
    fine = in_range(leaf.reach, leaf.weight)
    if not (_places_in_range(leaf.skeleton) and _matrix_in_range(leaf.matrix)):
        fine[:] = False
    return [
        Misfit(Problem.RANGE, int(leaf.origin[i]), leaf.kernel, np.nan, float(leaf.reach[i]), float(leaf.weight[i]))
        for i in np.flatnonzero(~fine)[:1]
    ]


def _places_in_range(skeleton: ir.Skeleton) -> bool:
    match skeleton:
        case ir.Points(at):
            arrays = (at,)
        case ir.Lines(a, b):
            arrays = (a, b)
        case _:
            arrays = (skeleton.points,)
    return all(bool((np.abs(x) <= LARGEST).all()) for x in arrays)


def _matrix_in_range(matrix: Array | None) -> bool:
    if matrix is None:
        return True
    return bool((np.abs(matrix) <= LARGEST).all()) and abs(float(np.linalg.det(matrix[:, :3]))) >= LARGEST**-3


# ---- the tree ------------------------------------------------------------------------


def build_field(group: Group, threshold: float, paint_index: PaintIndex) -> tuple[ir.Field, list[Misfit], list[int]]:
    """The IR of a group; the blobs without solution; the origins of blobs without effect."""
    rows: list[Row] = []
    plan = _collect(group, rows)
    setting = Setting(threshold, paint_index)
    tree = _build(plan, gather(rows, setting), setting)
    return tree, setting.misfits, setting.idle


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """A group whose blobs are rows of the columns."""

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


def _build(plan: _Plan, columns: Columns, setting: Setting) -> ir.Field:
    numbers = range(plan.start, plan.end)
    if plan.group.op == "sum":
        children: list[ir.Field] = [*_leaves(columns, setting, numbers)]
    else:
        children = [_one(columns, setting, i) for i in numbers]
    children += [_build(inner, columns, setting) for inner in plan.inner]
    if plan.group.has_zero:
        children.append(_NOTHING)
    return _node(plan.group.op, children)


def _one(columns: Columns, setting: Setting, i: int) -> ir.Field:
    """A child of max or min; a cloud is one child, the sum of its balls."""
    leaves = _leaves(columns, setting, [i])
    return leaves[0] if leaves else _NOTHING


def _node(op: Op, children: list[ir.Field]) -> ir.Field:
    """A node in canonical form."""
    flat: list[ir.Field] = []
    for child in children:
        if isinstance(child, ir.Node) and child.op == op and op in FOLDS:
            flat += child.children
        else:
            flat.append(child)
    if op != "sum" and any(child is _NOTHING for child in flat):
        flat = [child for child in flat if child is not _NOTHING] + [_NOTHING]
    if not flat:
        return _NOTHING
    if len(flat) > 1:
        return ir.Node(op, tuple(flat))
    cut = ir.cut_off(op, flat[0])
    return flat[0] if cut is None else _node(cut, [flat[0], _NOTHING])
