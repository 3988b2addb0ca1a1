"""The C's response to light against NumPy, and against what energy and symmetry demand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from picture import reference

from blobscript import ir
from blobscript.backends import picture

Array = NDArray[np.float64]

MATERIALS = [
    ir.Material((0.8, 0.3, 0.2), roughness=0.9, specular=0.25),
    ir.Material((0.2, 0.4, 0.8), roughness=0.25),
    ir.Material((0.9, 0.7, 0.4), roughness=0.35, metalness=1.0),
    ir.Material((1.0, 1.0, 1.0), roughness=1.0, specular=1.0, metalness=0.5),
    ir.Material((0.9, 0.9, 0.9), roughness=0.5, transmission=0.5),
]


def directions(n: int, seed: int) -> Array:
    """Unit vectors above z = 0."""
    d = np.random.default_rng(seed).standard_normal((n, 3))
    d[:, 2] = np.abs(d[:, 2]) + 0.02
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def respond(material: ir.Material, eyes: Array, lights: Array) -> Array:
    """(n, 2, 3) diffuse and specular, times the cosine."""
    row, out = np.array(picture._row(material)), np.empty((len(lights), 2, 3))
    eyes, lights = (np.ascontiguousarray(np.broadcast_to(a, (len(out), 3))) for a in (eyes, lights))
    picture._library().shade_respond(row.ctypes.data, len(out), eyes.ctypes.data, lights.ctypes.data, out.ctypes.data)
    return out


def lobe(material: ir.Material, eye: Array, numbers: Array) -> tuple[Array, Array, Array]:
    """Directions (n, 3), their densities (n,), and weights (n, 3)."""
    row, out = np.array(picture._row(material)), np.empty((len(numbers), 7))
    picture._library().shade_lobe(
        row.ctypes.data, eye.ctypes.data, len(numbers), np.ascontiguousarray(numbers).ctypes.data, out.ctypes.data
    )
    return out[:, :3], out[:, 3], out[:, 4:]


@pytest.mark.parametrize("m", MATERIALS)
def test_the_response_is_what_the_formulas_say(m: ir.Material) -> None:
    n = np.array((0.0, 0.0, 1.0))
    eyes, lights = directions(200, 1), directions(200, 2)
    found = respond(m, eyes, lights)
    through = m.transmission * (1 - m.metalness)
    for eye, light, (diffuse, specular) in zip(eyes, lights, found, strict=True):
        f0 = (1 - through) * reference.base_reflectance(m) + through * ((m.ior - 1) / (m.ior + 1)) ** 2
        layer = reference.layer_share(f0, m, eye[2])
        base = np.array(m.color) * (1 - m.metalness) * (1 - m.transmission) * (1 - layer)
        expected = base * reference.oren_nayar(m.roughness / 2, n, eye, light, eye[2])
        np.testing.assert_allclose(diffuse, expected, rtol=1e-9, atol=1e-12)
        layer = reference.gain(m, eye[2]) * reference.ggx(f0, m.roughness, n, eye, light, eye[2])
        np.testing.assert_allclose(specular, layer, rtol=1e-9)


@pytest.mark.parametrize("m", MATERIALS)
def test_light_takes_the_same_share_both_ways(m: ir.Material) -> None:
    """Helmholtz reciprocity: of the specular term but for the gain of metals, and of the diffuse one under a layer that
    does not vary."""
    eyes, lights = directions(300, 3), directions(300, 4)
    there, back = respond(m, eyes, lights), respond(m, lights, eyes)
    there = there[:, 1] / np.array([reference.gain(m, d[2]) for d in eyes]) / lights[:, 2:]
    back = back[:, 1] / np.array([reference.gain(m, d[2]) for d in lights]) / eyes[:, 2:]
    np.testing.assert_allclose(there, back, rtol=1e-9)
    bare = ir.Material((1.0, 1.0, 1.0), roughness=m.roughness, specular=0.0)
    layers = [1 - reference.layer_share(np.zeros(3), bare, d[2])[0] for d in (*eyes, *lights)]
    there, back = respond(bare, eyes, lights)[:, 0, 0], respond(bare, lights, eyes)[:, 0, 0]
    np.testing.assert_allclose(there / lights[:, 2] / layers[:300], back / eyes[:, 2] / layers[300:], rtol=1e-9)


def furnace(m: ir.Material, z: float) -> float:
    """What the first colour returns of light from everywhere to an eye at the cosine z."""
    eye = np.array((math.sqrt(1 - z * z), 0.0, z))
    cosines, weights = np.polynomial.legendre.leggauss(128)
    turns = (np.arange(240) + 0.5) * (2 * math.pi / 240)
    up, turn = (a.ravel() for a in np.meshgrid((cosines + 1) / 2, turns, indexing="ij"))
    side = np.sqrt(1 - up * up)
    lights = np.stack([side * np.cos(turn), side * np.sin(turn), up], axis=1)
    return float(respond(m, eye, lights).sum(axis=1)[:, 0] @ np.repeat(weights / 2, 240) * (2 * math.pi / 240))


@pytest.mark.parametrize("roughness", [0.3, 0.45, 0.6, 0.8, 1.0])
@pytest.mark.parametrize("z", [0.2, 0.4, 0.7, 1.0])
def test_white_metal_returns_all_light(roughness: float, z: float) -> None:
    """White furnace, to 1 %, from every side: what facets send on to one another is not lost."""
    assert furnace(ir.Material((1.0, 1.0, 1.0), roughness=roughness, metalness=1.0), z) == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("roughness", [0.3, 0.45, 0.6, 0.8, 1.0])
def test_a_white_dielectric_returns_all_light(roughness: float) -> None:
    """White furnace, to 1 % over all sides; from one side to 3 %, for the fit of the layer's share."""
    m = ir.Material((1.0, 1.0, 1.0), roughness=roughness)
    heights, weights = np.polynomial.legendre.leggauss(8)
    z = (heights + 1) / 2
    total = np.array([furnace(m, float(c)) for c in z])
    assert float((total * z) @ weights) == pytest.approx(1, abs=0.01)
    assert np.abs(total[z > 0.3] - 1).max() < 0.03


def test_colored_metal_is_tinted_by_every_reflection() -> None:
    """Where a single reflection leaves 0.7, the rest comes back darker and more saturated than it went."""
    rough = [furnace(ir.Material((c, c, c), roughness=1.0, metalness=1.0), 0.7) for c in (0.9, 0.5, 0.2)]
    smooth = [furnace(ir.Material((c, c, c), roughness=0.3, metalness=1.0), 0.7) for c in (0.9, 0.5, 0.2)]
    kept = [a / b for a, b in zip(rough, smooth, strict=True)]
    assert 1 > kept[0] > kept[1] > kept[2] > 0.4


@pytest.mark.parametrize("roughness", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("z", [0.3, 0.6, 1.0])
def test_drawn_directions_have_the_density_and_weight_of_the_lobe(roughness: float, z: float) -> None:
    """weight = response / density, to rounding, and the mean over samples is the lobe's integral."""
    m = ir.Material((0.9, 0.6, 0.3), roughness=roughness, metalness=1.0)
    eye = np.array((math.sqrt(1 - z * z), 0.0, z))
    i = (np.arange(20_000) + 0.5) / 20_000
    numbers = np.stack([i, np.mod(np.arange(20_000) * 0.6180339887498949, 1.0)], axis=1)
    ways, density, weight = lobe(m, eye, numbers)
    up = ways[:, 2] > 1e-3
    expected = respond(m, eye, ways)[up, 1] / density[up, None]
    np.testing.assert_allclose(weight[up], expected, rtol=1e-6, atol=1e-9)
    assert (weight[ways[:, 2] <= 0] == 0).all()
    cosines, weights = np.polynomial.legendre.leggauss(400)
    turns = (np.arange(720) + 0.5) * (2 * math.pi / 720)
    height, turn = (a.ravel() for a in np.meshgrid((cosines + 1) / 2, turns, indexing="ij"))
    side = np.sqrt(1 - height * height)
    lights = np.stack([side * np.cos(turn), side * np.sin(turn), height], axis=1)
    whole = respond(m, eye, lights)[:, 1].T @ np.repeat(weights / 2, 720) * (2 * math.pi / 720)
    np.testing.assert_allclose(weight.mean(axis=0), whole, rtol=0.01)


# ---- the sky ----------------------------------------------------------------------------


def sphere(n: int) -> Array:
    """Evenly spread unit vectors."""
    i = np.arange(n) + 0.5
    y, turn = 1 - 2 * i / n, 2 * math.pi * i * 0.6180339887498949
    r = np.sqrt(1 - y * y)
    return np.stack([r * np.cos(turn), y, r * np.sin(turn)], axis=1)


def looked(sky: picture._Sky, d: Array) -> Array:
    """(n, 4) radiance and density."""
    out, d = np.empty((len(d), 4)), np.ascontiguousarray(d)
    picture._library().shade_sky_look(picture.ctypes.addressof(sky), len(d), d.ctypes.data, out.ctypes.data)
    return out


def environment(seed: int = 0, turn: float = 0.7) -> ir.Background:
    rng = np.random.default_rng(seed)
    pixels = rng.random((24, 48, 3), np.float32) ** 4
    pixels[5, 30] = 300.0
    return ir.Background((0.0, 0.0, 0.0), light=ir.Environment("x.exr", pixels, turn))


def test_an_environment_is_seen_where_it_was_painted() -> None:
    """The middle is towards -z, right of it +x; turning it moves everything counter-clockwise from above."""
    pixels = np.zeros((4, 8, 3), np.float32)
    pixels[1:3, 3:5] = (1, 0, 0)
    pixels[1:3, 5:7] = (0, 1, 0)
    pixels[0] = (0, 0, 1)
    ahead, right, up = (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    for turn, ways in ((0.0, (ahead, right, up)), (math.pi / 2, ((-1.0, 0.0, 0.0), ahead, up))):
        sky, keep = picture.pack_sky(ir.Background((0, 0, 0), light=ir.Environment("x", pixels, turn)))
        np.testing.assert_allclose(looked(sky, np.array(ways))[:, :3], np.eye(3), atol=1e-6)
        assert keep


def test_directions_of_an_environment_are_drawn_with_their_density() -> None:
    sky, keep = picture.pack_sky(environment())
    grid = sphere(200_000)
    light = looked(sky, grid)
    assert light[:, 3].mean() * 4 * math.pi == pytest.approx(1, rel=0.01)
    n = 100_000
    numbers = np.stack([np.mod(np.arange(n) * 0.6180339887498949, 1.0), (np.arange(n) + 0.5) / n], axis=1)
    drawn = np.empty((n, 3))
    picture._library().shade_sky_draw(picture.ctypes.addressof(sky), n, numbers.ctypes.data, drawn.ctypes.data)
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1, atol=1e-12)
    found = looked(sky, drawn)
    estimate = (found[:, :3] / found[:, 3:]).mean(axis=0)
    np.testing.assert_allclose(estimate, light[:, :3].mean(axis=0) * 4 * math.pi, rtol=0.03)
    assert keep


@pytest.mark.parametrize(
    "background",
    [environment(), ir.Background((0, 0, 0), light=ir.Sky((0.2, 0.4, 0.9), (0.9, 0.9, 0.8), (0.3, 0.2, 0.1)))],
)
def test_the_even_light_is_the_projection_of_the_sky(background: ir.Background) -> None:
    """Mean, and 3 <L d> 2/3 along each axis, against a sum over the sphere."""
    sky, keep = picture.pack_sky(background)
    d = sphere(400_000)
    light = looked(sky, d)[:, :3]
    np.testing.assert_allclose(np.array(sky.ambient), light.mean(axis=0), rtol=0.02, atol=2e-3)
    linear = 2 * np.einsum("nc,na->ca", light, d) / len(d)
    np.testing.assert_allclose(np.array(sky.tilt).reshape(3, 3), linear, atol=0.03 * np.abs(linear).max())
    assert isinstance(keep, tuple)
