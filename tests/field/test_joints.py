"""The smooth maximum: never above the maximum, equal to it where one or all are, smooth where the densities are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from random_scenes import make_leaf

import blobscript
from blobscript import field as reference
from blobscript.ir import Kernel, Lines, Node
from blobscript.joints import SHARPNESS, STEEPER, smooth_max, smooth_max_range

RNG = np.random.default_rng(11)
WYVILL = Kernel("wyvill")


def values(count: int, n: int = 4000) -> np.ndarray:
    """Densities of both signs and of all sizes, many of them 0 or nearly equal."""
    rough = RNG.normal(size=(count, n)) * 10.0 ** RNG.uniform(-3, 3, n)
    near = np.abs(RNG.normal(size=n)) * (1.0 + RNG.normal(size=(count, n)) * 1e-2)
    return np.where(RNG.random(n) < 0.5, rough, near) * (RNG.random((count, n)) < 0.8)


@pytest.mark.parametrize("count", [1, 2, 3, 17])
def test_it_is_a_mean_below_the_largest(count: int):
    f = values(count)
    joint = smooth_max(f)
    top = np.maximum(f, 0.0).max(axis=0)
    assert (joint.value <= top).all()
    assert (joint.value >= 0.0).all()
    assert np.allclose(joint.shares.sum(axis=0), top > 0.0)
    if count == 2:  # what the rounding of the crease takes away
        assert (joint.value >= top * (1.0 - 0.278 / SHARPNESS - 1e-12)).all()


def test_one_alone_and_equal_ones_are_what_they_are():
    f = np.abs(RNG.normal(size=100))
    nothing = np.zeros(100)
    assert np.allclose(smooth_max(np.stack([f, nothing, -f])).value, f, rtol=1e-15)
    assert np.allclose(smooth_max(np.stack([f, f, f])).value, f, rtol=1e-15)


def test_any_size_of_density():
    for size in (1e-300, 1e-60, 1.0, 1e60, 1e300):
        f = size * np.array([[1.0], [0.9], [1e-3]])
        assert np.allclose(smooth_max(f).value / size, smooth_max(f / size).value, rtol=1e-14)


@pytest.mark.parametrize("count", [2, 3, 17])
def test_rates_are_derivatives_and_bounded(count: int):
    f = np.abs(RNG.normal(size=(count, 2000))) + 0.05
    joint = smooth_max(f)
    for i in range(count):
        step = np.zeros_like(f)
        step[i] = 1e-6
        difference = (smooth_max(f + step).value - smooth_max(f - step).value) / 2e-6
        assert np.allclose(joint.rates[i], difference, atol=1e-6)
    rates = smooth_max(values(count, 40000)).rates
    assert rates.max() <= STEEPER
    assert rates.min() >= -(((SHARPNESS - 1) / SHARPNESS) ** (SHARPNESS - 1)) - 1e-12
    assert np.allclose((joint.rates * f).sum(axis=0), joint.value)  # homogeneous


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("width", [1e-9, 1e-3, 0.3, 2.0])
def test_range_holds_every_value(count: int, width: float):
    low = values(count)
    high = low + width * np.abs(RNG.normal(size=low.shape)) * np.abs(low).max(axis=0)
    least, most = smooth_max_range(low, high)
    for _ in range(20):
        f = low + (high - low) * RNG.choice([0.0, 1.0, 0.5, RNG.random()], size=low.shape)
        value = smooth_max(np.clip(f, low, high)).value
        assert (least <= value).all()
        assert (value <= most).all()
    if width < 1e-6:
        assert (most - least <= 200 * count * width * np.abs(high).max(axis=0)).all()


# ---- joints of rods --------------------------------------------------------------------------------------


def rods(*directions: tuple[float, float, float]) -> tuple[Node, Node, Node]:
    """Sum, max and smooth_max of rods from the origin, 3 long, of radius 0.5 at the threshold 0.5."""
    parts = tuple(
        make_leaf(Lines(np.zeros((1, 3)), 3.0 * np.array([d])), WYVILL, 1.0, 1.0)  # D(1/2) = 1/2
        for d in directions
    )
    return Node("sum", parts), Node("max", parts), Node("smooth_max", parts)


STRAIGHT = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
BEND = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
BRANCH = ((1.0, 0.0, 0.0), (-0.5, 0.75**0.5, 0.0), (-0.5, -(0.75**0.5), 0.0))
ALL = pytest.mark.parametrize("directions", [STRAIGHT, BEND, BRANCH], ids=["straight", "bend", "branch"])


@ALL
def test_nothing_swells(directions):
    """Half the thickness across the plane of the rods, anywhere near the joint."""
    total, largest, smooth = rods(*directions)
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 81), np.linspace(-1, 1, 81)))
    above = np.column_stack([u, v, np.full(u.shape, 0.5 + 1e-9)])
    assert (reference.field_value(total, above) > 0.5).any()
    assert not (reference.field_value(largest, above) > 0.5).any()
    assert not (reference.field_value(smooth, above) > 0.5).any()
    thin = np.array([[x * d[0], x * d[1], 0.475] for d in directions for x in np.linspace(0.0, 1.0, 50)])
    assert (reference.field_value(smooth, thin) > 0.5).all()  # and shrinks by less than 5 %


@ALL
def test_there_is_no_crease(directions):
    """From one rod's side to the other's the gradient of the maximum jumps, that of the smooth one does not."""
    _, largest, smooth = rods(*directions)
    u = RNG.uniform(-0.6, 0.6, (4000, 3))
    step = 1e-6 * RNG.normal(size=u.shape)
    if directions is not STRAIGHT:  # there the densities of both touch without a crease
        a, b = np.array(directions[0]), np.array(directions[1])
        u -= np.outer(u @ (a - b), a - b) / ((a - b) @ (a - b))  # onto the plane between two rods
        jump = np.linalg.norm(reference.gradient(largest, u + step) - reference.gradient(largest, u - step), axis=1)
        assert jump.max() > 1.0
    jump = np.linalg.norm(reference.gradient(smooth, u + step) - reference.gradient(smooth, u - step), axis=1)
    away = np.linalg.norm(u, axis=1) > 0.1
    assert (jump[away] < 1e-3).all()


def test_a_negative_factor_mirrors_it():
    script = "let f = smooth_max { ball((-0.4, 0, 0), reach = 1)\n ball((0.4, 0, 0), reach = 1) }\n"
    above = blobscript.compile(script + "surface(f)")
    below = blobscript.compile(script + "surface(threshold = -0.5) { -f }")
    p = RNG.uniform(-1.5, 1.5, (200, 3))
    assert np.allclose(above.field(p), -below.field(p), rtol=1e-14)


def test_the_tracer_has_the_same_exponent():
    header = Path(blobscript.__file__).parent / "tracer" / "joint.h"
    assert f"enum {{ SHARPNESS = {SHARPNESS} }};" in header.read_text(encoding="utf-8")
