"""Time per ray of a mesh as a skeleton against its number of triangles, one thread, processor time.

    python tests/bench/bench_meshes.py            # 1 000, 10 000 and 100 000 triangles, and their ratios

A knobbly torus of exactly that many triangles, reach a tenth of its size, rays of a picture in 16 x 16 blocks. The
sizes take turns, the least of all rounds counts. The exit code is 1 if 100 000 triangles cost more than four times
what 1 000 do.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from random_scenes import make_leaf, make_scene

from blobscript import ir
from blobscript.backends.native import Native

#: Triangles -> quads around and along the tube.
SIZES = {1_000: (20, 25), 10_000: (50, 100), 100_000: (200, 250)}
ALLOWED = 4.0


def torus(around: int, along: int) -> ir.Mesh:
    """2 * around * along triangles."""
    u = 2.0 * np.pi * np.arange(along) / along
    v = 2.0 * np.pi * np.arange(around) / around
    u, v = np.meshgrid(u, v, indexing="ij")
    tube = 0.3 + 0.04 * np.sin(5.0 * u) * np.sin(3.0 * v)
    ring = 0.7 + tube * np.cos(v)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(along), np.arange(around), indexing="ij"))
    a, b = i * around + j, (i + 1) % along * around + j
    c, d = (i + 1) % along * around + (j + 1) % around, i * around + (j + 1) % around
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return ir.Mesh(np.ascontiguousarray(points), faces.astype(np.int32), False)


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


def measure(rounds: int, width: int, height: int) -> dict[int, float]:
    """Microseconds per ray by number of triangles."""
    origins, directions = rays(width, height)
    traced = {}
    for count, (around, along) in SIZES.items():
        scene = make_scene((make_leaf(torus(around, along), ir.Kernel("wyvill"), 0.15, 1.0), 0.5))
        traced[count] = Native(scene)
        hits = traced[count].first_hit(origins, directions, threads=1)
        print(f"{count:>7} triangles: {hits.hit.mean():.0%} hits, {hits.evaluations.mean():.1f} evaluations per ray")
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
    arguments = parser.parse_args()
    width, height = map(int, arguments.size.split("x"))
    found = measure(arguments.rounds, width, height)
    for count, each in found.items():
        print(f"{count:>7} triangles: {each:6.2f} us per ray, {each / found[1_000]:4.2f} times 1 000")
    return int(found[100_000] > ALLOWED * found[1_000])


if __name__ == "__main__":
    sys.exit(main())
