"""Pictures that need no recursion (tracer/plain.c) are those that shade.c makes, pixel for pixel."""

import importlib
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import blobscript
from blobscript import Scene, ir
from blobscript.backends import picture
from blobscript.images import Image

SCENE = """
surface(material = plastic(coral)) {
  ball((-0.6, 0, 0), radius = 0.8)
  ball((0.6, 0.2, 0.1), radius = 0.7).paint(clay(#3a6ea5))
  line((0, -0.5, 0), (0, 0.9, 0.4)).blob(radius = 0.3)
}
surface(material = material(#408040, roughness = 0.9, emission = #101020)) { ball((0.2, 0.4, 1.2), radius = 0.3) }
sun(toward = (-0.5, -1, -0.4), strength = 2)
lamp(at = (2, 3, 4), color = #ffe0c0, strength = 20)
"""

#: Not seen anywhere; where some material transmits light, shadows are looked through, which plain.c cannot.
GLASS = ir.Material((1.0, 1.0, 1.0), transmission=1.0)
BENCH = Path(__file__).parent.parent / "bench"


@pytest.fixture
def bench_shading(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCH))
    return importlib.import_module("bench_shading")


def compiled(more: str = "") -> Scene:
    return blobscript.compile(SCENE + more)


def slowly(scene: Scene, width: int, height: int, **options: Any) -> Image:
    """By shade.c, as the tracer is handed a material that nothing wears."""
    return picture.render(
        replace(scene.ir, materials=(*scene.ir.materials, GLASS)), width=width, height=height, **options
    )


@pytest.mark.parametrize("more", ["", "background(#204060)\n", "sky(zenith = #406080, horizon = #ffeedd)\n"])
@pytest.mark.parametrize("samples", [1, 5])
def test_plain_is_as_general(more: str, samples: int) -> None:
    scene = compiled(more)
    options: dict[str, Any] = {
        "width": 70,
        "height": 45,
        "samples": samples,
        "indirect": "even",
        "aov": ("direct", "indirect", "samples"),
    }
    fast, slow = scene.render(**options), slowly(scene, **options)
    np.testing.assert_allclose(fast.rgba, slow.rgba, rtol=2e-6, atol=1e-7)
    for layer in ("direct", "indirect", "samples"):
        np.testing.assert_allclose(fast.aov[layer], slow.aov[layer], rtol=2e-6, atol=1e-7)
    assert fast.rgba[..., :3].std() > 0.05


def crowded(kind: str) -> Scene:
    """300 blobs, some of which take away, under a sun and two lamps, one of them in their midst."""
    at = np.random.default_rng(3).random((300, 3)) - 0.5
    b = at + 0.1 * np.random.default_rng(4).normal(size=at.shape)
    skeleton = ir.Lines(at, b) if kind == "lines" else ir.Points(at)
    weight = np.where(np.arange(300) % 5 == 0, -0.8, 1.0) if kind == "holes" else np.ones(300)
    kernel = ir.Kernel("gauss", a=2.0) if kind == "gauss" else ir.Kernel("wyvill" if kind == "wyvill" else "soft2")
    ints = np.zeros(300, np.int32)
    leaf = ir.Leaf(skeleton, kernel, np.full(300, 0.18), weight, ints - 1, ints)
    surface = ir.Surface("crowd", leaf, 0.6, 0, None)
    lights = (
        ir.Sun((-0.5, -0.8, -0.6), (2.0, 2.0, 2.0), 0.0),
        ir.Lamp((2.0, 3.0, 2.5), (20.0, 18.0, 15.0)),
        ir.Lamp((0.0, 0.0, 0.05), (1.0, 1.0, 1.0)),
    )
    camera = ir.Camera((0.4, 0.3, 2.2), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.6)
    scene = ir.Scene((surface,), (ir.Material((0.8, 0.7, 0.6)),), camera, lights, ir.Background((0.1, 0.1, 0.1)))
    return Scene(scene)


@pytest.mark.parametrize("kind", ["points", "lines", "holes", "gauss", "wyvill"])
def test_plain_casts_the_same_shadows(kind: str) -> None:
    """Shadow rays of plain pictures start where the search found the hits, and hits are guessed from neighbours."""
    scene = crowded(kind)
    fast, slow = scene.render(96, 72), slowly(scene, 96, 72)
    np.testing.assert_allclose(fast.rgba, slow.rgba, rtol=2e-6, atol=1e-7)
    assert (fast.rgba[..., :3].max(axis=2) > 0.3).mean() > 0.05  # lit


def test_plain_from_inside() -> None:
    scene = compiled("camera(from = (-0.6, 0, 0.1), to = (1, 0.2, 0))\n")
    fast, slow = scene.render(40, 30, indirect="even"), slowly(scene, 40, 30, indirect="even")
    np.testing.assert_allclose(fast.rgba, slow.rgba, rtol=2e-6, atol=1e-7)


@pytest.mark.parametrize("isa", ["baseline", "x86-64-v3"])
def test_plain_on_other_processors(isa: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = compiled()
    here = scene.render(48, 32, samples=4, indirect="even").rgba
    monkeypatch.setenv("BLOBSCRIPT_ISA", isa)
    np.testing.assert_allclose(scene.render(48, 32, samples=4, indirect="even").rgba, here, rtol=1e-6, atol=1e-7)


def test_parts_and_threads_of_plain_pictures() -> None:
    scene = compiled()
    whole = scene.render(70, 45, samples=3, indirect="even", threads=1).rgba
    assert np.array_equal(scene.render(70, 45, samples=3, indirect="even", threads=3).rgba, whole)
    part = scene.render(70, 45, samples=3, indirect="even", region=(13, 7, 50, 40)).rgba
    assert np.array_equal(part, whole[7:40, 13:50])


def test_shading_costs_no_more_than_hits(bench_shading: ModuleType) -> None:
    """A seeded share of tests/bench/bench_shading.py: one light with shadows, 9 samples per pixel. It is about a
    fifth; the least of three is what the machine's other work has disturbed least."""
    scene = bench_shading.lit(100)
    pictures = [scene.render(160, 120, 9, indirect="even", threads=1) for _ in range(3)]
    assert min(p.timing["shading"] / p.timing["hits"] for p in pictures) < 1
    light = pictures[0].rgba[..., :3]
    assert light.max() > 0.3 and (light == 0).mean() > 0.1  # lit, and with shadows


def test_pov_ray_gets_the_same_scene(bench_shading: ModuleType, tmp_path: Path) -> None:
    import bench_points

    file = tmp_path / "scene.pov"
    file.write_text(bench_shading.pov_text(bench_shading.lit(10)), encoding="ascii")
    assert bench_points.pov_seconds(file, (48, 36)) >= 0
