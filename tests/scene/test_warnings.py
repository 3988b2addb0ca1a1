"""Warnings: each where it must be said, and nothing on scenes that are fine."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from language.compiling import run

from blobscript import enclosure, values
from blobscript import field as reference
from blobscript.source import Span


def surface(make, *children, **arguments):
    return make.surface(children=list(children), **arguments)


def found(make, *placed, **more):
    scene, diagnostics = make.scene(*placed, **more)
    assert scene is not None
    return diagnostics


# ---- W0401 ---------------------------------------------------------------------------


def two_balls(make, distance):
    balls = [make.ball(at=(x, 0, 0), reach=1, weight=0.7) for x in (-distance / 2, distance / 2)]
    return surface(make, *balls, threshold=1.2)


def test_unreachable_threshold(make):
    (warning,) = found(make, two_balls(make, 1.8))
    assert warning.code == "W0401"
    assert [label.text for label in warning.labels] == ["at most 0.7", "at most 0.7; they barely overlap"]
    assert "the highest field value is 0.7" in warning.notes[0]
    assert "below 0.7" in warning.helps[0].text


def test_reachable_threshold(make):
    assert found(make, two_balls(make, 0.3)) == []


@pytest.mark.parametrize("factor, codes", [(1.02, ["W0401"]), (0.98, [])])
def test_nearly_reachable_threshold(make, factor, codes):
    """The highest value lies between the centres, where nobody looks first."""
    balls = [make.ball(at=(x, 0, 0), reach=1, weight=0.7) for x in (-0.3, 0.3)]
    highest = reference.field_value(make.field(*balls), np.linspace((-1, 0, 0), (1, 0, 0), 2001)).max()
    assert [d.code for d in found(make, surface(make, *balls, threshold=factor * highest))] == codes


def test_empty_surface(make):
    for empty in (surface(make), surface(make, make.max(children=[])), surface(make, make.balls(at=[], radius=1))):
        assert [d.code for d in found(make, empty)] == ["W0401"]


def test_only_negative_weights(make):
    (warning,) = found(make, surface(make, make.ball(reach=1, weight=-1)))
    assert warning.code == "W0401"
    assert "the highest field value is 0 " in warning.notes[0]
    assert [label.text for label in warning.labels] == ["only takes away"]
    assert warning.helps[0].text == "give it blobs with positive weights"


def test_all_taken_away(make):
    (warning,) = found(make, surface(make, make.ball(radius=1), make.ball(reach=4, weight=-5)))
    assert warning.code == "W0401"
    assert [label.text for label in warning.labels] == ["at most 1", "only takes away"]
    assert warning.helps[0].text == "weaken or move what takes away"


@pytest.mark.parametrize("seed", range(60))
def test_empty_is_never_said_of_what_can_be_seen(make, seed):
    """Random sums near their threshold: a point inside refutes the warning."""
    rng = random.Random(seed)
    balls = [
        make.ball(
            at=tuple(rng.uniform(-1, 1) for _ in range(3)), reach=rng.uniform(0.5, 1.5), weight=rng.uniform(-1, 1)
        )
        for _ in range(6)
    ]
    tree = make.field(*balls)
    points = np.random.default_rng(seed).uniform(-2, 2, (5000, 3))
    highest = reference.field_value(tree, points).max()
    threshold = max(highest, 1e-6) * rng.choice([0.9, 0.999, 1.3])
    codes = [d.code for d in found(make, surface(make, *balls, threshold=threshold))]
    if threshold <= highest:
        assert "W0401" not in codes


# ---- W0402 ---------------------------------------------------------------------------


def test_never_placed(make):
    span = Span(make.source, 0, 1)
    ball = surface(make, make.ball(radius=1))
    (warning,) = found(make, ball, unplaced=[("rock", "surface", span), ("_spare", "surface", span)])
    assert warning.code == "W0402"
    assert warning.message == "surface `rock` is defined but not in the scene"
    assert warning.span == span


# ---- W0403, W0404 --------------------------------------------------------------------


@pytest.mark.parametrize("to, codes", [((0, 0, 0), []), ((0, 0, 20), ["W0403"]), ((20, 0, 9), ["W0403"])])
def test_outside_the_view(make, to, codes):
    camera = make.camera(**{"from": (0, 0, 10), "to": to})
    assert [d.code for d in found(make, surface(make, make.ball(radius=1)), camera)] == codes


def test_a_corner_in_the_picture_is_enough(make):
    camera = make.camera(**{"from": (4.4, 0, 10), "to": (4.4, 0, 0)})
    assert found(make, surface(make, make.ball(radius=1)), camera) == []


@pytest.mark.parametrize("past, codes", [(6.0, ["W0403"]), (5.2, ["W0403"]), (3.2, []), (0.0, [])])
def test_past_a_long_creature(past, codes):
    """The box around it is in the view, and of all its parts none is."""
    _, diagnostics = run(f"""
    surface {{ for (i in -10..10) {{ ball((i, i, 0), radius = 0.8) }} }}
    camera((6, -6, 12), to = ({past}, {-past}, 0), fov = 30deg)
    """)
    assert [d.code for d in diagnostics] == codes


def test_each_surface_is_told(make):
    camera = make.camera(**{"from": (0, 0, 10)})
    egg, far = (surface(make, make.ball(at=(x, 0, 0), radius=1)) for x in (0, 100))
    (warning,) = found(make, (egg, "egg", None), (far, "far", None), camera)
    assert "far" in warning.message
    assert "(100, 0, 0)" in warning.helps[0].text


def test_camera_inside(make):
    camera = make.camera(**{"from": (0.5, 0, 0)})
    warning = found(make, surface(make, make.ball(radius=1)), camera)[-1]
    assert warning.code == "W0404"
    assert warning.span == camera.span


# ---- W0405, W0406 --------------------------------------------------------------------


def test_hidden_by_a_negative_weight(make):
    seen = make.ball(at=(5, 0, 0), radius=1)
    hidden = make.ball(radius=0.5)
    cut = make.ball(reach=2, weight=-5)
    (warning,) = found(make, surface(make, seen, hidden, cut))
    assert warning.code == "W0405"
    assert warning.span.line == 2
    assert [label.span.line for label in warning.labels] == [3]


def test_partly_hidden_is_fine(make):
    hidden = make.ball(radius=1)
    cut = make.ball(at=(0.5, 0, 0), reach=1, weight=-1)
    assert found(make, surface(make, hidden, cut)) == []


def test_negative_weight_in_empty_space(make):
    ball = make.ball(radius=1)
    idle = make.ball(at=(9, 0, 0), reach=1, weight=-1)
    (warning,) = found(make, surface(make, ball, idle))
    assert warning.code == "W0406"
    assert warning.span.line == 2


def test_weak_blob_in_empty_space(make):
    ball = make.ball(radius=1)
    weak = make.ball(at=(9, 0, 0), reach=1, weight=0.1)
    (warning,) = found(make, surface(make, ball, weak))
    assert warning.code == "W0406"
    assert "at most 0.1" in warning.label


def test_weak_blob_that_swells_another(make):
    assert found(make, surface(make, make.ball(radius=1), make.ball(at=(1.2, 0, 0), reach=1, weight=0.1))) == []


def test_some_of_many(make):
    at = [(k, 0, 0) for k in range(5)] + [(50, 0, 0)]
    (warning,) = found(make, surface(make, make.balls(at=at, reach=1, weight=[0.6] * 5 + [0.2])))
    assert warning.code == "W0406"
    assert "1 of the 6 blobs made here" in warning.message


def test_cutting_by_min_is_an_effect(make):
    lens = make.min(children=[make.ball(at=(-0.5, 0, 0), radius=1), make.ball(at=(0.5, 0, 0), radius=1)])
    assert found(make, surface(make, lens)) == []


def test_zero_weights_and_factors(make):
    zero = make.ball(reach=1, weight=0)
    nothing = values.scale_field(make.ball(radius=1), 0)
    warned = found(make, surface(make, make.ball(radius=1), zero, nothing))
    assert [d.code for d in warned] == ["W0406", "W0406"]
    assert [d.span.line for d in warned] == [1, 2]


def test_what_a_loop_repeats_is_said_once(make):
    zero = make.ball(reach=1, weight=0)
    placed = [surface(make, make.ball(at=(x, 0, 0), radius=1), zero) for x in range(4)]
    assert [d.code for d in found(make, *placed)] == ["W0406"]


# ---- W0407 ---------------------------------------------------------------------------


@pytest.mark.parametrize("threshold", [0, -0.5])
def test_threshold_not_positive(make, threshold):
    assert [d.code for d in found(make, surface(make, make.ball(reach=1, weight=-1), threshold=threshold))] == ["W0407"]


# ---- proofs ----------------------------------------------------------------------------


def test_the_highest_value_is_a_bound_and_close(make):
    balls = [make.ball(at=(x, 0, 0), reach=1, weight=0.7) for x in (-0.3, 0.4)]
    tree = make.field(*balls)
    seen = reference.field_value(tree, np.linspace((-1, 0, 0), (1, 0, 0), 2001)).max()
    top, found_seen = enclosure.highest(tree, reference.extent(tree))
    assert found_seen <= seen * (1 + 1e-9)
    assert seen <= top <= 1.03 * seen


@pytest.mark.parametrize("seed", range(10))
def test_boxes_hold_the_surface(make, seed):
    rng = random.Random(seed)
    blobs = [
        make.rotate(it=make.scale(it=make.ball(at=(rng.uniform(-2, 2), 0, 1), radius=0.4), y=2), x=rng.random())
        for _ in range(8)
    ]
    scene = make.good(surface(make, *blobs))
    lo, hi = enclosure.surface_box(scene.surfaces[0], precision=1 / 32, effort=20)
    points = np.random.default_rng(seed).uniform(lo - 0.3, hi + 0.3, (20_000, 3))
    inside = points[reference.field_value(scene.surfaces[0].field, points) >= 0.5]
    assert len(inside)
    assert (inside >= lo).all()
    assert (inside <= hi).all()
    # each side at most 1/32 of the largest too far out; samples miss the tips
    assert np.ptp(inside, axis=0) == pytest.approx(hi - lo, abs=2 / 32 * (hi - lo).max() + 0.2)


def test_a_scene_with_many_blobs_is_quick_to_check(make):
    """Sixty blobs of all kinds; the limit is several times what it takes."""
    import time

    blobs = [
        make.ball(at=(math.cos(k), math.sin(k), k / 10), radius=0.3)
        if k % 3
        else make.blob(skeleton=make.line(a=(k / 9, 0, 0), b=(0, k / 9, 0)), reach=1, weight=-0.1)
        for k in range(60)
    ]
    placed = surface(make, *blobs)
    make.scene(placed)
    start = time.process_time()
    make.scene(placed)
    assert time.process_time() - start < 0.25
