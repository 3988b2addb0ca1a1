"""Group grazing, roots that meet: touches, pairs closer than any step, surfaces of a single place."""

from __future__ import annotations

import math

from blobscript.stress.cases import Case, ray, tangents

__all__ = ["cases"]

#: (1 - 1/4)^3: soft3 at half its reach, exactly.
_HALF = 27 / 64


def cases() -> list[Case]:
    return [*(_tangents(*row) for row in _KERNELS), *_pairs(), *_touches()]


#: Kernel, where its density is 0.3.
_KERNELS = (
    ("gauss(a = 4)", math.sqrt(math.log(1 / 0.3) / 4)),
    ("soft2", math.sqrt(1 - math.sqrt(0.3))),
    ("metaball", 1 - math.sqrt(0.2)),
)


def _tangents(kernel: str, radius: float) -> Case:
    name = kernel.split("(")[0]
    return Case(
        f"ball-{name}",
        "grazing",
        f"tangents of a ball of the kernel {name}",
        "The slope at the surface, and how the field bends along the ray, differ from kernel to kernel; how close two "
        "crossings come before rounding joins them follows from both.",
        f"surface(threshold = 0.3) {{ ball(reach = 1, weight = 1, kernel = {kernel}) }}",
        tangents(radius, (2, 4, 6, 8)),
    )


def _pairs() -> list[Case]:
    below = math.nextafter(_HALF, 0.0)
    return [
        Case(
            "two-roots-1e-8",
            "grazing",
            "two crossings 1e-8 apart",
            "The threshold is the double below the largest density on the ray: in between the field is above it by one "
            "unit in the last place.",
            f"surface(threshold = {below!r}) {{ ball(reach = 1, weight = 1, kernel = soft3) }}",
            (ray("at the top", (0.5, 0, 2), (0, 0, -1)), ray("a little lower", (0.4999, 0, 2), (0, 0, -1))),
        ),
        Case(
            "two-roots-1e-10",
            "grazing",
            "two crossings 2e-10 apart",
            "A Gaussian with a = 1e4 and a threshold one unit in the last place below its top: all of the surface is "
            "smaller than what a step, or a tolerance of 1e-9, can see.",
            "surface(threshold = 0.9999999999999999) { ball(reach = 1, weight = 1, kernel = gauss(a = 1e4)) }",
            (ray("through the middle", (0, 0, 1), (0, 0, -1)), ray("beside it", (1e-6, 0, 1), (0, 0, -1))),
        ),
    ]


def _touches() -> list[Case]:
    return [
        Case(
            "tangent-exact",
            "grazing",
            "an exact tangent",
            "All numbers are doubles, and the field along the ray reaches the threshold in one place without passing "
            "it: a touch is no crossing. Neither a hit nor a miss is wrong in double precision; an endless loop is.",
            f"surface(threshold = {_HALF!r}) {{ ball(reach = 1, weight = 1, kernel = soft3) }}",
            (ray("from afar", (0.5, 0, 2), (0, 0, -1)), ray("from the tangent's foot", (0.5, 0, 0), (0, 0, -1))),
        ),
        Case(
            "equal-maxima",
            "grazing",
            "two tops that reach the threshold exactly",
            "Two touches one behind the other, and nothing in between.",
            f"surface(threshold = {_HALF!r}) {{ ball((-1.5, 0, 0), reach = 1, weight = 1, kernel = soft3)\n"
            "  ball((1.5, 0, 0), reach = 1, weight = 1, kernel = soft3) }",
            (ray("past both", (-4, 0.5, 0), (1, 0, 0)), ray("a hair lower", (-4, 0.5 - 1e-9, 0), (1, 0, 0))),
        ),
        Case(
            "single-place",
            "grazing",
            "a surface that is a single place",
            "Midway between two balls the densities reach the threshold, everywhere else they stay below: there is no "
            "inside, and no normal.",
            "surface(threshold = 1.125) { ball((-0.5, 0, 0), reach = 1, weight = 1, kernel = soft2)\n"
            "  ball((0.5, 0, 0), reach = 1, weight = 1, kernel = soft2) }",
            (
                ray("along both", (-3, 0, 0), (1, 0, 0)),
                ray("across", (0, 0, 3), (0, 0, -1)),
                ray("beside", (0.1, 0.1, 3), (0, 0, -1)),
            ),
        ),
    ]
