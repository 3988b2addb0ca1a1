"""What the compiler has to say: diagnostics as data, and the table of their codes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from blobscript.source import Span

__all__ = [
    "CODES",
    "BlobscriptError",
    "Diagnostic",
    "Edit",
    "Help",
    "Label",
    "MissingError",
    "ProgramError",
    "has_errors",
]


@dataclass(frozen=True, slots=True)
class Label:
    """A secondary place that explains the primary one."""

    span: Span
    text: str


@dataclass(frozen=True, slots=True)
class Edit:
    """Replace the span's text (an empty span inserts)."""

    span: Span
    replacement: str


@dataclass(frozen=True, slots=True)
class Help:
    """Advice, perhaps with the edit that follows it.

    certainty: "safe" may be applied by `check --fix`, "guess" after asking; an "example" is only
    shown, because a number or name in it stands for one that only the author knows.
    """

    text: str
    edits: tuple[Edit, ...] = ()
    certainty: Literal["safe", "guess", "example"] = "guess"


_SEVERITIES: dict[str, Literal["error", "warning", "note"]] = {"E": "error", "W": "warning", "N": "note"}


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One finding. `message` stands alone; `label` is written under the primary span.

    `span` is None where no script is concerned (a missing file, say); `path` then names it. With a
    span, `path` is that of its script. Lines and columns count from 1, and are 0 without a span.
    """

    code: str
    message: str
    span: Span | None = None
    label: str = ""
    labels: tuple[Label, ...] = ()
    helps: tuple[Help, ...] = ()
    notes: tuple[str, ...] = ()
    path: str = ""

    def __post_init__(self) -> None:
        if self.span is not None and not self.path:
            object.__setattr__(self, "path", self.span.source.path)

    @property
    def severity(self) -> Literal["error", "warning", "note"]:
        """By the letter of the code; a note is what `debug` shows."""
        return _SEVERITIES[self.code[0]]

    @property
    def line(self) -> int:
        return self.span.line if self.span else 0

    @property
    def column(self) -> int:
        return self.span.column if self.span else 0

    @property
    def end_line(self) -> int:
        return self.span.end_position[0] if self.span else 0

    @property
    def end_column(self) -> int:
        """Of the first character behind."""
        return self.span.end_position[1] if self.span else 0


class BlobscriptError(Exception):
    """Base of every exception that this package raises on purpose."""


class MissingError(BlobscriptError):
    """A library or program that the command needs is not installed; the text says how to get it. Exit code 3."""


class ProgramError(BlobscriptError):
    """A script with errors. `diagnostics` holds all of them, warnings included."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        self.diagnostics: tuple[Diagnostic, ...] = tuple(diagnostics)
        first = next((d for d in self.diagnostics if d.severity == "error"), None)
        super().__init__(_headline(first) if first else "the program has errors")


def _headline(error: Diagnostic) -> str:
    place = f"{error.path}:{error.line}:{error.column}" if error.span else error.path
    return f"{place}: error[{error.code}]: {error.message}" if place else f"error[{error.code}]: {error.message}"


def has_errors(diagnostics: Iterable[Diagnostic]) -> bool:
    return any(d.severity == "error" for d in diagnostics)


#: Code -> short title. The numbers are part of the contract: add to the ends, never renumber.
CODES: dict[str, str] = {
    "E0101": "unclosed bracket or text",
    "E0102": "unexpected closing bracket",
    "E0103": "unexpected word",
    "E0104": "two items on a line",
    "E0105": "comma in a block",
    "E0106": "header without parentheses",
    "E0107": "reserved word",
    "E0108": "bad number or unit",
    "E0109": "unknown character",
    "E0201": "unknown name",
    "E0202": "defined twice",
    "E0203": "unknown field",
    "E0204": "import not found",
    "E0205": "name not in module",
    "E0206": "cycle",
    "E0207": "file outside the scene's folder",
    "E0301": "angle or number",
    "E0302": "missing argument",
    "E0303": "unknown argument",
    "E0304": "wrong type",
    "E0305": "needs a type",
    "E0306": "not callable",
    "E0307": "no block here",
    "E0308": "list elements differ",
    "E0309": "branches differ",
    "E0310": "operator not defined",
    "E0311": "never equal",
    "E0401": "no surface",
    "E0402": "two cameras",
    "E0403": "bad mesh",
    "E0404": "degenerate or ill-defined skeleton",
    "E0405": "bad number",
    "E0406": "radius, reach and weight do not fit",
    "E0407": "a function that cannot be a texture",
    "E0501": "kernel ends",
    "E0502": "kernel not flat at its ends",
    "E0503": "kernel rises",
    "E0504": "kernel jumps",
    "E0505": "kernel has a kink",
    "E0506": "kernel not proved",
    "E0601": "parameter out of range",
    "E0602": "unknown parameter",
    "E0603": "parameter of the wrong type",
    "E0701": "assertion failed",
    "E0801": "cannot read",
    "E0802": "cannot write",
    "E0803": "unknown format",
    "E0901": "budget exceeded",
    "E1001": "not a scene for POV-Ray",
    "E1002": "not read from POV-Ray",
    "E1003": "POV-Ray failed",
    "E1004": "POV-Ray is missing",
    "E1101": "not a film",
    "N0701": "value shown by debug",
    "N1001": "approximated in POV-Ray",
    "N1002": "left out of the import",
    "W0401": "surface proved empty",
    "W0402": "defined but never placed",
    "W0403": "outside the camera",
    "W0404": "camera inside",
    "W0405": "hidden by a negative weight",
    "W0406": "without effect",
    "W0407": "threshold not positive",
    "W0501": "waiver without effect",
}
