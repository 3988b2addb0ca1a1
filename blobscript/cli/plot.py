"""`blobscript plot`: figures of kernels, of a slice through the field, of the search along a ray."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from blobscript import ir
from blobscript.cli.figures import check_figure, write_figure
from blobscript.cli.options import UsageError
from blobscript.cli.program import load_scene
from blobscript.diagnostics import ProgramError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from blobscript.plots.elements import Ray
    from blobscript.scene import Scene

__all__ = ["pixel_ray", "run"]

#: Options and the figures that they belong to.
_OF = {
    "threshold": ("kernel",),
    "weight": ("kernel",),
    "plane": ("slice",),
    "surface": ("slice", "ray"),
    "pixel": ("ray",),
    "size": ("ray",),
    "origin": ("ray",),
    "direction": ("ray",),
}
_SHOWN = {"origin": "--from", "direction": "--toward"}


def run(arguments: argparse.Namespace) -> int:
    _refuse_what_has_no_effect(arguments)
    check_figure(arguments.output)
    scripts = [word for word in arguments.items if word == "-" or word.endswith(".blob")]
    names = [word for word in arguments.items if word not in scripts]
    _check_items(arguments.what, scripts, names)
    scene = None
    if scripts:
        arguments.file = scripts[0]
        scene = load_scene(arguments)
    write_figure(arguments.output, _figure(arguments, scene, names))
    if arguments.format == "json":
        print(json.dumps({"diagnostics": [], "files": [arguments.output]}))
    else:
        print(f"{arguments.output}: {arguments.what}", file=sys.stderr)
    return 0


def _refuse_what_has_no_effect(arguments: argparse.Namespace) -> None:
    for name, kinds in _OF.items():
        if getattr(arguments, name) is not None and arguments.what not in kinds:
            option = _SHOWN.get(name, "--" + name)
            raise UsageError(f"{option} has no effect on `plot {arguments.what}`, only on {' and '.join(kinds)}")
    if (arguments.origin is None) != (arguments.direction is None):
        raise UsageError("--from and --toward belong together\n  = help: --from 0,0,5 --toward 0,0,-1")
    if arguments.direction is not None and not any(arguments.direction):
        raise UsageError("--toward 0,0,0 is no direction")
    if arguments.origin is not None and (arguments.pixel or arguments.size):
        raise UsageError("either --pixel or --from and --toward say which ray, not both")
    if arguments.weight == 0.0:
        raise UsageError("--weight 0 leaves nothing to draw")


def _check_items(what: str, scripts: Sequence[str], names: Sequence[str]) -> None:
    if len(scripts) > 1:
        raise UsageError(f"one script at a time, please: {', '.join(scripts)}")
    if what == "kernel":
        if not scripts and not names:
            raise UsageError(
                "which kernels? Name them, or give a script\n"
                "  = help: blobscript plot kernel soft3 wyvill -o kernels.svg"
            )
    elif names:
        raise UsageError(f"`{names[0]}` is no script (FILE.blob)")
    elif not scripts:
        raise UsageError(f"plot {what} wants a script\n  = help: blobscript plot {what} scene.blob -o {what}.svg")


def _figure(arguments: argparse.Namespace, scene: Scene | None, names: Sequence[str]) -> Figure:
    from blobscript import plots

    if arguments.what == "kernel" or scene is None:
        return _kernels(arguments, scene, names)
    surface = surface_number(scene, arguments.surface)
    if arguments.what == "slice":
        plane = plots.Plane(*arguments.plane) if arguments.plane else None
        return plots.plot_slice(scene, plane, surface)
    if arguments.origin is not None:
        return plots.plot_ray(scene, np.array(arguments.origin), np.array(arguments.direction), surface)
    width, height = arguments.size or (scene.ir.width, scene.ir.height)
    x, y = arguments.pixel or telling_pixel(scene, width, height)
    ray = pixel_ray(scene, x, y, width, height)
    what = f"through pixel {x},{y} of {width}x{height}"
    return plots.plot_ray(scene, ray.origin, ray.direction, surface, what)


# ---- which surface, which ray ------------------------------------------------------------------


def surface_number(scene: Scene, name: str | None) -> int | None:
    """By name, or by number from 1."""
    if name is None:
        return None
    for number, surface in enumerate(scene.surfaces):
        if name in (surface.name, str(number + 1)):
            return number
    known = ", ".join(f"{number + 1}: {surface.name}" for number, surface in enumerate(scene.surfaces[:12]))
    raise UsageError(f"there is no surface `{name}`\n  = help: --surface takes a name or number: {known}")


def pixel_ray(scene: Scene, x: int, y: int, width: int, height: int) -> Ray:
    """Through the middle of a pixel."""
    from blobscript.framing import pixel_rays
    from blobscript.plots.elements import Ray

    if x >= width or y >= height:
        raise UsageError(f"there is no pixel {x},{y} in a picture of {width}x{height}\n  = help: --size WxH")
    origins, directions = pixel_rays(scene.ir, width, height, np.array([float(x)]), np.array([float(y)]))
    return Ray(origins[0], directions[0] / np.linalg.norm(directions[0]))


def telling_pixel(scene: Scene, width: int, height: int) -> tuple[int, int]:
    """The hit nearest to the middle, else the middle."""
    from blobscript.framing import pixel_rays

    step = max(1, min(width, height) // 120)
    ys, xs = np.mgrid[step // 2 : height : step, step // 2 : width : step].reshape(2, -1)
    origins, directions = pixel_rays(scene.ir, width, height, xs.astype(float), ys.astype(float))
    hit = np.flatnonzero(scene.first_hit(origins, directions).hit)
    if len(hit) == 0:
        return width // 2, height // 2
    best = hit[np.argmin((xs[hit] - width / 2) ** 2 + (ys[hit] - height / 2) ** 2)]
    return int(xs[best]), int(ys[best])


# ---- kernels -----------------------------------------------------------------------------------


def _kernels(arguments: argparse.Namespace, scene: Scene | None, names: Sequence[str]) -> Figure:
    from blobscript.plots import plot_kernel

    shown = [*(_named_kernel(name) for name in names), *(_kernels_of(scene) if scene else ())]
    threshold = arguments.threshold
    if threshold is None:
        threshold = scene.surfaces[0].threshold if scene else 0.5
    return plot_kernel(list(dict.fromkeys(shown)), threshold, arguments.weight or 1.0)


def _kernels_of(scene: Scene) -> Iterator[ir.Kernel]:
    """All that blobs of the scene have, in the order of the script."""
    stack: list[ir.Field] = [surface.field for surface in reversed(scene.surfaces)]
    while stack:
        match stack.pop():
            case ir.Leaf() as leaf:
                yield leaf.kernel
            case ir.Node(_, children):
                stack.extend(reversed(children))


def _named_kernel(text: str) -> ir.Kernel:
    """Built in or of std.kernels, as a script would write it."""
    from blobscript import kernels
    from blobscript.driver import compile as compiled

    name = re.match(r"\s*(\w+)", text)
    imports = "" if name is None or name[1] in kernels.KERNELS else f"import {name[1]} from std.kernels\n"
    script = f"{imports}surface(sum(kernel = {text}) {{ point(0, 0, 0).blob(reach = 1, weight = 1) }})"
    try:
        return next(_kernels_of(compiled(script, "<kernel>")))
    except ProgramError as error:
        known = ", ".join([*kernels.KERNELS])
        raise UsageError(
            f"`{text}` is no kernel: {error.diagnostics[0].message}\n"
            f"  = help: built in are {known}; std.kernels has more; those of a script come with it: plot kernel x.blob"
        ) from error
