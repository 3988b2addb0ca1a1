"""`blobscript mesh`: a script in, triangles out."""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import TYPE_CHECKING

import numpy as np

from blobscript.cli.options import UsageError
from blobscript.cli.program import load_scene
from blobscript.cli.progress import Progress
from blobscript.outputs import write_text

if TYPE_CHECKING:
    from blobscript.meshing import Options, Part

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    """What can be refused is refused before the work."""
    from blobscript.meshing import bodies, files

    options = _options(arguments)
    files.check_output(arguments.output)
    if arguments.report:
        from blobscript.meshing.account import check_report

        check_report(arguments.report)
    scene = load_scene(arguments)
    progress = Progress("meshing")
    start = time.perf_counter()
    parts = bodies(scene.ir, scene._native, options, progress)  # pyright: ignore[reportPrivateUsage]
    seconds = time.perf_counter() - start
    progress.finish()
    if arguments.report:
        from blobscript.meshing.account import account_of, report_text

        write_text(arguments.report, report_text(arguments.report, account_of(scene, parts, options, seconds)))
    files.save(parts, arguments.output, arguments.unit)
    _tell(arguments, parts, seconds)
    return 0


def _options(arguments: argparse.Namespace) -> Options:
    from blobscript.meshing import Options

    if arguments.adaptive and arguments.tolerance is None:
        raise UsageError("--adaptive has no effect without a tolerance\n  = help: --tolerance 0.01 --adaptive")
    if arguments.refine > 8:
        raise UsageError(f"--refine {arguments.refine} is too much\n  = help: 0 to 8")
    clip = None if arguments.clip is None else (np.array(arguments.clip[0]), np.array(arguments.clip[1]))
    return Options(
        cell=arguments.cell,
        resolution=arguments.resolution,
        tolerance=arguments.tolerance,
        adaptive=arguments.adaptive,
        relax=arguments.relax,
        clip=clip,
        refine=arguments.refine,
        threads=arguments.threads,
    )


def _tell(arguments: argparse.Namespace, parts: list[Part], seconds: float) -> None:
    from blobscript.meshing.measure import topology

    shapes = [topology(part.body.triangles, len(part.body.vertices)) for part in parts]
    hidden = sum(part.body.counts.hidden for part in parts)
    if arguments.format == "json":
        rows = [
            {
                "name": part.name,
                "vertices": len(part.body.vertices),
                "triangles": len(part.body.triangles),
                "components": shape.components,
                "euler": shape.euler,
                "watertight": shape.is_closed,
                "cell": part.cell,
                "distance": part.distance,
                "cells_that_may_hide_something": part.body.counts.hidden,
            }
            for part, shape in zip(parts, shapes, strict=True)
        ]
        print(json.dumps({"diagnostics": [], "files": [arguments.output], "bodies": rows, "seconds": seconds}))
    else:
        count = sum(len(part.body.triangles) for part in parts)
        pieces = sum(shape.components for shape in shapes)
        words = f"{len(parts)} bod{'y' if len(parts) == 1 else 'ies'}, {pieces} component{'s' * (pieces != 1)}"
        print(f"{arguments.output}: {count} triangles, {words}, meshed in {seconds:.2f} s", file=sys.stderr)
    if hidden:
        places = np.concatenate([part.body.counts.places for part in parts])
        where = "({:.3g}, {:.3g}, {:.3g})".format(*places[0])
        print(
            f"note: {hidden} cells may hold parts smaller than they are, near {where}"
            f"{' and elsewhere' if len(places) > 1 else ''}\n  = help: smaller cells, or a larger --refine",
            file=sys.stderr,
        )
