"""Groups scale, joint, bulge and load."""

from __future__ import annotations

from blobscript.stress.cases import Case, Ray, fan, ray

__all__ = ["cases"]


def cases() -> list[Case]:
    return [*_scale(), *_joint(), *_at_joints(), *_bulge(), *_load()]


def _scaled(rays: tuple[Ray, ...], s: float, shift: float = 0.0) -> tuple[Ray, ...]:
    """The same rays s times as large, moved along x."""
    moved: list[Ray] = []
    for r in rays:
        x, y, z = (v * s for v in r.origin)
        moved.append(Ray(r.name, (x + shift, y, z), r.direction, r.t_min * s, r.t_max * s))
    return tuple(moved)


def _scale() -> list[Case]:
    made: list[Case] = []
    for power in (-38, -12, 12, 38):
        s = 10.0**power
        made.append(
            Case(
                f"size-1e{power}",
                "scale",
                f"a scene of size 1e{power}",
                "Squares and cubes of its lengths lose all meaning as absolute tolerances. It is the plain scene seen "
                "through another unit.",
                f"surface "
                f"{{ ball(radius = {s!r})\n  line(({s!r}, 0, 0), ({2 * s!r}, {s!r}, 0)).blob(radius = {0.3 * s!r}) }}",
                _scaled(fan((0.4, 0.2, 0), 4.0, 0.9, 6), s),
            )
        )
    for power in (-150, 150):
        made.append(
            Case(
                f"size-1e{power}",
                "scale",
                f"a scene of size 1e{power}",
                "Squares of its lengths leave the range of numbers. That is said, with the place, instead of "
                "tracing it.",
                f"surface {{ ball(radius = 1e{power}) }}",
                refused="E0405",
            )
        )
    for power in (3, 6, 9):
        shift = 10.0**power
        made.append(
            Case(
                f"far-1e{power}",
                "scale",
                f"a scene 1e{power} from the origin",
                "Places have lost digits before anything is computed; nothing more may be lost.",
                f"surface {{ ball(({shift!r}, 0, 0), radius = 1)\n  ball(({shift + 1!r}, 0.5, 0), radius = 0.5) }}",
                _scaled(fan((0.3, 0, 0), 4.0, 0.9, 5), 1.0, shift),
            )
        )
    for power in (4, 8, 12):
        made.append(
            Case(
                f"camera-1e{power}",
                "scale",
                f"seen from 1e{power} away",
                "The squared distance to the camera swamps the squared radius; the closest approach does not.",
                "surface { ball(radius = 1) }",
                (
                    ray("through the middle", (0, 0, 10.0**power), (0, 0, -1)),
                    ray("off the middle", (0.5, 0.25, 10.0**power), (0, 0, -1)),
                    ray("beside", (2.0, 0, 10.0**power), (0, 0, -1)),
                ),
            )
        )
    made.append(
        Case(
            "dust-by-a-planet",
            "scale",
            "a grain beside a planet",
            "Radii of 1e-6 and 1e6 in one scene.",
            "surface { ball((0, -1e6, 0), radius = 1e6) }\nsurface { ball((0, 2e-6, 0), radius = 1e-6) }",
            (
                ray("the grain", (0, 2.2e-6, 1), (0, 0, -1)),
                ray("between the two", (0, 0.5e-6, 1), (0, 0, -1)),
                ray("the planet", (0.1, 3, 0), (0, -1, 0)),
            ),
        )
    )
    return made


def _joint() -> list[Case]:
    return [
        Case(
            "crease",
            "joint",
            "across the crease of a maximum",
            "Where the larger of two densities changes, the field has a kink. The first hit may lie right on it.",
            "surface { max { ball((-0.6, 0, 0), radius = 1)\n  ball((0.6, 0, 0), radius = 1) } }",
            (
                ray("at the crease", (0, 0, 4), (0, 0, -1)),
                ray("a hair beside", (1e-9, 0, 4), (0, 0, -1)),
                ray("along the crease plane", (0, 4, 0.2), (0, -1, 0)),
                *fan((0, 0, 0), 4.0, 1.2, 4),
            ),
        ),
        Case(
            "corner",
            "joint",
            "the corner of a polyline",
            "Three lines of one polyline meet at sharp angles; inside the bend the nearest one changes along the ray.",
            "surface { polyline([(-1, 0, 0), (0, 1, 0), (0.1, 0, 0), (1, 1, 0.5)]).blob(radius = 0.2) }",
            fan((0, 0.5, 0), 4.0, 1.0, 8),
        ),
        Case(
            "solid",
            "joint",
            "faces, edges and corners of a solid",
            "A cube with a soft skin: flat over its faces, round over edges and corners, constant inside.",
            "surface { polyhedron([(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), "
            "(1, 1, 1),\n"
            "  (-1, 1, 1)], faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, "
            "0, 4, 7]])\n"
            "  .blob(radius = 0.25) }",
            (
                ray("a face", (0.2, 0.1, 4), (0, 0, -1)),
                ray("an edge", (1.1, 0.1, 4), (0, 0, -1)),
                ray("at an edge, askew", (3, 0.1, 3), (-1, 0, -1)),
                ray("a corner", (3, 3, 3), (-1, -1, -1)),
                ray("past a corner", (1.2, 1.2, 4), (0, 0, -1)),
            ),
        ),
        Case(
            "max-of-sums",
            "joint",
            "a maximum of sums of minima",
            "Four levels of sum, max and min, with weights of both signs.",
            "let a = ball((-0.5, 0, 0), radius = 0.8)\nlet b = ball((0.5, 0, 0), radius = 0.8)\n"
            "let c = line((0, -1, 0), (0, 1, 0)).blob(radius = 0.4)\n"
            "surface { max { min { a\n  c }\n  sum { b\n  max { c\n  a }\n  -0.7 * ball((0.5, 0.3, 0.5), radius "
            "= 0.4) } } }",
            fan((0, 0, 0), 4.0, 1.1, 8),
        ),
    ]


def _at_joints() -> list[Case]:
    return [
        Case(
            "joint-of-a-kernel",
            "joint",
            "a surface where two pieces of a kernel meet",
            "The kernel metaball is 2/3 where its two formulas meet: right there its bend jumps from -6 to 3, and "
            "whatever extrapolates from one side is wrong on the other.",
            "surface(threshold = 2 / 3) { ball(reach = 1, weight = 1, kernel = metaball) }",
            (
                ray("through the middle", (0, 0, 3), (0, 0, -1)),
                ray("off the middle", (0.3, 0.1, 3), (0, 0, -1)),
                ray("out from the middle", (0, 0, 0), (0.6, 0, 0.8)),
            ),
        ),
    ]


def _bulge() -> list[Case]:
    rods = (
        "let rods = [for (i in 0..<3) line((0, 0, 0), 1.5 * (sin(1turn * i / 3), cos(1turn * i / 3), 0))"
        ".blob(radius = 0.3)]\n"
    )
    rays = (
        ray("at the middle", (0, 0, 4), (0, 0, -1)),
        ray("beside the middle", (0.05, 0.02, 4), (0, 0, -1)),
        ray("at a rod", (0, 1, 4), (0, 0, -1)),
        *fan((0, 0, 0), 4.0, 0.8, 4),
    )
    return [
        Case(
            "sum",
            "bulge",
            "three rods, summed",
            "The middle bulges: three densities add.",
            f"{rods}surface(sum(rods))",
            rays,
        ),
        Case(
            "max",
            "bulge",
            "three rods, the largest of them",
            "No bulge, but a crease: the slope jumps.",
            f"{rods}surface(max(rods))",
            rays,
        ),
    ]


def _load() -> list[Case]:
    return [
        Case(
            "hundred-thousand",
            "load",
            "a hundred thousand blobs in one span",
            "All of them overlap everywhere: no index and no cull can leave one out. Sums must neither be slow "
            "nor lose "
            "their digits.",
            "surface { balls([for (i in 0..<100000) (i / 1e9, 0, 0)], reach = 1, weight = 2e-5) }",
            (ray("across", (0, 0.1, 3), (0, 0, -1)),),
        ),
        Case(
            "deep-tree",
            "load",
            "forty levels of max and min",
            "Each level adds a ball; the value climbs through all of them.",
            "fn nest(n: int) -> field = if (n == 0) ball((0.2, 0, 0), radius = 0.8) else max([\n"
            "  min([nest(n - 1), ball((0, 0, n / 50), radius = 1.2)]), ball((n / 20 - 1, 1, 0), radius = 0.1)])\n"
            "surface(nest(20))",
            fan((0, 0, 0), 4.0, 0.8, 4),
        ),
        Case(
            "thousand-lines",
            "load",
            "a thousand lines",
            "A ball of wool: two dozen lines near every ray, and most of the work is to find them.",
            "surface { for (i in 0..<1000) { line(1.5 * (rand(i, seed = 1) - 0.5, rand(i, seed = 2) - 0.5, "
            "rand(i, seed = 3)"
            " - 0.5),\n  1.5 * (rand(i, seed = 4) - 0.5, rand(i, seed = 5) - 0.5, rand(i, seed = 6) - 0.5))"
            ".blob(radius = 0.01) } }",
            fan((0, 0, 0), 4.0, 0.6, 4),
        ),
        Case(
            "thousand-balls",
            "load",
            "a thousand balls, some of which take away",
            "A cloud of all sizes; one ball in ten is negative. Rays cross dozens of spans before the first hit.",
            "surface(threshold = 0.6) { for (i in 0..<1000) {\n"
            "  ball(10 * (rand(i, seed = 1) - 0.5, rand(i, seed = 2) - 0.5, rand(i, seed = 3) - 0.5),\n"
            "    reach = 0.4 + rand(i, seed = 4), weight = if (rand(i, seed = 5) < 0.1) -1.5 else 1, "
            "kernel = soft3) } }",
            fan((0, 0, 0), 9.0, 4.0, 8),
        ),
    ]
