"""Diagnostics -> text for people. `interchange` writes the same as JSON and SARIF."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from blobscript.diagnostics import Diagnostic, Help
from blobscript.excerpt import Mark, edited_lines, marked_lines
from blobscript.interchange import to_json, to_sarif
from blobscript.paint import Paint
from blobscript.source import Source

__all__ = ["render", "render_all", "sorted_by_place", "summary", "to_json", "to_sarif"]


def render_all(diagnostics: Iterable[Diagnostic], color: bool = False) -> str:
    """All of them in order of place, with a blank line between, and the summary. Ends with a line end."""
    ordered = sorted_by_place(diagnostics)
    parts = [render(diagnostic, color) for diagnostic in ordered]
    return "\n\n".join([*parts, summary(ordered)]) + "\n" if ordered else ""


def sorted_by_place(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """By file (in the order in which files first appear), then by place; without a place comes first."""
    diagnostics = list(diagnostics)
    files: dict[str, int] = {}
    for diagnostic in diagnostics:
        files.setdefault(_path(diagnostic), len(files))
    return sorted(diagnostics, key=lambda d: (files[_path(d)], d.span.start if d.span else -1))


def _path(diagnostic: Diagnostic) -> str:
    return diagnostic.span.source.path if diagnostic.span else diagnostic.path


def render(diagnostic: Diagnostic, color: bool = False) -> str:
    """One diagnostic, without a line end at its end."""
    paint = Paint(color, diagnostic.severity)
    marks = _marks(diagnostic)
    gutter = _gutter(diagnostic, marks)
    margin = paint.gutter(f"{'':{gutter}} |")
    title = paint.title(f"{diagnostic.severity}[{diagnostic.code}]")
    rows = [title + paint.strong(f": {diagnostic.message}")]
    rows += _excerpts(diagnostic, marks, gutter, paint)
    if marks:
        rows.append(margin)
    for help_ in diagnostic.helps:
        rows += _help(help_, gutter, paint)
    for note in diagnostic.notes:
        rows += _bullet("note", note, gutter, paint)
    rows += _bullet("more", f"blobscript explain {diagnostic.code}", gutter, paint)
    return "\n".join(rows)


def _marks(diagnostic: Diagnostic) -> list[Mark]:
    if diagnostic.span is None:
        return []
    labels = [Mark(label.span, label.text, False) for label in diagnostic.labels]
    return [Mark(diagnostic.span, diagnostic.label, True), *labels]


def _gutter(diagnostic: Diagnostic, marks: Sequence[Mark]) -> int:
    """Digits of the largest line number shown."""
    lines = [mark.span.line for mark in marks]
    for help_ in diagnostic.helps:
        lines += [edit.span.end_position[0] + edit.replacement.count("\n") for edit in help_.edits]
    return len(str(max(lines, default=1)))


def _excerpts(diagnostic: Diagnostic, marks: list[Mark], gutter: int, paint: Paint) -> list[str]:
    """The primary source first, under `-->`; other files under `:::`, in the order of the labels."""
    if not marks:
        return [f"{paint.gutter(' --> ')}{diagnostic.path}"] if diagnostic.path else []
    margin = paint.gutter(f"{'':{gutter}} |")
    sources: dict[int, tuple[Source, list[Mark]]] = {}
    for mark in marks:
        sources.setdefault(id(mark.span.source), (mark.span.source, []))[1].append(mark)
    rows: list[str] = []
    for source, here in sources.values():
        arrow = ":::" if rows else "-->"
        first = here[0].span
        rows.append(f"{paint.gutter(' ' * gutter + arrow)} {source.path}:{first.line}:{first.column}")
        rows += [margin, *marked_lines(here, gutter, paint)]
    return rows


def _help(help_: Help, gutter: int, paint: Paint) -> list[str]:
    rows = _bullet("help", help_.text, gutter, paint)
    if help_.edits:
        rows += [paint.gutter(f"{'':{gutter}} |"), *edited_lines(help_.edits, gutter, paint)]
    return rows


def _bullet(word: str, text: str, gutter: int, paint: Paint) -> list[str]:
    """`= help: …`; further lines of the text stand under its first."""
    head = f"{'':{gutter}} = {word}: "
    first, *rest = text.split("\n")
    rows = [f"{paint.gutter(' ' * gutter + ' =')} {paint.strong(word + ':')} {first}"]
    return rows + [(" " * len(head) + line).rstrip() for line in rest]


def summary(diagnostics: Iterable[Diagnostic]) -> str:
    """`2 errors, 1 warning. 1 safe fix (check --fix), 1 guess to confirm (check --fix --ask)`."""
    diagnostics = list(diagnostics)
    errors = sum(d.severity == "error" for d in diagnostics)
    warnings = sum(d.severity == "warning" for d in diagnostics)
    counts = [_count(errors, "error", "errors"), _count(warnings, "warning", "warnings")]
    helps = [help_ for d in diagnostics for help_ in d.helps if help_.edits]
    safe = sum(help_.certainty == "safe" for help_ in helps)
    guesses = sum(help_.certainty == "guess" for help_ in helps)
    fixes = [
        f"{_count(safe, 'safe fix', 'safe fixes')} (check --fix)" if safe else "",
        f"{_count(guesses, 'guess', 'guesses')} to confirm (check --fix --ask)" if guesses else "",
    ]
    parts = [", ".join(filter(None, counts)) or "no errors", ", ".join(filter(None, fixes))]
    return ". ".join(filter(None, parts))


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}" if number else ""
