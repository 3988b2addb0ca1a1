"""The reference evaluator against the definition, differences, and its own bounds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_scenes import (
    BUILT_IN,
    OCTAHEDRON,
    SHELL,
    SKELETONS,
    USER,
    make_leaf,
    make_scene,
    random_field,
    random_leaf,
    random_matrix,
    sphere,
)

from blobscript import field as reference
from blobscript import geometry, kernels
from blobscript.ir import Kernel, Leaf, Lines, Mesh, Node, Points, Polyhedron, Polyline

SEEDS = st.integers(0, 2**32 - 1)


def mean_by_powers(values: list[np.ndarray], axis: int) -> np.ndarray:
    positive = np.maximum(values, 0.0)
    total = (positive**8).sum(axis=axis)
    return np.where(total > 0.0, (positive**9).sum(axis=axis) / np.where(total > 0.0, total, 1.0), 0.0)


FOLDS = {
    "sum": np.sum,
    "max": np.max,
    "min": np.min,
    "smooth_max": mean_by_powers,
    "smooth_min": lambda values, axis: -mean_by_powers(np.negative(values), axis),
}


def defined_value(field, points: np.ndarray) -> np.ndarray:
    """The sentence of the language's reference, element by element, without any culling."""
    if isinstance(field, Node):
        values = [defined_value(child, points) for child in field.children]
        fold = FOLDS[field.op]
        return fold(values, axis=0) if values else np.zeros(len(points))
    mapped = points if field.matrix is None else points @ field.matrix[:, :3].T + field.matrix[:, 3]
    total = np.zeros(len(points))
    for i in range(field.count):
        match field.skeleton:
            case Points(at):
                part = Points(at[i : i + 1])
            case Lines(a, b):
                part = Lines(a[i : i + 1], b[i : i + 1])
            case part:
                pass
        distance = np.linalg.norm(geometry.offsets(part, mapped), axis=1)
        total += field.weight[i] * kernels.value(field.kernel, (distance / field.reach[i]) ** 2)
    return total


def places(field, rng: np.random.Generator, count: int) -> np.ndarray:
    lo, hi = reference.extent(field)
    return rng.uniform(lo - 0.1, hi + 0.1, (count, 3))


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_value_is_the_definition(seed: int):
    rng = np.random.default_rng(seed)
    field = random_field(rng, 2)
    points = places(field, rng, 64)
    assert np.allclose(reference.field_value(field, points), defined_value(field, points), rtol=0, atol=1e-13)


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_gradient_agrees_with_differences(seed: int):
    """Central differences where the field is smooth: where two step widths agree with each other."""
    rng = np.random.default_rng(seed)
    field = random_field(rng, 2)
    points = places(field, rng, 64)

    def difference(h: float) -> np.ndarray:
        steps = h * np.eye(3)
        ends = [[reference.field_value(field, points + sign * e) for e in steps] for sign in (1, -1)]
        return (np.array(ends[0]) - np.array(ends[1])).T / (2 * h)

    wide, narrow = difference(2e-5), difference(1e-5)
    smooth = np.linalg.norm(wide - narrow, axis=1) < 1e-7
    assert smooth.sum() > 8
    assert np.allclose(reference.gradient(field, points)[smooth], narrow[smooth], rtol=0, atol=3e-7)


@settings(max_examples=80, deadline=None)
@given(SEEDS, st.floats(-6, 0.5))
def test_value_lies_in_the_bounds_of_any_box_around_its_point(seed: int, size: float):
    rng = np.random.default_rng(seed)
    field = random_field(rng, 2)
    points = places(field, rng, 48)
    below, above = rng.uniform(0, 10.0**size, (2, 48, 3)) * (rng.random((2, 48, 3)) < 0.9)
    low, high = reference.bounds(field, points - below, points + above)
    for share in rng.random((4, 48, 3)):
        value = reference.field_value(field, points - below + share * (below + above))
        assert np.all(low <= value)
        assert np.all(value <= high)
    value = reference.field_value(field, points)
    assert np.all((low <= value) & (value <= high))


@pytest.mark.parametrize("kind", SKELETONS)
@pytest.mark.parametrize("kernel", [*BUILT_IN, *USER], ids=lambda k: f"{k.name}{k.a or ''}")
def test_bounds_shrink_with_their_box(kind: str, kernel: Kernel):
    """First order: over boxes of size h they are within a constant times h of the value."""
    rng = np.random.default_rng(3)
    leaf = random_leaf(rng, (kind,), (kernel,), mapped=0.5)
    points = places(leaf, rng, 100)
    speed = 1.0 if leaf.matrix is None else float(np.linalg.norm(leaf.matrix[:, :3], 2))
    constant = np.sum(np.abs(leaf.weight) / leaf.reach) * kernels.lipschitz(kernel) * speed
    for h in (1e-2, 1e-4, 1e-6):
        low, high = reference.bounds(leaf, points - h, points + h)
        assert np.all(high - low <= 8.0 * h * constant + 1e-11)


def test_bounds_are_exact_for_points_and_boxes():
    leaf = make_leaf(Points(np.zeros((1, 3))), Kernel("soft2"), 1.0, 1.0)
    low, high = reference.bounds(leaf, [[0.3, 0.0, -0.4]], [[0.6, 0.0, 0.0]])
    assert low[0] == pytest.approx((1 - 0.52) ** 2, rel=1e-14)
    assert high[0] == pytest.approx((1 - 0.09) ** 2, rel=1e-14)


def test_what_is_not_there_counts_as_zero_in_max_and_min():
    hole = make_leaf(Points(np.zeros((1, 3))), Kernel("soft2"), 1.0, -1.0)
    far = make_leaf(Points(np.full((1, 3), 9.0)), Kernel("soft2"), 1.0, 1.0)
    origin = np.zeros((1, 3))
    assert reference.field_value(Node("max", (hole, far)), origin)[0] == 0.0
    assert reference.field_value(Node("min", (hole, far)), origin)[0] == -1.0
    assert reference.field_value(Node("max", (hole,)), origin)[0] == -1.0
    assert reference.field_value(Node("max", ()), origin)[0] == 0.0


def test_a_mesh_is_the_max_of_its_triangles():
    rng = np.random.default_rng(4)
    points, faces = sphere(1)
    mesh = make_leaf(Mesh(points, faces, False), Kernel("wyvill"), 0.6, 1.2)
    each = [make_leaf(Mesh(points, face[None], False), Kernel("wyvill"), 0.6, 1.2) for face in faces]
    where = rng.uniform(-1.5, 1.5, (500, 3))
    together = reference.field_value(Node("max", tuple(each)), where)
    assert np.allclose(reference.field_value(mesh, where), together, rtol=0, atol=1e-14)


def test_a_polyline_is_the_max_of_its_lines():
    rng = np.random.default_rng(5)
    points = rng.uniform(-1, 1, (6, 3))
    whole = make_leaf(Polyline(points, False), Kernel("metaball"), 0.7, 1.0)
    parts = [make_leaf(Lines(points[i : i + 1], points[i + 1 : i + 2]), Kernel("metaball"), 0.7, 1.0) for i in range(5)]
    where = rng.uniform(-1.5, 1.5, (500, 3))
    together = reference.field_value(Node("max", tuple(parts)), where)
    assert np.allclose(reference.field_value(whole, where), together, rtol=0, atol=1e-14)


def test_transformed_field_is_the_field_of_the_mapped_point():
    rng = np.random.default_rng(6)
    for kind in SKELETONS:
        leaf = random_leaf(rng, (kind,), mapped=0.0)
        matrix = random_matrix(rng)
        moved = Leaf(leaf.skeleton, leaf.kernel, leaf.reach, leaf.weight, leaf.paint, leaf.origin, matrix)
        where = rng.uniform(-2, 2, (300, 3))
        image = where @ matrix[:, :3].T + matrix[:, 3]
        assert np.array_equal(reference.field_value(moved, where), reference.field_value(leaf, image))
        expected = reference.gradient(leaf, image) @ matrix[:, :3]
        assert np.allclose(reference.gradient(moved, where), expected, rtol=1e-12, atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_the_field_vanishes_outside_its_extent(seed: int):
    rng = np.random.default_rng(seed)
    field = random_field(rng, 2)
    lo, hi = reference.extent(field)
    where = rng.uniform(lo - 2, hi + 2, (300, 3))
    where = where[np.any((where < lo) | (where > hi), axis=1)]
    assert np.all(np.abs(reference.field_value(field, where)) < 1e-14)


def test_extent_of_a_ball_is_tight_under_a_map():
    leaf = make_leaf(
        Points(np.zeros((1, 3))),
        Kernel("soft2"),
        2.0,
        1.0,
        matrix=np.array([[0.5, 0, 0, 1.0], [0, 1.0, 0, 0], [0, 0, 4.0, 0]]),
    )
    lo, hi = reference.extent(leaf)
    assert np.allclose(lo, [-6, -2, -0.5], atol=1e-10)
    assert np.allclose(hi, [2, 2, 0.5], atol=1e-10)


def test_many_elements_against_brute_force():
    rng = np.random.default_rng(7)
    leaf = make_leaf(Points(rng.uniform(size=(10_000, 3))), Kernel("soft2"), 0.02, 1.0)
    where = rng.uniform(size=(1000, 3))
    brute = np.linalg.norm(where[:, None] - leaf.skeleton.at[None], axis=2) / 0.02
    expected = np.sum(np.maximum(1 - brute**2, 0) ** 2, axis=1)
    assert np.allclose(reference.field_value(leaf, where), expected, rtol=0, atol=1e-12)


def test_gaussians_are_summed_far_beyond_their_surface():
    leaf = make_leaf(Points(np.zeros((1, 3))), Kernel("gauss", 1.0), 1.0, 1e30)
    where = np.array([[9.0, 0, 0], [12.0, 0, 0]])
    assert np.allclose(reference.field_value(leaf, where), 1e30 * np.exp([-81.0, -144.0]), rtol=1e-12)


def test_points_at_the_skeleton_have_no_gradient():
    cone = make_leaf(Points(np.zeros((1, 3))), SHELL, 1.0, 1.0)
    assert np.array_equal(reference.gradient(cone, np.zeros((1, 3))), np.zeros((1, 3)))
    solid = make_leaf(Polyhedron(*OCTAHEDRON, True), Kernel("soft2"), 1.0, 1.0)
    assert np.array_equal(reference.gradient(solid, np.zeros((1, 3))), np.zeros((1, 3)))


@pytest.mark.parametrize("kind", SKELETONS)
@pytest.mark.parametrize("kernel", [BUILT_IN[0], BUILT_IN[3], BUILT_IN[4], *USER], ids=lambda k: k.name)
def test_places_far_away_are_outside_of_everything(kind: str, kernel: Kernel):
    """No overflow (a warning is an error here), no NaN, but 0."""
    rng = np.random.default_rng(9)
    where = np.array([[1e200, 0, 0], [1e308, 1e308, -1e308], [np.inf, 0, 0], [-np.inf, np.inf, 0]])
    for mapped in (0.0, 1.0):
        leaf = random_leaf(rng, (kind,), (kernel,), mapped=mapped)
        assert np.all(reference.field_value(leaf, where) == 0.0)
        assert np.all(reference.gradient(leaf, where) == 0.0)
        low, high = reference.bounds(leaf, where, where)
        assert np.all((low <= 0.0) & (high >= 0.0) & (high - low < 1e-12))
        low, high = reference.bounds(leaf, [[-1e308] * 3], [[1e308] * 3])
        total = np.sum(np.abs(leaf.weight)) * 1.4
        assert -total <= low[0] <= high[0] <= total
        assert np.all(np.isfinite(reference.field_value(leaf, [[1e-200, 0, -1e-308]])))


def test_no_points_and_no_elements():
    leaf = make_leaf(Points(np.zeros((0, 3))), Kernel("soft2"), 1.0, 1.0)
    assert reference.field_value(leaf, np.zeros((2, 3))).tolist() == [0.0, 0.0]
    assert reference.field_value(leaf, np.zeros((0, 3))).shape == (0,)
    assert reference.gradient(leaf, np.zeros((0, 3))).shape == (0, 3)
    assert reference.bounds(leaf, np.zeros((1, 3)), np.ones((1, 3)))[1][0] == 0.0
    assert np.array_equal(reference.extent(leaf)[0], np.zeros(3))


# ---- paint ----------------------------------------------------------------------------------------


def colors(field, where, threshold: float = 0.1) -> np.ndarray:
    scene = make_scene((field, threshold))
    return reference.material(scene.surfaces[0], np.atleast_2d(where), scene)[:, reference.MATERIAL_ROW["color"]]


def painted(x: float, weight: float, paint: int) -> Leaf:
    return make_leaf(Points(np.array([[x, 0.0, 0.0]])), Kernel("soft2"), 2.0, weight, paint)


BLUE, GREEN, OWN = (0.1, 0.3, 0.8), (0.1, 0.8, 0.1), (0.8, 0.3, 0.1)


def test_sum_blends_paint_by_positive_contribution():
    both = make_leaf(Points(np.array([[0.0, 0, 0], [1.0, 0, 0]])), Kernel("soft2"), 2.0, [1.0, 2.0], [1, 2])
    near, far = 1.0, 2 * (1 - 0.25) ** 2
    expected = (near * np.array(BLUE) + far * np.array(GREEN)) / (near + far)
    assert np.allclose(colors(both, (0, 0, 0)), expected, rtol=1e-14)
    apart = Node("sum", (painted(0, 1.0, 1), painted(1, 2.0, 2)))
    assert np.allclose(colors(apart, (0, 0, 0)), expected, rtol=1e-14)
    with_hole = Node("sum", (painted(0, 1.0, 1), painted(1, 2.0, 2), painted(0.5, -0.7, 0)))
    assert np.allclose(colors(with_hole, (0, 0, 0)), expected, rtol=1e-14)


def test_max_and_min_take_the_paint_of_the_winner():
    children = (painted(0, 1.0, 1), painted(0.5, 1.5, 2))
    assert np.allclose(colors(Node("max", children), (0, 0, 0)), GREEN)
    assert np.allclose(colors(Node("min", children), (0, 0, 0)), BLUE)


def test_a_max_is_one_term_of_a_sum():
    tree = Node("sum", (Node("max", (painted(0, 1.0, 1), painted(0, 3.0, 2))), painted(0, 1.0, -1)))
    assert np.allclose(colors(tree, (0, 0, 0)), (3 * np.array(GREEN) + np.array(OWN)) / 4, rtol=1e-14)


def test_without_positive_contribution_the_largest_has_its_paint():
    tree = Node("sum", (painted(0, -1.0, 1), painted(0, -0.5, 2)))
    assert np.allclose(colors(tree, (0.1, 0, 0), -0.5), GREEN)
    assert np.allclose(colors(tree, (50, 0, 0), -0.5), OWN)
