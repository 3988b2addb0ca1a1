"""Values that become what their place wants: ints as numbers, rows of a file as declared records.

Arrays stay arrays: a column of a million ints is converted at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from blobscript.columns import type_of_table
from blobscript.convert import needs_conversion
from blobscript.operators import plain
from blobscript.runtime import FunctionValue
from blobscript.types import FnOf, ListOf, Primitive, RecordOf, Type, article, describe, fits
from blobscript.values import MakerError, Table

__all__ = ["coercion", "records"]

Change = Callable[[Any], Any]


def coercion(actual: Type, wanted: Type) -> Change | None:
    """What turns a value of the one type into one of the other; None: nothing has to be done.

    A list literal that holds both ints and numbers has the type that it becomes: equal types.
    """
    if actual == wanted:
        return _unified(wanted)
    if not needs_conversion(actual, wanted):
        return None
    match actual, wanted:
        case ListOf(own), ListOf(element):
            return _list(coercion(own, element))
        case RecordOf(), RecordOf(fields):
            return _record({n: c for n, k in fields if (own := actual.field(n)) and (c := coercion(own, k))})
        case FnOf(own, result), FnOf(parameters, wanted_result):
            given = [coercion(gives, takes) for takes, gives in zip(own, parameters, strict=True)]
            return _function(given, coercion(result, wanted_result))
        case _:
            return float


def _unified(kind: Type) -> Change | None:
    """Numbers at any depth become floats, for values of which some parts are ints."""
    match kind:
        case Primitive("number"):
            return float
        case ListOf(element):
            change = _unified(element)
            return _list(change) if change else None
        case RecordOf(fields):
            changes = {name: change for name, own in fields if (change := _unified(own))}
            return _record(changes) if changes else None
        case _:
            return None


def _list(change: Change | None) -> Change:
    def run(values: Any) -> Any:
        if isinstance(values, np.ndarray):
            array = cast("NDArray[Any]", values)
            return array.astype(np.float64) if change is float else array
        return [change(value) for value in plain(values)] if change else values

    return run


def _record(changes: dict[str, Change]) -> Change:
    def run(value: Any) -> Any:
        changed = dict(value)
        for name, change in changes.items():
            changed[name] = change(changed[name])
        return changed

    return run


def _function(given: list[Change | None], result: Change | None) -> Change:
    def run(value: FunctionValue) -> FunctionValue:
        call = value.call

        def changed(arguments: list[Any]) -> Any:
            arguments = [
                argument if change is None else change(argument)
                for argument, change in zip(arguments, given, strict=True)
            ]
            made = call(arguments)
            return made if result is None else result(made)

        return FunctionValue(changed, origin=value.origin)

    return run


# ---- records from files -------------------------------------------------------------------------


def records(wanted: Type) -> Callable[[Table], Table]:
    """Checks that a file holds the records that the script declares, and makes ints numbers."""
    assert isinstance(wanted, ListOf)
    element = wanted.element

    def run(table: Table) -> Table:
        found = type_of_table(table)
        if not isinstance(element, RecordOf) or not fits(found, element):
            raise _not_as_declared(found, element)
        columns: dict[str, Any] = {}
        for name, kind in element.fields:
            own = found.field(name)
            change = coercion(ListOf(own), ListOf(kind)) if own is not None else None
            columns[name] = change(table.columns[name]) if change else table.columns[name]
        return Table(columns, table.length)

    return run


def _not_as_declared(found: RecordOf, wanted: Type) -> MakerError:
    notes: list[str] = []
    for name, kind in wanted.fields if isinstance(wanted, RecordOf) else ():
        own = found.field(name)
        if own is None:
            notes.append(f"the file has no column `{name}`")
        elif not fits(own, kind):
            notes.append(f"its column `{name}` is {article(own)}, not {article(kind)}")
    return MakerError(
        "E0304",
        f"the file's records are {describe(found)}, but {describe(wanted)} is declared",
        "file",
        "does not hold these records",
        notes=tuple(notes),
    )
