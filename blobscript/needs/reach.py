"""Blobs that cannot touch a surface: found by samples, proved by bounds.

Most nodes rise with each of their elements, so the field rises with every positive blob and falls with every
negative one. A blob can be left out if, all over the box outside of which its density is 0, the field with it and
the field without it stay on the same strict side of the threshold: then the surface is where it was, the gradient on
it is what it was, and so is every first hit. Of both fields the one that counts is the one nearer to the
threshold: the upper one where they are below, the lower one where they are above.

A batch of candidates is left out at once. Let G be the field without all candidates of one sign. Positive ones
are proved below by the field as it is (leaving out any of them only lowers it) and above by G; negative ones the
other way round. Those that pass may go together, whatever the others do, since any field between is between both.

Smooth nodes need not rise, and a kernel of the script that is below 0 somewhere has no sign: there the field as it is
and the one without all candidates are both proved, again without those that fail until none does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blobscript import field, geometry, ir, kernels
from blobscript.ir import leaves
from blobscript.needs.tree import Mask, kept

__all__ = ["idle"]

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

#: Work on a surface beyond which no proofs are tried, a fraction of a second: a point counts 1, anything else, whose
#: box may be far larger than what it fills, more, and a tenth for each segment or triangle.
_MOST_WORK, _WORK, _EACH = 10_000, 30, 0.1
#: Likewise pairs of blobs that overlap, estimated from those that overlap with so many of them.
_MOST_PAIRS, _PROBES = 400_000, 64
#: Boxes in the proofs of one batch, and how often a box is cut in eight.
_MOST_BOXES = 4096
_CUTS = 4
#: How often a batch under smooth nodes is tried again without those that failed.
_ROUNDS = 4
#: How far from the threshold a bound must stay, as a part of what it is made of: more than a tracer rounds.
_MARGIN = 1e-9
_ROUNDING = 2.0**-53

#: From the place of a blob to where its density ends, along the axes.
_AROUND = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)]) * 0.999


@dataclass(frozen=True, slots=True)
class _Blobs:
    """All blobs of a surface: leaf and row, weight, box, samples (n, 7, 3) and a ball around the density (of what is
    not a plain point: without end)."""

    leaf: Ints
    row: Ints
    weight: Array
    lo: Array
    hi: Array
    samples: Array
    radius: Array

    def masks(self, surface: ir.Surface, out: NDArray[np.bool_]) -> list[Mask]:
        """What is left of each leaf without the blobs `out` (n,)."""
        masks = [np.ones(leaf.count, dtype=bool) for leaf in leaves(surface.field)]
        for number, row in zip(self.leaf[out].tolist(), self.row[out].tolist(), strict=True):
            masks[number][row] = False
        return masks


def idle(surface: ir.Surface) -> list[Mask] | None:
    """One mask for each leaf of the surface's field: which of its blobs matter. None: all of them."""
    count = sum(leaf.count for leaf in leaves(surface.field))
    work = sum(map(_work, leaves(surface.field)))
    if surface.threshold <= 0.0 or not 0 < work <= _MOST_WORK:
        return None
    blobs = _blobs(surface, count)
    if _pairs(blobs) > _MOST_PAIRS:
        return None
    side = _sides(surface, blobs)
    rises = not _is_smooth(surface.field) and not any(kernels.is_signed(leaf.kernel) for leaf in leaves(surface.field))
    out = _proved_rising(surface, blobs, side) if rises else _proved_smooth(surface, blobs, side)
    return blobs.masks(surface, out) if out.any() else None


def _work(leaf: ir.Leaf) -> float:
    if isinstance(leaf.skeleton, ir.Points):
        return leaf.count
    return leaf.count * _WORK + _EACH * (geometry.simplex_count(leaf.skeleton) - leaf.count)


def _proved_rising(surface: ir.Surface, blobs: _Blobs, side: NDArray[np.int8]) -> Mask:
    """Those that may be left out where all nodes rise with their elements."""
    out = np.zeros(len(side), dtype=bool)
    for sign in (1.0, -1.0):
        for below in (True, False):
            tried = (side == (-1 if below else 1)) & (np.sign(blobs.weight) == sign)
            if tried.any():
                out |= _proved(surface, blobs, out, tried, below)
    return out


def _proved_smooth(surface: ir.Surface, blobs: _Blobs, side: NDArray[np.int8]) -> Mask:
    """Those that may be left out whatever the nodes do."""
    out = side != 0
    for _ in range(_ROUNDS):
        if not out.any():
            break
        less = kept(surface.field, blobs.masks(surface, out))
        failed = [
            _failing(tree, surface.threshold, blobs, np.flatnonzero(out & (side == (-1 if below else 1))), below)
            for tree in (surface.field, less)
            for below in (True, False)
        ]
        wrong = np.concatenate(failed)
        if not len(wrong):
            return out
        out[wrong] = False
    return np.zeros(len(side), dtype=bool)


def _pairs(blobs: _Blobs) -> float:
    """About how many pairs of blobs overlap."""
    count = len(blobs.weight)
    probes = blobs.samples[np.linspace(0, count - 1, min(count, _PROBES)).astype(np.intp), 0][:, None]
    over = ((blobs.lo <= probes) & (probes <= blobs.hi)).all(axis=2).sum(axis=1)
    return float(over.mean()) * count


def _is_smooth(tree: ir.Field) -> bool:
    """Are there nodes that need not rise with all of their elements?"""
    return isinstance(tree, ir.Node) and (tree.op not in ("sum", "max", "min") or any(map(_is_smooth, tree.children)))


# ---- boxes and samples ---------------------------------------------------------------------------


def _blobs(surface: ir.Surface, count: int) -> _Blobs:
    parts = [
        (number, leaf, *_boxes(leaf, surface.threshold, count)) for number, leaf in enumerate(leaves(surface.field))
    ]
    return _Blobs(
        np.concatenate([np.full(leaf.count, number) for number, leaf, *_ in parts]),
        np.concatenate([np.arange(leaf.count) for _, leaf, *_ in parts]),
        np.concatenate([leaf.weight for _, leaf, *_ in parts]),
        np.concatenate([lo for _, _, lo, *_ in parts]),
        np.concatenate([hi for _, _, _, hi, *_ in parts]),
        np.concatenate([samples for *_, samples, _ in parts]),
        np.concatenate([radius for *_, radius in parts]),
    )


def _cut(leaf: ir.Leaf, threshold: float, count: int) -> Array:
    """Where each density ends. A Gaussian never does: where all tails together are below the rounding of the
    threshold, as in the tracer."""
    if np.isfinite(kernels.support(leaf.kernel)):
        return leaf.reach
    level = _ROUNDING * threshold / count
    return leaf.reach * np.sqrt(np.log(np.maximum(np.abs(leaf.weight) / level, 1.0 + 1e-12)) / leaf.kernel.a)


def _boxes(leaf: ir.Leaf, threshold: float, count: int) -> tuple[Array, Array, Array, Array]:
    """Per blob the box of its density (n, 3) twice, samples (n, 7, 3) in the middle and at the rim, and a radius."""
    corners = geometry.simplices(leaf.skeleton)
    cut = _cut(leaf, threshold, count)
    if not isinstance(leaf.skeleton, ir.Points | ir.Lines):
        corners = corners.reshape(1, -1, 3)
    middle = corners.mean(axis=1) if isinstance(leaf.skeleton, ir.Points | ir.Lines) else corners[:, 0]
    samples = middle[:, None] + _AROUND * cut[:, None, None]
    grow = cut[:, None]
    if leaf.matrix is not None:
        back = np.linalg.inv(leaf.matrix[:, :3])
        corners, samples = (corners - leaf.matrix[:, 3]) @ back.T, (samples - leaf.matrix[:, 3]) @ back.T
        grow = cut[:, None] * np.sqrt(np.sum(back * back, axis=1))
    lo, hi = corners.min(axis=1) - grow, corners.max(axis=1) + grow
    slack = 1e-12 * (np.abs(lo) + np.abs(hi) + grow)
    plain = leaf.matrix is None and isinstance(leaf.skeleton, ir.Points)
    radius = cut * (1.0 + 1e-12) if plain else np.full(leaf.count, np.inf)
    return lo - slack, hi + slack, samples, radius


def _sides(surface: ir.Surface, blobs: _Blobs) -> NDArray[np.int8]:
    """-1, 1: the samples around a blob are all outside, or inside. 0: some of both, so it may matter."""
    side = np.zeros(len(blobs.weight), dtype=np.int8)
    left = np.arange(len(side))
    seen = np.zeros((len(side), 2), dtype=bool)
    for k in range(len(_AROUND)):  # two places tell most blobs apart
        inside = field.field_value(surface.field, blobs.samples[left, k]) >= surface.threshold
        seen[left] |= np.stack([inside, ~inside], axis=1)
        left = left[~seen[left].all(axis=1)]
    side[left] = np.where(seen[left, 0], 1, -1)
    return side


# ---- proofs -----------------------------------------------------------------------------------------


def _proved(surface: ir.Surface, blobs: _Blobs, out: Mask, tried: Mask, below: bool) -> Mask:
    """Of the blobs to be tried, all of one sign, those that may be left out besides `out`."""
    rises = float(blobs.weight[tried][0]) > 0.0
    tree = kept(surface.field, blobs.masks(surface, out if rises == below else out | tried))
    passed = tried.copy()
    passed[_failing(tree, surface.threshold, blobs, np.flatnonzero(tried), below)] = False
    return passed


def _failing(tree: ir.Field, threshold: float, blobs: _Blobs, which: Ints, below: bool) -> Ints:
    """Blobs for which the proof that the tree stays below (above) the threshold does not succeed."""
    lo, hi, owner = blobs.lo[which], blobs.hi[which], which
    failed = np.zeros(0, dtype=np.intp)
    for _ in range(_CUTS + 1):
        felt = geometry.box_gap2(lo, hi, blobs.samples[owner, 0], blobs.samples[owner, 0]) <= blobs.radius[owner] ** 2
        lo, hi, owner = lo[felt], hi[felt], owner[felt]
        least, most = field.bounds(tree, lo, hi)
        margin = _MARGIN * np.maximum(threshold, np.maximum(np.abs(least), np.abs(most)))
        open_ = most >= threshold - margin if below else least <= threshold + margin
        lo, hi, owner = lo[open_], hi[open_], owner[open_]
        failed = np.union1d(failed, owner[_seen_otherwise(tree, threshold, blobs, lo, hi, owner, below)])
        there = ~np.isin(owner, failed)
        lo, hi, owner = lo[there], hi[there], owner[there]
        if not len(owner):
            return failed
        if 8 * len(owner) > _MOST_BOXES:
            break
        lo, hi, owner = _cut_in_eight(lo, hi, owner)
    return np.union1d(failed, owner)


def _seen_otherwise(
    tree: ir.Field, threshold: float, blobs: _Blobs, lo: Array, hi: Array, owner: Ints, below: bool
) -> Mask:
    """Is the middle of a box on the wrong side, and within reach of the blob whose proof this is?"""
    middle = 0.5 * lo + 0.5 * hi
    inside = field.field_value(tree, middle) >= threshold
    near = np.linalg.norm(middle - blobs.samples[owner, 0], axis=1) <= blobs.radius[owner]
    return near & (inside if below else ~inside)


def _cut_in_eight(lo: Array, hi: Array, owner: Ints) -> tuple[Array, Array, Ints]:
    middle = 0.5 * lo + 0.5 * hi
    upper = np.array([[(k >> axis) & 1 for axis in range(3)] for k in range(8)], dtype=bool)
    from_ = np.where(upper[None], middle[:, None], lo[:, None]).reshape(-1, 3)
    to = np.where(upper[None], hi[:, None], middle[:, None]).reshape(-1, 3)
    return from_, to, np.repeat(owner, 8)
