"""`blobscript info`: what a scene or a finished picture contains."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any, get_args

from blobscript import ir
from blobscript.cli.needs import print_needs
from blobscript.cli.options import UsageError
from blobscript.cli.params import parameter_lines, schema
from blobscript.cli.program import load_scene

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    from blobscript import images

    endings = {ending for form in images.FORMATS for ending in form.endings}
    picture = Path(arguments.file).suffix.lower() in endings
    if arguments.needs:
        if picture:
            raise UsageError("--needs is about scripts, not pictures\n  = help: blobscript info FILE.blob --needs")
        return print_needs(load_scene(arguments), arguments)
    facts = _picture(arguments.file) if picture else _scene(arguments)
    if arguments.format == "json":
        print(json.dumps(facts, indent=1, ensure_ascii=False))
    else:
        sys.stdout.write("".join(f"{line}\n" for line in (_picture_lines if picture else _scene_lines)(facts)))
    return 0


# ---- pictures ------------------------------------------------------------------------------


def _picture(path: str) -> dict[str, object]:
    from blobscript import images

    image = images.read(path)
    return {
        "file": path,
        "width": image.width,
        "height": image.height,
        "layers": sorted(image.aov),
        "provenance": image.metadata,
    }


def _picture_lines(facts: dict[str, Any]) -> list[str]:
    lines = [f"{facts['file']}: a picture of {facts['width']} x {facts['height']} pixels"]
    layers = facts["layers"]
    if layers:
        lines.append("layers: " + ", ".join(layers))
    provenance = facts["provenance"]
    lines += [f"{key}: {value}" for key, value in provenance.items()]
    return lines if provenance else [*lines, "not made by blobscript, or its notes were removed"]


# ---- scenes --------------------------------------------------------------------------------


def _scene(arguments: argparse.Namespace) -> dict[str, object]:
    scene = load_scene(arguments)
    data = scene.ir
    camera = data.camera
    return {
        "file": arguments.file,
        "surfaces": [_surface(surface) for surface in data.surfaces],
        "materials": len(data.materials),
        "lights": len(data.lights),
        "camera": {
            "from": camera.at,
            "to": camera.to,
            "up": camera.up,
            "fov": math.degrees(camera.fov),
            "default": camera.span is None,
        },
        "image": [data.width, data.height],
        "animate": {"seconds": data.animate.seconds, "fps": data.animate.fps} if data.animate else None,
        "parameters": schema(data.params, arguments.file)["properties"],
        "parameter_lines": parameter_lines(data.params),
        "sources": [{"path": path, "sha256": digest} for path, digest in data.sources],
        "hash": scene.hash,
    }


def _surface(surface: ir.Surface) -> dict[str, object]:
    from blobscript import field

    lo, hi = field.extent(surface.field)
    kinds: dict[str, int] = {}
    nodes: dict[str, int] = dict.fromkeys(get_args(ir.Op), 0)
    kernels: set[str] = set()
    _count(surface.field, kinds, nodes, kernels)
    return {
        "name": surface.name,
        "threshold": surface.threshold,
        "blobs": sum(kinds.values()),
        "skeletons": kinds,
        "nodes": {op: count for op, count in nodes.items() if count},
        "kernels": sorted(kernels),
        "bounds": [[_finite(x) for x in lo], [_finite(x) for x in hi]],
    }


def _finite(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


def _count(field: ir.Field, kinds: dict[str, int], nodes: dict[str, int], kernels: set[str]) -> None:
    stack = [field]
    while stack:
        match stack.pop():
            case ir.Node(op, children):
                nodes[op] += 1
                stack.extend(children)
            case ir.Leaf() as leaf:
                kind = type(leaf.skeleton).__name__.lower()
                kinds[kind] = kinds.get(kind, 0) + leaf.count
                kernels.add(leaf.kernel.name)


def _scene_lines(facts: dict[str, Any]) -> list[str]:
    camera, image = facts["camera"], facts["image"]
    surfaces: list[dict[str, Any]] = facts["surfaces"]
    lines = [
        f"{facts['file']}: {_plural(len(surfaces), 'surface')}, {_plural(facts['materials'], 'material')}, "
        f"{_plural(facts['lights'], 'light')}, image {image[0]} x {image[1]}"
    ]
    for surface in surfaces:
        parts = ", ".join(f"{count} in {kind}" for kind, count in surface["skeletons"].items())
        lines.append(
            f"{surface['name']}: threshold {surface['threshold']:g}, {_plural(surface['blobs'], 'blob')} "
            f"({parts}), kernels {', '.join(surface['kernels']) or 'none'}"
        )
        lines.append(f"    within {_point(surface['bounds'][0])} .. {_point(surface['bounds'][1])}")
    chosen = " (chosen to show everything)" if camera["default"] else ""
    lines.append(f"camera from {_point(camera['from'])} to {_point(camera['to'])}, {camera['fov']:.4g}deg high{chosen}")
    if facts["animate"]:
        animate = facts["animate"]
        lines.append(f"film of {animate['seconds']:g} s at {animate['fps']:g} frames per second")
    parameters = facts["parameter_lines"]
    if parameters:
        lines += ["parameters:", *parameters]
    sources = facts["sources"]
    lines += [f"reads {source['path']} (sha256 {source['sha256'][:12]}…)" for source in sources]
    return [*lines, f"scene hash {facts['hash']}"]


def _plural(count: object, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _point(p: list[float | None]) -> str:
    return "(" + ", ".join("unbounded" if x is None else f"{x:.4g}" for x in p) + ")"
