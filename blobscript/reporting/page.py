"""A report as one HTML file that needs nothing else: plots as SVG, the picture inside, made for screen and paper."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from blobscript.images import srgb_encode
from blobscript.plots.style import svg_text
from blobscript.reporting.content import Report
from blobscript.reporting.sections import Section, sections
from blobscript.reporting.summary import search_sentences
from blobscript.reporting.tables import Table, header_rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from blobscript.scene import Scene

__all__ = ["STYLE", "document", "figure_tag", "page", "picture_tag", "section_html", "table_html"]

STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; color: #1a1a1a; background: #fff;
  margin: 0 auto; padding: 2rem 1.5rem 4rem; max-width: 1060px; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .5rem; border-top: 1px solid #d9dce0; padding-top: 1.1rem; }
.top { display: flex; gap: 1.6rem; align-items: flex-start; }
.top img { width: 380px; max-width: 42%; border-radius: 6px; }
.summary { font-size: 1.08rem; }
.summary p { margin: 0 0 .7rem; }
.summary p:first-child { font-weight: 600; }
figure { margin: 1.2rem 0; }
figure img { width: 100%; height: auto; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .76rem; font-variant-numeric: tabular-nums; margin: .8rem 0; }
th, td { padding: .2rem .38rem; text-align: right; white-space: nowrap; border-bottom: 1px solid #e8eaed; }
th { font-weight: 600; border-bottom: 1px solid #5f6368; vertical-align: bottom; white-space: normal; }
th:first-child, td:first-child { text-align: left; }
tr.best td { background: #e6f2fa; font-weight: 600; }
.facts { font-size: .85rem; }
.facts td { text-align: left; white-space: normal; vertical-align: top; border: none; padding: .1rem .8rem .1rem 0; }
.facts td:first-child { color: #5f6368; }
.note { font-size: .8rem; color: #5f6368; max-width: 52rem; }
details summary { cursor: pointer; color: #0072b2; }
@media print {
  html { font-size: 10.5px; }
  body { font-size: 11px; max-width: none; padding: 0; }
  h2 { break-after: avoid; }
  figure, tr { break-inside: avoid; }
  .scroll { overflow: visible; }
  table { font-size: 7.6px; }
  th, td { padding: 1px 3px; }
}
@media (max-width: 700px) { .top { display: block; } .top img { max-width: 100%; width: 100%; } }
"""


def page(report: Report) -> str:
    """The whole file."""
    title = f"{report.header.script}: error against run time"
    body = "".join(section_html(section) for section in sections(report))
    told = search_sentences(report.searches)
    return document(title, told, picture_tag(report.scene), header_rows(report.header), body)


def document(title: str, told: list[str], picture: str, facts: list[tuple[str, str]], body: str) -> str:
    """told: sentences, the first of which is the most important; picture and body: HTML."""
    name = html.escape(title)
    sentences = "".join(f"<p>{html.escape(sentence)}</p>" for sentence in told)
    rows = "".join(f"<tr><td>{html.escape(k)}</td><td>{html.escape(v)}</td></tr>" for k, v in facts)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{name}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style></head><body>\n'
        f'<h1>{name}</h1>\n<div class="top"><div class="summary">{sentences}</div>{picture}</div>\n'
        f'<table class="facts">{rows}</table>\n{body}</body></html>\n'
    )


def section_html(section: Section) -> str:
    parts = [f"<section><h2>{html.escape(section.title)}</h2><p>{html.escape(section.finding)}</p>\n"]
    parts += [figure_tag(words, make) for words, make in section.figures]
    if section.table:
        parts.append(table_html(section.table))
    return "".join(parts) + "</section>\n"


def figure_tag(words: str, make: Callable[[], Figure]) -> str:
    """A figure as SVG inside the page."""
    data = base64.b64encode(svg_text(make()).encode("utf-8")).decode("ascii")
    return f'<figure><img alt="{html.escape(words)}" src="data:image/svg+xml;base64,{data}"></figure>\n'


def table_html(table: Table) -> str:
    head = "".join(f"<th>{html.escape(column)}</th>" for column in table.columns)
    rows: list[str] = []
    for number, row in enumerate(table.rows):
        cells = "".join(f"<td>{html.escape(cell)}</td>" for cell in row)
        rows.append(f'<tr class="best">{cells}</tr>' if number in table.marked else f"<tr>{cells}</tr>")
    note = f'<p class="note">{html.escape(table.note)}</p>' if table.note else ""
    return f'<div class="scroll"><table><tr>{head}</tr>{"".join(rows)}</table></div>{note}\n'


def picture_tag(scene: Scene, width: int = 520) -> str:
    """The scene's picture as PNG inside the page."""
    from matplotlib.image import imsave  # pyright: ignore[reportUnknownVariableType]

    height = max(round(width * scene.ir.height / scene.ir.width), 1)
    image = scene.render(width=width, height=height, samples=16)
    buffer = io.BytesIO()
    write: Any = imsave  # pyright: ignore[reportUnknownVariableType]
    write(buffer, np.clip(srgb_encode(image.rgba[..., :3]), 0.0, 1.0), format="png")
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f'<img alt="the scene" src="data:image/png;base64,{data}">'
