"""A scene as one self-contained C17 file: the parts of the tracer that it needs, and the scene as constant data.

The text comes from the tracer's own sources, so it is in step with them: their declarations are taken apart
(`units`), conditions that are settled for this scene are folded (`facts`, `folding`), and what `main` does not reach is
left out. No text of the script gets into the file but line numbers and a cleaned file name.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from importlib import resources
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from blobscript import __version__, ir
from blobscript.backends.picture import pack_plain
from blobscript.digest import scene_hash
from blobscript.emitting.data import Tables, array_text, number
from blobscript.emitting.facts import facts_for, families
from blobscript.emitting.folding import Facts, folded
from blobscript.emitting.pruning import members_read, tidied, without_unread
from blobscript.emitting.sources import joined_sources
from blobscript.emitting.units import Macro, Unit, macros_of, reached, split_macro, units_of
from blobscript.framing import Extents, camera_for, default_fit
from blobscript.ir import leaves
from blobscript.needs.names import MANY_SAMPLES, Need, needs_of
from blobscript.pack import SHAPE_TRIANGLE, Packed, pack

__all__ = ["SOURCES", "c_program", "preamble", "present", "reduced", "tracer_alive"]

#: The tracer without its other indexes; octree.c divides many items for bvh.c.
SOURCES = ("index.c", "bvh.c", "engine.c", "trace.c", "shade.c", "plain.c", "octree.c")
_WIDTH, _HEIGHT = 640, 480


def c_program(scene: ir.Scene, whole: ir.Scene | None = None) -> str:
    """The C text of a trimmed scene. whole: the scene that it was trimmed from, which the default camera shows."""
    shown = _shown(scene)
    packed = pack(shown)
    camera = camera_for(whole or scene, _WIDTH, _HEIGHT)
    seen = replace(shown, camera=camera, width=_WIDTH, height=_HEIGHT)
    data = pack_plain(seen, _WIDTH, _HEIGHT)
    needs = needs_of(scene)
    index = "bvh" if any(need.name == "index" for need in needs) else "none"
    headers, sources = joined_sources(SOURCES)
    program = _main(whole or scene, data, index)
    lights = data.keep[0][: data.picture.light_count]

    def facts(kinds: dict[str, list[str]], macros: dict[str, Macro]) -> Facts:
        alive = tracer_alive(packed, kinds, index) | _picture_alive(data.picture, kinds, lights)
        there = present(packed, needs) | _asked(seen)
        return facts_for(there, alive, kinds, _flags(data.picture), macros)

    code = reduced(sources + "\n\n" + program, facts, ("main",))
    used = members_read(code)
    tables = _tables(packed, data, used, sources)
    before, heading, after = code.partition("/* ==== the picture ==== */")
    text = "\n\n".join([_head(scene, needs), preamble(headers), before.strip(), tables, heading + after.rstrip()])
    return tidied(text) + "\n"


def _shown(scene: ir.Scene) -> ir.Scene:
    """Surfaces without blobs are nothing here."""
    surfaces = tuple(s for s in scene.surfaces if any(True for _ in leaves(s.field)))
    return replace(scene, surfaces=surfaces or scene.surfaces[:1])


# ---- the code ------------------------------------------------------------------------------------


def reduced(
    text: str, facts_of: Callable[[dict[str, list[str]], dict[str, Macro]], Facts], roots: Iterable[str]
) -> str:
    """What the roots reach of a text, with what is known folded in. facts_of: from enums and macros."""
    macros = macros_of(text)
    units = units_of(text, macros)
    facts = facts_of(families(units), macros)
    units = _settled(reached(units, roots, _is_heading), facts, macros)
    while True:
        kept = reached(units, roots, _is_heading)
        slim = [_slimmed(unit, macros) for unit in kept]
        if all(a.text == b.text for a, b in zip(kept, slim, strict=True)) and len(kept) == len(units):
            return _joined(kept)
        units = slim


def _is_heading(unit: Unit) -> bool:
    return unit.kind == "heading"


def _settled(units: list[Unit], facts: Facts, macros: Mapping[str, Macro]) -> list[Unit]:
    """The units with what is known folded in. What a macro pastes together follows from its folded body."""
    texts = [_folded_text(unit, facts) for unit in units]
    left = dict(macros) | macros_of("\n".join(t for u, t in zip(units, texts, strict=True) if u.kind == "macro"))
    made = [units_of(text, left) for text in texts]
    return [
        Unit(
            text, unit.kind, unit.provides, {name for part in parts for name in part.needs} - unit.provides, unit.tight
        )
        for unit, text, parts in zip(units, texts, made, strict=True)
    ]


def _folded_text(unit: Unit, facts: Facts) -> str:
    if unit.kind == "macro":
        head, body = split_macro(unit.text)
        return head + folded(body, facts, unit.provides)
    return folded(unit.text, facts, unit.provides) if unit.kind == "code" else unit.text


def _slimmed(unit: Unit, macros: dict[str, Macro]) -> Unit:
    """Without locals that nothing reads. Macros that make functions have some, too."""
    if "{" not in unit.text or unit.kind not in ("code", "macro"):
        return unit
    if unit.kind == "macro":
        head, body = split_macro(unit.text)
        return _again(unit, head + without_unread(body), macros)
    return _again(unit, _inlined(without_unread(unit.text)), macros)


def _inlined(text: str) -> str:
    """Functions that pass vectors by value are always put where they are called: compilers tell that the way in which
    vectors are passed depends on the machine, and no remark in the file can quiet all of what they say about it."""
    if re.search(r"^static (lane_\w+|\w+ \w+\([^{;]*\blane_(real|mask) \w)[^{;]*\{", text, re.MULTILINE):
        return re.sub(r"^static (?!inline)", "LANE_INLINE ", text, count=1, flags=re.MULTILINE)
    return text


def _again(unit: Unit, text: str, macros: dict[str, Macro]) -> Unit:
    """The unit with another text."""
    if text == unit.text:
        return unit
    made = units_of(text, macros)
    needs = {name for part in made for name in part.needs}
    return Unit(text, unit.kind, unit.provides, needs - unit.provides, unit.tight)


def _joined(units: list[Unit]) -> str:
    parts: list[str] = []
    for i, unit in enumerate(units):
        if unit.kind == "heading" and (i + 1 == len(units) or units[i + 1].kind == "heading"):
            continue  # nothing of this file is needed
        parts.append(("\n" if unit.tight and parts else "\n\n") + unit.text.strip("\n"))
    return "".join(parts)


def present(packed: Packed, needs: tuple[Need, ...]) -> frozenset[str]:
    """The needs that decide expressions: those of the scene, and those that follow from its packed form."""
    names = {need.name for need in needs}
    if packed.scene.shape_count:
        names.add("shapes")
    nodes = packed.arrays["nodes"]
    if len(nodes) > packed.scene.surface_count or (nodes["op"] != 0).any():
        names.add("nodes")
    return frozenset(names)


def _asked(scene: ir.Scene) -> set[str]:
    """The needs that decide how a picture of one sample a pixel is made: where no ray goes on, without queues."""
    asked = {
        "bounces": any(m.reflection or m.metalness or m.transmission or m.texture for m in scene.materials),
        "fog": scene.fog is not None,
        "floor": scene.floor is not None,
    }
    image = isinstance(scene.background.light, ir.Environment)
    asked["queues"] = any(asked.values()) or image
    asked["plain"] = not asked["queues"]
    return {name for name, needed in asked.items() if needed}


def _occurring(kinds: Mapping[str, list[str]], first: str, values: Any) -> set[str]:
    return {kinds[first][int(value)] for value in np.unique(values)}


def tracer_alive(packed: Packed, kinds: Mapping[str, list[str]], index: str) -> dict[str, set[str]]:
    """First enumerator of an enum -> those that occur in a packed scene, searched by default."""
    shapes = packed.arrays["shapes"]["kind"]
    return {
        "KERNEL_SOFT2": _occurring(kinds, "KERNEL_SOFT2", packed.arrays["kernels"]["id"]),
        "OP_SUM": _occurring(kinds, "OP_SUM", packed.arrays["nodes"]["op"]),
        "SHAPE_POINT": _occurring(kinds, "SHAPE_POINT", shapes),
        "SET_NONE": set(kinds["SET_NONE"]) if (shapes >= SHAPE_TRIANGLE).any() else {"SET_NONE"},
        "BLOB_SEARCH_SANDWICH": {"BLOB_SEARCH_SANDWICH"},
        "BLOB_INDEX_BVH": {f"BLOB_INDEX_{index.upper()}"},
        "BLOB_NORMALS_ANALYTIC": {"BLOB_NORMALS_ANALYTIC"},
    }


def _picture_alive(seen: Any, kinds: Mapping[str, list[str]], lights: Iterable[Any]) -> dict[str, set[str]]:
    return {
        "SHADE_SUN": _occurring(kinds, "SHADE_SUN", [light.kind for light in lights]),
        "SHADE_GRADIENT": _occurring(kinds, "SHADE_GRADIENT", seen.sky.kind),
        "SHADE_EVEN": _occurring(kinds, "SHADE_EVEN", seen.indirect),
        "SHADE_NO_FLOOR": _occurring(kinds, "SHADE_NO_FLOOR", seen.floor),
        "SHADE_LINEAR": _occurring(kinds, "SHADE_LINEAR", seen.curve),
    }


def _flags(record: ctypes.Structure, path: str = "picture") -> dict[str, str]:
    """Whole numbers of the picture that are the same for every size, and what is 0."""
    found: dict[str, str] = {}
    for name, kind, *_ in type(record)._fields_:
        value: Any = getattr(record, name)
        if isinstance(value, ctypes.Structure):
            found |= _flags(value, f"{path}->{name}" if "->" not in path else f"{path}.{name}")
        elif name in ("width", "height"):
            continue
        elif isinstance(value, ctypes.Array):
            numbers: list[float] = list(cast("Any", value))
            expression = f"{path}->{name}" if "->" not in path else f"{path}.{name}"
            found |= {f"{expression}[{i}]": "0" for i, x in enumerate(numbers) if x == 0.0 and not any(numbers)}
        elif kind in (ctypes.c_int32, ctypes.c_uint32) or (kind is ctypes.c_double and value == 0.0):
            expression = f"{path}->{name}" if "->" not in path else f"{path}.{name}"
            found |= {expression: str(int(value)), f"job->{expression}": str(int(value))}
    return found


# ---- data ----------------------------------------------------------------------------------------


def _tables(packed: Packed, data: Any, used: set[str], sources: str) -> str:
    """The scene and the picture as constants."""
    kinds = _pointer_kinds(sources)
    scene = Tables(list(packed.arrays.values()), kinds, used)
    scene.record("blob_scene", "the_scene", packed.scene, "scene")
    picture = Tables(data.keep, kinds, used)
    picture.record("shade_picture", "the_picture", data.picture, "picture")
    return "\n\n".join(["/* ==== the scene ==== */", *scene.parts, *picture.parts])


def _pointer_kinds(sources: str) -> dict[str, str]:
    """Member -> type of what it points to, as the structs of the tracer say."""
    found: dict[str, str] = {}
    for kind, members in re.findall(r"\n    const (\w+) ((?:\*\w+(?:, )?)+);", sources):
        for name in re.findall(r"\*(\w+)", members):
            found.setdefault(name, kind)
    return found


# ---- the program -----------------------------------------------------------------------------------


def _main(whole: ir.Scene, data: Any, index: str) -> str:
    """The last part of the file, with the view of the scene's camera."""
    picture = data.picture
    eye, right, down, corner = (np.array(list(getattr(picture, n))) for n in ("eye", "right", "down", "corner"))
    fit, move = _fitting(whole) if whole.camera.span is None else ("", "")
    filled = {
        "EYE": _triple(eye),
        "AHEAD": _triple(corner + right * (_WIDTH / 2) + down * (_HEIGHT / 2)),
        "RIGHT": _triple(right * _HEIGHT),
        "DOWN": _triple(down * _HEIGHT),
        "FIT": fit,
        "MOVE": move,
        "INDEX": f"BLOB_INDEX_{index.upper()}",
    }
    text = resources.files("blobscript").joinpath("emitting", "main.c").read_text(encoding="utf-8")
    return re.sub("@([A-Z]+)@", lambda found: filled[found[1]], text)


def _triple(v: NDArray[np.float64]) -> str:
    return ", ".join(number(float(x)) for x in v)


def _fitting(whole: ir.Scene) -> tuple[str, str]:
    """The default camera shows everything at any shape of the picture: data and code for where it stands
    (`framing.Fit`)."""
    fit = default_fit(Extents(whole.surfaces).boxes())
    rows = np.column_stack([fit.side / fit.tangent, fit.height, fit.along])
    rows = np.unique(rows, axis=0)
    # corners that another one outdoes in everything say nothing
    signed = rows * np.array([1.0, 1.0, -1.0])
    rows = rows[[not ((signed >= row).all(axis=1) & (signed > row).any(axis=1)).any() for row in signed]]
    table = array_text("double", "program_fit", rows, ())
    data = f"""
/* The camera stands so far from the centre that everything is in view: for each corner of the bounds how far it is
 * to the side, in height, and along the view. */
{table}
static const double program_centre[3] = {{{_triple(fit.centre)}}}, program_from[3] = {{{_triple(fit.unit)}}};
"""
    code = f"""
    double distance = {number(fit.least)};
    for (int i = 0; i < {len(rows)}; i++) {{
        const double *corner = program_fit + 3 * i;
        distance = fmax(distance, fmax(corner[0] * height / width, corner[1]) - corner[2]);
    }}
    if (distance == 0.0) distance = 1.0;
    for (int k = 0; k < 3; k++) picture->eye[k] = program_centre[k] + distance * program_from[k];"""
    return data, code


def preamble(headers: tuple[str, ...]) -> str:
    names = sorted({*headers, "stdio.h", "stdlib.h", "string.h", "stdint.h"})
    lines = [f"#include <{name}>" for name in names]
    lines += [
        "",
        "#ifdef __GNUC__",
        '#pragma GCC diagnostic ignored "-Wpsabi"            /* vectors of eight numbers stay within this file */',
        '#pragma GCC diagnostic ignored "-Wunused-parameter" /* what only other scenes need */',
        "#endif",
        "#if defined(__GNUC__) && !defined(__clang__)",
        '#pragma GCC diagnostic ignored "-Wmaybe-uninitialized" /* where folded conditions set and read it */',
        "#endif",
        "",
        "#define BLOB_ISA baseline",
    ]
    return "\n".join(lines)


def _head(scene: ir.Scene, needs: tuple[Need, ...]) -> str:
    lines = [
        f"/* A scene by blobscript {__version__}: a program that renders it.",
        " *",
        " *     cc -O2 scene.c -lm && ./a.out 640 480 > out.pfm",
        " *",
        f" * Scene {scene_hash(scene)}. It needs, and this file holds nothing else:",
    ]
    for need in needs:
        if need.name in MANY_SAMPLES:
            continue
        where = f" (line {need.span.line}{_of(need)})" if need.span else ""
        lines.append(f" *   {need.meaning}{where}")
    return "\n".join([*lines, " */"])


def _of(need: Need) -> str:
    """The file's name without anything that could mean something in C."""
    assert need.span is not None
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", need.span.source.path.replace("\\", "/").rsplit("/", 1)[-1])[:60]
    return f" of {name}" if name else ""
