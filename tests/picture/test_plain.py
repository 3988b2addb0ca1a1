"""Pictures that need no recursion (tracer/plain.c) are those that shade.c makes, pixel for pixel."""

import importlib
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import blobscript
from blobscript import Scene, ir

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


def slowly(scene: Scene) -> Scene:
    return Scene(replace(scene.ir, materials=(*scene.ir.materials, GLASS)))


@pytest.mark.parametrize("more", ["", "background(#204060)\n", "sky(zenith = #406080, horizon = #ffeedd)\n"])
@pytest.mark.parametrize("samples", [1, 5])
def test_plain_is_as_general(more: str, samples: int) -> None:
    scene = compiled(more)
    options = {
        "width": 70,
        "height": 45,
        "samples": samples,
        "indirect": "even",
        "aov": ("direct", "indirect", "samples"),
    }
    fast, slow = scene.render(**options), slowly(scene).render(**options)
    np.testing.assert_allclose(fast.rgba, slow.rgba, rtol=2e-6, atol=1e-7)
    for layer in ("direct", "indirect", "samples"):
        np.testing.assert_allclose(fast.aov[layer], slow.aov[layer], rtol=2e-6, atol=1e-7)
    assert fast.rgba[..., :3].std() > 0.05


def test_plain_from_inside() -> None:
    scene = compiled("camera(from = (-0.6, 0, 0.1), to = (1, 0.2, 0))\n")
    fast, slow = (s.render(40, 30, indirect="even") for s in (scene, slowly(scene)))
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
