"""Warnings about scenes that would give an empty or puzzling picture (W0401 to W0407).

Every warning is proved by bounds of the field over boxes (`enclosure`), never by samples. Samples
only save work: a point that is seen to be inside shows that nothing needs proving. `check` has
milliseconds, so proofs have a budget; what is not proved within it is not said.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blobscript import field, framing, ir, kernels
from blobscript.arguments import count_text, show
from blobscript.diagnostics import Diagnostic, Edit, Help, Label
from blobscript.enclosure import highest, proved_below
from blobscript.source import Span

__all__ = ["never_placed", "scene_warnings", "without_effect"]

Array = NDArray[np.float64]

#: More blobs than this are not looked at one by one.
_MOST_BLOBS = 2000
#: Blobs that get a proof of their own; each costs about a millisecond.
_MOST_PROOFS = 12
_SAMPLES = 256
_MOST_PAIRS = 2_000_000


def scene_warnings(
    scene: ir.Scene,
    extents: framing.Extents,
    thresholds: Sequence[Span | None],
    unplaced: Sequence[tuple[str, str, Span]] = (),
) -> list[Diagnostic]:
    """All warnings about a scene. `thresholds`: where the threshold of each surface stands."""
    found = never_placed(unplaced)
    for number, surface in enumerate(scene.surfaces):
        look = _look(surface, scene, thresholds[number])
        if surface.threshold <= 0:
            found.append(_not_positive(look))
            continue
        if not look.seen_inside.any() and (empty := _proved_empty(look)):
            found.append(empty)
            continue
        found += _outside_view(look, scene, extents, number)
        found += _idle_blobs(look)
    return found + _camera_inside(scene)


# ---- W0402, W0406 for weights of 0, W0407 --------------------------------------------


def never_placed(unplaced: Sequence[tuple[str, str, Span]]) -> list[Diagnostic]:
    """W0402 for scene values that are defined and never used; a leading `_` says: on purpose."""
    return [
        Diagnostic(
            "W0402",
            f"{kind} `{name}` is defined but not in the scene",
            span,
            "never placed",
            helps=(
                Help(f"to place it, write its name on a line of its own: {name}"),
                Help(f"to keep it aside on purpose, name it _{name}", (Edit(span, f"_{name}"),)),
            ),
        )
        for name, kind, span in unplaced
        if not name.startswith("_")
    ]


def without_effect(origins: Sequence[int], spans: Sequence[Span]) -> list[Diagnostic]:
    """W0406 for terms with weight or factor 0."""
    return [
        Diagnostic(
            "W0406",
            "this has no effect: its weight is 0",
            spans[origin],
            count_text(count, "time") if count > 1 else "adds nothing",
            helps=(Help("give it a weight, or leave it out"),),
        )
        for origin, count in Counter(origins).items()
        if 0 <= origin < len(spans)
    ]


def _not_positive(look: _Look) -> Diagnostic:
    surface = look.surface
    return Diagnostic(
        "W0407",
        f"the threshold of {_called(surface)} is {show(surface.threshold)}: what no blob reaches counts as inside",
        look.threshold_span,
        "not positive",
        helps=(Help("give a threshold above 0, for example threshold = 0.5"),),
    )


# ---- one surface ---------------------------------------------------------------------


def _called(surface: ir.Surface) -> str:
    """`rock`, or surface 2."""
    return surface.name if surface.name.startswith("surface ") else f"`{surface.name}`"


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """A surface, a place on the skeleton of each blob, and which of these are inside."""

    surface: ir.Surface
    scene: ir.Scene
    threshold_span: Span | None
    leaves: tuple[ir.Leaf, ...]
    count: int
    places: Array
    seen_inside: NDArray[np.bool_]

    def span(self, origin: int) -> Span | None:
        spans = self.scene.spans
        return spans[origin] if 0 <= origin < len(spans) else None


def _look(surface: ir.Surface, scene: ir.Scene, threshold_span: Span | None) -> _Look:
    """Of many blobs, only some are looked at."""
    leaves = tuple(ir.leaves(surface.field))
    places = np.concatenate([np.empty((0, 3)), *map(_places, leaves)])
    if len(places) > _MOST_BLOBS:
        some = min(_SAMPLES, max(16, _MOST_PAIRS // len(places)))  # where all overlap, each costs as much as there are
        places = places[np.linspace(0, len(places) - 1, some).astype(np.intp)]
    inside = field.field_value(surface.field, places) >= surface.threshold
    count = sum(leaf.count for leaf in leaves)
    return _Look(surface, scene, threshold_span or surface.span, leaves, count, places, inside)


def _places(leaf: ir.Leaf) -> Array:
    """A point on the skeleton of each blob, in the scene."""
    match leaf.skeleton:
        case ir.Points(at):
            points = at
        case ir.Lines(a, b):
            points = 0.5 * a + 0.5 * b
        case ir.Polygon(at, triangles):
            points = at[triangles[0]].mean(axis=0)[None]
        case ir.Polyhedron(at, triangles) | ir.Mesh(at, triangles):
            points = at[triangles[0]][:1]
        case ir.Polyline(at):
            points = at[:1]
    if leaf.matrix is None:
        return points
    back = np.linalg.inv(leaf.matrix[:, :3])
    return (points - leaf.matrix[:, 3]) @ back.T


# ---- W0401 ---------------------------------------------------------------------------


def _proved_empty(look: _Look) -> Diagnostic | None:
    surface = look.surface
    if not look.leaves:
        return Diagnostic(
            "W0401",
            "this surface is empty: there are no fields in it",
            surface.span,
            "no point has a field above 0",
            helps=(Help("put something into its block, for example ball(radius = 1)"),),
        )
    if look.count > _MOST_BLOBS:
        return None
    box = field.extent(surface.field)
    if not proved_below(surface.field, box, surface.threshold):
        return None
    some = any(_adds(leaf) for leaf in look.leaves)
    top, seen = highest(surface.field, box) if some else (0.0, 0.0)
    exact = top - seen <= 2e-3 * abs(top)
    return Diagnostic(
        "W0401",
        "this surface is empty: its threshold can never be reached",
        look.threshold_span,
        "no point has a field this high",
        _peaks(look, top),
        (_remedy(look, top),),
        (f"the highest field value is {'' if exact else 'below '}{_up(top)} (proved with interval bounds)",),
    )


def _adds(leaf: ir.Leaf) -> bool:
    """Is some blob of it above 0 somewhere? (A kernel that is below 0 somewhere adds there under a negative weight.)"""
    return bool((leaf.weight > 0).any()) or kernels.is_signed(leaf.kernel)


def _remedy(look: _Look, top: float) -> Help:
    if top <= 1e-6 * look.surface.threshold:
        some = any(_adds(leaf) for leaf in look.leaves)
        return Help("weaken or move what takes away" if some else "give it blobs with positive weights")
    return Help(f"lower the threshold below {_up(top)}, raise the weights, or move the blobs together")


def _up(x: float) -> str:
    """Four digits, rounded away from what is proved to what is sure: upward."""
    if x == 0 or not math.isfinite(x):
        return show(x)
    unit = 10.0 ** (math.floor(math.log10(abs(x))) - 3)
    return f"{math.ceil(x / unit - 1e-6) * unit:.4g}"


def _peaks(look: _Look, top: float) -> tuple[Label, ...]:
    """What the first few blobs can reach alone."""
    labels: dict[int, Label] = {}
    highest_alone, all_add = 0.0, True
    for leaf in look.leaves:
        least, peak = kernels.peak(leaf.kernel)
        highest_alone = max(highest_alone, float(leaf.weight.max()) * peak)
        all_add = all_add and bool((leaf.weight > 0).all())
        for origin, weight in zip(leaf.origin.tolist(), leaf.weight.tolist(), strict=True):
            span = look.span(origin)
            if span and origin not in labels and len(labels) < 4:
                alone = weight * (peak if weight > 0 else least if kernels.is_signed(leaf.kernel) else 0.0)
                labels[origin] = Label(span, f"at most {_up(alone)}" if alone > 0 else "only takes away")
    found = list(labels.values())
    if len(found) > 1 and all_add and top < 1.05 * highest_alone:
        found[-1] = replace(found[-1], text=f"{found[-1].text}; they barely overlap")
    return tuple(found)


# ---- W0403, W0404 --------------------------------------------------------------------


def _outside_view(look: _Look, scene: ir.Scene, extents: framing.Extents, number: int) -> list[Diagnostic]:
    """Is every part of the surface on the wrong side of one of the five planes of the camera's view?"""
    camera, aspect = scene.camera, scene.width / scene.height
    if camera.span is None or _in_view(camera, aspect, look.places[look.seen_inside]):
        return []
    if look.count > _MOST_BLOBS:
        return []
    box = extents.box(number)
    if box is None or look.surface.threshold <= 0:
        return []

    def aside(lo: Array, hi: Array) -> NDArray[np.bool_]:
        points = np.stack([np.where(pick, hi, lo) for pick in _CORNERS])
        beyond = _beyond(camera, aspect, points.reshape(-1, 3)).reshape(8, -1, 5)
        return np.any(np.all(beyond, axis=0), axis=-1)

    if not proved_below(look.surface.field, box, look.surface.threshold, aside):
        return []
    centre = 0.5 * box[0] + 0.5 * box[1]
    return [
        Diagnostic(
            "W0403",
            f"{_called(look.surface)} is not in the picture: it lies wholly outside the camera's view",
            look.surface.span,
            f"around {show(_short(centre))}",
            (Label(camera.span, "the camera looks elsewhere"),),
            (Help(f"turn the camera, for example: to = {show(_short(centre))}, or leave it out: then all is in view"),),
        )
    ]


#: Of a box, which of its sides meet at each corner.
_CORNERS = framing.corners((np.zeros(3), np.ones(3))) > 0


def _beyond(camera: ir.Camera, aspect: float, points: Array) -> NDArray[np.bool_]:
    """(n, 5): which points lie behind the camera, or right, left, above, below of its view."""
    right, up, forward = framing.view_axes(camera)
    offsets = points - np.array(camera.at)
    x, y, depth = offsets @ right, offsets @ up, offsets @ forward
    height = math.tan(camera.fov / 2) * depth
    width = aspect * height
    return np.stack([depth <= 0, x > width, -x > width, y > height, -y > height], axis=1)


def _in_view(camera: ir.Camera, aspect: float, points: Array) -> bool:
    return bool(len(points)) and bool((~_beyond(camera, aspect, points).any(axis=1)).any())


def _short(p: Array) -> tuple[float, ...]:
    size = float(np.abs(p).max()) or 1.0
    digits = 2 - math.floor(math.log10(size))
    return tuple(round(float(x), digits) + 0.0 for x in p)


def _camera_inside(scene: ir.Scene) -> list[Diagnostic]:
    at = np.array([scene.camera.at])
    for surface in scene.surfaces:
        if surface.threshold > 0 and field.field_value(surface.field, at)[0] >= surface.threshold:
            labels = (Label(surface.span, "this surface"),) if surface.span else ()
            return [
                Diagnostic(
                    "W0404",
                    f"the camera is inside {_called(surface)}",
                    scene.camera.span,
                    f"{show(scene.camera.at)} is inside",
                    labels if scene.camera.span else (),
                    (Help("move the camera away, or leave it out: then everything is in view"),),
                )
            ]
    return []


# ---- W0405, W0406 --------------------------------------------------------------------


def _idle_blobs(look: _Look) -> list[Diagnostic]:
    """Blobs that show nothing and change nothing; told once for each place in the script."""
    if look.count > _MOST_BLOBS:
        return []
    idle: dict[int, list[tuple[ir.Leaf, int]]] = {}
    proofs = start = 0
    for leaf in look.leaves:
        seen = look.seen_inside[start : start + leaf.count]
        start += leaf.count
        if not _only_helps(look.surface.field, leaf):
            continue
        for i in np.flatnonzero(~seen | (leaf.weight < 0)):
            proofs += 1
            if proofs > _MOST_PROOFS:
                return []
            if _proved_idle(look.surface, leaf, int(i)):
                idle.setdefault(int(leaf.origin[i]), []).append((leaf, int(i)))
    return [_explain_idle(look, origin, blobs) for origin, blobs in idle.items()]


def _only_helps(tree: ir.Field, leaf: ir.Leaf) -> bool:
    """Is the leaf below sums and max alone? (Below min a blob works by what it takes away, below smooth_max, too.)"""
    if isinstance(tree, ir.Leaf):
        return tree is leaf
    return tree.op in ("sum", "max") and any(_only_helps(child, leaf) for child in tree.children)


def _proved_idle(surface: ir.Surface, leaf: ir.Leaf, i: int) -> bool:
    """Within the blob's reach nothing is inside: with it, or, if it only takes away, without it; if it may do
    either, both."""
    box = field.extent(_single(leaf, i))
    either = kernels.is_signed(leaf.kernel)
    with_it = either or leaf.weight[i] > 0
    without_it = either or leaf.weight[i] < 0
    return (not with_it or proved_below(surface.field, box, surface.threshold)) and (
        not without_it or proved_below(_without(surface.field, leaf, i), box, surface.threshold)
    )


def _single(leaf: ir.Leaf, i: int) -> ir.Leaf:
    return _rows(leaf, np.array([i]))


def _rows(leaf: ir.Leaf, rows: NDArray[np.intp]) -> ir.Leaf:
    skeleton = leaf.skeleton
    match skeleton:
        case ir.Points(at):
            skeleton = ir.Points(at[rows])
        case ir.Lines(a, b):
            skeleton = ir.Lines(a[rows], b[rows])
        case _:
            pass
    return replace(
        leaf,
        skeleton=skeleton,
        reach=leaf.reach[rows],
        weight=leaf.weight[rows],
        paint=leaf.paint[rows],
        origin=leaf.origin[rows],
    )


def _without(tree: ir.Field, leaf: ir.Leaf, i: int) -> ir.Field:
    """The tree without one blob."""
    if tree is leaf:
        rest = np.delete(np.arange(leaf.count), i)
        return _rows(leaf, rest) if len(rest) else ir.Node("sum", ())
    if isinstance(tree, ir.Leaf):
        return tree
    return ir.Node(tree.op, tuple(_without(child, leaf, i) for child in tree.children))


def _explain_idle(look: _Look, origin: int, blobs: list[tuple[ir.Leaf, int]]) -> Diagnostic:
    leaf, i = blobs[0]
    weight, threshold = float(leaf.weight[i]), look.surface.threshold
    made_here = sum(int(np.count_nonzero(other.origin == origin)) for other in look.leaves)
    several = f"{len(blobs)} of the {made_here} blobs made here" if made_here > 1 else ""
    span = look.span(origin)
    if weight < 0:
        return Diagnostic(
            "W0406",
            f"{several or 'this negative blob'} takes nothing away: there is no surface within its reach",
            span,
            f"reach {show(leaf.reach[i])}",
            helps=(Help("move it to what it should cut, or give it a larger reach"),),
        )
    if weight < threshold:
        return Diagnostic(
            "W0406",
            f"{several or 'this blob'} adds nothing: the field around it stays below the threshold {show(threshold)}",
            span,
            f"at most {show(weight)} alone",
            helps=(Help("give it more weight, or move it closer to others"),),
        )
    return Diagnostic(
        "W0405",
        f"{several or 'this blob'} cannot be seen: negative weights keep the field below the threshold",
        span,
        "hidden",
        _negative_neighbours(look, leaf, i),
        (Help("make the negative blob smaller or weaker, or move one of the two"),),
    )


def _negative_neighbours(look: _Look, leaf: ir.Leaf, i: int) -> tuple[Label, ...]:
    """The negative blobs whose influence meets that of a blob."""
    lo, hi = field.extent(_single(leaf, i))
    labels: dict[int, Label] = {}
    for other in look.leaves:
        for k in np.flatnonzero(other.weight < 0)[:_MOST_BLOBS]:
            low, high = field.extent(_single(other, int(k)))
            span = look.span(int(other.origin[k]))
            if span and (low < hi).all() and (high > lo).all() and len(labels) < 3:
                labels.setdefault(int(other.origin[k]), Label(span, f"takes away up to {show(-other.weight[k])}"))
    return tuple(labels.values())
