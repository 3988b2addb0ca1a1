"""IR -> flat arrays for the tracer. The one place in Python that knows the memory layout of
`tracer/scene.h`; every class below mirrors a struct there (checked by `blob_abi` and by tests).

Packed coordinates are p = (P - center) * scale with scale a power of two that brings the extent near 1.
The center is 0 unless the scene lies far from the origin, and then a coarse grid point, so that moving
there loses no bit (numerics.md, section 2).
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.kernels import lipschitz

__all__ = ["BlobScene", "Packed", "pack"]

ABI = 3
#: ORDER KERNELS, as in scene.h
KERNEL_IDS = {"soft2": 0, "soft3": 1, "wyvill": 2, "gauss": 3, "gauss_c1": 4, "metaball": 5}
KERNEL_USER = 6
#: ORDER OPS, as in scene.h
OPS = {"sum": 0, "max": 1, "min": 2, "smooth_max": 3, "smooth_min": 4}
#: ORDER SHAPES, as in scene.h
SHAPE_POINT, SHAPE_LINE, SHAPE_TRIANGLE, SHAPE_MESH = range(4)
PIECE_DEGREE = 23

_ROUNDING = 2.0**-53
#: Meshes up to this size become a max node of their triangles, each with its own place in the index; larger
#: ones keep a tree for nearest points. With few triangles the tree costs more than it saves.
_SMALL_MESH = 64
_I32, _F64 = ctypes.c_int32, ctypes.c_double


class BlobPiece(ctypes.Structure):
    _fields_ = [
        *[(n, _F64) for n in ("s_lo", "s_hi", "centre", "half")],
        *[(n, _F64) for n in ("end_value_lo", "end_value_hi", "end_slope_lo", "end_slope_hi")],
        *[(n, _F64) for n in ("kinks", "defects")],
        ("coefficients", _F64 * (PIECE_DEGREE + 1)),
        *[(n, _I32) for n in ("degree", "in_s", "convex", "falling", "run", "joined")],
    ]


class BlobKernel(ctypes.Structure):
    _fields_ = [
        *[(n, _I32) for n in ("id", "first_piece", "piece_count", "reserved")],
        *[(n, _F64) for n in ("a", "norm", "tail", "lipschitz")],
    ]


class BlobShape(ctypes.Structure):
    _fields_ = [
        *[(n, _I32) for n in ("kind", "matrix", "mesh", "reserved")],
        ("box", _F64 * 6),
        ("b", _F64 * 3),
        ("c", _F64 * 3),
    ]


class BlobSurface(ctypes.Structure):
    _fields_ = [
        ("threshold", _F64),
        *[(n, _I32) for n in ("element_begin", "element_end", "node_begin", "node_end", "material", "reserved")],
    ]


class BlobNode(ctypes.Structure):
    _fields_ = [(n, _I32) for n in ("op", "parent", "children", "depth", "element_begin", "element_end")]


class BlobMesh(ctypes.Structure):
    _fields_ = [(n, _I32) for n in ("vertex_begin", "vertex_end", "triangle_begin", "triangle_end", "solid", "convex")]


class BlobScene(ctypes.Structure):
    _fields_ = [
        *[
            (n, _I32)
            for n in (
                "abi",
                "surface_count",
                "node_count",
                "element_count",
                "kernel_count",
                "piece_count",
                "shape_count",
                "matrix_count",
                "mesh_count",
                "mesh_vertex_count",
                "mesh_triangle_count",
                "reserved",
            )
        ],
        ("center", _F64 * 3),
        ("scale", _F64),
        ("lo", _F64 * 3),
        ("hi", _F64 * 3),
        *[
            (n, ctypes.c_void_p)
            for n in (
                "surfaces",
                "nodes",
                "kernels",
                "pieces",
                "shapes",
                "matrices",
                "meshes",
                "mesh_vertices",
                "mesh_triangles",
                "mesh_neighbors",
                "mesh_normals",
                "x",
                "y",
                "z",
                "weight",
                "inverse_reach2",
                "support",
                "kernel",
                "node",
                "paint",
                "shape",
            )
        ],
    ]


@dataclass(slots=True)
class Packed:
    """The C scene and the arrays that it points to; `origin` (index into `ir.Scene.spans`) per element."""

    scene: BlobScene
    arrays: dict[str, NDArray[Any]]
    origin: NDArray[np.int32]

    @property
    def nbytes(self) -> int:
        return sum(a.nbytes for a in self.arrays.values()) + self.origin.nbytes


def _records(kind: type[ctypes.Structure], rows: list[dict[str, object]]) -> NDArray[Any]:
    """Rows as a structured array with the layout of `kind`."""
    table: NDArray[Any] = np.zeros(len(rows), dtype=np.dtype(kind))
    for i, row in enumerate(rows):
        for name, value in row.items():
            table[name][i] = value
    return table


# ---- coordinates ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Frame:
    center: NDArray[np.float64]
    scale: float

    def points(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = p - self.center
        moved *= self.scale
        return moved

    def matrix(self, m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Scene -> skeleton space, for packed points: M (p / scale + center) + m."""
        wide = m.astype(np.longdouble)
        out = np.empty((3, 4))
        out[:, :3] = m[:, :3] / self.scale
        out[:, 3] = wide[:, :3] @ self.center.astype(np.longdouble) + wide[:, 3]
        return out


def _skeleton_points(skeleton: ir.Skeleton) -> NDArray[np.float64]:
    match skeleton:
        case ir.Points(at=at):
            return at
        case ir.Lines(a=a, b=b):
            return np.concatenate([a, b])
        case _:
            return skeleton.points


def _leaf_box(leaf: ir.Leaf) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A box in scene space that holds the skeleton and about its reach (for scaling only)."""
    points = _skeleton_points(leaf.skeleton)
    reach = float(leaf.reach.max())
    lo, hi = points.min(axis=0) - reach, points.max(axis=0) + reach
    if leaf.matrix is None:
        return lo, hi
    back = np.linalg.inv(leaf.matrix[:, :3])
    corners = np.array([[x, y, z] for x in (lo[0], hi[0]) for y in (lo[1], hi[1]) for z in (lo[2], hi[2])])
    corners = (corners - leaf.matrix[:, 3]) @ back.T
    return corners.min(axis=0), corners.max(axis=0)


def _frame(scene: ir.Scene) -> _Frame:
    boxes = [_leaf_box(leaf) for s in scene.surfaces for leaf in ir.leaves(s.field) if leaf.count]
    if not boxes:
        return _Frame(np.zeros(3), 1.0)
    lo = np.min([b[0] for b in boxes], axis=0)
    hi = np.max([b[1] for b in boxes], axis=0)
    extent = float((hi - lo).max())
    middle: NDArray[np.float64] = 0.5 * (lo + hi)
    scale = 2.0 ** -math.frexp(extent)[1]
    if np.abs(middle).max() <= 4.0 * extent:
        return _Frame(np.zeros(3), scale)
    grid = 2.0 ** (math.frexp(extent)[1] - 2)
    return _Frame(np.round(middle / grid) * grid, scale)


# ---- elements ------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Builder:
    frame: _Frame
    surfaces: list[dict[str, object]] = field(default_factory=list[dict[str, object]])
    nodes: list[dict[str, object]] = field(default_factory=list[dict[str, object]])
    kernels: list[dict[str, object]] = field(default_factory=list[dict[str, object]])
    kernel_index: dict[ir.Kernel, int] = field(default_factory=dict[ir.Kernel, int])
    pieces: list[dict[str, object]] = field(default_factory=list[dict[str, object]])
    shapes: list[NDArray[Any]] = field(default_factory=list[NDArray[Any]])
    shape_count: int = 0
    matrices: list[NDArray[np.float64]] = field(default_factory=list[NDArray[np.float64]])
    meshes: list[dict[str, object]] = field(default_factory=list[dict[str, object]])
    vertices: list[NDArray[np.float64]] = field(default_factory=list[NDArray[np.float64]])
    triangles: list[NDArray[np.int32]] = field(default_factory=list[NDArray[np.int32]])
    neighbors: list[NDArray[np.int32]] = field(default_factory=list[NDArray[np.int32]])
    normals: list[NDArray[np.float64]] = field(default_factory=list[NDArray[np.float64]])
    columns: dict[str, list[NDArray[Any]]] = field(
        default_factory=lambda: {
            n: []
            for n in (
                "x",
                "y",
                "z",
                "weight",
                "inverse_reach2",
                "support",
                "kernel",
                "node",
                "paint",
                "shape",
                "origin",
            )
        }
    )
    count: int = 0

    # -- tables

    def kernel(self, kernel: ir.Kernel) -> int:
        if kernel not in self.kernel_index:
            self.kernel_index[kernel] = len(self.kernels)
            row: dict[str, object] = {
                "id": KERNEL_IDS.get(kernel.name, KERNEL_USER),
                "a": kernel.a,
                "lipschitz": lipschitz(kernel),
            }
            if kernel.pieces:
                row |= {"id": KERNEL_USER, "first_piece": len(self.pieces), "piece_count": len(kernel.pieces)}
                self.pieces += _piece_rows(kernel.pieces)
            if row["id"] == KERNEL_IDS["gauss_c1"]:
                # 1 - e^-a (1 + a), by its series where that cancels: sum over k >= 2 of a^k / k!, times e^-a
                a = kernel.a
                rise = math.fsum(a**k / math.factorial(k) for k in range(2, 30)) if a < 1.0 else 0.0
                row["norm"] = math.exp(a) / rise if a < 1.0 else 1.0 / (1.0 - math.exp(-a) * (1.0 + a))
                row["tail"] = math.exp(-a)
            self.kernels.append(row)
        return self.kernel_index[kernel]

    def matrix(self, m: NDArray[np.float64] | None) -> int:
        if m is None:
            return -1
        self.matrices.append(self.frame.matrix(m))
        return len(self.matrices) - 1

    # -- elements

    def add(
        self,
        leaf: ir.Leaf,
        node: int,
        at: NDArray[np.float64],
        threshold: float,
        terms: int,
        shape: NDArray[Any] | None,
        rows: NDArray[np.int64] | None = None,
    ) -> None:
        """Elements at `at` (already in their own space). rows: which entry of the leaf each one belongs to."""
        n = len(at)
        pick = slice(None) if rows is None else rows
        unit = self.frame.scale if leaf.matrix is None else 1.0
        reach = leaf.reach[pick] * unit
        weight = leaf.weight[pick].copy()  # `_fold` writes into it
        put = self.columns
        for axis, name in enumerate("xyz"):
            put[name].append(np.ascontiguousarray(at[:, axis]))
        put["weight"].append(weight)
        put["inverse_reach2"].append(1.0 / reach**2)
        put["support"].append(_support(leaf.kernel, reach, weight, threshold, terms))
        put["kernel"].append(np.full(n, self.kernel(leaf.kernel), dtype=np.uint16))
        put["node"].append(np.full(n, node, dtype=np.int32))
        put["paint"].append(leaf.paint[pick].astype(np.int32))
        put["origin"].append(leaf.origin[pick].astype(np.int32))
        if shape is None:
            put["shape"].append(np.full(n, -1, dtype=np.int32))
        else:
            for some in _slices(n):
                shape["box"][some] = self.boxes(leaf, shape[some], at[some], put["support"][-1][some])
            put["shape"].append(np.arange(self.shape_count, self.shape_count + n, dtype=np.int32))
            self.shapes.append(shape)
            self.shape_count += n
        self.count += n

    def boxes(
        self,
        leaf: ir.Leaf,
        shape: NDArray[Any],
        at: NDArray[np.float64],
        support: NDArray[Any],
    ) -> NDArray[np.float64]:
        """Where each element's density is not 0, in packed coordinates, rounded outwards."""
        lo, hi = at.copy(), at.copy()
        for kind, names in ((SHAPE_LINE, "b"), (SHAPE_TRIANGLE, "bc")):
            which = shape["kind"] == kind
            for name in names:
                lo[which] = np.minimum(lo[which], shape[name][which])
                hi[which] = np.maximum(hi[which], shape[name][which])
        for i in np.flatnonzero(shape["kind"] == SHAPE_MESH):
            mesh = self.meshes[int(shape["mesh"][i])]
            vertices = self.vertices[int(shape["mesh"][i])]
            assert len(vertices) == int(mesh["vertex_end"]) - int(mesh["vertex_begin"])  # type: ignore[call-overload]
            lo[i], hi[i] = vertices.min(axis=0), vertices.max(axis=0)
        grow = support[:, None]
        if leaf.matrix is not None:
            m = self.matrices[int(shape["matrix"][0])]
            back = np.linalg.inv(m[:, :3])
            middle, half = 0.5 * (lo + hi) - m[:, 3], 0.5 * (hi - lo)
            # the box of the image of a box, plus that of a ball: rows of the inverse
            lo = middle @ back.T
            grow = half @ np.abs(back).T + support[:, None] * np.linalg.norm(back, axis=1)
            hi = lo
        slack = 1e-14 * (np.abs(lo) + np.abs(hi) + grow)
        return np.concatenate([lo - grow - slack, hi + grow + slack], axis=1)

    # -- the tree

    def open(self, op: str, parent: int) -> int:
        depth = 0 if parent < 0 else int(self.nodes[parent]["depth"]) + 1  # type: ignore[call-overload]
        self.nodes.append({"op": OPS[op], "parent": parent, "children": 0, "depth": depth, "element_begin": self.count})
        if parent >= 0:
            self.child(parent)
        return len(self.nodes) - 1

    def child(self, node: int, n: int = 1) -> None:
        self.nodes[node]["children"] = int(self.nodes[node]["children"]) + n  # type: ignore[call-overload]

    def close(self, node: int) -> None:
        self.nodes[node]["element_end"] = self.count

    def surface(self, surface: ir.Surface) -> None:
        begin, node_begin = self.count, len(self.nodes)
        terms = sum(leaf.count for leaf in ir.leaves(surface.field)) or 1
        whole = surface.field
        root = self.open(whole.op if isinstance(whole, ir.Node) else "sum", -1)
        for child in whole.children if isinstance(whole, ir.Node) else (whole,):
            self.field(child, root, surface.threshold, terms)
        self.close(root)
        self.surfaces.append(
            {
                "threshold": surface.threshold,
                "element_begin": begin,
                "element_end": self.count,
                "node_begin": node_begin,
                "node_end": len(self.nodes),
                "material": surface.material,
            }
        )

    def field(self, node: ir.Field, parent: int, threshold: float, terms: int) -> None:
        if isinstance(node, ir.Node):
            mine = self.open(node.op, parent)
            for child in node.children:
                self.field(child, mine, threshold, terms)
            self.close(mine)
            return
        self.leaf(node, parent, threshold, terms)

    def leaf(self, leaf: ir.Leaf, parent: int, threshold: float, terms: int) -> None:
        """One leaf; parts of a skeleton whose distance is a minimum become a max node (weight < 0: min)."""
        at, shape = self.shape_of(leaf)
        parts = not isinstance(leaf.skeleton, (ir.Points, ir.Lines)) and len(at) > 1
        op = ("max" if leaf.weight[0] > 0.0 else "min") if parts else "sum"
        nested = len(at) > 1 and self.nodes[parent]["op"] != OPS[op]
        node = self.open(op, parent) if nested else parent
        self.child(node, len(at))
        rows = np.zeros(len(at), dtype=np.int64) if parts else None
        self.add(leaf, node, at, threshold, terms, shape, rows)
        if nested:
            self.close(node)

    def shape_of(self, leaf: ir.Leaf) -> tuple[NDArray[np.float64], NDArray[Any] | None]:
        """First points of the elements in their own space, and their shapes (None: plain points)."""
        skeleton = leaf.skeleton
        own = self.frame.points if leaf.matrix is None else np.asarray
        match skeleton:
            case ir.Points(at=at):
                if leaf.matrix is None:
                    return own(at), None
                return own(at), self.shape_rows(leaf, len(at), SHAPE_POINT)
            case ir.Lines(a=a, b=b):
                shape = self.shape_rows(leaf, len(a), SHAPE_LINE)
                shape["b"] = own(b)
                return own(a), shape
            case ir.Polyline() | ir.Polygon() if not leaf.kernel.falls:
                return self.mesh_shape(leaf, *_parts(skeleton, own), solid=False)
            case ir.Polyline(points=points, closed=closed):
                moved, count = own(points), len(points) if closed else len(points) - 1
                shape = self.shape_rows(leaf, count, SHAPE_LINE)
                shape["b"][: len(points) - 1] = moved[1:]
                shape["b"][len(points) - 1 :] = moved[: count - len(points) + 1]
                return moved[:count], shape
            case ir.Mesh(points=points, triangles=triangles, solid=False) if (
                len(triangles) <= _SMALL_MESH and leaf.kernel.falls
            ):
                return self.triangle_shapes(leaf, own(points)[triangles])
            case ir.Polygon(points=points, triangles=triangles):
                return self.triangle_shapes(leaf, own(points)[triangles])
            case ir.Polyhedron(points=points, triangles=triangles, convex=convex):
                return self.mesh_shape(leaf, own(points), triangles, solid=True, convex=convex)
            case ir.Mesh(points=points, triangles=triangles, solid=solid):
                return self.mesh_shape(leaf, own(points), triangles, solid=solid)

    def triangle_shapes(self, leaf: ir.Leaf, corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[Any]]:
        """corners: (k, 3, 3)"""
        shape = self.shape_rows(leaf, len(corners), SHAPE_TRIANGLE)
        shape["b"], shape["c"] = corners[:, 1], corners[:, 2]
        return np.ascontiguousarray(corners[:, 0]), shape

    def shape_rows(self, leaf: ir.Leaf, n: int, kind: int) -> NDArray[Any]:
        shape: NDArray[Any] = np.zeros(n, dtype=np.dtype(BlobShape))
        shape["kind"] = kind
        shape["matrix"] = self.matrix(leaf.matrix)
        shape["mesh"] = -1
        return shape

    def mesh_shape(
        self,
        leaf: ir.Leaf,
        points: NDArray[np.float64],
        triangles: NDArray[np.int32],
        *,
        solid: bool,
        convex: bool = False,
    ) -> tuple[NDArray[np.float64], NDArray[Any]]:
        vertex_begin = sum(len(v) for v in self.vertices)
        triangle_begin = sum(len(t) for t in self.triangles)
        self.meshes.append(
            {
                "vertex_begin": vertex_begin,
                "vertex_end": vertex_begin + len(points),
                "triangle_begin": triangle_begin,
                "triangle_end": triangle_begin + len(triangles),
                "solid": int(solid),
                "convex": int(convex),
            }
        )
        if solid:
            self.neighbors.append(_neighbors(triangles))
            self.normals.append(_vertex_normals(points, triangles))
        else:
            self.neighbors.append(np.zeros_like(triangles))
            self.normals.append(np.zeros_like(points))
        self.vertices.append(np.ascontiguousarray(points))
        self.triangles.append(np.ascontiguousarray(triangles, dtype=np.int32))
        shape = self.shape_rows(leaf, 1, SHAPE_MESH)
        shape["mesh"] = len(self.meshes) - 1
        return np.ascontiguousarray(points[:1]), shape


def _parts(
    skeleton: ir.Polyline | ir.Polygon, own: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Points and triangles, flat ones for lines. Where a kernel rises, the density of the nearest part is not
    the largest of all parts, so these skeletons cannot become a max node; as a mesh their distance counts."""
    points = own(skeleton.points)
    if isinstance(skeleton, ir.Polygon):
        return points, skeleton.triangles
    starts = np.arange(len(points) if skeleton.closed else len(points) - 1, dtype=np.int32)
    ends = ((starts + 1) % len(points)).astype(np.int32)
    return points, np.stack([starts, ends, ends], axis=1)


def _neighbors(triangles: NDArray[np.int32]) -> NDArray[np.int32]:
    """(k, 3) the triangle across each edge (i, i + 1) of a closed, oriented mesh."""
    heads = np.roll(triangles, -1, axis=1)
    key = np.minimum(triangles, heads).astype(np.int64)
    key *= int(triangles.max()) + 1
    key += np.maximum(triangles, heads)
    # each edge is there twice, once in each direction
    first, second = np.argsort(key.ravel(), kind="stable").reshape(-1, 2).T
    found = np.empty(triangles.size, dtype=np.int32)
    found[first], found[second] = second // 3, first // 3
    return found.reshape(-1, 3)


def _vertex_normals(points: NDArray[np.float64], triangles: NDArray[np.int32]) -> NDArray[np.float64]:
    """(m, 3) unit face normals weighted by the angle at the vertex (Baerentzen and Aanaes 2005)."""
    sums = np.zeros_like(points)
    for i in range(3):
        for some in _slices(len(triangles)):
            np.add.at(sums, triangles[some, i], _normals_at(points[triangles[some]], i))
    return sums


def _normals_at(corners: NDArray[np.float64], i: int) -> NDArray[np.float64]:
    """(k, 3) unit normals of the triangles (k, 3, 3), times the angle at corner i."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(length > 0.0, length, 1.0)
    u, v = corners[:, (i + 1) % 3] - corners[:, i], corners[:, (i + 2) % 3] - corners[:, i]
    angle = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v))
    return angle[:, None] * normal


#: Pieces belong to one run if nothing at their joint changes a value, or the slope, by more than that.
_SMOOTH, _STRAIGHT = 2.0**-46, 2.0**-10


def _piece_rows(pieces: Sequence[ir.KernelPiece]) -> list[dict[str, object]]:
    rows = [_piece_row(piece) for piece in pieces]
    kinks = defects = 0.0
    run, sign = 1, 0
    members: list[dict[str, object]] = []
    for row, piece, after in zip(rows, pieces, [*pieces[1:], None], strict=True):
        ends = [_jet(piece, piece.r_hi), _jet(after, after.r_lo) if after else (0.0, 0.0)]
        row["end_value_lo"], row["end_value_hi"] = sorted(value for value, _ in ends)
        row["end_slope_lo"], row["end_slope_hi"] = sorted(slope for _, slope in ends)
        sign = sign or piece.convex
        kink, defect = _defect(ends, sign or (after.convex if after else 0), piece.r_hi**2)
        joined = defect <= _SMOOTH and kink <= _STRAIGHT and _goes_on(piece, after, sign)
        kinks, defects = kinks + kink * joined, defects + defect * joined
        members.append(row)
        row |= {"kinks": kinks, "defects": defects, "joined": int(joined)}
        if not joined or after is None:
            for member in members:
                member["run"] = -run if sign < 0 else run
            run, sign, members = run + 1, 0, []
    return rows


def _goes_on(piece: ir.KernelPiece, after: ir.KernelPiece | None, sign: int) -> bool:
    """Can the next piece (None: beyond the reach, 0) be in a run of this curvature?"""
    if after is None:
        return True
    return piece.falling == after.falling and sign * after.convex >= 0


def _defect(ends: list[tuple[float, float]], sign: int, s: float) -> tuple[float, float]:
    """At a joint: how far the slope changes against the curvature, and what a value beyond it may be off."""
    (value, slope), (next_value, next_slope) = ends
    change = next_slope - slope
    kink = abs(change) if sign == 0 else max(0.0, -sign * change)
    return kink, abs(next_value - value) + kink * (1.0 - s)


def _piece_row(piece: ir.KernelPiece) -> dict[str, object]:
    coefficients = np.zeros(PIECE_DEGREE + 1)
    coefficients[: len(piece.coefficients)] = piece.coefficients
    return {
        "s_lo": piece.r_lo**2,
        "s_hi": piece.r_hi**2,
        "centre": piece.centre,
        "half": piece.half,
        "coefficients": coefficients,
        "degree": len(piece.coefficients) - 1,
        "in_s": int(piece.variable == "s"),
        "convex": piece.convex,
        "falling": int(piece.falling),
    }


def _jet(piece: ir.KernelPiece, r: float) -> tuple[float, float]:
    """Value and slope in s of a piece at r > 0 (r = 0 is no end of two pieces), as the tracer has them."""
    x = ((r * r if piece.variable == "s" else r) - piece.centre) / piece.half
    value, slope = piece.coefficients[-1], 0.0
    for coefficient in reversed(piece.coefficients[:-1]):
        slope = slope * x + value
        value = value * x + coefficient
    slope /= piece.half
    return value, slope if piece.variable == "s" else slope / (2.0 * max(r, 1e-8))


def _support(
    kernel: ir.Kernel, reach: NDArray[np.float64], weight: NDArray[np.float64], threshold: float, terms: int
) -> NDArray[np.float64]:
    """Where the density ends. The Gaussian never does: it is cut where the sum of all cut tails is below
    the rounding of the threshold, |w| e^(-a s) <= 2^-53 |T| / n (numerics.md, section 1)."""
    if kernel.name != "gauss" or kernel.pieces:
        return reach.copy()
    level = _ROUNDING * (abs(threshold) or float(np.abs(weight).min(initial=1.0))) / terms
    tail = np.log(np.maximum(np.abs(weight) / level, 1.0))
    return reach * np.sqrt(np.maximum(tail, 1e-300) / kernel.a)


# ---- the whole scene -------------------------------------------------------------------------------


def pack(scene: ir.Scene) -> Packed:
    """Flatten a verified scene. Raises nothing for a scene that `verify` accepts."""
    frame = _frame(scene)
    build = _Builder(frame)
    for surface in scene.surfaces:
        build.surface(surface)
    kinds = {"kernel": np.uint16, "node": np.int32, "paint": np.int32, "shape": np.int32, "origin": np.int32}
    columns = {name: _joined(build.columns.pop(name), kinds.get(name, np.float64)) for name in tuple(build.columns)}
    arrays: dict[str, NDArray[Any]] = {
        "surfaces": _records(BlobSurface, build.surfaces),
        "nodes": _records(BlobNode, build.nodes),
        "kernels": _records(BlobKernel, build.kernels),
        "pieces": _records(BlobPiece, build.pieces),
        "shapes": _joined(build.shapes, np.dtype(BlobShape)),
        "matrices": np.concatenate([m.ravel() for m in build.matrices]) if build.matrices else np.zeros(0),
        "meshes": _records(BlobMesh, build.meshes),
        "mesh_vertices": _joined(build.vertices, np.float64).ravel(),
        "mesh_triangles": _joined(build.triangles, np.int32).ravel(),
        "mesh_neighbors": _joined(build.neighbors, np.int32).ravel(),
        "mesh_normals": _joined(build.normals, np.float64).ravel(),
        **columns,
    }
    origin = arrays.pop("origin")
    _fold(arrays, build)
    if not build.shape_count:
        del arrays["shape"]
    return Packed(_c_scene(arrays, frame, build), arrays, origin.astype(np.int32, copy=False))


#: Rows of temporary arrays.
_ROWS = 65_536


def _slices(count: int) -> Iterator[slice]:
    """Of arrays of this length, some rows at a time: what is computed of them in between is no second copy."""
    return (slice(start, min(start + _ROWS, count)) for start in range(0, count, _ROWS))


def _joined(parts: list[NDArray[Any]], kind: type[Any] | np.dtype[Any]) -> NDArray[Any]:
    """One array of all parts. A single part is taken as it is: a million points need no second copy."""
    if len(parts) == 1:
        return parts[0]
    return np.concatenate(parts) if parts else np.zeros(0, dtype=kind)


def _fold(arrays: dict[str, NDArray[Any]], build: _Builder) -> None:
    """Identical plain points under one sum act as one: the first takes the sum of their weights, the others
    0. Bounds that look at terms one by one cannot see that +1e8 and -(1e8 - 1) at one place nearly cancel."""
    if not (arrays["shape"] < 0).any():
        return
    x = arrays["x"]
    key = x * 0.7548776662466927 + arrays["y"] * 0.5698402909980532 + arrays["z"] * 0.4198193842113862
    order = np.argsort(key, kind="stable")
    same = np.ones(len(order), dtype=bool)
    names = ["x", "y", "z", "inverse_reach2", "kernel", "node", "paint"]
    if len(order) < 2 or not (np.diff(key[order]) == 0.0).any():
        return
    rows = np.stack([arrays[n][order].astype(np.float64) for n in names])
    shape = arrays["shape"][order]
    ops = np.array([n["op"] for n in build.nodes])[arrays["node"][order]]
    same = (np.diff(rows, axis=1) == 0.0).all(axis=0) & (shape[1:] < 0) & (shape[:-1] < 0) & (ops[1:] == OPS["sum"])
    if not same.any():
        return
    group = np.concatenate([[0], np.cumsum(~same)])
    weight = arrays["weight"]
    first = order[np.concatenate([[True], ~same])]
    totals = np.array([math.fsum(part) for part in np.split(weight[order], np.flatnonzero(~same) + 1)])
    weight[order] = 0.0
    weight[first] = totals
    assert len(totals) == group[-1] + 1


def _c_scene(arrays: dict[str, NDArray[Any]], frame: _Frame, build: _Builder) -> BlobScene:
    out = BlobScene()
    out.abi = ABI
    for name, array in (
        ("surface_count", "surfaces"),
        ("node_count", "nodes"),
        ("element_count", "x"),
        ("kernel_count", "kernels"),
        ("piece_count", "pieces"),
        ("shape_count", "shapes"),
        ("mesh_count", "meshes"),
    ):
        setattr(out, name, len(arrays[array]))
    out.matrix_count = len(arrays["matrices"]) // 12
    out.mesh_vertex_count = len(arrays["mesh_vertices"]) // 3
    out.mesh_triangle_count = len(arrays["mesh_triangles"]) // 3
    out.center = tuple(frame.center)
    out.scale = frame.scale
    lo, hi = _bounds(arrays)
    out.lo, out.hi = tuple(lo), tuple(hi)
    for name, array in arrays.items():
        setattr(out, name, array.ctypes.data if array.size else None)
    return out


def _bounds(arrays: dict[str, NDArray[Any]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if not len(arrays["x"]):
        return np.zeros(3), np.zeros(3)
    boxes = [_some_bounds(arrays, some) for some in _slices(len(arrays["x"]))]
    return np.min([lo for lo, _ in boxes], axis=0), np.max([hi for _, hi in boxes], axis=0)


def _some_bounds(arrays: dict[str, NDArray[Any]], some: slice) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The box around some elements."""
    support = arrays["support"][some]
    lo = np.stack([arrays[n][some] - support for n in "xyz"], axis=1)
    hi = np.stack([arrays[n][some] + support for n in "xyz"], axis=1)
    if "shape" in arrays:
        shape = arrays["shape"][some]
        shaped = shape >= 0
        box = arrays["shapes"]["box"][shape[shaped]]
        lo[shaped], hi[shaped] = box[:, :3], box[:, 3:]
    return lo.min(axis=0), hi.max(axis=0)
