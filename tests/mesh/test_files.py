"""The five formats, read again by trimesh; the command."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cli.conftest import Blob, blob  # noqa: F401

import blobscript
from blobscript.meshing import Options, bodies, files

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.blob"))
PAINTED = (
    "let red = surface(material = metal(#ff0000)) { ball((-1, 0, 0), radius = 0.5) }\nred\n"
    "let two = surface {\nball((1, 0, 0), radius = 0.5).paint(#00ff00)\n"
    "ball((1, 0.6, 0), radius = 0.5).paint(#0000ff)\n}\ntwo"
)


@pytest.fixture(scope="module")
def painted():
    scene = blobscript.compile(PAINTED)
    return bodies(scene.ir, scene._native, Options(resolution=24))


@pytest.mark.parametrize("ending", files.ENDINGS)
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_in_all_formats(path: Path, ending: str, tmp_path: Path, made={}) -> None:  # noqa: B006
    if path not in made:
        scene = blobscript.load(path)
        made[path] = bodies(scene.ir, scene._native, Options(resolution=20, refine=1))
    out = tmp_path / f"out{ending}"
    files.save(made[path], out)
    mesh = trimesh.load(out, force="mesh")
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert len(mesh.faces) == sum(len(part.body.triangles) for part in made[path])
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize("ending", [".glb", ".3mf"])
def test_bodies_have_names(painted, ending: str, tmp_path: Path) -> None:
    files.save(painted, tmp_path / f"a{ending}")
    assert set(trimesh.load(tmp_path / f"a{ending}").geometry) == {"red", "two"}


def test_bodies_of_obj_have_names(painted, tmp_path: Path) -> None:
    files.save(painted, tmp_path / "a.obj", "mm")
    lines = (tmp_path / "a.obj").read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if line.startswith("o ")] == ["o red", "o two"]
    assert "unit: mm" in lines[0]


def test_glb_has_materials_normals_and_colors(painted, tmp_path: Path) -> None:
    files.save(painted, tmp_path / "a.glb")
    scene = trimesh.load(tmp_path / "a.glb")
    red, two = scene.geometry["red"], scene.geometry["two"]
    assert red.visual.material.metallicFactor > 0.9
    assert two.visual.material.metallicFactor == 0.0
    assert np.allclose(red.vertex_normals, painted[0].body.normals, atol=1e-6)
    colors = two.visual.vertex_attributes["color"]
    assert (colors[two.vertices[:, 1] < -0.42] == [0, 255, 0, 255]).all()
    assert (colors[two.vertices[:, 1] > 1.02] == [0, 0, 255, 255]).all()


def test_units(painted, tmp_path: Path) -> None:
    """GLB counts in metres, 3MF in millimetres; the numbers of STL are those of the script."""
    size = {}
    for ending in (".stl", ".glb", ".3mf"):
        files.save(painted, tmp_path / f"a{ending}", "cm")
        size[ending] = float(np.ptp(trimesh.load(tmp_path / f"a{ending}", force="mesh").vertices[:, 0]))
    assert size[".glb"] == pytest.approx(size[".stl"] / 100, rel=1e-6)
    assert size[".3mf"] == pytest.approx(size[".stl"] * 10, rel=1e-6)
    assert zipfile.is_zipfile(tmp_path / "a.3mf")


# ---- the command --------------------------------------------------------------------------------------


def test_mesh_command(blob: Blob) -> None:  # noqa: F811
    done = blob("mesh", "hello.blob", "-o", "out.glb", "--resolution", "20", "--format", "json")
    assert done.code == 0, done.text
    told = json.loads(done.out)
    assert told["bodies"][0]["watertight"]
    assert told["bodies"][0]["euler"] == 2
    assert len(trimesh.load("out.glb", force="mesh").faces) == told["bodies"][0]["triangles"]


@pytest.mark.parametrize(
    ("given", "code", "message"),
    [
        (("-o", "out.foo"), 2, "no mesh format"),
        (("-o", "nowhere/out.stl"), 3, "there is no folder"),
        (("-o", "out.stl", "--resolution", "0"), 2, "whole number"),
        (("-o", "out.stl", "--cell", "-1"), 2, "positive"),
        (("-o", "out.stl", "--cell", "nan"), 2, "positive"),
        (("-o", "out.stl", "--cell", "1", "--resolution", "9"), 2, "not allowed with"),
        (("-o", "out.stl", "--resolution", "10000000"), 4, "may be used"),
        (("-o", "out.stl", "--adaptive"), 2, "without a tolerance"),
        (("-o", "out.stl", "--clip", "0,0,0,1,1"), 2, "six numbers"),
        (("-o", "out.stl", "--clip", "0,0,0,1,0,1"), 2, "no box"),
        (("-o", "out.stl", "--unit", "furlong"), 2, "--unit"),
        (("-o", "out.stl", "--report", "r.pdf"), 2, "no report format"),
    ],
)
def test_bad_input(blob: Blob, given: tuple[str, ...], code: int, message: str) -> None:  # noqa: F811
    done = blob("mesh", "hello.blob", *given)
    assert done.code == code, done.text
    assert message in done.err
    assert "Traceback" not in done.text
    assert sorted(path.name for path in Path().iterdir()) == ["hello.blob", "lamp.blob"]


def test_an_empty_surface_leaves_no_file(blob: Blob) -> None:  # noqa: F811
    Path("empty.blob").write_text("surface(threshold = 3) { ball(reach = 1, weight = 1) }", encoding="utf-8")
    done = blob("mesh", "empty.blob", "-o", "out.stl")
    assert done.code == 4
    assert "W0401" in done.err
    assert not Path("out.stl").exists()


def test_an_interruption_leaves_the_old_file(blob: Blob, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    Path("out.stl").write_text("old", encoding="utf-8")
    monkeypatch.setattr("blobscript.meshing.mesher._Run.together", stop)
    done = blob("mesh", "hello.blob", "-o", "out.stl")
    assert done.code == 130
    assert Path("out.stl").read_text(encoding="utf-8") == "old"
    assert len(list(Path().iterdir())) == 3


@pytest.mark.parametrize("ending", ["html", "md", "json"])
def test_reports(blob: Blob, ending: str) -> None:  # noqa: F811
    done = blob("mesh", "hello.blob", "-o", "out.stl", "--resolution", "48", "--report", f"r.{ending}")
    assert done.code == 0, done.text
    text = Path(f"r.{ending}").read_text(encoding="utf-8")
    if ending == "json":
        account = json.loads(text)
        body = account["bodies"][0]
        assert body["topology"] == {"components": 1, "euler": 2, "boundary": 0, "nonmanifold": 0, "misoriented": 0}
        assert body["residual"] < 1e-12
        assert account["volume_order"] == pytest.approx(2.0, abs=0.3)
        assert len(account["steps"]) >= 3
        assert body["visited"] > 0
    else:
        for words in (
            "vertex residual",
            "mesh to surface",
            "surface to mesh",
            "Euler characteristic",
            "boundary edges",
        ):
            assert words in text
        assert ("<svg" in text) == (ending == "html")
