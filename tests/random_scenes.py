"""Seeded random scenes and rays for the suites that compare one evaluator with another.

Everything comes from a numpy Generator: the same seed makes the same scene. Skeletons live in
about [-1, 1]^3, reaches are 0.2 to 1.2 of that, so that elements overlap.
"""

from __future__ import annotations

import math

import numpy as np

from blobscript import field as reference
from blobscript.ir import (
    Background,
    Camera,
    Field,
    Kernel,
    KernelPiece,
    Leaf,
    Lines,
    Material,
    Mesh,
    Node,
    Points,
    Polygon,
    Polyhedron,
    Polyline,
    Scene,
    Skeleton,
    Surface,
)

SKELETONS = ("points", "lines", "polyline", "polygon", "polyhedron", "mesh", "solid_mesh")

#: (1 - r)^2 (1 + 2 r): even and odd powers of r, two pieces in different coordinates.
SMOOTH = Kernel(
    "smooth",
    pieces=(
        KernelPiece(0.0, 0.5, "r", 0.0, 1.0, (1.0, 0.0, -3.0, 2.0), 1, True),
        KernelPiece(0.5, 1.0, "r", 0.75, 0.25, (0.15625, -0.28125, 0.09375, 0.03125), 1, True),
    ),
    lipschitz=1.5,
)

_THIRD = math.sqrt(1.0 / 3.0)

#: (1 - s)(1 + 3 s): rises to 4/3, then falls to 0 with a crease at the rim.
SHELL = Kernel(
    "shell",
    pieces=(
        KernelPiece(0.0, _THIRD, "s", 0.0, 1.0, (1.0, 2.0, -3.0), -1, False),
        KernelPiece(_THIRD, 1.0, "s", 0.0, 1.0, (1.0, 2.0, -3.0), -1, True),
    ),
    lipschitz=8.0,
)

BUILT_IN = (
    Kernel("soft2"),
    Kernel("soft3"),
    Kernel("wyvill"),
    Kernel("metaball"),
    Kernel("gauss", 4.0),
    Kernel("gauss", 13.8),
    Kernel("gauss_c1", 0.05),
    Kernel("gauss_c1", 8.0),
)
USER = (SMOOTH, SHELL)


def make_scene(*surfaces: tuple[Field, float]) -> Scene:
    """A scene of (field, threshold) pairs, with what else a scene needs."""
    return Scene(
        surfaces=tuple(Surface(f"surface {i + 1}", f, t, 0, None) for i, (f, t) in enumerate(surfaces)),
        materials=(Material((0.8, 0.3, 0.1)), Material((0.1, 0.3, 0.8), 0.2), Material((0.1, 0.8, 0.1), 0.9)),
        camera=Camera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.7),
        lights=(),
        background=Background((1.0, 1.0, 1.0)),
    )


def make_leaf(skeleton: Skeleton, kernel: Kernel, reach, weight, paint=None, matrix=None) -> Leaf:
    """A leaf from one number or one number per element for reach, weight and paint."""
    count = {Points: lambda s: len(s.at), Lines: lambda s: len(s.a)}.get(type(skeleton), lambda _: 1)(skeleton)
    full = lambda x, kind: np.ascontiguousarray(np.broadcast_to(np.asarray(x, dtype=kind), (count,)))  # noqa: E731
    return Leaf(
        skeleton,
        kernel,
        full(reach, np.float64),
        full(weight, np.float64),
        full(-1 if paint is None else paint, np.int32),
        np.zeros(count, dtype=np.int32),
        matrix,
    )


# ---- skeletons -----------------------------------------------------------------------------------


def _ints(rows) -> np.ndarray:
    return np.asarray(rows, dtype=np.int32)


#: A square with a notch, seen from +z, and its triangles: concave.
NOTCH = np.array([[-1, -1], [1, -1], [1, 1], [0, -0.4], [-1, 1]], dtype=float)
NOTCH_TRIANGLES = [[0, 1, 3], [1, 2, 3], [0, 3, 4]]


def prism(outline: np.ndarray, triangles: list[list[int]], height: float) -> tuple[np.ndarray, np.ndarray]:
    """Closed, outward: a counter-clockwise outline (m, 2) between z = -height and height."""
    m = len(outline)
    points = np.concatenate([np.column_stack([outline, np.full(m, z)]) for z in (-height, height)])
    bottom = [[a, c, b] for a, b, c in triangles]
    top = [[a + m, b + m, c + m] for a, b, c in triangles]
    ring = [(i, (i + 1) % m) for i in range(m)]
    return points, _ints(bottom + top + [[i, j, j + m] for i, j in ring] + [[i, j + m, i + m] for i, j in ring])


OCTAHEDRON = (
    np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float),
    _ints([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]),
)


def sphere(levels: int) -> tuple[np.ndarray, np.ndarray]:
    """The octahedron with each face split in four, `levels` times, on the unit sphere."""
    points, faces = list(map(tuple, OCTAHEDRON[0])), OCTAHEDRON[1].tolist()
    for _ in range(levels):
        middle: dict[tuple[int, int], int] = {}
        split = []
        for a, b, c in faces:
            ids = []
            for i, j in ((a, b), (b, c), (c, a)):
                key = (min(i, j), max(i, j))
                if key not in middle:
                    p = np.add(points[i], points[j])
                    points.append(tuple(p / np.linalg.norm(p)))
                    middle[key] = len(points) - 1
                ids.append(middle[key])
            d, e, f = ids
            split += [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
        faces = split
    return np.array(points), _ints(faces)


def rotation(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def _place(rng: np.random.Generator, points: np.ndarray, size: float) -> np.ndarray:
    return np.ascontiguousarray(points @ rotation(rng).T * size + rng.uniform(-0.6, 0.6, 3))


def random_skeleton(rng: np.random.Generator, kind: str) -> Skeleton:
    size = rng.uniform(0.2, 0.7)
    match kind:
        case "points":
            return Points(rng.uniform(-1, 1, (rng.integers(1, 6), 3)))
        case "lines":
            a = rng.uniform(-1, 1, (rng.integers(1, 5), 3))
            b = a + rng.normal(0, 0.6, a.shape) * (rng.random((len(a), 1)) < 0.9)
            return Lines(a, b)
        case "polyline":
            points = np.cumsum(rng.normal(0, 0.4, (rng.integers(2, 7), 3)), axis=0)
            return Polyline(points - points.mean(axis=0), bool(rng.random() < 0.4 and len(points) > 2))
        case "polygon":
            if rng.random() < 0.5:
                flat = np.column_stack([NOTCH, np.zeros(5)])
                return Polygon(_place(rng, flat, size), _ints(NOTCH_TRIANGLES))
            return Polygon(_place(rng, rng.normal(size=(3, 3)), size), _ints([[0, 1, 2]]))
        case "polyhedron":
            if rng.random() < 0.5:
                points, faces = prism(NOTCH, NOTCH_TRIANGLES, rng.uniform(0.2, 1.0))
                return Polyhedron(_place(rng, points, size), faces, False)
            return Polyhedron(_place(rng, OCTAHEDRON[0] * rng.uniform(0.3, 1.5, 3), size), OCTAHEDRON[1], True)
        case "mesh":
            points, faces = sphere(1)
            faces = faces[rng.random(len(faces)) < 0.6]
            faces = faces if len(faces) else _ints([[0, 2, 4]])
            return Mesh(_place(rng, points + rng.normal(0, 0.1, points.shape), size), faces, False)
        case _:
            points, faces = sphere(1)
            return Mesh(_place(rng, points * rng.uniform(0.6, 1.3, (len(points), 1)), size), faces, True)


# ---- fields ------------------------------------------------------------------------------------------


def random_matrix(rng: np.random.Generator) -> np.ndarray:
    """Scene -> skeleton space: rotation, non-uniform scale of 0.5 to 2, mirror now and then, shift."""
    linear = rotation(rng) @ np.diag(np.exp(rng.uniform(-0.7, 0.7, 3)) * rng.choice([-1.0, 1.0], 3)) @ rotation(rng)
    return np.ascontiguousarray(np.column_stack([linear, rng.uniform(-0.3, 0.3, 3)]))


def random_leaf(
    rng: np.random.Generator,
    kinds: tuple[str, ...] = SKELETONS,
    kernels: tuple[Kernel, ...] = BUILT_IN + USER,
    negative: float = 0.3,
    mapped: float = 0.3,
) -> Leaf:
    skeleton = random_skeleton(rng, str(rng.choice(kinds)))
    count = len(skeleton.at) if isinstance(skeleton, Points) else len(skeleton.a) if isinstance(skeleton, Lines) else 1
    weight = rng.uniform(0.3, 1.5, count) * np.where(rng.random(count) < negative, -1.0, 1.0)
    return make_leaf(
        skeleton,
        kernels[rng.integers(len(kernels))],
        rng.uniform(0.2, 1.2, count),
        weight,
        rng.integers(-1, 3, count),
        random_matrix(rng) if rng.random() < mapped else None,
    )


def random_field(rng: np.random.Generator, depth: int = 2, op: str | None = None, **leaf) -> Field:
    """A tree with up to `depth` nested nodes whose children never repeat the operation above."""
    if depth == 0:
        return random_leaf(rng, **leaf)
    ops = [name for name in ("sum", "sum", "max", "min", "smooth_max") if name != op]
    chosen = str(rng.choice(ops))
    count = rng.integers(1, 4 if depth > 1 else 5)
    below = [random_field(rng, int(rng.integers(0, depth)), chosen, **leaf) for _ in range(count)]
    return Node(chosen, tuple(below))  # pyright: ignore[reportArgumentType]


def random_scene(rng: np.random.Generator, depth: int = 2, surfaces: int = 1, **leaf) -> Scene:
    """Thresholds at a level that the field reaches somewhere, where it is positive at all."""
    pairs = []
    for _ in range(surfaces):
        field = random_field(rng, depth, **leaf)
        lo, hi = reference.extent(field)
        top = float(reference.field_value(field, rng.uniform(lo, hi, (256, 3))).max())
        pairs.append((field, float(rng.uniform(0.15, 0.7)) * (top if top > 0.01 else 1.0)))
    return make_scene(*pairs)


# ---- rays ----------------------------------------------------------------------------------------------


def random_rays(rng: np.random.Generator, scene: Scene, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions: from outside into the extent, a fifth of them from within."""
    lo, hi = _extent(scene)
    target = rng.uniform(lo, hi, (count, 3))
    away = rng.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    distance = np.where(rng.random(count) < 0.2, rng.uniform(0, 0.3, count), rng.uniform(1.0, 3.0, count))
    return target + away * (distance * np.linalg.norm(hi - lo))[:, None], -away


def grazing_rays(rng: np.random.Generator, scene: Scene, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays that pass a surface nearly along its tangent, 1e-2 to 1e-9 above or below it; fewer
    than `count` where the surfaces are hard to find."""
    lo, hi = _extent(scene)
    surface = scene.surfaces[rng.integers(len(scene.surfaces))]
    on = _surface_points(rng, surface, lo, hi, count)
    normal = -reference.gradient(surface.field, on)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    on, normal, length = on[length[:, 0] > 0], normal[length[:, 0] > 0], length[length[:, 0] > 0]
    normal = normal / length
    tangent = np.cross(normal, rng.normal(size=normal.shape))
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    height = 10.0 ** rng.uniform(-9, -2, (len(on), 1)) * rng.choice([-1.0, 1.0], (len(on), 1))
    back = rng.uniform(0.1, 1.5, (len(on), 1)) * np.linalg.norm(hi - lo)
    return on + height * normal - back * tangent, tangent


def _extent(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    boxes = [reference.extent(surface.field) for surface in scene.surfaces]
    return np.min([lo for lo, _ in boxes], axis=0), np.max([hi for _, hi in boxes], axis=0)


def _surface_points(rng: np.random.Generator, surface: Surface, lo, hi, count: int) -> np.ndarray:
    """Bisection between random places inside and outside."""
    places = rng.uniform(lo, hi, (max(512, 4 * count), 3))
    is_in = reference.field_value(surface.field, places) >= surface.threshold
    if not is_in.any() or is_in.all():
        return np.zeros((0, 3))
    a = places[is_in][rng.integers(is_in.sum(), size=count)]
    b = places[~is_in][rng.integers((~is_in).sum(), size=count)]
    for _ in range(60):
        middle = 0.5 * (a + b)
        inside = (reference.field_value(surface.field, middle) >= surface.threshold)[:, None]
        a, b = np.where(inside, middle, a), np.where(inside, b, middle)
    return a
