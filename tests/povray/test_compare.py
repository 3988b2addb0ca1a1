"""`compare`: both renderers agree on a small scene, the reports say so, and where we were off it would be seen."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript import images
from blobscript.cli import main
from blobscript.framing import view_rays
from blobscript.images import Image, srgb_encode
from blobscript.povray import compare as comparing
from blobscript.povray import judge, page
from blobscript.povray.compare import Comparison, compare
from blobscript.povray.program import workshop

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


LOOKS = {
    "sky, noise and a floor that fades": """\
import checker, clouds, tiles from std.textures
surface(material = clay(clouds(skyblue, coral, size = 0.5, octaves = 2))) { ball((-0.7, 0.6, 0), radius = 0.6) }
surface(material = clay(checker(white, black, size = 0.3))) { ball((0.7, 0.6, 0), radius = 0.6) }
surface(material = material(gold, bump = fn(p) = 0.02 * noise(8 * p))) { ball((0, 0.4, 1), radius = 0.4) }
floor(material = clay(tiles(white, silver)), fade = 12)
sky(zenith = #7fb2e8, horizon = #f4f7fa, ground = #b8ad9c)
sun((0.6, -1, -0.5), strength = 2)
""",
    "fog": """\
for (i in 0..<4) { surface(material = plastic(coral)) { ball((i - 1.5, 0.5, -3 * i), radius = 0.5) } }
floor(material = clay)
sky(zenith = #274b6d, horizon = #c9dbe6, ground = #31424d)
sun((0.6, -1, -0.5), strength = 2)
fog(distance = 15, color = #c0c8d0)
""",
    "rough metal": """\
import checker from std.textures
let metal = material(checker(#ffd070, #a05030, size = 0.25), roughness = 0.8, metalness = 1)
surface(material = metal) { ball((-0.7, 0.6, 0), radius = 0.6) }
surface(material = material(#e0b060, roughness = 0.6, metalness = 1)) { ball((0.7, 0.6, 0), radius = 0.6) }
sky(zenith = #7fb2e8, horizon = #f4f7fa, ground = #b8ad9c)
sun((0.6, -1, -0.5), strength = 2)
""",
    "water": """\
fn waves(at: vec3) -> number = 0.02 * noise(6 * at) + 0.012 * noise(15 * at)
surface(material = clay(coral)) { ball((0, 0.4, 0), radius = 0.5) }
floor(material = material(#1d5f7f, roughness = 0.12, specular = 0.6, bump = waves), fade = 16)
sky(zenith = #4a8fd6, horizon = #dfeaf2, ground = #3d6f8c)
sun((-0.9, -0.6, -0.25), strength = 2)
""",
    "mirrored horizon": """\
surface(material = material(#ffc766, roughness = 0.16, metalness = 1)) { ball((0, 0.8, 0), radius = 0.8) }
floor(material = material(#1d2b3a, roughness = 0.25, specular = 0.6), fade = 9)
sky(zenith = #d9e4f0, horizon = #ffffff, ground = #29384a, shown = #22303f)
""",
    "tinted glass": """\
let tinted = material(#5fb4ee, roughness = 0, transmission = 1, ior = 1.5, depth = 0.8)
surface(material = tinted) {
  ball((0, 0.8, 0), radius = 0.8)
  ball((0, 1.5, 0), radius = 0.4)
}
floor(material = clay(white), fade = 14)
sky(zenith = #7fb2e8, horizon = #f4f7fa, ground = #b8ad9c)
""",
    "environment": """surface(material = clay(white)) { ball((-0.6, 0, 0), radius = 0.5) }
surface(material = chrome) { ball((0.6, 0, 0), radius = 0.5) }
environment("room.exr", turn = 30deg)
""",
    "rough things in an environment": """let brass = material(#f0a070, roughness = 0.35, metalness = 1)
surface(material = brass) { ball((-0.8, 0.5, 0), radius = 0.5)
  ball((-0.4, 0.9, 0), radius = 0.4) }
surface(material = material(#8c1022, roughness = 0.1, specular = 0.8), kernel = soft2) {
  ball((0.5, 0.5, 0), radius = 0.5)
  ball((0.9, 0.9, 0), radius = 0.4).paint(teal) }
surface(line((-1, 0.1, 1), (1, 0.1, 1)).blob(radius = 0.1), material = brass)
floor(material = material(#3a3634, roughness = 0.22, specular = 0.6), fade = 14)
environment("room.exr", strength = 2, turn = 200deg)
""",
}


#: Steps of 255, in the mean; measured are 1.5, 0.8, 1.4, 2.0, 0.6, 0.06, 0.03 and 0.4.
MOST = {
    "sky, noise and a floor that fades": 2.0,
    "fog": 1.0,
    "rough metal": 1.6,
    "water": 2.5,
    "mirrored horizon": 1.0,
    "tinted glass": 0.3,
    "environment": 0.1,
    "rough things in an environment": 0.6,
}


@pytest.mark.parametrize("name", LOOKS)
def test_skies_textures_and_fog_come_along(name: str, tmp_path: Path) -> None:
    down, across = np.mgrid[0:16, 0:32].astype(np.float32)
    room = np.stack([across / 32, down / 16, (across // 8) % 2, np.ones_like(down)], axis=2)
    Image(np.ascontiguousarray(room, np.float32)).save(tmp_path / "room.exr")
    scene = blobscript.compile(LOOKS[name], base=tmp_path)
    made = scene.pov_document(96, 72, "looks")
    with workshop() as shop:
        shop.add(made.files)
        shop.run(made.text, ("+Oo.png", "+W96", "+H72", "-D", "-A", "-V", "+FN16"), 60.0)
        theirs = images.read(shop.folder / "o.png").rgba[:, :, :3]
    assert made.surfaces.count("FOG = ") == ("fog" in name), "what the looks use is declared with them"
    ours = np.ascontiguousarray(scene.render(96, 72).rgba[:, :, :3])
    assert 255 * np.abs(srgb_encode(ours) - srgb_encode(theirs)).mean() < MOST[name]
    assert not any("mean of the texture" in note.message for note in made.diagnostics)


def test_without_files_noise_is_its_mean_and_said_so() -> None:
    made = blobscript.compile(LOOKS["sky, noise and a floor that fades"]).pov_document()
    assert made.files == {}
    assert any("noise without a file" in note.message for note in made.diagnostics)


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


def test_exposure_and_tone_are_in_both_pictures() -> None:
    text = SCENE.replace("strength = 3", "strength = 20") + 'tone("film", exposure = -0.7)\n'
    found = compare(blobscript.compile(text), "film.blob", 60, 45, 60.0)
    assert found.colors.mean < 1.2
    white = images.developed(np.ones((1, 1, 4), np.float32), 0.0, "film")
    assert found.theirs.max() > white[:, :, :3].max(), "light beyond white reaches the curve"
    assert "+FE" in found.commands[0]
    assert any("tone curve" in note.message for note in found.notes)
    assert not any("exposure" in note.message for note in found.notes)
