"""What every scene must satisfy, whatever made it; run after assembly and in the tests.

A failure here is our mistake, never the user's: what a script can do wrong has been reported
before.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Any, assert_never, get_args

import numpy as np
from numpy.typing import NDArray

from blobscript import ir, kernels, texture

__all__ = ["InvalidSceneError", "verify"]


class InvalidSceneError(AssertionError):
    """The scene breaks a promise of `ir`: an internal error."""


def _need(condition: object, what: str) -> None:
    if not condition:
        raise InvalidSceneError(f"invalid scene: {what}")


def verify(scene: ir.Scene) -> None:
    """Raise InvalidSceneError where the scene breaks a promise of `ir`."""
    _need(scene.surfaces, "it has no surface")
    for surface in scene.surfaces:
        _need(np.isfinite(surface.threshold), f"{surface.name}: threshold is not finite")
        _need(0 <= surface.material < len(scene.materials), f"{surface.name}: material index")
        _verify_field(surface.field, scene)
    for material in scene.materials:
        _verify_material(material)
    _need(len(set(scene.materials)) == len(scene.materials), "a material stands twice in the table")
    _verify_camera(scene.camera)
    for light in scene.lights:
        _verify_light(light)
    _need(scene.width >= 1 and scene.height >= 1, "image size")
    _finite((scene.background.color,), "background")
    _verify_stage(scene)


def _finite(arrays: Iterable[object], what: str) -> None:
    for array in arrays:
        _need(np.isfinite(np.asarray(array, dtype=np.float64)).all(), f"{what}: a number is not finite")


# ---- fields --------------------------------------------------------------------------


#: Nodes that are folds of two: below themselves they are one.
_FOLDS = ("sum", "max", "min")


def _verify_field(field: ir.Field, scene: ir.Scene) -> None:
    match field:
        case ir.Leaf():
            _verify_leaf(field, scene)
        case ir.Node():
            _need(field.op in get_args(ir.Op), f"unknown node {field.op!r}")
            _need(len(field.children) != 1, "a node has one child")
            for child in field.children:
                same = isinstance(child, ir.Node) and child.op == field.op in _FOLDS and bool(child.children)
                _need(not same, f"a {field.op} stands directly below a {field.op}")
                _verify_field(child, scene)
        case _:
            assert_never(field)


def _verify_leaf(leaf: ir.Leaf, scene: ir.Scene) -> None:
    n = leaf.count
    _need(n > 0, "a leaf has no blobs")
    for name, kind in (("reach", np.float64), ("weight", np.float64), ("paint", np.int32), ("origin", np.int32)):
        _array(getattr(leaf, name), (n,), kind, f"leaf.{name}")
    _finite((leaf.reach, leaf.weight), "leaf")
    _need((leaf.reach > 0).all(), "a reach is not positive")
    _need((leaf.weight != 0).all(), "a weight is 0")
    _need((leaf.paint >= -1).all() and (leaf.paint < len(scene.materials)).all(), "paint index")
    _need((leaf.origin >= -1).all() and (leaf.origin < max(len(scene.spans), 1)).all(), "origin index")
    if leaf.matrix is not None:
        _array(leaf.matrix, (3, 4), np.float64, "leaf.matrix")
        _finite((leaf.matrix,), "leaf.matrix")
        _need(np.linalg.det(leaf.matrix[:, :3]) != 0, "a matrix flattens space")
    _verify_kernel(leaf.kernel)
    _need(n == _verify_skeleton(leaf.skeleton), "number of blobs and of skeletons")


def _array(array: Any, shape: tuple[int, ...], kind: type[np.generic], what: str) -> None:
    _need(isinstance(array, np.ndarray), f"{what} is no array")
    _need(array.shape == shape and array.dtype == kind, f"{what} has shape {array.shape}, type {array.dtype}")
    _need(array.flags.c_contiguous, f"{what} is not contiguous")


def _verify_kernel(kernel: ir.Kernel) -> None:
    if kernel.pieces:
        _need(kernel.pieces[0].r_lo == 0 and kernel.pieces[-1].r_hi == 1, "kernel pieces do not cover 0..1")
        for piece, after in pairwise(kernel.pieces):
            _need(piece.r_hi == after.r_lo, "kernel pieces leave a gap")
    else:
        row = kernels.KERNELS.get(kernel.name)
        _need(row, f"unknown kernel {kernel.name!r}")
        _need(not (row and row.has_parameter) or 0 < kernel.a < np.inf, "kernel parameter")


# ---- skeletons -----------------------------------------------------------------------


def _verify_skeleton(skeleton: ir.Skeleton) -> int:
    """How many blobs it is for."""
    match skeleton:
        case ir.Points(at):
            _points(at, 1)
            return len(at)
        case ir.Lines(a, b):
            _points(a, 1)
            _points(b, 1)
            _need(len(a) == len(b), "lines have different numbers of points at their ends")
            return len(a)
        case ir.Polyline(points):
            _points(points, 2)
        case ir.Polygon(points, triangles):
            _points(points, 3)
            _triangles(triangles, len(points))
        case ir.Polyhedron(points, triangles):
            _points(points, 4)
            _triangles(triangles, len(points))
            _closed(triangles, len(points))
        case ir.Mesh(points, triangles, solid):
            _points(points, 1)
            _triangles(triangles, len(points))
            if solid:
                _closed(triangles, len(points))
        case _:
            assert_never(skeleton)
    return 1


def _points(points: NDArray[np.float64], least: int) -> None:
    _array(points, (len(points), 3), np.float64, "points")
    _need(len(points) >= least, f"{len(points)} points, {least} needed")
    _finite((points,), "points")


def _triangles(triangles: NDArray[np.int32], n: int) -> None:
    _array(triangles, (len(triangles), 3), np.int32, "triangles")
    _need(len(triangles) > 0, "no triangles")
    _need((triangles >= 0).all() and (triangles < n).all(), "triangle index")


def _closed(triangles: NDArray[np.int32], n: int) -> None:
    start = triangles.ravel().astype(np.int64)
    end = np.roll(triangles, -1, axis=1).ravel().astype(np.int64)
    there = np.sort(start * n + end)
    _need(np.array_equal(there, np.sort(end * n + start)), "a solid is open")
    _need((np.diff(there) > 0).all(), "an edge of a solid is used twice")


# ---- looks ---------------------------------------------------------------------------


def _verify_material(m: ir.Material) -> None:
    _finite((m.color, m.absorption, m.emission), "material")
    for name in ("roughness", "metalness", "specular", "transmission", "reflection"):
        _need(0 <= getattr(m, name) <= 1, f"material {name}")
    _need(m.ior >= 1, "material ior")
    if m.texture is not None:
        _verify_texture(m.texture)


def _verify_texture(t: ir.Texture) -> None:
    known = 3 + len(t.constants)
    for name, *inputs in t.code:
        _need(name in texture.OPERATIONS, f"unknown texture operation {name!r}")
        _need(all(isinstance(i, int) and 0 <= i < known for i in inputs), "a texture reads what is not there")
        known += 1
    _need(all(0 <= register < known for _, register in t.outputs), "a texture gives what is not there")
    columns = [column for column, _ in t.outputs]
    _need(columns and len(set(columns)) == len(columns), "texture outputs")
    _need(set(columns) <= {c for part in texture.COLUMNS.values() for c in part}, "texture columns")


def _verify_stage(scene: ir.Scene) -> None:
    match scene.background.light:
        case ir.Sky(zenith, horizon, ground):
            _finite((zenith, horizon, ground), "sky")
        case ir.Environment(_, pixels, turn):
            _need(pixels.ndim == 3 and pixels.shape[2] == 3 and pixels.size, "environment pixels")
            _finite((pixels, turn), "environment")
            _need(pixels.min() >= 0, "environment light is negative")
        case None:
            pass
    if scene.floor is not None:
        _finite((scene.floor.height, scene.floor.fade), "floor")
        _need(0 <= scene.floor.material < len(scene.materials), "floor material index")
    if scene.fog is not None:
        _finite((scene.fog.distance, scene.fog.color), "fog")
        _need(scene.fog.distance > 0, "fog distance")
    _finite((scene.tone.exposure,), "exposure")


def _verify_camera(camera: ir.Camera) -> None:
    _finite((camera.at, camera.to, camera.up, camera.fov), "camera")
    _need(0 < camera.fov < np.pi, "camera fov")
    _need(camera.at != camera.to, "the camera looks nowhere")
    _need(camera.aperture >= 0, "camera aperture")
    _finite((camera.aperture, camera.focus or ()), "camera lens")


def _verify_light(light: ir.Light) -> None:
    _finite((light.color,), "light")
    match light:
        case ir.Sun(toward, _, angle):
            _finite((toward, angle), "sun")
            _need(0 <= angle <= np.pi, "a sun's angle")
            _need(any(toward), "a sun shines nowhere")
        case ir.Lamp(at, _, size):
            _finite((at, size), "lamp")
            _need(size >= 0, "a lamp's size")
        case _:
            assert_never(light)
