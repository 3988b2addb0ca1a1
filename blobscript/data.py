"""Data files: `read_points` and `read_records` from CSV, JSON and XYZ.

Files lie below the scene's folder, symbolic links resolved. Numbers go from the text straight into
arrays (NumPy's C parser), so a million rows make no Python object each; only where that fails is
the text read again, slowly, to say which line is wrong and why.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import stat
from collections.abc import Iterable, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from blobscript.arguments import LARGEST, count_text
from blobscript.diagnostics import Help
from blobscript.values import Context, MakerError, Table

__all__ = ["read_bytes", "read_points", "read_records", "unreadable"]

Array = NDArray[np.float64]

#: Larger files are refused, so that a scene from a stranger cannot fill the memory.
MAX_SIZE = 200_000_000
#: JSON becomes Python objects, ten times as large as the text.
MAX_JSON_SIZE = 40_000_000

# ---- files ---------------------------------------------------------------------------


def unreadable(file: str, reason: str, *helps: str, label: str = "") -> MakerError:
    return MakerError("E0801", f"cannot read `{file}`: {reason}", "file", label, tuple(map(Help, helps)))


def read_bytes(ctx: Context, file: str) -> bytes:
    """The content of a file below the scene's folder; remembered as a source of the scene."""
    path = _path(ctx, file)
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise unreadable(file, "it is not a file" if not os.path.isdir(path) else "it is a folder")
        with open(path, "rb") as opened:
            content = opened.read(MAX_SIZE + 1)
    except OSError as error:
        raise unreadable(file, *_reason(ctx, file, error)) from None
    if len(content) > MAX_SIZE:
        raise unreadable(file, f"it is larger than {MAX_SIZE // 1_000_000} MB")
    ctx.sources.append((file, hashlib.sha256(content).hexdigest()))
    return content


def _path(ctx: Context, file: str) -> str:
    if ctx.folder is None:
        raise MakerError("E0207", f"this script may not read files, but it asks for `{file}`", "file", "no files here")
    root = os.path.realpath(ctx.root or ctx.folder)
    try:
        path = os.path.realpath(os.path.join(ctx.folder, file))
    except (OSError, ValueError):
        raise unreadable(ascii(file)[1:-1], "that is no file name") from None
    if path != root and not path.startswith(root.rstrip(os.sep) + os.sep):
        raise MakerError(
            "E0207",
            f"`{file}` lies outside the scene's folder",
            "file",
            "outside",
            (Help("put the file into the scene's folder or below it; scenes can read nothing else"),),
        )
    return path


def _reason(ctx: Context, file: str, error: OSError) -> tuple[str, ...]:
    if not isinstance(error, FileNotFoundError):
        return ((error.strerror or str(error)).lower(),)
    folder = os.path.dirname(os.path.join(ctx.folder or "", file))
    try:
        near = [name for name in sorted(os.listdir(folder)) if name.lower() == os.path.basename(file).lower()]
    except OSError:
        near = []
    if near:
        return "there is no such file", f"did you mean `{near[0]}`? Capital letters count"
    return "there is no such file", "file names start from the folder of the script"


def _text(ctx: Context, file: str) -> str:
    content = read_bytes(ctx, file)
    if b"\0" in content[:4096]:
        raise unreadable(file, "it is not a text")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise unreadable(file, f"line {line} is not UTF-8", "save it as UTF-8") from None


def _format(file: str) -> str:
    ending = os.path.splitext(file)[1].lower()
    kind = {".csv": "csv", ".tsv": "csv", ".txt": "csv", ".dat": "csv", ".json": "json", ".xyz": "xyz"}.get(ending)
    if kind is None:
        raise MakerError(
            "E0803",
            f"cannot tell what kind of data `{file}` holds" + (f": {ending} is unknown" if ending else ""),
            "file",
            helps=(Help("data files end in .csv (also .tsv, .txt, .dat), .json or .xyz"),),
        )
    return kind


# ---- the two built-ins ---------------------------------------------------------------


def read_points(ctx: Context, file: str) -> Array:
    """(n, 3) points of a file."""
    kind, text = _format(file), _text(ctx, file)
    match kind:
        case "csv":
            points = _csv_points(file, text)
        case "xyz":
            points = _xyz(file, text)[1]
        case _:
            points = _json_points(file, text)
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
    kind, text = _format(file), _text(ctx, file)
    match kind:
        case "csv":
            return _with_at(_csv_records(file, text))
        case "xyz":
            kinds, points = _xyz(file, text)
            return Table({"kind": kinds, "at": _checked(file, points)}, len(points))
        case _:
            return _with_at(_json_records(file, text))


def _with_at(table: Table) -> Table:
    columns = dict(table.columns)
    parts = [columns.get(name) for name in "xyz"]
    if "at" not in columns and all(isinstance(part, np.ndarray) and part.ndim == 1 for part in parts):
        columns["at"] = np.ascontiguousarray(np.column_stack(cast("list[Array]", parts)), dtype=np.float64)
    return Table(columns, len(table))


# ---- CSV -----------------------------------------------------------------------------


class _Csv:
    """Where the rows of a CSV text start, what separates its cells, and its header if it has one."""

    def __init__(self, file: str, text: str) -> None:
        self.file = file
        start, line = 0, 1
        while True:
            end = text.find("\n", start)
            row = text[start : end if end >= 0 else len(text)].strip()
            if row and not row.startswith("#"):
                break
            if end < 0:
                raise unreadable(file, "it has no rows")
            start, line = end + 1, line + 1
        self.delimiter = next((d for d in (";", "\t", ",") if d in row), None)
        cells = self.cells(row)
        self.header = None if all(map(_is_number, cells)) else [cell.strip() for cell in cells]
        self.width = len(cells)
        self.first_line = line + 1 if self.header else line
        self.body = text[(end + 1 if end >= 0 else len(text)) :] if self.header else text[start:]

    def cells(self, row: str) -> list[str]:
        if self.delimiter is None:
            return row.split()
        return [cell.strip() for cell in next(csv.reader([row], delimiter=self.delimiter))]

    def rows(self) -> Iterable[tuple[int, list[str]]]:
        """(line number, cells) one by one, quoted line ends included; for mixed columns and errors."""
        if self.delimiter is None:
            for number, row in enumerate(self.body.splitlines(), self.first_line):
                if row.strip() and not row.lstrip().startswith("#"):
                    yield number, row.split()
            return
        reader = csv.reader(io.StringIO(self.body), delimiter=self.delimiter)
        try:
            for row in reader:
                if row and any(row) and not row[0].startswith("#"):
                    yield self.first_line + reader.line_num - 1, [cell.strip() for cell in row]
        except csv.Error as error:
            line = self.first_line + reader.line_num - 1
            raise unreadable(self.file, f"line {line}: {error}", label=f"line {line}") from None

    def numbers(self, columns: Sequence[int] | None) -> Array | None:
        """All rows as numbers by NumPy's parser; None if it finds anything odd."""
        if self.header and not self.body.strip():
            return np.empty((0, self.width if columns is None else len(columns)))
        try:
            return np.loadtxt(
                io.StringIO(self.body), delimiter=self.delimiter, usecols=columns, comments="#", ndmin=2, encoding=None
            )
        except (ValueError, IndexError):
            return None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def _csv_points(file: str, text: str) -> Array:
    table = _Csv(file, text)
    columns = _point_columns(file, table)
    points = table.numbers(columns)
    return _slow_points(file, table, columns) if points is None else points


def _point_columns(file: str, table: _Csv) -> list[int]:
    if table.header is None:
        if table.width < 3:
            raise unreadable(
                file,
                f"line {table.first_line} has {count_text(table.width, 'number')}, a point needs three",
                "write x, y, z on each line, separated by commas, semicolons, tabs or spaces",
            )
        return [0, 1, 2]
    names = [name.lower() for name in table.header]
    missing = [name for name in "xyz" if name not in names]
    if missing:
        found = ", ".join(f"`{name}`" for name in table.header[:8])
        raise unreadable(
            file,
            f"it has no column {' and no column '.join(f'`{name}`' for name in missing)}",
            f"its columns are {found}; name three of them x, y and z",
        )
    return [names.index(name) for name in "xyz"]


def _slow_points(file: str, table: _Csv, columns: list[int]) -> Array:
    """Row by row: either it works (quotes, odd blanks) or the wrong line is found."""
    points: list[list[float]] = []
    for line, cells in table.rows():
        if len(cells) <= max(columns):
            raise unreadable(
                file,
                f"line {line} has {count_text(len(cells), 'value')}, at least {max(columns) + 1} are needed",
                label=f"line {line}",
            )
        points.append([_number(file, line, cells[k]) for k in columns])
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def _number(file: str, line: int, cell: str) -> float:
    if not _is_number(cell):
        comma = _is_number(cell.replace(",", "."))
        help_text = "write decimal points, not commas" if comma else "each point is three numbers: x, y, z"
        shown = cell if len(cell) <= 40 else cell[:37] + "..."
        raise unreadable(file, f"line {line}: `{shown}` is not a number", help_text, label=f"line {line}")
    return float(cell)


def _csv_records(file: str, text: str) -> Table:
    table = _Csv(file, text)
    if table.header is None:
        raise unreadable(
            file, "its first line names no columns", "start it with a line of names, for example: x,y,z,radius"
        )
    names = _field_names(file, table.header)
    numbers = table.numbers(None)
    if numbers is not None and numbers.shape[1] == len(names):
        return Table({name: _number_column(numbers[:, k]) for k, name in enumerate(names)}, len(numbers))
    rows: list[list[str]] = []
    for line, cells in table.rows():
        if len(cells) != len(names):
            raise unreadable(
                file,
                f"line {line} has {count_text(len(cells), 'value')}, but there are {len(names)} columns",
                label=f"line {line}",
            )
        rows.append(cells)
    columns = list(zip(*rows, strict=True)) or [()] * len(names)
    return Table({name: _column(list(columns[k])) for k, name in enumerate(names)}, len(rows))


def _field_names(file: str, header: list[str]) -> list[str]:
    names = ["".join(c if c.isalnum() else "_" for c in name) for name in header]
    for k, name in enumerate(names):
        if not name or name in names[:k]:
            problem = f"two columns are called `{name}`" if name else f"column {k + 1} has no name"
            raise unreadable(file, problem, "give each column a name of its own")
    return names


def _number_column(column: Array) -> Array | NDArray[np.int64]:
    """Whole numbers are `int`."""
    with np.errstate(invalid="ignore"):
        whole = bool((np.abs(column) < 2**53).all()) and bool((column == np.rint(column)).all())
    if whole and len(column):
        return column.astype(np.int64)
    return np.ascontiguousarray(column)


def _column(cells: list[str]) -> Any:
    if cells and all(map(_is_number, cells)):
        return _number_column(np.array(cells, dtype=np.float64))
    if cells and all(cell in ("true", "false") for cell in cells):
        return [cell == "true" for cell in cells]
    return cells


# ---- XYZ -----------------------------------------------------------------------------


def _xyz(file: str, text: str) -> tuple[list[str], Array]:
    """Kinds and places of the first molecule: a count, a comment, then lines `kind x y z`."""
    lines = text.splitlines()
    head = lines[0].split() if lines else []
    if len(head) != 1 or not head[0].isdigit():
        if len(head) >= 3 and all(map(_is_number, head[:3])):
            points = _csv_points(file, text)
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
    return cells[0], _number(file, line, cells[1]), _number(file, line, cells[2]), _number(file, line, cells[3])


# ---- JSON ----------------------------------------------------------------------------


def _json(file: str, text: str) -> list[Any]:
    if len(text) > MAX_JSON_SIZE:
        raise unreadable(file, f"JSON may have {MAX_JSON_SIZE // 1_000_000} MB at most", "large tables fit into CSV")
    try:
        found = json.loads(text, parse_constant=_no_constant)
    except json.JSONDecodeError as error:
        message = f"line {error.lineno}, column {error.colno}: {error.msg[:1].lower()}{error.msg[1:]}"
        raise unreadable(file, message, label=f"line {error.lineno}") from None
    except (ValueError, RecursionError) as error:
        reason = "it nests too deep" if isinstance(error, RecursionError) else str(error)
        raise unreadable(file, reason) from None
    if not isinstance(found, list):
        raise unreadable(file, "it holds no list", "the file must be a list: [ ... ]")
    return cast("list[Any]", found)


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number that JSON allows")


def _json_points(file: str, text: str) -> Array:
    found = _json(file, text)
    points = [_json_point(file, k, item) for k, item in enumerate(found)]
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def _json_point(file: str, k: int, item: Any) -> tuple[float, float, float]:
    if isinstance(item, dict):
        record = cast("dict[str, Any]", item)
        item = record["at"] if "at" in record else [record.get(name) for name in "xyz"]
    point = _vec3(item)
    if point is None:
        raise unreadable(
            file, f"item {k} (counted from 0) is not a point", 'a point is [1, 2, 3] or {"x": 1, "y": 2, "z": 3}'
        )
    return point


def _vec3(item: Any) -> tuple[float, float, float] | None:
    if not isinstance(item, list) or len(cast("list[Any]", item)) != 3:
        return None
    parts = [_json_number(part) for part in cast("list[Any]", item)]
    if None in parts:
        return None
    return cast("tuple[float, float, float]", tuple(parts))


def _json_number(item: Any) -> float | None:
    if isinstance(item, bool) or not isinstance(item, (int, float)):
        return None
    try:
        return float(item)
    except OverflowError:
        return float("inf")


def _json_records(file: str, text: str) -> Table:
    found = _json(file, text)
    for k, item in enumerate(found):
        if not isinstance(item, dict):
            raise unreadable(file, f"item {k} (counted from 0) is no record", 'a record is {"name": value, ...}')
        if item.keys() != found[0].keys():
            differing = sorted(item.keys() ^ found[0].keys())[0]
            raise unreadable(
                file,
                f"item {k} (counted from 0) and item 0 have different fields: `{differing}`",
                "all records need the same fields",
            )
    names = _field_names(file, list(found[0])) if found else []
    columns = zip(names, found[0] if found else (), strict=True)
    return Table({name: _json_column([item[key] for item in found]) for name, key in columns}, len(found))


def _json_column(items: list[Any]) -> Any:
    if all(type(item) is int and abs(item) < 2**62 for item in items):
        return np.array(items, dtype=np.int64)
    numbers = [_json_number(item) for item in items]
    if None not in numbers:
        return np.array(numbers, dtype=np.float64)
    vectors = [_vec3(item) for item in items]
    if None not in vectors:
        return np.array(vectors, dtype=np.float64)
    return [_json_value(item) for item in items]


def _json_value(item: Any) -> Any:
    """JSON as values of the language: records, lists, vectors."""
    if isinstance(item, dict):
        return {str(name): _json_value(value) for name, value in cast("dict[str, Any]", item).items()}
    if isinstance(item, list):
        vector = _vec3(item)
        return vector if vector else [_json_value(part) for part in cast("list[Any]", item)]
    return item
