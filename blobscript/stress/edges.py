"""Groups grazing, degenerate and start."""

from __future__ import annotations

import math

from blobscript.stress.cases import Case, fan, ray, tangents

__all__ = ["cases"]

_BALL = "surface { ball(radius = 1) }"


def cases() -> list[Case]:
    return [*_grazing(), *_degenerate(), *_start()]


def _grazing() -> list[Case]:
    far, near = range(2, 9), range(10, 16, 2)
    return [
        Case(
            "easy",
            "grazing",
            "one ball, plain rays: the easy case",
            "What everything else is compared with: a ball of radius 1 and six rays that nothing is special about.",
            _BALL,
            fan((0, 0, 0), 4.0, 0.9, 6),
        ),
        Case(
            "ball",
            "grazing",
            "tangents of a ball",
            "Rays at (1 -+ 10^-k) radii from the centre. Inside, two crossings lie 2 sqrt(2 10^-k) apart; "
            "outside there "
            "is none, and the field along the ray comes as close to the threshold as one likes.",
            _BALL,
            tangents(1.0, far),
        ),
        Case(
            "ball-last-digits",
            "grazing",
            "tangents of a ball in the last digits",
            "Nearer than the rounding of the field either answer is right in double precision; a hang is not.",
            _BALL,
            tangents(1.0, near),
        ),
        Case(
            "cylinder",
            "grazing",
            "tangents of a rod",
            "A line grazes across its side, and along it, where the field is constant along the ray.",
            "surface { line((0, 0, -1), (0, 0, 1)).blob(radius = 0.5) }",
            (
                *(ray(f"across 1e-{k}", (0.5 * (1 - 10.0**-k), -3, 0.2), (0, 1, 0)) for k in far),
                *(ray(f"along 1e-{k}", (0.5 * (1 + 10.0**-k), 0, 3), (0, 0, -1)) for k in (2, 4, 6, 8)),
            ),
        ),
        Case(
            "two-balls",
            "grazing",
            "between two balls that nearly touch",
            "The ray passes through the neck of two balls that almost melt: the field there is a little below the "
            "threshold, and above it a little further on.",
            "surface { ball((-1.3, 0, 0), radius = 1)\n  ball((1.3, 0, 0), radius = 1) }",
            tuple(ray(f"height {h:g}", (0.0, h, 4), (0, 0, -1)) for h in (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5)),
        ),
    ]


def _degenerate() -> list[Case]:
    return [
        Case(
            "lines-of-no-length",
            "degenerate",
            "lines without length",
            "A line from a place to itself is a point, and must be hit like one.",
            "surface { line((0, 0, 0), (0, 0, 0)).blob(radius = 1)\n"
            "  line((2, 0, 0), (2, 0, 1e-200)).blob(radius = 0.5) }",
            (*fan((0, 0, 0), 4.0, 0.9, 4), *fan((2, 0, 0), 4.0, 0.4, 3)),
        ),
        Case(
            "flat-triangles",
            "degenerate",
            "triangles without area",
            "One collapsed to a line, one to a point, one so thin that its normal is noise.",
            "surface { mesh([(-1, 0, 0), (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 1, 0), (0.5, 1.0000000000001, 0)],\n"
            "  faces = [[0, 1, 2], [3, 4, 3], [0, 3, 5]]).blob(radius = 0.3) }",
            fan((0, 0.4, 0), 4.0, 0.8, 7),
        ),
        Case(
            "just-reached",
            "degenerate",
            "a threshold that is just reached",
            "The densities reach the threshold in one point. Whether that is a surface is a matter of the last digit; "
            "that nothing breaks is not.",
            "surface(threshold = 1) { ball(reach = 1, weight = 1) }",
            (ray("through the point", (0, 0, 3), (0, 0, -1)), ray("beside it", (0.1, 0, 3), (0, 0, -1))),
        ),
        Case(
            "along-axes",
            "degenerate",
            "rays along the axes of everything",
            "Components of the direction are 0, and the ray runs within the line that the rod has grown from.",
            "surface { line((-1, 0, 0), (1, 0, 0)).blob(radius = 0.5)\n  ball((0, 0.5, 0), radius = 0.5) }",
            (
                ray("within the line", (-4, 0, 0), (1, 0, 0)),
                ray("down", (0, 4, 0), (0, -1, 0)),
                ray("forward", (0, 0, 4), (0, 0, -1)),
                ray("minus zero", (0.25, 4, 0), (-0.0, -1, 0.0)),
                ray("almost an axis", (0, 4, 0), (1e-300, -1, 1e-200)),
            ),
        ),
        Case(
            "in-the-surface",
            "degenerate",
            "a ray within the surface of a rod",
            "Along it the field is the threshold, for a whole stretch: no search may lose itself in there.",
            "surface(threshold = 0.5625) { line((0, 0, -1), (0, 0, 1)).blob(reach = 1, weight = 1, kernel = soft2) }",
            (ray("just outside", (0.5000001, 0, 4), (0, 0, -1)), ray("just inside", (0.4999999, 0, 4), (0, 0, -1))),
        ),
        Case(
            "repeated",
            "degenerate",
            "the same ball a hundred times",
            "Identical blobs are one of their joint weight.",
            "surface { for (i in 0..<100) { ball(reach = 1, weight = 0.01) }\n  ball((1, 0, 0), radius = 0.5) }",
            fan((0.3, 0, 0), 4.0, 0.9, 5),
        ),
    ]


def _start() -> list[Case]:
    unit = (0.6, 0.0, 0.8)
    root = math.sqrt(0.5)
    return [
        Case(
            "on-the-surface",
            "start",
            "rays that leave from the surface",
            "A shadow ray starts where the last one ended. It must not find that place again, and it must find "
            "everything behind it: no distance to skip is right for all scenes.",
            "surface { ball(radius = 1)\n  ball((0, 0, 4), radius = 1) }",
            (
                ray("out, at the other ball", (0, 0, 1), (0, 0, 1)),
                ray("out, into the open", unit, (0.6, 0.1, 0.8)),
                ray("in", (0, 0, 1), (0.3, 0.1, -1)),
                ray("out at a small angle", (0, 0, 1), (1, 0, 1e-3)),
                ray("in at a small angle", (0, 0, 1), (1, 0, -1e-3)),
            ),
        ),
        Case(
            "inside",
            "start",
            "rays that start inside",
            "They leave: the answer is an exit, whatever the field does on the way.",
            "surface { ball(radius = 1)\n  ball((0.2, 0, 0), reach = 0.3, weight = -9) }",
            (
                ray("from the middle of the hole", (0.2, 0, 0), (1, 0.2, 0)),
                ray("from beside the hole", (-0.5, 0, 0), (1, 0, 0)),
                ray("away from the hole", (-0.5, 0, 0), (-1, 0.1, 0)),
            ),
        ),
        Case(
            "windows",
            "start",
            "windows that open and close at a crossing",
            "The window is (t_min, t_max]: a crossing at t_max counts, one at t_min does not.",
            _BALL,
            (
                ray("closes before", (0, 0, 3), (0, 0, -1), 0.0, 1.9999),
                ray("closes behind", (0, 0, 3), (0, 0, -1), 0.0, 2.0001),
                ray("opens inside", (0, 0, 3), (0, 0, -1), 2.5),
                ray("opens behind all", (0, 0, 3), (0, 0, -1), 4.5),
                ray("opens before the start", (0, 0, -3), (0, 0, -1), -5.0, 0.0),
            ),
        ),
        Case(
            "at-the-rim",
            "start",
            "starts where a density begins",
            "At the reach the field, its slope, and here its bend are 0.",
            "surface { ball(reach = 1, weight = 1, kernel = soft3) }",
            (
                ray("at the rim, inwards", (0, 0, 1), (0, 0, -1)),
                ray("at the rim, along", (0, 0, 1), (1, 0, 0)),
                ray("just within", (root * (1 - 1e-12), 0, root * (1 - 1e-12)), (-1, 0, -1)),
            ),
        ),
        Case(
            "shadow-rays",
            "start",
            "shadow rays that leave at small angles",
            "They start at a place of the surface, as well as doubles know it, and leave it at cosines of 0.1 to 1e-4, "
            "outwards and inwards: no speck of shadow, and no light that leaks through.",
            "surface { ball(radius = 1, kernel = soft2, reach = 2)\n  ball((0, 0, 1.9), radius = 0.5) }",
            tuple(
                ray(f"{word}, cosine {c:g}", (0, 0, -1), (0.6, 0.8, -sign * c))
                for c in (1e-1, 1e-2, 1e-3, 1e-4)
                for sign, word in ((1, "out"), (-1, "in"))
            ),
        ),
    ]
