"""Smooth maxima in the tracer: values, gradients and paint as in NumPy, hits as certified, all searches agree."""

from __future__ import annotations

import conditioning
import numpy as np
import oracle
import pytest
import random_scenes
from random_scenes import make_leaf, make_scene
from tracer import campaigns

from blobscript import field as reference
from blobscript import ir
from blobscript.backends.native import MISS, Native

SEARCHES = ("sandwich", "interval", "bernstein")


def joint_scene(seed: int, **leaf) -> tuple[np.random.Generator, ir.Scene]:
    """A smooth maximum of two to five trees (now and then its mirror image), some of them smooth again."""
    rng = np.random.default_rng([seed, 41])
    below = tuple(
        random_scenes.random_field(rng, int(rng.integers(0, 3)), **leaf) for _ in range(int(rng.integers(2, 6)))
    )
    op, threshold = ("smooth_max", 0.3) if seed % 4 else ("smooth_min", -0.3)
    return rng, make_scene((ir.Node(op, below), threshold))


@pytest.mark.parametrize("seed", range(12))
def test_values_gradients_and_paint(seed: int):
    finite = tuple(k for k in random_scenes.BUILT_IN + random_scenes.USER if k.name != "gauss")  # cut elsewhere
    rng, scene = joint_scene(seed, kernels=finite)
    surface, native = scene.surfaces[0], Native(scene)
    lo, hi = reference.extent(surface.field)
    at = rng.uniform(lo, hi, (500, 3))
    value, gradient = reference.value_and_gradient(surface.field, at)
    error = conditioning.rounding(surface, at, conditioning.position_error(at, np.zeros(len(at))))
    assert (np.abs(native.field(at) - value) <= error).all()
    steep = 1.0 + np.abs(gradient).max()
    assert np.allclose(native.gradient(at), gradient, atol=1e-9 * steep)
    felt = np.abs(value) > 1e-9
    rows = np.stack([reference.material_row(material) for material in scene.materials])
    found = native.paint(at[felt], np.zeros(felt.sum(), dtype=np.int32), rows)
    assert np.allclose(found, reference.material(surface, at[felt], scene), atol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_searches_agree(seed: int):
    rng, scene = joint_scene(seed)
    origins, directions = campaigns.rays_of(rng, scene, 240)
    first, *others = (Native(scene).first_hit(origins, directions, search=search, threads=1) for search in SEARCHES)
    allowed = conditioning.tolerance(scene.surfaces[0], origins[first.hit], directions[first.hit], first.t[first.hit])
    for other in others:
        assert ((first.status == other.status) | ~(first.hit | other.hit)).all()
        assert (np.abs(first.t[first.hit] - other.t[first.hit]) <= 2.0 * allowed).all()


@pytest.mark.parametrize("seed", range(4))
def test_hits_are_as_certified(seed: int):
    rng, scene = joint_scene(seed)
    origins, directions = campaigns.rays_of(rng, scene, 9)
    hits = Native(scene).first_hit(origins, directions, threads=1)
    for i in range(len(origins)):
        answer = oracle.certain_hit(scene, origins[i], directions[i])
        if not answer.stable:
            continue
        assert (answer.status == "hit") == bool(hits.hit[i])
        if hits.hit[i]:
            allowed = conditioning.tolerance(
                scene.surfaces[0], origins[i : i + 1], directions[i : i + 1], hits.t[i : i + 1]
            )
            assert abs(hits.t[i] - answer.distance) <= allowed[0]


def test_huge_and_tiny_densities_meet():
    """Nothing overflows when densities are raised to their eighth power."""
    at = np.array([[-0.3, 0.0, 0.0], [0.3, 0.0, 0.0]])
    for weight in (1e-60, 1e60):
        parts = tuple(make_leaf(ir.Points(p[None]), ir.Kernel("soft2"), 1.0, weight) for p in at)
        native = Native(make_scene((ir.Node("smooth_max", parts), 0.3 * weight)))
        for search in SEARCHES:
            hits = native.first_hit([[0.0, 0.0, 5.0]], [[0.0, 0.0, -1.0]], search=search)
            # both are (1 - 0.09 - z^2)^2 = 0.3 on the axis
            assert hits.t[0] == pytest.approx(5.0 - np.sqrt(0.91 - np.sqrt(0.3)), abs=1e-14)


def test_many_children_of_many_sizes():
    """A hundred children wait on the stack at once, below other nodes."""
    rng = np.random.default_rng(3)
    balls = tuple(
        make_leaf(ir.Points(rng.uniform(-0.4, 0.4, (1, 3))), ir.Kernel("soft3"), 1.0, 1.0) for _ in range(100)
    )
    inner = ir.Node("smooth_max", balls)
    hole = make_leaf(ir.Points(np.array([[0.0, 0.0, 1.0]])), ir.Kernel("soft2"), 0.5, -1.0)
    scene = make_scene((ir.Node("sum", (hole, ir.Node("max", (inner, hole)))), 0.4))
    origins, directions = random_scenes.random_rays(rng, scene, 200)
    hits = Native(scene).first_hit(origins, directions)
    assert hits.hit.sum() > 30
    value = reference.field_value(scene.surfaces[0].field, hits.position[hits.hit])
    assert np.allclose(value, 0.4, atol=1e-10)
    assert (hits.status[~hits.hit] == MISS).all()
