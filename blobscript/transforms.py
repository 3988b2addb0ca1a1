"""Transforms: `move rotate scale mirror apply identity`, on everything that they work on.

On a skeleton a transform moves its points; on a field or surface it maps space; lights and cameras
move with their points and directions. Rotations are right-handed; `rotate(x, y, z)` turns about the
fixed x, then y, then z axis.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TypeVar, assert_never, cast

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.arguments import LARGEST, direction, number, show, vector
from blobscript.diagnostics import Help
from blobscript.values import (
    IDENTITY,
    Affine,
    Blob,
    Camera,
    Changed,
    Cloud,
    Combine,
    Context,
    Dot,
    Lamp,
    Maker,
    MakerError,
    Material,
    Segment,
    Skeleton,
    Sun,
    Surface,
    Transform,
    Vec3,
    compose,
)

__all__ = ["MAKERS", "map_points", "transformed"]

Array = NDArray[np.float64]
T = TypeVar("T")


# ---- matrices ------------------------------------------------------------------------


def _rotation(axis: int, angle: float) -> Affine:
    """About a coordinate axis; quarter turns are exact."""
    c, s = _cos_sin(angle)
    match axis:
        case 0:
            return (1.0, 0.0, 0.0, 0.0, 0.0, c, -s, 0.0, 0.0, s, c, 0.0)
        case 1:
            return (c, 0.0, s, 0.0, 0.0, 1.0, 0.0, 0.0, -s, 0.0, c, 0.0)
        case _:
            return (c, -s, 0.0, 0.0, s, c, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def _cos_sin(angle: float) -> tuple[float, float]:
    quarters = angle / (math.pi / 2)
    if quarters == round(quarters):
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarters) % 4]
    return math.cos(angle), math.sin(angle)


def _axis_rotation(angle: float, axis: Vec3) -> Affine:
    """Rodrigues' formula for a unit axis."""
    largest = max(map(abs, axis))
    x, y, z = (a / largest for a in axis)
    norm = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / norm, y / norm, z / norm
    c, s = _cos_sin(angle)
    d = 1 - c
    return (
        c + x * x * d,
        x * y * d - z * s,
        x * z * d + y * s,
        0.0,
        y * x * d + z * s,
        c + y * y * d,
        y * z * d - x * s,
        0.0,
        z * x * d - y * s,
        z * y * d + x * s,
        c + z * z * d,
        0.0,
    )


def map_points(matrix: Affine, points: Array) -> Array:
    """Images of (n, 3) points."""
    m = np.array(matrix).reshape(3, 4)
    return np.ascontiguousarray(points @ m[:, :3].T + m[:, 3])


def _map_point(m: Affine, p: Vec3) -> Vec3:
    x, y, z = p
    return (
        m[0] * x + m[1] * y + m[2] * z + m[3],
        m[4] * x + m[5] * y + m[6] * z + m[7],
        m[8] * x + m[9] * y + m[10] * z + m[11],
    )


def _map_direction(m: Affine, d: Vec3) -> Vec3:
    x, y, z = _map_point(m, d)
    return x - m[3], y - m[7], z - m[11]


def _mirrors(m: Affine) -> bool:
    return float(np.linalg.det(np.array(m).reshape(3, 4)[:, :3])) < 0


# ---- what a map does to each kind of thing -------------------------------------------


def transformed(ctx: Context, it: T, matrix: Affine) -> T:
    """`it` after the map."""
    return cast(T, _transformed(ctx, it, matrix))


def _transformed(ctx: Context, it: object, matrix: Affine) -> object:
    match it:
        case Blob() | Combine():
            return Changed(it, matrix, origin=ctx.origin(ctx.span))
        case Changed(paint=Material()):
            return Changed(it, matrix, origin=it.origin)  # its texture moves along
        case Changed():
            return replace(it, matrix=matrix if it.matrix is None else compose(matrix, it.matrix))
        case Surface():
            return replace(it, matrix=matrix if it.matrix is None else compose(matrix, it.matrix))
        case Transform():
            return Transform(compose(matrix, it.matrix))
        case Lamp():
            size = it.size * abs(float(np.linalg.det(np.reshape(matrix, (3, 4))[:, :3]))) ** (1 / 3)
            return replace(it, at=_map_point(matrix, it.at), size=size)
        case Sun():
            return replace(it, toward=_map_direction(matrix, it.toward))
        case Camera():
            return replace(
                it,
                at=_map_point(matrix, it.at),
                to=_map_point(matrix, it.to),
                up=_map_direction(matrix, it.up),
                focus=None if it.focus is None else _map_point(matrix, it.focus),
            )
        case _:
            return map_skeleton(cast(Skeleton, it), matrix)


def map_skeleton(it: Skeleton, matrix: Affine) -> Skeleton:
    """A skeleton with its points moved; the faces of a solid keep looking outward."""
    match it:
        case Dot():
            return Dot(_map_point(matrix, it.at))
        case Segment():
            return Segment(_map_point(matrix, it.a), _map_point(matrix, it.b))
        case Cloud():
            return Cloud(map_points(matrix, it.at))
        case ir.Polyline() | ir.Polygon():
            return replace(it, points=map_points(matrix, it.points))
        case ir.Polyhedron() | ir.Mesh():
            triangles = np.ascontiguousarray(it.triangles[:, ::-1]) if _mirrors(matrix) else it.triangles
            return replace(it, points=map_points(matrix, it.points), triangles=triangles)
        case _:
            assert_never(it)


# ---- the built-ins -------------------------------------------------------------------


def _move(ctx: Context, it: T, x: float = 0.0, y: float = 0.0, z: float = 0.0, v: Vec3 | None = None) -> T:
    dx, dy, dz = vector(v, "v") if v is not None else (number(x, "x"), number(y, "y"), number(z, "z"))
    return transformed(ctx, it, (1.0, 0.0, 0.0, dx, 0.0, 1.0, 0.0, dy, 0.0, 0.0, 1.0, dz))


def _rotate(
    ctx: Context,
    it: T,
    x: float = 0.0,
    y: float = 0.0,
    z: float = 0.0,
    angle: float | None = None,
    axis: Vec3 | None = None,
) -> T:
    if angle is not None and axis is not None:
        return transformed(ctx, it, _axis_rotation(number(angle, "angle"), direction(axis, "axis")))
    matrix: Affine | None = None
    for i, turn in enumerate((number(x, "x"), number(y, "y"), number(z, "z"))):
        if turn:
            step = _rotation(i, turn)
            matrix = step if matrix is None else compose(step, matrix)
    return transformed(ctx, it, matrix or IDENTITY)


def _factor(value: float, argument: str) -> float:
    factor = number(value, argument)
    if abs(factor) < 1 / LARGEST:
        raise MakerError(
            "E0405",
            f"a scale factor must not be zero or close to it, but `{argument}` is {show(factor)}",
            argument=argument,
            label="flattens everything",
            helps=(Help("1 changes nothing, -1 mirrors"),),
        )
    return factor


def _scale(ctx: Context, it: T, x: float = 1.0, y: float = 1.0, z: float = 1.0, s: float | None = None) -> T:
    if s is not None:
        a = b = c = _factor(s, "s")
    else:
        a, b, c = _factor(x, "x"), _factor(y, "y"), _factor(z, "z")
    return transformed(ctx, it, (a, 0.0, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, 0.0, c, 0.0))


def _mirror(ctx: Context, it: T, normal: Vec3, at: Vec3 = (0.0, 0.0, 0.0)) -> T:
    """Householder's reflection p - 2 n (n . (p - at)) with the unit normal n."""
    n = np.array(direction(normal, "normal"))
    n /= np.abs(n).max()
    h = np.eye(3) - 2 * np.outer(n, n) / (n @ n)
    shift = 2 * n * (n @ np.array(vector(at, "at"))) / (n @ n)
    return transformed(ctx, it, cast(Affine, tuple(np.column_stack((h, shift)).ravel().tolist())))


def _identity(ctx: Context) -> Transform:
    return Transform()


def _apply(ctx: Context, it: T, t: Transform) -> T:
    return transformed(ctx, it, t.matrix)


MAKERS: dict[str, Maker] = {
    "identity": _identity,
    "move": _move,
    "rotate": _rotate,
    "scale": _scale,
    "mirror": _mirror,
    "apply": _apply,
}
