"""Textures: the function of the script, its program in NumPy, and the program in C are one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from language.compiling import run
from numpy.typing import NDArray

import blobscript
from blobscript import ir, texture
from blobscript.backends import picture
from blobscript.builtins import FUNCTIONS

Array = NDArray[np.float64]

#: Every operation and built-in, by numbers of p.
NUMBERS = [
    "p.x + p.y - 2 * p.z / 3",
    "-p.x ^ 2",
    "abs(p.x) ^ p.y",
    "sqrt(abs(p.x)) + exp(p.y) + log(1 + p.z ^ 2)",
    "sin(1rad * p.x) + cos(90deg * p.y) + tan(0.3rad * p.z)",
    "asin(clamp(p.x, -1, 1)) / 1rad + acos(clamp(p.y, -1, 1)) / 1turn + atan(p.z) / 1rad",
    "atan2(p.y, p.x) / 1rad",
    "floor(p.x * 3) + ceil(p.y * 3) + round(p.z * 3) + sign(p.x)",
    "mod(p.x, 0.3) + mod(p.y, -0.7)",
    "min(p.x, p.y, p.z) + max([p.x, 0.1])",
    "clamp(p.x, -0.2, p.y ^ 2) + lerp(p.x, p.y, p.z)",
    "dot(p, (1, 2, 3)) + length(cross(p, (0, 1, 0))) + normalize(p).y",
    "noise(3 * p) + noise(p * 7 - (0.5, 0, 2), seed = 5)",
    "rand(floor(9 * p.x)) + rand(floor(4 * p.y), seed = 3)",
    "(if (p.x < 0 and p.y >= 0 or not (p.z > 0.5)) 1 else if (p.x == p.y) 2 else 3)",
    "fold([p.x, p.y, p.z], 0, fn(a, b) = a + b^2)",
    "[1, 4, 9, 16][floor(clamp(2 + 2 * p.x, 0, 3))]",
    "max(map([1, 2, 3], fn(j) = sin(j * 1rad * p.x)))",
    "max([for (j in 1..4) noise(j * p) / j])",
    "twice(p).y + k * (q = p.x, r = 2).q",
    "layers(p, 4)",
    "f(p.x)",
]
HEAD = """
fn twice(p: vec3) -> vec3 {
  let q = p + p
  return q
}
fn layers(p: vec3, n: int) -> number = if (n == 0) 0 else noise(p) + 0.5 * layers(2 * p, n - 1)
let k = 2.5
fn scaled(by: number) -> (number) -> number = fn(x: number) = by * x
let f = scaled(k)
"""
COLORS = [
    "lerp(red, #204060, p.x ^ 2)",
    "rgb(abs(p.x), 0.2, clamp(p.y, 0, 1))",
    "hsl(360deg * p.x, 0.7, 0.5 + 0.3 * p.y)",
    "oklch(0.7, 0.1 * abs(p.x), 1turn * p.y)",
    "if (mod(floor(5 * p.x) + floor(5 * p.y), 2) == 0) white else [coral, navy][floor(clamp(p.z, 0, 1))]",
]


def compiled(color: str, more: str = "") -> ir.Scene:
    return blobscript.compile(f"{HEAD}\nsurface(material = clay({color}){more}) {{ ball(radius = 1) }}").ir


def places(n: int = 100) -> Array:
    return np.random.default_rng(0).uniform(-0.95, 0.95, (n, 3))


def in_c(t: ir.Texture, points: Array) -> Array:
    packed = picture._textures([ir.Material((1.0, 1.0, 1.0), texture=t)])
    data = picture._Picture(
        textures=packed.programs.ctypes.data,
        constants=packed.constants.ctypes.data,
        code=packed.code.ctypes.data,
        outputs=packed.outputs.ctypes.data,
    )
    out = np.empty((len(points), len(t.outputs)))
    address = picture.ctypes.addressof(data)
    picture._library().shade_evaluate(
        address, 0, len(points), np.ascontiguousarray(points).ctypes.data, out.ctypes.data
    )
    return out


@pytest.mark.parametrize("expression", NUMBERS)
def test_numbers(expression: str) -> None:
    """As a height, which has no limits: by the script's own evaluation at a few places, and by C at many."""
    whole = "0 * 1.0 + " if "round" in expression or "(if (p.x" in expression or expression.startswith("[1") else ""
    head = f"{HEAD}\nfn it(p: vec3) -> number = {whole}{expression}\n"
    material = "material(bump = fn(p) = it(p))"
    scene = blobscript.compile(f"{head}surface(material = {material}) {{ ball(radius = 1) }}").ir
    program = scene.materials[0].texture
    assert program is not None
    points = places()
    found = texture.evaluate(program, points)
    np.testing.assert_allclose(in_c(program, points), found, rtol=1e-12, atol=1e-13)
    for point, value in zip(points[:12].tolist(), found[:12, 0].tolist(), strict=True):
        at = "({!r}, {!r}, {!r})".format(*point)
        check = f'{head}let v = it({at})\nassert abs(v - ({value!r})) <= 1e-11 * (1 + abs(v)), "{{v}}"\n'
        made, diagnostics = run(check + "surface { ball(radius = 1) }")
        assert made is not None, [d.message for d in diagnostics]


@pytest.mark.parametrize("expression", COLORS)
def test_colors(expression: str) -> None:
    program = compiled(f"fn(p) = {expression}").materials[0].texture
    assert program is not None
    points = places()
    found = texture.evaluate(program, points)
    np.testing.assert_allclose(in_c(program, points), found, rtol=1e-12, atol=1e-13)
    for (x, y, z), value in zip(points[:8].tolist(), found[:8], strict=True):
        text = expression.replace("p.x", f"({x!r})").replace("p.y", f"({y!r})").replace("p.z", f"({z!r})")
        scene = blobscript.compile(f"surface(material = clay({text})) {{ ball(radius = 1) }}").ir
        np.testing.assert_allclose(scene.materials[0].color, value, rtol=1e-9, atol=1e-12)


def test_noise_and_rand_are_those_of_the_language_to_the_bit() -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(-50, 50, (200, 3))
    seeds = rng.integers(-9, 9, 200)
    expected = [FUNCTIONS["noise"](tuple(p), int(s)) for p, s in zip(points.tolist(), seeds, strict=True)]
    assert texture.noise(*points.T, seeds.astype(float)).tolist() == expected
    whole = rng.integers(-1000, 1000, 200)
    drawn = [FUNCTIONS["rand"](int(i), int(s)) for i, s in zip(whole, seeds, strict=True)]
    assert texture.rand(whole.astype(float), seeds.astype(float)).tolist() == drawn


def test_what_is_known_costs_nothing() -> None:
    program = compiled("fn(p) = if (k > 2) lerp(red, blue, 0.5 + 0 * k) else rgb(p.x, 0, 0)").materials[0].texture
    assert program is not None
    assert program.code == ()


def test_no_number_is_black_and_nothing_is_brighter_than_white() -> None:
    program = compiled("fn(p) = rgb(sqrt(p.x), 5 * p.y, 1)").materials[0].texture
    assert program is not None
    points = places()
    found = in_c(program, points)
    assert (found[points[:, 0] < 0, 0] == 0).all()
    assert found.max() == 1
    assert found.min() == 0


@pytest.mark.parametrize(
    ("expression", "reason"),
    [
        ('rgb(len("{p.x}") / 9, 0, 0)', "texts"),
        ("rgb(len([for (i in 0..floor(p.x)) i]) / 9, 0, 0)", "range"),
        ("rgb(deep(p.x), 0, 0)", "never end"),
        ("rgb(fold([for (j in 1..900) j], 0, fn(a, j) = a + noise(j * p) * noise(p / j) + j * p.x), 0, 0)", "4096"),
        ("if (inside(s, p)) red else blue", "inside"),
    ],
)
def test_what_cannot_be_followed_is_told(expression: str, reason: str) -> None:
    text = "fn deep(x: number) -> number = if (x > 0) deep(x / 2) else x\nlet s = surface { ball(radius = 1) }\n"
    scene, found = run(f"{text}surface(material = clay(fn(p) = {expression})) {{ ball(radius = 1) }}\ns")
    assert scene is None
    assert [d.code for d in found] == ["E0407"]
    assert reason in found[0].message


# ---- in pictures ------------------------------------------------------------------------


def test_a_texture_is_seen_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """The albedo layer at every hit is the program at the hit; on painted sums, mixed by contribution."""
    scene = blobscript.compile(
        "surface(material = clay(fn(p) = lerp(red, blue, 0.5 + 0.5 * noise(3 * p)))) {\n"
        "ball((-0.5, 0, 0), radius = 0.7)\n"
        "ball((0.6, 0, 0), radius = 0.6).paint(clay(fn(p) = if (p.y > 0) white else black))\n"
        "ball((0, 0.7, 0), radius = 0.4).paint(lime)\n}"
    )
    image = scene.render(80, 60, aov=("position", "albedo", "surface"))
    on = image.aov["surface"] == 0
    points = image.aov["position"][on].astype(np.float64)
    programs = [m.texture for m in scene.ir.materials]
    assert [p is not None for p in programs] == [True, True, False]
    marks = np.eye(3, 15)
    share = scene._native.paint(points, np.zeros(len(points), np.int32), marks)[:, :3]
    expected = share[:, 2:] * np.array(scene.ir.materials[2].color)
    for k in (0, 1):
        program = programs[k]
        assert program is not None
        expected = expected + share[:, k : k + 1] * texture.evaluate(program, points)
    edge = np.abs(points[:, 1]) < 1e-4
    np.testing.assert_allclose(image.aov["albedo"][on][~edge], expected[~edge], atol=2e-4)


def test_a_texture_moves_with_its_surface() -> None:
    look = "clay(fn(p) = if (p.x > 0) white else black)"
    turned = blobscript.compile(
        f"surface(material = {look}) {{ ball(radius = 1) }}.rotate(z = 90deg).move(x = 3)\n"
        "camera((3, 0, 9), to = (3, 0, 0))"
    )
    image = turned.render(40, 40, aov=("albedo", "position", "surface"))
    on = image.aov["surface"] == 0
    high = image.aov["position"][on][:, 1] > 0
    assert np.array_equal(image.aov["albedo"][on][:, 0] > 0.5, high)


@pytest.mark.parametrize(
    ("part", "axis"),
    [
        ("ball(radius = 1).paint(LOOK).rotate(z = 90deg).move(x = 3)", "x"),
        ("ball(radius = 1).paint(LOOK).rotate(z = 45deg).rotate(z = 45deg).move(x = 3).scale(1)", "x"),
        ("sum { ball(radius = 1) }.paint(LOOK).move(x = 2).rotate(z = 90deg).move(x = 3, y = -2)", "x"),
        ("sum { balls([(0, 0, 0), (0.5, 0, 0)], radius = 1) }.paint(LOOK).rotate(z = 90deg).move(x = 3)", "x"),
        ("ball((0, -3, 0), radius = 1).rotate(z = 90deg).paint(LOOK)", "y"),
    ],
)
def test_a_texture_moves_with_the_part_that_is_painted(part: str, axis: str) -> None:
    """What happens to a field after it was painted happens to the texture, too; what happened before does not."""
    part = part.replace("LOOK", f"material(fn(p) = if (p.{axis} > 0) white else black)")
    scene = blobscript.compile(f"surface {{ {part} }}\ncamera((3, 0, 9), to = (3, 0, 0))")
    image = scene.render(40, 40, aov=("albedo", "position", "surface"))
    on = image.aov["surface"] == 0
    high = image.aov["position"][on][:, 1] > 0
    assert on.any()
    assert np.array_equal(image.aov["albedo"][on][:, 0] > 0.5, high)


def test_one_textured_part_used_twice_has_two_textures_and_colors_none() -> None:
    """Each use has its own place; the same use keeps one material."""
    look = "material(fn(p) = if (p.x > 0) white else black)"
    scene = blobscript.compile(
        f"let part = sum {{ for (i in 0..<5) {{ ball((0, 0.2 * i, 0), radius = 0.5) }} }}.paint({look})\n"
        "surface { part\n part.move(x = 3)\n ball((9, 0, 0), radius = 1).paint(red).move(x = 1) }"
    )
    textures = [m.texture for m in scene.ir.materials if m.texture is not None]
    assert len(textures) == 2
    assert {t.matrix for t in textures} == {None, (1.0, 0.0, 0.0, -3.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)}


def test_a_bump_turns_the_normal_by_its_slope() -> None:
    """A ball with the height 0.3 x where it faces the camera: the normal leans by atan(0.3), the light says so."""
    camera = "camera((0, 0, 400), fov = 0.05deg)\nsun((0, 0, -1), strength = 2)\nbackground(black)\n"
    light = {}
    for name, height in (("flat", "0 * p.x"), ("bumpy", "0.3 * p.x")):
        look = f"material(#808080, roughness = 0, specular = 0, bump = fn(p) = {height})"
        scene = blobscript.compile(f"{camera}surface(material = {look}) {{ ball(radius = 1) }}")
        light[name] = float(scene.render(9, 9).rgba[4, 4, 0])
    assert light["bumpy"] / light["flat"] == pytest.approx(math.cos(math.atan(0.3)), rel=2e-3)
