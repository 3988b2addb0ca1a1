"""Group input: what is no ray, and what is no scene."""

from __future__ import annotations

import math

from blobscript.stress.cases import Case, Ray

__all__ = ["cases"]

_REFUSED: list[tuple[str, str, str, str]] = [
    ("reach-0", "a reach of 0", "surface { ball(reach = 0, weight = 1) }", "E0405"),
    ("reach-negative", "a reach below 0", "surface { ball(reach = -1, weight = 1) }", "E0405"),
    ("no-number", "a place that is no number", "surface { ball((0 / 0, 0, 0), radius = 1) }", "E0405"),
    ("infinite", "a threshold without end", "surface(threshold = 1e308 * 10) { ball(radius = 1) }", "E0405"),
    ("flat-kernel", "a Gaussian that does not fall", "surface { ball(radius = 1, kernel = gauss(a = 0)) }", "E0405"),
    (
        "no-such-corner",
        "a mesh with a corner that is not there",
        "surface { mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], faces = [[0, 1, 99]]).blob(radius = 0.1) }",
        "E0403",
    ),
    ("scale-0", "a scale of 0", "surface { ball(radius = 1).scale(x = 0) }", "E0405"),
    ("all-three", "radius, reach and weight together", "surface { ball(radius = 1, reach = 2, weight = 3) }", "E0406"),
    ("too-weak", "a weight that cannot reach the threshold", "surface { ball(radius = 1, weight = 0.1) }", "E0406"),
    (
        "open-solid",
        "a solid with a hole",
        "surface { mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2]], "
        "solid = true).blob(radius = 0.1) }",
        "E0403",
    ),
    (
        "crossed",
        "a polygon that crosses itself",
        "surface { polygon([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0)]).blob(radius = 0.1) }",
        "E0404",
    ),
    ("no-points", "a polyline of nothing", "surface { polyline([]).blob(radius = 0.1) }", "E0404"),
    ("nothing", "no surface at all", "let a = ball(radius = 1)", "E0401"),
    ("forever", "a recursion without end", "fn f(n: int) -> int = f(n + 1)\nsurface { ball(radius = f(0)) }", "E0901"),
]


def cases() -> list[Case]:
    return [_rays(), _directions(), _empty(), _inside_out(), *(_refused(*row) for row in _REFUSED)]


def _refused(name: str, title: str, script: str, code: str) -> Case:
    return Case(name, "input", title, f"Refused with {code} before anything is traced.", script, refused=code)


def _rays() -> Case:
    nan, inf = math.nan, math.inf
    rays = (
        (Ray("origin is no number", (nan, 0, 3), (0, 0, -1)), "invalid"),
        (Ray("direction is no number", (0, 0, 3), (0, nan, -1)), "invalid"),
        (Ray("infinite origin", (0, inf, 3), (0, 0, -1)), "invalid"),
        (Ray("infinite direction", (0, 0, 3), (0, 0, -inf)), "invalid"),
        (Ray("direction without length", (0, 0, 3), (0, 0, 0)), "invalid"),
        (Ray("window opens nowhere", (0, 0, 3), (0, 0, -1), nan), "invalid"),
        (Ray("empty window", (0, 0, 3), (0, 0, -1), 3.0, 3.0), "miss"),
        (Ray("backward window", (0, 0, 3), (0, 0, -1), 3.0, 1.0), "miss"),
        (Ray("tiny direction", (0, 0, 3), (0, 0, -1e-300)), "hit"),
        (Ray("huge direction", (0, 0, 3), (0, 0, -1e300)), "hit"),
    )
    return Case(
        "rays",
        "input",
        "what is no ray",
        "Each of them gets an answer of its own, and none spoils its neighbours in the packet.",
        "surface { ball(radius = 1) }",
        tuple(r for r, _ in rays),
        manual=tuple((r.name, status) for r, status in rays if status != "hit"),
    )


def _directions() -> Case:
    ways = {
        "a denormal component": (5e-324, 0.0, -1.0),
        "a huge length": (0.1e200, 0.2e200, -1e200),
        "a tiny length": (0.1e-200, 0.2e-200, -1e-200),
        "all denormal": (0.0, 0.0, -5e-324),
        "minus zero": (-0.0, -0.0, -1.0),
    }
    return Case(
        "directions",
        "input",
        "directions of any length",
        "The square of a length leaves the range of numbers long before the length does: directions are scaled by "
        "their largest component first.",
        "surface { ball(radius = 1) }",
        tuple(Ray(name, (0, 0, 3), way) for name, way in ways.items()),
    )


def _empty() -> Case:
    return Case(
        "empty",
        "input",
        "a surface without blobs",
        "It is said that nothing is to be seen, and no ray hits anything.",
        "surface { }",
        (Ray("anywhere", (0, 0, 3), (0, 0, -1)),),
        warned="W0401",
    )


def _inside_out() -> Case:
    return Case(
        "inside-out",
        "input",
        "a threshold below 0",
        "All of empty space is inside, which is worth a warning; rays start there and leave it where a negative ball "
        "begins.",
        "surface(threshold = -0.5) { ball(reach = 1, weight = -1) }",
        (Ray("at the ball", (0, 0, 3), (0, 0, -1)), Ray("past it", (2, 0, 3), (0, 0, -1))),
        warned="W0407",
    )
