"""From the tree of field values to groups of blobs: the first half of assembly.

Factors, maps, paint and inherited kernels flow from the root to the blobs; paint with a texture takes along the maps
that came after it; a negative factor turns
`max` into `min`; sums in sums (and max in max, min in min) become one group; a sum, max or min with one
child is that child. Values may be shared, so the tree that they span can be far larger than what the
script made: `limit` bounds it. The walk keeps its own stack, so deep scripts are no problem.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from blobscript import ir
from blobscript.deep import make_room
from blobscript.values import Affine, Blob, Changed, Color, Combine, Field, Material, Paint, compose

__all__ = ["FOLDS", "Group", "Op", "Row", "TooBigError", "flatten"]

Op = ir.Op

#: blob, map to the scene, factor of the weight, paint, kernel
Row = tuple[Blob, Affine | None, float, "Look | None", ir.Kernel]
#: one paint, or one for each point of a cloud
Look = Paint | tuple[Paint, ...]

_FLIPPED: dict[Op, Op] = {
    "sum": "sum",
    "max": "min",
    "min": "max",
    "smooth_max": "smooth_min",
    "smooth_min": "smooth_max",
}
#: Nodes that are folds of two: below themselves they are one.
FOLDS = ("sum", "max", "min")

#: Groups in groups; passes over trees recurse, see `deep`.
_DEEPEST = 10_000


class TooBigError(Exception):
    """The scene has more parts, or nests deeper, than is allowed. `origin`: where it was noticed."""

    def __init__(self, message: str, origin: int) -> None:
        super().__init__(message)
        self.message = message
        self.origin = origin


@dataclass(slots=True, eq=False)
class Group:
    """Blobs and groups under one node; `has_zero`: one of its terms is 0 everywhere."""

    op: Op
    depth: int = 0  # groups around it
    rows: list[Row] = field(default_factory=list[Row])
    groups: list[Group] = field(default_factory=list["Group"])
    has_zero: bool = False

    @property
    def count(self) -> int:
        return len(self.rows) + len(self.groups) + self.has_zero


def flatten(root: Field, matrix: Affine | None, kernel: ir.Kernel, limit: int = 2_000_000) -> tuple[Group, list[int]]:
    """The group of a surface's field, and the origins of terms without effect (0 * f, weight 0)."""
    group = Group("sum")
    idle: list[int] = []
    stack: list[tuple[Field, Affine | None, float, Look | None, ir.Kernel, Group]] = [
        (root, matrix, 1.0, None, kernel, group)
    ]
    moved = _Mover()
    deepest = 0
    if _size(root) > limit:
        raise TooBigError(f"this surface has more than {limit} parts", root.origin)
    while stack:
        f, matrix, factor, paint, kernel, group_now = stack.pop()
        match f:
            case Blob():
                if factor == 0 or (isinstance(f.weight, float) and f.weight == 0.0):
                    group_now.has_zero = True
                    idle.append(f.origin)
                else:
                    group_now.rows.append((f, matrix, factor, moved(f.paint, matrix) or paint, f.kernel or kernel))
            case Changed():
                paint = moved(f.paint, matrix) or paint
                if f.matrix is not None:
                    matrix = f.matrix if matrix is None else compose(matrix, f.matrix)
                # paint flows down: what lies deeper wins
                stack.append((f.inner, matrix, factor * f.factor, paint, kernel, group_now))
            case Combine():
                inner = _group_for(f, factor, group_now)
                deepest = max(deepest, inner.depth)
                down = f.kernel or kernel
                stack.extend((child, matrix, factor, paint, down, inner) for child in reversed(f.children))
    make_room(deepest)
    _simplify(group)
    return group, idle


class _Mover:
    """Paint after what happened to the field once it had the paint: textures move along. The same paint under the
    same map stays one value."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, Affine | None], Look] = {}
        self._keep: list[Look] = []  # keeps the ids in `_known` valid

    def __call__(self, paint: Look | None, matrix: Affine | None) -> Look | None:
        if paint is None or matrix is None or isinstance(paint, Color):
            return paint
        key = (id(paint), matrix)
        if key not in self._known:
            self._known[key] = self._moved(paint, matrix)
            self._keep.append(paint)
        return self._known[key]

    def _moved(self, paint: Material | tuple[Paint, ...], matrix: Affine) -> Look:
        if isinstance(paint, tuple):
            each = [self(one, matrix) for one in paint]
            return tuple(one for one in each if one is not None and not isinstance(one, tuple))
        return paint.moved(matrix)


def _size(root: Field) -> int:
    """Nodes of the tree that a value spans, shared ones counted each time; quick, as it visits
    each value once."""
    sizes: dict[int, int] = {}
    stack = [root]
    while stack:
        f = stack[-1]
        below = f.children if isinstance(f, Combine) else (f.inner,) if isinstance(f, Changed) else ()
        waiting = [child for child in below if id(child) not in sizes]
        if waiting:
            stack += waiting
        else:
            sizes[id(f)] = 1 + sum([sizes[id(child)] for child in below])
            stack.pop()
    return sizes[id(root)]


def _group_for(f: Combine, factor: float, group: Group) -> Group:
    """Where the children of a node go: its own group, or the group around it."""
    op = _FLIPPED[f.op] if factor < 0 else f.op
    if not f.children:
        group.has_zero = True
        return group
    if op in FOLDS and (op == group.op or len(f.children) == 1):
        return group
    if group.depth >= _DEEPEST:
        raise TooBigError(f"fields nest deeper than {_DEEPEST} levels of sum, max and min", f.origin)
    inner = Group(op, group.depth + 1)
    group.groups.append(inner)
    return inner


def _simplify(group: Group) -> None:
    """Zeros leave sums; groups of one element give it to their parent (not smooth ones: they cut off what is
    negative)."""
    children, group.groups = group.groups, []
    for child in children:
        _simplify(child)
        if child.count == 0:
            group.has_zero = True
        elif child.count > 1 or child.op not in FOLDS:
            group.groups.append(child)
        else:
            _adopt(group, child)
    if group.op == "sum":
        group.has_zero = False


def _adopt(group: Group, child: Group) -> None:
    """Take over the only element of a child (and what is in it, if it is a group of our kind)."""
    group.has_zero |= child.has_zero
    group.rows += child.rows
    for inner in child.groups:
        if inner.op == group.op and inner.op in FOLDS:
            group.rows += inner.rows
            group.groups += inner.groups
            group.has_zero |= inner.has_zero
        else:
            group.groups.append(inner)
