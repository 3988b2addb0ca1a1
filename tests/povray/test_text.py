"""The text of scenes for POV-Ray: golden files, what a name cannot do, what is refused, and how long it takes."""

from __future__ import annotations

import re
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from random_scenes import make_leaf, make_scene

import blobscript
from blobscript import Scene, ir
from blobscript.cli import main
from blobscript.povray import document, objects
from blobscript.povray.program import workshop
from blobscript.povray.readback import answers

HERE = Path(__file__).parent

SCRIPTS = {
    "blob": """\
surface(threshold = 0.6, kernel = soft2) {
  ball((-0.5, 0, 0), reach = 1).paint(coral)
  ball((0.5, 0, 0), reach = 1, weight = -0.4)
  line((0, 0, 0), (0, 1, 0)).blob(reach = 0.5).scale(x = 2)
}
""",
    "skins": """\
surface(max { ball(radius = 0.5)
  line((0, 0, 0), (1, 0, 0)).blob(radius = 0.2)
  polygon([(0, 0, 0), (0, 1, 0), (0, 0, 1)]).blob(radius = 0.1) })
""",
    "cut": "surface(kernel = soft2) { min { ball(reach = 1)\n  ball((0.3, 0, 0), reach = 1).paint(gold) } }",
    "pieces": """\
surface(material = clay(coral)) {
  ball((-0.4, 0, 0), radius = 0.5)
  ball((0.4, 0, 0), radius = 0.5).paint(gold)
}
camera(from = (0, 0, 5))
sun(toward = (0, -1, -1), color = white, strength = 3)
lamp(at = (2, 2, 2), strength = 5)
background(#203040)
image(width = 64, height = 48)
""",
}


@pytest.mark.parametrize("name", SCRIPTS)
def test_golden(name: str, request: pytest.FixtureRequest) -> None:
    text = blobscript.compile(SCRIPTS[name], name=f"{name}.blob").to_pov()
    golden = HERE / "golden" / f"{name}.pov"
    if request.config.getoption("--update-golden"):
        golden.write_text(text, encoding="ascii")
    assert _rounded(text) == _rounded(golden.read_text(encoding="ascii"))


def _rounded(text: str) -> str:
    """To nine digits: the last ones depend on the machine's mathematical library."""
    return re.sub(r"-?\d+\.\d+(e-?\d+)?", lambda m: f"{float(m[0]):.9g}", text)


def test_the_forms_are_the_best_that_mean_the_same() -> None:
    kinds = {name: document(blobscript.compile(text).ir).forms[0] for name, text in SCRIPTS.items()}
    assert kinds == {"blob": "blob", "skins": "primitives", "cut": "primitives", "pieces": "isosurface"}


def test_names_and_paths_never_become_code(tmp_path: Path) -> None:
    """Texts of the user stand in comments only, one line each."""
    script = tmp_path / 'a"} #include "evil.inc" *'
    script.write_text("let ball_of_mine = surface { ball(radius = 1) }\nball_of_mine\n", encoding="utf-8")
    text = blobscript.load(script).to_pov()
    live = "\n".join(line.split("//")[0] for line in text.splitlines())
    assert "evil" not in live
    assert "include" not in live
    assert '"' not in live
    strange = blobscript.compile("surface { ball(radius = 1) }", name="x\n#include x\r/* ü*/.blob").to_pov()
    assert "#include" not in "\n".join(line.split("//")[0] for line in strange.splitlines())
    assert strange.isascii()


def test_every_part_names_its_line_of_the_script() -> None:
    text = blobscript.compile(
        "surface {\n  ball(radius = 1)\n\n  ball((1, 0, 0), radius = 1)\n}", name="two.blob"
    ).to_pov()
    assert "two.blob:1" in text
    assert "two.blob:2" in text
    assert "two.blob:4" in text


@pytest.mark.parametrize(
    ("leaf", "threshold", "reason"),
    [
        (lambda: make_leaf(ir.Points(np.zeros((1_000_000, 3))), ir.Kernel("soft2"), 1.0, 1.0), 0.5, "components"),
        (lambda: make_leaf(ir.Points(np.ones((20_001, 3))), ir.Kernel("wyvill"), 0.01, 1.0), 0.5,
         "terms"),
        (lambda: make_leaf(ir.Points(np.zeros((1, 3))), ir.Kernel("wyvill"), 1.0, -1.0), 0.0, "threshold is 0"),
    ],
)  # fmt: skip
def test_what_cannot_be_expressed_is_refused(leaf, threshold: float, reason: str) -> None:
    with pytest.raises(blobscript.ProgramError, match=reason) as caught:
        document(make_scene((leaf(), threshold)))
    assert [d.code for d in caught.value.diagnostics] == ["E1001"]


def test_what_is_too_large_for_functions_is_sampled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In a file beside the scene, as far off as the note says; on standard output there is no place for one."""
    at = np.random.default_rng(1).random((21_000, 3))
    scene = Scene(make_scene((make_leaf(ir.Points(at), ir.Kernel("wyvill"), 0.08, 1.0), 0.5)))
    with pytest.raises(blobscript.ProgramError, match="21 000 terms"):
        scene.to_pov()
    made = scene.pov_document(stem='a "b', grid=80)
    assert list(made.files) == ["a__b-field-1.df3"]
    assert len(made.files["a__b-field-1.df3"]) == 6 + 4 * 81**3
    assert "sampled on 81 x 81 x 81 places" in made.diagnostics[0].message
    assert 0 < made.off[0] < 0.01
    origins = np.random.default_rng(2).normal(size=(300, 3))
    origins = 0.5 + 3 * origins / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = 0.5 - origins
    ours = scene.first_hit(origins, directions)
    with workshop() as shop:
        for name, data in made.files.items():
            (shop.folder / name).write_bytes(data)
        theirs = answers(shop, made, origins, directions, 60.0)
    assert (ours.hit == theirs.hit).all()
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    places = (origins + theirs.t[:, None] * unit)[theirs.hit]
    off = np.abs(scene.field(places) - 0.5) / np.linalg.norm(scene.gradient(places), axis=1)
    assert off.max() < 1.5 * made.off[0]
    assert np.median(off) < 2e-4


def test_what_nests_deep_is_sampled() -> None:
    """Functions of 80 levels are 2 MB, and take the cube of that to bound."""
    nested = "ball(radius = 1)"
    for level in range(200):
        nested = f"{'max' if level % 2 else 'sum'} {{\n{nested}\nball(({level % 7}, {level % 5}, 0), radius = 0.3)\n}}"
    scene = blobscript.compile(f"surface {{\n{nested}\n}}")
    with pytest.raises(blobscript.ProgramError, match=r"\d levels"):
        scene.to_pov()
    made = scene.pov_document(stem="deep", grid=20)
    assert list(made.files) == ["deep-field-1.df3"]
    assert " levels of nodes are too many" in made.diagnostics[0].message


def test_paints_that_sampling_loses_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(objects, "_MOST_TERMS", 1)
    script = "surface { ball(radius = 1)\n ball((1, 0, 0), radius = 1)PAINT }"
    for paint in ("", ".paint(red)"):
        scene = blobscript.compile(script.replace("PAINT", paint))
        told = [d.message for d in scene.pov_document(stem="a", grid=20).diagnostics]
        assert any("no terms left that could be painted" in text for text in told) == bool(paint)


def test_scene_and_samples_are_written_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(objects, "_MOST_TERMS", 1)
    script = tmp_path / "two.blob"
    script.write_text("surface { ball(radius = 1)\n ball((1, 0, 0), radius = 1) }", encoding="utf-8")
    assert main(["compile", str(script), "--to", "pov", "-o", str(tmp_path / "a;b.pov"), "--grid", "20"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a;b.pov", "a_b-field-1.df3", "two.blob"]
    assert 'df3 "a_b-field-1.df3"' in (tmp_path / "a;b.pov").read_text(encoding="ascii")
    assert main(["compile", str(script), "--to", "pov", "-o", str(tmp_path / "no" / "b.pov"), "--grid", "20"]) == 3
    assert main(["compile", str(script), "--to", "pov"]) == 1
    assert main(["compile", str(script), "--to", "json", "--grid", "20"]) == 2
    assert main(["compile", str(script), "--to", "pov", "--grid", "2"]) == 2


def test_zero_length_lines_are_spheres() -> None:
    lines = ir.Lines(np.zeros((2, 3)), np.array([[0.0, 0, 0], [1.0, 0, 0]]))
    text = document(make_scene((make_leaf(lines, ir.Kernel("soft2"), 1.0, 1.0), 0.5))).text
    assert text.count("cylinder {") == 1
    assert text.count("sphere { <0.0, 0.0, 0.0>") == 1


def test_a_hundred_thousand_points_are_written_and_read() -> None:
    """Measured: 0.9 s to write, 0.7 s to read; the limit is 3 s of processor time."""
    at = np.random.default_rng(1).random((100_000, 3))
    scene = Scene(make_scene((make_leaf(ir.Points(at), ir.Kernel("soft2"), 0.03, 1.0), 0.6)))
    start = time.process_time()
    text = scene.to_pov()
    assert time.process_time() - start < 3.0
    assert text.count("\n  sphere {") == 100_000
    with workshop() as shop:
        run = shop.run(text, ("+Oo.png", "+W8", "+H8", "-D", "-A", "-V", "+Q0"), 60.0)
    assert run.parse_seconds is not None


def test_the_verb_writes_whole_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "a.blob"
    script.write_text(SCRIPTS["blob"], encoding="utf-8")
    assert main(["compile", str(script), "--to", "pov", "-o", str(tmp_path / "a.pov")]) == 0
    assert (tmp_path / "a.pov").read_text(encoding="ascii").startswith("// a.blob, by blobscript")
    assert main(["compile", str(script), "--to", "pov"]) == 0
    assert capsys.readouterr().out == (tmp_path / "a.pov").read_text(encoding="ascii")
    script.write_text("surface(threshold = 0) { ball(reach = 1, weight = -1) }", encoding="utf-8")
    assert main(["compile", str(script), "--to", "pov", "-o", str(tmp_path / "b.pov")]) == 1
    assert "E1001" in capsys.readouterr().err
    steep = "polygon([(0, 0, 0), (1, 0, 0), (1, 2, 0)]).blob(reach = 1e-105, weight = 1e60, kernel = gauss(a = 10000))"
    steep = f"surface {{ line((0, 0, 0), (1e40, 1e40, 0)).blob(reach = 1e-108, weight = 1e60)\n{steep} }}"
    script.write_text(steep, encoding="utf-8")
    assert main(["compile", str(script), "--to", "pov", "-o", str(tmp_path / "b.pov")]) == 1
    assert "too steep" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.blob", "a.pov"]


def test_povray_is_there() -> None:
    """The suite of this folder is about the real one; `.ci/run` installs it."""
    assert shutil.which("povray")
