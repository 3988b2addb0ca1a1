"""Proved kernels in the tracer: certified first hits, above all of rays through skeletons."""

from __future__ import annotations

import numpy as np
import oracle
import pytest
from random_scenes import BUILT_IN, make_leaf, make_scene, random_rays, random_scene
from user_kernels import GOOD, proved

from blobscript import field as reference
from blobscript.backends.native import Native
from blobscript.ir import Points

KERNELS = [proved(text, **arguments) for text, arguments, _ in GOOD]


def certified_failures(scene, origins, directions) -> list[str]:
    """Rays on which the tracer's first hit is not the certified one; a graze counts as no hit."""
    hits = Native(scene).first_hit(origins, directions, threads=1)
    failures = []
    for i, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        answer = oracle.certain_hit(scene, origin, direction)
        expected = {"enter": 1, "exit": 2}.get(answer.kind, 0) if answer.status == "hit" else 0
        error = abs(hits.t[i] - answer.distance) if expected else 0.0
        if answer.stable and (hits.status[i] % 3 != expected or not error <= 4 * max(answer.tolerance, 1e-13)):
            failures.append(f"ray {i}: status {hits.status[i]} at {hits.t[i]!r}, {answer}")
    return failures


def lattice_scene(rng: np.random.Generator, kernel):
    """Points on a coarse lattice, so that rays along the axes meet several of them exactly."""
    count = int(rng.integers(1, 5))
    at = rng.integers(-2, 3, (count, 3)) * 0.25
    weight = rng.uniform(0.3, 1.5, count) * np.where(rng.random(count) < 0.4, -1.0, 1.0)
    top = float(np.abs(weight).max())
    threshold = float(rng.choice([0.999 * top, 0.5 * top, 0.2, 1e-3]))
    return at, make_scene((make_leaf(Points(at), kernel, rng.choice([0.5, 1.0, 1.5], count), weight), threshold))


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda k: k.name)
def test_rays_through_skeletons(kernel):
    """Where s = 0: the slope in s has its limit there, or none at all for a kernel with a crease."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        at, scene = lattice_scene(rng, kernel)
        directions = np.concatenate([np.eye(3), -np.eye(3), rng.normal(size=(4, 3))])
        origins = at[rng.integers(len(at), size=len(directions))] - 3.0 * directions
        origins[6:8] += 3.0 * directions[6:8]  # two rays start at a skeleton
        assert certified_failures(scene, origins, directions) == []


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda k: k.name)
def test_random_scenes_with_a_user_kernel(kernel):
    for seed in range(2):
        rng = np.random.default_rng(seed)
        scene = random_scene(rng, kinds=("points", "lines"), kernels=(kernel, *BUILT_IN))
        assert certified_failures(scene, *random_rays(rng, scene, 8)) == []


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda k: k.name)
def test_values_in_the_tracer(kernel):
    rng = np.random.default_rng(1)
    scene = random_scene(rng, kinds=("points",), kernels=(kernel,))
    where = rng.uniform(-2, 2, (500, 3))
    native = Native(scene)
    assert np.allclose(native.field(where), reference.field_value(scene.surfaces[0].field, where), rtol=0, atol=1e-13)
    expected = reference.gradient(scene.surfaces[0].field, where)
    assert np.allclose(native.gradient(where), expected, rtol=1e-9, atol=1e-11)
