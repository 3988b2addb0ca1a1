"""The lecture's searches beside the sandwich: three miss nothing and agree on every ray; segment, sphere and march
find what is easy, and fail as they are known to. Certified answers for the first three are in test_stress.py."""

from __future__ import annotations

import conditioning
import numpy as np
import pytest
import random_scenes
from random_scenes import SHELL, make_leaf, make_scene
from tracer import campaigns
from tracer.methods import SEARCHES

from blobscript import ir, kernels
from blobscript.backends.native import ENTER, EXIT, MISS, Hits, Native

PROVED = SEARCHES
#: What the others report may be off by: the last step is shorter than 1e-9 reaches, but the slope there may be
#: small beside the bound that steps are made of.
LOOSE = 1e-6
EASY = ("segment", "sphere", "march")


def _balls(*centers: tuple[float, float, float], kernel: str = "soft2", weight: float = 1.0) -> ir.Scene:
    return make_scene((make_leaf(ir.Points(np.array(centers)), ir.Kernel(kernel), 1.0, weight), 0.25))


def _grid(count: int = 20, at: float = -3.0) -> tuple[np.ndarray, np.ndarray]:
    """Parallel rays along z through the unit square."""
    x, y = np.meshgrid(np.linspace(-0.9, 0.9, count), np.linspace(-0.9, 0.9, count))
    origins = np.stack([x.ravel(), y.ravel(), np.full(x.size, at)], axis=1)
    return origins, np.tile([0.0, 0.0, 1.0], (x.size, 1))


def _differences(scene: ir.Scene, origins, directions, first: Hits, second: Hits) -> list[int]:
    """Rays with another answer, or another distance than conditioning allows."""
    wrong = (first.hit != second.hit) | (first.surface != second.surface)
    wrong |= first.hit & (first.status != second.status)
    for index, surface in enumerate(scene.surfaces):
        mine = np.flatnonzero((first.surface == index) & ~wrong)
        allowed = conditioning.tolerance(surface, origins[mine], directions[mine], first.t[mine])
        wrong[mine] = np.abs(first.t[mine] - second.t[mine]) > 2.0 * allowed
    return np.flatnonzero(wrong).tolist()


# ---- what is proved agrees ---------------------------------------------------------------------------------


@pytest.mark.parametrize("block", range(4))
def test_proved_searches_agree_on_every_ray(block: int):
    """Random trees of all skeletons and kernels, a third of the rays grazing."""
    hits = 0
    for seed in range(100 + 12 * block, 112 + 12 * block):
        rng, scene = campaigns.scene_of(seed)
        origins, directions = campaigns.rays_of(rng, scene, 150)
        native = Native(scene)
        found = {search: native.first_hit(origins, directions, search=search) for search in PROVED}
        hits += int(found["sandwich"].hit.sum())
        for search in PROVED[1:]:
            assert _differences(scene, origins, directions, found["sandwich"], found[search]) == [], (seed, search)
    assert hits > 100


@pytest.mark.parametrize("search", PROVED[1:])
@pytest.mark.parametrize("op", ["max", "min", "sum"])
def test_proved_searches_agree_under_nodes(op: str, search: str):
    """Polynomial kernels only, so that exact coefficients meet in max and min as well."""
    rng = np.random.default_rng(5)
    children = tuple(
        make_leaf(
            ir.Points(rng.uniform(-0.6, 0.6, (4, 3))), ir.Kernel(kernel), 1.0, rng.choice([1.0, -0.4], 4, p=[0.8, 0.2])
        )
        for kernel in ("soft2", "soft3", "wyvill")
    )
    lines = make_leaf(ir.Lines(rng.uniform(-1, 1, (3, 3)), rng.uniform(-1, 1, (3, 3))), ir.Kernel("soft3"), 0.7, 1.0)
    scene = make_scene((ir.Node(op, (*children, lines)), 0.2))
    native = Native(scene)
    origins, directions = random_scenes.random_rays(rng, scene, 600)
    first = native.first_hit(origins, directions)
    assert _differences(scene, origins, directions, first, native.first_hit(origins, directions, search=search)) == []
    assert first.hit.sum() > 30


@pytest.mark.parametrize("search", PROVED)
def test_large_densities_that_cancel(search: str):
    """A million and minus a million, a millionth apart: the sum is a dipole of size 1. Bounds of each of them alone
    need thousands of intervals; coefficients are summed before they are bounded."""
    leaf = make_leaf(
        ir.Points(np.array([[0.0, 0, 0], [1e-6, 0, 0]])), ir.Kernel("soft3"), np.ones(2), np.array([-1e6, 1e6])
    )
    scene = make_scene((leaf, 0.5))
    native = Native(scene)
    rng = np.random.default_rng(2)
    origins = np.stack([np.full(64, 3.0), *rng.uniform(-0.4, 0.4, (2, 64))], axis=1)
    directions = np.tile([-1.0, 0.0, 0.0], (64, 1))
    hits = native.first_hit(origins, directions, search=search, counters=True)
    assert hits.hit.all()
    # d/dx of (1 - r^2)^3, times the distance of the two, to first order in it
    x = hits.position
    s = (x**2).sum(axis=1)
    np.testing.assert_allclose(6.0 * x[:, 0] * (1.0 - s) ** 2, 0.5, atol=1e-5)
    assert hits.evaluations.mean() < {"sandwich": 100, "bernstein": 60, "interval": 20000}[search]
    assert hits.counters["fallbacks"].any() == (search == "sandwich")


# ---- the others, where it is easy ------------------------------------------------------------------------------


@pytest.mark.parametrize("kernel", ["soft2", "soft3", "wyvill", "gauss", "gauss_c1", "metaball"])
@pytest.mark.parametrize("search", EASY)
def test_easy_scenes(search: str, kernel: str):
    leaf = make_leaf(
        ir.Points(np.array([[0.0, 0, 0], [0.5, 0.3, 0.2]])),
        ir.Kernel(kernel, 4.0 if "gauss" in kernel else 0.0),
        1.0,
        1.0,
    )
    native = Native(make_scene((leaf, 0.4)))
    origins, directions = _grid()
    right = native.first_hit(origins, directions)
    clear = ~right.hit | (np.abs(right.normal[:, 2]) > 0.2)
    hits = native.first_hit(origins, directions, search=search)
    np.testing.assert_array_equal(hits.status[clear], right.status[clear])
    here = clear & right.hit
    assert here.sum() > 100
    assert np.abs(hits.t[here] - right.t[here]).max() < LOOSE
    assert np.abs(hits.normal[here] - right.normal[here]).max() < 100 * LOOSE


@pytest.mark.parametrize("search", EASY)
@pytest.mark.parametrize("kind", random_scenes.SKELETONS)
def test_every_skeleton(kind: str, search: str):
    """Mapped meshes, solids, lines …: hits lie on the surface, and few are missed or false near silhouettes."""
    rng = np.random.default_rng(7)
    rays = wrong = 0
    for _ in range(3):
        scene = random_scenes.random_scene(rng, depth=1, kinds=(kind,))
        native = Native(scene)
        origins, directions = random_scenes.random_rays(rng, scene, 100)
        right, hits = (native.first_hit(origins, directions, search=s) for s in ("sandwich", search))
        both = right.hit & hits.hit
        rays += len(origins)
        wrong += int((right.hit != hits.hit).sum() + (np.abs(right.t[both] - hits.t[both]) > 1e-5).sum())
    assert wrong <= 0.02 * rays


@pytest.mark.parametrize("search", [*PROVED, *EASY])
def test_user_kernels_and_max_nodes(search: str):
    """A kernel that rises before it falls, beside a ball: the larger counts."""
    children = tuple(
        make_leaf(ir.Points(np.array([at])), kernel, 1.0, 1.0)
        for at, kernel in (((-0.6, 0.0, 0.0), SHELL), ((0.6, 0.0, 0.0), ir.Kernel("soft2")))
    )
    native = Native(make_scene((ir.Node("max", children), 0.25)))
    hits = native.first_hit([[-3.0, 0, 0], [3.0, 0, 0]], [[1.0, 0, 0], [-1.0, 0, 0]], search=search)
    # 1 + 2s - 3s^2 = 1/4 and (1 - s)^2 = 1/4
    expected = 3.0 - 0.6 - np.sqrt([(1.0 + np.sqrt(3.25)) / 3.0, 0.5])
    np.testing.assert_allclose(hits.t, expected, atol=LOOSE)
    assert (hits.status == ENTER).all()


@pytest.mark.parametrize("search", [*PROVED, *EASY])
def test_starts_inside_and_windows(search: str):
    """(1 - s)^2 = 1/4 at r = 0.5412; a window is open below and closed above."""
    native = Native(_balls((0, 0, 0)))
    r = np.sqrt(0.5)
    hits = native.first_hit(
        [[0.0, 0, 0], [-3.0, 0, 0], [-3.0, 0, 0]], np.tile([1.0, 0, 0], (3, 1)), 0.0, [9, 2, 9], search=search
    )
    np.testing.assert_array_equal(hits.status, [EXIT, MISS, ENTER])
    np.testing.assert_allclose(hits.t[[0, 2]], [r, 3.0 - r], atol=LOOSE)
    behind = native.first_hit([[-3.0, 0, 0]], [[1.0, 0, 0]], 3.0, search=search)
    assert behind.status[0] == EXIT
    assert abs(behind.t[0] - 3.0 - r) < LOOSE
    assert native.first_hit([[-3.0, 0, 0]], [[1.0, 0, 0]], 5.0, search=search).status[0] == MISS


@pytest.mark.parametrize("search", [*PROVED, *EASY])
def test_starts_on_the_surface(search: str):
    """A hit's own surface is not hit again on the way out; on the way in, the other side is."""
    native = Native(_balls((0, 0, 0)))
    origins, directions = _grid()
    first = native.first_hit(origins, directions)
    clear = first.hit & (np.abs(first.normal[:, 2]) > 0.2)
    p, n = first.position[clear], first.normal[clear]
    assert (native.first_hit(p, n, search=search).status == MISS).all()
    inward = native.first_hit(p, directions[clear], search=search)
    assert inward.hit.all()
    assert (inward.t > 0.1).all()


def test_negative_densities_and_thresholds():
    """Below 0 everything far away is inside: gaps are not skipped, a hole is entered from its inside."""
    native = Native(make_scene((make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("soft2"), 1.0, -1.0), -0.25)))
    rays = [[-3.0, 0, 0], [0.0, 0, 0]], [[1.0, 0, 0], [1.0, 0, 0]]
    expected = native.first_hit(*rays)
    assert expected.status.tolist() == [EXIT, ENTER]
    for search in (*PROVED, *EASY):
        hits = native.first_hit(*rays, search=search)
        np.testing.assert_array_equal(hits.status, expected.status)
        np.testing.assert_allclose(hits.t, expected.t, atol=LOOSE)


# ---- options -----------------------------------------------------------------------------------------------------


def test_march_misses_what_is_thinner_than_its_step():
    """A shell 0.006 thick that every ray crosses four times or twice."""
    leaf = make_leaf(ir.Points(np.zeros((1, 3))), SHELL, 1.0, 1.0)
    native = Native(make_scene((leaf, 4.0 / 3.0 - 1e-4)))
    origins, directions = _grid()
    crossed = native.first_hit(origins, directions).hit
    coarse = native.first_hit(origins, directions, search="march", step=0.1).hit
    fine = native.first_hit(origins, directions, search="march", step=0.001).hit
    assert crossed.sum() > 100
    assert coarse[crossed].mean() < 0.5
    assert fine[crossed].mean() > 0.95
    assert not (coarse & ~crossed).any()
    assert not (fine & ~crossed).any()


def test_steps_and_tolerances_cost_evaluations():
    native = Native(_balls((0, 0, 0), (0.5, 0.2, 0.0)))
    rays = _grid()

    def effort(search: str, **options: float) -> float:
        return native.first_hit(*rays, search=search, **options).evaluations.mean()

    assert effort("march", step=0.001) > 5.0 * effort("march", step=0.02)
    assert effort("march", tolerance=1e-3) < effort("march")
    for search in ("segment", "sphere"):
        assert effort(search, tolerance=1e-3) < effort(search, tolerance=1e-6) < effort(search, tolerance=1e-12)
    assert effort("segment") < 0.5 * effort("sphere")
    for search in PROVED:
        assert effort(search, tolerance=1e-2) < effort(search)


@pytest.mark.parametrize("search", [*PROVED, *EASY])
def test_a_tolerance_bounds_the_error(search: str):
    """The step or bracket at the end is below it; F / |F'| is at most (bound of slopes) / |F'| of that."""
    native = Native(_balls((0, 0, 0)))
    origins, directions = _grid()
    right = native.first_hit(origins, directions)
    clear = right.hit & (np.abs(right.normal[:, 2]) > 0.5)
    hits = native.first_hit(origins, directions, search=search, tolerance=1e-4)
    error = np.abs(hits.t[clear] - right.t[clear])
    assert error.max() < 5e-4
    assert error.max() > 1e-13


def test_sphere_and_segment_stop_beside_a_tangent():
    """A ray that passes at 1e-6 of the surface and never touches it: a hit with a coarser tolerance. Segments know how
    flat F gets there, and stop only where the root of the distance is below it."""
    native = Native(_balls((0, 0, 0)))
    ray = [[-3.0, np.sqrt(0.5) + 1e-6, 0.0]], [[1.0, 0.0, 0.0]]
    for search in PROVED:
        assert native.first_hit(*ray, search=search).status[0] == MISS
    for search, tolerance in (("sphere", 1e-4), ("segment", 1e-2)):
        assert native.first_hit(*ray, search=search, tolerance=tolerance).status[0] == ENTER
        assert native.first_hit(*ray, search=search, tolerance=1e-9).status[0] == MISS


def test_sphere_leaves_the_rest_to_the_sandwich():
    """Along a cylinder just above the tolerance spheres take millions of steps: the search gives up and says so."""
    leaf = make_leaf(ir.Lines(np.array([[-40.0, 0, 0]]), np.array([[40.0, 0, 0]])), ir.Kernel("soft2"), 1.0, 1.0)
    native = Native(make_scene((leaf, 0.25)))
    above = [[-39.0, np.sqrt(0.5) + 1e-5, 0.0]], [[1.0, 0.0, 0.0]]
    hits = native.first_hit(*above, search="sphere", tolerance=1e-7, counters=True)
    assert hits.status[0] == MISS
    assert hits.counters["fallbacks"][0] == 1
    assert native.first_hit(*above, counters=True).counters["fallbacks"][0] == 0


@pytest.mark.parametrize("search", [*PROVED, "segment", "sphere"])
def test_a_step_belongs_to_march(search: str):
    native = Native(_balls((0, 0, 0)))
    with pytest.raises(ValueError, match="step belongs to the search 'march'"):
        native.first_hit([[0.0, 0, 5]], [[0.0, 0, -1]], search=search, step=0.1)


def test_a_step_of_normals_belongs_to_differences():
    native = Native(_balls((0, 0, 0)))
    with pytest.raises(ValueError, match="normal_step belongs to"):
        native.first_hit([[0.0, 0, 5]], [[0.0, 0, -1]], normal_step=0.1)


# ---- what they stand on ------------------------------------------------------------------------------------------


def test_lipschitz_bounds_are_packed():
    """Sphere tracing is as good as the bound: no slope of any kernel exceeds it, and it is nearly reached."""
    for kernel in (*random_scenes.BUILT_IN, *random_scenes.USER):
        native = Native(make_scene((make_leaf(ir.Points(np.zeros((1, 3))), kernel, 1.0, 1.0), 0.25)))
        r = np.linspace(1e-3, 1.0 - 1e-9, 20001)
        steepest = np.abs(native.gradient(np.stack([r, 0 * r, 0 * r], axis=1))[:, 0]).max()
        packed = float(native.packed.arrays["kernels"]["lipschitz"][0])  # type: ignore[call-overload]
        assert packed == kernels.lipschitz(kernel)
        assert 0.99 * packed <= steepest <= packed * (1.0 + 1e-9)


def test_several_surfaces_and_threads():
    """The nearest of both surfaces; the same bits from any number of threads."""
    leaves = [make_leaf(ir.Points(np.array([[0.0, 0, z]])), ir.Kernel("soft2"), 1.0, 1.0) for z in (0.0, 2.5)]
    native = Native(make_scene((leaves[0], 0.25), (leaves[1], 0.25)))
    origins, directions = (np.tile(a, (30, 1)) for a in _grid())
    for search in (*PROVED, *EASY):
        one, many = (native.first_hit(origins, directions, search=search, threads=n) for n in (1, 4))
        np.testing.assert_array_equal(one.t, many.t)
        assert set(one.surface.tolist()) == {-1, 0}
        assert set(native.first_hit(origins, directions, 1.0 + 3.0, search=search).surface.tolist()) == {-1, 1}
