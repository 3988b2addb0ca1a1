"""The certified oracle and the reference evaluator against the stress catalogue and each other."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import oracle
import pytest
import stress_data
from random_scenes import grazing_rays, make_leaf, make_scene, random_rays, random_scene

from blobscript import field as reference
from blobscript.ir import Kernel, Lines, Points

CASES = [case for case in stress_data.cases() if case.scene is not None]


def rays(case: stress_data.Case):
    """(index, expectation) of the rays that are rays at all."""
    return [(i, e) for i, e in enumerate(case.expectations) if e["status"] != "invalid"]


def answers(case: stress_data.Case) -> SimpleNamespace:
    """The certified answers in the form of a tracer's."""
    count = len(case.names)
    hits = SimpleNamespace(
        status=np.full(count, stress_data.INVALID), t=np.full(count, np.inf), normal=np.full((count, 3), np.nan)
    )
    for i, expected in rays(case):
        hit = expected["status"] == "hit"
        kind = stress_data.EXIT if expected.get("kind") == "exit" else stress_data.ENTER
        hits.status[i] = kind if hit else stress_data.MISS
        if hit:
            hits.t[i] = expected["dist"]
            normal = np.array(expected.get("normal", [1.0, 0.0, 0.0]))
            hits.normal[i] = normal / np.linalg.norm(normal)
    return hits


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_oracle_agrees_with_the_catalogue(case: stress_data.Case):
    """Two certified answers by different programs: status, kind, and distance to the last bit."""
    slack = 1e-14 if case.group == "start" else 0.0
    for i, expected in rays(case):
        ray = case.origins[i], case.directions[i], case.t_min[i], case.t_max[i]
        answer = oracle.first_hit(case.scene, *ray, slack=slack)
        assert answer.status == expected["status"], case.names[i]
        if answer.status == "hit":
            assert answer.kind == expected.get("kind", answer.kind)
            assert answer.distance == pytest.approx(expected["dist"], rel=4e-16)
            assert float(answer.t.rad()) < 1e-30 * max(1.0, answer.distance)


def test_oracle_marks_what_double_precision_may_get_wrong():
    """`certain_hit` is no bolder than the catalogue, and not timid either."""
    for case in CASES:
        if case.id not in ("graze_D1", "graze_D3", "tangent_exact", "nested_tree", "pinhole", "thin_shell"):
            continue
        stable = []
        for i, expected in rays(case):
            answer = oracle.certain_hit(case.scene, case.origins[i], case.directions[i])
            stable.append(answer.stable)
            assert not (answer.stable and expected.get("f64_may_differ", False)), case.names[i]
            if answer.stable and answer.status == "hit":
                assert answer.tolerance >= 0.3 * expected["tol_dist_f64"]
        assert np.mean(stable) > 0.6 or case.id == "tangent_exact"


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_reference_is_at_its_threshold_at_certified_hits(case: stress_data.Case):
    surface = case.scene.surfaces[0]
    for i, expected in rays(case):
        if expected["status"] != "hit" or "normal" not in expected or expected.get("f64_may_differ"):
            continue
        scaled = case.directions[i] / np.abs(case.directions[i]).max()
        at = case.origins[i] + expected["dist"] * scaled / np.linalg.norm(scaled)
        value = reference.field_value(surface.field, at)[0]
        position = np.spacing(max(np.abs(at).max(), np.abs(case.origins[i]).max(), expected["dist"]))
        slack = expected["F_rounding"] + 4.0 * position * expected["grad"]
        assert abs(value - surface.threshold) <= slack
        if "normal_ambiguous" not in expected:
            gradient = reference.gradient(surface.field, at)[0]
            assert np.linalg.norm(gradient) == pytest.approx(expected["grad"], rel=1e-6)
            normal = -gradient / np.linalg.norm(gradient)
            assert np.linalg.norm(normal - expected["normal"]) < 1e-7 + 1e3 * position


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_judge_accepts_the_certified_answers(case: stress_data.Case):
    assert stress_data.judge(case, answers(case)) == []


def test_judge_refuses_wrong_answers():
    case = next(case for case in CASES if case.id == "base")
    good = answers(case)

    def failures(**changes) -> list[str]:
        return stress_data.judge(case, SimpleNamespace(**{**vars(good), **changes}))

    count = len(case.names)
    assert len(failures(t=good.t + 1e-12)) == count
    assert len(failures(t=good.t + 1e-16)) == 0
    assert len(failures(status=np.full(count, stress_data.EXIT))) == count
    assert len(failures(normal=-good.normal)) == count
    assert len(failures(normal=2.0 * good.normal)) == count
    missed = failures(status=np.zeros(count, int), t=np.full(count, np.inf), normal=np.full((count, 3), np.nan))
    assert len(missed) == count
    grazed = next(case for case in CASES if case.id == "T_above_max")
    false = SimpleNamespace(status=np.ones(2, int), t=np.ones(2), normal=np.array([[1.0, 0, 0]] * 2))
    assert len(stress_data.judge(grazed, false)) == 2
    invalid = next(case for case in CASES if case.id == "bad_rays")
    assert (
        len(stress_data.judge(invalid, SimpleNamespace(**{**vars(answers(invalid)), "status": np.zeros(4, int)}))) == 4
    )


def sampled_crossing(scene, origin, direction, step: float, end: float) -> float:
    """First change of sign along a fine march: late by at most a step, blind to thinner things."""
    t = np.arange(0.0, end, step)
    first = np.inf
    for surface in scene.surfaces:
        inside = reference.field_value(surface.field, origin + t[:, None] * direction) >= surface.threshold
        changed = np.flatnonzero(inside != inside[0])
        first = min(first, t[changed[0]] if len(changed) else np.inf)
    return first


@pytest.mark.parametrize("seed", range(12))
def test_oracle_agrees_with_a_fine_march_on_random_scenes(seed: int):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, surfaces=1 + seed % 2)
    boxes = [reference.extent(surface.field) for surface in scene.surfaces]
    size = max(float(np.linalg.norm(hi - lo)) for lo, hi in boxes) + np.abs(boxes).max()
    for origin, direction in zip(*random_rays(rng, scene, 6), strict=True):
        step = size / 500.0
        answer = oracle.first_hit(scene, origin, direction)
        marched = sampled_crossing(scene, origin, direction, step, 8.0 * size)
        if answer.status == "hit":
            assert answer.distance <= marched
            at = origin + answer.distance * direction
            surface = scene.surfaces[answer.surface]
            assert reference.field_value(surface.field, at)[0] == pytest.approx(surface.threshold, abs=1e-10)
            if marched > answer.distance + step:  # the march stepped over something thin: is it there?
                before, after = (answer.distance + h for h in (-1e-9 * size, 1e-9 * size))
                values = reference.field_value(surface.field, origin + np.array([[before], [after]]) * direction)
                assert (values[0] >= surface.threshold) != (values[1] >= surface.threshold)
        else:
            assert marched == np.inf


def test_grazing_rays_graze():
    rng = np.random.default_rng(1)
    scene = random_scene(rng)
    origins, directions = grazing_rays(rng, scene, 20)
    assert len(origins) > 5
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0)
    hits = sum(oracle.first_hit(scene, o, d).status == "hit" for o, d in zip(origins, directions, strict=True))
    assert hits >= 1


def test_a_ray_along_the_surface_does_not_cross_it():
    """(1 - 1/4)^2 = 9/16 at half the reach beside a line: F is zero over the line's length."""
    line = make_leaf(Lines(np.zeros((1, 3)), np.array([[2.0, 0, 0]])), Kernel("soft2"), 1.0, 1.0)
    answer = oracle.first_hit(make_scene((line, 0.5625)), [-3.0, 0.5, 0.0], [1.0, 0.0, 0.0])
    assert answer.status in ("miss", "touch")


def test_a_start_on_the_surface_whose_halved_ray_ends_on_the_other_side():
    """The ray is halved until it leaves the surface monotonely; one half ends on the surface again, a chord away."""
    scene = make_scene((make_leaf(Points(np.zeros((1, 3))), Kernel("soft2"), 1.0, 1.0), (1.0 - 0.3**2) ** 2))
    answer = oracle.first_hit(scene, (-0.3, 0, 0), (1, 0, 0), 0.0, 1.2, slack=1e-12)
    assert (answer.start, answer.kind) == ("in", "exit")
    assert answer.distance == pytest.approx(0.6, abs=1e-12)


def test_a_search_beyond_its_budget_says_so(monkeypatch):
    monkeypatch.setattr("blobscript.certified._BUDGET", 3)
    case = next(case for case in CASES if case.id == "nested_tree")
    with pytest.raises(oracle.Undecided):
        oracle.first_hit(case.scene, case.origins[0], case.directions[0])
