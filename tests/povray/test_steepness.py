"""The proved bound on the gradient holds, and is tight enough to be used."""

from __future__ import annotations

import numpy as np
import pytest
from random_scenes import make_leaf, random_field

from blobscript import field
from blobscript.ir import Kernel, Points
from blobscript.povray.steepness import gradient_enclosure, proved_gradient, sampled_gradient, steepness


@pytest.mark.parametrize("seed", range(12))
def test_gradients_lie_in_their_enclosure(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = random_field(rng, depth=2)
    lo, hi = field.extent(tree)
    low = rng.uniform(lo, hi, (40, 3))
    high = low + rng.uniform(0, 0.3, (40, 1)) * (hi - lo) * rng.uniform(0, 1, (40, 3))
    bounds = gradient_enclosure(tree, low, high)
    steep = steepness(tree, low, high)
    for _ in range(20):
        found = field.gradient(tree, rng.uniform(low, high))
        good = np.isfinite(found).all(axis=1)
        slack = 1e-9 * (1.0 + np.abs(found[good]))
        assert (found[good] >= bounds[0][good] - slack).all()
        assert (found[good] <= bounds[1][good] + slack).all()
        assert (np.linalg.norm(found[good], axis=1) <= steep[good] * (1 + 1e-9) + 1e-12).all()


@pytest.mark.parametrize("count", [5, 20, 100])
def test_at_most_three_times_the_true_maximum(count: int) -> None:
    """Random points that overlap; the sum of Lipschitz constants would be 2.8, 12 and 40 times too large."""
    at = np.random.default_rng(count).uniform(-1, 1, (count, 3))
    leaf = make_leaf(Points(at), Kernel("soft3"), 0.9 if count < 100 else 0.75, 1.0)
    lo, hi = field.extent(leaf)
    proved, seen = proved_gradient(leaf, lo, hi), sampled_gradient(leaf, lo, hi, 100_000)
    assert seen <= proved <= 3.0 * seen
