"""Materials, lights, backgrounds and the stage as a script gives them, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from language.compiling import run

from blobscript import ir
from blobscript.assemble import DEFAULT_LIGHTS
from blobscript.images import Image
from blobscript.verify import verify

BALL = "surface { ball(radius = 1) }\n"


def made(text: str) -> ir.Scene:
    scene, found = run(BALL + text)
    assert scene is not None, [d.message for d in found]
    assert found == []
    verify(scene)
    return scene


def test_the_stage() -> None:
    scene = made(
        'floor(y = -1, material = stone, fade = 20)\nfog(30, color = white)\ntone("film", exposure = -0.5)\n'
        "camera((0, 0, 9), aperture = 0.2, focus = (0, 0, 1))\n"
        "sun((0, -1, 0), angle = 10deg)\nlamp((0, 5, 0), strength = 4, size = 0.5)\n"
        "sky(zenith = blue, horizon = white, ground = black, strength = 2)\n"
    )
    assert scene.floor is not None
    assert (scene.floor.height, scene.floor.fade, scene.floor.catch) == (-1, 20, False)
    assert scene.materials[scene.floor.material].name == "stone"
    assert scene.fog == ir.Fog(30, (1, 1, 1))
    assert scene.tone == ir.Tone("film", -0.5)
    assert (scene.camera.aperture, scene.camera.focus) == (0.2, (0, 0, 1))
    sun, lamp = scene.lights
    assert isinstance(sun, ir.Sun)
    assert isinstance(lamp, ir.Lamp)
    assert sun.angle == pytest.approx(math.radians(10))
    assert (lamp.size, lamp.color) == (0.5, (4, 4, 4))
    assert scene.background.light == ir.Sky((0, 0, 2), (2, 2, 2), (0, 0, 0))
    assert not scene.background.shown


def test_a_sky_is_light_and_takes_the_place_of_the_default_lights() -> None:
    assert made("").lights == DEFAULT_LIGHTS
    assert made("background(red)").lights == DEFAULT_LIGHTS
    assert made("sky()").lights == ()
    shown = made("sky(shown = red)").background
    assert (shown.shown, shown.color) == (True, (1, 0, 0))


def test_floor_is_still_a_function_of_numbers() -> None:
    scene = made("let n = floor(2.7)\nassert n == 2\nassert map([1.5, -0.5], floor) == [1, -1]\nfloor()")
    assert scene.floor is not None
    assert scene.floor.height == 0


def test_materials_of_ones_own() -> None:
    scene, _ = run(
        "surface(material = material(#ff8080, transmission = 1, depth = 2)) { ball(radius = 1) }\n"
        "surface(material = material(black, emission = white, glow = 8)) { ball((3, 0, 0), radius = 1) }"
    )
    assert scene is not None
    clear, bright = scene.materials
    assert np.exp(-2 * np.array(clear.absorption)) == pytest.approx((1, 0.2158605, 0.2158605), rel=1e-5)
    assert bright.emission == (8, 8, 8)


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("material(roughness = -0.1)", "E0405", "`roughness` must lie in 0..1, but it is -0.1"),
        ("material(metalness = 1.5)", "E0405", "`metalness` must lie in 0..1"),
        ("material(ior = 0.9)", "E0405", "`ior` must lie in 1..10, but it is 0.9"),
        ("material(ior = 1e200 ^ 2)", "E0405", ""),
        ("material(transmission = 1, depth = 0)", "E0405", "`depth` must be positive"),
        ("material(depth = 1, absorption = red)", "E0405", "not by both"),
        ("material(emission = red, glow = -1)", "E0405", "`glow` must not be negative"),
        ("material(emission = fn(p) = red, glow = 2)", "E0405", "`glow` goes with one colour"),
        ("clay(fn(p) = p)", "E0304", ""),
        ("clay(fn(x: number) = red)", "E0304", ""),
        ("clay(rgb(-0.2, 0, 0))", "E0405", "`r` must lie in 0..1, but it is -0.2"),
    ],
)
def test_bad_materials(text: str, code: str, words: str) -> None:
    scene, found = run(f"surface(material = {text}) {{ ball(radius = 1) }}")
    assert scene is None
    assert [d.code for d in found] == [code]
    assert words in found[0].message
    assert found[0].line == 1


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("sun((0, -1, 0), angle = 200deg)", "E0405", "`angle` must lie between 0deg and 180deg"),
        ("sun((0, -1, 0), strength = -1)", "E0405", "`strength` must not be negative"),
        ("lamp((0, 1, 0), size = -1)", "E0405", "`size` must not be negative"),
        ("sky(strength = -1)", "E0405", "`strength` must not be negative"),
        ("fog(0)", "E0405", "`distance` must be positive"),
        ("floor(fade = -1)", "E0405", "`fade` must not be negative"),
        ("floor(catch = true, material = clay)", "E0405", "has no material"),
        ("floor()\nfloor(y = 1)", "E0402", "there is a floor already"),
        ("sky()\nbackground(red)", "E0402", "there is a background already"),
        ("tone(exposure = 50)", "E0405", "`exposure` must lie in -20..20 stops"),
        ('tone("vivid")', "E0304", "linear"),
        ("camera((0, 0, 9), aperture = -1)", "E0405", "`aperture` must not be negative"),
        ("camera((0, 0, 9), aperture = 1, focus = (0, 0, 20))", "E0405", "behind the camera"),
        ('environment("none.exr")', "E0801", "cannot read `none.exr`"),
    ],
)
def test_bad_light(text: str, code: str, words: str, tmp_path: Path) -> None:
    scene, found = run(BALL + text, folder=tmp_path)
    assert scene is None
    assert [d.code for d in found] == [code]
    assert words in found[0].message
    assert found[0].line >= 2
    assert found[0].helps or found[0].notes or code == "E0402"


# ---- environments ---------------------------------------------------------------------


def picture(path: Path, width: int, height: int, value: float = 0.5) -> None:
    Image(np.full((height, width, 4), value, np.float32)).save(path)


def test_an_environment_comes_from_a_file_below_the_script(tmp_path: Path) -> None:
    picture(tmp_path / "room.exr", 64, 32, 3.0)
    scene, found = run(f'{BALL}environment("room.exr", strength = 2, turn = 90deg)', folder=tmp_path)
    assert scene is not None, found
    light = scene.background.light
    assert isinstance(light, ir.Environment)
    assert light.pixels.shape == (32, 64, 3)
    assert light.pixels.max() == light.pixels.min() == 6
    assert light.turn == pytest.approx(math.pi / 2)
    assert scene.background.color == pytest.approx((6, 6, 6))
    assert [name for name, _ in scene.sources if name.endswith(".exr")] == ["room.exr"]
    verify(scene)


def test_large_environments_are_averaged(tmp_path: Path) -> None:
    picture(tmp_path / "big.png", 4100, 2050)
    scene, _ = run(f'{BALL}environment("big.png")', folder=tmp_path)
    assert scene is not None
    assert isinstance(scene.background.light, ir.Environment)
    assert scene.background.light.pixels.shape == (683, 1366, 3)


@pytest.mark.parametrize(
    ("name", "words"), [("square.exr", "has 32 x 32 pixels"), ("text.exr", "no picture"), ("../out.exr", "outside")]
)
def test_what_is_no_environment(name: str, words: str, tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    folder.mkdir()
    picture(folder / "square.exr", 32, 32)
    picture(tmp_path / "out.exr", 32, 16)
    (folder / "text.exr").write_text("hello", encoding="utf-8")
    scene, found = run(f'{BALL}environment("{name}")', folder=folder)
    assert scene is None
    assert found[0].code in ("E0801", "E0207")
    assert words in found[0].message or found[0].code == "E0207"
