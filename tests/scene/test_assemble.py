"""Assembly against the definition, on random trees, and rule by rule."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from blobscript import field as reference
from blobscript import framing, ir, kernels, values
from blobscript.assemble import DEFAULT_LIGHTS
from blobscript.values import Blob, Changed, Color, Combine, Dot, MakerError

WYVILL = ir.Kernel("wyvill")
SOFT = ir.Kernel("soft2")
GAUSS = ir.Kernel("gauss", 4.0)


def only_leaf(tree: ir.Field) -> ir.Leaf:
    assert isinstance(tree, ir.Leaf)
    return tree


# ---- the definition --------------------------------------------------------------------


def defined(value, points, threshold, kernel=WYVILL):
    """What the language says that a field value means, at (n, 3) points; slow and plain."""
    match value:
        case Changed():
            if value.matrix is not None:
                m = np.array(value.matrix).reshape(3, 4)
                points = np.linalg.solve(m[:, :3], (points - m[:, 3]).T).T
            return value.factor * defined(value.inner, points, threshold, kernel)
        case Combine():
            below = value.kernel or kernel
            parts = [defined(child, points, threshold, below) for child in value.children]
            if value.op == "smooth_max":
                return mean_by_powers(parts, points)
            fold = {"sum": np.sum, "max": np.max, "min": np.min}[value.op]
            return fold(parts, axis=0) if parts else np.zeros(len(points))
        case Blob():
            return defined_blob(value, points, threshold, value.kernel or kernel)


def mean_by_powers(parts, points):
    if not parts:
        return np.zeros(len(points))
    positive = np.maximum(parts, 0.0)
    total = (positive**8).sum(axis=0)
    return np.where(total > 0.0, (positive**9).sum(axis=0) / np.where(total > 0.0, total, 1.0), 0.0)


def defined_blob(blob, points, threshold, kernel):
    radius, reach, weight = blob.radius, blob.reach, blob.weight
    if radius is not None and reach is None and weight is None:
        reach = 2 * radius
    if weight is None:
        weight = 1 if radius is None else threshold / float(kernels.value(kernel, (radius / reach) ** 2))
    if reach is None:
        reach = radius / float(kernels.inverse(kernel, threshold / weight))
    if isinstance(blob.skeleton, Dot):
        distance = np.linalg.norm(points - np.array(blob.skeleton.at), axis=1)
    else:
        a, b = np.array(blob.skeleton.a), np.array(blob.skeleton.b)
        t = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-300), 0, 1)
        distance = np.linalg.norm(points - a - t[:, None] * (b - a), axis=1)
    return weight * kernels.value(kernel, (distance / reach) ** 2)


def random_value(make, rng, depth):
    def vec(size=2.0):
        return tuple(rng.uniform(-size, size) for _ in range(3))

    kernel = rng.choice([None, None, SOFT, GAUSS])
    if depth == 0 or rng.random() < 0.2:
        sizes = rng.choice(
            [
                {"radius": rng.uniform(0.3, 1)},
                {"reach": rng.uniform(0.5, 2)},
                {"reach": rng.uniform(0.5, 2), "weight": rng.uniform(-2, 2)},
                {"radius": rng.uniform(0.3, 1), "weight": rng.uniform(0.6, 3)},
                {"radius": rng.uniform(0.3, 1), "reach": rng.uniform(1.2, 3)},
            ]
        )
        if rng.random() < 0.5:
            return make.ball(at=vec(), kernel=kernel, **sizes)
        return make.blob(skeleton=make.line(a=vec(), b=vec()), kernel=kernel, **sizes)
    inner = random_value(make, rng, depth - 1)
    match rng.randrange(8):
        case 0:
            return make.move(it=inner, v=vec())
        case 1:
            return make.rotate(it=inner, x=rng.uniform(-3, 3), y=rng.uniform(-3, 3), z=rng.uniform(-3, 3))
        case 2:
            return make.scale(it=inner, x=rng.uniform(0.5, 2), y=rng.uniform(0.5, 2), z=-rng.uniform(0.5, 2))
        case 3:
            return values.scale_field(make.scale(it=inner, s=rng.uniform(0.5, 2)), rng.choice([-1, 0.5, 2, 0]))
        case 4:
            return values.subtract_fields(inner, random_value(make, rng, depth - 1))
        case 5:
            return values.add_fields(inner, make.mirror(it=inner, normal=vec(), at=vec()))
        case _:
            children = [random_value(make, rng, depth - 1) for _ in range(rng.randrange(4))]
            op = rng.choice([make.sum, make.max, make.min, make.smooth_max])
            return op(children=[inner, *children], kernel=kernel)


@pytest.mark.parametrize("seed", range(150))
def test_random_trees_mean_what_the_language_says(make, seed):
    rng = random.Random(seed)
    threshold = rng.choice([0.5, 0.3])
    value = make.sum(children=[random_value(make, rng, rng.randrange(1, 5)) for _ in range(2)])
    points = np.random.default_rng(seed).uniform(-3, 3, (200, 3))
    scene = make.good(make.surface(children=value, threshold=threshold))
    found = reference.field_value(scene.surfaces[0].field, points)
    expected = defined(value, points, threshold)
    assert np.allclose(found, expected, rtol=1e-9, atol=1e-9 * (1 + np.abs(expected).max()))


# ---- radius, reach, weight -------------------------------------------------------------


@pytest.mark.parametrize("kernel", [None, SOFT, GAUSS, ir.Kernel("gauss_c1", 3.0), ir.Kernel("metaball")])
@pytest.mark.parametrize("sizes", [{"radius": 0.7}, {"radius": 0.7, "reach": 1.9}, {"radius": 0.7, "weight": 1.3}])
def test_alone_a_blob_has_its_radius(make, kernel, sizes):
    leaf = only_leaf(make.field(make.ball(kernel=kernel, **sizes), threshold=0.4))
    density = leaf.weight[0] * kernels.value(leaf.kernel, (0.7 / leaf.reach[0]) ** 2)
    assert density == pytest.approx(0.4, rel=1e-12)
    assert leaf.reach[0] == pytest.approx(sizes.get("reach", leaf.reach[0] if "weight" in sizes else 1.4))
    assert leaf.weight[0] == pytest.approx(sizes.get("weight", leaf.weight[0]))


def test_reach_alone_has_weight_one(make):
    leaf = only_leaf(make.field(make.ball(reach=2)))
    assert (leaf.reach[0], leaf.weight[0]) == (2, 1)


def test_each_surface_solves_for_its_own_threshold(make):
    ball = make.ball(radius=1)
    scene = make.good(make.surface(children=ball, threshold=0.2), make.surface(children=ball, threshold=0.4))
    first, second = (only_leaf(surface.field).weight[0] for surface in scene.surfaces)
    assert second == pytest.approx(2 * first)


def test_factors_do_not_change_how_a_blob_is_solved(make):
    leaf = only_leaf(make.field(values.scale_field(make.ball(radius=1), -0.5)))
    assert leaf.weight[0] == pytest.approx(-0.5 * only_leaf(make.field(make.ball(radius=1))).weight[0])


@pytest.mark.parametrize(
    "sizes, threshold, words",
    [
        ({"radius": 1, "reach": 1}, 0.5, "no density"),
        ({"radius": 1, "reach": 0.5}, 0.5, "ends at 0.5"),
        ({"radius": 1, "weight": 0.5}, 0.5, "does not exceed the threshold 0.5"),
        ({"radius": 1, "weight": -1.0}, 0.5, "does not exceed"),
        ({"radius": 1}, 0.0, "not positive"),
        ({"radius": 1, "weight": 2.0}, -1.0, "not positive"),
        ({"radius": 1, "reach": 1 + 1e-16 * 4, "kernel": SOFT}, 1e39, "too large"),
        ({"radius": 1, "reach": 0.02, "kernel": GAUSS}, 0.5, "double precision"),
    ],
)
def test_sizes_that_do_not_fit(make, sizes, threshold, words):
    ball = make.ball(**sizes)
    scene, found = make.scene(make.surface(children=ball, threshold=threshold))
    assert scene is None
    assert [d.code for d in found] == ["E0406"]
    assert words in found[0].message
    assert found[0].span.line == 1
    assert found[0].labels[0].span.line == 2


def test_one_report_for_each_place(make):
    bad = make.balls(at=np.zeros((50, 3)), radius=1, reach=np.full(50, 0.5))
    assert make.codes(make.surface(children=[bad, bad, make.ball(radius=1, reach=1)])) == ["E0406", "E0406"]


def test_missing_and_too_many_sizes(make):
    places = {"ball": {}, "balls": {"at": [(0, 0, 0)]}, "blob": {"skeleton": Dot((0, 0, 0))}}
    for sizes, code in (({}, "E0302"), ({"weight": 1}, "E0302"), ({"radius": 1, "reach": 2, "weight": 1}, "E0406")):
        for name, place in places.items():
            with pytest.raises(MakerError) as caught:
                getattr(make, name)(**place, **sizes)
            assert caught.value.code == code


@pytest.mark.parametrize("name", ["radius", "reach"])
@pytest.mark.parametrize(
    "bad",
    [0, -1, math.nan, math.inf, -math.inf, 10**400, 1e-200],
    ids=list("01n+-ht"),
)
def test_sizes_must_be_positive_and_finite(make, name, bad):
    with pytest.raises(MakerError) as caught:
        make.ball(**{name: bad})
    assert caught.value.code == "E0405"
    assert caught.value.argument == name
    with pytest.raises(MakerError) as caught:
        make.balls(at=[(0, 0, 0), (1, 0, 0)], **{name: [1, bad]})
    assert caught.value.code == "E0405"


def test_threshold_must_be_finite(make):
    with pytest.raises(MakerError) as caught:
        make.surface(children=[], threshold=math.nan)
    assert caught.value.argument == "threshold"


# ---- the tree --------------------------------------------------------------------------


def test_points_of_one_kernel_become_one_leaf(make):
    tree = make.field(
        make.ball(at=(1, 0, 0), radius=1),
        make.sum(children=[make.ball(at=(2, 0, 0), radius=1), make.ball(at=(3, 0, 0), radius=1, kernel=SOFT)]),
        make.balls(at=[(4, 0, 0), (5, 0, 0)], radius=1),
        make.blob(skeleton=make.line(a=(0, 0, 0), b=(1, 0, 0)), radius=1),
        make.blob(skeleton=make.line(a=(0, 0, 0), b=(1, 1, 0)), radius=1),
    )
    assert isinstance(tree, ir.Node)
    assert sorted(leaf.count for leaf in tree.children) == [1, 2, 4]


def test_single_children_collapse(make):
    tree = make.field(make.max(children=[make.sum(children=[make.min(children=[make.ball(radius=1)])])]))
    assert isinstance(tree, ir.Leaf)


def test_max_keeps_its_children_apart(make):
    tree = make.field(make.max(children=[make.ball(radius=1), make.balls(at=[(0, 0, 0), (1, 0, 0)], radius=1)]))
    assert isinstance(tree, ir.Node)
    assert tree.op == "max"
    assert [leaf.count for leaf in tree.children] == [1, 2]


def test_a_negative_factor_turns_max_into_min(make):
    pair = make.max(children=[make.ball(reach=1), make.ball(reach=2)])
    tree = make.field(values.scale_field(pair, -1))
    assert tree.op == "min"
    assert all(leaf.weight[0] == -1 for leaf in tree.children)


def test_an_empty_max_is_zero_beside_others(make):
    tree = make.field(make.max(children=[make.sum(children=[]), make.ball(reach=1, weight=-1)]))
    assert reference.field_value(tree, np.zeros((1, 3))).tolist() == [0]


def test_inherited_kernels(make):
    tree = make.field(
        make.sum(
            children=[
                make.ball(radius=1),
                make.ball(radius=1, kernel=GAUSS),
                make.sum(children=[make.ball(radius=1)], kernel=ir.Kernel("metaball")),
            ],
            kernel=SOFT,
        ),
        make.ball(radius=1),
    )
    assert {leaf.kernel.name for leaf in tree.children} == {"soft2", "gauss", "metaball", "wyvill"}


def test_surface_hands_its_kernel_down(make):
    assert only_leaf(make.field(make.ball(radius=1), kernel=SOFT)).kernel == SOFT


def test_similar_maps_are_applied(make):
    ball = make.scale(it=make.ball(at=(1, 2, 3), radius=1), s=2)
    leaf = only_leaf(make.field(make.rotate(it=make.move(it=ball, x=1), z=math.pi / 2)))
    assert leaf.matrix is None
    assert leaf.skeleton.at.tolist() == [[-4, 3, 6]]
    assert leaf.reach[0] == 4


def test_uneven_scales_stay_as_matrix(make):
    leaf = only_leaf(make.field(make.scale(it=make.ball(radius=1), x=2), make.scale(it=make.ball(reach=1), x=2)))
    assert leaf.matrix[0].tolist() == [0.5, 0, 0, 0]
    assert leaf.count == 2


def test_surfaces_can_be_moved(make):
    leaf = only_leaf(make.good(make.scale(it=make.surface(children=make.ball(radius=1)), s=3)).surfaces[0].field)
    assert leaf.reach[0] == 6


def test_skeletons_move_without_their_blob(make):
    line = make.scale(it=make.line(a=(0, 0, 0), b=(1, 0, 0)), x=5)
    leaf = only_leaf(make.field(make.blob(skeleton=line, radius=1)))
    assert leaf.skeleton.b.tolist() == [[5, 0, 0]]
    assert leaf.reach[0] == 2


def test_mirrored_bodies_still_look_outward(make):
    tetrahedron = make.polyhedron(
        points=[(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], faces=[[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    )
    for body in (
        make.field(make.blob(skeleton=make.mirror(it=tetrahedron, normal=(1, 0, 0)), radius=0.1)),
        make.field(make.mirror(it=make.blob(skeleton=tetrahedron, radius=0.1), normal=(1, 1, 0))),
    ):
        skeleton = only_leaf(body).skeleton
        a, b, c = (skeleton.points[skeleton.triangles[:, k]] for k in range(3))
        assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0


def test_extreme_maps_are_refused(make):
    tiny = make.ball(radius=1)
    for _ in range(4):
        tiny = make.scale(it=tiny, s=1e-30)
    scene, found = make.scene(make.surface(children=tiny))
    assert scene is None
    assert found[0].code == "E0406"
    flat = make.ball(radius=1)
    for _ in range(5):
        flat = make.scale(it=flat, x=1e-39)
    assert make.codes(make.surface(children=flat)) == ["E0406"]


def test_shared_values_cannot_explode(make):
    """Forty doublings are a trillion balls."""
    value = make.ball(radius=1)
    for _ in range(40):
        value = make.sum(children=[value, value])
    scene, found = make.scene(make.surface(children=value), limit=10_000)
    assert scene is None
    assert [d.code for d in found] == ["E0901"]


def test_deep_trees(make):
    value = make.ball(radius=1)
    for _ in range(3000):
        value = make.sum(children=[value, make.ball(radius=1)])
    assert only_leaf(make.field(value)).count == 3001
    for k in range(10_100):
        value = (make.max, make.min)[k % 2](children=[value, make.ball(radius=1)])
    assert make.codes(make.surface(children=value)) == ["E0901"]


# ---- paint -----------------------------------------------------------------------------


def test_paint_inside_stays(make):
    red, blue = Color(1, 0, 0), Color(0, 0, 1)
    tree = make.field(
        make.paint(
            field=make.sum(
                children=[make.paint(field=make.ball(at=(1, 0, 0), radius=1), **{"with": red}), make.ball(radius=1)]
            ),
            **{"with": blue},
        ),
        make.ball(at=(2, 0, 0), radius=1),
    )
    scene = make.good(make.surface(children=make.sum(children=[])), make.surface(children=[]))
    assert len(scene.materials) == 1
    assert only_leaf(tree).paint.tolist() == [1, 2, -1]


def test_a_colour_keeps_the_material(make):
    plastic = make.plastic(color=Color(0, 1, 0))
    ball = make.paint(field=make.ball(radius=1), **{"with": Color(1, 0, 0)})
    scene = make.good(make.surface(children=ball, material=plastic))
    assert [m.color for m in scene.materials] == [(0, 1, 0), (1, 0, 0)]
    assert scene.materials[0].roughness == scene.materials[1].roughness


def test_equal_paint_is_one_material(make):
    balls = make.balls(at=[(0, 0, 0), (1, 0, 0), (2, 0, 0)], radius=1, paint=[Color(1, 0, 0)] * 2 + [Color(0, 1, 0)])
    scene = make.good(make.surface(children=balls, material=make.clay(color=Color(0, 1, 0))))
    assert only_leaf(scene.surfaces[0].field).paint.tolist() == [1, 1, -1]
    assert len(scene.materials) == 2


def test_materials(make):
    for name in ("clay", "plastic", "metal", "glass", "jelly", "chrome", "stone"):
        bare, red = getattr(make, name)(), getattr(make, name)(color=Color(1, 0, 0))
        assert bare.look.name == name
        assert bare.look != red.look
    assert make.glass(color=Color(1, 0, 0)).look.absorption[0] == 0
    assert make.material(roughness=0.2, emission=Color(1, 1, 1)).look.emission == (1, 1, 1)
    with pytest.raises(MakerError):
        make.material(roughness=2)


# ---- many ------------------------------------------------------------------------------


def test_balls_take_lists(make):
    n = 1000
    at = np.random.default_rng(1).uniform(-5, 5, (n, 3))
    radius = np.linspace(0.1, 0.2, n)
    leaf = only_leaf(make.field(make.balls(at=at, radius=radius)))
    assert leaf.skeleton.at is at or np.shares_memory(leaf.skeleton.at, at)
    assert np.array_equal(leaf.reach, 2 * radius)


def test_balls_of_one_point(make):
    leaf = only_leaf(make.field(make.balls(at=(1, 2, 3), reach=[2], weight=[3])))
    assert (leaf.skeleton.at.tolist(), leaf.reach.tolist(), leaf.weight.tolist()) == ([[1, 2, 3]], [2], [3])


def test_no_balls_at_all(make):
    tree = make.field(make.balls(at=[], radius=1), make.ball(radius=1))
    assert only_leaf(tree).count == 1


@pytest.mark.parametrize("name", ["radius", "paint"])
def test_lists_of_the_wrong_length(make, name):
    with pytest.raises(MakerError) as caught:
        make.balls(**{"at": [(0, 0, 0)], "radius": 1, name: [Color(1, 1, 1)] * 2 if name == "paint" else [1, 2]})
    assert caught.value.argument == name


def test_weights_of_zero_are_left_out(make):
    balls = make.balls(at=[(0, 0, 0), (1, 0, 0)], reach=1, weight=[0, 1])
    scene, found = make.scene(make.surface(children=[balls, make.ball(at=(5, 0, 0), reach=1, weight=0)]))
    assert only_leaf(scene.surfaces[0].field).count == 1
    assert [d.code for d in found] == ["W0406", "W0406"]


# ---- the scene -------------------------------------------------------------------------


def test_names_and_defaults(make):
    ball = make.ball(radius=1)
    scene = make.good((make.surface(children=ball), "egg", None), make.surface(children=ball))
    assert [surface.name for surface in scene.surfaces] == ["egg", "surface 2"]
    assert scene.lights == DEFAULT_LIGHTS
    assert scene.background.default
    assert (scene.width, scene.height) == (640, 480)


def test_given_lights_replace_the_default(make):
    scene = make.good(
        make.surface(children=make.ball(radius=1)),
        [make.sun(toward=(0, -1, 0), strength=3), make.lamp(at=(1, 2, 3), color=Color(1, 0.5, 0), strength=2)],
        make.background(color=Color(0.1, 0.2, 0.3)),
        make.image(width=100, height=50),
        make.animate(seconds=2),
    )
    assert scene.lights == (ir.Sun((0, -1, 0), (3, 3, 3)), ir.Lamp((1, 2, 3), (2, 1, 0)))
    assert scene.background == ir.Background((0.1, 0.2, 0.3))
    assert (scene.width, scene.height, scene.animate) == (100, 50, ir.Animate(2, 24))


def test_no_surface(make):
    scene, found = make.scene(make.sun(toward=(0, -1, 0)), source=make.source)
    assert scene is None
    assert [d.code for d in found] == ["E0401"]


def test_no_surface_but_one_aside(make):
    unplaced = [("egg", "surface", make.context.span)]
    found = make.scene(source=make.source, unplaced=unplaced)[1]
    assert "egg" in found[0].helps[0].text


@pytest.mark.parametrize("name", ["camera", "image", "background", "animate"])
def test_two_of_what_there_is_one_of(make, name):
    arguments = {
        "camera": {"from": (0, 0, 9)},
        "image": {},
        "background": {"color": Color(0, 0, 0)},
        "animate": {"seconds": 1},
    }[name]
    ball = make.surface(children=make.ball(radius=1))
    spans = [make.context.span]
    one = getattr(make, name)(**arguments)
    scene, found = make.scene(ball, (one, None, spans[0]), (one, None, spans[0]))
    assert scene is None
    assert [d.code for d in found] == ["E0402"]
    assert name in found[0].message


def test_cameras_lights_and_transforms_move(make):
    turn = make.rotate(it=make.identity(), y=math.pi / 2)
    camera = make.apply(it=make.camera(**{"from": (0, 0, 9)}), t=make.move(it=turn, y=1))
    assert camera.at == (9, 1, 0)
    assert camera.to == (0, 1, 0)
    assert make.rotate(it=make.sun(toward=(1, 0, 0)), z=math.pi / 2).toward == (0, 1, 0)
    assert make.move(it=make.lamp(at=(1, 2, 3)), v=(1, 1, 1)).at == (2, 3, 4)


def test_rotations_compose_about_fixed_axes(make):
    x, y, z = 0.3, 0.5, 0.7
    all_at_once = make.rotate(it=make.point(p=(1, 2, 3)), x=x, y=y, z=z)
    steps = make.rotate(it=make.rotate(it=make.rotate(it=make.point(p=(1, 2, 3)), x=x), y=y), z=z)
    assert all_at_once.at == pytest.approx(steps.at)
    about_z = make.rotate(it=make.point(p=(1, 0, 0)), angle=math.pi / 2, axis=(0, 0, 5))
    assert about_z.at == pytest.approx((0, 1, 0))


def test_mirror(make):
    assert make.mirror(it=make.point(p=(1, 2, 3)), normal=(2, 0, 0), at=(3, 9, 9)).at == (5, 2, 3)


@pytest.mark.parametrize(
    "name, arguments, argument",
    [
        ("scale", {"it": Dot((0, 0, 0)), "s": 0}, "s"),
        ("scale", {"it": Dot((0, 0, 0)), "y": 0}, "y"),
        ("move", {"it": Dot((0, 0, 0)), "v": (0, math.nan, 0)}, "v"),
        ("rotate", {"it": Dot((0, 0, 0)), "x": math.inf}, "x"),
        ("rotate", {"it": Dot((0, 0, 0)), "angle": 1, "axis": (0, 0, 0)}, "axis"),
        ("mirror", {"it": Dot((0, 0, 0)), "normal": (0, 0, 0)}, "normal"),
        ("camera", {"from": (0, 0, 0)}, "to"),
        ("camera", {"from": (0, 0, 9), "up": (0, 0, 2)}, "up"),
        ("camera", {"from": (0, 9, 0)}, None),
        ("camera", {"from": (0, 0, 9), "fov": math.pi}, "fov"),
        ("sun", {"toward": (0, 0, 0)}, "toward"),
        ("sun", {"toward": (0, 1, 0), "strength": -1}, "strength"),
        ("lamp", {"at": (math.inf, 0, 0)}, "at"),
        ("image", {"width": 0}, "width"),
        ("image", {"height": 10**9}, "height"),
        ("animate", {"seconds": 0}, "seconds"),
        ("animate", {"seconds": 1, "fps": -1}, "fps"),
        ("gauss", {"a": 0}, "a"),
        ("gauss_c1", {"a": math.nan}, "a"),
    ],
)
def test_bad_numbers(make, name, arguments, argument):
    with pytest.raises(MakerError) as caught:
        getattr(make, name)(**arguments)
    assert caught.value.code == "E0405"
    assert caught.value.argument == argument


# ---- the default camera ----------------------------------------------------------------


@pytest.mark.parametrize("aspect", [(640, 480), (100, 400), (2000, 100)])
@pytest.mark.parametrize("far", [0.0, 1e5])
def test_default_camera_shows_everything_and_no_more(make, aspect, far):
    ball = make.move(it=make.ball(radius=1), x=far)
    scene = make.good(make.surface(children=ball), make.image(width=aspect[0], height=aspect[1]))
    camera = scene.camera
    assert np.subtract(camera.at, camera.to) / np.linalg.norm(np.subtract(camera.at, camera.to)) == pytest.approx(
        np.array([0.4, 0.3, 1]) / np.linalg.norm([0.4, 0.3, 1])
    )
    assert camera.to == pytest.approx((far, 0, 0), abs=0.05)
    distance = np.linalg.norm(np.subtract(camera.at, camera.to))
    half = math.atan(math.tan(camera.fov / 2) * min(1, aspect[0] / aspect[1]))
    assert 1 / math.sin(half) < distance < 2 / math.sin(half) + 1


def test_default_camera_for_another_size(make):
    scene = make.good(make.surface(children=make.ball(radius=1)))
    assert framing.camera_for(scene, 320, 240) is scene.camera
    narrow = framing.camera_for(scene, 100, 1000)
    assert np.linalg.norm(narrow.at) > 2 * np.linalg.norm(scene.camera.at)
    given = make.good(make.surface(children=make.ball(radius=1)), make.camera(**{"from": (0, 0, 9)}))
    assert framing.camera_for(given, 100, 1000) is given.camera


def test_default_camera_of_many_surfaces(make):
    """A ring of forty: the close boxes of some and the loose ones of others hold all of them."""
    turns = [2 * math.pi * k / 40 for k in range(40)]
    balls = [make.ball(at=(9 * math.cos(t), 9 * math.sin(t), 0), radius=0.5) for t in turns]
    boxes = framing.Extents(make.good(*[make.surface(children=ball) for ball in balls]).surfaces).boxes()
    assert len(boxes) == 40
    for ball, (lo, hi) in zip(balls, boxes, strict=True):
        assert (lo <= np.array(ball.skeleton.at) - 0.5).all()
        assert (hi >= np.array(ball.skeleton.at) + 0.5).all()
        assert (hi - lo <= 2.01).all()
    assert sum(bool((hi - lo < 1.3).all()) for lo, hi in boxes) == 16


def test_default_camera_of_an_empty_scene(make):
    scene = make.good(make.surface(children=[]))
    assert math.isfinite(scene.camera.at[0])


# ---- queries ---------------------------------------------------------------------------


def test_queries(make):
    surface = make.move(it=make.surface(children=make.ball(radius=1)), x=5)
    assert make.inside(surface=surface, at=(5.99, 0, 0)) is True
    assert make.inside(surface=surface, at=(6.01, 0, 0)) is False
    assert make.field_at(surface=surface, at=(6, 0, 0)) == pytest.approx(0.5)
    box = make.bounds(surface=surface)
    assert np.all(np.array(box["lo"]) <= (4, -1, -1))
    assert box["hi"] == pytest.approx((6, 1, 1), abs=0.2)


def test_queries_about_what_cannot_be_solved(make):
    surface = make.surface(children=make.ball(radius=1, weight=0.1))
    with pytest.raises(MakerError) as caught:
        make.inside(surface=surface, at=(0, 0, 0))
    assert caught.value.code == "E0406"
