"""`blobscript render`: a script in, a picture out."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from blobscript import ir
from blobscript.cli.native import use_native
from blobscript.cli.options import UsageError
from blobscript.cli.program import load_scene
from blobscript.cli.progress import Progress

if TYPE_CHECKING:
    from blobscript.images import Image
    from blobscript.scene import Scene

__all__ = ["DEFAULT_NOISE", "light_options", "run"]

#: What a pixel's error may be where neither --samples nor --noise is given: 2.5 of the 255 steps of a screen.
DEFAULT_NOISE = 0.01

#: Beside parts of the time that are not measured by a clock on the wall.
_NOTES = {"hits": "  (of all processors)", "shading": "  (of all processors)"}


def run(arguments: argparse.Namespace) -> int:
    """What can be refused is refused before the first ray."""
    from blobscript import images
    from blobscript.backends.native import StepError

    _refuse_what_has_no_effect(arguments)
    images.check_output(arguments.output, arguments.bits, bool(arguments.aov))
    begin = time.perf_counter()
    scene = load_scene(arguments)
    compiled = time.perf_counter() - begin
    width, height = arguments.size or (scene.ir.width, scene.ir.height)
    _check_region(arguments.region, width, height)
    if arguments.native:
        use_native(scene, arguments, width, height, light_options(arguments, scene.ir.tone))
    progress = Progress("rendering")
    start = time.perf_counter()
    try:
        image = _rendered(scene, arguments, width, height, progress)
    except StepError as mistake:
        raise UsageError(f"--step: {mistake}\n  = help: --search sandwich takes no step and misses nothing") from None
    seconds = time.perf_counter() - start
    progress.finish()
    image.metadata |= {"command": shlex.join(["blobscript", *sys.argv[1:]]), "script": arguments.file}
    begin = time.perf_counter()
    written = image.save(arguments.output, arguments.bits)
    timing = {"compile": compiled, **image.timing, "output": time.perf_counter() - begin}
    _report(arguments, written, image.width, image.height, seconds, timing)
    return 0


def _rendered(scene: Scene, arguments: argparse.Namespace, width: int, height: int, progress: Progress) -> Image:
    return scene.render(
        width=width,
        height=height,
        **light_options(arguments, scene.ir.tone),
        threads=arguments.threads,
        aov=arguments.aov,
        seed=arguments.seed,
        region=arguments.region,
        search=arguments.search,
        index=arguments.index,
        normals=arguments.normals,
        tolerance=arguments.tolerance,
        step=arguments.step,
        normal_step=arguments.normal_step,
        progress=progress,
    )


def light_options(arguments: argparse.Namespace, tone: ir.Tone) -> dict[str, Any]:
    """The options of `_light_options` as `Scene.render` takes them: without --samples the noise decides."""
    samples, noise = arguments.samples, arguments.noise
    curve = arguments.tone or tone.curve
    exposure = tone.exposure if arguments.exposure is None else arguments.exposure
    return {
        "samples": samples or 1,
        "noise": DEFAULT_NOISE if samples is None and noise is None else noise,
        "indirect": arguments.indirect,
        "tone": ir.Tone(curve, exposure),
        "transparent": arguments.transparent,
    }


def _refuse_what_has_no_effect(arguments: argparse.Namespace) -> None:
    """An option that would be ignored is a mistake."""
    if arguments.transparent and Path(arguments.output).suffix.lower() in (".jpg", ".jpeg"):
        raise UsageError("--transparent has no effect on JPEG, which has no alpha\n  = help: write .png or .exr")
    if arguments.step is not None and arguments.search != "march":
        raise UsageError(f"--step has no effect on the search `{arguments.search}`\n  = help: --search march")
    if arguments.normal_step is not None and arguments.normals == "analytic":
        raise UsageError("--normal-step has no effect on analytic normals\n  = help: --normals forward or central")


def _check_region(region: tuple[int, int, int, int] | None, width: int, height: int) -> None:
    if region and (region[2] > width or region[3] > height):
        shown = ",".join(map(str, region))
        raise UsageError(f"--region {shown} is not inside the picture of {width}x{height} pixels")


def _report(
    arguments: argparse.Namespace,
    written: tuple[Path, ...],
    width: int,
    height: int,
    seconds: float,
    timing: dict[str, float],
) -> None:
    if arguments.format == "json":
        files = [str(path) for path in written]
        told = {"diagnostics": [], "files": files, "width": width, "height": height, "seconds": seconds}
        print(json.dumps(told | {"timing": timing} if arguments.timing else told))
        return
    if arguments.timing:
        print(
            "".join(f"{part:8} {1000 * value:9.1f} ms{_NOTES.get(part, '')}\n" for part, value in timing.items()),
            end="",
        )
    for path in written:
        print(f"{path}: {width}x{height}, rendered in {seconds:.2f} s", file=sys.stderr)
