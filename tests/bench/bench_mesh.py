"""How fast meshes are made: one hundred balls, beside scikit-image in the same run, and alone up to 2 048³ cells.

    python tests/bench/bench_mesh.py                 # against scikit-image (pip install scikit-image), 64³ to 512³
    python tests/bench/bench_mesh.py --alone         # 64³ to 2 048³ cells: visited boxes, memory, time

scikit-image gets a float32 field that NumPy samples only within each ball's reach; both sides run on one thread, times
are processor time, the least of interleaved repeats. `--alone` uses all cores and the wall clock, each size in a
process of its own, whose peak memory is told.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from typing import Any

import numpy as np

import blobscript
from blobscript import field, ir, kernels
from blobscript.meshing.grid import Grid
from blobscript.meshing.mesher import polygonize

_SIZES = (64, 128, 256, 512)
_ALONE = (64, 128, 256, 512, 1024, 2048)


def balls(count: int = 100) -> blobscript.Scene:
    """Balls that melt here and there, in about [-1.2, 1.2]³."""
    rng = np.random.default_rng(1)
    rows = np.column_stack([rng.uniform(-1, 1, (count, 3)), rng.uniform(0.1, 0.25, count)]).tolist()
    items = "\n".join(f"  ball(({x!r}, {y!r}, {z!r}), radius = {r!r})" for x, y, z, r in rows)
    return blobscript.compile(f"surface(threshold = 0.5) {{\n{items}\n}}")


def grid_for(scene: blobscript.Scene, cells: int) -> Grid:
    lo, hi = field.extent(scene.ir.surfaces[0].field)
    cell = float((hi - lo).max()) / cells
    return Grid(lo, np.full(3, cell), (cells, cells, cells), 0)


def ours(scene: blobscript.Scene, grid: Grid) -> int:
    return len(polygonize(scene._native, 0, grid, threads=1).triangles)


def with_scikit_image(scene: blobscript.Scene, grid: Grid) -> int:
    from skimage import measure

    values = sampled(scene.ir.surfaces[0].field, grid)
    _, triangles, _, _ = measure.marching_cubes(values, 0.5, spacing=tuple(grid.cell))
    return len(triangles)


def sampled(leaf: ir.Field, grid: Grid) -> np.ndarray:
    """The field at all nodes, each ball within its reach only."""
    assert isinstance(leaf, ir.Leaf)
    assert isinstance(leaf.skeleton, ir.Points)
    values = np.zeros([n + 1 for n in grid.cells], np.float32)
    for at, reach, weight in zip(leaf.skeleton.at, leaf.reach, leaf.weight, strict=True):
        first = np.maximum(np.ceil((at - reach - grid.lo) / grid.cell), 0).astype(int)
        last = np.minimum(np.floor((at + reach - grid.lo) / grid.cell) + 1, values.shape).astype(int)
        x, y, z = ((grid.lo[k] + grid.cell[k] * np.arange(first[k], last[k]) - at[k]) ** 2 for k in range(3))
        s = (x[:, None, None] + y[None, :, None] + z) / reach**2
        part = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        values[part] += weight * kernels.value(leaf.kernel, s)
    return values


def least_times(jobs: dict[str, Any], repeats: int) -> dict[str, float]:
    best = dict.fromkeys(jobs, float("inf"))
    for _ in range(repeats):
        for name, job in jobs.items():
            start = time.process_time()
            job()
            best[name] = min(best[name], time.process_time() - start)
    return best


def compare(repeats: int) -> None:
    scene = balls()
    print("| cells | scikit-image | blobscript | ratio |\n|---|---|---|---|")
    for size in _SIZES:
        grid = grid_for(scene, size)
        jobs = {"theirs": lambda g=grid: with_scikit_image(scene, g), "ours": lambda g=grid: ours(scene, g)}
        best = least_times(jobs, 1 + repeats // (2 if size < 512 else 4))
        print(
            f"| {size}³ | {1e3 * best['theirs']:,.0f} ms | {1e3 * best['ours']:,.0f} ms |"
            f" {best['theirs'] / best['ours']:.1f} |",
            flush=True,
        )


def one(size: int) -> None:
    """One size in this process; a line of JSON."""
    scene = balls()
    scene._native.index_pointer()
    grid = grid_for(scene, size)
    start = time.perf_counter(), time.process_time()
    body = polygonize(scene._native, 0, grid)
    wall, used = time.perf_counter() - start[0], time.process_time() - start[1]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    told = {"triangles": len(body.triangles), "visited": body.counts.visited, "cells": body.counts.cells}
    print(json.dumps(told | {"wall": wall, "processor": used, "peak": peak}))


def alone() -> None:
    print("| cells | boxes visited | per n² | cells kept | triangles | wall | processor | peak memory |")
    print("|---|---|---|---|---|---|---|---|")
    for size in _ALONE:
        done = subprocess.run(
            [sys.executable, __file__, "--one", str(size)], capture_output=True, text=True, check=True
        )
        told = json.loads(done.stdout)
        print(
            f"| {size}³ | {told['visited']:,} | {told['visited'] / size**2:.3f} | {told['cells']:,} |"
            f" {told['triangles']:,} | {told['wall']:.2f} s | {told['processor']:.2f} s |"
            f" {told['peak'] / 2**20:,.0f} MB |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--alone", action="store_true")
    parser.add_argument("--one", type=int)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    if given.one:
        one(given.one)
    elif given.alone:
        alone()
    else:
        compare(given.repeats)


if __name__ == "__main__":
    main()
