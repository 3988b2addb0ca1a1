"""Rows of results as text, JSON, Markdown and a page for a course."""

from __future__ import annotations

import html
import json
import math
import re
from collections.abc import Sequence
from typing import Any

from blobscript.stress.cases import GROUPS
from blobscript.stress.running import EXACT, OTHERS, Outcome, Row

__all__ = ["as_html", "as_json", "as_markdown", "as_text", "summary"]

#: The case that evaluations are compared with.
_EASY = ("grazing", "easy")
_HEAD = ("case", "result", "error", "effort", "us/ray")


def _easy(rows: Sequence[Row]) -> float:
    """Evaluations per ray of the easy case; those of the cheapest one where it did not run."""
    counts = {(row.case.group, row.case.id): row.outcomes["sandwich"].evaluations for row in rows if row.outcomes}
    return counts.get(_EASY) or min((c for c in counts.values() if c > 0), default=1.0)


def _cells(row: Row, easy: float) -> list[str]:
    """Result, conditioned error, evaluations against the easy case, time, and rays right of the others."""
    if not row.outcomes:
        word = f"refused: {row.case.refused}" if row.passed else "FAILED"
        return [word, "", "", "", *("" for _ in OTHERS)]
    ours = row.outcomes["sandwich"]
    return [
        "right" if row.passed else "FAILED",
        f"{ours.error:.2g}",
        f"{ours.evaluations / easy:.3g} x",
        f"{ours.seconds * 1e6:.3g}",
        *(_right(row.outcomes[name]) for name in OTHERS),
    ]


def _right(outcome: Outcome) -> str:
    """With the conditioned error of what is right."""
    if outcome.wrong:
        return f"{outcome.wrong} of {outcome.right + outcome.wrong} wrong"
    return f"right, {outcome.error:.0e}".replace("e+0", "e").replace("e-0", "e-") if outcome.error > 1 else "right"


def _columns(rows: Sequence[Row]) -> list[str]:
    asked = any("POV-Ray" in row.outcomes for row in rows)
    return [*_HEAD, *OTHERS, *(["POV-Ray"] if asked else [])]


def _lines(rows: Sequence[Row]) -> list[list[str]]:
    easy, columns = _easy(rows), _columns(rows)
    lines: list[list[str]] = []
    for row in rows:
        line = [row.case.id, *_cells(row, easy)]
        if "POV-Ray" in columns:
            outcome = row.outcomes.get("POV-Ray")
            line.append(_right(outcome) if outcome else ("" if row.case.refused else "-"))
        lines.append(line)
    return lines


def summary(rows: Sequence[Row]) -> str:
    failed = sum(not row.passed for row in rows)
    rays = sum(len(row.case.rays) for row in rows)
    worst = max((row.outcomes[name].error for row in rows if row.outcomes for name in EXACT), default=0.0)
    verdict = "all right" if not failed else f"{failed} FAILED"
    largest = f"largest conditioned error {worst:.2g} (1 is what rounding explains)"
    return f"{len(rows)} cases, {rays} rays: {verdict}; {largest}"


# ---- text ----------------------------------------------------------------------------------------------


def as_text(rows: Sequence[Row]) -> str:
    lines, columns = _lines(rows), _columns(rows)
    widths = [max(len(line[k]) for line in [columns, *lines]) for k in range(len(columns))]
    out: list[str] = []
    group = ""
    for row, line in zip(rows, lines, strict=True):
        if row.case.group != group:
            group = row.case.group
            head = [group, *columns[1:]]
            out += ["", "  ".join(f"{text:<{width}}" for text, width in zip(head, widths, strict=True)).rstrip()]
        out.append("  ".join(f"{text:<{width}}" for text, width in zip(line, widths, strict=True)).rstrip())
        out += [f"    {fault}" for fault in row.faults]
    return "\n".join([*out[1:], "", summary(rows), ""])


# ---- JSON ----------------------------------------------------------------------------------------------


def as_json(rows: Sequence[Row]) -> str:
    easy = _easy(rows)
    cases = [
        {
            "id": row.case.id,
            "group": row.case.group,
            "title": row.case.title,
            "about": row.case.about,
            "passed": row.passed,
            "faults": row.faults,
            "refused": row.case.refused or None,
            "rays": len(row.case.rays),
            "load_seconds": row.load_seconds,
            "outcomes": {name: _facts(outcome, easy) for name, outcome in row.outcomes.items()},
        }
        for row in rows
    ]
    return json.dumps({"passed": all(row.passed for row in rows), "summary": summary(rows), "cases": cases}, indent=1)


def _facts(outcome: Outcome, easy: float) -> dict[str, Any]:
    return {
        "right": outcome.right,
        "wrong": outcome.wrong,
        "conditioned_error": outcome.error,
        "evaluations": outcome.evaluations,
        "against_easy": outcome.evaluations / easy,
        "seconds_per_ray": outcome.seconds if math.isfinite(outcome.seconds) else None,
    }


# ---- Markdown and HTML -----------------------------------------------------------------------------------


def as_markdown(rows: Sequence[Row]) -> str:
    parts = ["# Stiff and extreme cases", "", _INTRODUCTION, "", f"**{summary(rows)}.**"]
    for group, about in GROUPS.items():
        mine = [row for row in rows if row.case.group == group]
        if mine:
            parts += ["", f"## {group.capitalize()}", "", about, "", *_markdown_table(mine, rows), ""]
            parts += [f"- **{row.case.title}** (`{row.case.id}`): {row.case.about}" for row in mine]
    return "\n".join(parts) + "\n"


def _markdown_table(mine: Sequence[Row], rows: Sequence[Row]) -> list[str]:
    columns = _columns(rows)
    lines = [line for row, line in zip(rows, _lines(rows), strict=True) if row in mine]
    return [
        f"| {' | '.join(columns)} |",
        f"|{'---|' * len(columns)}",
        *(f"| {' | '.join(line)} |" for line in lines),
    ]


_INTRODUCTION = (
    "Each case is a script with rays whose first hits are certified by ball arithmetic. *error* is the largest "
    "distance to "
    "the certified hit, in units of what rounding to double precision explains (the conditioned error: 1 or less "
    "is as good "
    "as it gets). *effort* is the number of evaluations per ray against that of the easy case, a ball; *us/ray* "
    "is processor "
    "time. The searches march, sphere and segment run with their default step and tolerance on the same rays: "
    "wrong is a hit "
    "missed or made up, or one off by more than a thousandth of the smallest reach; the number is their error."
)

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
h1 { font-size: 1.9rem } h2 { margin-top: 2.5rem; border-bottom: 2px solid #2a9d8f; padding-bottom: .2rem }
table { border-collapse: collapse; width: 100%; font-size: .85rem; margin: 1rem 0 }
th, td { text-align: left; padding: .3rem .6rem; border-bottom: 1px solid #ddd; white-space: nowrap }
th { background: #f3f7f6 } td:first-child { white-space: normal }
.right { color: #1b7a43 } .wrong { color: #b3261e; font-weight: 600 } .plain { color: #777 }
summary { cursor: pointer; font-weight: 600 } details { margin: .6rem 0 } pre { background: #f6f6f6; padding: .7rem;
overflow-x: auto; font-size: .8rem; border-radius: 4px } .verdict { font-size: 1.1rem; padding: .8rem 1rem; background:
#eef6f4; border-left: 5px solid #2a9d8f } .failed { background: #fdecea; border-color: #b3261e }
@media print { details > * { display: block } body { max-width: none } }
"""


def as_html(rows: Sequence[Row]) -> str:
    """One self-contained page: what each group and case is about, the table, and the scripts to try."""
    introduction = re.sub(r"[*]([^*]+)[*]", r"<i>\1</i>", html.escape(_INTRODUCTION))
    failed = "" if all(row.passed for row in rows) else " failed"
    parts = [
        f'<p class="verdict{failed}">{html.escape(summary(rows))}.</p>',
        f"<p>{introduction}</p>",
    ]
    for group, about in GROUPS.items():
        mine = [row for row in rows if row.case.group == group]
        if mine:
            parts += [f"<h2>{group.capitalize()}</h2>", f"<p>{html.escape(about)}</p>", _html_table(mine, rows)]
            parts += [_html_case(row) for row in mine]
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>Stiff and extreme cases</title>'
        f"<style>{_STYLE}</style></head>\n<body><h1>Stiff and extreme cases</h1>\n{body}\n</body></html>\n"
    )


def _html_table(mine: Sequence[Row], rows: Sequence[Row]) -> str:
    columns = _columns(rows)
    head = "".join(f"<th>{html.escape(column)}</th>" for column in columns)
    lines = [(row, line) for row, line in zip(rows, _lines(rows), strict=True) if row in mine]
    body = "\n".join(f"<tr>{''.join(map(_html_cell, [row.case.title, *line[1:]]))}</tr>" for row, line in lines)
    return f"<table><tr>{head}</tr>\n{body}</table>"


def _html_cell(text: str) -> str:
    kind = "right" if text.startswith("right") else "wrong" if "wrong" in text or text == "FAILED" else ""
    return f'<td class="{kind}">{html.escape(text)}</td>' if kind else f"<td>{html.escape(text)}</td>"


def _html_case(row: Row) -> str:
    faults = "".join(f'<p class="wrong">{html.escape(fault)}</p>' for fault in row.faults)
    return (
        f"<details><summary>{html.escape(row.case.title)}</summary><p>{html.escape(row.case.about)}</p>{faults}"
        f"<pre>{html.escape(row.case.script)}</pre></details>"
    )
