"""Time per ray of a mesh as a skeleton against its number of triangles, one thread, processor time.

    python tests/bench/bench_meshes.py            # about 1 000, 10 000 and 100 000 triangles, and their ratios
    python tests/bench/bench_meshes.py --only ball --only torus

Smooth, folded and strewn meshes, surfaces and solids, seen from outside by rays of a picture in 16 x 16 blocks, and
solids from inside by rays in any order. The sizes take turns, the least of all rounds counts. The exit code is 1 if
100 000 triangles cost more than four times what 1 000 do anywhere.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from random_scenes import make_leaf, make_scene

from blobscript import ir
from blobscript.backends.native import Native

#: Triangles -> quads around and along.
SIZES = {1_000: (20, 25), 10_000: (50, 100), 100_000: (200, 250)}
ALLOWED = 4.0


def grid(around: int, along: int, closed: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """2 * around * along triangles; u along and v around of its vertices, in [0, 1]. closed: end to end."""
    rows, columns = (along, around) if closed else (along + 1, around + 1)
    u, v = (a.ravel() for a in np.meshgrid(np.arange(rows) / along, np.arange(columns) / around, indexing="ij"))
    i, j = (a.ravel() for a in np.meshgrid(np.arange(along), np.arange(around), indexing="ij"))
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = (i + 1) % rows * columns + (j + 1) % columns, (i + 1) % rows * columns + j
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1)])
    return u, v, faces.astype(np.int32)


def torus(around: int, along: int) -> ir.Mesh:
    """A knobbly one."""
    u, v, faces = grid(around, along, True)
    u, v = 2.0 * np.pi * u, 2.0 * np.pi * v
    tube = 0.3 + 0.04 * np.sin(5.0 * u) * np.sin(3.0 * v)
    ring = 0.7 + tube * np.cos(v)
    return ir.Mesh(np.stack([ring * np.cos(u), ring * np.sin(u), tube * np.sin(v)], axis=-1), faces, False)


def knot(around: int, along: int) -> ir.Mesh:
    """A trefoil of thread, solid."""
    u, v, faces = grid(around, along, True)
    u, v = 2.0 * np.pi * u, 2.0 * np.pi * v[:, None]

    def middle(t: np.ndarray) -> np.ndarray:
        ring = 0.7 + 0.25 * np.cos(3.0 * t)
        return np.stack([ring * np.cos(2.0 * t), ring * np.sin(2.0 * t), 0.25 * np.sin(3.0 * t)], axis=-1)

    way = middle(u + 1e-4) - middle(u - 1e-4)
    aside = np.cross(way, [0.0, 0.0, 1.0])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    above = np.cross(aside, way)
    above /= np.linalg.norm(above, axis=1, keepdims=True)
    return ir.Mesh(middle(u) + 0.1 * (np.cos(v) * aside + np.sin(v) * above), faces, True)


def terrain(around: int, along: int) -> ir.Mesh:
    u, v, faces = grid(around, along, False)
    x, y = 2.0 * u - 1.0, 2.0 * v - 1.0
    height = 0.2 * np.sin(5.0 * x) * np.cos(4.0 * y) + 0.05 * np.sin(17.0 * x + 3.0 * y)
    return ir.Mesh(np.stack([x, y, height], axis=-1), faces, False)


def ball(around: int, along: int, solid: bool, ripple: float = 0.0) -> ir.Mesh:
    """An octahedron blown up: 8 n^2 triangles."""
    n = round((around * along / 4) ** 0.5)
    places: dict[tuple[int, int, int], int] = {}
    faces: list[tuple[int, int, int]] = []
    for sx, sy, sz in ((x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)):

        def at(i: int, j: int, s: tuple[int, int, int] = (sx, sy, sz)) -> int:
            return places.setdefault((s[0] * (n - i - j), s[1] * i, s[2] * j), len(places))

        for i in range(n):
            for j in range(n - i):
                some = [(at(i, j), at(i + 1, j), at(i, j + 1))]
                if i + j < n - 1:
                    some.append((at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)))
                faces += some if sx * sy * sz > 0 else [(a, c, b) for a, b, c in some]
    points = np.array(list(places), dtype=np.float64)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points *= 0.8 * (1.0 + ripple * np.sin(5.0 * points[:, :1]) * np.cos(6.0 * points[:, 2:]))
    return ir.Mesh(points, np.array(faces, dtype=np.int32), solid)


def strewn(around: int, along: int) -> ir.Mesh:
    """Triangles anywhere."""
    count, rng = 2 * around * along, np.random.default_rng(1)
    points = rng.uniform(-1.0, 1.0, (count, 1, 3)) + 0.6 * count ** (-1 / 3) * rng.standard_normal((count, 3, 3))
    return ir.Mesh(points.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3), False)


#: Name -> maker of the mesh, and reach.
CASES: dict[str, tuple[Callable[[int, int], ir.Mesh], float]] = {
    "torus": (torus, 0.15),
    "torus, felt from afar": (torus, 0.6),
    "ball": (partial(ball, solid=False), 0.3),
    "solid ball": (partial(ball, solid=True), 0.15),
    "solid ball, felt from afar": (partial(ball, solid=True), 1.0),
    "solid with knobs": (partial(ball, solid=True, ripple=0.15), 0.2),
    "solid with knobs, from inside": (partial(ball, solid=True, ripple=0.15), 0.3),
    "solid knot": (knot, 0.08),
    "terrain": (terrain, 0.1),
    "terrain, felt from afar": (terrain, 0.5),
    "strewn": (strewn, 0.15),
}


def rays(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """From (0, -2.2, 1.8) at the middle, block after block of 16 x 16."""
    y, x = np.mgrid[0:height, 0:width]
    order = np.lexsort((x.ravel() % 16, y.ravel() % 16, x.ravel() // 16, y.ravel() // 16))
    x, y = x.ravel()[order], y.ravel()[order]
    eye = np.array([0.0, -2.2, 1.8])
    forward = -eye / np.linalg.norm(eye)
    right = np.array([1.0, 0.0, 0.0])
    up = np.cross(right, forward)
    aside, above = ((x + 0.5) / width - 0.5) * width / height, 0.5 - (y + 0.5) / height
    directions = forward + 0.9 * (aside[:, None] * right + above[:, None] * up)
    return np.broadcast_to(eye, directions.shape).copy(), directions


def rays_inside(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    return rng.uniform(-0.4, 0.4, (count, 3)), rng.standard_normal((count, 3))


def measure(name: str, rounds: int, width: int, height: int) -> dict[int, float]:
    """Microseconds per ray by number of triangles."""
    inside = name.endswith("inside")
    origins, directions = rays_inside(width * height // 8) if inside else rays(width, height)
    traced: dict[int, Native] = {}
    for count, size in SIZES.items():
        maker, reach = CASES[name]
        mesh = maker(*size)
        mesh = ir.Mesh(np.ascontiguousarray(mesh.points), mesh.triangles, mesh.solid)
        traced[count] = Native(make_scene((make_leaf(mesh, ir.Kernel("wyvill"), reach, 1.0), 0.5)))
        traced[count].first_hit(origins, directions, threads=1)
    least = dict.fromkeys(SIZES, np.inf)
    for _ in range(rounds):
        for count, native in traced.items():
            start = time.process_time()
            native.first_hit(origins, directions, threads=1)
            least[count] = min(least[count], 1e6 * (time.process_time() - start) / len(origins))
    return least


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--only", action="append", default=[], choices=CASES)
    arguments = parser.parse_args()
    width, height = map(int, arguments.size.split("x"))
    worst = 0.0
    print(f"{'us per ray':30}" + "".join(f"{count:>10,}" for count in SIZES).replace(",", " ") + "     ratio")
    for name in arguments.only or CASES:
        found = measure(name, arguments.rounds, width, height)
        ratio = found[100_000] / found[1_000]
        print(f"{name:30}" + "".join(f"{each:10.2f}" for each in found.values()) + f"{ratio:10.2f}", flush=True)
        worst = max(worst, ratio)
    return int(worst > ALLOWED)


if __name__ == "__main__":
    sys.exit(main())
