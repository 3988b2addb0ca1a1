"""Why a pixel looks as it does: its ray, what it hits, and the terms that make the field there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from blobscript import field
from blobscript.framing import pixel_rays
from blobscript.plots.elements import Element, Ray, Tree, flat, tree_at
from blobscript.plots.ray import telling_surface
from blobscript.plots.sandwich import densities, window

if TYPE_CHECKING:
    from blobscript.backends.native import Hits
    from blobscript.scene import Scene

__all__ = ["Pixel", "Term", "explain_pixel", "terms_of"]

Array = NDArray[np.float64]

#: The status of a ray in words, by number.
STATUS = ("miss", "enter", "exit", "graze", "invalid")


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """An operation or an element in the tree of the field at one point.

    value: of it at the point. counts: does it take part in the result? The losers of a `max` or `min` do not.
    distance: of an element's skeleton, in reaches (NaN for operations).
    """

    depth: int
    operation: str
    element: Element | None
    value: float
    counts: bool
    distance: float


@dataclass(frozen=True, slots=True, eq=False)
class Pixel:
    """`point` is the hit, or where the ray comes nearest to a surface; None where it feels nothing at all."""

    scene: Scene
    x: int
    y: int
    width: int
    height: int
    ray: Ray
    hits: Hits
    surface: int
    t: float
    point: Array | None
    value: float
    terms: tuple[Term, ...]
    color: tuple[float, float, float] | None  # linear base colour of the surface there
    shown: tuple[float, float, float]  # sRGB of the finished pixel

    @property
    def status(self) -> str:
        return STATUS[int(self.hits.status[0])]

    @property
    def is_hit(self) -> bool:
        return bool(self.hits.hit[0])

    @property
    def threshold(self) -> float:
        return self.scene.surfaces[self.surface].threshold

    @property
    def elements(self) -> list[Term]:
        """The terms that are elements, the largest first."""
        return sorted((t for t in self.terms if t.element is not None), key=lambda t: -abs(t.value))


def explain_pixel(scene: Scene, x: int, y: int, width: int | None = None, height: int | None = None) -> Pixel:
    """Pixel (0, 0) is the top left one. Raises ValueError for one outside the picture."""
    width, height = width or scene.ir.width, height or scene.ir.height
    if not (0 <= x < width and 0 <= y < height):
        raise ValueError(f"there is no pixel {x},{y} in a picture of {width}x{height}")
    origins, directions = pixel_rays(scene.ir, width, height, np.array([float(x)]), np.array([float(y)]))
    ray = Ray(origins[0], directions[0] / np.linalg.norm(directions[0]))
    hits = scene.first_hit(origins, directions)
    surface = telling_surface(scene, ray, int(hits.surface[0]))
    t = float(hits.t[0]) if hits.hit[0] else _nearest(scene, surface, ray)
    point = ray.at(np.array([t]))[0] if np.isfinite(t) else None
    terms = terms_of(scene, surface, point) if point is not None else ()
    value = terms[0].value if terms else 0.0
    color = _base_color(scene, surface, point) if point is not None and hits.hit[0] else None
    shown = _shown_color(scene, x, y, width, height)
    return Pixel(scene, x, y, width, height, ray, hits, surface, t, point, value, terms, color, shown)


def terms_of(scene: Scene, surface: int, point: Array) -> tuple[Term, ...]:
    """The tree of the field at a point (3,), parents first; elements that add nothing there are left out."""
    found: list[Term] = []
    _collect(tree_at(scene.ir, surface, point), point[None], 0, True, found)
    return tuple(found)


def _collect(tree: Tree, at: Array, depth: int, counts: bool, found: list[Term]) -> None:
    value = float(densities(tree, at)[0])
    if isinstance(tree, Element):
        if value != 0.0:
            found.append(Term(depth, "", tree, value, counts, float(np.sqrt(tree.square(at)[0]))))
        return
    operation, children = tree
    found.append(Term(depth, operation, None, value, counts, np.nan))
    won = False
    for child in children:
        if not flat(child):
            continue
        wins = operation not in ("max", "min") or (not won and float(densities(child, at)[0]) == value)
        won = won or wins
        if isinstance(child, tuple) and child[0] == operation == "sum":
            for grandchild in child[1]:
                _collect(grandchild, at, depth + 1, counts, found)
        else:
            _collect(child, at, depth + 1, counts and wins, found)


def _nearest(scene: Scene, surface: int, ray: Ray) -> float:
    """Where, ahead of the ray's start, the field comes nearest to its threshold from outside; inf: nothing is felt."""
    from blobscript.plots.elements import tree_along

    tree = tree_along(scene.ir, surface, ray)
    ends = window(tree, ray)
    if ends is None or ends[1] <= 0.0:
        return np.inf
    lo, hi = max(ends[0], 0.0), ends[1]
    for _ in range(6):
        t = np.linspace(lo, hi, 257)
        best = int(np.argmax(densities(tree, ray.at(t))))
        lo, hi = float(t[max(best - 1, 0)]), float(t[min(best + 1, 256)])
    return 0.5 * (lo + hi)


def _base_color(scene: Scene, surface: int, point: Array) -> tuple[float, float, float]:
    row = field.material(scene.ir.surfaces[surface], point[None], scene.ir)[0]
    r, g, b = row[field.MATERIAL_ROW["color"]]
    return float(r), float(g), float(b)


def _shown_color(scene: Scene, x: int, y: int, width: int, height: int) -> tuple[float, float, float]:
    from blobscript.images import srgb_encode

    image = scene.render(width=width, height=height, region=(x, y, x + 1, y + 1))
    rgba = image.rgba.reshape(-1, 4)[0]
    r, g, b = np.clip(srgb_encode(rgba[:3]), 0.0, 1.0)
    return float(r), float(g), float(b)
