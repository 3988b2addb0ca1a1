"""The numbers behind the figures against the tracer, and the figures as files."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

import blobscript
from blobscript import field, ir
from blobscript.framing import pixel_rays
from blobscript.plots import explain_pixel, plot_kernel, plot_slice, svg_text
from blobscript.plots.elements import Ray, elements_of, flat, tree_along, tree_at
from blobscript.plots.kernel import kernel_curve
from blobscript.plots.ray import along
from blobscript.plots.sandwich import densities
from blobscript.plots.slice import default_plane

EXAMPLES = Path(__file__).parents[2] / "examples"
SHOWN = ("hello", "gecko", "shapes", "kernels", "bulge")


@pytest.fixture(scope="module")
def scenes() -> dict[str, blobscript.Scene]:
    return {
        name: blobscript.load(EXAMPLES / f"{name}.blob") for name in ("hello", "gecko", "shapes", "kernels", "bulge")
    }


def some_rays(scene: blobscript.Scene, count: int, seed: int) -> list[Ray]:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, scene.ir.width, count), rng.uniform(0, scene.ir.height, count)
    origins, directions = pixel_rays(scene.ir, scene.ir.width, scene.ir.height, x, y)
    return [Ray(o, d / np.linalg.norm(d)) for o, d in zip(origins, directions, strict=True)]


# ---- rays ----------------------------------------------------------------------------------------


def test_rays_of_pixels_are_those_of_pictures(scenes: dict[str, blobscript.Scene]) -> None:
    scene = scenes["gecko"]
    image = scene.render(width=40, height=30, aov=("depth",))
    ys, xs = np.mgrid[0:30, 0:40].reshape(2, -1).astype(float)
    origins, directions = pixel_rays(scene.ir, 40, 30, xs, ys)
    t = scene.first_hit(origins, directions).t.reshape(30, 40)
    seen = np.isfinite(t)  # a floor is behind the rest
    assert seen.any()
    np.testing.assert_allclose(image.aov["depth"].reshape(30, 40)[seen], t[seen], rtol=1e-6)


@pytest.mark.parametrize("name", ["hello", "gecko", "shapes", "kernels", "bulge"])
def test_the_search_for_readers_finds_what_the_tracer_finds(scenes: dict[str, blobscript.Scene], name: str) -> None:
    scene = scenes[name]
    hits = 0
    for ray in some_rays(scene, 25, seed=7):
        found = along(scene, ray.origin, ray.direction)
        assert (found.hit is None) == (found.search.t == np.inf)
        if found.hit is not None:
            hits += 1
            assert found.search.t == pytest.approx(found.hit, abs=1e-9 * (1.0 + found.hit))
    assert hits > 0


@pytest.mark.parametrize("name", ["gecko", "shapes", "kernels", "bulge"])
def test_bounds_hold(scenes: dict[str, blobscript.Scene], name: str) -> None:
    scene = scenes[name]
    looked = 0
    for ray in some_rays(scene, 30, seed=11):
        found = along(scene, ray.origin, ray.direction)
        for step in found.search.steps:
            t = np.linspace(step.a, step.b, 33)
            low, high = step.bounds(t)
            values = densities(found.tree, ray.at(t))
            slack = 1e-9 * (1.0 + np.abs(values))
            assert np.all(low <= values + slack)
            assert np.all(values <= high + slack)
            looked += 1
    assert looked > 10


def test_elements_together_are_the_field(scenes: dict[str, blobscript.Scene]) -> None:
    scene = scenes["gecko"]
    rng = np.random.default_rng(3)
    for number, surface in enumerate(scene.ir.surfaces):
        lo, hi = field.extent(surface.field)
        points = rng.uniform(lo, hi, (40, 3))
        expected = field.field_value(surface.field, points)
        for point, value in zip(points, expected, strict=True):
            got = densities(tree_at(scene.ir, number, point), point[None])[0]
            assert got == pytest.approx(value, abs=1e-12)


def test_numbers_of_elements_do_not_depend_on_the_ray(scenes: dict[str, blobscript.Scene]) -> None:
    scene = scenes["gecko"]
    every = elements_of(scene.ir, 0)
    assert [e.number for e in every] == list(range(len(every)))
    for ray in some_rays(scene, 5, seed=5):
        for element in flat(tree_along(scene.ir, 0, ray)):
            assert every[element.number].leaf is element.leaf
            assert every[element.number].index == element.index


def test_intervals_are_where_an_element_is_felt() -> None:
    scene = blobscript.compile(
        "surface { ball((0, 0, 0), reach = 1, weight = 1)\nline((1, 1, 0), (3, 1, 0)).blob(reach = 0.5, weight = 1)\n"
        "ball((5, 0, 0), reach = 1, weight = 1).scale(y = 2)\nball((5, 9, 0), reach = 1, weight = 1) }"
    )
    ray = Ray(np.array([-5.0, 0.7, 0.0]), np.array([1.0, 0.0, 0.0]))
    ends = {e.interval(ray) for e in elements_of(scene.ir, 0)}
    assert None in ends
    half, tall = np.sqrt(1.0 - 0.49), np.sqrt(1.0 - 0.35**2)
    expected = [(5 - half, 5 + half), (5.6, 8.4), (10 - tall, 10 + tall)]
    assert np.array(sorted(ends - {None})) == pytest.approx(np.array(expected))
    assert len(flat(tree_along(scene.ir, 0, ray))) == 3


# ---- why -----------------------------------------------------------------------------------------


def test_terms_add_up_to_the_threshold(scenes: dict[str, blobscript.Scene]) -> None:
    pixel = explain_pixel(scenes["gecko"], 320, 200)
    assert pixel.is_hit
    assert pixel.value == pytest.approx(0.35, abs=1e-9)
    winners = [term for term in pixel.terms if term.element is not None and term.counts]
    assert sum(term.value for term in winners) == pytest.approx(0.35, abs=1e-9)
    assert {term.element.place.line for term in winners if term.element and term.element.place} == {51}


def test_where_it_comes_nearest() -> None:
    scene = blobscript.compile("surface { ball(radius = 1, reach = 2) }\ncamera(from = (1.2, 0, 9), to = (1.2, 0, 0))")
    pixel = explain_pixel(scene, 50, 50, 101, 101)
    assert not pixel.is_hit
    assert pixel.t == pytest.approx(9.0, abs=1e-6)
    assert 0.0 < pixel.value < 0.5


def test_pixels_outside_are_refused(scenes: dict[str, blobscript.Scene]) -> None:
    with pytest.raises(ValueError, match="640x480"):
        explain_pixel(scenes["hello"], 640, 0)


def test_losers_of_a_maximum_have_no_say() -> None:
    scene = blobscript.compile(
        "surface(max { ball((0, 0, 0), radius = 1)\nball((0, 0, 0.2), radius = 1) })\ncamera(from = (0, 0, 9))"
    )
    pixel = explain_pixel(scene, 50, 50, 101, 101)
    counts = {term.element.number: term.counts for term in pixel.terms if term.element}
    assert counts == {0: False, 1: True}


# ---- kernels and slices --------------------------------------------------------------------------


def test_curves_carry_the_lectures_radius() -> None:
    curve = kernel_curve(ir.Kernel("soft3"), threshold=0.5)
    assert curve.radius == pytest.approx(np.sqrt(1 - 0.5 ** (1 / 3)))
    assert curve.slope.min() == pytest.approx(-96 / (25 * np.sqrt(5)), rel=1e-5)
    assert np.isnan(kernel_curve(ir.Kernel("soft3"), threshold=2.0).radius)


def test_the_slopes_are_those_of_the_values() -> None:
    for kernel in (ir.Kernel("wyvill"), ir.Kernel("metaball"), ir.Kernel("gauss", 4.0)):
        curve = kernel_curve(kernel, weight=-2.0)
        middle = (curve.value[2:] - curve.value[:-2]) / (curve.r[2:] - curve.r[:-2])
        np.testing.assert_allclose(curve.slope[1:-1], middle, atol=0.02)


def test_figures_are_the_same_text_each_time(scenes: dict[str, blobscript.Scene]) -> None:
    texts = [svg_text(plot_kernel([ir.Kernel("soft2"), ir.Kernel("gauss", 4.0)])) for _ in range(2)]
    assert texts[0] == texts[1]
    ET.fromstring(texts[0])
    ET.fromstring(svg_text(plot_slice(scenes["hello"])))


def test_the_slice_goes_through_the_middle(scenes: dict[str, blobscript.Scene]) -> None:
    assert default_plane(scenes["hello"]).words == "z = 0"


def test_kernels_of_one_name_are_told_apart() -> None:
    scene = blobscript.compile(
        "kernel own(r, k: int = 4) = (1 - r * r)^k\n"
        "surface { for (k in [4, 6]) { point(3 * k, 0, 0).blob(radius = 1, kernel = own(k = k)) }\n"
        " ball(radius = 1) }"
    )
    shown = [leaf.kernel for leaf in ir.leaves(scene.ir.surfaces[0].field)]
    legend = plot_kernel(shown).axes[0].get_legend()
    names = {text.get_text().partition("   ")[0] for text in legend.get_texts()}
    assert names == {"own (1)", "own (2)", "wyvill"}
