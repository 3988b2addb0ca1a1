"""A report as Markdown: findings and tables, without the plots."""

from __future__ import annotations

from blobscript.reporting.content import Report
from blobscript.reporting.sections import sections
from blobscript.reporting.summary import search_sentences
from blobscript.reporting.tables import Table, header_rows

__all__ = ["markdown", "table_markdown"]


def markdown(report: Report) -> str:
    parts = [f"# {report.header.script}: error against run time", "\n".join(search_sentences(report.searches))]
    parts.append(table_markdown(Table(("", ""), tuple(header_rows(report.header)))))
    for section in sections(report):
        parts += [f"## {section.title}", section.finding]
        if section.table:
            parts.append(table_markdown(section.table))
    return "\n\n".join(part for part in parts if part) + "\n"


def table_markdown(table: Table) -> str:
    lines = [_row(table.columns), _row(("---", *("---:" for _ in table.columns[1:])))]
    lines += [_row(row if i not in table.marked else (f"**{row[0]}**", *row[1:])) for i, row in enumerate(table.rows)]
    return "\n".join(lines) + (f"\n\n{table.note}" if table.note else "")


def _row(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
