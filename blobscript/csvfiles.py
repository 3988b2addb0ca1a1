"""CSV: points and records from lines of cells, separated by commas, semicolons, tabs or blanks.

Numbers go from the text straight into arrays (NumPy's C parser), so a million rows make no Python
object each; only where that fails is the text read again, slowly, to say which line is wrong and
why, or because there are texts between the numbers.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blobscript.arguments import count_text
from blobscript.datafiles import unreadable
from blobscript.values import Table

__all__ = ["cell_number", "csv_points", "csv_records", "field_names", "is_number"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Csv:
    """A CSV text: its header if it has one, the rows behind it, and what separates their cells
    (None: blanks). `width`: cells in the first line."""

    file: str
    delimiter: str | None
    header: list[str] | None
    width: int
    first_line: int  # of the body
    body: str

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


def _opened(file: str, text: str) -> _Csv:
    """Finds the first row; lines that are empty or start with # do not count."""
    start, line = 0, 1
    while True:
        end = text.find("\n", start)
        end = len(text) if end < 0 else end
        row = text[start:end].strip()
        if row and not row.startswith("#"):
            break
        if end == len(text):
            raise unreadable(file, "it has no rows")
        start, line = end + 1, line + 1
    delimiter = next((d for d in (";", "\t", ",") if d in row), None)
    try:
        cells = _cells(row, delimiter)
    except csv.Error as error:
        raise unreadable(file, f"line {line}: {error}", label=f"line {line}") from None
    if all(map(is_number, cells)):
        return _Csv(file, delimiter, None, len(cells), line, text[start:])
    return _Csv(file, delimiter, cells, len(cells), line + 1, text[end + 1 :])


def _cells(row: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return row.split()
    return [cell.strip() for cell in next(csv.reader([row], delimiter=delimiter))]


def is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def csv_points(file: str, text: str) -> Array:
    table = _opened(file, text)
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
        points.append([cell_number(file, line, cells[k]) for k in columns])
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def cell_number(file: str, line: int, cell: str) -> float:
    if not is_number(cell):
        comma = is_number(cell.replace(",", "."))
        help_text = "write decimal points, not commas" if comma else "each point is three numbers: x, y, z"
        shown = cell if len(cell) <= 40 else cell[:37] + "..."
        raise unreadable(file, f"line {line}: `{shown}` is not a number", help_text, label=f"line {line}")
    return float(cell)


def csv_records(file: str, text: str) -> Table:
    table = _opened(file, text)
    if table.header is None:
        raise unreadable(
            file, "its first line names no columns", "start it with a line of names, for example: x,y,z,radius"
        )
    names = field_names(file, table.header)
    numbers = table.numbers(None)
    if numbers is not None and numbers.shape[1] == len(names):
        return Table({name: number_column(numbers[:, k]) for k, name in enumerate(names)}, len(numbers))
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


def field_names(file: str, header: list[str]) -> list[str]:
    names = ["".join(c if c.isalnum() else "_" for c in name) for name in header]
    for k, name in enumerate(names):
        if not name or name in names[:k]:
            problem = f"two columns are called `{name}`" if name else f"column {k + 1} has no name"
            raise unreadable(file, problem, "give each column a name of its own")
    return names


def number_column(column: Array) -> Array | NDArray[np.int64]:
    """Whole numbers are `int`."""
    with np.errstate(invalid="ignore"):
        whole = bool((np.abs(column) < 2**53).all()) and bool((column == np.rint(column)).all())
    if whole and len(column):
        return column.astype(np.int64)
    return np.ascontiguousarray(column)


def _column(cells: list[str]) -> Any:
    if cells and all(map(is_number, cells)):
        return number_column(np.array(cells, dtype=np.float64))
    if cells and all(cell in ("true", "false") for cell in cells):
        return [cell == "true" for cell in cells]
    return cells
