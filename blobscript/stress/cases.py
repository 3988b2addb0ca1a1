"""What a stress case is: a script, rays, and what it is about."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["GROUPS", "Case", "Ray", "fan", "ray", "tangents"]

Vector = tuple[float, float, float]

#: Group -> what its cases have in common.
GROUPS: dict[str, str] = {
    "stiff": "Densities that rise from nothing to far above the threshold within a hair's breadth. Methods that "
    "stop where the field is small stop far too early; fixed steps jump over the rise.",
    "cancelling": "Large densities of both signs that nearly cancel. Bounds that look at one term at a time see "
    "nothing but the large ones; sums lose digits that the terms still had.",
    "grazing": "Rays that touch a surface, or miss it by very little. A crossing turns into two that lie ever closer "
    "together, and where they meet the answer depends on the last digit.",
    "thin": "Walls, needles and sheets far thinner than any step one would choose. What looks at places along the "
    "ray passes between its looks.",
    "scale": "The same shapes very small, very large, and far from the origin, with rays from far away. Tolerances "
    "and epsilons that are lengths are wrong in all of them.",
    "degenerate": "Shapes that have collapsed: lines without length, triangles without area, a threshold that is just "
    "reached, rays along an axis or within a surface. Divisions by nothing wait here.",
    "start": "Rays that start on a surface, in it, at the very rim of a density, and windows that open or close at "
    "a crossing. Shadows and mirrors are made of these.",
    "joint": "Several parts that meet: creases of a maximum, corners of a polyline, edges of a solid. The slope jumps "
    "there, and Newton's method jumps with it.",
    "bulge": "Where rods meet, their sum bulges and their maximum does not. Both are exact here.",
    "load": "Very much at once: a hundred thousand blobs in one span, trees of many levels, large meshes.",
    "input": "What is no ray and what is no scene: numbers that are none, directions without length, windows that are "
    "empty, scripts that ask for the impossible. Each gets its answer, none a crash.",
}


@dataclass(frozen=True, slots=True)
class Ray:
    """Window (t_min, t_max] of distances along the direction, which may have any length but 0."""

    name: str
    origin: Vector
    direction: Vector
    t_min: float = 0.0
    t_max: float = math.inf


@dataclass(frozen=True, slots=True)
class Case:
    """about: a sentence or two for people. refused: the code of the error that loading gives, "" if it loads;
    warned: that of its warning. manual: ray -> status, for rays that are none."""

    id: str
    group: str
    title: str
    about: str
    script: str
    rays: tuple[Ray, ...] = ()
    refused: str = ""
    warned: str = ""
    manual: tuple[tuple[str, str], ...] = ()

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Origins (n, 3), directions (n, 3), t_min (n,), t_max (n,)."""
        return (
            np.array([r.origin for r in self.rays], np.float64).reshape(-1, 3),
            np.array([r.direction for r in self.rays], np.float64).reshape(-1, 3),
            np.array([r.t_min for r in self.rays], np.float64),
            np.array([r.t_max for r in self.rays], np.float64),
        )


def ray(name: str, origin: Iterable[float], direction: Iterable[float], lo: float = 0.0, hi: float = math.inf) -> Ray:
    """With numbers of any kind."""
    a, b, c = (float(x) for x in origin)
    d, e, f = (float(x) for x in direction)
    return Ray(name, (a, b, c), (d, e, f), lo, hi)


def fan(target: Iterable[float], distance: float, spread: float, count: int = 5) -> tuple[Ray, ...]:
    """Rays from one side towards places around the target, on a spiral of radius `spread`: none of them special."""
    goal = np.array(list(target), np.float64)
    away = np.array([0.36, 0.48, 0.8]) * distance
    rays: list[Ray] = []
    for i in range(count):
        angle, radius = 2.399963 * i, spread * math.sqrt((i + 0.5) / count)
        place = goal + radius * np.array([math.cos(angle), math.sin(angle), 0.1 * math.sin(3 * angle)])
        rays.append(ray(f"fan {i + 1}", goal + away, place - goal - away))
    return tuple(rays)


def tangents(radius: float, exponents: Iterable[int], distance: float = 4.0) -> tuple[Ray, ...]:
    """Rays along z at radius (1 -+ 10^-k) from the z axis."""
    rays: list[Ray] = []
    for k in exponents:
        for sign, word in ((-1.0, "inside"), (1.0, "outside")):
            at = radius * (1.0 + sign * 10.0**-k)
            rays.append(ray(f"1e-{k} {word}", (at * 0.6, at * 0.8, distance), (0, 0, -1)))
    return tuple(rays)
