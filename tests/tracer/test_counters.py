"""What the tracer counts for each ray is what it did: recounted where that can be told from outside."""

from __future__ import annotations

import numpy as np
import pytest
from random_scenes import make_leaf, make_scene, random_rays, random_scene
from tracer.methods import INDEXES, SEARCHES

import blobscript
from blobscript import ir
from blobscript.backends.native import COUNTERS, Hits, Native

SCRIPT = """surface(threshold = 0.25) {
  ball((0, 0, 0), reach = 1, weight = 1)
  ball((0, 0, -5), reach = 1, weight = 1)
}"""
RIM = 1.0 / np.sqrt(2.0)  # (1 - s)^2 = 1/4


def row() -> ir.Scene:
    """Five balls of reach 1 along z, 5 apart."""
    at = np.array([[0.0, 0.0, -5.0 * i] for i in range(5)])
    return make_scene((make_leaf(ir.Points(at), ir.Kernel("soft2"), 1.0, 1.0), 0.25))


def alone(native: Native, origin: list[float], direction: list[float], **options: object) -> Hits:
    return native.first_hit([origin], [direction], counters=True, **options)  # pyright: ignore[reportArgumentType]


def test_every_counter_comes_with_hits():
    hits = blobscript.compile(SCRIPT).first_hit([[0.0, 0, 5]], [[0.0, 0, -1]], counters=True)
    assert set(hits.counters) == set(COUNTERS)
    assert all(len(values) == 1 for values in hits.counters.values())
    assert not blobscript.compile(SCRIPT).first_hit([[0.0, 0, 5]], [[0.0, 0, -1]]).counters


@pytest.mark.parametrize("index", INDEXES)
@pytest.mark.parametrize("search", SEARCHES)
def test_what_is_searched_is_counted(search: str, index: str):
    """A ray that hits was searched and looked at; one beside everything was not."""
    rng = np.random.default_rng(6)
    for seed in range(6):
        scene = random_scene(np.random.default_rng(seed), depth=seed % 3)
        native = Native(scene)
        origins, directions = random_rays(rng, scene, 60)
        hits = native.first_hit(origins, directions, search=search, index=index, counters=True)
        for name in ("nodes", "candidates", "spans"):
            assert (hits.counters[name][hits.hit] >= 1).all(), name
        assert (hits.evaluations >= hits.counters["sandwiches"]).all()
        assert (hits.evaluations[hits.hit] >= 1).all()
        if search != "sandwich":
            assert not hits.counters["sandwiches"].any()
    away = Native(row()).first_hit([[5.0, 0, 5]], [[0.0, 0, -1]], search=search, index=index, counters=True)
    assert away.evaluations[0] == 0
    assert not any(away.counters[name][0] for name in ("candidates", "spans", "sandwiches", "fallbacks"))


def test_candidates_are_the_elements_on_the_way():
    """Without an index all that the ray meets; where it stops at the first hit, no more than that."""
    native = Native(row())
    assert alone(native, [0.0, 0, 9], [0.0, 0, -1], index="none").counters["candidates"][0] == 5
    assert alone(native, [0.0, 0, 9], [0.0, 1, -0.2], index="none").counters["candidates"][0] == 0
    across = alone(native, [9.0, 0, -5], [-1.0, 0, 0], index="none")
    assert across.counters["candidates"][0] == 1


@pytest.mark.parametrize("step", [0.1, 0.01])
def test_looks_of_march(step: float):
    """From where the first ball is felt, which it enters at 0, to the crossing: a look every step, at whole steps from
    the start; then bisection down to the tolerance, and one look at the end."""
    native = Native(row())
    hits = alone(native, [0.0, 0, 4], [0.0, 0, -1], search="march", step=step, tolerance=step / 8.0)
    looks = np.ceil((4.0 - RIM) / step) - np.floor(3.0 / step)
    assert abs(hits.evaluations[0] - (1 + looks + 3 + 1)) <= 2


def test_looks_of_sphere():
    """Steps of -F / L from the rim of the reach on, recounted."""
    native = Native(make_scene((make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("soft2"), 1.0, 1.0), 0.25)))
    tolerance = 1e-4
    r, steepest, looks = 1.0, 8.0 / (3.0 * np.sqrt(3.0)), 0
    while True:
        looks += 1
        step = (0.25 - (1.0 - r * r) ** 2) / steepest
        if step < tolerance:
            break
        r -= step
    hits = alone(native, [0.0, 0, 4], [0.0, 0, -1], search="sphere", tolerance=tolerance)
    assert abs(hits.t[0] - (4.0 - r)) < 1e-6
    assert abs(hits.evaluations[0] - looks) <= 3  # the start, and one more for the normal


def test_pictures_show_the_same():
    """The layers of a picture are the counters of the rays through its pixels."""
    scene = blobscript.compile(SCRIPT)
    image = scene.render(width=32, height=32, aov=("depth", *COUNTERS, "evaluations"))
    seen = np.isfinite(image.aov["depth"])
    assert seen.any()
    for name in ("nodes", "candidates", "spans", "evaluations"):
        assert (image.aov[name][seen] >= 1).all(), name
    assert not image.aov["evaluations"][0, 0]
