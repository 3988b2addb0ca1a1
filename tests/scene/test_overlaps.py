"""Solids that pass through themselves are refused by the faces that cross; surfaces may do that, and be degenerate."""

from __future__ import annotations

import numpy as np
import pytest
from random_scenes import OCTAHEDRON, prism, sphere

import blobscript
from blobscript.overlaps import first_overlap

TETRAHEDRON = "[(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)"
FACES = "[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]"
BOTH = f"{TETRAHEDRON}, (0.2, 0.2, 0.2), (1.2, 0.2, 0.2), (0.2, 1.2, 0.2), (0.2, 0.2, 1.2)]"
TWICE = f"faces = [{FACES}, [4, 6, 5], [4, 5, 7], [4, 7, 6], [5, 6, 7]]"


def message(script: str) -> str:
    with pytest.raises(blobscript.ProgramError) as caught:
        blobscript.compile(script)
    (found,) = caught.value.diagnostics
    assert found.code == "E0403"
    return found.message


@pytest.mark.parametrize("maker", ["polyhedron({}, {})", "mesh({}, {}, solid = true)"])
def test_a_solid_that_crosses_itself_names_two_faces(maker: str):
    text = message(f"surface {{ {maker.format(BOTH, TWICE)}.blob(radius = 0.1) }}")
    assert "pass through itself" in text
    assert "(1, 0, 0), (0, 1, 0), (0, 0, 1)" in text


def test_a_surface_may_cross_itself():
    scene = blobscript.compile(f"surface {{ mesh({BOTH}, {TWICE}).blob(radius = 0.05) }}")
    hits = scene.first_hit([[0.3, 0.3, 5.0]], [[0.0, 0.0, -1.0]])
    # the outer tetrahedron's slanted face x + y + z = 1.6, thicker by 0.05
    assert hits.t[0] == pytest.approx(5.0 - (1.6 - 0.6 + 0.05 * np.sqrt(3.0)), abs=1e-12)


def ball(shift: float) -> tuple[np.ndarray, np.ndarray]:
    points, faces = sphere(2)
    return points + shift, faces


def both(a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([a[0], b[0]]), np.concatenate([a[1], b[1] + len(a[0])])


def test_what_only_touches_does_not_cross():
    outline = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    box = prism(outline, [[0, 1, 2], [0, 2, 3]], 0.5)
    for shift in ((1.0, 0.0, 0.0), (0.5, 1.0, 0.0), (1.0, 1.0, 1.0)):  # a side, part of one, a corner
        assert first_overlap(*both(box, (box[0] + np.array(shift), box[1]))) is None
    assert first_overlap(*both(box, (box[0] + np.array([0.5, 0.3, 0.2]), box[1]))) is not None
    assert first_overlap(*OCTAHEDRON) is None


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_at_any_size(size: float):
    for shift, crosses in ((0.3, True), (2.5, False)):
        points, faces = both(ball(0.0), ball(shift))
        assert (first_overlap(points * size, faces) is not None) == crosses


DEGENERATE = {
    "line of no length": "line((0, 0, 0), (0, 0, 0))",
    "repeated points": "polyline([(0, 0, 0), (0, 0, 0), (0, 0, 0)])",
    "flat triangle": "mesh([(-1, 0, 0), (0, 0, 0), (1, 0, 0)], faces = [[0, 1, 2]])",
    "point of a triangle": "mesh([(0, 0, 0)], faces = [[0, 0, 0]])",
    "sliver": "mesh([(-1, 0, 0), (1, 0, 0), (0, 1e-12, 0)], faces = [[0, 1, 2]])",
    "three faces at an edge": "mesh([(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 0, -1), (0, -1, -1)], "
    "faces = [[0, 1, 2], [0, 1, 3], [0, 1, 4]])",
}


@pytest.mark.parametrize("skeleton", DEGENERATE.values(), ids=DEGENERATE)
def test_degenerate_skeletons_have_a_distance(skeleton: str):
    """All of them pass through the origin and lie below it: the ray from above ends at the radius."""
    scene = blobscript.compile(f"surface {{ {skeleton}.blob(radius = 0.25) }}")
    for search in ("sandwich", "interval", "bernstein"):
        hits = scene.first_hit([[0.0, 0.0, 4.0]], [[0.0, 0.0, -1.0]], search=search)
        assert hits.t[0] == pytest.approx(3.75, abs=1e-9)


@pytest.mark.parametrize(
    ("skeleton", "code", "part"),
    [
        ("polygon([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0)])", "E0404", "edges of this polygon cross"),
        (f"polyhedron({TETRAHEDRON}], faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2]])", "E0403", "but its edge"),
        (f"mesh({TETRAHEDRON}], faces = [[0, 2, 4]])", "E0403", "names point 4"),
        (f"polyhedron({TETRAHEDRON}], faces = [[0, -2, 1]])", "E0403", "names point -2"),
    ],
)
def test_what_has_no_distance_is_named(skeleton: str, code: str, part: str):
    with pytest.raises(blobscript.ProgramError) as caught:
        blobscript.compile(f"surface {{ {skeleton}.blob(radius = 0.1) }}")
    (found,) = caught.value.diagnostics
    assert found.code == code
    assert part in found.message
