"""The parts of a report in reading order: a finding, a figure, a table. HTML and Markdown are made from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from blobscript.reporting import figures, summary, tables
from blobscript.reporting.content import Report
from blobscript.reporting.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Section", "sections"]


@dataclass(frozen=True, slots=True)
class Section:
    """figures: (what it shows in words, how to make it)."""

    title: str
    finding: str
    figures: tuple[tuple[str, Callable[[], Figure]], ...] = ()
    table: Table | None = None


def sections(report: Report) -> list[Section]:
    parts = [_searches(report), _normals(report), _indexes(report), _meshes(report), _sampling(report), _povray(report)]
    return [*parts, _method()]


def _searches(report: Report) -> Section:
    shown: list[tuple[str, Callable[[], Figure]]] = []
    if report.searches[0].judgement.all.hits:
        shown = [
            ("Error against run time, a curve per search", lambda: figures.searches_figure(report)),
            ("Error against evaluations, a curve per search", lambda: figures.searches_figure(report, True)),
            ("Distance error of each pixel", lambda: figures.error_maps(report)),
        ]
    return Section(
        "Searches along the ray", summary.proof_sentence(report.searches), tuple(shown), tables.search_table(report)
    )


def _normals(report: Report) -> Section:
    finding = summary.normal_sentence(report.normals)
    if not finding:
        return Section("Normals", "No hit to have a normal.")
    shown = (("Angle error over the step", lambda: figures.normals_figure(report)),)
    return Section("Normals", finding, shown, tables.normal_table(report))


def _indexes(report: Report) -> Section:
    shown = (("Time to build and to trace", lambda: figures.indexes_figure(report)),)
    return Section("Spatial indexes", summary.index_sentence(report.indexes), shown, tables.index_table(report))


def _meshes(report: Report) -> Section:
    if not report.meshes or not report.meshes[0].triangles:
        return Section("Meshes", "The surface is empty: there is nothing to mesh.")
    shown = (("Distance between mesh and surface over the cell size", lambda: figures.meshes_figure(report)),)
    return Section("Meshes", summary.mesh_sentence(report.meshes), shown, tables.mesh_table(report))


def _sampling(report: Report) -> Section:
    shown = (("Picture error over samples per pixel", lambda: figures.sampling_figure(report)),)
    return Section("Antialiasing", summary.sampling_sentence(report.sampling), shown, tables.sampling_table(report))


def _povray(report: Report) -> Section:
    povray = report.povray
    if povray is None:
        return Section("POV-Ray", "POV-Ray is not installed here: nothing to compare with.")
    finding = summary.povray_sentence(povray, report.searches)
    if not povray.results:
        return Section("POV-Ray", finding)
    shown = (("POV-Ray's errors against its run time", lambda: figures.povray_figure(report)),)
    return Section("POV-Ray", finding, shown, tables.povray_table(povray))


def _method() -> Section:
    text = (
        "Reference hits come from interval branch and bound in ball arithmetic (256 bits and more): every one is "
        "proved, and shares no code with the tracer. Picture rays go through a seeded random place of each pixel; "
        "grazing rays follow tangents at a distance of 1e-2 to 1e-9 units. Another root: both hit, but farther apart "
        "than the ray's rounding tolerance, 1e-3 units and ten times the method's own tolerance; such distances are "
        "counted and never averaged in. Rays whose answer double precision cannot know are counted apart. Units are "
        "mean reaches of the scene's elements. There is no single precision mode to compare with."
    )
    return Section("How this was measured", text)
