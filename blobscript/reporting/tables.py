"""The tables of a report, as text cells, for all forms of it."""

from __future__ import annotations

from dataclasses import dataclass

from blobscript.reporting.content import Report
from blobscript.reporting.header import Header
from blobscript.reporting.judging import RULE_OF_THREE
from blobscript.reporting.pov import PovRay, variant_words
from blobscript.reporting.searches import Result
from blobscript.reporting.summary import best_search, setting_words
from blobscript.reporting.words import count, joined, length, micro, percent, plural, seconds

__all__ = [
    "Table",
    "header_rows",
    "index_table",
    "mesh_table",
    "normal_table",
    "povray_table",
    "sampling_table",
    "search_table",
]


@dataclass(frozen=True, slots=True)
class Table:
    """rows: cells; marked: numbers of rows that stand out."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    marked: tuple[int, ...] = ()


def header_rows(header: Header) -> list[tuple[str, str]]:
    machine = header.machine
    certified = f"{count(header.picture_rays + header.grazing_rays)} rays, {count(header.hits)} hits"
    odd = [
        f"{count(number)} {word}"
        for number, word in (
            (header.touches, "touches"),
            (header.undecided, "undecided"),
            (header.unstable, "unstable"),
        )
        if number
    ]
    return [
        ("Script", f"{header.script}, scene {header.scene_hash[:16]}…"),
        *([("Parameters", header.parameters)] if header.parameters.strip("{} ") else []),
        (
            "Scene",
            f"{plural(header.surfaces, 'surface')}, {plural(header.elements, 'element')}; "
            f"unit (mean reach) {header.unit:.4g}",
        ),
        (
            "Rays",
            f"{count(header.picture_rays)} of a {header.width} x {header.height} picture, {count(header.grazing_rays)} "
            f"grazing; seed {header.seed}; sha256 {header.rays_hash[:16]}…",
        ),
        (
            "Reference",
            f"{certified}{', ' + ', '.join(odd) if odd else ''}, each certified in ball arithmetic; "
            f"sha256 {header.reference_hash[:16]}…",
        ),
        (
            "Timing",
            f"processor time, least of {header.repeats} interleaved rounds after a warm-up, {header.threads} thread",
        ),
        ("Machine", f"{machine.processor}, {machine.cores} cores, {machine.system}"),
        (
            "Versions",
            f"blobscript {machine.blobscript} ({machine.compiler}; runs {machine.instructions}), "
            f"Python {machine.python}, NumPy {machine.numpy}",
        ),
        ("Date", header.date),
    ]


def search_table(report: Report) -> Table:
    best = best_search(report.searches)
    rows = [_search_row(r) for r in report.searches]
    most = max(r.judgement.all.rays for r in report.searches)
    note = (
        f"Errors: distances along the ray in scene units, over right hits of picture rays. Conditioned: the largest in "
        f"units of what rounding makes unavoidable. Mistakes: in brackets those of "
        f"grazing rays; 0 of {count(most)} means fewer than {percent(RULE_OF_THREE / max(most, 1))} with 95 % "
        f"confidence. Slow settings are judged and timed on fewer rays, evenly spread. "
        f"Spread: from the least to the third quartile."
    )
    ended = [setting_words(r) for r in report.searches if r.last]
    if ended:
        note += f" Smaller tolerances would have taken too long after {joined(ended)}."
    marked = tuple(i for i, r in enumerate(report.searches) if r is best)
    columns = (
        "search", "tolerance or step", "rays", "time/ray", "spread", "evals/ray", "evals/ grazing", "median", "99 %",
        "largest", "conditioned", "missed", "false", "other root", "kind", "grazes",
    )  # fmt: skip
    if min(r.judgement.all.rays for r in report.searches) == most:  # the column would say nothing
        rows, columns = [row[:2] + row[3:] for row in rows], columns[:2] + columns[3:]
    return Table(columns, tuple(rows), note, marked)


def _search_row(r: Result) -> tuple[str, ...]:
    j, e = r.judgement, r.judgement.errors
    both = [
        (j.all.missed, j.grazing.missed),
        (j.all.false, j.grazing.false),
        (j.all.wrong_root, j.grazing.wrong_root),
        (j.all.wrong_kind, j.grazing.wrong_kind),
        (j.all.grazing, j.grazing.grazing),
    ]
    return (
        r.method.search,
        "default" if r.method.is_default else length(r.setting),
        count(j.all.rays),
        micro(r.time.least),
        percent(r.time.spread),
        f"{j.evaluations:.3g}",
        f"{j.grazing_evaluations:.3g}",
        length(e.median),
        length(e.p99),
        length(e.max),
        "–" if e.conditioned != e.conditioned else f"{e.conditioned:.2g}",
        *(f"{total} ({grazing})" if grazing else str(total) for total, grazing in both),
    )


def normal_table(report: Report) -> Table:
    rows = [
        (
            r.normals,
            length(r.step) if r.step else "–",
            length(r.errors.median),
            length(r.errors.p99),
            length(r.errors.max),
            micro(r.time.least),
            percent(r.time.spread),
        )
        for r in report.normals
    ]
    columns = ("normals", "step (units)", "median (rad)", "99 %", "largest", "time/ray", "spread")
    return Table(columns, tuple(rows), "Times are of the whole trace with normals.")


def index_table(report: Report) -> Table:
    rows = [
        (
            r.index,
            seconds(r.build.least),
            percent(r.build.spread),
            micro(r.trace.least),
            percent(r.trace.spread),
            seconds(r.total),
            f"{count(r.bytes / 1024)} KiB",
            str(r.judgement.all.bad),
        )
        for r in report.indexes
    ]
    columns = ("index", "build", "spread", "trace/ray", "spread", "total 640 x 480", "memory", "mistakes")
    least = min(range(len(rows)), key=lambda i: report.indexes[i].total)
    return Table(columns, tuple(rows), "All with the sandwich search.", (least,))


def mesh_table(report: Report) -> Table:
    rows = [
        (
            f"{r.cell:.4g}",
            count(r.triangles),
            length(r.to_mesh.median),
            length(r.to_mesh.p99),
            length(r.to_mesh.max),
            length(r.to_surface.p99),
            length(r.to_surface.max),
            count(r.open_edges),
            str(r.euler),
            seconds(r.time.least),
            percent(r.time.spread),
        )
        for r in report.meshes
    ]
    columns = (
        "cell", "triangles", "surface to mesh, median", "99 %", "largest", "mesh to surface, 99 %", "largest",
        "open edges", "Euler", "time", "spread",
    )  # fmt: skip
    note = "Distances in scene units; surface to mesh from certified hits, mesh to surface from vertices and middles."
    return Table(columns, tuple(rows), note)


def sampling_table(report: Report) -> Table:
    rows = [
        (
            r.words,
            f"{r.rms:.5f}",
            f"{r.worst:.3f}",
            percent(r.pixels),
            micro(r.time.least),
            percent(r.time.spread),
        )
        for r in report.sampling.results
    ]
    columns = ("samples", "root mean square", "largest", "pixels off by 1/255", "time/pixel", "spread")
    return Table(
        columns,
        tuple(rows),
        "sRGB values in 0 to 1; shading included. Noise: as many samples as each cell of 4 x 4 pixels needs for it.",
    )


def povray_table(povray: PovRay) -> Table:
    rows: list[tuple[str, ...]] = []
    for r in povray.results:
        j, e = r.judgement, r.judgement.errors
        both = [
            (j.all.missed, j.grazing.missed),
            (j.all.false, j.grazing.false),
            (j.all.wrong_root, j.grazing.wrong_root),
        ]
        rows.append(
            (
                variant_words(r),
                micro(r.time.least),
                percent(r.time.spread),
                f"{r.time.repeats} of width {r.width}",
                length(e.median),
                length(e.p99),
                length(e.max),
                *(f"{total} ({grazing})" if grazing else str(total) for total, grazing in both),
            )
        )
    columns = ("variant", "time/ray", "spread", "runs", "median", "99 %", "largest", "missed", "false", "other root")
    note = (
        "Times: processor seconds of its trace phase per pixel of small pictures at quality 1, one thread. Accuracy "
        "in scene units; max_gradient x 1 is the bound that blobscript proves for each piece."
    )
    return Table(columns, tuple(rows), " ".join([note, *(f"Left out: {text}." for text in povray.refused)]))
