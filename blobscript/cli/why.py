"""`blobscript why`: the terms that make a pixel, each with its value and its line of the script."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from blobscript.cli.figures import check_figure, write_figure
from blobscript.cli.options import UsageError
from blobscript.cli.program import load_scene

if TYPE_CHECKING:
    from blobscript.plots.pixel import Pixel, Term

__all__ = ["run"]

#: Terms shown as text; all of them are in the JSON.
_MOST_TERMS = 24
_EXCERPT = 48


def run(arguments: argparse.Namespace) -> int:
    from blobscript.plots.pixel import explain_pixel

    if arguments.output:
        check_figure(arguments.output)
    scene = load_scene(arguments)
    width, height = arguments.size or (scene.ir.width, scene.ir.height)
    x, y = arguments.pixel
    if x >= width or y >= height:
        raise UsageError(f"there is no pixel {x},{y} in a picture of {width}x{height}\n  = help: --size WxH")
    pixel = explain_pixel(scene, x, y, width, height)
    if arguments.output:
        from blobscript.plots.why import plot_why

        write_figure(arguments.output, plot_why(pixel))
    if arguments.format == "json":
        print(json.dumps(_facts(pixel, arguments), indent=1, ensure_ascii=False))
    else:
        sys.stdout.write("".join(f"{line}\n" for line in _lines(pixel, arguments.file)))
        if arguments.output:
            print(f"{arguments.output}: why", file=sys.stderr)
    return 0


# ---- text --------------------------------------------------------------------------------------


def _lines(pixel: Pixel, file: str) -> Iterator[str]:
    yield f"{file}, pixel {pixel.x},{pixel.y} of {pixel.width}x{pixel.height}: {_hex(pixel.shown)}"
    yield f"ray      from {_vector(pixel.ray.origin)} towards {_vector(pixel.ray.direction)}"
    surface = pixel.scene.surfaces[pixel.surface]
    if pixel.is_hit:
        how = "leaves" if pixel.status == "exit" else "enters"
        yield f"hit      {how} {surface.name} at t = {pixel.t:.10g}, {_vector(pixel.hits.position[0])}"
        yield f"normal   {_vector(pixel.hits.normal[0])}"
        if pixel.color is not None:
            yield f"colour   {_hex(_encoded(pixel.color))} before light falls on it"
    elif pixel.point is None:
        yield "no hit   the ray comes near to nothing: what is seen is the background"
    else:
        short = pixel.threshold - pixel.value
        touch = "touches" if pixel.status == "graze" else "comes nearest to"
        yield f"no hit   it {touch} {surface.name} at t = {pixel.t:.6g}, {short:.4g} below the threshold"
    yield f"search   {int(pixel.hits.evaluations[0])} evaluations"
    if pixel.point is not None:
        yield f"density  {pixel.value:.6g}, threshold {pixel.threshold:g}, of these terms:"
        yield ""
        yield from _term_lines(pixel)


def _term_lines(pixel: Pixel) -> Iterator[str]:
    """A tree: operations with their result, elements by size below them."""
    shown = {id(term) for term in pixel.elements[:_MOST_TERMS]}
    yield f"{'value':>12}  term"
    for term in pixel.terms:
        if term.element is None or id(term) in shown:
            yield _term_line(term)
    rest = pixel.elements[_MOST_TERMS:]
    if rest:
        yield f"{sum(term.value for term in rest):12.6g}  {len(rest)} smaller ones, together"
    if any(not term.counts for term in pixel.terms):
        yield f"{'':12}  (x): another one wins the max or min, this one has no say here"


def _term_line(term: Term) -> str:
    mark = "" if term.counts else "(x) "
    indent = "  " * term.depth
    if term.element is None:
        return f"{term.value:12.6g}  {indent}{mark}{term.operation} of"
    element = term.element
    what = f"{element.kind} {element.number + 1}: weight {element.weight:.4g}, {term.distance:.3f} reaches away"
    place = element.place
    if place is None:
        return f"{term.value:12.6g}  {indent}{mark}{what}"
    return f"{term.value:12.6g}  {indent}{mark}{what}   {place.source.path}:{place.line}  {_excerpt(place.text)}"


def _excerpt(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _EXCERPT else line[: _EXCERPT - 1] + "…"


def _vector(v: Any) -> str:
    return "(" + ", ".join(f"{float(x) + 0.0:.6g}" for x in v) + ")"


def _hex(color: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(255 * min(max(x, 0.0), 1.0)):02x}" for x in color)


def _encoded(linear: tuple[float, float, float]) -> tuple[float, float, float]:
    import numpy as np

    from blobscript.images import srgb_encode

    r, g, b = srgb_encode(np.array(linear, dtype=np.float32))
    return float(r), float(g), float(b)


# ---- JSON --------------------------------------------------------------------------------------


def _facts(pixel: Pixel, arguments: argparse.Namespace) -> dict[str, object]:
    hit = pixel.is_hit
    return {
        "file": arguments.file,
        "pixel": [pixel.x, pixel.y],
        "size": [pixel.width, pixel.height],
        "color": _hex(pixel.shown),
        "base_color": _hex(_encoded(pixel.color)) if pixel.color else None,
        "ray": {"origin": list(pixel.ray.origin), "direction": list(pixel.ray.direction)},
        "status": pixel.status,
        "surface": pixel.scene.surfaces[pixel.surface].name,
        "t": pixel.t if math.isfinite(pixel.t) else None,
        "point": None if pixel.point is None else list(pixel.point),
        "normal": list(pixel.hits.normal[0]) if hit else None,
        "evaluations": int(pixel.hits.evaluations[0]),
        "density": pixel.value,
        "threshold": pixel.threshold,
        "terms": [_term_facts(term) for term in pixel.terms],
        "files": [arguments.output] if arguments.output else [],
    }


def _term_facts(term: Term) -> dict[str, object]:
    facts: dict[str, object] = {"depth": term.depth, "value": term.value, "counts": term.counts}
    if term.element is None:
        return {**facts, "operation": term.operation}
    element, place = term.element, term.element.place
    facts |= {
        "element": element.number + 1,
        "skeleton": element.kind,
        "kernel": element.kernel.name,
        "weight": element.weight,
        "reach": element.reach,
        "distance_in_reaches": term.distance,
    }
    if place is not None:
        facts |= {"path": place.source.path, "line": place.line, "column": place.column, "text": place.text}
    return facts
