"""Skeletons from lists of points: what is degenerate is refused, the rest is brought to IR form."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.arguments import count_text, show
from blobscript.diagnostics import Help
from blobscript.overlaps import first_overlap
from blobscript.triangulate import clip_ears, first_crossing
from blobscript.values import Dot, MakerError, Segment, Skeleton

__all__ = ["mesh", "point_set", "polygon", "polyhedron", "polyline", "welded"]

Array = NDArray[np.float64]
Ints = NDArray[np.int32]
Faces = Sequence[Sequence[int]] | NDArray[np.integer]

#: A polygon lies within this part of its diameter of a plane; points closer to a line are on it.
_PLANAR = 1e-9
_STRAIGHT = 1e-14
#: Clipping ears takes quadratic time; more points than this belong into a mesh.
_LARGEST_POLYGON = 5000
#: Triangles at once where more are only added up.
_ROWS = 65_536
#: Solids of more triangles are believed not to pass through themselves: finding out takes seconds.
_CHECKED = 20_000


# ---- points and lines ----------------------------------------------------------------


def point_set(points: Array) -> Skeleton:
    """Many points as one skeleton: a mesh of triangles that have shrunk to points."""
    if not len(points):
        raise MakerError("E0404", "`points` has no points", helps=(Help("a skeleton needs at least one point"),))
    if len(points) == 1:
        return Dot(_tuple(points[0]))
    corners = np.repeat(np.arange(len(points), dtype=np.int32)[:, None], 3, axis=1)
    return ir.Mesh(points, corners, solid=False)


def polyline(points: Array, closed: bool) -> Skeleton:
    """Repeated points are dropped; one point is a point, two are a line."""
    if not len(points):
        raise MakerError(
            "E0404",
            "`polyline` has no points",
            argument="points",
            label="empty",
            helps=(Help("a polyline needs at least one point, better two"),),
        )
    kept = points[_kept(points, closed)]
    if len(kept) == 1:
        return Dot(_tuple(kept[0]))
    if len(kept) == 2:
        return Segment(_tuple(kept[0]), _tuple(kept[1]))
    return ir.Polyline(np.ascontiguousarray(kept), bool(closed))


def _kept(points: Array, closed: bool) -> NDArray[np.intp]:
    """Indices without consecutive repetitions."""
    differs = np.any(points != np.roll(points, 1, axis=0), axis=1)
    if not closed or not differs.any():
        differs[0] = True
    return np.flatnonzero(differs)


def _tuple(p: Array) -> tuple[float, float, float]:
    return float(p[0]), float(p[1]), float(p[2])


# ---- polygons ------------------------------------------------------------------------


def polygon(points: Array) -> ir.Polygon:
    """A flat, simple polygon and its triangles."""
    kept = _kept(points, closed=True) if len(points) else np.arange(0)
    if len(kept) < 3:
        found = count_text(len(kept), "different point") if len(kept) else "none"
        raise MakerError("E0404", f"`polygon` needs three points, but it has {found}", "points")
    if len(kept) > _LARGEST_POLYGON:
        raise MakerError(
            "E0404",
            f"this polygon has {len(kept)} points; up to {_LARGEST_POLYGON} are allowed",
            "points",
            helps=(Help("use `mesh` for shapes of that size"),),
        )
    corners = np.ascontiguousarray(points[kept])
    flat = _project(corners)
    crossing = first_crossing(flat)
    if crossing:
        raise _crossing(corners, kept, *crossing)
    return ir.Polygon(corners, np.array(clip_ears(flat, False), dtype=np.int32).reshape(-1, 3))


def _project(corners: Array) -> Array:
    """(n, 2): the plane of the points, seen along the axis closest to its normal."""
    centred = corners - corners.mean(axis=0)
    diameter = float(np.ptp(corners, axis=0).max())
    _, sizes, axes = np.linalg.svd(centred / diameter, full_matrices=False)
    if sizes[1] <= _STRAIGHT * len(corners):
        raise MakerError(
            "E0404",
            "all points of this polygon lie on one line",
            "points",
            helps=(Help("use `polyline` for a line without area"),),
        )
    height = np.abs(centred @ axes[2])
    if height.max() > _PLANAR * diameter:
        worst = int(np.argmax(height))
        raise MakerError(
            "E0404",
            f"this polygon is not flat: {show(corners[worst])} is {show(height[worst])} off its plane",
            "points",
            helps=(Help("move the point into the plane, or make triangles with `mesh`"),),
        )
    return np.delete(corners, int(np.argmax(np.abs(axes[2]))), axis=1)


def _crossing(corners: Array, names: NDArray[np.intp], i: int, j: int) -> MakerError:
    def edge(k: int) -> str:
        end = (k + 1) % len(corners)
        return f"{show(corners[k])}–{show(corners[end])}"

    def numbers(k: int) -> str:
        return f"{names[k]}–{names[(k + 1) % len(names)]}"

    return MakerError(
        "E0404",
        f"edges of this polygon cross: {edge(i)} and {edge(j)}",
        "points",
        f"the edges of points {numbers(i)} and {numbers(j)} (counted from 0) meet",
        (Help("list the points in the order in which you walk around the area"),),
    )


# ---- faces ---------------------------------------------------------------------------


def polyhedron(points: Array, faces: Faces) -> ir.Polyhedron:
    """A closed body; its faces all look outward (or all inward: then they are turned)."""
    triangles = _triangles(points, faces, "the polyhedron")
    points, triangles = _close(points, triangles, "a polyhedron", weld=False)
    return ir.Polyhedron(points, triangles, _is_convex(points, triangles))


def mesh(points: Array, faces: Faces, solid: bool, what: str) -> ir.Mesh:
    """A surface of polygons; a solid one must be closed (repeated points count as one)."""
    triangles = _triangles(points, faces, what)
    if solid:
        points, triangles = _close(points, triangles, "a solid mesh", weld=True)
    return ir.Mesh(np.ascontiguousarray(points), triangles, bool(solid))


def _triangles(points: Array, faces: Faces, what: str) -> Ints:
    """All faces, cut into triangles."""
    if not len(points) or not len(faces):
        raise MakerError("E0403", f"{what} has no {'faces' if len(points) else 'points'}")
    if isinstance(faces, np.ndarray) and faces.ndim == 2 and faces.shape[1] == 3:
        return _checked_array(faces, range(len(faces)), len(points), what)
    sizes = np.fromiter(map(len, faces), dtype=np.int64, count=len(faces))
    parts = [_checked_faces(points, faces, np.flatnonzero(sizes == 3), 3, what)]
    quads, rest = _of_quads(points, faces, np.flatnonzero(sizes == 4), what)
    parts.append(quads)
    one_by_one = np.concatenate([rest, np.flatnonzero((sizes != 3) & (sizes != 4))])
    left: list[int] = one_by_one.tolist()
    found = [triangle for i in left for triangle in _face(points, i, list(faces[i]), what)]
    parts.append(np.array(found, dtype=np.int32).reshape(-1, 3))
    return np.concatenate(parts)


def _of_quads(points: Array, faces: Faces, numbers: NDArray[np.intp], what: str) -> tuple[Ints, NDArray[np.intp]]:
    """The faces with four corners, cut from corner 0 to 2, else from 1 to 3, where both triangles
    then look the same way; and the numbers of those that need a closer look."""
    corners = _checked_faces(points, faces, numbers, 4, what)
    a, b, c, d = (points[corners[:, k]] for k in range(4))
    with np.errstate(over="ignore", invalid="ignore"):
        first = np.einsum("ij,ij->i", np.cross(b - a, c - a), np.cross(c - a, d - a)) > 0
        second = np.einsum("ij,ij->i", np.cross(b - a, d - a), np.cross(c - b, d - b)) > 0
    second &= ~first
    cuts = [corners[first][:, k] for k in ((0, 1, 2), (0, 2, 3))]
    cuts += [corners[second][:, k] for k in ((0, 1, 3), (1, 2, 3))]
    return np.concatenate(cuts), numbers[~(first | second)]


def _checked_faces(points: Array, faces: Faces, numbers: NDArray[np.intp], size: int, what: str) -> Ints:
    """(n, size) corners of the numbered faces; all of them name points that there are."""
    chosen: list[int] = numbers.tolist()
    try:
        corners = np.array([faces[i] for i in chosen], dtype=np.int64).reshape(-1, size)
    except OverflowError:
        corners = np.array([[min(k, 2**62) for k in faces[i]] for i in chosen], dtype=np.int64)
    return _checked_array(corners, numbers, len(points), what)


def _checked_array(faces: NDArray[np.integer], numbers: NDArray[np.intp] | range, n: int, what: str) -> Ints:
    """Corners as they are stored, if all of them name points that there are."""
    if faces.size and (faces.min() < 0 or faces.max() >= n):
        wrong = (faces < 0) | (faces >= n)
        row = int(np.argmax(wrong.any(axis=1)))
        raise _bad_index(int(faces[row][wrong[row]][0]), int(numbers[row]), n, what)
    return np.ascontiguousarray(faces, dtype=np.int32)


def _bad_index(index: int, face: int, n: int, what: str) -> MakerError:
    return MakerError(
        "E0403",
        f"face {face} of {what} names point {index}, but there are {count_text(n, 'point')}",
        "faces",
        f"points are numbered 0 to {n - 1}",
    )


def _face(points: Array, i: int, face: Sequence[int], what: str) -> Iterator[tuple[int, int, int]]:
    loop = [int(k) for k in face]
    for k in loop:
        if not 0 <= k < len(points):
            raise _bad_index(k, i, len(points), what)
    if len(loop) < 3:
        raise MakerError("E0403", f"face {i} of {what} has {count_text(len(loop), 'point')}; it needs three", "faces")
    if len(loop) == 3:
        yield loop[0], loop[1], loop[2]
    elif len(loop) > _LARGEST_POLYGON:
        raise MakerError("E0403", f"face {i} of {what} has {len(loop)} points; up to {_LARGEST_POLYGON} are allowed")
    else:
        yield from _many_cornered(points, i, loop, what)


def _many_cornered(points: Array, i: int, loop: list[int], what: str) -> list[tuple[int, int, int]]:
    """A face need not be quite flat: its triangles are the definition. One without any area is a
    fan of flat triangles."""
    corners = points[loop]
    after = np.roll(corners, -1, axis=0)
    normal = np.cross(corners - corners[0], after - corners[0]).sum(axis=0)
    if not normal.any():
        return [(loop[0], loop[k], loop[k + 1]) for k in range(1, len(loop) - 1)]
    flat = np.delete(corners, int(np.argmax(np.abs(normal))), axis=1)
    triangles = None if first_crossing(flat) else clip_ears(flat, True)
    if triangles is None:
        raise MakerError("E0403", f"face {i} of {what} crosses itself", "faces", f"face {i} (counted from 0)")
    return [(loop[a], loop[b], loop[c]) for a, b, c in triangles]


# ---- solids --------------------------------------------------------------------------


def _close(points: Array, triangles: Ints, what: str, weld: bool) -> tuple[Array, Ints]:
    """Check that the triangles enclose a body, and turn them outward."""
    names = np.arange(len(points))
    if weld:
        points, names, numbers = welded(points)
        triangles = numbers[triangles]
    a, b, c = triangles.T
    proper = (a != b) & (b != c) & (c != a)
    triangles = triangles if proper.all() else triangles[proper]
    _check_closed(points, names, triangles, what)
    _check_apart(points, triangles, what)
    if _volume(points, triangles) < 0:
        triangles = triangles[:, ::-1]
    return np.ascontiguousarray(points), np.ascontiguousarray(triangles)


def welded(points: Array) -> tuple[Array, NDArray[np.intp], Ints]:
    """Repeated points as one: the different points in rising order, the first row of each, and which of them each
    row is. As `np.unique` of rows, but with one column at a time."""
    order = np.lexsort(points.T[::-1])
    new = np.zeros(len(points), dtype=np.bool_)
    new[:1] = True
    for axis in range(points.shape[1]):
        column = points[order, axis]
        new[1:] |= column[1:] != column[:-1]
    numbers = np.empty(len(points), dtype=np.int32)
    numbers[order] = np.cumsum(new, dtype=np.int32) - np.int32(1)
    first = order[new]
    return points[first], first, numbers


def _is_closed(triangles: Ints, n: int) -> bool:
    """Every edge in exactly two triangles, once in each direction; n points."""
    there = triangles.astype(np.int64)
    back = np.roll(there, -1, axis=1)
    back *= n
    back += there
    there *= n
    there += np.roll(triangles, -1, axis=1)
    there, back = there.reshape(-1), back.reshape(-1)
    there.sort()
    back.sort()
    return len(triangles) > 0 and bool((there[1:] != there[:-1]).all()) and np.array_equal(there, back)


def _check_closed(points: Array, names: NDArray[np.intp], triangles: Ints, what: str) -> None:
    """Every edge in exactly two triangles, once in each direction. `names`: the points' numbers in the script."""
    if _is_closed(triangles, len(points)):
        return
    start = triangles.ravel().astype(np.int64)
    end = np.roll(triangles, -1, axis=1).ravel().astype(np.int64)
    n = len(points)
    there, counts = np.unique(start * n + end, return_counts=True)
    back = np.unique(end * n + start)
    if counts.size and counts.max() > 1:
        i, j = divmod(int(there[np.argmax(counts)]), n)
        problem = "is used twice in the same direction: two faces overlap, or one of them is turned over"
    elif not np.array_equal(there, back):
        i, j = divmod(int(np.setdiff1d(there, back, assume_unique=True)[0]), n)
        problem = "belongs to one face only: there is a hole"
    else:
        raise MakerError("E0403", f"{what} has no face with an area")
    raise MakerError(
        "E0403",
        f"{what} must be closed, but its edge {show(points[i])}–{show(points[j])} {problem}",
        label=f"the edge from point {names[i]} to point {names[j]} (counted from 0)",
        helps=(
            Help(
                "in a body every edge has two faces, which list it in opposite directions"
                + ("; without `solid = true` it is a surface, which may be open" if "mesh" in what else "")
            ),
        ),
    )


def _check_apart(points: Array, triangles: Ints, what: str) -> None:
    """No two triangles pass through each other: what lies between them would be inside twice, or turned over."""
    found = first_overlap(points, triangles) if len(triangles) <= _CHECKED else None
    if found is None:
        return

    def corners(i: int) -> str:
        return ", ".join(show(points[k]) for k in triangles[i])

    raise MakerError(
        "E0403",
        f"{what} must not pass through itself, but its faces {corners(found[0])} and {corners(found[1])} cross",
        "faces",
        "two of these faces cross",
        (
            Help(
                "make two bodies of it, which the field joins"
                + ("; without `solid = true` it is a surface, which may cross itself" if "mesh" in what else "")
            ),
        ),
    )


def _volume(points: Array, triangles: Ints) -> float:
    """Six times the signed volume."""
    total = 0.0
    for start in range(0, len(triangles), _ROWS):
        a, b, c = (points[triangles[start : start + _ROWS, k]] - points[0] for k in range(3))
        total += float(np.einsum("ij,ij->", a, np.cross(b, c)))
    return total


_CONVEX = 1e-12


def _is_convex(points: Array, triangles: Ints) -> bool:
    """Does no used point lie before any face?"""
    used = points[np.unique(triangles)]
    size = float(np.ptp(used, axis=0).max())
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normals = np.cross((b - a) / size, (c - a) / size)
    lengths = np.linalg.norm(normals, axis=1)
    normals, a = normals[lengths > 0] / lengths[lengths > 0, None], a[lengths > 0]
    step = max(1, 4_000_000 // len(used))
    for k in range(0, len(normals), step):
        n = normals[k : k + step]
        above = used @ n.T - np.einsum("ij,ij->i", n, a[k : k + step])
        if above.max() > _CONVEX * size:
            return False
    return True
