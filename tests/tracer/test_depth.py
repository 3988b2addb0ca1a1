"""Trees of nodes as deep as a script makes them, from text to hit, against the same recurrence in NumPy."""

from __future__ import annotations

import sys
import threading
from functools import lru_cache

import numpy as np
import pytest

import blobscript
from blobscript import deep

#: Every level takes what is there and a ball into a sum, a maximum or a minimum; every fourth node has a negative
#: factor twice.
SCRIPT = """
kernel shoulder(r) = (1 - r^2)^3 * (1 + 3 * r^2)
fn place(i: int) = (0.9 * cos(7rad * i), 0.9 * sin(7rad * i), 0.3 * cos(3rad * i))
fn level(below: field, i: int) -> field {
  let ball = ball(place(i), reach = 0.5, weight = if (mod(i, 5) == 0) -0.4 else 0.7, kernel = shoulder)
  return if (mod(i, 4) == 0) max([below, ball])
    else if (mod(i, 4) == 1) below + ball
    else if (mod(i, 4) == 2) -min([-below, 0.5 * ball])
    else sum([-0.9 * (-1 * below), ball])
}
surface(threshold = 0.4, fold([for (i in 0..<LEVELS) i], ball(reach = 0.7, kernel = soft2), with = level))
"""


def density(at: np.ndarray, points: np.ndarray, reach: float, power: int) -> np.ndarray:
    s = np.minimum(((points - at) ** 2).sum(axis=1) / reach**2, 1.0)
    return (1 - s) ** power * (1 + power * s if power == 3 else 1)


def field(levels: int, points: np.ndarray) -> np.ndarray:
    value = density(np.zeros(3), points, 0.7, 2)
    for i in range(levels):
        at = np.array([0.9 * np.cos(7 * i), 0.9 * np.sin(7 * i), 0.3 * np.cos(3 * i)])
        ball = (-0.4 if i % 5 == 0 else 0.7) * density(at, points, 0.5, 3)
        match i % 4:
            case 0:
                value = np.maximum(value, ball)
            case 1:
                value = value + ball
            case 2:
                value = -np.minimum(-value, 0.5 * ball)
            case _:
                value = 0.9 * value + ball
    return value


@lru_cache
def compiled(levels: int) -> blobscript.Scene:
    return blobscript.compile(SCRIPT.replace("LEVELS", str(levels)))


@pytest.mark.parametrize("levels", [60, 250, 2500])
def test_any_depth(levels: int):
    scene = compiled(levels)
    rng = np.random.default_rng(levels)
    points = rng.uniform(-1.3, 1.3, (400, 3)) * (1, 1, 0.5)
    expected = field(levels, points)
    np.testing.assert_allclose(scene.field(points), expected, rtol=0, atol=1e-12 * (1 + np.abs(expected).max()))
    origins = rng.uniform(-1.2, 1.2, (48, 3)) * (1, 1, 0) + (0, 0, 2)
    hits = scene.first_hit(origins, [[0.0, 0.0, -1.0]])
    assert hits.hit.sum() > 10
    t = np.linspace(0.0, 4.0, 60)
    places = origins[:, None] - t[None, :, None] * np.array([0.0, 0.0, 1.0])
    inside = field(levels, places.reshape(-1, 3)).reshape(48, -1) > 0.4 + 1e-9
    assert not (inside & (t[None] < np.where(hits.hit, hits.t, np.inf)[:, None])).any()
    on = field(levels, hits.position[hits.hit])
    np.testing.assert_allclose(on, 0.4, rtol=0, atol=1e-9)


def test_the_passes_go_as_deep():
    """Not only hits: whatever walks through the tree."""
    scene = compiled(2500)
    assert len(scene.hash) == 32
    assert {"max", "negative-weights"} <= scene.needs
    assert scene.to_json().count('"kind": "max"') > 300
    assert scene.render(width=16, height=12).rgba.shape == (12, 16, 4)
    assert "blob_scene" in scene.to_c()
    assert len(scene.mesh(resolution=8, refine=0).faces) > 50


def test_deeper_than_allowed_is_told():
    with pytest.raises(blobscript.ProgramError) as caught:
        compiled(12000)
    (error,) = caught.value.diagnostics
    assert (error.code, error.message) == ("E0901", "fields nest deeper than 10000 levels of sum, max and min")


def test_the_limit_of_recursion_is_that_of_the_last_to_leave():
    """Two threads deep in recursion: the first to end does not take the second's room away."""
    before = sys.getrecursionlimit()
    inner, outer = threading.Event(), threading.Event()

    def second() -> None:
        deep.deeply(lambda: (inner.set(), outer.wait(10)))

    thread = threading.Thread(target=second)
    thread.start()
    assert inner.wait(10)
    deep.deeply(lambda: None)
    assert sys.getrecursionlimit() > 100_000
    outer.set()
    thread.join()
    assert sys.getrecursionlimit() == before
