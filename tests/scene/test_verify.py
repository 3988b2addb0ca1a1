"""Every promise of the scene IR: keeping it passes, breaking it is noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blobscript import ir
from blobscript.verify import InvalidSceneError, verify

TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype=np.int32)


def leaf(skeleton=None, n=1, **changes) -> ir.Leaf:
    made = ir.Leaf(
        skeleton or ir.Points(np.zeros((n, 3))),
        ir.Kernel("wyvill"),
        np.ones(n),
        np.ones(n),
        np.full(n, -1, dtype=np.int32),
        np.full(n, -1, dtype=np.int32),
    )
    return replace(made, **changes)


def scene(field: ir.Field | None = None, **changes) -> ir.Scene:
    made = ir.Scene(
        (ir.Surface("egg", leaf() if field is None else field, 0.5, 0, None),),
        (ir.Material((1.0, 1.0, 1.0)),),
        ir.Camera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.7),
        (ir.Sun((0.0, -1.0, 0.0), (1.0, 1.0, 1.0)), ir.Lamp((0.0, 9.0, 0.0), (1.0, 1.0, 1.0))),
        ir.Background((0.0, 0.0, 0.0)),
    )
    return replace(made, **changes)


def piece(lo, hi) -> ir.KernelPiece:
    return ir.KernelPiece(lo, hi, "s", 0.0, 1.0, (1.0, -1.0), 0, True)


@pytest.mark.parametrize(
    "field",
    [
        leaf(),
        leaf(n=5),
        leaf(ir.Lines(np.zeros((1, 3)), np.ones((1, 3)))),
        leaf(ir.Polyline(TETRAHEDRON, True)),
        leaf(ir.Polygon(TETRAHEDRON[:3], FACES[:1])),
        leaf(ir.Polyhedron(TETRAHEDRON, FACES, True)),
        leaf(ir.Mesh(TETRAHEDRON, FACES[:2], False)),
        leaf(ir.Mesh(TETRAHEDRON, FACES, True)),
        leaf(matrix=np.eye(3, 4)),
        leaf(kernel=ir.Kernel("mine", pieces=(piece(0, 0.5), piece(0.5, 1)))),
        ir.Node("sum", ()),
        ir.Node("max", (leaf(), ir.Node("sum", (leaf(), leaf())), ir.Node("sum", ()))),
    ],
)
def test_good_fields(field):
    verify(scene(field))


@pytest.mark.parametrize(
    "field, words",
    [
        (leaf(n=0), "no blobs"),
        (leaf(reach=np.zeros(1)), "reach"),
        (leaf(reach=np.full(1, np.inf)), "finite"),
        (leaf(weight=np.zeros(1)), "weight is 0"),
        (leaf(weight=np.full(1, np.nan)), "finite"),
        (leaf(weight=np.ones(2)), "weight has shape"),
        (leaf(weight=np.ones(1, dtype=np.float32)), "float32"),
        (leaf(n=2, weight=np.ones(4)[::2]), "contiguous"),
        (leaf(paint=np.ones(1, dtype=np.int32)), "paint"),
        (leaf(origin=np.full(1, 7, dtype=np.int32)), "origin"),
        (leaf(ir.Points(np.zeros((2, 3)))), "number of blobs"),
        (leaf(ir.Points(np.full((1, 3), np.nan))), "finite"),
        (leaf(ir.Lines(np.zeros((1, 3)), np.zeros((2, 3)))), "different numbers"),
        (leaf(ir.Polyline(TETRAHEDRON[:1].copy(), False)), "2 needed"),
        (leaf(ir.Polygon(TETRAHEDRON, FACES + 1)), "index"),
        (leaf(ir.Polygon(TETRAHEDRON, FACES[:0])), "no triangles"),
        (leaf(ir.Polyhedron(TETRAHEDRON, FACES[:3].copy(), True)), "open"),
        (leaf(ir.Polyhedron(TETRAHEDRON, np.concatenate([FACES, FACES]), True)), "twice"),
        (leaf(ir.Mesh(TETRAHEDRON, FACES[:3].copy(), True)), "open"),
        (leaf(matrix=np.zeros((3, 4))), "flattens"),
        (leaf(matrix=np.eye(4)), "matrix has shape"),
        (leaf(kernel=ir.Kernel("none")), "unknown kernel"),
        (leaf(kernel=ir.Kernel("gauss", 0.0)), "parameter"),
        (leaf(kernel=ir.Kernel("mine", pieces=(piece(0, 0.5),))), "cover"),
        (leaf(kernel=ir.Kernel("mine", pieces=(piece(0, 0.4), piece(0.5, 1)))), "gap"),
        (ir.Node("sum", (leaf(),)), "one child"),
        (ir.Node("sum", (leaf(), ir.Node("sum", (leaf(), leaf())))), "directly below"),
    ],
)
def test_bad_fields(field, words):
    with pytest.raises(InvalidSceneError, match=words):
        verify(scene(field))


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"surfaces": ()}, "no surface"),
        ({"surfaces": (ir.Surface("egg", leaf(), np.nan, 0, None),)}, "threshold"),
        ({"surfaces": (ir.Surface("egg", leaf(), 0.5, 1, None),)}, "material index"),
        ({"materials": (ir.Material((1, 1, 1)),) * 2}, "twice"),
        ({"materials": (ir.Material((1, 1, 1), roughness=2),)}, "roughness"),
        ({"materials": (ir.Material((1, 1, 1), ior=0.5),)}, "ior"),
        ({"materials": (ir.Material((1, np.nan, 1)),)}, "finite"),
        ({"camera": ir.Camera((0, 0, 0), (0, 0, 0), (0, 1, 0), 0.7)}, "nowhere"),
        ({"camera": ir.Camera((0, 0, 9), (0, 0, 0), (0, 1, 0), 4)}, "fov"),
        ({"lights": (ir.Sun((0, 0, 0), (1, 1, 1)),)}, "nowhere"),
        ({"lights": (ir.Lamp((0, np.inf, 0), (1, 1, 1)),)}, "finite"),
        ({"background": ir.Background((0, 0, np.nan))}, "finite"),
        ({"width": 0}, "size"),
    ],
)
def test_bad_scenes(changes, words):
    with pytest.raises(InvalidSceneError, match=words):
        verify(scene(**changes))
