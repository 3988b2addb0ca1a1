"""What is approximated is said, in the text and in notes, each with a figure or why there is none."""

from __future__ import annotations

import re

import numpy as np
import pytest

import blobscript
from blobscript.povray import objects
from blobscript.povray.losses import Losses

#: A piece of a script -> words of the note it gives.
NOTED = {
    "camera(from = (0, 1, 6), to = (0, 0, 0), aperture = 0.6)": "pinhole",
    "lamp((2, 4, 3), strength = 60, size = 3)": "points",
    "sun((0.5, -1, -0.5), angle = 20deg)": "points",
    'tone("film")': "tone curve",
    "floor(catch = true)": "whole plane",
    "fog(distance = 8)\nsurface(material = chrome) { ball((2, 0, 0), radius = 0.5) }": "in mirrors",
    "floor(fade = 9)\nbackground(white)\nsurface(material = glass) { ball((2, 0, 0), radius = 0.5) }": "through glass",
    "surface(material = material(gold, roughness = 0.4, metalness = 1)) { ball((2, 0, 0), radius = 0.5) }": "metal",
    "surface(material = material(white, roughness = 0.4, transmission = 1)) { ball((2, 0, 0), 1) }": "smooth",
    "import clouds from std.textures\nsurface(material = clay(clouds(red, blue))) { ball((2, 0, 0), 1) }": "noise",
    "surface(material = material(gold, roughness = fn(p) = clamp(p.x, 0, 1))) { ball((2, 0, 0), 1) }": "depend",
    "surface(material = plastic) { ball((2, 0, 0), radius = 0.5) }\nsun((0.5, -1, -0.5))": "fitted",
}


@pytest.mark.parametrize("piece", NOTED)
def test_each_note_has_a_figure(piece: str) -> None:
    imports, rest = piece.split("\n", 1) if piece.startswith("import") else ("", piece)
    script = f"{imports}\nsurface(material = clay(coral)) {{ ball(radius = 1) }}\n{rest}\n"
    made = blobscript.compile(script).pov_document(64, 48)
    notes = [note.message for note in made.diagnostics]
    assert all(note.code == "N1001" for note in made.diagnostics)
    assert any(NOTED[piece] in note for note in notes), notes
    for note in notes:
        assert re.search(r"\d+\.\d/255 in the mean|\d\.\d%|`compare` measures it", note), note
        assert "// not exact: " in made.text


def test_figures_are_those_of_the_pictures() -> None:
    """Light through a lens ten times as wide changes more; what is not there changes nothing."""

    def lost(script: str) -> float:
        notes = blobscript.compile(f"surface {{ ball(radius = 1) }}\n{script}").pov_document(64, 48).diagnostics
        found = [re.search(r"([\d.]+)/255", note.message) for note in notes]
        return next((float(match[1]) for match in found if match), 0.0)

    narrow, wide = (lost(f"camera(from = (0, 0, 6), aperture = {a})") for a in (0.1, 2))
    assert 0 <= narrow < wide < 100
    scene = blobscript.compile("surface { ball(radius = 1) }").ir
    assert Losses(scene, 64, 48).without(scene) == "0.0/255 in the mean"


def test_what_negative_parts_would_weigh_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(objects, "_MOST_MIXED", 1)
    script = """surface(kernel = soft2) { ball(radius = 1).paint(red)
      ball((0.8, 0, 0), radius = 1).paint(blue)
      ball((0.4, 0.9, 0), reach = 1, weight = -0.5) }"""
    made = blobscript.compile(script).pov_document()
    told = [note.message for note in made.diagnostics if "negative components" in note.message]
    shares = [float(x) for x in re.findall(r"([\d.]+)%", told[0])]
    assert len(told) == 1
    assert 0 < shares[0] < shares[1] < 50
    assert np.isfinite(shares).all()
    assert "not exact: POV-Ray also counts negative" in made.text


def test_lost_paint_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(objects, "_MOST_TERMS", 1)
    scene = blobscript.compile("surface { ball(radius = 1).paint(red)\n ball((1, 0, 0), radius = 1) }")
    told = [n.message for n in scene.pov_document(64, 48, stem="a", grid=20).diagnostics if "painted" in n.message]
    assert len(told) == 1
    assert float(re.findall(r"([\d.]+)/255", told[0])[0]) > 1


def test_what_is_exact_is_not_noted() -> None:
    """The fixed example of the page of N1001."""
    script = "surface(material = material(coral, roughness = 0, specular = 0)) { ball(radius = 1) }"
    assert blobscript.compile(script).pov_document(64, 48).diagnostics == ()
