"""Group degenerate, skeletons: ends, slivers, notches, open meshes, solids."""

from __future__ import annotations

from blobscript.stress.cases import Case, ray

__all__ = ["cases"]

_CUBE = (
    "[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],\n"
    "  faces = [[4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]"
)


def cases() -> list[Case]:
    return [_along_a_line(), _end_of_a_line(), _sliver(), _folded(), _notch(), _open_box(), _solid_box()]


def _along_a_line() -> Case:
    return Case(
        "along-a-line",
        "degenerate",
        "rays that run along a rod",
        "Beside the middle of the line the distance does not change along the ray: the slope is 0 on a whole stretch, "
        "inside or outside the rod, and only the caps decide.",
        "surface { line((-1, 0, 0), (1, 0, 0)).blob(reach = 1, weight = 1, kernel = soft3) }",
        (
            *(ray(f"at {y:g}", (-4, y, 0), (1, 0, 0)) for y in (0.0, 0.2, 0.45, 0.46, 0.7, 1.5)),
            ray("out of the middle", (0, 0.3, 0), (1, 0, 0)),
        ),
    )


def _end_of_a_line() -> Case:
    return Case(
        "end-of-a-line",
        "degenerate",
        "rays through the end of a line",
        "The nearest place passes from the end to the side exactly where the ray does, and at once everywhere.",
        "surface { line((0, 0, 0), (1, 0, 0)).blob(reach = 1, weight = 1, kernel = soft3) }",
        (
            ray("down", (0, 3, 0), (0, -1, 0)),
            ray("forward", (0, 0, 3), (0, 0, -1)),
            ray("just beyond", (-1e-17, 0, 3), (0, 0, -1)),
            ray("up from the end", (0, 0, 0), (0, 1, 0)),
        ),
    )


def _sliver() -> Case:
    return Case(
        "sliver",
        "degenerate",
        "a triangle of height 1e-12",
        "Its normal has twelve digits less than its corners, and nothing may depend on it.",
        "surface { polygon([(0, 0, 0), (1, 0, 0), (0.5, 1e-12, 0)]).blob(reach = 1, weight = 1, kernel = soft3) }",
        (
            ray("at its face", (0.5, 0, 3), (0, 0, -1)),
            ray("at its edge", (0.5, -3, 0), (0, 1, 0)),
            ray("at a corner", (-3, 0, 0), (1, 0, 0)),
            ray("askew", (0.9, 2, 2), (-0.2, -1, -1)),
        ),
    )


def _folded() -> Case:
    return Case(
        "fold",
        "degenerate",
        "two triangles folded by 1e-7",
        "Nearly one plane, but not quite: which triangle is nearest changes along a diagonal that hardly anything "
        "tells.",
        "surface { mesh([(0, 0, 0), (1, 0, 0), (1, 1, 1e-7), (0, 1, 0)], faces = [[0, 1, 2], [0, 2, 3]])\n"
        "  .blob(reach = 1, weight = 1, kernel = soft3) }",
        (ray("at the diagonal", (0.5, 0.5, 3), (0, 0, -1)), ray("beside it", (0.7, 0.3, 3), (0, 0, -1))),
    )


def _notch() -> Case:
    return Case(
        "notch",
        "degenerate",
        "a polygon with a notch",
        "The distance to a concave shape has kinks along a ray: between the arms of a U it rises and falls again.",
        "surface { polygon([(0, 0, 0), (3, 0, 0), (3, 2, 0), (2, 2, 0), (2, 1, 0), (1, 1, 0), (1, 2, 0), (0, 2, 0)])\n"
        "  .blob(reach = 0.4, weight = 1, kernel = soft3) }",
        (
            ray("across both arms", (-2, 1.7, 0), (1, 0, 0)),
            ray("from within the notch", (1.5, 1.7, 0), (1, 0, 0)),
            ray("down into it", (1.5, 4, 0), (0, -1, 0)),
            ray("through it", (1.5, 1.6, 2), (0, 0, -1)),
            ray("at the floor", (1.5, 0.5, 2), (0, 0, -1)),
        ),
    )


def _open_box() -> Case:
    return Case(
        "open-box",
        "degenerate",
        "a box without a lid",
        "The distance to a mesh that is not closed is fine; what looks like its inside is not inside.",
        f"surface {{ mesh({_CUBE}])\n  .blob(reach = 0.3, weight = 1, kernel = soft3) }}",
        (
            ray("into the box", (0.5, 0.5, -3), (0, 0, 1)),
            ray("from within", (0.5, 0.5, 0.5), (0, 0, 1)),
            ray("out of it", (0.5, 0.5, 0.5), (0, 0, -1)),
            ray("at a wall", (-3, 0.4, 0.6), (1, 0, 0)),
        ),
    )


def _solid_box() -> Case:
    return Case(
        "solid-box",
        "degenerate",
        "the plateau of a solid",
        "Within a solid the density is its weight, without any slope; rays along a face's plane have it on one side.",
        f"surface {{ mesh({_CUBE}, [0, 3, 2, 1]], solid = true)\n  .blob(reach = 0.5, weight = 1, kernel = soft3) }}",
        (
            ray("at a face", (0.5, 0.5, 3), (0, 0, -1)),
            ray("in a face's plane", (-2, 0.5, 1), (1, 0, 0)),
            ray("out from the middle", (0.5, 0.5, 0.5), (1, 0, 0)),
            ray("along an edge", (-2, 1, 1), (1, 0, 0)),
            ray("past the corner", (-1, 2.3, 0.9), (1, -1, 0)),
            ray("beside", (2, 2, 3), (0, 0, -1)),
        ),
    )
