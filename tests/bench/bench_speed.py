"""Every figure of speed that README quotes, in one run with POV-Ray:

    python tests/bench/bench_speed.py --out speed           # writes speed/speed.md and speed/scaling.svg
    python tests/bench/bench_speed.py --only scaling,threads

The parts:

    points       first hits of 10 to 100 000 points with 8 neighbours, 100 000 with 100, and 1 000 lines, against
                 POV-Ray's `blob`, as it is and with `sturm` (its slower, safer root finder)
    crowded      the 100 000 points with 100 neighbours in a small picture, for which POV-Ray takes seconds
    pictures     `render` against POV-Ray, one light with shadows on both sides
    isosurface   100 points against POV-Ray's `isosurface`, at 160 x 120
    cubes        512 x 512 rays, 1 000 points of (1 - r^2)^3, against the 1 000 points above
    scaling      time per ray over 10 to 1 000 000 points, in a picture, close by, in any order; the index of a million
    threads      one thread against all

What is measured and how: `bench_points.py`. POV-Ray's time is its trace phase; its parsing is not counted, nor is our
packing. Ratios of one run are what to trust; each side counts its least time.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import bench_points as points
import numpy as np

from blobscript import Scene, ir

#: Light that casts shadows, in scene units.
LAMP = (2.0, 3.0, 2.5)
SIZES = (10, 100, 1000, 10_000, 100_000)
_CROWDED = f"{SIZES[-1]} points, 100 neighbours"
SCALES = (10, 100, 1000, 10_000, 100_000, 1_000_000)


def least(measure: Callable[[], float], runs: int) -> float:
    return min(measure() for _ in range(runs))


def leaf_of(scene: Scene) -> ir.Leaf:
    leaf = scene.ir.surfaces[0].field
    assert isinstance(leaf, ir.Leaf)
    return leaf


def processor_time(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def pov_time(text: str, runs: int, size: tuple[int, int] = (points.WIDTH, points.HEIGHT)) -> float:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.pov"
        file.write_text(text, encoding="ascii")
        return least(lambda: points.pov_seconds(file, size), runs)


# ---- the parts -----------------------------------------------------------------------------------


def first_hits(runs: int, crowded: bool) -> Iterator[str]:
    origins, directions = points.rays()
    yield "| scene | POV-Ray, ms | with sturm, ms | blobscript, ms | ratio | to sturm | hits | evaluations per ray |"
    yield "|---|---|---|---|---|---|---|---|"
    cases = [(f"{n} points, 8 neighbours", points.points(n, 8), runs) for n in SIZES]
    if crowded:
        cases.append((_CROWDED, points.points(SIZES[-1], 100), 1))
    cases.append(("1000 lines", points.lines(1000), runs))
    for name, scene, repeats in cases:
        text = points.pov_text(leaf_of(scene))
        hits = scene.first_hit(origins, directions, threads=1)
        theirs, ours = math.inf, math.inf
        for _ in range(repeats):  # in turn, so that both see the same load
            theirs = min(theirs, pov_time(text, 1))
            ours = min(ours, least(lambda s=scene: points.our_seconds(s, origins, directions), 5))
        careful = pov_time(text.replace("pigment", "sturm pigment"), 1) if name != _CROWDED else math.nan
        yield (
            f"| {name} | {1e3 * theirs:.0f} | {1e3 * careful:.0f} | {1e3 * ours:.1f} | {theirs / ours:.1f} | "
            f"{careful / ours:.1f} | {hits.hit.mean():.0%} | {hits.evaluations.mean():.1f} |"
        )


def crowded(runs: int) -> Iterator[str]:
    size = (160, 128)
    scene, rays = points.points(SIZES[-1], 100), points.rays(*size)
    theirs = pov_time(points.pov_text(leaf_of(scene)), 1, size)
    ours = least(lambda: points.our_seconds(scene, *rays), 5 * runs)
    yield "| scene, 160×128 | POV-Ray, ms | blobscript, ms | ratio |"
    yield "|---|---|---|---|"
    yield f"| {_CROWDED} | {1e3 * theirs:.0f} | {1e3 * ours:.1f} | {theirs / ours:.0f} |"


def lit(scene: Scene) -> Scene:
    """The same, seen as POV-Ray sees it, with one lamp."""
    camera = ir.Camera(tuple(map(float, points.EYE)), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), points.FOV)
    return Scene(replace(scene.ir, camera=camera, lights=(ir.Lamp(LAMP, (20.0, 20.0, 20.0)),)))


def pictures(runs: int) -> Iterator[str]:
    yield "| picture with shadows | POV-Ray, ms | blobscript, ms | ratio |"
    yield "|---|---|---|---|"
    at = ",".join(f"{v * points.UNIT:.17g}" for v in LAMP)
    for count in SIZES:
        scene = lit(points.points(count, 8))
        text = points.pov_text(leaf_of(scene)).split("\n")
        text = "\n".join(f"light_source {{ <{at}> rgb 1 }}" if "light_source" in t else t for t in text)
        theirs, ours = math.inf, math.inf
        for _ in range(runs if count > 1000 else max(runs, 8)):
            theirs = min(theirs, pov_time(text, 1))
            picture = lambda s=scene: s.render(points.WIDTH, points.HEIGHT, threads=1)  # noqa: E731
            ours = min(ours, least(lambda p=picture: processor_time(p), 3))
        yield f"| {count} points | {1e3 * theirs:.0f} | {1e3 * ours:.1f} | {theirs / ours:.1f} |"


def isosurface_text(leaf: ir.Leaf, steepest: float) -> str:
    assert isinstance(leaf.skeleton, ir.Points)
    text = points.pov_text(leaf).split("\n")
    terms = " + ".join(f"D(x,y,z,{a:.9g},{b:.9g},{c:.9g})" for a, b, c in leaf.skeleton.at * points.UNIT)
    reach = float(leaf.reach[0]) * points.UNIT
    side = 0.5 * points.UNIT + reach
    density = f"pow(max(0, 1 - ((x-a)*(x-a) + (y-b)*(y-b) + (z-c)*(z-c)) / {reach * reach:.17g}), 2)"
    return "\n".join(
        [
            *text[:3],
            f"#declare D = function(x, y, z, a, b, c) {{ {density} }}",
            f"isosurface {{ function {{ {points.THRESHOLD} - ({terms}) }}",
            f"contained_by {{ box {{ -{side}, {side} }} }} max_gradient {steepest / points.UNIT:.6g} accuracy 0.001",
            "pigment { rgb 1 } }",
        ]
    )


def isosurface(runs: int) -> Iterator[str]:
    """max_gradient is the largest at a hundred thousand places: less would be wrong, a proved bound is slower."""
    size = (160, 120)
    scene = points.points(100, 8)
    places = np.random.default_rng(0).random((100_000, 3)) * 1.6 - 0.8
    steepest = float(np.linalg.norm(scene.gradient(places), axis=1).max())
    theirs = pov_time(isosurface_text(leaf_of(scene), steepest), 1, size)
    origins, directions = points.rays(*size)
    ours = least(lambda: points.our_seconds(scene, origins, directions), 5 * runs)
    yield "| 100 points, 160×120 | POV-Ray's isosurface, ms | blobscript, ms | ratio |"
    yield "|---|---|---|---|"
    yield f"| first hits | {1e3 * theirs:.0f} | {1e3 * ours:.2f} | {theirs / ours:.0f} |"


def cubes(runs: int) -> Iterator[str]:
    scene = points.points(1000, 8)
    leaf = leaf_of(scene)
    surface = replace(scene.ir.surfaces[0], field=replace(leaf, kernel=ir.Kernel("soft3")), threshold=0.2)
    cubed = Scene(replace(scene.ir, surfaces=(surface,)))
    rays = points.rays(512, 512)
    theirs, ours = math.inf, math.inf
    for _ in range(runs):
        theirs = min(theirs, pov_time(points.pov_text(leaf), 1))
        ours = min(ours, least(lambda: points.our_seconds(cubed, *rays), 5))
    yield "| 512×512, 1 000 points of (1 − r²)³ | POV-Ray's 1 000 points, ms | share |"
    yield "|---|---|---|"
    yield f"| {1e3 * ours:.1f} ms | {1e3 * theirs:.0f} | {ours / theirs:.3f} |"


def overlap(scene: Scene, origins: np.ndarray, directions: np.ndarray, count: int = 200) -> tuple[float, float]:
    """Points whose reach a ray enters before its hit, and all along: means over some of the rays."""
    pick = np.random.default_rng(0).permutation(len(origins))[:count]
    hits = scene.first_hit(origins[pick], directions[pick], threads=1)
    leaf = leaf_of(scene)
    assert isinstance(leaf.skeleton, ir.Points)
    away = leaf.skeleton.at - origins[0]  # all rays start there
    away2, reach2 = np.einsum("ij,ij->i", away, away), leaf.reach**2
    met = np.zeros(2)
    for direction, t in zip(directions[pick], np.where(hits.hit, hits.t, math.inf), strict=True):
        tau = away @ (direction / np.linalg.norm(direction))
        inside = reach2 - (away2 - tau * tau)
        ahead = inside > 0.0
        enter = tau[ahead] - np.sqrt(inside[ahead])
        met += np.sum(enter < t), enter.size
    return met[0] / count, met[1] / count


def closer(directions: np.ndarray, count: int) -> np.ndarray:
    """Through the middle of the picture, so narrow that as many rays meet each point as at half the width of 1 000."""
    forward = points.view()[0]
    return forward + (directions - forward) * (0.5 * (1000.0 / count) ** (1.0 / 3.0))


def scaling(runs: int, folder: Path | None) -> Iterator[str]:
    origins, directions = points.rays()
    shuffled = np.random.default_rng(0).permutation(len(origins))[:60_000]
    yield "| points | index, s | ns per ray | overlap | to the hit | candidates | evaluations | close by | any order |"
    yield "|---|---|---|---|---|---|---|---|---|"
    curves: dict[str, list[float]] = {"picture": [], "close": [], "order": [], "work": [], "all": []}
    for count in SCALES:
        scene = points.points(count, 8)
        native = scene._native
        built = processor_time(native.index_pointer)
        hits = native.first_hit(origins, directions, threads=1, counters=True)

        def each(o: np.ndarray, d: np.ndarray, scene: Scene = scene) -> float:
            return 1e9 * least(lambda: points.our_seconds(scene, o, d), 3 * runs) / len(o)

        met, crossed = overlap(scene, origins, directions)
        curves["work"].append(met + math.log2(count))
        curves["all"].append(crossed + math.log2(count))
        curves["picture"].append(each(origins, directions))
        curves["close"].append(each(origins, closer(directions, count)) if count >= 1000 else math.nan)
        curves["order"].append(each(origins[shuffled], directions[shuffled]))
        yield (
            f"| {count} | {built:.3f} | {curves['picture'][-1]:.0f} | {crossed:.1f} | {met:.1f} | "
            f"{float(hits.counters['candidates'].mean()):.1f} | {hits.evaluations.mean():.1f} | "
            f"{'' if math.isnan(curves['close'][-1]) else round(curves['close'][-1])} | {curves['order'][-1]:.0f} |"
        )
    if folder:
        draw(folder / "scaling.svg", curves)


def draw(file: Path, curves: dict[str, list[float]]) -> None:
    """Time per ray, beside what it may grow like: overlap along the ray plus log2 N, drawn to touch the picture at 10:
    that to the hit, which is all that has to be looked at, and that of the whole ray."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    for name, color, label in (
        ("order", "#8a5a83", "rays in any order"),
        ("picture", "#2a6f97", "picture of 640×480"),
        ("close", "#d97b29", "as many rays per point as at 1 000"),
    ):
        axes.loglog(SCALES, curves[name], "o-", color=color, label=label)
    for name, style, label in (
        ("all", "--", "overlap along the ray + log₂ N"),
        ("work", ":", "the same up to the hit"),
    ):
        allowed = [w * curves["picture"][0] / curves[name][0] for w in curves[name]]
        axes.loglog(SCALES, allowed, style, color="#777777", label=label)
    axes.set_xlabel("points, each overlapping 8 others")
    axes.set_ylabel("time per ray, ns")
    axes.set_ylim(bottom=10)
    axes.grid(which="major", alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "scaling"}):  # letters as letters: a small file
        figure.savefig(file, metadata={"Date": None})


def threads(runs: int) -> Iterator[str]:
    """Wall clock: on a machine with other work the speed-up is smaller than it could be."""
    origins, directions = points.rays()
    scene = points.points(100_000, 8)
    yield "| threads | ms | speed-up |"
    yield "|---|---|---|"
    best = dict.fromkeys(range(1, (os.cpu_count() or 1) + 1), math.inf)
    for _ in range(10 * runs):
        for number in best:
            start = time.perf_counter()
            scene.first_hit(origins, directions, threads=number)
            best[number] = min(best[number], time.perf_counter() - start)
    for number, seconds in best.items():
        yield f"| {number} | {1e3 * seconds:.1f} | {best[1] / seconds:.2f} |"


# ---- all of them ---------------------------------------------------------------------------------


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for speed.md and scaling.svg")
    parser.add_argument("--only", default="points,pictures,isosurface,cubes,scaling,threads", help="parts")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="without 100 neighbours, which take POV-Ray minutes")
    arguments = parser.parse_args()
    if arguments.out:
        arguments.out.mkdir(parents=True, exist_ok=True)
    parts: dict[str, Callable[[], Iterator[str]]] = {
        "points": lambda: first_hits(arguments.runs, not arguments.quick),
        "crowded": lambda: crowded(arguments.runs),
        "pictures": lambda: pictures(arguments.runs),
        "isosurface": lambda: isosurface(arguments.runs),
        "cubes": lambda: cubes(arguments.runs),
        "scaling": lambda: scaling(arguments.runs, arguments.out),
        "threads": lambda: threads(arguments.runs),
    }
    if unknown := [name for name in arguments.only.split(",") if name not in parts]:
        sys.exit(f"no such part: {', '.join(unknown)}; there are {', '.join(parts)}")
    if not shutil.which("povray"):
        sys.exit("povray is not installed: apt-get install povray")
    lines: list[str] = []
    for name in arguments.only.split(","):
        for line in (f"## {name}", "", *parts[name](), ""):
            lines.append(line)
            print(line, flush=True)
    if arguments.out:
        (arguments.out / "speed.md").write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
