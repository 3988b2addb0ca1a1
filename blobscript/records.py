"""What `read_records` gives: the type of the records comes from the script, or from the file itself.

`let atoms: [(at: vec3, kind: text)] = read_records("a.xyz")` says it; without that the file must be
named by a plain text, so that its columns can be looked up while types are checked.
"""

from __future__ import annotations

from blobscript import typed
from blobscript.diagnostics import Diagnostic, Help
from blobscript.inferring import Inferring
from blobscript.source import Span
from blobscript.types import ERROR, ListOf, RecordOf, Type

__all__ = ["record_type"]


def record_type(inference: Inferring, file: typed.Expr, expected: Type | None, span: Span) -> Type:
    """The type of the list; ERROR if it was reported that nothing says it."""
    if isinstance(expected, ListOf) and isinstance(expected.element, RecordOf):
        return expected
    if isinstance(file, typed.Failed):
        return ListOf(ERROR)
    if isinstance(file, typed.Constant):
        return inference.known.record_type(file.value, inference.module, span, file.span)
    inference.report(
        Diagnostic(
            "E0305",
            "the type of these records must be written down: the name of the file is not known yet",
            span,
            "records of what type?",
            helps=(Help("declare it, for example: let rows: [(at: vec3, kind: text)] = read_records(...)"),),
        )
    )
    return ListOf(ERROR)
