"""Light that is followed by chance: soft shadows, sky, glass, floor, fog, lens; and how fast it settles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from picture import scenes
from picture.test_brdf import looked, respond, sphere

import blobscript
from blobscript import ir
from blobscript.backends import picture
from blobscript.backends.native import Native
from blobscript.images import Image

BLACK = ir.Background((0.0, 0.0, 0.0))
PLAIN = ir.Material((1.0, 1.0, 1.0), roughness=0.0, specular=0.0)
Array = NDArray[np.float64]


def seen(text: str, width: int = 40, height: int = 40, **options: object) -> Image:
    return blobscript.compile(text).render(width, height, **options)  # type: ignore[arg-type]


# ---- how it settles ---------------------------------------------------------------------


def shown(image: Image) -> Array:
    return np.sqrt(np.clip(image.rgba[:, :, :3], 0, 1)).astype(np.float64)


@pytest.fixture(scope="module")
def lit() -> tuple[ir.Scene, Native, Image]:
    """A scene with soft shadows, glass, rough metal and indirect light, and its fine picture."""
    scene = scenes.scene(
        *scenes.row().surfaces,
        lights=(ir.Sun((0.5, -0.8, -0.4), (2.0, 1.9, 1.7), 0.6), ir.Lamp((-3.0, 2.5, 3.0), (9.0, 10.0, 12.0), 1.0)),
        background=ir.Background((0.5, 0.5, 0.5), light=ir.Sky((0.3, 0.5, 0.9), (0.8, 0.8, 0.8), (0.3, 0.3, 0.3))),
    )
    native = Native(scene)
    return scene, native, picture.render(scene, native, width=24, height=16, samples=512, seed=99)


def test_noise_falls_as_it_should(lit: tuple[ir.Scene, Native, Image]) -> None:
    """Random samples would halve it for four times as many; well spread ones do at least that."""
    scene, native, fine = lit
    errors = []
    for n in (4, 16, 64):
        image = picture.render(scene, native, width=24, height=16, samples=n, seed=3)
        errors.append(float(np.sqrt(np.mean((shown(image) - shown(fine)) ** 2))))
    assert errors[1] < 0.56 * errors[0]
    assert errors[2] < 0.56 * errors[1]


@pytest.mark.parametrize("noise", [0.03, 0.015])
def test_the_noise_is_what_was_asked_for(noise: float, lit: tuple[ir.Scene, Native, Image]) -> None:
    """Root mean square over the picture; cells that are done stop, hard ones go on."""
    scene, native, fine = lit
    image = picture.render(scene, native, width=24, height=16, samples=256, noise=noise, aov=("samples",), seed=3)
    error = float(np.sqrt(np.mean((shown(image) - shown(fine)) ** 2)))
    assert 0.2 * noise < error < 1.1 * noise
    taken = image.aov["samples"]
    assert taken.min() == 8
    assert taken.max() >= 2 * taken.min()
    cells = taken.reshape(4, 4, 6, 4)
    assert (cells == cells[:, :1, :, :1]).all()


def test_what_chance_decides_does_not_depend_on_the_work(lit: tuple[ir.Scene, Native, Image]) -> None:
    scene, native, _ = lit
    layers = ("direct", "indirect", "samples", "albedo")
    pictures = [
        picture.render(scene, native, width=36, height=24, samples=16, noise=0.05, threads=threads, aov=layers)
        for threads in (1, 3)
    ]
    part = picture.render(
        scene, native, width=36, height=24, samples=16, noise=0.05, aov=layers, region=(17, 5, 31, 20)
    )
    for other in pictures[1:]:
        assert other.rgba.tobytes() == pictures[0].rgba.tobytes()
        assert all(other.aov[name].tobytes() == pictures[0].aov[name].tobytes() for name in layers)
    assert np.array_equal(part.rgba, pictures[0].rgba[5:20, 17:31])
    assert np.array_equal(part.aov["samples"], pictures[0].aov["samples"][5:20, 17:31])


@pytest.mark.parametrize("samples", [1, 8])
def test_direct_and_indirect_light_are_the_picture(samples: int, lit: tuple[ir.Scene, Native, Image]) -> None:
    scene, native, _ = lit
    image = picture.render(scene, native, samples=samples, aov=("direct", "indirect", "samples"))
    np.testing.assert_allclose(image.aov["direct"] + image.aov["indirect"], image.rgba[:, :, :3], rtol=1e-5, atol=1e-6)
    assert (image.aov["samples"] == samples).all()
    assert image.aov["indirect"].max() > 0.1
    dark = picture.render(
        scenes.scene(*scene.surfaces, lights=(), background=BLACK), samples=samples, aov=("direct", "indirect")
    )
    assert dark.aov["indirect"].max() <= 0.11  # one of the materials glows


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_no_acne_and_no_leaks_at_any_scale(scale: float) -> None:
    """The same scene in other units gives the same picture, to rounding: no length is built in."""
    text = f"""
let s = {scale!r}
surface(material = metal) {{ ball((0, 0, 0), radius = 0.8 * s)
  ball((s, 0.2 * s, 0), radius = 0.6 * s) }}
let clear = material(white, transmission = 1, roughness = 0)
surface(material = clear) {{ ball((-0.9 * s, -0.3 * s, 0.9 * s), radius = 0.4 * s) }}
floor(y = -0.8 * s, fade = 9 * s)
sky()
sun((0.4, -1, -0.5), strength = 2)
camera((0, 2 * s, 7 * s), to = (0.2 * s, 0, 0), fov = 30deg)
"""
    image, one = (seen(text.replace(repr(scale), repr(k)), 24, 24, samples=8) for k in (scale, 1.0))
    gap = np.abs(shown(image) - shown(one)).max(axis=2)
    assert np.mean(gap > 0.02) < 0.01
    assert np.isfinite(image.rgba).all()


# ---- lights -----------------------------------------------------------------------------


def test_a_wide_sun_softens_the_edge_of_a_shadow() -> None:
    """A half plane high over the floor: the light on it follows the part of the sun's disc that is seen."""
    text = """
surface(material = clay(black)) {{ polygon([(0, 2, -9), (9, 2, -9), (9, 2, 9), (0, 2, 9)]).blob(radius = 0.001) }}
floor(y = 0, material = material(white, roughness = 0, specular = 0))
sun((0, -1, 0), strength = 3, angle = {angle}deg)
background(black)
camera((0, 1.2, 2.5), to = (0, 0, 0), fov = 0.7deg)
"""
    for angle in (10, 20):
        image = seen(text.format(angle=angle), 41, 1, samples=256, aov=("position",), indirect="occlusion")
        x, light = image.aov["position"][0, :, 0], image.rgba[0, :, 0]
        radius = 2 * math.tan(math.radians(angle / 2))
        u = np.clip(-x / radius, -1, 1)
        free = 1 - (np.arccos(u) - u * np.sqrt(1 - u * u)) / math.pi
        floor = np.abs(image.aov["position"][0, :, 1]) < 1e-6
        assert floor.sum() > 30
        np.testing.assert_allclose(light[floor], free[floor] * light[floor].max(), atol=0.05 * light[floor].max())


def test_a_large_lamp_is_as_bright_as_the_point_that_it_replaces() -> None:
    """Irradiance straight below a glowing ball is color / d^2, whatever its size (Lambert's theorem)."""
    light = []
    for size in (0.0, 1.0, 2.5):
        text = f"""
surface {{ ball((50, 50, 50), radius = 0.1) }}
floor(y = 0, material = material(white, roughness = 0, specular = 0))
lamp((0, 2, 0), strength = 4, size = {size})
background(black)
camera((0, 0.5, 0.8), to = (0, 0, 0), fov = 0.1deg)
"""
        light.append(float(seen(text, 1, 1, samples=2048).rgba[0, 0, 0]))
    np.testing.assert_allclose(light, light[0], rtol=0.01)


def test_occlusion_in_a_corner() -> None:
    """On the floor at the distance d from a long, high wall the open sky gives (1 + sin a) / 2 of its light,
    with a the angle of the wall's foot: for an endless wall half of it everywhere."""
    text = """
surface(material = clay(black)) { polygon([(0, -1, -2000), (0, -1, 2000), (0, 2000, 2000), (0, 2000, -2000)])
  .blob(radius = 0.001) }
floor(y = 0, material = material(white, roughness = 0, specular = 0))
sky(white, white, white)
camera((2, 2, 0), to = (1, 0, 0), fov = 1deg)
"""
    image = seen(text, 1, 1, samples=4096, indirect="occlusion")
    assert float(image.rgba[0, 0, 0]) == pytest.approx(0.5, rel=0.02)
    bounced = seen(text.replace("clay(black)", "material(white, roughness = 0, specular = 0)"), 1, 1, samples=1024)
    assert 0.7 < float(bounced.rgba[0, 0, 0]) < 1.01


@pytest.mark.parametrize("name", ["CLAY", "PLASTIC", "METAL", "GLASS", "JELLY"])
def test_nothing_shines_brighter_than_the_sky_around_it(name: str) -> None:
    """White furnace by chance: the mean over a ball in even white light is white to 1 %, and glass is unseen."""
    m: ir.Material = getattr(scenes, name)
    white = ir.Material((1, 1, 1), m.roughness, m.metalness, m.specular, m.transmission, m.ior)
    sky = ir.Background((1, 1, 1), light=ir.Sky((1, 1, 1), (1, 1, 1), (1, 1, 1)))
    scene = scenes.scene(scenes.ball(), materials=(white,), lights=(), background=sky)
    image = picture.render(scene, width=12, height=9, samples=128, aov=("surface",))
    light = image.rgba[image.aov["surface"] == 0][:, 0]
    assert light.mean() < 1.01
    assert light.mean() > (0.995 if name == "GLASS" else 0.75)


@pytest.mark.parametrize(("roughness", "metalness"), [(0.9, 0.0), (0.4, 1.0), (0.3, 0.0)])
@pytest.mark.parametrize("height", [0.0, 0.7])
def test_an_environment_lights_as_the_sum_over_all_directions(
    height: float, roughness: float, metalness: float
) -> None:
    """At one place of a ball, where nothing is in the way: drawn directions and drawn lobes, weighed together."""
    rng = np.random.default_rng(1)
    pixels = (rng.random((16, 32, 3)) ** 3).astype(np.float32)
    pixels[5, 9] = 60.0
    around = ir.Background((0, 0, 0), light=ir.Environment("x.exr", pixels, 0.3))
    material = ir.Material((0.8, 0.7, 0.6), roughness=roughness, metalness=metalness)
    view = scenes.look((height, 0.0, 9.0), (height, 0.0, 0.0), (0.0, 1.0, 0.0), 1e-5)
    scene = scenes.scene(scenes.ball(), materials=(material,), lights=(), background=around, view=view)
    found = picture.render(scene, width=1, height=1, samples=4096).rgba[0, 0, :3]
    normal = np.array((height, 0.0, math.sqrt(1 - height**2)))
    frame = np.array(((normal[2], 0.0, -height), (0.0, 1.0, 0.0), normal))
    sky, keep = picture.pack_sky(around)
    ways = sphere(200_000)
    ways = ways[ways @ normal > 0]
    answer = respond(material, frame @ np.array((0.0, 0.0, 1.0)), np.ascontiguousarray(ways @ frame.T)).sum(axis=1)
    expected = (answer * looked(sky, ways)[:, :3]).sum(axis=0) * (4 * math.pi / 200_000)
    np.testing.assert_allclose(found, expected, rtol=0.02)
    assert len(keep) == 3


# ---- glass ------------------------------------------------------------------------------

SLAB = "polyhedron([(-2, -2, -0.5), (2, -2, -0.5), (2, 2, -0.5), (-2, 2, -0.5), (-2, -2, 0.5), (2, -2, 0.5), \
(2, 2, 0.5), (-2, 2, 0.5)], faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], \
[3, 0, 4, 7]])"


def transmitted(cosine: float, ior: float, absorption: float, thickness: float) -> float:
    """Of unpolarised light through a flat plate, all inner reflections summed: (1 - R)^2 A / (1 - R^2 A^2)."""
    inside = math.sqrt(1 - (1 - cosine**2) / ior**2)
    s = ((cosine - ior * inside) / (cosine + ior * inside)) ** 2
    p = ((inside - ior * cosine) / (inside + ior * cosine)) ** 2
    r, a = (s + p) / 2, math.exp(-absorption * thickness / inside)
    return (1 - r) ** 2 * a / (1 - r**2 * a**2)


@pytest.mark.parametrize("ior", [1.0, 1.5, 2.4])
@pytest.mark.parametrize("angle", [0, 60])
def test_a_plate_of_glass_lets_through_what_fresnel_and_beer_say(angle: float, ior: float) -> None:
    """White behind, black in front: exact exits, thin glass, absorption by the way inside."""
    direction = (math.sin(math.radians(angle)), 0.0, math.cos(math.radians(angle)))
    eye = tuple(6 * d for d in direction)
    text = f"""
let look = material(white, transmission = 1, roughness = 0, ior = {ior}, absorption = rgb(0.5, 0.5, 0.5))
surface(material = look) {{ {SLAB}.blob(radius = 0.01) }}
camera(({eye[0]!r}, 0, {eye[2]!r}), to = (0, 0, 0), fov = 0.5deg)
sky(black, black, black)
surface(material = material(black, emission = white, specular = 0, roughness = 1)) {{
  polygon([(-30, -30, -9), (30, -30, -9), (30, 30, -9), (-30, 30, -9)]).blob(radius = 0.01) }}
"""
    absorption = blobscript.compile(text).ir.materials[0].absorption[0]
    expected = transmitted(math.cos(math.radians(angle)), ior, absorption, 1.02)
    exact = float(seen(text, 1, 1).rgba[0, 0, 0])
    chance = float(seen(text, 1, 1, samples=4096).rgba[0, 0, 0])
    assert exact == pytest.approx(expected, rel=3e-3)
    assert chance == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("height", [0.0, 0.4, 0.8])
def test_a_ray_through_a_ball_of_glass_goes_the_way_of_the_formula(height: float) -> None:
    """The way inside is 2 sqrt(1 - (h / n)^2), and the ray leaves turned by twice the difference of the angles."""
    ior, absorption = 1.5, (0.3, 0.3, 0.3)
    inside = 2 * math.sqrt(1 - (height / ior) ** 2)
    turn = 2 * (math.asin(height) - math.asin(height / ior))
    glass = ir.Material((1, 1, 1), roughness=0.0, transmission=1.0, ior=ior, absorption=absorption)
    view = scenes.look((0.0, height, 9.0), (0.0, height, 0.0), (0.0, 1.0, 0.0), 1e-5)
    bands = np.zeros((4096, 8192, 1), np.float32)  # radiance says the angle below the horizon
    bands[:] = np.linspace(0, 1, 4096, dtype=np.float32)[:, None, None]
    around = ir.Environment("x.exr", np.repeat(bands[:, :8], 3, axis=2), 0.0)
    scene = scenes.scene(
        scenes.ball(0), materials=(glass,), lights=(), background=ir.Background((0, 0, 0), light=around), view=view
    )
    light = float(picture.render(scene, width=1, height=1).rgba[0, 0, 0])
    cosine = math.sqrt(1 - height**2)
    single = transmitted(cosine, ior, 0.0, 1.0)
    r = (1 - single) / (1 + single)  # (1 - r)^2 / (1 - r^2) = (1 - r) / (1 + r)
    row = (math.pi / 2 + turn) / math.pi * 4096 - 0.5
    expected = (1 - r) ** 2 * math.exp(-0.3 * inside) * row / 4095
    # what is reflected at once, and what goes round inside, comes from elsewhere: at most r of it each
    assert expected <= light + 1e-4
    assert light < expected + r + r * (1 - r) ** 2 / (1 - r) + 1e-4
    bare = expected + r * ((math.pi / 2 - 2 * math.asin(height)) / math.pi * 4096 - 0.5) / 4095
    assert light == pytest.approx(bare, abs=(1 - r) ** 2 * r / (1 - r) + 1e-3)


# ---- the stage --------------------------------------------------------------------------


def test_a_floor_that_catches_shadows_is_only_seen_where_they_are() -> None:
    """Away from the ball it is the background to the bit of a screen; below it, darker."""
    text = """
surface {{ ball((0, 1, 0), radius = 1) }}
{floor}
sun((0.3, -1, -0.2), strength = 3, angle = 5deg)
background(#808890)
camera((0, 3, 9), to = (0, 0.8, 0), fov = 40deg)
"""
    caught = seen(text.format(floor="floor(y = 0, catch = true)"), 24, 24, samples=32, aov=("surface",))
    bare = seen(text.format(floor=""), 24, 24, samples=32)
    off = caught.aov["surface"] < 0
    ratio = (caught.rgba[off] / bare.rgba[off])[:, :3]
    assert ratio.max() < 1.02
    assert ratio.min() < 0.6
    assert np.mean(ratio > 0.97) > 0.5
    rows = caught.rgba[:3, :, :3] / bare.rgba[:3, :, :3]
    np.testing.assert_allclose(rows, 1, atol=1e-5)


def test_a_floor_is_seen_from_above_and_stops_light_from_below() -> None:
    text = """
surface {{ ball((0, 1, 0), radius = 0.5) }}
floor(y = 0, material = clay(red))
sun((0, {way}, 0), strength = 3)
background(black)
camera((0, {eye}, 6), to = (0, 0.4, 0), fov = 40deg)
"""
    image = seen(text.format(way=-1, eye=2), aov=("depth", "position", "normal", "albedo", "surface"))
    floor = (image.aov["surface"] < 0) & np.isfinite(image.aov["depth"])
    assert floor.mean() > 0.4
    np.testing.assert_allclose(image.aov["position"][floor][:, 1], 0, atol=1e-6)
    np.testing.assert_allclose(image.aov["normal"][floor], np.broadcast_to((0, 1, 0), (floor.sum(), 3)))
    assert image.rgba[floor][:, 0].max() > 0.5
    below = seen(text.format(way=1, eye=2))
    assert below.rgba[:, :, :3].max() == 0
    under = seen(text.format(way=-1, eye=-2), aov=("depth", "surface"))
    assert np.array_equal(np.isfinite(under.aov["depth"]), under.aov["surface"] >= 0)


def test_fog_leaves_what_the_distance_says() -> None:
    text = """
surface(material = material(black, specular = 0, roughness = 1, emission = white)) {{ ball((0, 0, {z}), radius = 1) }}
fog(4, color = black)
camera((0, 0, 10), to = (0, 0, 0), fov = 1deg)
sky(black, black, black)
"""
    for z in (0.0, -10.0):
        light = float(seen(text.format(z=z), 1, 1).rgba[0, 0, 0])
        assert light == pytest.approx(math.exp(-(9 - z) / 4), rel=1e-4)


def test_a_lens_blurs_what_is_out_of_focus() -> None:
    """The edge of a ball at the focus stays sharp; twice as far away it spreads over aperture / 2 there."""
    text = """
surface(material = material(black, specular = 0, roughness = 1, emission = white)) {{ ball((1, 0, {z}), radius = 1) }}
camera((0, 0, 10), to = (0, 0, 0), fov = 0.12deg, aperture = {aperture})
sky(black, black, black)
"""

    def width(z: float, aperture: float) -> int:
        row = seen(text.format(z=z, aperture=aperture), 101, 1, samples=128).rgba[0, :, 0]
        return int(np.count_nonzero((row > 0.05) & (row < 0.95)))

    assert width(0.0, 0.5) <= 5
    assert width(-10.0, 0.0) <= 2
    assert 12 < width(-10.0, 0.5) < 40


# ---- tone -------------------------------------------------------------------------------


def test_exposure_and_curve_belong_to_pictures_not_to_light(tmp_path: object) -> None:
    from pathlib import Path

    from blobscript import images

    scene = blobscript.compile('surface { ball(radius = 1) }\ntone("film", exposure = 1)\nbackground(#777777)')
    image = scene.render(16, 12)
    plain = scene.render(16, 12, tone=ir.Tone())
    assert np.array_equal(image.rgba, plain.rgba)
    folder = Path(str(tmp_path))
    image.save(folder / "a.exr")
    image.save(folder / "a.png", 16)
    plain.save(folder / "b.png", 16)
    assert np.array_equal(images.read(folder / "a.exr").rgba, image.rgba)
    found = images.read(folder / "a.png").rgba
    np.testing.assert_allclose(found, images.developed(image.rgba, 1.0, "film"), atol=2e-4)
    assert found[0, 0, 0] > images.read(folder / "b.png").rgba[0, 0, 0]


def test_the_film_curve_keeps_grey_rises_and_ends_in_white() -> None:
    from blobscript.images import developed

    light = np.zeros((1, 400, 4), np.float32)
    light[0, :, :3] = np.linspace(0, 20, 400, dtype=np.float32)[:, None]
    curve = developed(light, 0.0, "film")[0, :, 0]
    assert curve[0] == 0
    assert (np.diff(curve) >= 0).all()
    assert curve[-1] == pytest.approx(1, abs=0.02)
    light[0, 0, :3] = 0.18
    assert developed(light, 0.0, "film")[0, 0, 0] == pytest.approx(0.18, rel=0.05)


# ---- lamps in mirrors -------------------------------------------------------------------


@pytest.mark.parametrize("looks", ["roughness = 0, metalness = 1", "roughness = 0, specular = 0, reflection = 1"])
def test_a_sun_with_a_size_is_seen_in_a_mirror_as_its_disc(looks: str) -> None:
    """Half angle 10 degrees: normals up to 5 degrees off show it, with its radiance, and nothing else is bright."""
    text = f"""surface(material = material(white, {looks})) {{ ball(radius = 1) }}
sun((0, 0, -1), strength = 2, angle = 20deg)
background(black)
camera((0, 0, 400), fov = 0.05deg)
"""
    image = seen(text, 60, 60, samples=16, aov=("normal",))
    light, off = image.rgba[:, :, 0], np.degrees(np.arccos(np.clip(image.aov["normal"][:, :, 2], -1, 1)))
    radiance = 2 / (2 * math.pi * (1 - math.cos(math.radians(10))))
    assert light[off < 4.6] == pytest.approx(radiance, rel=0.01)
    assert (light[off > 5.4] < 1e-3).all()


def test_a_lamp_with_a_size_lights_glossy_metal_as_much_as_the_point_that_it_replaces() -> None:
    """What the layer sends over all of a ball, for a disc in a smooth layer and for a rough one."""
    light = {}
    for size in (0.0, 0.8):
        for roughness in (0.15, 0.6):
            text = f"""let metal = material(white, roughness = {roughness}, metalness = 1)
surface(material = metal) {{ ball(radius = 1) }}
lamp((0, 0, 40), strength = 4000, size = {40 * math.sin(size / 2)})
background(black)
camera((0, 0, 400), fov = 0.3deg)
"""
            light[size, roughness] = float(seen(text, 90, 90, samples=16).rgba[:, :, 0].mean())
    assert light[0.8, 0.15] == pytest.approx(light[0.0, 0.15], rel=0.06)
    assert light[0.8, 0.6] == pytest.approx(light[0.0, 0.6], rel=0.06)
