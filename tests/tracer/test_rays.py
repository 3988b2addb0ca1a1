"""What a ray may be: where it starts, its window (t_min, t_max], its direction, and arrays of all shapes."""

from __future__ import annotations

import conditioning
import numpy as np
import pytest
import random_scenes
from random_scenes import make_leaf, make_scene
from tracer import campaigns

from blobscript import field as reference
from blobscript import ir
from blobscript.backends.native import ENTER, EXIT, GRAZE, INVALID, MISS, Native

RADIUS = float(np.sqrt(1.0 - np.sqrt(0.5)))  # of the balls below
X = np.array([[1.0, 0.0, 0.0]])


def balls(*centers: float) -> Native:
    """Balls of radius 0.54 on the x axis, too far apart to blend."""
    at = np.array([[c, 0.0, 0.0] for c in centers])
    return Native(make_scene((make_leaf(ir.Points(at), ir.Kernel("soft2"), 1.0, 1.0), 0.5)))


# ---- starts inside -----------------------------------------------------------------------------------------


def test_a_ray_that_starts_inside_exits():
    hits = balls(0.0).first_hit([[0.0, 0, 0], [0.2, 0, 0], [-0.2, 0.1, 0]], np.repeat(X, 3, axis=0))
    assert (hits.status == EXIT).all()
    assert hits.t[:2].tolist() == pytest.approx([RADIUS, RADIUS - 0.2], abs=2e-16)
    assert (np.einsum("ij,j->i", hits.normal, X[0]) > 0.9).all()


def test_everywhere_inside():
    """A threshold below 0: outside of all blobs is inside of the surface; a hollow is entered and left."""
    leaf = make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("soft2"), 1.0, -1.0)
    native = Native(make_scene((leaf, -0.5)))
    hits = native.first_hit([[-3.0, 0, 0], [0.0, 0, 0], [-3.0, 2.0, 0]], np.repeat(X, 3, axis=0))
    assert hits.status.tolist() == [EXIT, ENTER, MISS]
    assert hits.t[:2].tolist() == pytest.approx([3.0 - RADIUS, RADIUS], abs=1e-15)
    assert hits.normal[:, 0].tolist()[:2] == [1.0, -1.0]


@pytest.mark.parametrize("seed", range(10))
def test_walking_through_a_scene(seed: int):
    """From hit to hit along a ray, by t_min: ENTER and EXIT by turns for each surface, and as many crossings as 1 500
    samples of the reference show (more where the samples are too far apart)."""
    rng = np.random.default_rng([seed, 5])
    scene = random_scenes.random_scene(rng, depth=seed % 4)
    surface, native = scene.surfaces[0], Native(scene)
    origins, directions = random_scenes.random_rays(rng, scene, 12)
    for o, d in zip(origins[:, None], directions[:, None], strict=True):
        found: list[tuple[float, int]] = []
        t = 0.0
        while len(found) < 40:
            hits = native.first_hit(o, d, t_min=t)
            if not hits.hit[0]:
                break
            # the same crossing is found again where t rounds to before it: that is the half-open window's due
            again = found and hits.t[0] - found[-1][0] <= conditioning.tolerance(surface, o, d, hits.t)[0]
            if not again:
                found.append((float(hits.t[0]), int(hits.status[0])))
            t = max(float(hits.t[0]), float(np.nextafter(t, np.inf)))
        kinds = [kind for _, kind in found]
        starts_inside = reference.field_value(surface.field, o)[0] >= surface.threshold
        assert kinds == [(EXIT, ENTER)[(i + (not starts_inside)) % 2] for i in range(len(kinds))]
        times = np.linspace(0.0, found[-1][0] * 1.2 + 1.0 if found else 8.0, 1500)
        inside = reference.field_value(surface.field, o + times[:, None] * d) >= surface.threshold
        assert len(found) >= np.count_nonzero(np.diff(inside))


# ---- windows -----------------------------------------------------------------------------------------------


def test_the_window_is_half_open():
    """Crossings at 3 - r and 3 + r. A t_max behind a hit includes it; a t_min behind it excludes it."""
    native = balls(0.0)
    start = np.array([[-3.0, 0.0, 0.0]])
    first = native.first_hit(start, X)
    t = float(first.t[0])
    assert native.first_hit(start, X, t_max=t + 1e-12).status.tolist() == [ENTER]
    assert native.first_hit(start, X, t_max=t - 1e-12).status.tolist() == [MISS]
    assert native.first_hit(start, X, t_min=t - 1e-12).status.tolist() == [ENTER]
    behind = native.first_hit(start, X, t_min=t + 1e-12)
    assert behind.status.tolist() == [EXIT]
    assert behind.t[0] == pytest.approx(3.0 + RADIUS, abs=2e-15)
    assert native.first_hit(start, X, t_min=t + 1e-12, t_max=3.0 + RADIUS - 1e-12).status.tolist() == [MISS]
    assert native.first_hit(start, X, t_min=3.0 + RADIUS + 1e-12).status.tolist() == [MISS]


def test_the_window_is_closed_at_its_end():
    """Two windows that share an end see each crossing once: the reported t is in (0, t], and not in (t, inf)."""
    rng, scene = campaigns.scene_of(3)
    native = Native(scene)
    o, d = random_scenes.random_rays(rng, scene, 300)
    hits = native.first_hit(o, d)
    o, d, t = o[hits.hit], d[hits.hit], hits.t[hits.hit]
    until = native.first_hit(o, d, t_max=t)
    assert until.hit.all()
    assert (until.t <= t).all()


@pytest.mark.parametrize("far", [3.0, 30.0, 3000.0])
@pytest.mark.parametrize("kind", ["points", "lines", "polyline", "solid_mesh"])
def test_windows_that_share_an_end_see_each_crossing_once(kind: str, far: float):
    """Wherever the origin is, whose distance the last bit of t belongs to: also sums, which teams of packets search."""
    rng = np.random.default_rng(7)
    leaves = [random_scenes.random_leaf(rng, (kind,), random_scenes.BUILT_IN[:4], 0.0) for _ in range(3)]
    native = Native(make_scene((ir.Node("sum", tuple(leaves)), 0.4)))
    d = rng.normal(size=(1500, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    o = rng.uniform(-1, 1, d.shape) - far * d
    hits = native.first_hit(o, d)
    o, d, t = o[hits.hit], d[hits.hit], hits.t[hits.hit]
    assert len(t) > 100
    until, behind = native.first_hit(o, d, t_max=t), native.first_hit(o, d, t_min=t)
    assert until.hit.all() and (until.t <= t).all()
    assert (until.t >= t - 1e-12 * far).all()
    assert native.any_hit(o, d, t_max=t).all()
    assert (behind.t[behind.hit] > t[behind.hit] + 1e-12 * far).all()


@pytest.mark.parametrize("seed", range(8))
def test_every_window_around_a_hit(seed: int):
    """Windows that end before the first hit are empty; those that begin before it and end behind it have it (the
    tracer's bound of rounding is some ten times the conditioned error: it holds for the whole interval that it
    looks at); whatever the window, any_hit agrees."""
    rng, scene = campaigns.scene_of(seed)
    native = Native(scene)
    o, d = random_scenes.random_rays(rng, scene, 400)
    hits = native.first_hit(o, d)
    o, d, t, surface = o[hits.hit], d[hits.hit], hits.t[hits.hit], hits.surface[hits.hit]
    allowed = np.array(
        [
            conditioning.tolerance(scene.surfaces[k], o[i : i + 1], d[i : i + 1], t[i : i + 1])[0]
            for i, k in enumerate(surface)
        ]
    )
    share = rng.random(len(t))
    before = native.first_hit(o, d, t_max=t - 16.0 * allowed)
    assert not before.hit.any()
    clear = share * t < t - 64.0 * allowed  # a t_min at the hit itself is a start on the surface
    around = native.first_hit(o, d, t_min=share * t, t_max=t + 64.0 * allowed)
    assert around.hit[clear].all()
    assert (np.abs(around.t - t) <= 4.0 * allowed)[clear].all()
    np.testing.assert_array_equal(native.any_hit(o, d, share * t, t + 64.0 * allowed), around.hit)
    np.testing.assert_array_equal(native.any_hit(o, d, 0.0, t - 16.0 * allowed), before.hit)


@pytest.mark.parametrize(
    ("t_min", "t_max"),
    [
        (1.0, 1.0),
        (5.0, 1.0),
        (np.inf, np.inf),
        (100.0, np.inf),
        (0.0, 0.0),
        (-9.0, -8.0),
        (0.0, -np.inf),
        (0.0, np.nan),
    ],
)
def test_windows_without_anything_in_them(t_min: float, t_max: float):
    hits = balls(0.0).first_hit([[-3.0, 0.0, 0.0]], X, t_min, t_max)
    assert hits.status[0] in ((INVALID, MISS) if not np.isfinite([t_min]).all() or np.isnan(t_max) else (MISS,))
    assert not balls(0.0).any_hit([[-3.0, 0.0, 0.0]], X, t_min, t_max)[0]


def test_windows_may_lie_behind_the_origin():
    """t counts from the origin in both directions."""
    hits = balls(0.0).first_hit([[3.0, 0.0, 0.0]], X, t_min=-10.0)
    assert hits.status.tolist() == [ENTER]
    assert hits.t[0] == pytest.approx(-3.0 - RADIUS, abs=2e-15)


def test_a_window_per_ray():
    o = np.repeat([[-3.0, 0.0, 0.0]], 20, axis=0)
    d = np.repeat(X, 20, axis=0)
    t_min = np.linspace(0.0, 5.0, 20)
    t_max = np.where(np.arange(20) % 2, 2.0, np.inf)
    hits = balls(0.0).first_hit(o, d, t_min, t_max)
    expected = np.where(t_min < 3.0 - RADIUS, ENTER, np.where(t_min < 3.0 + RADIUS, EXIT, MISS))
    expected[1::2] = MISS
    assert hits.status.tolist() == expected.tolist()


# ---- directions --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("length", [1e-300, 1e-160, 1e-9, 3.0, 1e9, 1e160, 1e300])
def test_the_length_of_a_direction_does_not_matter(length: float):
    """t is a distance; scaling a direction rounds it by half an ulp per component, which moves the hit by that
    times the distance over the cosine (above 0.05 for the rays compared)."""
    rng, scene = campaigns.scene_of(2)
    native = Native(scene)
    o, d = random_scenes.random_rays(rng, scene, 200)
    unit, scaled = native.first_hit(o, d), native.first_hit(o, d * length)
    steep = unit.hit & (np.abs(np.einsum("ij,ij->i", unit.normal, d)) > 0.05)
    np.testing.assert_array_equal(unit.status[steep | ~unit.hit], scaled.status[steep | ~unit.hit])
    np.testing.assert_allclose(scaled.t[steep], unit.t[steep], rtol=0, atol=1e-13)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_directions_along_an_axis(axis: int, sign: float):
    """Zeros in a direction, of both signs, and origins exactly in the planes of boxes: no 0 times infinity."""
    at = np.array([[x, y, z] for x in (-2, 0, 2) for y in (-2, 0, 2) for z in (-2, 0, 2)], dtype=float)
    native = Native(make_scene((make_leaf(ir.Points(at), ir.Kernel("soft2"), 1.0, 1.0), 0.5)))
    grid = np.array([[u, v] for u in (-3, -2, -1, 0, 1, 2, 3) for v in (-3, -2, -1, 0, 1, 2, 3)], dtype=float)
    o = np.insert(grid, axis, -sign * 8.0, axis=1)
    for zero in (0.0, -0.0, 1e-310):
        d = np.full((len(o), 3), zero)
        d[:, axis] = sign
        hits = native.first_hit(o, d)
        meets = (np.abs(grid) % 2 == 0).all(axis=1) & (np.abs(grid) <= 2).all(axis=1)
        np.testing.assert_array_equal(hits.hit, meets)
        assert np.abs(hits.t[meets] - (6.0 - RADIUS)).max() < 2e-15


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_rays_that_are_none(bad: float):
    """INVALID, with the outputs of a miss; the other rays of the block are as without them."""
    rng, scene = campaigns.scene_of(1)
    native = Native(scene)
    o, d = random_scenes.random_rays(rng, scene, 40)
    good = native.first_hit(o, d)
    broken_o, broken_d, t_min = o.copy(), d.copy(), np.zeros(40)
    broken_o[3, 1], broken_d[10, 2], broken_d[17], t_min[25] = bad, bad, 0.0, np.nan
    hits = native.first_hit(broken_o, broken_d, t_min)
    none = np.array([3, 10, 17, 25])
    assert (hits.status[none] == INVALID).all()
    assert np.isinf(hits.t[none]).all() and np.isnan(hits.normal[none]).all() and (hits.surface[none] == -1).all()
    assert np.isnan(hits.position[none]).all()
    rest = np.setdiff1d(np.arange(40), none)
    np.testing.assert_array_equal(hits.status[rest], good.status[rest])
    np.testing.assert_allclose(hits.t[rest], good.t[rest], rtol=0, atol=1e-13)
    assert not native.any_hit(broken_o, broken_d, t_min)[none].any()


@pytest.mark.parametrize("far", [1e3, 1e6, 1e9, 1e12])
def test_far_cameras(far: float):
    """The hit is as good as the position can be, 4 eps (|o| + t), for a ray aimed at the middle."""
    d = np.random.default_rng(0).normal(size=(64, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    hits = balls(0.0).first_hit(-far * d, d)
    assert (hits.status == ENTER).all()
    assert np.abs(hits.t - (far - RADIUS)).max() <= 8.0 * conditioning.EPS * far


@pytest.mark.parametrize("far", [1e3, 1e6, 1e9])
def test_places_seen_from_afar_lie_on_the_surface(far: float):
    """A ray that starts at such a place and leaves sees nothing, one that goes inwards leaves at the other side."""
    d = np.random.default_rng(0).normal(size=(64, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    native = balls(0.0)
    hits = native.first_hit(-far * d, d)
    assert np.abs(np.linalg.norm(hits.position, axis=1) - RADIUS).max() <= 1e-15
    assert not native.any_hit(hits.position, hits.normal).any()
    assert (native.first_hit(hits.position, -hits.normal).status == EXIT).all()


@pytest.mark.parametrize("search", ["sandwich", "bernstein", "interval", "segment", "sphere", "march"])
def test_every_search_has_the_window_closed_at_its_end(search: str):
    """t_max at the crossing, reached by exact numbers: the field is the threshold there to the last bit."""
    native = Native(make_scene((make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("soft2"), 1.0, 1.0), 0.5625)))
    o = np.array([[-2.0, 0.0, 0.0]])
    assert native.field([[-0.5, 0.0, 0.0]])[0] == 0.5625
    options = {"step": 0.25} if search == "march" else {}
    assert native.first_hit(o, X, t_max=1.5, search=search, **options).status.tolist() == [ENTER]
    assert native.first_hit(o, X, t_max=1.5 - 1e-7, search=search, **options).status.tolist() == [MISS]
    behind = native.first_hit(o, X, t_min=1.5, search=search, **options)
    assert behind.status.tolist() == [EXIT] and behind.t[0] == pytest.approx(2.5, abs=1e-8)


# ---- arrays ------------------------------------------------------------------------------------------------


def test_no_rays():
    native = balls(0.0)
    hits = native.first_hit(np.zeros((0, 3)), np.zeros((0, 3)))
    assert len(hits) == 0
    assert hits.normal.shape == hits.position.shape == (0, 3)
    assert native.any_hit(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 255, 256, 257, 4095, 4097])
def test_every_number_of_rays(count: int):
    """Around the sizes of packets (8), blocks (256) and calls (4096)."""
    o = np.repeat([[-3.0, 0.0, 0.0]], count, axis=0)
    hits = balls(0.0).first_hit(o, np.repeat(X, count, axis=0))
    assert (hits.status == ENTER).all()
    assert np.unique(hits.t).tolist() == pytest.approx([3.0 - RADIUS], abs=2e-15)


def test_arrays_of_any_layout():
    rng, scene = campaigns.scene_of(6)
    native = Native(scene)
    o, d = random_scenes.random_rays(rng, scene, 64)
    plain = native.first_hit(o, d)
    both = np.concatenate([o, d], axis=1)
    for p, e in ((both[:, :3], both[:, 3:]), (np.asfortranarray(o), np.asfortranarray(d)), (o[::-1], d[::-1])):
        hits = native.first_hit(p, e)
        forward = slice(None, None, -1) if p.strides[0] < 0 else slice(None)
        np.testing.assert_array_equal(hits.status[forward], plain.status)
        np.testing.assert_allclose(hits.t[forward], plain.t, rtol=0, atol=1e-12)
    assert native.first_hit(o.tolist(), d.tolist()).t.tolist() == plain.t.tolist()
    single = native.first_hit(o.astype(np.float32), d.astype(np.float32))
    assert (single.status == plain.status).mean() > 0.9
    before = o.copy(), d.copy()
    native.first_hit(o, d)
    assert (o == before[0]).all() and (d == before[1]).all()


def test_shapes_that_do_not_fit():
    native = balls(0.0)
    with pytest.raises(ValueError, match="origins must have the shape"):
        native.first_hit(np.zeros(3), X)
    with pytest.raises(ValueError, match="directions must have the shape"):
        native.first_hit(X, np.ones((1, 2)))
    with pytest.raises(ValueError, match="as many"):
        native.first_hit(np.zeros((2, 3)), X)
    with pytest.raises(ValueError):
        native.first_hit(X, X, t_min=np.zeros(3))
    with pytest.raises(ValueError):
        native.any_hit(X, X, t_max=np.zeros((1, 1, 2)))


@pytest.mark.parametrize(
    ("option", "value"),
    [("search", "newton"), ("index", "kd"), ("normals", "guess"), ("tolerance", 0.0), ("step", -1.0), ("step", np.nan)],
)
def test_options_that_do_not_exist(option: str, value: object):
    with pytest.raises(ValueError, match=option):
        balls(0.0).first_hit(X, X, **{option: value})  # pyright: ignore[reportArgumentType]


# ---- several surfaces --------------------------------------------------------------------------------------


def test_the_nearest_surface_wins():
    first = make_leaf(ir.Points(np.array([[2.0, 0, 0]])), ir.Kernel("soft2"), 1.0, 1.0)
    second = make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("soft2"), 1.0, 1.0)
    native = Native(make_scene((first, 0.5), (second, 0.5)))
    hits = native.first_hit([[-3.0, 0, 0], [5.0, 0, 0], [1.0, 0, 0]], [[1.0, 0, 0], [-1.0, 0, 0], [1.0, 0, 0]])
    assert hits.surface.tolist() == [1, 0, 0]
    assert hits.t.tolist() == pytest.approx([3.0 - RADIUS, 3.0 - RADIUS, 1.0 - RADIUS], abs=2e-15)


def test_one_surface_inside_another():
    """Entering the outer, then the inner, leaving the inner, then the outer: each with its own index."""
    inner = make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("soft2"), 1.0, 1.0)
    outer = make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("soft2"), 2.0, 1.0)
    native = Native(make_scene((inner, 0.5), (outer, 0.5)))
    seen = []
    t = 0.0
    for _ in range(4):
        hits = native.first_hit([[-3.0, 0, 0]], X, t_min=t)
        seen.append((int(hits.surface[0]), int(hits.status[0])))
        t = hits.t[0] + 1e-12
    assert seen == [(1, ENTER), (0, ENTER), (0, EXIT), (1, EXIT)]
    assert native.first_hit([[-3.0, 0, 0]], X, t_min=t).status.tolist() == [MISS]


def test_a_graze_of_one_surface_does_not_hide_a_hit_of_another():
    grazed = make_leaf(ir.Points(np.array([[0.0, -RADIUS, 0]])), ir.Kernel("soft2"), 1.0, 1.0)
    behind = make_leaf(ir.Points(np.array([[5.0, 0, 0]])), ir.Kernel("soft2"), 1.0, 1.0)
    for pair in ((grazed, behind), (behind, grazed)):
        native = Native(make_scene(*((leaf, 0.5) for leaf in pair)))
        hits = native.first_hit([[-3.0, 0, 0]], X)
        assert hits.status.tolist() == [ENTER]
        assert hits.t[0] == pytest.approx(8.0 - RADIUS, abs=4e-15)


def test_graze_is_reported_and_is_no_hit():
    """A ray that touches within rounding: GRAZE or MISS, never a hit for any_hit."""
    native = balls(0.0)
    o = np.array([[-3.0, RADIUS + k * np.spacing(RADIUS), 0.0] for k in range(-2, 3)])
    d = np.repeat(X, 5, axis=0)
    hits = native.first_hit(o, d)
    assert GRAZE in hits.status
    assert not native.any_hit(o, d)[np.isin(hits.status, (GRAZE, MISS))].any()


@pytest.mark.parametrize("threads", [0, -1])
def test_threads_are_at_least_one(threads: int):
    with pytest.raises(ValueError, match="threads must be at least 1"):
        balls(0.0).first_hit(np.array([[-3.0, 0.0, 0.0]]), X, threads=threads)


@pytest.mark.parametrize("name", ["t_min", "t_max"])
@pytest.mark.parametrize("shape", [(2,), (3, 1), (1, 3)])
def test_windows_of_another_shape(name: str, shape: tuple[int, ...]):
    o = np.zeros((3, 3))
    with pytest.raises(ValueError, match=rf"{name} must be a number or one per ray, shape \(3,\)"):
        balls(0.0).first_hit(o, np.repeat(X, 3, axis=0), **{name: np.zeros(shape)})


def test_one_window_for_more_rays_than_a_chunk():
    """Bit for bit as if it were written down for each."""
    rng = np.random.default_rng(3)
    o, d = rng.normal(size=(20_000, 3)) * 2.0, rng.normal(size=(20_000, 3))
    native = balls(0.0, 3.0)
    one, each = native.first_hit(o, d, 0.5, 2.5), native.first_hit(o, d, np.full(20_000, 0.5), np.full(20_000, 2.5))
    for name in ("status", "t", "normal", "surface", "evaluations"):
        np.testing.assert_array_equal(getattr(one, name), getattr(each, name))


@pytest.mark.parametrize("window", [0.003, 0.01, 1.0])
def test_rays_in_all_directions_find_the_same_in_any_company(window: float):
    """From few places, far from being a beam; then among others of which each packet shares nothing."""
    rng = np.random.default_rng(0)
    at = rng.random((100_000, 3)) - 0.5
    native = Native(make_scene((make_leaf(ir.Points(at), ir.Kernel("soft2"), 0.0267, 1.0), 0.6)))
    origins, directions = np.repeat(rng.random((8, 3)) - 0.5, 256, axis=0), rng.normal(size=(2048, 3))
    together = native.first_hit(origins, directions, t_max=window)
    order = rng.permutation(2048)
    apart = native.first_hit(origins[order], directions[order], t_max=window)
    np.testing.assert_array_equal(together.status[order], apart.status)
    np.testing.assert_allclose(together.t[order], apart.t, rtol=0.0, atol=1e-12)


def test_the_field_at_no_place_is_no_number():
    native = balls(0.0)
    places = np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [0.1, 0.0, np.nan], [np.inf, 0.0, 0.0]])
    np.testing.assert_array_equal(np.isnan(native.field(places)), [False, True, True, False])
    np.testing.assert_array_equal(np.isnan(native.gradient(places)).all(axis=1), [False, True, True, False])
