"""The light in a picture: against a second implementation, and against what energy allows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from picture import reference, scenes

from blobscript import ir
from blobscript.backends import picture
from blobscript.backends.native import Native

WHITE = ir.Background((1.0, 1.0, 1.0))


@pytest.mark.parametrize("name", ["row", "painted", "crowd", "plain"])
def test_pixels_are_what_the_formulas_say(name: str) -> None:
    """Every 53rd pixel of a small picture, to float32 and the rounding of a few bounces."""
    scene = getattr(scenes, name)()
    native = Native(scene)
    image = picture.render(scene, native)
    ref = reference.Reference(scene, native)
    places = [(i % scene.width, i // scene.width) for i in range(0, scene.width * scene.height, 53)]
    expected = np.array([ref.pixel(x, y) for x, y in places])
    found = np.array([image.rgba[y, x, :3] for x, y in places])
    error = np.abs(found - expected) / (1 + np.abs(expected))
    assert error.max() < 1e-5


def test_each_material_is_seen() -> None:
    """So that the test above is about all of them."""
    scene = scenes.row()
    image = picture.render(scene, aov=("surface",))
    assert set(np.unique(image.aov["surface"])) == {-1, 0, 1, 2, 3, 4, 5}


def furnace(material: ir.Material, monkeypatch: pytest.MonkeyPatch, lights: tuple[ir.Light, ...] = ()) -> np.ndarray:
    """The colours of a ball in even white light, from its middle to its rim."""
    monkeypatch.setattr(picture, "FILL", 1.0)
    monkeypatch.setattr(picture, "FLOOR", 1.0)
    scene = scenes.scene(scenes.ball(), materials=(material,), lights=lights, background=WHITE)
    image = picture.render(scene, aov=("surface",), width=96, height=72)
    return image.rgba[image.aov["surface"] == 0][:, :3]


@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
def test_a_white_ball_in_white_light_cannot_be_seen(roughness: float, monkeypatch: pytest.MonkeyPatch) -> None:
    colours = furnace(ir.Material((1.0, 1.0, 1.0), roughness=roughness), monkeypatch)
    np.testing.assert_allclose(colours, 1, atol=1e-6)


def test_clear_glass_in_white_light_cannot_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """But for the faint rays that are not followed."""
    colours = furnace(ir.Material((1.0, 1.0, 1.0), roughness=0.0, transmission=1.0), monkeypatch)
    assert colours.max() < 1 + 1e-6
    assert colours.min() > 0.99


@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.5, 1.0])
def test_white_metal_returns_no_more_than_it_gets(roughness: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """One bounce between microfacets is modelled; rough metal loses the rest."""
    colours = furnace(ir.Material((1.0, 1.0, 1.0), roughness=roughness, metalness=1.0), monkeypatch)
    assert colours.max() <= 1 + 1e-6
    assert colours.min() > 0.4
    if roughness < 0.2:
        assert colours.min() > 0.9


@pytest.mark.parametrize("roughness", [0.45, 0.7, 1.0])
@pytest.mark.parametrize("nv", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("f0", [0.04, 1.0])
def test_no_material_returns_more_than_a_light_sends(roughness: float, nv: float, f0: float) -> None:
    """The response to light from all sides, integrated: 1, up to the error of the fitted layer."""
    n, v = np.array((0.0, 0.0, 1.0)), np.array((math.sqrt(1 - nv * nv), 0.0, nv))
    m = ir.Material((1.0, 1.0, 1.0), roughness=roughness, metalness=float(f0 == 1))
    cosines, weights = np.polynomial.legendre.leggauss(64)
    total = 0.0
    for z, weight in zip((cosines + 1) / 2, weights / 2, strict=True):
        for turn in np.arange(64) * (2 * math.pi / 64):
            way = np.array((math.sqrt(1 - z * z) * math.cos(turn), math.sqrt(1 - z * z) * math.sin(turn), z))
            layer = reference.layer_share(np.full(3, f0), m, nv)
            diffuse = (1 - layer[0]) * (f0 < 1) * reference.oren_nayar(m.roughness / 2, n, v, way, nv)
            glossy = (reference.gain(m, nv) * reference.ggx(np.full(3, f0), m.roughness, n, v, way, nv))[0]
            total += weight * 2 * math.pi / 64 * (diffuse + glossy)
    assert 0.95 < total < (1.08 if nv < 0.2 else 1.05)


def test_shadows_are_hard_and_right() -> None:
    """A small ball between the sun and a large one: the shadow is the disc that geometry says."""
    sun = ir.Sun((0.0, 0.0, -1.0), (3.0, 3.0, 3.0))
    scene = scenes.scene(
        scenes.ball(0, (0, 0, 0), 1.0),
        scenes.ball(0, (0, 0, 3), 0.3),
        lights=(sun,),
        view=scenes.look((6, 0, 6), (0, 0, 0), (0, 1, 0), 0.5),
    )
    image = picture.render(scene, width=120, height=120, aov=("position", "normal", "surface"))
    dark = picture.render(scenes.scene(*scene.surfaces, lights=(), view=scene.camera), width=120, height=120)
    lit = (image.rgba - dark.rgba)[:, :, :3].max(axis=2) > 0
    on = image.aov["surface"] == 0
    p, n = image.aov["position"][on], image.aov["normal"][on]
    radius = np.hypot(p[:, 0], p[:, 1])
    expected = (n[:, 2] > 0) & (radius > 0.3)
    sure = (np.abs(radius - 0.3) > 1e-3) & (np.abs(n[:, 2]) > 1e-3)
    assert np.array_equal(lit[on][sure], expected[sure])
    assert np.count_nonzero((radius < 0.3) & (n[:, 2] > 0)) > 100


def test_a_lamp_falls_off_with_the_square() -> None:
    plain = ir.Material((1.0, 1.0, 1.0), roughness=0.0, specular=0.0)
    black = ir.Background((0.0, 0.0, 0.0))
    view = scenes.look((0, 0, 5), (0, 0, 0), (0, 1, 0), 0.01)
    middle = []
    for distance in (2.0, 4.0):
        lamp = ir.Lamp((0.0, 0.0, 1 + distance), (1.0, 1.0, 1.0))
        scene = scenes.scene(scenes.ball(), materials=(plain,), lights=(lamp,), background=black, view=view)
        image = picture.render(scene, width=9, height=9, samples=1)
        middle.append(float(image.rgba[4, 4, 0]))
    assert middle[0] / middle[1] == pytest.approx(4, rel=1e-3)


def test_shadows_from_far_away_have_no_holes() -> None:
    """The hit's distance has fewer digits than its place: no speck of shadow on the lit side."""
    sun = ir.Sun((-0.25, -0.3, -1.0), (3.0, 3.0, 3.0))
    for distance in (7.0, 1e4, 1e8):
        view = scenes.camera(distance, 2.4 / distance)
        lights, dark = ((sun,), ()), ir.Background((0.0, 0.0, 0.0))
        lit, unlit = (
            picture.render(scenes.scene(scenes.ball(), lights=some, background=dark, view=view), aov=("surface",))
            for some in lights
        )
        on = lit.aov["surface"] == 0
        assert on.sum() > 500
        assert ((lit.rgba - unlit.rgba)[on][:, 0] > 0).all()


@pytest.mark.parametrize(
    "view",
    [
        scenes.look((0, 0, 0.2), (0, 0, -1), (0, 1, 0), 1.0),  # in a ball
        scenes.look((0, 0, 1), (0, 0, 0), (0, 1, 0), 1.0),  # on it, looking in
        scenes.look((0, 0, 1), (0, 1, 1), (0, 0, 1), 1.0),  # on it, looking along
        scenes.look((0, 0, 1e6), (0, 0, 0), (0, 1, 0), 3e-6),
        scenes.look((0, 0, 3), (0, 0, 0), (0, 1, 0), 3.1),
    ],
)
@pytest.mark.parametrize("material", [0, 2, 4, 5])
def test_no_pixel_is_not_a_number(view: ir.Camera, material: int) -> None:
    """Also with lamps on a surface, inside it, and at the camera."""
    lamps = tuple(ir.Lamp(at, (2.0, 2.0, 2.0)) for at in [(0.0, 0.0, 1.0), (0.0, 0.0, 0.0), view.at])
    scene = scenes.scene(scenes.ball(material), lights=lamps, view=view)
    image = picture.render(scene, width=31, height=23, samples=2)
    assert np.isfinite(image.rgba).all()
    assert image.rgba.min() >= 0
