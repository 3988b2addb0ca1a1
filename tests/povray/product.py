"""Kernel x skeleton x node x transformation x sign of weight: small scenes for POV-Ray and for blobscript.

A number names a case, and the same number makes the same one. What differs is judged by the certified reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from random_scenes import (
    BUILT_IN,
    SKELETONS,
    USER,
    make_leaf,
    make_scene,
    random_matrix,
    random_rays,
    random_skeleton,
    rotation,
)

from blobscript import Scene, field, ir
from blobscript.certified import UndecidedError, certain_hit
from blobscript.povray import document
from blobscript.povray.program import workshop
from blobscript.povray.readback import answers

__all__ = ["PRODUCT", "Found", "compared"]

NODES = ("alone", "sum", "max", "min", "smooth_max", "smooth_min", "max in a sum")
TRANSFORMS = ("as it is", "turned", "squeezed")

#: (kernel, skeleton, node, transformation, sign). A smooth minimum of positive densities is 0: nothing to see.
PRODUCT = [
    row
    for row in product(BUILT_IN + USER, SKELETONS, NODES, TRANSFORMS, (1.0, -1.0))
    if row[2] != "smooth_min" or row[4] < 0
]


@dataclass(frozen=True)
class Found:
    """Of a number of cases: rays, those that hit, and lines that say where POV-Ray and where blobscript is off."""

    rays: int
    hits: int
    theirs: list[str]
    ours: list[str]


def surface_of(number: int) -> tuple[ir.Field, float]:
    """The field and its threshold."""
    kernel, kind, node, transform, sign = PRODUCT[number]
    rng = np.random.default_rng([11, number])
    matrix = {"as it is": None, "turned": _turned(rng), "squeezed": random_matrix(rng)}[transform]
    part = make_leaf(random_skeleton(rng, kind), kernel, rng.uniform(0.5, 1.0), sign, None, matrix)
    points = ir.Points(rng.uniform(-0.7, 0.7, (3, 3)))
    few = make_leaf(points, kernel, rng.uniform(0.6, 1.0, 3), rng.uniform(0.6, 1.2, 3))
    match node:
        case "alone":
            return part, 0.4 * sign
        case "min" if sign < 0:
            return ir.Node("min", (few, part)), -0.3
        case "smooth_min":
            hollow = make_leaf(ir.Points(np.zeros((1, 3))), kernel, 0.8, -0.5)
            return ir.Node("sum", (few, ir.Node("smooth_min", (part, hollow)))), 0.3
        case "max in a sum":
            ball = make_leaf(ir.Points(np.zeros((1, 3))), kernel, 0.8, 0.6)
            return ir.Node("sum", (ball, ir.Node("max", (few, part)))), 0.5
        case _:
            return ir.Node(node, (few, part)), 0.4


def _turned(rng: np.random.Generator) -> np.ndarray:
    return np.ascontiguousarray(np.column_stack([rotation(rng), rng.uniform(-0.3, 0.3, 3)]))


def compared(numbers: list[int], rays: int) -> Found:
    """All in one run of POV-Ray. Off is more than 1e-6 of a case's size, or another answer to hit or miss."""
    scenes = [make_scene(surface_of(number)) for number in numbers]
    made = document(make_scene(*map(surface_of, numbers)))
    asked = [_outside(scene, number, rays) for scene, number in zip(scenes, numbers, strict=True)]
    ours = [Scene(scene).first_hit(*ray) for scene, ray in zip(scenes, asked, strict=True)]
    which = np.repeat(np.arange(len(numbers)), [len(o) for o, _ in asked])
    with workshop() as shop:
        found = answers(shop, made, *(np.concatenate([ray[k] for ray in asked]) for k in (0, 1)), 600.0, which)
    theirs_off: list[str] = []
    ours_off: list[str] = []
    for row, (number, scene) in enumerate(zip(numbers, scenes, strict=True)):
        lo, hi = field.extent(scene.surfaces[0].field)
        size, mine, hits = float(np.linalg.norm(hi - lo)), which == row, ours[row]
        t, hit = found.t[mine], found.hit[mine]
        with np.errstate(invalid="ignore"):
            differ = (hits.hit != hit) | (hits.hit & hit & ~(np.abs(hits.t - t) <= 1e-6 * size))
        for i in np.flatnonzero(differ).tolist():
            exact = _exact(scene, asked[row][0][i], asked[row][1][i])
            text = f"{number} {_name(number)}: ray {i}, ours {hits.t[i]!r}, POV-Ray's {t[i]!r}, exactly {exact!r}"
            right = exact is None or hits.t[i] == exact or abs(hits.t[i] - exact) <= 1e-9 * size
            (theirs_off if right else ours_off).append(text)
    return Found(len(which), int(sum(o.hit.sum() for o in ours)), theirs_off, ours_off)


def _outside(scene: ir.Scene, number: int, rays: int) -> tuple[np.ndarray, np.ndarray]:
    """Seen from within, the union of a skin's parts shows what is behind them."""
    origins, directions = random_rays(np.random.default_rng([3, number]), scene, rays)
    surface = scene.surfaces[0]
    outside = (field.field_value(surface.field, origins) >= surface.threshold) == (surface.threshold <= 0)
    return origins[outside], directions[outside]


def _exact(scene: ir.Scene, origin: np.ndarray, direction: np.ndarray) -> float | None:
    try:
        answer = certain_hit(scene, origin, direction / np.linalg.norm(direction))
    except UndecidedError:
        return None
    return answer.distance if answer.status == "hit" else np.inf


def _name(number: int) -> str:
    kernel, kind, node, transform, sign = PRODUCT[number]
    return f"{kernel.name}{kernel.a or ''}, {kind}, {node}, {transform}, {sign:+g}"
