"""Whole pictures against POV-Ray: one sun with hard shadows, 9 samples per pixel, and what shading costs beside hits.

    python tests/bench/bench_shading.py

The scenes and the view of bench_points.py, 640 x 480, one thread. POV-Ray renders 1920 x 1440 without antialiasing,
which is 9 samples per pixel in the cheapest way it has; here it is `render(samples=9, indirect="even")`. The same
sun and shadows, no ambient light there, a diffuse surface. Processor time of POV-Ray's trace phase against ours for
the whole picture; least of several runs, order alternating.
"""

from __future__ import annotations

import argparse
import math
import shutil
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import bench_points
import numpy as np

from blobscript import Scene, ir
from blobscript.source import Source, Span

SUN = ir.Sun((-0.5, -0.8, -0.6), (3.0, 3.0, 3.0), 0.0)


def lit(count: int) -> Scene:
    """Points of bench_points under a sun, seen from where its rays start."""
    at = tuple(map(float, bench_points.EYE))
    camera = ir.Camera((at[0], at[1], at[2]), (0, 0, 0), (0, 1, 0), bench_points.FOV, Span(Source("bench", ""), 0, 0))
    matt = ir.Material((0.8, 0.8, 0.8), roughness=0.0, specular=0.0)
    plain = bench_points.points(count, 8).ir
    return Scene(replace(plain, camera=camera, lights=(SUN,), materials=(matt,)))


def pov_text(scene: Scene) -> str:
    leaf = scene.ir.surfaces[0].field
    assert isinstance(leaf, ir.Leaf)
    x, y, z = (-1000 * bench_points.UNIT * np.array(SUN.toward)).tolist()
    text = bench_points.pov_text(leaf)
    lines = [
        f"light_source {{ <{x}, {y}, {z}> rgb 3 parallel point_at 0 }}" if line.startswith("light_source") else line
        for line in text.splitlines()
    ]
    return "\n".join(lines).replace("pigment { rgb 1 }", "pigment { rgb 0.8 } finish { ambient 0 diffuse 0.318 }")


def our_seconds(scene: Scene) -> tuple[float, float, float]:
    """Processor seconds of all, of hits, and of shading."""
    start = time.process_time()
    image = scene.render(bench_points.WIDTH, bench_points.HEIGHT, samples=9, indirect="even", threads=1)
    return time.process_time() - start, image.timing["hits"], image.timing["shading"]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sizes", default="10,100,1000,10000", help="numbers of points")
    parser.add_argument("--runs", type=int, default=3)
    arguments = parser.parse_args()
    if not shutil.which("povray"):
        sys.exit("povray is not installed: apt-get install povray")
    tripled = (3 * bench_points.WIDTH, 3 * bench_points.HEIGHT)
    print("| points | POV-Ray, s | blobscript, s | ratio | of that hits, s | shading, s |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for count in map(int, arguments.sizes.split(",")):
            scene, file = lit(count), Path(folder) / "scene.pov"
            file.write_text(pov_text(scene), encoding="ascii")
            theirs, ours = math.inf, (math.inf, 0.0, 0.0)
            for _ in range(arguments.runs):
                theirs = min(theirs, bench_points.pov_seconds(file, tripled))
                ours = min(ours, our_seconds(scene))
            row = (theirs, ours[0], theirs / ours[0], ours[1], ours[2])
            print(f"| {count} | " + " | ".join(f"{x:.2f}" for x in row) + " |", flush=True)


if __name__ == "__main__":
    main()
