"""Groups stiff, cancelling and thin."""

from __future__ import annotations

import math

from blobscript.stress.cases import Case, fan, ray

__all__ = ["cases"]


def cases() -> list[Case]:
    return [*_stiff(), *_cancelling(), *_thin()]


def _stiff() -> list[Case]:
    made: list[Case] = []
    for a, weight in ((4e2, 1.0), (1e4, 1e6), (1e8, 1e12)):
        # radius where w e^(-a r^2) = 0.5
        radius = math.sqrt(math.log(weight / 0.5) / a)
        made.append(
            Case(
                f"gauss-{a:.0e}".replace("+0", ""),
                "stiff",
                f"a Gaussian with a = {a:g}",
                f"The density is {weight:g} in the middle and falls to the threshold within {radius:.2g} scene "
                f"units. The "
                "logarithm of the field is as tame as ever; the field itself is not.",
                f"surface {{ point(0, 0, 0).blob(reach = 1, weight = {weight:g}, kernel = gauss(a = {a:g})) }}",
                fan((0, 0, 0), 3.0, 1.4 * radius, 6),
            )
        )
    for power in (6, 12, 15):
        made.append(
            Case(
                f"weight-1e{power}",
                "stiff",
                f"a weight of 1e{power}",
                "The surface lies at the very rim of the density, where both the field and its slope are almost "
                "nothing "
                "while they are huge a little further in.",
                f"surface {{ ball(reach = 1, weight = 1e{power}, kernel = soft3) }}",
                fan((0, 0, 0), 3.0, 1.1, 6),
            )
        )
    made.append(
        Case(
            "many-scales",
            "stiff",
            "five scales in one sum",
            "Five balls, each a thousand times smaller than the last, sit on each other's skins. One step size fits "
            "one of them.",
            "surface { for (i in 0..4) { ball((1 - 1000 ^ -i, 0, 0), reach = 1000 ^ -i, weight = 3) } }",
            (
                *fan((0, 0, 0), 4.0, 0.9, 3),
                *(ray(f"at scale 1e-{3 * i}", (1 - 1000.0**-i, 0.2 * 1000.0**-i, 3), (0, 0, -1)) for i in range(5)),
            ),
        )
    )
    made.append(
        Case(
            "steep-kernel",
            "stiff",
            "a kernel of the script that is nearly a step",
            "(1 - r^2)^24 is a polynomial of degree 48 that drops to the threshold at a sixth of its reach.",
            "kernel sharp(r) = (1 - r^2)^24\nsurface { point(0, 0, 0).blob(reach = 1, weight = 1, kernel = sharp) }",
            fan((0, 0, 0), 3.0, 0.2, 6),
        )
    )
    made.append(
        Case(
            "forty-decades",
            "stiff",
            "a field over forty powers of ten",
            "Two Gaussians of weight 1e39 and a = 1e4, side by side: along a ray the field rises from nothing to 1e39 "
            "within a tenth. Secants stall on it; halving and logarithms do not.",
            "surface { point(-0.11, 0, 0).blob(reach = 1, weight = 1e39, kernel = gauss(a = 1e4))\n"
            "  point(0.11, 0.02, 0).blob(reach = 1, weight = 1e39, kernel = gauss(a = 1e4)) }",
            (*fan((0, 0, 0), 3.0, 0.18, 5), ray("between them", (0, -1, 0.02), (0, 1, 0))),
        )
    )
    return made


def _cancelling() -> list[Case]:
    made = [
        Case(
            "same-place",
            "cancelling",
            "+1e8 and -(1e8 - 1) at one place",
            "Together they are an ordinary ball of weight 1. Bounds that take the two apart cannot see it before the "
            "interval is as short as 1e-8; folded while the scene is loaded they are never apart.",
            "surface { ball(reach = 1, weight = 1e8)\n  ball(reach = 1, weight = -(1e8 - 1)) }",
            fan((0, 0, 0), 3.0, 0.8, 6),
        ),
        Case(
            "three-reaches",
            "cancelling",
            "large weights with slightly different reaches",
            "1e6 and -1e6 with reaches that differ by a millionth leave a ring around the rim.",
            "surface(threshold = 0.2) { ball(reach = 1, weight = 1e6)\n  ball(reach = 0.999999, weight = -1e6) }",
            fan((0, 0, 0), 3.0, 0.9, 6),
        ),
    ]
    for power, gap in ((6, "1e-6"), (10, "1e-10")):
        made.append(
            Case(
                f"dipole-1e{power}",
                "cancelling",
                f"a dipole of 1e{power} across {gap}",
                "Two huge densities of opposite sign almost at one place leave the derivative of a ball: a lobe on one "
                "side, a hole on the other.",
                f"surface(threshold = 0.25) {{ ball(reach = 1, weight = 1e{power})\n"
                f"  ball(({gap}, 0, 0), reach = 1, weight = -1e{power}) }}",
                (*fan((-0.4, 0, 0), 3.0, 0.5, 4), ray("along the axis", (-3, 0.01, 0), (1, 0, 0))),
            )
        )
    made.append(
        Case(
            "checkerboard",
            "cancelling",
            "a lattice of alternating signs",
            "Sixty-four balls of weights +-40, each overlapping dozens of others: the field is what is left over.",
            "surface(threshold = 0.3) { for (i in 0..3) { for (j in 0..3) { for (k in 0..3) {\n"
            "  ball((i, j, k) / 3, reach = 0.9, weight = 40 * (-1) ^ (i + j + k))\n} } } }",
            fan((0.5, 0.5, 0.5), 4.0, 0.9, 8),
        )
    )
    made.append(
        Case(
            "hole-in-1e15",
            "cancelling",
            "a hole in a weight of 1e15",
            "The hole of weight -1e15 reaches a little less far than the ball it is in; what is left has lost "
            "all but the "
            "last digit in the middle, and none at the rim.",
            "surface { ball(reach = 1, weight = 1e15)\n  ball((0.5, 0, 0), reach = 0.6, weight = -1e15) }",
            fan((0.3, 0, 0), 3.0, 0.9, 6),
        )
    )
    made += [
        Case(
            "thousand-at-one-place",
            "cancelling",
            "a thousand balls of weight 0.001 at one place",
            "A thousand events at the same distance, and a sum of numbers that are no doubles.",
            "surface { for (i in 0..<1000) { ball(reach = 1, weight = 0.001) } }",
            fan((0, 0, 0), 3.0, 0.6, 3),
        ),
        Case(
            "below-the-top",
            "cancelling",
            "a threshold 1e-9 below the top",
            "The surface is a ball of radius 2e-5 within a reach of 1: threshold and density cancel nine digits.",
            "surface(threshold = 1 - 1e-9) { ball(reach = 1, weight = 1, kernel = soft3) }",
            (ray("through it", (1e-6, 2e-6, 2), (0, 0, -1)), *fan((0, 0, 0), 2.0, 3e-5, 4)),
        ),
        Case(
            "above-the-top",
            "cancelling",
            "a threshold 1e-9 above the top",
            "No place reaches it: the surface is empty, which is said while the script is checked, and no ray hits.",
            "surface(threshold = 1 + 1e-9) { ball(reach = 1, weight = 1, kernel = soft3) }",
            (ray("through the middle", (0, 0, 2), (0, 0, -1)), ray("from the middle", (0, 0, 0), (1, 0, 0))),
            warned="W0401",
        ),
    ]
    return made


def _thin() -> list[Case]:
    made: list[Case] = []
    for k in (3, 6, 9):
        # a shell: a ball minus a slightly smaller one; threshold far below the weights' difference
        made.append(
            Case(
                f"shell-1e-{k}",
                "thin",
                f"a hollow ball with a wall of about 1e-{k}",
                "A ball from which a slightly smaller one takes everything away but the skin. Half of the rays that a "
                "picture sends at it would pass through if the wall were sampled.",
                f"surface {{ max {{ ball(radius = 1, reach = 1.5)\n  ball((4, 0, 0), radius = 0.1) }}\n"
                f"  ball(reach = {1.0 - 10.0**-k!r}, weight = -1e6, kernel = soft2) }}",
                fan((0, 0, 0), 3.0, 0.95, 6),
            )
        )
    for k in (2, 4, 7):
        made.append(
            Case(
                f"needle-1e-{k}",
                "thin",
                f"a needle of radius 1e-{k}",
                "A line that is long and all but invisible. Rays that come near enough must see it.",
                f"surface {{ line((-1, 0, 0), (1, 0, 0)).blob(radius = 1e-{k}) }}",
                (
                    ray("across, through", (0.3, 2, 1e-1 * 10.0**-k), (0, -1, 0)),
                    ray("across, beside", (0.3, 2, 1.5 * 10.0**-k), (0, -1, 0)),
                    ray("askew", (0.4, 1.0, 2.0), (-0.2, -1.0, -2.0)),
                    ray("along", (-3, 0.2 * 10.0**-k, 0), (1, 0, 0)),
                ),
            )
        )
    made.append(
        Case(
            "sheet",
            "thin",
            "a sheet of paper seen from its edge",
            "A triangle with a skin of 1e-5: a wall from the front, a line from the side.",
            "surface { polygon([(-1, -1, 0), (1, -1, 0), (0, 1, 0)]).blob(radius = 1e-5) }",
            (
                ray("from the front", (0.1, 0.1, 2), (0, 0, -1)),
                ray("from the edge", (0.1, -3, 0), (0, 1, 0)),
                ray("past the edge", (0.1, -3, 1.1e-5), (0, 1, 0)),
                ray("at a small angle", (-3, 0.0, 0.003), (1, 0, -0.001)),
            ),
        )
    )
    made.append(
        Case(
            "pinhole",
            "thin",
            "a ball with a hole of a thousandth",
            "A needle of weight -1e7 drills through it: the ray in the hole sees the light behind, its neighbours do "
            "not.",
            "surface { ball(reach = 1, weight = 1, kernel = soft3)\n"
            "  line((-2, 0, 0), (2, 0, 0)).blob(reach = 1e-3, weight = -1e7, kernel = soft3) }",
            (
                ray("through the hole", (-3, 0, 0), (1, 0, 0)),
                ray("askew through the hole", (-3, 2e-4, 0), (1, -1e-4, 0)),
                ray("beside the hole", (-3, 1.1e-3, 0), (1, 0, 0)),
                ray("across the hole", (0.1, 0, 3), (0, 0, -1)),
            ),
        )
    )
    return made
