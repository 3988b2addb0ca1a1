"""First hits of points and lines against POV-Ray's `blob`, in the same run on the same scenes.

    python tests/bench/bench_points.py            # the table against POV-Ray
    python tests/bench/bench_points.py --scaling  # cost against size, 10 to 1 000 000 points, and threads

640 x 480 rays in 16 x 16 blocks through the public `first_hit` with threads=1 (status, distance and normal), against
POV-Ray's trace phase for the same picture: one shadowless light, no antialiasing, one thread (+WT1). Random
points in a unit cube, kernel (1 - r^2)^2, threshold 0.6, so large that each point overlaps 8 or 100 others.
Both sides count processor time of the whole process; for POV-Ray that of its trace phase, by its own statistics.
Order alternates, the least of several runs counts.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from blobscript import Scene, ir

WIDTH, HEIGHT = 640, 480
THRESHOLD = 0.6
EYE = np.array([0.4, 0.3, 2.2])
FOV = math.radians(35.0)
#: POV-Ray has absolute tolerances that suit a scene of some hundred units.
UNIT = 100.0


def surface_scene(leaf: ir.Leaf) -> Scene:
    camera = ir.Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.6)
    surface = ir.Surface("blob", leaf, THRESHOLD, 0, None)
    return Scene(ir.Scene((surface,), (ir.Material((1.0, 1.0, 1.0)),), camera, (), ir.Background((0.0, 0.0, 0.0))))


def _leaf(skeleton: ir.Points | ir.Lines, count: int, reach: float) -> ir.Leaf:
    ints = np.zeros(count, np.int32)
    return ir.Leaf(skeleton, ir.Kernel("soft2"), np.full(count, reach), np.ones(count), ints - 1, ints)


def points(count: int, neighbours: int) -> Scene:
    at = np.random.default_rng(1).random((count, 3)) - 0.5
    return surface_scene(_leaf(ir.Points(at), count, (neighbours * 3.0 / (4.0 * math.pi * count)) ** (1.0 / 3.0)))


def lines(count: int) -> Scene:
    """Of about the length of their reach, 8 neighbours as for points."""
    rng = np.random.default_rng(2)
    reach = 0.8 * (8 * 3.0 / (4.0 * math.pi * count)) ** (1.0 / 3.0)
    a = rng.random((count, 3)) - 0.5
    way = rng.normal(size=(count, 3))
    b = a + reach * way / np.linalg.norm(way, axis=1, keepdims=True)
    return surface_scene(_leaf(ir.Lines(a, b), count, reach))


def view() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forward, right and up, so that a pixel looks along forward + x right + y up with |x|, |y| <= 1 / 2."""
    forward = -EYE / np.linalg.norm(EYE)
    right = np.cross(forward, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    height = 2.0 * math.tan(FOV / 2.0)
    return forward, right * height * WIDTH / HEIGHT, np.cross(right, forward) * height


def rays(width: int = WIDTH, height: int = HEIGHT) -> tuple[np.ndarray, np.ndarray]:
    """The picture's rays in blocks of 16 x 16, the last row of blocks lower where the height is no multiple."""
    forward, right, up = view()
    tall = [min(16, height - top) for top in range(0, height, 16)]
    rows = [np.mgrid[16 * i : 16 * i + h, 0:width].reshape(2, h, width // 16, 16) for i, h in enumerate(tall)]
    y, x = np.concatenate([row.transpose(0, 2, 1, 3).reshape(2, -1) for row in rows], axis=1)[..., None]
    directions = forward + ((x + 0.5) / width - 0.5) * right + (0.5 - (y + 0.5) / height) * up
    return np.broadcast_to(EYE, directions.shape).copy(), directions


# ---- the two sides ---------------------------------------------------------------------------------


def pov_text(leaf: ir.Leaf) -> str:
    def vector(v: np.ndarray) -> str:
        return f"<{v[0]:.17g},{v[1]:.17g},{v[2]:.17g}>"

    forward, right, up = view()
    reach = float(leaf.reach[0]) * UNIT
    if isinstance(leaf.skeleton, ir.Points):
        parts = [f"sphere{{{vector(p * UNIT)},{reach:.17g},1}}" for p in leaf.skeleton.at]
    else:
        assert isinstance(leaf.skeleton, ir.Lines)
        pairs = zip(leaf.skeleton.a, leaf.skeleton.b, strict=True)
        parts = [f"cylinder{{{vector(a * UNIT)},{vector(b * UNIT)},{reach:.17g},1}}" for a, b in pairs]
    camera = f"location {vector(EYE * UNIT)} direction {vector(forward)} right {vector(right)} up {vector(up)}"
    return "\n".join(
        [
            "#version 3.7; global_settings { assumed_gamma 1 }",
            f"camera {{ perspective {camera} }}",
            f"light_source {{ {vector(EYE * UNIT)} rgb 1 shadowless }}",
            f"blob {{ threshold {THRESHOLD}",
            *parts,
            "pigment { rgb 1 } }",
        ]
    )


def pov_seconds(scene: Path, size: tuple[int, int] = (WIDTH, HEIGHT)) -> float:
    """Processor seconds of the trace phase."""
    command = ["povray", f"+I{scene}", "+O/dev/null", "+FN", f"+W{size[0]}", f"+H{size[1]}", "-D", "-A", "+WT1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    tracing = re.search(r"Trace Time:.*?\n\s*using \d+ thread\(s\) with ([\d.]+) CPU-seconds total", done.stderr, re.S)
    if not tracing:
        raise SystemExit(f"POV-Ray did not say how long it took:\n{done.stderr[-2000:]}")
    return float(tracing[1])


def our_seconds(scene: Scene, origins: np.ndarray, directions: np.ndarray, threads: int = 1) -> float:
    start = time.process_time()
    scene.first_hit(origins, directions, threads=threads)
    return time.process_time() - start


# ---- tables ------------------------------------------------------------------------------------------


def against_povray(sizes: list[int], runs: int) -> None:
    origins, directions = rays()
    cases: list[tuple[str, Callable[[], Scene], int]] = [
        (f"{n} points, 8 neighbours", lambda n=n: points(n, 8), runs) for n in sizes
    ]
    cases.append((f"{max(sizes)} points, 100 neighbours", lambda: points(max(sizes), 100), 1))
    cases.append(("1000 lines", lambda: lines(1000), runs))
    print("| scene | POV-Ray, ms | blobscript, ms | ratio | hits | evaluations per ray |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, make, repeats in cases:
            scene, file = make(), Path(folder) / "scene.pov"
            leaf = scene.ir.surfaces[0].field
            assert isinstance(leaf, ir.Leaf)
            file.write_text(pov_text(leaf), encoding="ascii")
            hits = scene.first_hit(origins, directions, threads=1)
            theirs, ours = [], []
            for _ in range(repeats):
                theirs.append(pov_seconds(file))
                ours += [our_seconds(scene, origins, directions) for _ in range(3)]
            ratio = min(theirs) / min(ours)
            share = hits.hit.mean()
            print(
                f"| {name} | {1e3 * min(theirs):.0f} | {1e3 * min(ours):.1f} | {ratio:.1f} | {share:.0%} | "
                f"{hits.evaluations.mean():.1f} |",
                flush=True,
            )


def scaling(runs: int) -> None:
    origins, directions = rays()
    print("| points | pack, s | index, s | trace, ms | ns per ray | candidates per ray | evaluations per ray |")
    print("|---|---|---|---|---|---|---|")
    for count in (10, 100, 1000, 10_000, 100_000, 1_000_000):
        scene = points(count, 8)
        start = time.process_time()
        native = scene._native
        packed = time.process_time()
        native.index_pointer()
        built = time.process_time()
        hits = native.first_hit(origins, directions, threads=1, counters=True)
        best = min(our_seconds(scene, origins, directions) for _ in range(runs))
        print(
            f"| {count} | {packed - start:.3f} | {built - packed:.3f} | {1e3 * best:.1f} | "
            f"{1e9 * best / len(origins):.0f} | {hits.counters['candidates'].mean():.1f} | "
            f"{hits.evaluations.mean():.1f} |",
            flush=True,
        )
    print(
        f"\nThreads, 100 000 points, wall clock, {os.cpu_count()} cores:\n\n| threads | ms | speed-up |\n|---|---|---|"
    )
    scene, single = points(100_000, 8), 0.0
    for threads in range(1, (os.cpu_count() or 1) + 1):
        best = math.inf
        for _ in range(3 * runs):
            start = time.perf_counter()
            scene.first_hit(origins, directions, threads=threads)
            best = min(best, time.perf_counter() - start)
        single = single or best
        print(f"| {threads} | {1e3 * best:.1f} | {single / best:.2f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scaling", action="store_true", help="cost against size and threads, without POV-Ray")
    parser.add_argument("--sizes", default="10,100,1000,10000,100000", help="numbers of points")
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    if arguments.scaling:
        scaling(arguments.runs)
        return
    if not shutil.which("povray"):
        sys.exit("povray is not installed: apt-get install povray")
    against_povray([int(n) for n in arguments.sizes.split(",")], arguments.runs)


if __name__ == "__main__":
    main()
