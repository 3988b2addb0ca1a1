"""`import-pov`: scenes come over with their shapes, and what cannot be read is refused with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript.cli import main
from blobscript.diagnostics import ProgramError
from blobscript.povray.program import workshop
from blobscript.povray.sdl import imported
from blobscript.source import Source

#: Each is `#declare Thing = …`; the same blob is traced by POV-Ray and by us after the import.
SCENES = {
    "plain": "blob { threshold 0.6 sphere { 0, 1, 1 } cylinder { 0, <1, 1, 0.5>, 0.7, strength 1.2 } sturm }",
    "old": "blob { threshold 0.5 component 1, 1, x/2 component -0.5 0.8 <0, 0.4, 0.3> component 1 1 <-0.4, 0.1, 0.2> }",
    "moved": """blob { threshold 0.4
      sphere { 0, 1, 1 scale <1, 0.4, 1.7> rotate <20, 30, 40> translate <0.3, 0, 0> }
      cylinder { -x, x, 0.5, -0.6 rotate 35*z }
      sphere { <0, 0.5, 0.1>, 0.7, 1 matrix <1, 0.2, 0, 0, 1, 0, 0.1, 0, 1, 0, 0.2, 0> }
      rotate <10, 0, -50> scale <1, 1.5, 1> translate -0.2*y }""",
    "loops": """blob { threshold 0.6
      #declare N = 7; #local R = seed(5); #declare I = 0;
      #while (I < N)
        #if (mod(I, 2) = 0) sphere { <cos(2*pi*I/N), 0, sin(2*pi*I/N)>, 0.6 + 0.1*rand(R), 1 }
        #else sphere { vrotate(x, I/N*360*y) + 0.2*y, 0.7, 1 } #end
        #declare I = I + 1;
      #end
      #for (K, 0, 2) sphere { K*0.4*y, 0.5, 1 } #end
      #switch (N) #case (6) sphere { 5, 9, 9 } #break #range (7, 8) sphere { 0, 0.9, 1 } #break
      #else sphere { 9, 1, 1 } #end }""",
}


def script_of(text: str) -> blobscript.Scene:
    return blobscript.compile(imported(Source("scene.pov", text))[0])


@pytest.fixture(scope="module")
def theirs() -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Rays, and how far POV-Ray says that they go (inf: on and on)."""
    rng = np.random.default_rng(2)
    origins = rng.normal(size=(400, 3))
    origins *= 6 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.uniform(-0.9, 0.9, (400, 3)) - origins
    text = ["#version 3.7;", "#declare M = <0, 0, 0>;", '#fopen F "out.csv" write']
    for name, scene in SCENES.items():
        text.append(f"#declare Thing_{name} = {scene}")
        for o, d in zip(origins.tolist(), directions.tolist(), strict=True):
            eye, way = ("<" + ", ".join(map(repr, v)) + ">" for v in (o, d))
            text.append(f"#declare P = trace(Thing_{name}, {eye}, {way}, M);")
            text.append(f'#write(F, vlength(M), ",", str(vlength(P - {eye}), 0, 15), "\\n")')
    text += ["#fclose F", "camera { location 0 }", ""]
    with workshop() as shop:
        shop.run("\n".join(text), ("+Oo.png", "+W4", "+H4", "-D", "-A"), 60)
        rows = np.loadtxt(shop.folder / "out.csv", delimiter=",").reshape(len(SCENES), -1, 2)
    found = {name: np.where(part[:, 0] > 0, part[:, 1], np.inf) for name, part in zip(SCENES, rows, strict=True)}
    return origins, directions, found


@pytest.mark.parametrize("name", SCENES)
def test_the_same_shape_comes_over(theirs, name: str) -> None:
    origins, directions, found = theirs
    turned = np.array([1.0, 1.0, -1.0])  # POV-Ray's axes are left-handed
    hits = script_of(SCENES[name]).first_hit(origins * turned, directions * turned)
    assert (hits.hit == np.isfinite(found[name])).all()
    assert hits.hit.sum() > 60
    assert np.abs(hits.t[hits.hit] - found[name][hits.hit]).max() < 1e-6


def test_camera_light_and_background_come_over() -> None:
    text = """blob { threshold 0.5 sphere { <0.3, 0.2, 0.1>, 1, 1 pigment { rgb <1, 0.5, 0> } finish { phong 1 } } }
      camera { location <0, 1, -5> look_at <0, 0, 0> angle 40 right x*1.6 }
      light_source { <10, 20, -30> rgb <1, 0.9, 0.8> }
      light_source { <0, 9, 0>, 0.5 parallel point_at <0, 0, 0> }
      background { color rgb <0.1, 0.2, 0.3> }"""
    scene = script_of(text).ir
    assert (scene.width, scene.height) == (640, 400)
    assert scene.camera.at == (0.0, 1.0, 5.0)
    horizontal = 2 * np.degrees(np.arctan(np.tan(scene.camera.fov / 2) * 1.6))
    assert horizontal == pytest.approx(40.0)
    assert len(scene.lights) == 2
    assert scene.background.color == pytest.approx((0.1, 0.2, 0.3), abs=2e-4)
    image = blobscript.Scene(scene).render(width=64, height=40, aov=("surface",))
    seen = np.argwhere(image.aov["surface"] >= 0).mean(axis=0)
    assert seen[1] > 32, "x goes to the right as in POV-Ray"
    assert seen[0] < 20


def test_names_objects_and_unions() -> None:
    text = """#declare Drop = blob { threshold 0.5 sphere { 0, 1, 1 } }
      #declare Strange = function { x*x + y }
      union { object { Drop translate 2*x } object { Drop scale 0.5 } sphere { 0, 1 } translate y }
      plane { y, -1 pigment { checker } }"""
    script, notes = imported(Source("scene.pov", text))
    scene = blobscript.compile(script)
    assert len(scene.surfaces) == 2
    assert scene.field([[2.0, 1.0, 0.0], [0.0, 1.0, 0.0]], 0).tolist() == [1.0, 0.0]
    assert scene.field([[0.0, 1.25, 0.0]], 1) == pytest.approx([0.5625])
    assert sorted(note.message for note in notes) == ["`plane` is left out (line 4)", "`sphere` is left out (line 3)"]
    assert {note.code for note in notes} == {"N1002"}


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("#if (0) blob { threshold 1 } #end", 1, "stands in a branch"),
        ("#declare S = sphere { 0, 1 }\n#if (inside(S, <0, 0, 0>)) #end", 2, "asks POV-Ray about an object"),
        ("blob {\n threshold 0.5\n sphere { 0, Size, 1 } }", 3, "`Size` is not known"),
        ("blob { threshold 0.5 sphere { 0, 1, 1 }\n clipped_by { plane { y, 0 } } }", 2, "clipped_by"),
        ("blob { sphere { 0, 1, 1 scale 0 } }", 1, "scale of 0"),
        ("blob { sphere { 0, 1, 1 }", 1, "in a blob"),
        ("\n/* never", 2, "does not end"),
        ("#while (1)\n #declare A = 1;\n", 3, "no `#end`"),
        ("#while (1)\n #declare A = 1;\n#end", 1, "more steps"),
        ("sphere { 0, 1 }", 1, "no blob"),
        ("blob { sphere { 0, 1/0, 1 } }", 1, "division by 0"),
        ("blob { sphere { 0, sqrt(-1), 1 } }", 1, "cannot take"),
        ("blob { threshold 1 @ }", 1, "means nothing"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_line(
    text: str, line: int, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("blobscript.povray.sdl.reader._BUDGET", 1000)
    with pytest.raises(ProgramError, match=message) as caught:
        imported(Source("scene.pov", text))
    assert [(d.code, d.line) for d in caught.value.diagnostics] == [("E1002", line)]


def test_the_verb(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, script = tmp_path / "a.pov", tmp_path / "a.blob"
    scene.write_bytes(
        "// Kugel für Latin-1\nblob { threshold T sphere { 0, 1, 1 } }\nbox { -1, 1 }\n".encode("latin-1")
    )
    assert main(["import-pov", str(scene), "-o", str(script)]) == 1
    assert "a.pov:2:18" in capsys.readouterr().err
    assert not script.exists()
    assert main(["import-pov", str(scene), "-o", str(script), "--declare", "T=0.25"]) == 0
    assert "`box` is left out" in capsys.readouterr().err
    assert blobscript.load(script).surfaces[0].threshold == 0.25
    assert main(["fmt", "--check", str(script)]) == 0
    assert main(["import-pov", str(tmp_path / "none.pov")]) == 3
    assert main(["import-pov", str(scene), "--declare", "T"]) == 2
