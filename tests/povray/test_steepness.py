"""The proved bound on the gradient holds, and is tight enough to be used."""

from __future__ import annotations

import numpy as np
import pytest
from random_scenes import make_leaf, random_field

from blobscript import field, ir
from blobscript.ir import Kernel, Points
from blobscript.povray import cells
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


def test_pieces_of_many_blobs_are_those_of_each_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A field is looked at in blocks, with what is felt there: the same pieces as with all of it."""
    chance = np.random.default_rng(5)
    children = tuple(make_leaf(Points(chance.uniform(-2, 2, (1, 3))), Kernel("soft3"), 1.0, 0.7) for _ in range(40))
    for op in ("sum", "smooth_max"):
        surface = ir.Surface("a", ir.Node(op, children), 0.5, 0, None)
        monkeypatch.setattr(cells, "_MANY", 32)
        some = cells.cells_of(surface, 1e-6)
        monkeypatch.setattr(cells, "_MANY", 1000)
        whole = cells.cells_of(surface, 1e-6)
        assert len(some) == len(whole) > 50
        for one, other in zip(some, whole, strict=True):
            assert np.array_equal(one.lo, other.lo)
            assert np.array_equal(one.hi, other.hi)
            assert one.max_gradient == pytest.approx(other.max_gradient, rel=1e-9)
