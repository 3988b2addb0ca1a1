"""First hits are the first, and hits: none missed, none false, no wrong root. The full campaigns are run by
tests/bench/campaigns.py; a seeded hundredth of each is here."""

from __future__ import annotations

import conditioning
import numpy as np
import pytest
import random_scenes
import user_kernels
from random_scenes import SKELETONS, make_leaf, make_scene
from tracer import campaigns
from tracer.methods import INDEXES, SEARCHES

from blobscript import field as reference
from blobscript import ir
from blobscript.backends.native import ENTER, EXIT, GRAZE, MISS, Native

# ---- random trees ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", INDEXES)
@pytest.mark.parametrize("search", SEARCHES)
def test_agrees_with_certified_answers(search: str, index: str):
    """Ball arithmetic on random trees of all skeletons and kernels, a third of the rays grazing. Rays whose
    answer a rounding error could change are left out, there must be few. Distances within the conditioned error."""
    tally = campaigns.Tally()
    for seed in range(20):
        tally.add(campaigns.against_oracle(seed, 5, search=search, index=index))
    assert tally.faults == []
    assert tally.rays > 75
    assert tally.hits > 12
    assert tally.worst <= 1.0


@pytest.mark.parametrize("make", campaigns.MAKERS[1:])
def test_sums_and_smooth_nodes_agree_with_certified_answers(make: campaigns.Maker):
    """What teams of packets search, and smooth maxima and minima; windows that begin or end within the scene."""
    tally = campaigns.Tally()
    for seed in range(12):
        tally.add(campaigns.against_oracle(seed, 8, make, windows=True))
    assert tally.faults == []
    assert tally.rays > 60
    assert tally.hits > 8


def test_guaranteed_searches_agree():
    """Sandwich, interval and Bernstein: the same status, surface and, within twice the conditioned error, distance."""
    tally = campaigns.Tally()
    for seed in range(20):
        tally.add(campaigns.against_each_other(seed, 1500))
    assert tally.faults == []
    assert tally.hits > 5000


def test_guaranteed_searches_agree_on_sums_of_points_and_lines():
    """What teams of packets search, all built-in kernels, blocks of a picture and grazing rays among them."""
    tally = campaigns.Tally()
    for seed in range(24):
        tally.add(campaigns.against_each_other(seed, 900, campaigns.sum_of))
    assert tally.faults == []
    assert tally.hits > 5000


@pytest.mark.parametrize("block", range(4))
def test_nothing_is_crossed_before_the_hit(block: int):
    """10 000 rays, 60 samples of the field before each hit: no sample on the other side by more than rounding."""
    tally = campaigns.Tally()
    for seed in range(15 * block, 15 * block + 15):
        tally.add(campaigns.against_samples(seed, 170, samples=60))
    assert tally.faults == []
    assert tally.hits > 100


@pytest.mark.parametrize("kind", SKELETONS)
def test_each_skeleton_alone(kind: str):
    tally = campaigns.Tally()
    for seed in range(6):
        tally.add(campaigns.against_samples(1000 + seed, 100, samples=100, kinds=(kind,)))
    assert tally.faults == []
    assert tally.hits > 10


@pytest.mark.parametrize("kind", SKELETONS)
def test_kernels_below_zero(kind: str):
    """A kernel that is below 0 here and there adds under a negative weight. As certified, and by samples."""
    wave = user_kernels.proved("@allow(nonmonotone)\nkernel wave(r) = (1 - r^2)^2 * cos(720deg * r)")
    tally = campaigns.Tally()
    for seed in range(4):
        tally.add(campaigns.against_samples(2000 + seed, 60, samples=100, kinds=(kind,), kernels=(wave,), negative=0.6))
    assert tally.faults == []
    assert tally.hits > 10


def test_a_crowd():
    """3 000 points of both signs and two sizes: every ray sees many of them, the index works for its living."""
    rng = np.random.default_rng(0)
    count = 3000
    leaf = make_leaf(
        ir.Points(rng.uniform(-1, 1, (count, 3))),
        ir.Kernel("wyvill"),
        rng.choice([0.08, 0.3], count, p=[0.95, 0.05]),
        rng.choice([1.0, -0.5], count, p=[0.8, 0.2]),
    )
    scene = make_scene((leaf, 0.6))
    native = Native(scene)
    o, d = random_scenes.random_rays(rng, scene, 2000)
    hits = native.first_hit(o, d)
    end = np.where(hits.hit, hits.t, 12.0)
    assert hits.hit.mean() > 0.3
    bad = campaigns._crossed(native, 0, scene.surfaces[0], o, d, end, rng.random((len(o), 200)))
    assert len(bad) == 0
    assert campaigns._off(scene.surfaces[0], hits, np.flatnonzero(hits.hit), o) == []


# ---- what a hit says ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_kind_normal_and_surface_belong_to_the_hit(seed: int):
    """ENTER against the normal, EXIT along it; the normal is -gradient / |gradient| of the reference at the hit (to
    1e-6: the position is off by rounding, the kernels bend within 0.2); any_hit says the same; all arrays are in
    the state that the documentation promises for rays without a hit."""
    rng, scene = campaigns.scene_of(seed)
    native = Native(scene)
    o, d = random_scenes.random_rays(rng, scene, 300)
    hits = native.first_hit(o, d)
    hit = hits.hit
    assert set(np.unique(hits.status)) <= {MISS, ENTER, EXIT, GRAZE}
    assert ((hits.status == ENTER) | (hits.status == EXIT)).tolist() == hit.tolist()
    assert np.isinf(hits.t[~hit]).all() and (hits.t[~hit] > 0).all()
    assert np.isnan(hits.normal[~hit]).all() and np.isnan(hits.position[~hit]).all()
    assert (hits.surface[~hit] == -1).all()
    np.testing.assert_array_equal(native.any_hit(o, d), hit)
    # a bundle of pieces may cross with the gradient along the ray just turning: then the kind is what counts
    along = np.einsum("ij,ij->i", hits.normal[hit], d[hit])
    clear = np.abs(along) > 1e-6
    assert ((along < 0) == (hits.status[hit] == ENTER))[clear].all()
    np.testing.assert_allclose(np.linalg.norm(hits.normal[hit], axis=1), 1.0, rtol=0, atol=1e-14)
    for i, surface in enumerate(scene.surfaces):
        mine = hits.surface == i
        at = hits.position[mine]
        gradient = reference.gradient(surface.field, at)
        length = np.linalg.norm(gradient, axis=1)
        expected = -gradient / length[:, None]
        for h in (-1e-8, 1e-8):  # at creases the winner may be another
            beside = reference.gradient(surface.field, at + h)
            length[np.linalg.norm(beside - gradient, axis=1) > 1e-3 * length] = np.nan
        smooth = np.isfinite(length)
        assert np.linalg.norm(hits.normal[mine] - expected, axis=1)[smooth].max(initial=0.0) < 1e-6


def test_effort_is_counted():
    rng, scene = campaigns.scene_of(3)
    o, d = random_scenes.random_rays(rng, scene, 64)
    assert Native(scene).first_hit(o, d).counters == {}
    hits = Native(scene).first_hit(o, d, counters=True)
    hit = hits.hit
    assert (hits.evaluations[hit] > 0).all()
    assert set(hits.counters) == {"nodes", "candidates", "spans", "sandwiches", "fallbacks"}
    assert all((counts >= 0).all() for counts in hits.counters.values())
    assert (hits.counters["sandwiches"] <= hits.evaluations).all()
    assert (hits.counters["candidates"][hit] > 0).all()
    away = Native(scene).first_hit(o + 100.0, np.ones((64, 3)))
    assert (away.evaluations == 0).all()


# ---- spheres: exact answers --------------------------------------------------------------------------------

POINT = ir.Points(np.zeros((1, 3)))


@pytest.mark.parametrize("kernel", random_scenes.BUILT_IN, ids=lambda k: f"{k.name}({k.a:g})")
def test_one_point_is_a_sphere(kernel: ir.Kernel):
    """A hit exactly where the ray comes nearer than the radius, for chords down to 1e-6 of it (from 5 away the
    position is rounded to 1e-15, which 1e-12 above or below the tangent cannot change); the distance is that of the
    sphere within the conditioned error of a chord, some eps / half chord."""
    from blobscript import kernels

    radius = float(kernels.inverse(kernel, np.array(0.5)))
    native = Native(make_scene((make_leaf(POINT, kernel, 1.0, 1.0), 0.5)))
    depth = 10.0 ** -np.arange(0, 12.5, 0.5)
    for sign in (1.0, -1.0):
        offset = radius * (1.0 - sign * depth)
        o = np.column_stack([np.full_like(offset, -5.0), offset, np.zeros_like(offset)])
        d = np.broadcast_to([1.0, 0.0, 0.0], o.shape)
        hits = native.first_hit(o, d)
        assert (hits.hit == (sign > 0)).all()
        if sign > 0:
            half = radius * np.sqrt(depth * (2.0 - depth))
            slope = kernels.lipschitz(kernel)  # of the threshold's rounding, in terms of the radius
            assert (np.abs(hits.t - (5.0 - half)) <= 64 * conditioning.EPS * (5.0 + max(1.0, 1.0 / slope) / half)).all()


@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize("kernel", random_scenes.BUILT_IN, ids=lambda k: f"{k.name}({k.a:g})")
def test_a_touch_is_no_hit(kernel: ir.Kernel, search: str):
    """Tangent to a sphere, to the last bit that the offset has: MISS or GRAZE, or a hit within the distance that
    one rounding error of the threshold buys, 2 sqrt(2 E / |F''|) < 1e-7."""
    from blobscript import kernels

    radius = float(kernels.inverse(kernel, np.array(0.5)))
    native = Native(make_scene((make_leaf(POINT, kernel, 1.0, 1.0), 0.5)))
    offset = radius + np.arange(-3, 4) * np.spacing(radius)
    o = np.column_stack([np.full_like(offset, -5.0), offset, np.zeros_like(offset)])
    hits = native.first_hit(o, np.broadcast_to([1.0, 0.0, 0.0], o.shape), search=search)
    near = np.abs(hits.t - 5.0) < 1e-7 * (1.0 + 1.0 / np.sqrt(max(kernel.a, 1.0)))
    assert (np.isin(hits.status, (MISS, GRAZE)) | near).all()


def test_a_ray_on_the_surface_of_a_cylinder_grazes():
    """F is zero within rounding over the whole length: skipped whole and reported as GRAZE, whichever way the
    rounding falls; the effort stays small."""
    radius = np.sqrt(1.0 - np.sqrt(0.5))
    line = make_leaf(ir.Lines(np.zeros((1, 3)), np.array([[2.0, 0, 0]])), ir.Kernel("soft2"), 1.0, 1.0)
    native = Native(make_scene((line, 0.5)))
    offset = radius + np.arange(-2, 3) * np.spacing(radius)
    o = np.column_stack([np.full_like(offset, -3.0), offset, np.zeros_like(offset)])
    hits = native.first_hit(o, np.broadcast_to([1.0, 0.0, 0.0], o.shape))
    assert np.isin(hits.status, (MISS, GRAZE)).all()
    assert GRAZE in hits.status
    assert hits.evaluations.max() < 500


def test_a_graze_before_a_hit_is_a_hit():
    """The ray touches one sphere and enters another behind it."""
    radius = np.sqrt(1.0 - np.sqrt(0.5))
    at = np.array([[0.0, -radius, 0.0], [5.0, 0.0, 0.0]])
    native = Native(make_scene((make_leaf(ir.Points(at), ir.Kernel("soft2"), 1.0, 1.0), 0.5)))
    hits = native.first_hit([[-3.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]])
    assert hits.status.tolist() == [ENTER]
    assert hits.t[0] == pytest.approx(8.0 - radius, abs=1e-14)


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_slit_is_seen(gap: float):
    """A ray that starts inside one blob, through a slit between two max-ed spheres into the other: the exit from
    the first is found however thin the slit is, and the entry behind it, from within the slit."""
    radius = np.sqrt(1.0 - np.sqrt(0.5))
    balls = [
        make_leaf(ir.Points(np.array([[x, 0.0, 0.0]])), ir.Kernel("soft2"), 1.0, 1.0)
        for x in (-radius - gap / 2, radius + gap / 2)
    ]
    native = Native(make_scene((ir.Node("max", tuple(balls)), 0.5)))
    leave = native.first_hit([[-radius, 0.0, 0.0]], [[1.0, 0.0, 0.0]])
    assert leave.status.tolist() == [EXIT]
    assert leave.t[0] == pytest.approx(radius - gap / 2, abs=4e-15)
    enter = native.first_hit([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]])
    assert enter.status.tolist() == [ENTER]
    assert enter.t[0] == pytest.approx(gap / 2, abs=4e-15)


@pytest.mark.parametrize("dip", [1e-1, 1e-4, 1e-8, 1e-12])
def test_a_thin_shell_is_hit(dip: float):
    """A kernel that peaks with 4/3 at s = 1/3 under a threshold `dip` below that: a wall from s = 1/3 - w to 1/3 + w
    with w = sqrt(dip / 3), down to 1e-6. Outside, inside and the way out of it are found within the conditioned
    error, E / |F'| with |F'| = 4 sqrt(dip) and E = 32 eps (8 rounding errors of the terms and of the position)."""
    native = Native(make_scene((make_leaf(POINT, random_scenes.SHELL, 1.0, 1.0), 4.0 / 3.0 - dip)))
    rng = np.random.default_rng(0)
    d = rng.normal(size=(200, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    width = np.sqrt(dip / 3.0)
    outer, inner = np.sqrt(1.0 / 3.0 + width), np.sqrt(1.0 / 3.0 - width)
    allowed = 32.0 * conditioning.EPS / (4.0 * np.sqrt(dip)) + 8.0 * conditioning.EPS * 3.0
    enter = native.first_hit(-3.0 * d, d)
    assert (enter.status == ENTER).all()
    assert np.abs(enter.t - (3.0 - outer)).max() < allowed
    leave = native.first_hit(-3.0 * d, d, t_min=3.0 - 0.5 * (outer + inner))
    assert (leave.status == EXIT).all()
    assert np.abs(leave.t - (3.0 - inner)).max() < allowed
    assert (native.first_hit(np.zeros((200, 3)), d).status == ENTER).all()
