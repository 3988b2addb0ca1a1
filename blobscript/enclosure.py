"""Branch and bound over boxes: where a surface is, and how high a field can rise.

All answers are proved by the bounds of the field over boxes (`field.bounds`), which are halved
again and again; points only say where no proof can succeed. The work is bounded, so an answer may
be loose, but it is never wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from blobscript import field, geometry, ir

__all__ = ["Box", "blob_count", "highest", "proved_below", "surface_box"]

Array = NDArray[np.float64]
Box = tuple[Array, Array]
Aside = Callable[[Array, Array], NDArray[np.bool_]]

#: Surfaces of more blobs are framed by where their blobs end, which is close enough then.
_MOST_BLOBS = 20_000
#: Likewise those of more segments or triangles, whose boxes are known where they are single blobs.
_MOST_SIMPLICES = 100_000
#: What may be spent on one surface, at 8 for each box and 0.1 for each of its blobs: about 20 ms.
_WORK = 30_000
#: Rounds of halving: twenty for each axis.
_ROUNDS = 60

#: Boxes in a proof, and halvings: enough to tell two balls that barely touch from two that melt.
_MOST_BOXES = 2048
_HALVINGS = 30


# ---- where a surface is --------------------------------------------------------------


def surface_box(surface: ir.Surface, precision: float, effort: float = 1.0) -> Box | None:
    """A box that is proved to hold the inside of a surface; None: it is proved empty.

    The field's extent is halved again and again; boxes where the field stays below the threshold
    are dropped, and so are those within the box around the points that are seen to be inside: they
    cannot make it larger. The sides are too long by at most `precision` of the largest, unless the
    work runs out (`effort` multiplies what is allowed). All of the field's extent where a threshold
    is not positive.
    """
    count = blob_count(surface.field)
    large = any(geometry.simplex_count(leaf.skeleton) > _MOST_SIMPLICES for leaf in ir.leaves(surface.field))
    if (
        large
        and isinstance(surface.field, ir.Leaf)
        and surface.threshold > 0
        and count == 1
        and surface.field.kernel.falls
    ):
        return field.level_extent(surface.field, surface.threshold)
    lo, hi = field.extent(surface.field)
    if surface.threshold <= 0 or large or count > _MOST_BLOBS:
        return lo, hi
    seen = _nothing()
    cost = 8 + 0.1 * count
    budget = _WORK * effort
    lo, hi = _grid(lo, hi, 4)
    for _ in range(_ROUNDS):
        budget -= cost * len(lo)
        keep = field.bounds(surface.field, lo, hi)[1] >= surface.threshold
        lo, hi = lo[keep], hi[keep]
        middle = 0.5 * lo + 0.5 * hi
        inside = middle[field.field_value(surface.field, middle) >= surface.threshold]
        seen = _around(seen, inside, inside)
        within = np.all((lo >= seen[0]) & (hi <= seen[1]), axis=1)
        lo, hi = lo[~within], hi[~within]
        if not len(lo) or budget < 2 * cost * len(lo) or _excess(seen, _around(seen, lo, hi)) <= precision:
            break
        lo, hi = _halved(lo, hi)
    box = _around(seen, lo, hi)
    return box if (box[0] <= box[1]).all() else None


def _nothing() -> Box:
    return np.full(3, np.inf), np.full(3, -np.inf)


def _around(box: Box, lo: Array, hi: Array) -> Box:
    """The box around a box and the boxes from lo to hi."""
    return np.minimum(box[0], lo.min(axis=0, initial=np.inf)), np.maximum(box[1], hi.max(axis=0, initial=-np.inf))


def _excess(inner: Box, outer: Box) -> float:
    """By how much the outer box is longer, as a part of its longest side; inf around nothing."""
    if not (inner[0] <= inner[1]).all():
        return np.inf
    longest = float((outer[1] - outer[0]).max())
    excess = max(float((inner[0] - outer[0]).max()), float((outer[1] - inner[1]).max()))
    return excess / longest if longest else 0.0


def _grid(lo: Array, hi: Array, n: int) -> Box:
    """The n^3 equal parts of a box."""
    steps = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    edges = lo + (hi - lo) * np.arange(n + 1)[:, None] / n
    axes = np.arange(3)
    return edges[steps, axes], edges[steps + 1, axes]


def blob_count(tree: ir.Field) -> int:
    """How many blobs a field has."""
    return tree.count if isinstance(tree, ir.Leaf) else sum(map(blob_count, tree.children))


def _halved(lo: Array, hi: Array) -> Box:
    """Both halves of each box, cut across its longest side."""
    rows, axis = np.arange(len(lo)), np.argmax(hi - lo, axis=1)
    middle = 0.5 * lo[rows, axis] + 0.5 * hi[rows, axis]
    left, right = hi.copy(), lo.copy()
    left[rows, axis] = middle
    right[rows, axis] = middle
    return np.concatenate([lo, right]), np.concatenate([left, hi])


# ---- how high a field is -------------------------------------------------------------


def proved_below(tree: ir.Field, box: Box, level: float, aside: Aside | None = None) -> bool:
    """Is the field below the level everywhere in the box? False also where the budget ends.

    aside: of boxes (n, 3) to (n, 3), which of them do not matter.
    """
    lo, hi = box[0][None], box[1][None]
    budget, cost = 4.0 * _WORK, 8 + 0.1 * blob_count(tree)
    for _ in range(_HALVINGS):
        if aside is not None:
            matters = ~aside(lo, hi)
            lo, hi = lo[matters], hi[matters]
        budget -= cost * len(lo)
        middle = 0.5 * lo + 0.5 * hi
        points = middle if aside is None else middle[~aside(middle, middle)]
        # seeing one point above is cheaper than bounds, and settles it
        if len(lo) > _MOST_BOXES or budget < 0 or (field.field_value(tree, points) >= level).any():
            return False
        keep = field.bounds(tree, lo, hi)[1] >= level
        if not keep.any():
            return True
        lo, hi = _halved(lo[keep], hi[keep])
    return False


def highest(tree: ir.Field, box: Box) -> tuple[float, float]:
    """A proved upper bound of the field over a box, as tight as the budget allows (branch and
    bound), and the highest value seen."""
    lo, hi = box[0][None], box[1][None]
    least, seen = math.inf, -math.inf
    for _ in range(_HALVINGS):
        tops = field.bounds(tree, lo, hi)[1]
        least = min(least, max(float(tops.max()), seen))
        seen = max(seen, float(field.field_value(tree, 0.5 * lo + 0.5 * hi).max()))
        keep = tops > seen
        if least - seen <= 1e-3 * abs(least) or not keep.any() or np.count_nonzero(keep) > _MOST_BOXES:
            break
        lo, hi = _halved(lo[keep], hi[keep])
    return least, seen
