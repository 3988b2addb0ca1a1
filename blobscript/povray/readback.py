"""Numbers out of POV-Ray: where rays hit its objects, to the last digits.

`trace()` shoots a ray while the scene is read and gives place and normal as doubles; `#write` puts them down with 15
decimals. One run answers any number of rays: starting POV-Ray takes most of a second, a ray some microseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.framing import view_axes
from blobscript.povray.program import Run, Workshop
from blobscript.povray.scene_text import Document
from blobscript.povray.text import Array, number, vector

__all__ = ["Answers", "answers", "camera_answers"]

#: A picture of a few pixels, which nobody looks at: the numbers are written before it starts.
_OPTIONS = ("+Odummy.png", "+W4", "+H4", "-D", "-A", "-V", "+Q0", "+WT1")


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """hit (n,), t (n,) along the unit direction in units of the script (inf), normal (n, 3) towards the eye (NaN)."""

    hit: NDArray[np.bool_]
    t: Array
    normal: Array
    run: Run | None


def camera_answers(shop: Workshop, made: Document, camera: ir.Camera, width: int, height: int, limit: float) -> Answers:
    """One ray per pixel, row by row."""
    right, up, forward = view_axes(camera)
    step = 2.0 * np.tan(camera.fov / 2) / height
    loop = [
        f"#declare Eye = {vector(np.array(camera.at) * made.unit)};",
        f"#declare Right = {vector(right * step)}; #declare Up = {vector(up * step)};",
        f"#declare Ahead = {vector(forward)};",
        f"#for(J,0,{height - 1}) #for(I,0,{width - 1})",
        f"#declare D = vnormalize(Ahead+(I+0.5-{number(width / 2)})*Right+({number(height / 2)}-J-0.5)*Up);",
        "#declare P = trace(Everything,Eye,D,N);",
        f"#if(vlength(N)>0) {_writing(f'J*{width}+I', 'Eye')} #end",
        "#end #end",
    ]
    return _traced(shop, [made.surfaces], _everything(made.names), loop, width * height, made.unit, limit)


def answers(
    shop: Workshop,
    made: Document,
    origins: Array,
    directions: Array,
    limit: float,
    surface: NDArray[np.int64] | None = None,
) -> Answers:
    """Any rays: origins, directions (n, 3) in units of the script. surface (n,): each ray sees only that one."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    names = list(made.names)
    places = np.full(len(unit), len(names))
    if surface is not None:
        row_of = {number_: row for row, number_ in enumerate(made.names.values())}
        places = np.array([row_of.get(number_, -1) for number_ in surface.tolist()])
    rows = np.column_stack([places, origins * made.unit, unit])
    np.savetxt(shop.folder / "rays.csv", rows[places >= 0], fmt="%.17g", delimiter=",", newline=",\n")
    loop = [
        f"#declare Each = array[{len(names) + 1}]",
        *(f"#declare Each[{row}] = object {{ {name} }}" for row, name in enumerate(names)),
        f"#declare Each[{len(names)}] = object {{ Everything }}",
        '#fopen R "rays.csv" read',
        f"#for(I,0,{np.count_nonzero(places >= 0) - 1})",
        "#read(R,Which,Ex,Ey,Ez,Dx,Dy,Dz)",
        "#declare Eye = <Ex,Ey,Ez>; #declare D = <Dx,Dy,Dz>;",
        "#declare P = trace(Each[Which],Eye,D,N);",
        f"#if(vlength(N)>0) {_writing('I', 'Eye')} #end",
        "#end #fclose R",
    ]
    found = _traced(
        shop, [made.surfaces], _everything(made.names), loop, int(np.count_nonzero(places >= 0)), made.unit, limit
    )
    return found if (places >= 0).all() else _spread(found, places >= 0)


def _spread(found: Answers, asked: NDArray[np.bool_]) -> Answers:
    """Rays towards surfaces that are proved empty miss."""
    count = len(asked)
    hit, t, normal = np.zeros(count, np.bool_), np.full(count, np.inf), np.full((count, 3), np.nan)
    hit[asked], t[asked], normal[asked] = found.hit, found.t, found.normal
    return Answers(hit, t, normal, found.run)


def _writing(index: str, origin: str) -> str:
    distance = f"vlength(P-{origin})"
    return f'#write(F,{index},",",str({distance},0,15),",",vstr(3,N,",",0,15),"\\n")'


def _everything(names: Sequence[str] | dict[str, int]) -> str:
    if not names:
        # nothing to hit, but trace() wants an object
        return "#declare Everything = sphere { <0,0,0>, 1 clipped_by { sphere { <0,9,0>, 1 } } }"
    return "#declare Everything = union { " + " ".join(f"object {{ {name} }}" for name in names) + " }"


def _traced(
    shop: Workshop, declared: list[str], everything: str, loop: list[str], count: int, unit: float, limit: float
) -> Answers:
    head = ["#declare N = <0,0,0>;", '#fopen F "hits.csv" write']
    text = "\n".join([*declared, everything, *head, *loop, "#fclose F", "camera { location <0,0,0> }", ""])
    run = shop.run(text, _OPTIONS, limit, "trace")
    return _read(shop.folder / "hits.csv", count, unit, run)


def _read(file: Path, count: int, unit: float, run: Run) -> Answers:
    rows = np.fromstring(file.read_text().replace("\n", ","), sep=",").reshape(-1, 5)  # pyright: ignore
    index = rows[:, 0].astype(np.int64)
    hit, t, normal = np.zeros(count, np.bool_), np.full(count, np.inf), np.full((count, 3), np.nan)
    hit[index], t[index], normal[index] = True, rows[:, 1] / unit, rows[:, 2:5]
    return Answers(hit, t, normal, run)
