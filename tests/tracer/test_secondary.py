"""Rays that start on the surface: shadows, reflections, refractions. No false shadow (a hit of the surface
where the ray starts), no leak (an occluder that is not hit), at any scale and place, without an epsilon.

The start is decided by monotony (numerics.md, section 2): the side is that on which F is as soon as it has left
zero. So a hit point that is off by its own rounding is as good as an exact one. (A hit seen from far away is off by
the rounding of that distance: `on_surface_again` takes it back to the surface, as the pictures do.)
"""

from __future__ import annotations

import conditioning
import numpy as np
import oracle
import pytest
import random_scenes
from random_scenes import make_leaf, make_scene
from tracer import campaigns

from blobscript import ir
from blobscript.backends.native import ENTER, EXIT, Native

RADIUS = float(np.sqrt(1.0 - np.sqrt(0.5)))
#: Threshold and radius of the crowd of spheres: they fill most of their reach.
LOW, WIDE = 0.1, float(np.sqrt(1.0 - np.sqrt(0.1)))
#: Scale and shift of the scene: (p + shift) * scale.
PLACES = [(1.0, 0.0), (1e-3, 0.0), (1e3, 0.0), (1.0, 1e5)]
IDS = ["unit", "small", "large", "far"]


def spheres(rng: np.random.Generator, scale: float, shift: float) -> tuple[np.ndarray, np.ndarray, Native]:
    """Centers and radii of 60 balls whose reaches do not overlap: their surfaces are spheres exactly."""
    places: list[np.ndarray] = []
    reaches: list[float] = []
    while len(places) < 60:
        at, reach = rng.uniform(-2, 2, 3), float(rng.uniform(0.1, 0.6))
        if all(np.linalg.norm(at - p) > (reach + r) * 1.001 for p, r in zip(places, reaches, strict=True)):
            places.append(at)
            reaches.append(reach)
    centers, reach = (np.array(places) + shift * np.array([1.0, -1.0, 0.5])) * scale, np.array(reaches) * scale
    leaf = make_leaf(ir.Points(centers), ir.Kernel("soft2"), reach, 1.0)
    return centers, WIDE * reach, Native(make_scene((leaf, LOW)))


def starts(rng, centers, radii, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points on spheres, to the rounding of their coordinates; outward directions whose cosine with the normal is
    1 to 1e-4. Also which sphere, and the normal."""
    which = rng.integers(len(centers), size=count)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    across = np.cross(normal, rng.normal(size=(count, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    cosine = (10.0 ** rng.uniform(-4, 0, count))[:, None]
    return (
        centers[which] + radii[which, None] * normal,
        cosine * normal + np.sqrt(1 - cosine**2) * across,
        which,
        normal,
    )


def exact_hits(centers, radii, o, d, which) -> tuple[np.ndarray, np.ndarray]:
    """First hit of a sphere other than the start's, +inf for none, and how clear the answer is: the smallest
    distance between the ray and any sphere's rim, relative to the radius. The start's sphere is not hit again."""
    t, clear = np.full(len(o), np.inf), np.full(len(o), np.inf)
    for i, (center, radius) in enumerate(zip(centers, radii, strict=True)):
        x = center - o
        along = np.einsum("ij,ij->i", x, d)
        away = np.linalg.norm(x - along[:, None] * d, axis=1)
        other = (which != i) & (along > -radius)
        clear = np.where(other, np.minimum(clear, np.abs(away - radius) / radius), clear)
        meets = other & (away < radius) & (along > 0)
        entry = along - np.sqrt(np.maximum(radius**2 - away**2, 0.0))
        t = np.where(meets & (entry < t), entry, t)
    return t, clear


def on_surface_again(native: Native, points: np.ndarray, threshold: float = 0.5, surface: int = 0) -> np.ndarray:
    """One Newton step along the gradient."""
    gradient = native.gradient(points, surface)
    missing = threshold - native.field(points, surface)
    return points + (missing / np.einsum("ij,ij->i", gradient, gradient))[:, None] * gradient


@pytest.mark.parametrize(("scale", "shift"), PLACES, ids=IDS)
def test_no_false_shadows_and_no_leaks(scale: float, shift: float):
    """4 000 grazing starts on spheres. Left out are rays that pass another sphere's rim within 1e-6 of its radius
    (1e-10 away from it moves a hit by 1e-5); distances within what rounding of a far position allows."""
    rng = np.random.default_rng(11)
    centers, radii, native = spheres(rng, scale, shift)
    o, d, which, _ = starts(rng, centers, radii, 4000)
    expected, clear = exact_hits(centers, radii, o, d, which)
    sure = clear > 1e-6
    assert sure.mean() > 0.99
    assert np.isfinite(expected[sure]).mean() > 0.2
    hits = native.first_hit(o, d)
    false_shadows = sure & hits.hit & np.isinf(expected)
    leaks = sure & ~hits.hit & np.isfinite(expected)
    assert np.flatnonzero(false_shadows).tolist() == []
    assert np.flatnonzero(leaks).tolist() == []
    found = sure & hits.hit
    position = conditioning.EPS * (np.linalg.norm(o, axis=1) + scale)
    allowed = 64.0 * position / np.sqrt(np.minimum(clear, 1.0))
    assert (np.abs(hits.t[found] - expected[found]) <= allowed[found]).all()
    assert (hits.status[found] == ENTER).all()
    np.testing.assert_array_equal(native.any_hit(o, d), hits.hit)


@pytest.mark.parametrize("far", [3.0, 1e2, 1e4, 1e6])
def test_hits_from_afar_as_starts(far: float):
    """A ball seen from far away, lit from everywhere above its horizon: no shadow on itself."""
    rng = np.random.default_rng(13)
    native = Native(make_scene((make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("soft2"), 1.0, 1.0), 0.5)))
    d = rng.normal(size=(2000, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    first = native.first_hit(-far * d + rng.uniform(-0.2, 0.2, (2000, 3)), d)
    assert first.hit.mean() > 0.8
    o, normal = on_surface_again(native, first.position[first.hit]), first.normal[first.hit]
    across = np.cross(normal, rng.normal(size=normal.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    cosine = (10.0 ** rng.uniform(-4, 0, len(o)))[:, None]
    assert not native.any_hit(o, cosine * normal + np.sqrt(1.0 - cosine**2) * across).any()


@pytest.mark.parametrize(("scale", "shift"), PLACES, ids=IDS)
def test_inward_starts_leave_at_the_other_side(scale: float, shift: float):
    """Refraction: EXIT of the sphere where the ray starts, after a chord of 2 r cos, however short."""
    rng = np.random.default_rng(12)
    centers, radii, native = spheres(rng, scale, shift)
    o, d, which, normal = starts(rng, centers, radii, 4000)
    cosine = np.einsum("ij,ij->i", d, normal)
    hits = native.first_hit(o, -d)
    position = conditioning.EPS * (np.linalg.norm(o, axis=1) + scale)
    chord = 2.0 * radii[which] * cosine
    clear = chord > 1e4 * position / cosine  # shorter than that, the start may be on the other side
    assert clear.mean() > (0.7 if shift else 0.99)
    assert (hits.status[clear] == EXIT).all()
    assert (np.abs(hits.t[clear] - chord[clear]) <= (64.0 * position / cosine)[clear]).all()


@pytest.mark.parametrize(("scale", "shift"), PLACES, ids=IDS)
def test_starts_at_hits_in_a_crowd(scale: float, shift: float):
    """Hits of a blended scene of both signs as starts, certified by ball arithmetic; a hundredth of the campaign."""
    false, judged = certified_starts(np.random.default_rng(3), scale, shift, 25)
    assert false == []
    assert judged > 12


@pytest.mark.parametrize("make", campaigns.MAKERS)
def test_starts_at_hits_on_everything(make: campaigns.Maker):
    """Trees, polygons, meshes, solids, smooth nodes, all kernels: no false shadow, no leak."""
    judged = 0
    for seed in range(5):
        rng, scene = make(seed)
        false, count = starts_at_hits(rng, scene, 6)
        assert false == [], seed
        judged += count
    assert judged > 10


def certified_starts(rng: np.random.Generator, scale: float, shift: float, count: int) -> tuple[list[str], int]:
    """What goes wrong on `count` rays from hits, and how many were judged (the others double precision may change)."""
    at = (rng.uniform(-1, 1, (30, 3)) + shift * np.array([1.0, -1.0, 0.5])) * scale
    leaf = make_leaf(ir.Points(at), ir.Kernel("soft3"), 0.8 * scale, rng.choice([1.0, -0.4], 30, p=[0.8, 0.2]))
    return starts_at_hits(rng, make_scene((leaf, 0.45)), count)


def starts_at_hits(rng: np.random.Generator, scene: ir.Scene, count: int) -> tuple[list[str], int]:
    """The same in any scene."""
    native = Native(scene)
    first = native.first_hit(*random_scenes.random_rays(rng, scene, 12 * count))
    o, normal = first.position[first.hit][:count], first.normal[first.hit][:count]
    across = np.cross(normal, rng.normal(size=normal.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    cosine = (10.0 ** rng.uniform(-4, 0, len(o)) * rng.choice([1.0, -1.0], len(o), p=[0.8, 0.2]))[:, None]
    d = cosine * normal + np.sqrt(1.0 - cosine**2) * across
    hits = native.first_hit(o, d)
    position = conditioning.position_error(o, np.zeros(len(o)))
    on_surface = np.max([conditioning.rounding(surface, o, position) for surface in scene.surfaces], axis=0)
    faults, judged = [], 0
    if not (native.any_hit(o, d) == hits.hit).all():
        faults.append("any_hit sees something else")
    for i in range(len(o)):
        try:
            answer = oracle.certain_hit(scene, o[i], d[i])
            near = oracle.first_hit(scene, o[i], d[i], slack=float(on_surface[i]))
        except oracle.Undecided:
            continue
        if not answer.stable or near.status != answer.status or near.kind != answer.kind:
            continue  # the certain answer takes a chord on which F stays within its generous bound for nothing
        judged += 1
        expected = {"miss": (0, 3), "hit": (EXIT if answer.kind == "exit" else ENTER,)}[answer.status]
        off = abs(hits.t[i] - answer.distance) if hits.hit[i] and answer.status == "hit" else 0.0
        if hits.status[i] not in expected or off > answer.tolerance:
            faults.append(f"ray {i}: {hits.status[i]} at {hits.t[i]}, certified {answer.status} at {answer.distance}")
    return faults, judged


# ---- scale and place ---------------------------------------------------------------------------------------


def moved(scene: ir.Scene, scale: float, shift: np.ndarray) -> ir.Scene:
    """The scene at (p + shift) * scale."""
    return make_scene(*((_moved(s.field, scale, shift), s.threshold) for s in scene.surfaces))


def _moved(tree: ir.Field, scale: float, shift: np.ndarray) -> ir.Field:
    if isinstance(tree, ir.Node):
        return ir.Node(tree.op, tuple(_moved(child, scale, shift) for child in tree.children))
    assert isinstance(tree.skeleton, ir.Points)
    at = (tree.skeleton.at + shift) * scale
    return make_leaf(ir.Points(at), tree.kernel, tree.reach * scale, tree.weight, tree.paint)


def crowd(seed: int) -> tuple[ir.Scene, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    scene = random_scenes.random_scene(rng, depth=2, kinds=("points",), mapped=0.0)
    o, d = random_scenes.random_rays(rng, scene, 300)
    return scene, o, d


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("exponent", [-500, -60, -1, 1, 60, 500])
def test_a_power_of_two_changes_nothing(seed: int, exponent: int):
    """The same bits: packed coordinates are the same numbers."""
    scene, o, d = crowd(seed)
    factor = 2.0**exponent
    plain, scaled = Native(scene).first_hit(o, d), Native(moved(scene, factor, np.zeros(3))).first_hit(o * factor, d)
    np.testing.assert_array_equal(scaled.status, plain.status)
    np.testing.assert_array_equal(scaled.t, plain.t * factor)
    np.testing.assert_array_equal(scaled.normal, plain.normal)


@pytest.mark.parametrize("scale", [1e-150, 1e-30, 1e-3, 1e3, 1e30, 1e150])
def test_scale(scale: float):
    """Hits at the scaled distance, to the rounding of the scaled scene's numbers (half an ulp of each reach and
    coordinate, so 16 eps) over the cosine; grazing rays are left out."""
    for seed in range(3):
        scene, o, d = crowd(seed)
        plain, scaled = Native(scene).first_hit(o, d), Native(moved(scene, scale, np.zeros(3))).first_hit(o * scale, d)
        cosine = np.abs(np.einsum("ij,ij->i", plain.normal, d))
        clear = ~plain.hit | (cosine > 0.05)
        np.testing.assert_array_equal(scaled.status[clear], plain.status[clear])
        hit = plain.hit & clear
        assert (np.abs(scaled.t[hit] / scale - plain.t[hit]) <= 256.0 * conditioning.EPS * 10.0 / cosine[hit]).all()
        assert (np.linalg.norm(scaled.normal[hit] - plain.normal[hit], axis=1) <= 1e-11).all()


@pytest.mark.parametrize("shift", [2.0**10, 2.0**20, -(2.0**30)])
def test_place(shift: float):
    """Coordinates on a grid of 2^-20, so that the moved scene is the same exactly: hits differ by the rounding of
    positions so far away at most."""
    for seed in range(3):
        scene, o, d = crowd(seed)
        round_to = lambda x: np.round(x * 2.0**20) / 2.0**20  # noqa: E731
        scene = moved(scene, 1.0, np.zeros(3))
        for leaf in conditioning.leaves(scene.surfaces[0].field):
            leaf.skeleton.at[:] = round_to(leaf.skeleton.at)  # pyright: ignore
        o = round_to(o)
        offset = shift * np.array([1.0, -1.0, 0.5])
        plain, far = Native(scene).first_hit(o, d), Native(moved(scene, 1.0, offset)).first_hit(o + offset, d)
        cosine = np.abs(np.einsum("ij,ij->i", plain.normal, d))
        clear = ~plain.hit | (cosine > 0.05)
        np.testing.assert_array_equal(far.status[clear], plain.status[clear])
        hit = plain.hit & clear
        assert (np.abs(far.t[hit] - plain.t[hit]) <= 64.0 * conditioning.EPS * abs(shift) / cosine[hit]).all()


# ---- starts in special places ------------------------------------------------------------------------------


def two_balls(op: str, gap: float = 0.0) -> Native:
    """Balls of radius 0.54 with centers 0.6 apart (they overlap), or touching (op "touch")."""
    apart = 0.3 if op != "touch" else RADIUS + gap
    pair = [make_leaf(ir.Points(np.array([[x, 0.0, 0.0]])), ir.Kernel("soft2"), 1.0, 1.0) for x in (-apart, apart)]
    if op == "surfaces":
        return Native(make_scene(*((leaf, 0.5) for leaf in pair)))
    return Native(make_scene((ir.Node("max", tuple(pair)), 0.5)))


@pytest.mark.parametrize("op", ["max", "surfaces"])
def test_starts_on_a_crease(op: str):
    """On the circle where two overlapping balls meet. Away from both normals: nothing is hit. Into both: the exit from
    the union (max), or from the first ball that is left (two surfaces). Into one of them along the crease plane: a
    chord of that plane's circle. The start itself is never a hit."""
    native = two_balls(op)
    height = np.sqrt(RADIUS**2 - 0.3**2)
    angle = np.linspace(0.0, 6.28, 500)
    radial = np.column_stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)])
    o = height * radial
    rng = np.random.default_rng(0)
    tilt = rng.uniform(-0.55, 0.55, (500, 1)) * np.array([[1.0, 0.0, 0.0]])
    outward = radial + tilt  # within both tangent planes: |x| / radial < tan of 0.3 / height
    assert not native.first_hit(o, outward).hit.any()
    inward = native.first_hit(o, -radial)
    assert (inward.status == EXIT).all()
    assert np.abs(inward.t - 2.0 * height).max() < 1e-14
    along = native.first_hit(o, np.repeat([[1.0, 0.0, 0.0]], 500, axis=0))
    assert (along.status == EXIT).all()  # parallel to the axis, inside the right ball, until it is left
    assert np.abs(along.t - 0.6).max() < 1e-14


@pytest.mark.parametrize("two", [False, True], ids=["max", "surfaces"])
def test_touching_balls(two: bool):
    """Rays through the point where two balls touch, start there, or pass close by."""
    pair = [make_leaf(ir.Points(np.array([[x, 0.0, 0.0]])), ir.Kernel("soft2"), 1.0, 1.0) for x in (-RADIUS, RADIUS)]
    scene = make_scene(*((leaf, 0.5) for leaf in pair)) if two else make_scene((ir.Node("max", tuple(pair)), 0.5))
    native = Native(scene)
    through = native.first_hit([[-3.0, 0, 0]], [[1.0, 0, 0]])
    assert through.status.tolist() == [ENTER]
    assert through.t[0] == pytest.approx(3.0 - 2.0 * RADIUS, abs=2e-15)
    across = native.first_hit([[0.0, -3.0, 0]], [[0.0, 1.0, 0]])
    assert not across.hit[0] or abs(across.t[0] - 3.0) < 1e-7
    out = native.first_hit(np.zeros((64, 3)), _circle(64))
    assert not out.hit.any() or np.abs(out.t[out.hit]).max() < 1e-7
    into = native.first_hit([[0.0, 0, 0], [0.0, 0, 0]], [[1.0, 0, 0], [-1.0, 0, 0]])
    assert (into.status == EXIT).all()
    assert np.abs(into.t - 2.0 * RADIUS).max() < 1e-14


def _circle(count: int) -> np.ndarray:
    angle = np.arange(count) / count * 6.283185307179586
    return np.column_stack([np.zeros(count), np.cos(angle), np.sin(angle)])


def test_starts_on_every_skeleton():
    """Hits of scenes of everything as starts of mirrored rays: what they hit first is not where they start (a
    hit nearer than 1e-9 must be a thin thing that is really there: the reference changes its side)."""
    from blobscript import field as reference

    for seed in range(12):
        rng = np.random.default_rng([seed, 6])
        scene = random_scenes.random_scene(rng, depth=seed % 4, negative=0.1)
        native = Native(scene)
        o, d = random_scenes.random_rays(rng, scene, 600)
        first = native.first_hit(o, d)
        hit = (first.status == ENTER) & (np.abs(np.einsum("ij,ij->i", first.normal, d)) > 0.01)
        surface = scene.surfaces[0]
        n, d = first.normal[hit], d[hit]
        o = on_surface_again(native, first.position[hit], surface.threshold)
        mirrored = d - 2.0 * np.einsum("ij,ij->i", d, n)[:, None] * n
        again = native.first_hit(o, mirrored)
        for i in np.flatnonzero(again.hit & (again.t < 1e-6)):
            span = np.linspace(0.0, 1.5 * again.t[i] + 1e-9, 64)[1:, None]
            inside = reference.field_value(surface.field, o[i] + span * mirrored[i]) >= surface.threshold
            assert inside.any() and not inside.all(), (seed, i)
