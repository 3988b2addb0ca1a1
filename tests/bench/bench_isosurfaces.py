"""What the proved bounds and the pieces of an isosurface are worth: POV-Ray's time for random points of soft3.

    python tests/bench/bench_isosurfaces.py

One isosurface of all terms with the steepest gradient that 200 000 samples show (times 1.05), which nobody can know
beforehand; the same with the proved bound; and the pieces that `compile --to pov` writes. Processor seconds of the
trace phase on one thread, 160 x 120 pixels.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np

from blobscript import Scene, field
from blobscript.ir import Kernel, Points
from blobscript.povray import document
from blobscript.povray.program import Run, workshop
from blobscript.povray.steepness import proved_gradient, sampled_gradient
from blobscript.povray.units import magnified

sys.path.insert(0, str(Path(__file__).parent.parent))
from random_scenes import make_leaf, make_scene

OPTIONS = ("+Oo.png", "+W160", "+H120", "-D", "-A", "-V", "+Q1", "+WT1")


def seconds(run: Run) -> float:
    found = re.search(r"Trace Time:.*?using \d+ thread\(s\) with ([\d.]+) CPU-seconds total", run.output, re.DOTALL)
    return float(found[1]) if found else float("nan")


def single(text: str, terms: list[str], box: tuple[np.ndarray, np.ndarray], steepest: float) -> str:
    """The scene with one isosurface in the place of its pieces."""
    lo, hi = (", ".join(map(repr, v.tolist())) for v in box)
    whole = (
        f"#declare Surface_1 = isosurface {{ function {{ 0.5-({'+'.join(terms)}) }} "
        f"Piece(<{lo}>, <{hi}>, {steepest!r}) texture {{ Look_1 }} }}"
    )
    start = text.index("#declare Surface_1")
    return text[:start] + whole + "\nobject { Surface_1 }\n"


def main() -> None:
    print("| points | pieces | proved / seen | one, seen, s | one, proved, s | pieces, s |\n|---|---|---|---|---|---|")
    for count, reach in ((5, 0.9), (20, 0.9), (100, 0.75)):
        at = np.random.default_rng(count).uniform(-1, 1, (count, 3))
        scene = make_scene((make_leaf(Points(at), Kernel("soft3"), reach, 1.0), 0.5))
        made = document(scene)
        large = magnified(scene, made.unit).surfaces[0].field
        box = field.extent(large)
        seen, proved = sampled_gradient(large, *box, 200_000) * 1.05, proved_gradient(large, *box)
        terms = sorted(set(re.findall(r"B\d+(?= = function)", made.text)))
        times = []
        with workshop() as shop:
            for text in (
                single(made.text, [f"{t}(x,y,z)" for t in terms], box, seen),
                single(made.text, [f"{t}(x,y,z)" for t in terms], box, proved),
                made.text,
            ):
                times.append(seconds(shop.run(text, OPTIONS, 600.0)))
        hits = Scene(scene).render(160, 120, aov=("surface",)).aov["surface"] >= 0
        pieces = made.text.count("isosurface {")
        print(f"| {count} | {pieces} | {proved / seen * 1.05:.2f} | " + " | ".join(f"{t:.2f}" for t in times) + " |"
              f"  <!-- {int(hits.sum())} hits -->", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
