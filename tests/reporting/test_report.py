"""Reports: what is counted and timed, what follows from it, and the files."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import blobscript
from blobscript import reporting
from blobscript.reporting import pov, summary
from blobscript.reporting.judging import Judgement, error_stats, judge
from blobscript.reporting.pov import measure_povray
from blobscript.reporting.rays import make_rays, unit_of
from blobscript.reporting.reference import HIT, MISS, Reference, certify
from blobscript.reporting.searches import Method, Result
from blobscript.reporting.timing import REPEATS, Timing, measure

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def report() -> reporting.Report:
    scene = blobscript.load(EXAMPLES / "hello.blob")
    return reporting.make_report(scene, "hello.blob", quick=True, seed=3, count=(600, 200), workers=1, povray=False)


# ---- rays and reference ------------------------------------------------------------------------------


def test_rays_are_seeded_and_graze() -> None:
    scene = blobscript.load(EXAMPLES / "hello.blob")
    rays, again, other = (make_rays(scene, 500, 100, seed) for seed in (1, 1, 2))
    assert rays.digest == again.digest != other.digest
    assert rays.width * rays.height == rays.picture
    assert abs(rays.picture - 500) < 40
    assert len(rays) == rays.picture + 100
    assert sorted(rays.pixel) == list(range(rays.picture))
    assert np.linalg.norm(rays.directions, axis=1) == pytest.approx(1.0)
    short = scene.first_hit(rays.origins[rays.picture :], rays.directions[rays.picture :])
    cosines = np.abs(np.einsum("ij,ij->i", short.normal, rays.directions[rays.picture :]))
    assert np.nanmin(cosines) < 1e-3  # chords so short that a random ray never makes one


def test_every_ray_is_certified(report: reporting.Report) -> None:
    reference, rays = report.reference, report.rays
    assert len(reference.status) == len(rays)
    assert set(reference.status.tolist()) == {HIT, MISS}
    hits = report.scene.first_hit(rays.origins, rays.directions)
    assert np.array_equal(hits.hit, reference.hit)
    assert np.all(reference.error(hits.t)[reference.hit] <= reference.tolerance[reference.hit])


def test_leaving_out_what_is_far_changes_no_hit() -> None:
    """Against hits certified with all elements."""
    from blobscript.certified import first_hit

    scene = blobscript.load(EXAMPLES / "gecko.blob")
    rays = make_rays(scene, 60, 0, 5)
    reference = certify(scene.ir, rays, workers=1)
    assert 0 < np.count_nonzero(reference.hit) < len(rays)
    for i in range(0, len(rays), 4):
        whole = first_hit(scene.ir, rays.origins[i], rays.directions[i])
        assert (whole.status == "hit") == bool(reference.hit[i])
        if reference.hit[i]:
            assert abs(whole.distance - reference.t[i]) <= 1e-15 * whole.distance
            assert abs(reference.t_low[i]) <= 1e-15 * whole.distance


def test_processes_and_one_agree() -> None:
    scene = blobscript.compile("surface { ball(radius = 1) }")
    rays = make_rays(scene, 400, 50, 0)
    assert certify(scene.ir, rays, workers=2).digest == certify(scene.ir, rays, workers=1).digest


# ---- judging -------------------------------------------------------------------------------------------


def test_every_mistake_has_its_name() -> None:
    inf, nan = np.inf, np.nan
    reference = Reference(
        status=np.array([1, 1, 1, 1, 0, 0, 1, 2], np.int8),
        t=np.array([1.0, 1.0, 1.0, 1.0, inf, inf, 1.0, inf]),
        t_low=np.zeros(8),
        kind=np.array([1, 1, 1, 1, 0, 0, 1, 0], np.int8),
        surface=np.array([0, 0, 0, 0, -1, -1, 0, -1], np.int32),
        tolerance=np.array([1e-15, 1e-15, 1e-15, 1e-15, nan, nan, 1e-15, nan]),
        stable=np.array([True] * 7 + [False]),
    )
    hits: Any = SimpleNamespace(
        status=np.array([1, 0, 1, 2, 1, 0, 1, 1], np.int8),
        t=np.array([1.0 + 4e-16, inf, 1.5, 1.0, 3.0, inf, 1.0 + 2e-3, 1.0]),
        hit=np.array([True, False, True, True, True, False, True, True]),
        evaluations=np.arange(8),
    )
    judged = judge(hits, reference, picture=6, unit=1.0)
    assert (judged.picture.right, judged.picture.missed, judged.picture.false) == (1, 1, 1)
    assert (judged.picture.wrong_root, judged.picture.wrong_kind) == (1, 1)
    assert (judged.grazing.wrong_root, judged.grazing.rays, judged.grazing.unstable) == (1, 1, 1)
    assert judged.all.bad == 5
    assert judged.errors.max == pytest.approx(4.44e-16, rel=1e-2)
    assert judged.bad.tolist() == [False, True, True, True, True, False, True, False]
    coarse = judge(hits, reference, picture=6, unit=1.0, tolerance=1e-3)
    assert coarse.grazing.wrong_root == 0  # within ten of its own tolerances


def test_errors_are_left_empty_where_there_are_none() -> None:
    assert np.isnan(error_stats(np.zeros(0)).max)


# ---- timing --------------------------------------------------------------------------------------------


def test_runs_are_interleaved_after_a_warm_up() -> None:
    calls: list[str] = []
    timed = measure({name: lambda name=name: calls.append(name) for name in "abc"}, seed=1)
    assert calls[:3] == ["a", "b", "c"]
    rounds = [calls[k : k + 3] for k in range(3, len(calls), 3)]
    assert len(rounds) == REPEATS >= 10
    assert all(sorted(r) == ["a", "b", "c"] for r in rounds)
    assert len({tuple(r) for r in rounds}) > 1
    assert all(t.repeats == REPEATS and t.least <= t.low <= t.median <= t.high for t in timed.values())


def test_more_work_takes_more_time() -> None:
    timed = measure({"little": lambda: sum(range(2_000)), "much": lambda: sum(range(200_000))})
    assert timed["much"].least > 10 * timed["little"].least
    assert timed["much"].per(100).least == pytest.approx(timed["much"].least / 100)


# ---- what follows --------------------------------------------------------------------------------------


def made_up(
    report: reporting.Report, search: Any, time: float, worst: float = 1e-15, bad: int = 0, **more: Any
) -> Result:
    old: Judgement = report.searches[0].judgement
    errors = replace(old.errors, max=worst, conditioned=worst / 2e-15)
    picture = replace(old.picture, missed=bad)
    timing = Timing(time, time, time, time, 10)
    return Result(Method(search, **more), replace(old, errors=errors, picture=picture), timing, 100, 1e-6)


def test_the_advice_follows_from_the_figures(report: reporting.Report) -> None:
    sandwich = made_up(report, "sandwich", 1.0)
    march = made_up(report, "march", 0.5, bad=7, step=0.1)
    loose = made_up(report, "segment", 0.8, worst=1e-6, tolerance=1e-6)
    interval = made_up(report, "interval", 0.4)

    def best(*results: Result) -> Result | None:
        return summary.best_search(list(results))

    assert best(march) is None
    assert best(sandwich, march, loose) is sandwich
    assert best(sandwich, interval, march) is interval
    told = " ".join(summary.search_sentences([sandwich, march, loose]))
    assert told.startswith("Take sandwich with its default tolerance: it makes no mistake, is exact to rounding")
    assert "march, step 1e-06 units, is 2 times as quick and gets 7 rays wrong" in told
    assert "The default, sandwich, is right as well and takes 2.5 times as long" in " ".join(
        summary.search_sentences([sandwich, interval])
    )
    assert "makes march" in summary.search_sentences([march])[0]


def test_the_front_holds_what_nothing_beats(report: reporting.Report) -> None:
    quick = made_up(report, "segment", 0.5, worst=1e-6)
    exact = made_up(report, "sandwich", 1.0, worst=1e-15)
    slow = made_up(report, "sphere", 2.0, worst=1e-9)
    wrong = made_up(report, "march", 0.1, worst=1e-16, bad=1)
    assert summary.pareto([slow, exact, wrong, quick]) == [quick, exact]


def test_proved_searches_make_no_mistake(report: reporting.Report) -> None:
    proved = [r for r in report.searches if r.method.proved]
    assert {r.method.search for r in proved} == {"sandwich", "bernstein", "interval"}
    assert all(r.faultless for r in proved)
    assert all(r.judgement.errors.conditioned <= 1.0 for r in proved if r.method.is_default)
    swept = [r for r in report.searches if r.method.search == "segment"]
    assert [r.judgement.errors.max for r in swept] == sorted((r.judgement.errors.max for r in swept), reverse=True)
    assert any(r.judgement.all.bad for r in report.searches if r.method.search == "march")


def test_other_sections_hold_what_is_known(report: reporting.Report) -> None:
    analytic = next(r for r in report.normals if r.normals == "analytic")
    assert analytic.errors.max < 1e-12
    assert min(r.errors.max for r in report.normals if r.normals == "central") < 1e-8
    assert [r.index for r in report.indexes] == ["bvh", "grid", "octree", "bsp", "none"]
    assert all(r.judgement.all.bad == 0 and r.build.least > 0.0 for r in report.indexes)
    rms = [r.rms for r in report.sampling.fixed]
    assert [r.noise for r in report.sampling.adaptive] == [0.05, 0.02]
    assert rms == sorted(rms, reverse=True)
    assert unit_of(report.scene.ir) == report.header.unit


def test_slow_searches_get_fewer_rays_and_say_so(report: reporting.Report, monkeypatch: pytest.MonkeyPatch) -> None:
    from blobscript.reporting import searches, tables

    monkeypatch.setattr(searches, "_QUICK_JUDGED", 1e-4)
    monkeypatch.setattr(searches, "_TIMED", 1e-4)
    monkeypatch.setattr(searches, "_FEW", 10**6)
    rays, reference = report.rays, report.reference
    results = searches.measure_searches(report.scene, rays, reference, unit_of(report.scene.ir), True)
    swept = [r for r in results if not r.method.is_default]
    assert len({r.method.search for r in swept}) == len(swept)  # one setting of each, and no smaller tolerance
    assert all(r.last for r in swept)
    assert all(r.judgement.all.rays < len(rays) and r.timed_rays < rays.picture for r in swept)
    assert all(len(r.judgement.error) == len(rays) and r.time.repeats == REPEATS for r in results)
    table = tables.search_table(replace(report, searches=results))
    assert "rays" in table.columns
    assert "Smaller tolerances would have taken too long" in table.note


def test_meshes_come_nearer_with_smaller_cells(report: reporting.Report) -> None:
    errors = [r.to_mesh.p99 for r in report.meshes]
    assert len(errors) >= 2
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.01 * report.header.unit
    assert all(r.open_edges == 0 and r.euler == 2 for r in report.meshes)


def test_povray_is_judged_on_the_same_rays(report: reporting.Report, monkeypatch: pytest.MonkeyPatch) -> None:
    """A blob it can show, and one whose gradient is understated: it misses."""
    monkeypatch.setattr("blobscript.reporting.pov.REPEATS", 1)
    monkeypatch.setattr("blobscript.reporting.pov._WIDTH", 120)
    source = "surface(sum(kernel = {}) {{ ball((-0.6, 0, 0), radius = 0.6)\n ball((0.6, 0, 0), radius = 0.6) }})"
    found = {}
    for kernel in ("soft2", "wyvill"):
        scene = blobscript.compile(source.format(kernel))
        rays = make_rays(scene, 600, 100, 0)
        reference = certify(scene.ir, rays, workers=1)
        found[kernel] = measure_povray(scene, rays, reference, unit_of(scene.ir), quick=True)
    blob, iso = found["soft2"], found["wyvill"]
    assert blob is not None
    assert iso is not None
    assert blob.forms == ("blob",)
    assert all(r.judgement.errors.max < 1e-4 and r.time.least > 0.0 for r in blob.results)
    exact = next(r for r in iso.results if r.gradient == 1.0 and r.accuracy < 1e-5)
    hasty = next(r for r in iso.results if r.gradient < 1.0)
    assert exact.judgement.errors.max < 1e-5
    assert hasty.judgement.all.bad > exact.judgement.all.bad
    assert "isosurface" in summary.povray_sentence(iso, report.searches)


# ---- files ---------------------------------------------------------------------------------------------


def test_the_page_needs_nothing_else(report: reporting.Report) -> None:
    text = reporting.page(report)
    assert not re.search(r"(src|href)=\"(?!data:)", text)
    pictures = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', text)
    assert len(pictures) >= 6
    import base64

    for coded in pictures:
        ET.fromstring(base64.b64decode(coded))
    assert "Take " in text
    assert report.header.rays_hash[:16] in text
    assert report.header.reference_hash[:16] in text
    assert "nan" not in re.sub(r"base64,[^\"]+", "", text).lower().replace("nanosecond", "")


def test_json_holds_every_figure(report: reporting.Report) -> None:
    facts = json.loads(reporting.report_json(report))
    assert facts["header"]["seed"] == 3
    assert facts["header"]["repeats"] >= 10
    assert len(facts["searches"]) == len(report.searches)
    assert sum(r["taken"] for r in facts["searches"]) == 1
    assert {"missed", "false", "wrong_root", "grazing"} <= set(facts["searches"][0]["grazing"])
    assert facts["summary"] == summary.search_sentences(report.searches)


def test_markdown_has_the_tables(report: reporting.Report) -> None:
    text = reporting.markdown(report)
    assert text.startswith("# hello.blob: error against run time")
    assert "| sphere |" in text
    assert text.count("## ") == 7


def test_an_empty_scene_is_told() -> None:
    scene = blobscript.compile("surface { ball(radius = 1) }\ncamera(from = (0, 0, 9), to = (0, 0, 20))")
    report = reporting.make_report(scene, quick=True, count=(80, 0), workers=1, povray=False)
    assert summary.search_sentences(report.searches)[0].startswith("No ray meets a surface")
    assert "No ray meets" in reporting.page(report)
    json.loads(reporting.report_json(report))


def test_an_exposure_does_not_end_the_rays_that_povray_is_timed_on() -> None:
    """It is a filter before the camera, and without transparency all rays would end there."""
    scene = blobscript.compile('surface { ball(radius = 1) }\ntone("film", exposure = 0.5)')
    assert "a filter before the camera" in scene.pov_document(40, 30, "scene").text
    assert "a filter before the camera" not in pov._unexposed(scene).pov_document(40, 30, "scene").text


def _workers(session: int) -> int:
    """Processes of a session that were started to certify rays."""
    count = 0
    for path in Path("/proc").glob("[0-9]*"):
        try:
            count += os.getsid(int(path.name)) == session and b"spawn_main" in (path / "cmdline").read_bytes()
        except OSError:
            continue
    return count


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="looks for processes in /proc")
def test_an_interruption_ends_the_processes(tmp_path: Path) -> None:
    """Ctrl-C while rays are certified: at once, without a word of theirs, and none is left."""
    script = tmp_path / "a.blob"
    script.write_text("surface { ball(radius = 1) }", encoding="utf-8")
    command = [sys.executable, "-m", "blobscript.cli", "report", str(script), "-o", str(tmp_path / "r.html")]
    if (os.cpu_count() or 1) < 2:
        pytest.skip("one processor: nothing is shared out")
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    while process.poll() is None and _workers(process.pid) < 2:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=20)  # processes that live on would keep it open
    assert process.returncode == 130
    assert err.endswith("interrupted\n")
    assert "Traceback" not in err
    assert "leaked" not in err
    assert [path.name for path in tmp_path.iterdir()] == ["a.blob"]
