"""Pictures without background: alpha is what hides it, and of a floor that catches shadows only those are left."""

from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript.backends.picture import Indirect
from blobscript.images import read

BALL = "surface(material = clay(#c04030)) { ball((0, 1, 0), radius = 1) }\n"
VIEW = "camera(from = (0, 4, 8), to = (0, 0.5, 0), fov = 40deg)\n"
CATCH = "floor(catch = true)\nsun(toward = (-1, -1, 0), strength = 3)\n"


@pytest.mark.parametrize(("samples", "indirect"), [(1, "even"), (9, "even"), (8, "occlusion"), (8, "bounce")])
def test_only_shadows_are_left_of_the_floor(samples: int, indirect: Indirect) -> None:
    scene = blobscript.compile(BALL + VIEW + CATCH)
    picture = scene.render(96, 72, samples, indirect=indirect, transparent=True)
    alpha = picture.rgba[..., 3]
    assert alpha[36, 48] == 1  # the ball
    assert alpha[2, 48] <= 0.01 and alpha[70, 90] <= 0.1  # sky, and floor in the light
    assert 0.3 < alpha[40, 28] < 1  # the shadow, to the left of the ball
    shadow = (alpha > 0.3) & (alpha < 1) & (np.arange(96) < 34)
    assert shadow.sum() > 20
    assert np.all(picture.rgba[..., :3][shadow] <= 1e-6)  # is black


@pytest.mark.parametrize("more", ["", "background(#ff0000)\n", "sky(zenith = #ffffff)\n"])
def test_over_the_background_it_is_the_usual_picture(more: str) -> None:
    """Where the light is even and the ball matt, nothing but the camera sees the background of one colour."""
    scene = blobscript.compile(BALL + VIEW + CATCH + more)
    usual = scene.render(96, 72, 4, indirect="even").rgba
    clear = scene.render(96, 72, 4, indirect="even", transparent=True).rgba
    ball = clear[..., 3] == 1
    np.testing.assert_allclose(usual[ball], clear[ball], rtol=1e-5)
    if "background" in more:
        shown = usual[0, 0, :3]
        np.testing.assert_allclose(usual[..., :3], clear[..., :3] + (1 - clear[..., 3:]) * shown, atol=1e-4)


def test_a_solid_floor_hides_the_background() -> None:
    scene = blobscript.compile(BALL + VIEW + "floor()\n")
    alpha = scene.render(60, 40, 4, transparent=True).rgba[..., 3]
    assert alpha[-1].min() == 1


def test_alpha_in_files(tmp_path: Path) -> None:
    scene = blobscript.compile(BALL + VIEW)
    picture = scene.render(60, 40, 4, transparent=True)
    for name in ("a.png", "a.exr"):
        picture.save(tmp_path / name)
        back = read(tmp_path / name).rgba
        np.testing.assert_allclose(back[..., 3], picture.rgba[..., 3], atol=0.003)
        assert back[0, 0].tolist() == [0, 0, 0, 0]
