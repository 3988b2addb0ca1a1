"""Every example compiles without a warning, is formatted, and shows something worth looking at."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript.cli import main

ROOT = Path(__file__).parent.parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.blob"))
MODULES = sorted((ROOT / "stdlib").glob("*.blob"))
#: The milk goes on beyond the picture.
UP_TO_THE_RIM = {"drops"}
SCRIPTS = [*EXAMPLES, *sorted((ROOT / "examples/parts").glob("*.blob")), *MODULES]


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", EXAMPLES, ids=name)
def test_example_compiles_without_a_warning(path: Path) -> None:
    scene = blobscript.load(path)
    assert [f"{d.code} {d.line}: {d.message}" for d in scene.diagnostics] == []


@pytest.mark.parametrize("path", EXAMPLES, ids=name)
def test_example_is_in_view(path: Path) -> None:
    """Its surfaces fill a good part of the picture, do not touch the rim much, and are lit."""
    scene = blobscript.load(path)
    width = 160
    image = scene.render(width=width, height=round(width * scene.ir.height / scene.ir.width), aov=("surface",))
    seen = image.aov["surface"] >= 0
    assert seen.mean() > 0.05
    if path.stem not in UP_TO_THE_RIM:
        rim = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
        assert seen.mean() < 0.75
        assert rim.mean() < 0.1
    luminance = image.rgba[seen][:, :3] @ np.array([0.2126, 0.7152, 0.0722])
    assert 0.03 < luminance.mean() < 0.9
    assert luminance.std() > 0.02


@pytest.mark.parametrize("path", SCRIPTS, ids=name)
def test_script_has_a_purpose_an_edition_and_the_format(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.startswith("// ")
    assert "\nblobscript 1\n" in text
    assert main(["fmt", "--check", str(path)]) == 0


@pytest.mark.parametrize("path", MODULES, ids=name)
def test_library_is_documented_and_has_no_errors(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert main(["check", str(path)]) == 0
    undocumented = re.findall(r"(?<!\n///)(?<!\))\n\n(?:fn|let|kernel|type) (\w+)", text)
    assert undocumented == []


@pytest.mark.parametrize("path", MODULES, ids=name)
def test_library_is_shown_by_examples(path: Path) -> None:
    """The one that it names, and others: every definition but those that others of the same file are made of."""
    text = path.read_text(encoding="utf-8")
    named = re.search(r"^// See (examples/\w+\.blob)\.$", text, re.MULTILINE)
    assert named
    assert f"from std.{path.stem}" in (ROOT / named[1]).read_text(encoding="utf-8")
    shown = "\n".join(p.read_text(encoding="utf-8") for p in SCRIPTS if p.parent.name == "examples")
    defined = re.findall(r"^(?:fn|let|kernel) (\w+)", text, re.MULTILINE)
    missing = {word for word in defined if not re.search(rf"\b{word}\b", shown)}
    assert {word for word in missing if len(re.findall(rf"\b{word}\(", text)) < 2} == set()


def test_caffeine_has_the_right_atoms_at_the_right_distances() -> None:
    """C8H10N4O2; each hydrogen is bound to one atom at about 1.09 A (C-H); 25 bonds in all."""
    rows = (ROOT / "examples/data/caffeine.xyz").read_text(encoding="utf-8").splitlines()[2:]
    kinds = [row.split()[0] for row in rows]
    at = np.array([[float(x) for x in row.split()[1:]] for row in rows])
    assert Counter(kinds) == {"C": 8, "H": 10, "N": 4, "O": 2}
    distance = np.linalg.norm(at[:, None] - at[None], axis=2)
    bonds = [(i, j) for i in range(24) for j in range(i) if distance[i, j] < 1.6]
    assert len(bonds) == 25
    for i, j in bonds:
        lo, hi = (1.05, 1.12) if "H" in (kinds[i], kinds[j]) else (1.2, 1.5)
        assert lo < distance[i, j] < hi, (kinds[i], kinds[j], distance[i, j])


def test_molecule_has_one_blob_per_atom() -> None:
    [surface] = blobscript.load(ROOT / "examples/molecule.blob").surfaces
    scene = blobscript.load(ROOT / "examples/molecule.blob", params={"size": 0.3})
    assert scene.surfaces[0].name == surface.name == "caffeine"


@pytest.mark.parametrize("wish", [{"skin": "jelly"}, {"skin": "chrome"}, {"bite": 0.0}, {"tail_length": 3.5}])
def test_gecko_has_other_faces(wish: dict[str, object]) -> None:
    plain = blobscript.load(ROOT / "examples/gecko.blob")
    assert blobscript.load(ROOT / "examples/gecko.blob", params=wish).hash != plain.hash


def test_lamp_loops() -> None:
    """Whole turns per loop: the field at phase 1 would be that at phase 0."""
    text = (ROOT / "examples/lamp.blob").read_text(encoding="utf-8")
    start = blobscript.compile(text.replace("phase", "0"))
    end = blobscript.compile(text.replace("phase", "1"))
    points = np.random.default_rng(1).uniform(-2, 2, (200, 3))
    assert np.allclose(start.field(points), end.field(points), rtol=0, atol=1e-12)


@pytest.mark.parametrize("path", EXAMPLES, ids=name)
def test_a_leaving_ray_does_not_hit_where_it_starts(path: Path) -> None:
    """From every hit towards the lights: what is met within rounding of the start would be a black speckle."""
    scene = blobscript.load(path)
    camera = scene.ir.camera
    random = np.random.default_rng(9)
    towards = np.subtract(camera.to, camera.at)
    rays = towards + random.uniform(-0.35, 0.35, (3000, 3)) * np.linalg.norm(towards) * np.tan(camera.fov / 2)
    seen = scene.first_hit([camera.at], rays)
    # once more from close by: from afar, t alone is rounded more coarsely than the place it stands for
    close = seen.position[seen.hit] + 1e-3 * seen.normal[seen.hit]
    hits = scene.first_hit(close, -seen.normal[seen.hit], t_max=2e-3)
    at, normal = hits.position[hits.hit], hits.normal[hits.hit]
    away = random.normal(size=normal.shape)
    away *= np.sign(np.sum(away * normal, axis=1, keepdims=True))
    steep = np.sum(away * normal, axis=1) > 0.05 * np.linalg.norm(away, axis=1)
    again = scene.first_hit(at[steep], away[steep])
    assert np.count_nonzero(steep) > 200
    assert np.count_nonzero(again.t < 1e-9) == 0
