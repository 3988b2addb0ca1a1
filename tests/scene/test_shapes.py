"""Polygons, bodies and meshes from lists of points: what is cut, what is refused."""

from __future__ import annotations

import math
import random
import time
from itertools import combinations

import numpy as np
import pytest

from blobscript import ir
from blobscript.triangulate import segments_meet, side
from blobscript.values import Dot, MakerError, Segment

SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
U_SHAPE = [(0, 0, 0), (3, 0, 0), (3, 2, 0), (2, 2, 0), (2, 1, 0), (1, 1, 0), (1, 2, 0), (0, 2, 0)]
CUBE = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
CUBE_FACES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


def area(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2


def volume(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


def refusal(call, *arguments, **named) -> MakerError:
    with pytest.raises(MakerError) as caught:
        call(*arguments, **named)
    return caught.value


# ---- polylines -----------------------------------------------------------------------


def test_polyline_drops_repeated_points(make):
    line = make.polyline(points=[(0, 0, 0), (0, 0, 0), (1, 0, 0), (1, 0, 0), (1, 1, 0)])
    assert line.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]]


def test_closed_polyline_drops_a_repeated_start(make):
    line = make.polyline(points=[*SQUARE, SQUARE[0]], closed=True)
    assert isinstance(line, ir.Polyline)
    assert len(line.points) == 4
    assert line.closed


def test_short_polylines_are_points_and_lines(make):
    assert isinstance(make.polyline(points=[(1, 2, 3)]), Dot)
    assert isinstance(make.polyline(points=[(1, 2, 3)] * 3, closed=True), Dot)
    assert isinstance(make.polyline(points=[(1, 2, 3), (4, 5, 6)]), Segment)


def test_empty_polyline(make):
    assert refusal(make.polyline, points=[]).code == "E0404"


# ---- polygons ------------------------------------------------------------------------


@pytest.mark.parametrize("points, expected", [(SQUARE, 1), (U_SHAPE, 5), (U_SHAPE[::-1], 5)])
def test_polygon_is_covered_by_its_triangles(make, points, expected):
    polygon = make.polygon(points=points)
    assert area(polygon.points, polygon.triangles) == pytest.approx(expected)
    assert len(polygon.triangles) == len(points) - 2


def test_polygon_with_straight_and_repeated_corners(make):
    points = [(0, 0, 0), (0.5, 0, 0), (1, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0.5, 0), (0, 0, 0)]
    polygon = make.polygon(points=points)
    assert len(polygon.points) == 6
    assert area(polygon.points, polygon.triangles) == pytest.approx(1)


@pytest.mark.parametrize("seed", range(40))
def test_random_star_polygons(make, seed):
    """Any star-shaped polygon in any plane: its triangles have its area and do not overlap."""
    rng = random.Random(seed)
    n = rng.randrange(3, 40)
    turns = sorted(rng.random() for _ in range(n))
    if max(b - a for a, b in zip(turns, [*turns[1:], turns[0] + 1], strict=True)) >= 0.5:
        turns = [(k + 0.5 * rng.random()) / n for k in range(n)]
    flat = [
        (r * math.cos(2 * math.pi * t), r * math.sin(2 * math.pi * t))
        for t, r in ((t, rng.uniform(0.1, 2)) for t in turns)
    ]
    expected = abs(sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(flat, flat[1:] + flat[:1], strict=True))) / 2
    axes = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    points = np.array(flat) @ axes[:2] + 5 * axes[2]
    polygon = make.polygon(points=points)
    assert area(polygon.points, polygon.triangles) == pytest.approx(expected, rel=1e-9)
    normals = np.cross(
        points[polygon.triangles[:, 1]] - points[polygon.triangles[:, 0]],
        points[polygon.triangles[:, 2]] - points[polygon.triangles[:, 0]],
    )
    assert (normals @ normals[0] > 0).all()


def test_spiral(make):
    """A long thin spiral: few ears at any time."""
    steps = [k * 0.2 for k in range(60)]
    outer = [((1 + t) * math.cos(t), (1 + t) * math.sin(t), 0) for t in steps]
    inner = [((0.8 + t) * math.cos(t), (0.8 + t) * math.sin(t), 0) for t in reversed(steps)]
    polygon = make.polygon(points=outer + inner)
    assert len(polygon.triangles) == 118


def test_keyhole_combs(make):
    """Many corners on one line, teeth pointing both ways."""
    top = [(x, 1 + (x % 2), 0) for x in range(20)]
    polygon = make.polygon(points=[(19, 0, 0), (0, 0, 0), *top])
    expected = area(polygon.points, polygon.triangles)
    assert expected == pytest.approx(19 * 1.5)


@pytest.mark.parametrize(
    "points, words",
    [
        ([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0)], "cross: (0, 0, 0)–(1, 1, 0) and (1, 0, 0)–(0, 1, 0)"),
        ([(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 0, 0), (0, 2, 0)], "cross"),  # a corner touches an edge
        ([(0, 0, 0), (2, 0, 0), (1, 0, 0), (1, 2, 0)], "cross"),  # an edge folds back
        ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 0, 0), (-1, 0, 0), (-1, -1, 0)], "cross"),  # touches itself
        ([(0, 0, 0), (1, 0, 0), (2, 0, 0)], "one line"),
        ([(0, 0, 0), (1, 0, 0), (1, 1, 1e-7), (0, 1, 0)], "not flat"),
        ([(0, 0, 0), (1, 0, 0), (0, 0, 0)], "three points"),
        ([(1, 1, 1)] * 5, "three points"),
        ([], "three points"),
    ],
)
def test_bad_polygons(make, points, words):
    error = refusal(make.polygon, points=points)
    assert error.code == "E0404"
    assert words in error.message


def test_polygon_may_be_off_its_plane_by_rounding(make):
    make.polygon(points=[(0, 0, 0), (1, 0, 0), (1, 1, 1e-10), (0, 1, 0)])


def test_crossing_is_exact():
    """Three points that only exact arithmetic tells from a line."""
    a, b = (12.0, 12.0), (24.0, 24.0)
    near = (0.5, math.nextafter(0.5, 1))
    assert side(a, b, (0.5, 0.5)) == 0
    assert side(a, b, near) == 1
    assert side(b, a, near) == -1
    assert side((0, 0), (1e-300, 0), (0, 1e-300)) == 1


def test_segments_that_touch():
    assert segments_meet((0, 0), (2, 0), (1, 0), (1, 5))
    assert segments_meet((0, 0), (2, 0), (1, 0), (5, 0))
    assert not segments_meet((0, 0), (2, 0), (3, 0), (5, 0))
    assert not segments_meet((0, 0), (2, 0), (1, 1), (1, 5))


# ---- bodies --------------------------------------------------------------------------


def test_cube(make):
    cube = make.polyhedron(points=CUBE, faces=CUBE_FACES)
    assert cube.convex
    assert len(cube.triangles) == 12
    assert volume(cube.points, cube.triangles) == pytest.approx(1)


def test_inside_out_cube_is_turned(make):
    cube = make.polyhedron(points=CUBE, faces=[face[::-1] for face in CUBE_FACES])
    assert volume(cube.points, cube.triangles) == pytest.approx(1)


def prism(flat):
    n = len(flat)
    points = [(x, y, 0) for x, y, _ in flat] + [(x, y, 1) for x, y, _ in flat]
    sides = [[k, (k + 1) % n, n + (k + 1) % n, n + k] for k in range(n)]
    return points, [list(range(n))[::-1], list(range(n, 2 * n)), *sides]


def test_concave_prism(make):
    points, faces = prism(U_SHAPE)
    body = make.polyhedron(points=points, faces=faces)
    assert not body.convex
    assert volume(body.points, body.triangles) == pytest.approx(5)


def test_faces_with_straight_corners_stay_closed(make):
    """Corners in the middle of edges must not open slits between faces."""
    flat = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (2, 2, 0), (1, 2, 0), (0, 2, 0), (0, 1, 0)]
    points, faces = prism(flat)
    body = make.polyhedron(points=points, faces=faces)
    assert volume(body.points, body.triangles) == pytest.approx(4)
    comb = [(0, 0, 0), (4, 0, 0), (4, 1, 0), (3, 1, 0), (3, 0.5, 0), (2, 1, 0), (1, 0.5, 0), (1, 1, 0), (0, 1, 0)]
    points, faces = prism(comb)
    body = make.polyhedron(points=points, faces=faces)
    assert volume(body.points, body.triangles) == pytest.approx(area(*_mesh(make, comb)))
    triangle = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0), (0, 3, 0)]
    points, faces = prism(triangle)
    body = make.polyhedron(points=points, faces=faces)
    assert volume(body.points, body.triangles) == pytest.approx(4.5)


def _mesh(make, flat):
    polygon = make.polygon(points=flat)
    return polygon.points, polygon.triangles


@pytest.mark.parametrize("seed", range(30))
def test_random_lattice_prisms_stay_closed(make, seed):
    """Star polygons with corners on a lattice have many straight and collinear corners."""
    rng = random.Random(seed)
    corners = {(rng.randrange(-3, 4), rng.randrange(-3, 4)) for _ in range(14)} - {(0, 0)}
    by_direction = {}
    for x, y in corners | {(5, -4), (-5, -4), (0, 5)}:
        g = math.gcd(x, y)
        by_direction.setdefault((x // g, y // g), (x, y))
    ring = sorted(by_direction.values(), key=lambda p: math.atan2(p[1], p[0]))
    flat = [(x, y, 0) for x, y in ring]
    points, faces = prism(flat)
    body = make.polyhedron(points=points, faces=faces)
    assert volume(body.points, body.triangles) == pytest.approx(area(*_mesh(make, flat)))


@pytest.mark.parametrize(
    "faces, words",
    [
        (CUBE_FACES[:5], "belongs to one face only"),
        ([*CUBE_FACES[:5], CUBE_FACES[5][::-1]], "same direction"),
        ([*CUBE_FACES, CUBE_FACES[0]], "same direction"),
        ([*CUBE_FACES, [0, 1, 8]], "names point 8"),
        ([*CUBE_FACES, [0, 1, -1]], "names point -1"),
        ([*CUBE_FACES, [0, 1]], "it needs three"),
        ([], "has no faces"),
    ],
)
def test_bad_bodies(make, faces, words):
    error = refusal(make.polyhedron, points=CUBE, faces=faces)
    assert error.code == "E0403"
    assert words in error.message


def test_open_body_names_the_edge(make):
    message = refusal(make.polyhedron, points=CUBE, faces=CUBE_FACES[:5]).message
    ends = [corner for corner in combinations(CUBE, 2) if all(f"({a}, {b}, {c})" in message for a, b, c in corner)]
    assert len(ends) == 1


def test_concave_and_bent_quads(make):
    """An arrowhead must be cut from its notch; a bent quad is what its triangles are."""
    arrow = [(0, 0, 0), (2, -1, 0), (0.5, 0, 0), (2, 1, 0)]
    for turned in (arrow, arrow[1:] + arrow[:1]):
        mesh = make.mesh(points=turned, faces=[[0, 1, 2, 3]])
        assert area(mesh.points, mesh.triangles) == pytest.approx(0.5)
    bent = make.mesh(points=[(0, 0, 0), (1, 0, 0), (1, 1, 1e-7), (0, 1, 0)], faces=[[0, 1, 2, 3]])
    assert bent.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_flat_faces_are_lines(make):
    mesh = make.mesh(points=[(x, 2 * x, 0) for x in range(5)], faces=[[0, 1, 2, 3, 4]])
    assert set(mesh.triangles.ravel().tolist()) == {0, 1, 2, 3, 4}


def spiral(n: int) -> list[tuple[float, float, float]]:
    steps = [k * 60 / (n // 2) for k in range(n // 2)]
    outer = [((1 + t) * math.cos(t), (1 + t) * math.sin(t), 0) for t in steps]
    return outer + [((0.8 + t) * math.cos(t), (0.8 + t) * math.sin(t), 0) for t in reversed(steps)]


def comb(n: int) -> list[tuple[float, float, float]]:
    return [(n - 3, 0, 0), (0, 0, 0), *((x, 1 + x % 2, 0) for x in range(n - 2))]


@pytest.mark.parametrize("outline", [spiral, comb])
def test_large_polygons_are_quick(make, outline):
    """Few ears at any time, or half of all corners reflex and in line; the limit is ten times what it takes."""
    start = time.process_time()
    polygon = make.polygon(points=outline(5000))
    assert time.process_time() - start < 5
    flat = polygon.points[:, :2]
    after = np.roll(flat, -1, axis=0)
    enclosed = abs(float((flat[:, 0] * after[:, 1] - flat[:, 1] * after[:, 0]).sum())) / 2
    assert area(polygon.points, polygon.triangles) == pytest.approx(enclosed, rel=1e-9)


def test_polygons_too_large_say_what_to_do_instead(make):
    error = refusal(make.polygon, points=spiral(5002))
    assert "5002 points; up to 5000" in error.message
    assert "mesh" in error.helps[0].text


def test_huge_index(make):
    assert "names point" in refusal(make.mesh, points=CUBE, faces=[[0, 1, 10**30]]).message
    assert "names point" in refusal(make.mesh, points=CUBE, faces=[[0, 1, 2, 10**30]]).message


def test_crossing_face(make):
    flat = [(0, 0, 0), (2, 2, 0), (2, 0, 0), (0, 1, 0)]
    assert "crosses itself" in refusal(make.mesh, points=flat, faces=[[0, 1, 2, 3]]).message


# ---- meshes --------------------------------------------------------------------------


def test_open_mesh_is_a_surface(make):
    mesh = make.mesh(points=CUBE, faces=CUBE_FACES[:5])
    assert not mesh.solid
    assert len(mesh.triangles) == 10


def test_open_mesh_is_no_solid(make):
    error = refusal(make.mesh, points=CUBE, faces=CUBE_FACES[:5], solid=True)
    assert error.code == "E0403"
    assert "hole" in error.message


def test_the_edge_of_a_hole_has_the_numbers_of_the_script(make):
    points = [(1, 0, 0), (0, 1, 0), (0, 0, 0), (1, 0, 0)]
    error = refusal(make.mesh, points=points, faces=[[3, 1, 2]], solid=True)
    assert "edge (0, 0, 0)–(1, 0, 0)" in error.message
    assert "from point 2 to point 0 (counted from 0)" in error.label


def test_triangle_soup_is_welded(make):
    cube = make.mesh(points=CUBE, faces=CUBE_FACES)
    soup = cube.points[cube.triangles].reshape(-1, 3)
    solid = make.mesh(points=soup, faces=np.arange(36).reshape(-1, 3), solid=True)
    assert solid.solid
    assert len(solid.points) == 8
    assert volume(solid.points, solid.triangles) == pytest.approx(1)


def test_flat_mesh_triangles_are_allowed(make):
    mesh = make.mesh(points=[(0, 0, 0), (1, 0, 0), (2, 0, 0)], faces=[[0, 1, 2]])
    assert len(mesh.triangles) == 1


def test_bad_index(make):
    error = refusal(make.mesh, points=CUBE, faces=[[0, 1, 99]])
    assert error.code == "E0403"
    assert error.argument == "faces"


def test_points_are_one_skeleton(make):
    assert isinstance(make.points(at=[(1, 2, 3)]), Dot)
    cloud = make.points(at=[(0, 0, 0), (1, 0, 0)])
    assert cloud.triangles.tolist() == [[0, 0, 0], [1, 1, 1]]
    assert refusal(make.points, at=[]).code == "E0404"


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 10**400, 1e200], ids=list("n+-hl"))
def test_coordinates_must_be_finite(make, bad):
    for call, arguments in (
        (make.point, {"p": (0, bad, 0)}),
        (make.point, {"x": bad, "y": 0, "z": 0}),
        (make.line, {"a": (0, 0, 0), "b": (0, 0, bad)}),
        (make.polyline, {"points": [(0, 0, 0), (bad, 0, 0)]}),
        (make.polygon, {"points": [*SQUARE, (bad, 0, 0)]}),
        (make.mesh, {"points": [*CUBE, (bad, 0, 0)], "faces": CUBE_FACES}),
    ):
        assert refusal(call, **arguments).code == "E0405"
