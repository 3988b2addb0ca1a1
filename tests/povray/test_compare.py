"""`compare`: both renderers agree on a small scene, the reports say so, and where we were off it would be seen."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript.cli import main
from blobscript.povray import compare as comparing
from blobscript.povray import judge, page
from blobscript.povray.compare import Comparison, compare
from blobscript.povray.readback import view_rays

#: A piece of each form, matte, one light.
SCENE = """\
surface(material = clay(coral)) { ball((-1.2, 0, 0), radius = 0.6)
  ball((-0.5, 0.4, 0), radius = 0.5).paint(gold) }
surface(material = stone, kernel = soft2) { ball((0.7, 0, 0), radius = 0.5)
  ball((1.4, 0, 0), radius = 0.5) }
surface(line((-1, -1, 0), (1, -1, 0)).blob(radius = 0.2), material = clay)
camera(from = (0, 0, 6))
sun(toward = (-0.5, -1, -1), strength = 3)
background(#c8d0d8)
"""


@pytest.fixture(scope="module")
def found() -> Comparison:
    return compare(blobscript.compile(SCENE, name="three.blob"), "three.blob", 120, 90, 60.0)


def test_both_see_the_same(found: Comparison) -> None:
    assert found.mask_share == 1.0
    assert found.both > 1500
    assert found.outliers == 0
    assert found.depth.median < 1e-7 * found.size
    assert found.depth.max < 1.01e-7 * found.size
    assert found.normal.p99 < 1e-4
    assert sorted(found.document.forms.values()) == ["blob", "isosurface", "primitives"]


def test_a_matte_scene_with_one_light_looks_the_same(found: Comparison) -> None:
    assert found.colors.mean < 1.0


def test_a_sample_is_judged_and_we_are_not_off(found: Comparison) -> None:
    assert found.judged
    assert len(found.sample) > 5
    assert found.agrees
    assert max(v.our_error for v in found.sample) < 1e-12
    assert 0 < np.median([v.their_error for v in found.sample]) < 1e-6


def test_where_we_are_off_the_judge_says_so() -> None:
    scene = blobscript.compile(SCENE)
    rays = view_rays(scene.ir.camera, 40, 30)
    hits = scene.first_hit(rays[0][None], rays[1].reshape(-1, 3))
    pixels = np.flatnonzero(hits.hit)[:3]
    wrong = hits.t + np.where(np.arange(len(hits.t)) == pixels[1], 1e-3, 0.0)
    verdicts = judge.judged(scene.ir, pixels, rays, wrong, hits.t, 30.0)
    assert [v.we_are_off(1e-9) for v in verdicts] == [False, True, False]
    assert verdicts[1].our_error == pytest.approx(1e-3)
    assert verdicts[1].their_error < 1e-12


def test_pages_are_complete(found: Comparison) -> None:
    data = json.loads(page.as_json(found))
    assert data["mask"]["share"] == 1.0
    assert data["agrees"] is True
    assert data["versions"]["POV-Ray"].startswith("3.")
    assert {"here: picture", "POV-Ray: picture"} <= set(data["seconds"])
    assert data["commands"][0].startswith("povray +Iscene.pov")
    text = page.as_html(replace(found, script="<b>three.blob"))
    assert text.count("data:image/png;base64,") == 4
    assert "&lt;b&gt;three" in text
    assert 'src="http' not in text


def test_the_verb(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "a.blob"
    script.write_text("surface { ball(radius = 1) }", encoding="utf-8")
    report = tmp_path / "r.html"
    assert main(["compare", str(script), "-o", str(report), "--size", "32x24"]) == 0
    assert report.read_text(encoding="utf-8").startswith("<!doctype html>")
    monkeypatch.setattr(comparing, "OUR_TOLERANCE", -1.0)
    monkeypatch.setattr(judge.Verdict, "we_are_off", lambda self, tolerance: tolerance < 0)
    assert main(["compare", str(script), "--format", "json", "--size", "16x12"]) == 5
    assert json.loads(capsys.readouterr().out)["agrees"] is False


@pytest.mark.parametrize(
    ("options", "code"),
    [(["-o", "report.txt"], 2), ([], 2), (["-o", "r.html", "--size", "64x48", "--timeout", "0.01"], 4)],
)
def test_what_cannot_be(tmp_path: Path, options: list[str], code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.blob").write_text("surface { ball(radius = 1) }", encoding="utf-8")
    assert main(["compare", "a.blob", *options]) == code
    assert [path.name for path in tmp_path.iterdir()] == ["a.blob"]
