"""Every index finds the same first hits: bounding volumes, grid, octree, partition and none at all.

What an index may change is the order of sums, so distances agree within the conditioned error of both answers.
The stress catalogue and the certified random trees run through all indexes in test_stress.py and test_first_hit.py.
"""

from __future__ import annotations

import ctypes

import conditioning
import numpy as np
import pytest
import random_scenes
from random_scenes import make_leaf, make_scene
from tracer.methods import INDEXES

from blobscript import field as reference
from blobscript import ir
from blobscript.backends.library import INDEXES as NAMES
from blobscript.backends.library import check_status
from blobscript.backends.native import EXIT, Hits, Native

OTHERS = tuple(name for name in NAMES if name != "bvh")
SOFT = ir.Kernel("soft2")


def points_scene(at, reach, threshold: float = 0.4) -> ir.Scene:
    return make_scene((make_leaf(ir.Points(np.ascontiguousarray(at, dtype=float)), SOFT, reach, 1.0), threshold))


def bundle(rng: np.random.Generator, scene: ir.Scene, width: int = 32) -> tuple[np.ndarray, np.ndarray]:
    """Coherent rays: those of a small picture, in blocks of 16 x 16."""
    lo, hi = random_scenes._extent(scene)
    size = float(np.linalg.norm(hi - lo))
    turn = random_scenes.rotation(rng)
    blocks = np.arange(width * width).reshape(width // 16, 16, width // 16, 16).transpose(0, 2, 1, 3).ravel()
    x, y = (blocks % width + 0.5) / width - 0.5, (blocks // width + 0.5) / width - 0.5
    directions = np.column_stack([x, y, np.full(len(x), -1.2)]) @ turn.T
    origins = np.broadcast_to(0.5 * (lo + hi) + turn @ [0.0, 0.0, 1.1 * size], directions.shape)
    return np.ascontiguousarray(origins), directions


def rays_of(rng: np.random.Generator, scene: ir.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Incoherent, coherent, and from within."""
    lo, hi = random_scenes._extent(scene)
    inside = rng.uniform(lo, hi, (200, 3)), rng.normal(size=(200, 3))
    parts = [random_scenes.random_rays(rng, scene, 300), bundle(rng, scene), inside]
    return np.concatenate([o for o, _ in parts]), np.concatenate([d for _, d in parts])


def aimed_rays(rng: np.random.Generator, scene: ir.Scene, count: int) -> tuple[np.ndarray, np.ndarray]:
    """From 3 reaches away, or from within, near elements picked at random."""
    leaf = scene.surfaces[0].field
    assert isinstance(leaf, ir.Leaf)
    at = leaf.skeleton.a if isinstance(leaf.skeleton, ir.Lines) else leaf.skeleton.at  # pyright: ignore
    which = rng.integers(len(at), size=count)
    reach = leaf.reach[which, None]
    d = rng.normal(size=(count, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    target = at[which] + rng.normal(size=(count, 3)) * 0.2 * reach
    return target - np.where(rng.random((count, 1)) < 0.2, 0.0, 3.0) * reach * d, d


def assert_same(scene: ir.Scene, o: np.ndarray, d: np.ndarray, a: Hits, b: Hits) -> None:
    np.testing.assert_array_equal(a.status, b.status)
    np.testing.assert_array_equal(a.surface, b.surface)
    for i, surface in enumerate(scene.surfaces):
        mine = a.surface == i
        if mine.any():
            allowed = conditioning.tolerance(surface, o[mine], d[mine], a.t[mine])
            assert (np.abs(a.t[mine] - b.t[mine]) <= 2.0 * allowed).all()


def field_through(native: Native, index: str, points: np.ndarray) -> np.ndarray:
    values = np.empty(len(points))
    where = native.index_pointer(index)
    status = native._library.blob_field(
        native.scene_pointer, where, 0, len(points), points.ctypes.data, values.ctypes.data, None
    )
    check_status(status)
    return values


def bytes_of(native: Native, index: str) -> int:
    return native._library.blob_index_bytes(native.index_pointer(index))


def test_all_are_in_the_suites():
    assert set(INDEXES) == set(NAMES)


# ---- same hits ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", OTHERS)
@pytest.mark.parametrize("seed", range(6))
def test_random_trees(seed: int, index: str):
    """All skeletons and kernels, one or two surfaces."""
    rng = np.random.default_rng([seed, 8])
    scene = random_scenes.random_scene(rng, depth=seed % 4, surfaces=1 + seed % 2)
    o, d = rays_of(rng, scene)
    native = Native(scene)
    assert_same(scene, o, d, native.first_hit(o, d), native.first_hit(o, d, index=index))
    np.testing.assert_array_equal(native.any_hit(o, d, index=index), native.any_hit(o, d))


def crowd(kind: str) -> ir.Scene:
    """Scenes in which the index has work to do, each unpleasant to some kind of it."""
    rng = np.random.default_rng(len(kind))
    unit = rng.uniform(-1, 1, (3000, 3))
    match kind:
        case "even":
            return points_scene(unit, 0.12)
        case "sizes":  # from a thousandth of the scene to all of it
            return points_scene(unit, 10.0 ** rng.uniform(-3, 0, 3000) * (rng.random(3000) < 0.02) + 0.02, 0.9)
        case "clusters":
            return points_scene(unit * 1e-3 + rng.integers(-1, 2, (3000, 3)), 3e-4)
        case "flat":
            return points_scene(unit * [1.0, 1.0, 0.0], 0.04)
        case "line":
            return points_scene(unit * [0.0, 1.0, 0.0], 0.002)
        case "lattice":  # centres and borders coincide with planes of cells
            steps = np.arange(-8, 8) / 8.0
            return points_scene(np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3), 0.125)
        case "lines":
            along = rng.normal(size=(500, 3)) * [0.02, 0.02, 1.0]
            lines = ir.Lines(unit[:500] - along, unit[:500] + along)
            return make_scene((make_leaf(lines, SOFT, 0.1, 1.0), 0.4))
        case _:
            raise ValueError(kind)


CROWDS = ("even", "sizes", "clusters", "flat", "line", "lattice", "lines")


@pytest.mark.parametrize("index", OTHERS)
@pytest.mark.parametrize("kind", CROWDS)
def test_crowds(kind: str, index: str):
    scene = crowd(kind)
    rng = np.random.default_rng(1)
    o, d = (np.concatenate(pair) for pair in zip(rays_of(rng, scene), aimed_rays(rng, scene, 300), strict=True))
    native = Native(scene)
    expected = native.first_hit(o, d)
    assert expected.hit.sum() > 100
    assert (expected.status == EXIT).sum() > 3
    assert_same(scene, o, d, expected, native.first_hit(o, d, index=index))


@pytest.mark.parametrize("index", NAMES)
@pytest.mark.parametrize("kind", CROWDS)
def test_each_element_counts_once(kind: str, index: str):
    """The field through any index is that of the reference: no element is missing, none is added twice."""
    scene = crowd(kind)
    points = aimed_rays(np.random.default_rng(2), scene, 100)[0]
    expected = reference.field_value(scene.surfaces[0].field, points)
    assert (expected > 0).sum() > 20
    np.testing.assert_allclose(field_through(Native(scene), index, points), expected, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("index", ("bvh", "grid", "octree", "bsp"))
def test_large_scenes(index: str):
    """100 000 points, as many as make bvh.c gather runs first, some thousand of them in one place."""
    rng = np.random.default_rng(10)
    at = rng.uniform(-1, 1, (100_000, 3))
    at[rng.integers(100_000, size=3000)] = at[0]
    scene = points_scene(at, rng.choice([0.01, 0.05], 100_000, p=[0.99, 0.01]))
    native = Native(scene)
    points = np.concatenate([at[:1], aimed_rays(rng, scene, 100)[0]])
    expected = reference.field_value(scene.surfaces[0].field, points)
    assert expected[0] > 2000
    np.testing.assert_allclose(field_through(native, index, points), expected, rtol=1e-11, atol=1e-13)
    o, d = aimed_rays(rng, scene, 300)
    hits = native.first_hit(o, d, index=index)
    assert hits.hit.sum() > 200
    assert_same(scene, o, d, native.first_hit(o, d), hits)


@pytest.mark.parametrize("index", NAMES)
def test_threads_give_the_same_bits(index: str):
    scene = crowd("sizes")
    rng = np.random.default_rng(3)
    o, d = random_scenes.random_rays(rng, scene, 10_000)
    native = Native(scene)
    one = native.first_hit(o, d, index=index, threads=1)
    for threads in (2, 3):
        more = native.first_hit(o, d, index=index, threads=threads)
        assert one.t.tobytes() == more.t.tobytes()
        assert one.normal.tobytes() == more.normal.tobytes()
        assert one.status.tobytes() == more.status.tobytes()


@pytest.mark.parametrize("index", NAMES)
def test_the_same_scene_gives_the_same_index(index: str):
    scene = crowd("sizes")
    o, d = random_scenes.random_rays(np.random.default_rng(4), scene, 1000)
    first, second = Native(scene), Native(scene)
    assert bytes_of(first, index) == bytes_of(second, index)
    a, b = (native.first_hit(o, d, index=index, counters=True) for native in (first, second))
    assert a.t.tobytes() == b.t.tobytes()
    np.testing.assert_array_equal(a.counters["nodes"], b.counters["nodes"])


# ---- degenerate scenes -------------------------------------------------------------------------------------


def degenerate(kind: str) -> ir.Scene:
    rng = np.random.default_rng(5)
    match kind:
        case "one":
            return points_scene([[0.1, 0.2, 0.3]], 1.0)
        case "coincident":
            return points_scene(np.full((500, 3), 0.3), 1.0, 100.0)
        case "coincident but one":
            return points_scene(np.concatenate([np.full((500, 3), 0.3), [[5.0, 0.0, 0.0]]]), 1.0, 0.5)
        case "nested":  # one centre, reaches from 1e-9 to 1
            return points_scene(np.zeros((300, 3)), 10.0 ** np.linspace(-9, 0, 300), 0.5)
        case "dust around a giant":
            at = np.concatenate([[[0.0, 0.0, 0.0]], rng.uniform(-1e-6, 1e-6, (2000, 3))])
            return points_scene(at, np.concatenate([[1.0], np.full(2000, 1e-9)]), 0.5)
        case "all overlap":
            return points_scene(rng.uniform(-0.01, 0.01, (1000, 3)), 1.0, 300.0)
        case "far apart":
            return points_scene([[0.0, 0.0, 0.0], [1e6, 0.0, 0.0], [0.0, 1e6, 0.0]], [1e-3, 1.0, 1e4], 0.5)
        case _:
            raise ValueError(kind)


DEGENERATE = ("one", "coincident", "coincident but one", "nested", "dust around a giant", "all overlap", "far apart")


@pytest.mark.parametrize("index", OTHERS)
@pytest.mark.parametrize("kind", DEGENERATE)
def test_degenerate_scenes(kind: str, index: str):
    scene = degenerate(kind)
    o, d = aimed_rays(np.random.default_rng(6), scene, 400)
    native = Native(scene)
    expected = native.first_hit(o, d)
    assert expected.hit.sum() > 50
    assert_same(scene, o, d, expected, native.first_hit(o, d, index=index))


# ---- memory and effort -------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", NAMES)
@pytest.mark.parametrize("reach", [1e-6, 0.05, 1.0, 1e3])
def test_memory_is_bounded(reach: float, index: str):
    """However the elements overlap: at most 8 listings each (36 bytes), and as many nodes as listings / 8 (256)."""
    rng = np.random.default_rng(7)
    native = Native(points_scene(rng.uniform(-1, 1, (20_000, 3)), reach))
    assert 36 * 20_000 <= bytes_of(native, index) <= 20_000 * 8 * (36 + 32) + 10_000


def test_giants_do_not_burst_the_grid():
    """A few elements that reach everywhere are listed in every cell; many make the cells coarser."""
    rng = np.random.default_rng(8)
    for giants in (3, 300, 20_000):
        reach = np.where(np.arange(20_000) < giants, 2.0, 1e-3)
        native = Native(points_scene(rng.uniform(-1, 1, (20_000, 3)), reach))
        for index in ("grid", "bsp"):
            assert bytes_of(native, index) <= 20_000 * 8 * (36 + 32) + 10_000


def test_what_an_index_saves():
    """Without an index one node is opened and every element on the way is a candidate; a structure opens more
    nodes and looks at fewer candidates, as it stops at the hit."""
    scene = crowd("even")
    rng = np.random.default_rng(9)
    o, d = bundle(rng, scene)
    native = Native(scene)
    counters = {name: native.first_hit(o, d, index=name, counters=True).counters for name in NAMES}
    none = counters.pop("none")
    assert none["nodes"].max() == 1
    for name, counts in counters.items():
        assert counts["nodes"].mean() > 1.5, name
        assert counts["candidates"].mean() < 0.8 * none["candidates"].mean(), name
        assert counts["nodes"].max() < 1000, name


def test_unknown_kinds_are_refused():
    native = Native(degenerate("one"))
    with pytest.raises(ValueError, match="index must be one of bvh, grid, octree, bsp, none"):
        native.first_hit([[0.0, 0.0, 3.0]], [[0.0, 0.0, -1.0]], index="kd")
    for kind in (-1, len(NAMES)):
        pointer = ctypes.c_void_p(1)
        status = native._library.blob_index_build(native.scene_pointer, kind, ctypes.byref(pointer))
        assert status == 3
