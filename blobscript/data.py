"""`read_points` and `read_records`: data files of any kind, by their ending; XYZ molecules."""

from __future__ import annotations

import os
from typing import cast

import numpy as np
from numpy.typing import NDArray

from blobscript.arguments import LARGEST
from blobscript.csvfiles import cell_number, csv_points, csv_records, is_number
from blobscript.datafiles import located, read_text, unreadable
from blobscript.diagnostics import Help
from blobscript.jsonfiles import json_points, json_records
from blobscript.values import Context, MakerError, Table

__all__ = ["read_points", "read_records"]

Array = NDArray[np.float64]


def _format(ctx: Context, file: str) -> str:
    ending = os.path.splitext(file)[1].lower()
    kind = {".csv": "csv", ".tsv": "csv", ".txt": "csv", ".dat": "csv", ".json": "json", ".xyz": "xyz"}.get(ending)
    if kind is None:
        located(ctx, file)  # a file that may not be read is a mistake whatever it holds
        raise MakerError(
            "E0803",
            f"cannot tell what kind of data `{file}` holds" + (f": {ending} is unknown" if ending else ""),
            "file",
            helps=(Help("data files end in .csv (also .tsv, .txt, .dat), .json or .xyz"),),
        )
    return kind


def read_points(ctx: Context, file: str) -> Array:
    """(n, 3) points of a file."""
    kind, text = _format(ctx, file), read_text(ctx, file)
    match kind:
        case "csv":
            points = csv_points(file, text)
        case "xyz":
            points = _xyz(file, text)[1]
        case _:
            points = json_points(file, text)
    return _checked(file, points)


def _checked(file: str, points: Array) -> Array:
    wrong = ~(np.abs(points) <= LARGEST)
    if wrong.any():
        i = int(np.argmax(wrong.any(axis=1)))
        raise unreadable(file, f"point {i + 1} is not finite", "take it out, or give it numbers")
    return np.ascontiguousarray(points, dtype=np.float64)


def read_records(ctx: Context, file: str) -> Table:
    """The rows of a file as records: columns named by the header (CSV) or the keys (JSON); `kind`
    and `at` for molecules (XYZ). Columns x, y, z also give `at`."""
    kind, text = _format(ctx, file), read_text(ctx, file)
    match kind:
        case "csv":
            return _with_at(csv_records(file, text))
        case "xyz":
            kinds, points = _xyz(file, text)
            return Table({"kind": kinds, "at": _checked(file, points)}, len(points))
        case _:
            return _with_at(json_records(file, text))


def _with_at(table: Table) -> Table:
    columns = dict(table.columns)
    parts = [columns.get(name) for name in "xyz"]
    if "at" not in columns and all(isinstance(part, np.ndarray) and part.ndim == 1 for part in parts):
        columns["at"] = np.ascontiguousarray(np.column_stack(cast("list[Array]", parts)), dtype=np.float64)
    return Table(columns, len(table))


# ---- XYZ -----------------------------------------------------------------------------


def _xyz(file: str, text: str) -> tuple[list[str], Array]:
    """Kinds and places of the first molecule: a count, a comment, then lines `kind x y z`."""
    lines = text.splitlines()
    head = lines[0].split() if lines else []
    if len(head) != 1 or not head[0].isdigit():
        if len(head) >= 3 and all(map(is_number, head[:3])):
            points = csv_points(file, text)
            return [""] * len(points), points
        raise unreadable(
            file,
            "line 1 must be the number of atoms",
            "an XYZ file is: the number of atoms, a comment line, then lines like `C 0.0 1.2 -0.5`",
            label="line 1",
        )
    count = int(head[0]) if len(head[0]) < 10 else 10**9
    rows = lines[2 : 2 + count]
    if len(rows) < count:
        raise unreadable(file, f"it announces {count} atoms on line 1, but has lines for {len(rows)}")
    atoms = [_atom(file, k, row) for k, row in enumerate(rows, 3)]
    return [kind for kind, *_ in atoms], np.array([xyz for _, *xyz in atoms], dtype=np.float64).reshape(-1, 3)


def _atom(file: str, line: int, row: str) -> tuple[str, float, float, float]:
    cells = row.split()
    if len(cells) < 4:
        raise unreadable(file, f"line {line} is not `kind x y z`", label=f"line {line}")
    return (
        cells[0],
        cell_number(file, line, cells[1]),
        cell_number(file, line, cells[2]),
        cell_number(file, line, cells[3]),
    )
