"""The same measurements over many scenes, beside the peers that are installed, for one table."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from blobscript.diagnostics import ProgramError
from blobscript.driver import load
from blobscript.plots import style
from blobscript.reporting import figures
from blobscript.reporting.as_json import finite, judgement_facts, povray_facts, result_facts
from blobscript.reporting.content import Stage
from blobscript.reporting.header import Header, Machine, make_header, this_machine
from blobscript.reporting.judging import RULE_OF_THREE
from blobscript.reporting.markdown import table_markdown
from blobscript.reporting.page import document, figure_tag, table_html
from blobscript.reporting.peers import MeshPair, measure_mesh_pair, scikit_image_version
from blobscript.reporting.pov import PovRay, PovResult, measure_povray
from blobscript.reporting.rays import make_rays, unit_of
from blobscript.reporting.reference import certify
from blobscript.reporting.searches import Result, measure_searches
from blobscript.reporting.summary import best_search, setting_words
from blobscript.reporting.tables import Table
from blobscript.reporting.timing import REPEATS
from blobscript.reporting.words import count, factor, joined, length, micro, percent, plural, seconds

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Bench", "Row", "bench_json", "bench_markdown", "bench_page", "bench_sentences", "bench_table", "make_bench"]

_RAYS, _QUICK_RAYS = (3000, 500), (900, 150)


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One scene."""

    header: Header
    searches: list[Result]
    povray: PovRay | None
    meshes: MeshPair | None

    @property
    def default(self) -> Result:
        return next(r for r in self.searches if r.method.search == "sandwich" and r.method.is_default)

    @property
    def peer(self) -> PovResult | None:
        return self.povray.results[0] if self.povray and self.povray.results else None

    @property
    def name(self) -> str:
        return Path(self.header.script).stem


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """failed: (script, why) of those that have errors."""

    machine: Machine
    scikit_image: str | None
    rows: list[Row]
    failed: list[tuple[str, str]]


def make_bench(
    paths: Iterable[str], stage: Stage, *, quick: bool = False, seed: int = 0, workers: int | None = None
) -> Bench:
    rows: list[Row] = []
    failed: list[tuple[str, str]] = []
    for path in paths:
        try:
            rows.append(_row(path, stage, quick, seed, workers))
        except ProgramError as error:
            failed.append((path, str(error)))
    return Bench(this_machine(), scikit_image_version(), rows, failed)


def _row(path: str, stage: Stage, quick: bool, seed: int, workers: int | None) -> Row:
    scene, name = load(path), Path(path).stem
    rays = make_rays(scene, *(_QUICK_RAYS if quick else _RAYS), seed)
    reference = certify(scene.ir, rays, workers, stage(f"{name}: certifying"))
    unit = unit_of(scene.ir)
    return Row(
        make_header(scene, path, rays, reference, unit, REPEATS),
        measure_searches(scene, rays, reference, unit, True, stage(f"{name}: searches")),
        measure_povray(scene, rays, reference, unit, quick, stage(f"{name}: POV-Ray"), swept=False),
        measure_mesh_pair(scene, rays, reference),
    )


# ---- words -------------------------------------------------------------------------------------


def bench_sentences(bench: Bench) -> list[str]:
    """What holds over all scenes."""
    if not bench.rows:
        return ["No scene could be measured."]
    counts = [row.default.judgement.all for row in bench.rows]
    rays, bad = sum(c.rays for c in counts), sum(c.bad for c in counts)
    worst = max((row.default.judgement.errors.conditioned for row in bench.rows), default=0.0)
    mistakes = "no mistake" if bad == 0 else plural(bad, "mistake")
    told = [
        f"The default search makes {mistakes} on {count(rays)} certified rays of {plural(len(bench.rows), 'scene')}; "
        f"errors reach {worst:.2g} of what rounding makes unavoidable."
    ]
    return [*told, *_povray_sentences(bench), *_mesh_sentences(bench)]


def _povray_sentences(bench: Bench) -> list[str]:
    pairs = [(row, row.peer) for row in bench.rows if row.peer is not None]
    if not pairs:
        return []
    ratios = [peer.time.least / row.default.time.least for row, peer in pairs]
    bad = sum(peer.judgement.all.bad for _, peer in pairs)
    rays = sum(peer.judgement.all.rays for _, peer in pairs)
    version = next(row.povray.version for row in bench.rows if row.povray)
    mistakes = "no mistake" if bad == 0 else plural(bad, "mistake")
    return [
        f"POV-Ray {version} takes {_range(ratios)} as long per ray and makes {mistakes} on {count(rays)} rays "
        f"({plural(len(pairs), 'scene')} that it can show)."
    ]


def _mesh_sentences(bench: Bench) -> list[str]:
    pairs = [(row.meshes.ours, row.meshes.theirs) for row in bench.rows if row.meshes and row.meshes.theirs]
    if not pairs:
        return []
    pace = [b.time.least / a.time.least for a, b in pairs]
    error = [b.to_mesh.p99 / a.to_mesh.p99 for a, b in pairs if a.to_mesh.p99 > 0.0]
    return [
        f"Meshing with the same cells, scikit-image {bench.scikit_image} takes {_range(pace)} as long, with "
        f"{_range(error)} the error."
    ]


def _range(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return factor(low) if high < 1.1 * low else f"{factor(low).removesuffix(' times')} to {factor(high)}"


def bench_table(bench: Bench) -> Table:
    rows = [_cells(row) for row in bench.rows]
    columns = (
        "scene", "elements", "hits / rays", "mistakes", "largest error", "time/ray", "quickest as good",
        "POV-Ray as", "mistakes", "largest error", "time/ray", "mesh error", "time", "scikit-image error", "time",
    )  # fmt: skip
    note = (
        "Certified rays, grazing ones among them; mistakes: missed, false or another root. Errors in scene units; of "
        "meshes: 99 % of distances from certified hits to a mesh of 64 cells along the longest side. One thread, "
        "processor time, least of the runs. POV-Ray: its trace phase at quality 1, the text of `compile --to pov`."
    )
    failed = [f"Not measured: {path}: {why}." for path, why in bench.failed]
    refused = [
        f"POV-Ray and {row.name}: {'; '.join(row.povray.refused)}."
        for row in bench.rows
        if row.povray and row.povray.refused
    ]
    return Table(columns, tuple(rows), " ".join([note, *refused, *failed]))


def _cells(row: Row) -> tuple[str, ...]:
    j = row.default.judgement
    best = best_search(row.searches)
    peer, meshes = row.peer, row.meshes
    return (
        row.name,
        count(row.header.elements),
        f"{count(j.all.hits)} / {count(j.all.rays)}",
        str(j.all.bad),
        length(j.errors.max),
        micro(row.default.time.least),
        "–" if best is None else setting_words(best),
        "–" if row.povray is None or peer is None else joined(list(row.povray.forms)),
        *(("–",) * 3 if peer is None else _peer_cells(peer)),
        *(("–",) * 2 if meshes is None else (length(meshes.ours.to_mesh.p99), seconds(meshes.ours.time.least))),
        *(
            ("–",) * 2
            if meshes is None or meshes.theirs is None
            else (length(meshes.theirs.to_mesh.p99), seconds(meshes.theirs.time.least))
        ),
    )


def _peer_cells(peer: PovResult) -> tuple[str, str, str]:
    return str(peer.judgement.all.bad), length(peer.judgement.errors.max), micro(peer.time.least)


def _facts(bench: Bench) -> list[tuple[str, str]]:
    machine = bench.machine
    rays = sum(row.default.judgement.all.rays for row in bench.rows)
    peers = [f"POV-Ray {row.povray.version}" for row in bench.rows if row.povray][:1]
    peers += [f"scikit-image {bench.scikit_image}"] if bench.scikit_image else []
    floor = percent(RULE_OF_THREE / max(rays, 1))
    return [
        ("Peers", joined(peers) or "none installed"),
        ("Reference", f"{count(rays)} rays, each certified; 0 mistakes means fewer than {floor} with 95 % confidence"),
        ("Timing", f"processor time, least of {REPEATS} interleaved rounds after a warm-up, one thread"),
        ("Machine", f"{machine.processor}, {machine.cores} cores, {machine.system}"),
        (
            "Versions",
            f"blobscript {machine.blobscript} ({machine.compiler}; runs {machine.instructions}), "
            f"Python {machine.python}, NumPy {machine.numpy}",
        ),
    ]


# ---- figures -----------------------------------------------------------------------------------


def _panels(bench: Bench) -> Figure:
    """A small diagram per scene: largest error against time, a curve per search, POV-Ray beside them."""
    with style.styled():
        columns = min(4, max(len(bench.rows), 1))
        lines = -(-len(bench.rows) // columns)
        figure = style.new_figure(10.2, 2.3 * lines + 1.3)
        panels = np.atleast_1d(figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False).ravel())
        style.titled(figure, "Every scene", "largest distance error (scene units) against time per ray (µs)")
        for axes, row in zip(panels, bench.rows, strict=False):
            figures.search_curves(axes, row.searches)
            if row.peer is not None and np.isfinite(row.peer.judgement.errors.max):
                error = max(row.peer.judgement.errors.max, figures.ERROR_FLOOR)
                axes.plot([error], [1e6 * row.peer.time.least], "*", color=style.INK, markersize=9)
            axes.set_title(row.name, fontsize=9)
        for axes in panels[len(bench.rows) :]:
            axes.set_visible(False)
        figures.search_legend(figure, bench.rows[0].searches, (("POV-Ray", "*"),))
    return figure


# ---- forms -------------------------------------------------------------------------------------


def bench_markdown(bench: Bench) -> str:
    told = "\n".join(bench_sentences(bench))
    facts = table_markdown(Table(("", ""), tuple(_facts(bench))))
    return f"# Error against run time\n\n{told}\n\n{table_markdown(bench_table(bench))}\n\n{facts}\n"


def bench_page(bench: Bench) -> str:
    shown = figure_tag("A diagram per scene", lambda: _panels(bench)) if bench.rows else ""
    return document(
        "Error against run time", bench_sentences(bench), "", _facts(bench), shown + table_html(bench_table(bench))
    )


def bench_json(bench: Bench) -> str:
    facts: dict[str, Any] = {
        "summary": bench_sentences(bench),
        "machine": asdict(bench.machine),
        "scikit_image": bench.scikit_image,
        "failed": bench.failed,
        "scenes": [
            {
                "header": asdict(row.header),
                "default": judgement_facts(row.default.judgement),
                "searches": [result_facts(r, row.searches) for r in row.searches],
                "povray": None if row.povray is None else povray_facts(row.povray),
                "meshes": None if row.meshes is None else asdict(row.meshes),
            }
            for row in bench.rows
        ],
    }
    return json.dumps(finite(facts), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
