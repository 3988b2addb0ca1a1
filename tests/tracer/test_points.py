"""Field, gradient and paint of the C against their specification, `blobscript.field`.

Both sides sum the same terms in another order, in packed and in scene coordinates: they may differ by some
rounding errors of the terms' size (`conditioning.magnitude`), and by what rounding moves the point by times the
steepness there. Nothing else is tolerated.
"""

from __future__ import annotations

import conditioning
import numpy as np
import pytest
import random_scenes
from random_scenes import BUILT_IN, SKELETONS, USER, make_leaf, make_scene, random_field, random_scene

from blobscript import field as reference
from blobscript import ir, kernels
from blobscript.backends.native import Native

EPS = conditioning.EPS
KERNELS = BUILT_IN + USER


def places(rng: np.random.Generator, tree: ir.Field, count: int) -> np.ndarray:
    """In and a little around the extent; every tenth on a vertex of a skeleton or half way between two."""
    lo, hi = reference.extent(tree)
    points = rng.uniform(lo - 0.05 * (hi - lo), hi + 0.05 * (hi - lo), (count, 3))
    corners = np.concatenate([_corners(leaf) for leaf in conditioning.leaves(tree)])
    pick = lambda: corners[rng.integers(len(corners), size=(count + 9) // 10)]  # noqa: E731
    points[::10] = np.where(rng.random((len(pick()), 1)) < 0.5, pick(), 0.5 * (pick() + pick()))
    return points


def _corners(leaf: ir.Leaf) -> np.ndarray:
    match leaf.skeleton:
        case ir.Points(at=points):
            pass
        case ir.Lines(a=a, b=b):
            points = np.concatenate([a, b])
        case other:
            points = other.points
    if leaf.matrix is None:
        return points
    return (points - leaf.matrix[:, 3]) @ np.linalg.inv(leaf.matrix[:, :3]).T


def allowed(tree: ir.Field, points: np.ndarray) -> np.ndarray:
    """8 rounding errors of the terms, and 16 of the position (packing, mapping and the distance)."""
    lo, hi = reference.extent(tree)
    size = np.linalg.norm(points, axis=1) + np.abs(np.stack([lo, hi])).max()
    return 8.0 * EPS * conditioning.magnitude(tree, points) + 16.0 * EPS * size * _steepest(tree)


def _steepest(tree: ir.Field) -> float:
    """A bound of the field's slope: points on a crease of the distance see either side of it."""
    total = 0.0
    for leaf in conditioning.leaves(tree):
        stretch = 1.0 if leaf.matrix is None else float(np.linalg.norm(leaf.matrix[:, :3], 2))
        total += float(np.sum(np.abs(leaf.weight) / leaf.reach)) * kernels.lipschitz(leaf.kernel) * stretch
    return total


def assert_same_gradient(tree: ir.Field, points: np.ndarray, found: np.ndarray) -> None:
    """Where the gradient is continuous around the point, to 1e-9 of the field's slope (the curvature of the
    kernels times rounding is far below); elsewhere the winner may be another by rounding, and it must be finite."""
    assert np.isfinite(found).all()
    expected, steepest = reference.gradient(tree, points), _steepest(tree)
    smooth = np.ones(len(points), dtype=bool)
    for axis in range(3):
        for h in (-1e-7, 1e-7):
            beside = reference.gradient(tree, points + h * np.eye(3)[axis])
            smooth &= np.linalg.norm(beside - expected, axis=1) <= 1e-3 * steepest
    assert smooth.mean() > 0.8
    difference = np.linalg.norm(found - expected, axis=1)
    assert difference[smooth].max(initial=0.0) <= 1e-9 * steepest


# ---- trees of everything -----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", SKELETONS)
@pytest.mark.parametrize("mapped", [0.0, 1.0], ids=["plain", "mapped"])
def test_skeleton(kind: str, mapped: float):
    """One leaf of each kind, with and without a map, all kernels in turn."""
    for seed, kernel in enumerate(KERNELS):
        rng = np.random.default_rng([seed, 1])
        leaf = random_scenes.random_leaf(rng, (kind,), (kernel,), mapped=mapped)
        points = places(rng, leaf, 200)
        native = Native(make_scene((leaf, 0.5)))
        error = np.abs(native.field(points) - reference.field_value(leaf, points))
        assert (error <= allowed(leaf, points)).all()
        assert_same_gradient(leaf, points, native.gradient(points))


@pytest.mark.parametrize("seed", range(24))
def test_tree(seed: int):
    rng = np.random.default_rng([seed, 2])
    tree = random_field(rng, depth=1 + seed % 4)
    points = places(rng, tree, 500)
    native = Native(make_scene((tree, 0.5)))
    error = np.abs(native.field(points) - reference.field_value(tree, points))
    assert (error <= allowed(tree, points)).all()
    assert_same_gradient(tree, points, native.gradient(points))


def test_each_surface_has_its_own_field():
    rng = np.random.default_rng(5)
    scene = random_scene(rng, surfaces=3)
    native = Native(scene)
    points = rng.uniform(-1, 1, (100, 3))
    for i, surface in enumerate(scene.surfaces):
        error = np.abs(native.field(points, i) - reference.field_value(surface.field, points))
        assert (error <= allowed(surface.field, points)).all()


@pytest.mark.parametrize("op", ["max", "min"])
def test_what_is_out_of_reach_counts_as_zero(op: str):
    """A max of a negative child and nothing is 0, not the child; a min of a positive one and nothing, too."""
    weight = -1.0 if op == "max" else 1.0
    near = make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("soft2"), 1.0, weight)
    away = make_leaf(ir.Points(np.array([[5.0, 0, 0]])), ir.Kernel("soft2"), 1.0, weight)
    native = Native(make_scene((ir.Node(op, (near, away)), 0.5)))  # pyright: ignore[reportArgumentType]
    assert native.field([[0.0, 0, 0], [0.5, 0, 0], [5.0, 0.1, 0]]).tolist() == [0.0, 0.0, 0.0]
    assert native.gradient([[0.5, 0, 0]]).tolist() == [[0.0, 0.0, 0.0]]


def test_a_deep_tree():
    """200 nested nodes, sum and max by turns: the value is that of the sum of what wins on the way."""
    tree: ir.Field = make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("soft2"), 1.0, 1.0)
    for i in range(200):
        at = np.array([[0.01 * i, 0.0, 0.0]])
        other = make_leaf(ir.Points(at), ir.Kernel("soft2"), 1.0, 0.3)
        tree = ir.Node("sum" if i % 2 else "max", (tree, other))
    points = np.random.default_rng(0).uniform(-1, 3, (64, 3))
    native = Native(make_scene((tree, 0.5)))
    assert np.abs(native.field(points) - reference.field_value(tree, points)).max() < 1e-12


# ---- kernels -----------------------------------------------------------------------------------------------

EXTREME = (
    *(ir.Kernel("gauss", a) for a in (1e-3, 0.5, 50.0, 1e4)),
    *(ir.Kernel("gauss_c1", a) for a in (1e-12, 1e-3, 0.5, 0.999999, 1.000001, 30.0, 500.0)),
)


@pytest.mark.parametrize("kernel", KERNELS + EXTREME, ids=lambda k: f"{k.name}({k.a:g})")
def test_kernel(kernel: ir.Kernel):
    """Along a line through one point, with the centre, the rim and the numbers beside them: the value to 16 and
    the slope to 64 rounding errors of what is summed up in them (u = 1 - s near the rim, the exponential)."""
    leaf = make_leaf(ir.Points(np.zeros((1, 3))), kernel, 1.0, 1.0)
    native = Native(make_scene((leaf, 0.5)))
    special = [0.0, 1e-300, 1e-160, 1e-8, 1.0 / 3.0, np.nextafter(1.0, 0.0), 1.0, np.nextafter(1.0, 2.0), 1.1, 1e9]
    r = np.concatenate([special, np.sqrt([1.0 / 3.0, 0.25]), np.linspace(0.0, 1.2, 997)])
    points = np.column_stack([r, np.zeros_like(r), np.zeros_like(r)])
    s = r * r
    scale = max(abs(p) for p in kernels.peak(kernel)) * (1.0 + kernel.a * np.minimum(s, 1.0 / max(kernel.a, 1.0)))
    assert (np.abs(native.field(points) - kernels.value(kernel, s)) <= 16.0 * EPS * scale).all()
    gradient = native.gradient(points)
    assert np.isfinite(gradient).all()
    with np.errstate(all="ignore"):
        expected = np.where(s > 0.0, kernels.slope(kernel, s), 0.0) * 2.0 * r
    clear = np.abs(s - 1.0) > 1e-12  # on the rim itself the slope of a user kernel may jump
    error = np.abs(gradient[:, 0] - expected)[clear]
    assert error.max() <= 64.0 * EPS * max(np.abs(expected[clear]).max(), 1.0)
    assert (gradient[:, 1:] == 0.0).all()


@pytest.mark.parametrize("weight", [1e-300, 1e-12, 1e12, 1e100])
def test_extreme_weights(weight: float):
    leaf = make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("gauss", 4.0), 1.0, weight)
    native = Native(make_scene((leaf, 0.5 * weight)))
    points = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    np.testing.assert_allclose(native.field(points), reference.field_value(leaf, points), rtol=64 * EPS)


# ---- points that are no places -----------------------------------------------------------------------------


def test_points_that_are_not_finite():
    """Nothing is felt at infinity, and the field at NaN is NaN; the points beside them in a packet do not notice."""
    rng = np.random.default_rng(7)
    scene = random_scene(rng, depth=2)
    native = Native(scene)
    good = rng.uniform(-0.5, 0.5, (32, 3))
    expected = native.field(good)
    mixed = good.copy()
    mixed[::5] = np.array([np.nan, np.inf, -np.inf])[rng.integers(3, size=(7, 3))]
    found = native.field(mixed)
    kept = np.isfinite(mixed).all(axis=1)
    np.testing.assert_allclose(found[kept], expected[kept], rtol=0, atol=1e-13)
    nowhere = np.isnan(mixed).any(axis=1)
    assert np.isnan(found[nowhere]).all()
    assert (found[~kept & ~nowhere] == 0.0).all()
    assert nowhere.any()
    assert (~kept & ~nowhere).any()
    assert native.gradient(mixed).shape == (32, 3)


@pytest.mark.parametrize("far", [1e6, 1e100, 1e300])
def test_far_points_feel_nothing(far: float):
    """gauss is cut where nothing is left of it; a far point is neither near by overflow nor NaN."""
    scene = make_scene((random_field(np.random.default_rng(3), 2), 0.5))
    points = far * np.array([[1.0, 0, 0], [0, -1.0, 0], [0.5, 0.5, 0.7]])
    native = Native(scene)
    assert native.field(points).tolist() == [0.0, 0.0, 0.0]
    assert (native.gradient(points) == 0.0).all()


def test_no_points_and_wrong_shapes():
    native = Native(make_scene((random_field(np.random.default_rng(3), 1), 0.5)))
    assert native.field(np.zeros((0, 3))).shape == (0,)
    assert native.gradient(np.zeros((0, 3))).shape == (0, 3)
    with pytest.raises(ValueError, match="shape"):
        native.field([1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="shape"):
        native.field(np.zeros((4, 2)))
    with pytest.raises(IndexError):
        native.field(np.zeros((1, 3)), surface=1)
    strided = np.random.default_rng(0).uniform(-1, 1, (20, 6))[::2, ::2]
    np.testing.assert_array_equal(native.field(strided), native.field(np.ascontiguousarray(strided)))
    single = np.random.default_rng(0).uniform(-1, 1, (9, 3)).astype(np.float32)
    np.testing.assert_array_equal(native.field(single), native.field(single.astype(np.float64)))


def test_an_empty_field_is_zero():
    native = Native(make_scene((ir.Node("sum", ()), 0.5)))
    assert native.field(np.zeros((3, 3))).tolist() == [0.0, 0.0, 0.0]
    assert native.first_hit(np.zeros((3, 3)), np.ones((3, 3))).status.tolist() == [0, 0, 0]


# ---- paint -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kernels", [KERNELS, tuple(k for k in KERNELS if k.name != "gauss")], ids=["all", "compact"])
@pytest.mark.parametrize("seed", range(12))
def test_paint(seed: int, kernels: tuple[ir.Kernel, ...]):
    """Material rows blended at points on and off the surfaces, to the rounding of a weighted mean (the shares of
    terms near the rim of their reach are tiny differences, so 1e-9); at ties the winner may be either. Where
    nothing but the tails of Gaussians is felt, the tracer has cut them off: not compared."""
    rng = np.random.default_rng([seed, 3])
    scene = random_scene(rng, depth=seed % 4, surfaces=1 + seed % 2, kernels=kernels)
    rows = np.stack([reference.material_row(m) for m in scene.materials])
    native = Native(scene)
    for i, surface in enumerate(scene.surfaces):
        points = places(rng, surface.field, 300)
        if kernels == KERNELS:
            points = points[reference.field_value(surface.field, points) > 1e-9]
        expected = reference.material(surface, points, scene)
        found = native.paint(points, np.full(len(points), i), rows)
        different = np.abs(found - expected).max(axis=1, initial=0.0) > 1e-9
        stable = np.ones(len(points), dtype=bool)
        for h in (-1e-9, 1e-9):
            beside = reference.material(surface, points + h, scene)
            stable &= np.abs(beside - expected).max(axis=1, initial=0.0) < 1e-5
        assert len(points) == 0 or stable.mean() > 0.8
        assert not (different & stable).any()


def test_paint_does_not_depend_on_the_points_beside():
    """Two touching negative blobs of their own colours under a threshold below 0: each point takes the colour
    of what it feels, also when the points of its packet feel the other one."""
    at = np.array([[0.0, 0, 0], [2.0, 0, 0]])
    leaf = make_leaf(ir.Points(at), ir.Kernel("soft2"), 1.0, -1.0, paint=[1, 2])
    scene = make_scene((leaf, -0.5))
    rows = np.stack([reference.material_row(m) for m in scene.materials])
    points = np.array([[0.3, 0, 0], [1.7, 0, 0]])
    together = Native(scene).paint(points, [0, 0], rows)
    np.testing.assert_array_equal(together, rows[[1, 2]])
    for i in range(2):
        np.testing.assert_array_equal(Native(scene).paint(points[i : i + 1], [0], rows)[0], together[i])


def test_paint_of_no_surface_is_zero():
    scene = random_scene(np.random.default_rng(3))
    rows = np.stack([reference.material_row(m) for m in scene.materials])
    out = Native(scene).paint(np.zeros((3, 3)), [-1, 0, 99], rows)
    assert (out[0] == 0.0).all() and (out[2] == 0.0).all() and out[1].any()
