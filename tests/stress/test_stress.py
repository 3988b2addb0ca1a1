"""The catalogue of stiff and extreme cases: certified answers, the tracer against them, and the command."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import blobscript
from blobscript import cli, ir, kernels
from blobscript.scene import Search
from blobscript.stress import GROUPS, Case, all_cases, expected
from blobscript.stress import running as runs
from blobscript.stress.catalogue import certify, fingerprint
from blobscript.stress.images import image_faults
from blobscript.stress.running import EXACT, OTHERS, run_case
from blobscript.stress.tables import as_html, as_json, as_markdown, as_text

#: Seconds each; the command runs them.
SLOW = {"load/thousand-lines", "cancelling/checkerboard"}
QUICK = [case for case in all_cases() if f"{case.group}/{case.id}" not in SLOW]


def name_of(case: Case) -> str:
    return f"{case.group}/{case.id}"


def named(name: str) -> Case:
    return next(case for case in all_cases() if name_of(case) == name)


# ---- the catalogue ------------------------------------------------------------------------------------


def test_all_groups_are_there() -> None:
    assert {case.group for case in all_cases()} == set(GROUPS)
    names = [name_of(case) for case in all_cases()]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("case", all_cases(), ids=name_of)
def test_every_ray_has_an_answer_for_what_it_is_now(case: Case) -> None:
    answers = expected(case)
    assert len(answers) == (0 if case.refused else len(case.rays))
    assert len(case.about) > 20
    for answer in answers:
        assert answer.status in ("hit", "miss", "touch", "invalid")
        assert (answer.status == "hit") == math.isfinite(answer.t)
        assert answer.status != "hit" or answer.tolerance > 0


def test_a_changed_case_has_no_answers() -> None:
    case = replace(named("grazing/easy"), script="surface { ball(radius = 1.5) }")
    assert fingerprint(case) != fingerprint(named("grazing/easy"))
    with pytest.raises(KeyError, match="has changed"):
        expected(case)


@pytest.mark.parametrize("name", ["grazing/ball", "stiff/gauss-1e8", "degenerate/flat-triangles", "input/rays"])
def test_the_answers_are_what_ball_arithmetic_says(name: str) -> None:
    """A few of them again; `python -m blobscript.stress.make` makes them all."""
    case = named(name)
    assert certify(case, blobscript.compile(case.script).ir) == expected(case)


# ---- tracers against it -----------------------------------------------------------------------------------


@pytest.mark.parametrize("case", QUICK, ids=name_of)
def test_ours_pass(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "OTHERS", ())
    monkeypatch.setattr(runs, "_REPEATS", 1)
    monkeypatch.setattr(runs, "image_faults", lambda scene: [])
    row = run_case(case)
    assert row.faults == []
    assert set(row.outcomes) == (set() if case.refused else set(EXACT))


@pytest.mark.parametrize(
    "name", ["stiff/weight-1e15", "cancelling/three-reaches", "joint/max-of-sums", "scale/far-1e6"]
)
def test_pictures_have_no_faults(name: str) -> None:
    assert image_faults(blobscript.compile(named(name).script)) == []


@pytest.mark.parametrize("form", ["surface {{ {} }}", "surface(max([sum {{ {} }}, ball((5, 0, 0), radius = 0.1)]))"])
@pytest.mark.parametrize("search", ["sandwich", "bernstein"])
def test_long_sums_are_right_to_the_last_digits(form: str, search: Search) -> None:
    """A plain sum of so many terms is off by its length's root, and rays that go on into the solid enter it again."""
    count = 30_000
    balls = f"balls([for (i in 0..<{count}) (i / 1e9, 0, 0)], reach = 1, weight = {2 / count!r})"
    scene = blobscript.compile(form.format(balls))
    way = np.array([[-0.43, -0.23, -0.87]]) + 0.05 * np.random.default_rng(2).standard_normal((24, 3))
    origins = -4.0 * way
    hits = scene.first_hit(origins, way, search=search)
    assert hits.hit.all()
    for at in hits.position:
        s = (at[0] - np.arange(count) / 1e9) ** 2 + at[1] ** 2 + at[2] ** 2
        value = math.fsum(2 / count * kernels.value(ir.Kernel("wyvill"), s)) - scene.surfaces[0].threshold
        assert abs(value) < 40 * 2.0**-53
    assert (scene.first_hit(hits.position, way, search=search).status == 2).all()  # out at the back


def test_other_methods_fail_where_they_must() -> None:
    """So that the comparison means something: march steps over shells and needles."""
    row = run_case(named("thin/shell-1e-6"))
    assert row.passed
    assert row.outcomes["march"].wrong == len(row.case.rays)
    assert row.outcomes["sandwich"].wrong == 0
    assert row.outcomes["sphere"].error < 1 or row.outcomes["segment"].error > 1


@pytest.mark.parametrize(
    ("shift", "flip", "word"), [(1e-9, False, "times what rounding explains"), (0.0, True, "expected exit")]
)
def test_wrong_answers_are_found(shift: float, flip: bool, word: str, monkeypatch: pytest.MonkeyPatch) -> None:
    case = named("grazing/easy")
    changed = tuple(
        replace(e, t=e.t + shift, kind="exit" if flip else e.kind) if e.status == "hit" else e for e in expected(case)
    )
    monkeypatch.setattr(runs, "expected", lambda _case: changed)
    monkeypatch.setattr(runs, "image_faults", lambda scene: [])
    row = run_case(case)
    assert not row.passed
    assert word in row.faults[0]


def test_missed_and_made_up_hits_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    case = named("grazing/ball")
    swapped = tuple(
        replace(
            e, status="miss" if e.status == "hit" else "hit", t=math.inf if e.status == "hit" else 3.0, tolerance=1.0
        )
        for e in expected(case)
    )
    monkeypatch.setattr(runs, "expected", lambda _case: swapped)
    monkeypatch.setattr(runs, "image_faults", lambda scene: [])
    faults = " ".join(run_case(case).faults)
    assert "missed" in faults
    assert "where there is none" in faults


def test_a_case_that_should_be_refused_and_is_not() -> None:
    case = replace(named("input/reach-0"), script="surface { ball(radius = 1) }")
    assert run_case(case).faults == ["loads, but E0405 was expected"]
    other = replace(named("input/reach-0"), refused="E0404")
    assert run_case(other).faults == ["refused with E0405, not E0404"]


def test_a_case_that_should_warn_and_does_not() -> None:
    assert run_case(named("input/inside-out")).passed
    assert run_case(replace(named("input/inside-out"), warned="")).faults == ["loads with W0407, not without any"]
    assert "loads with no warning, not W0407" in run_case(replace(named("grazing/easy"), warned="W0407")).faults


def test_a_picture_with_acne_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = blobscript.compile("surface { ball(radius = 1) }")
    true_any = type(scene).any_hit

    def blocked(self, *rays):
        return ~true_any(self, *rays)

    monkeypatch.setattr(type(scene), "any_hit", blocked)
    assert any("ways back to the eye are blocked" in fault for fault in image_faults(scene))


# ---- the command --------------------------------------------------------------------------------------------


def test_the_table(capsys, tmp_path) -> None:
    page = tmp_path / "stress.html"
    argv = ["stress", "--only", "bulge", "--only", "input", "--no-povray", "-o", str(page)]
    assert cli.main(argv) == 0
    out = capsys.readouterr().out
    assert "bulge" in out
    assert "refused: E0406" in out
    assert "all right" in out
    assert not any(word in out for word in ("stiff", "grazing"))
    text = page.read_text(encoding="utf-8")
    assert "three rods, summed" in text
    assert "<script" not in text


def test_json_and_exit_code_5(capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "image_faults", lambda scene: ["picture: a pixel is no number"])
    assert cli.main(["stress", "--only", "bulge", "--no-povray", "--format", "json"]) == 5
    facts = json.loads(capsys.readouterr().out)
    assert facts["passed"] is False
    assert facts["cases"][0]["faults"] == ["picture: a pixel is no number"]
    assert set(facts["cases"][0]["outcomes"]) == {*EXACT, *OTHERS}


def test_povray_answers_the_same_rays() -> None:
    row = run_case(named("bulge/sum"), povray=True)
    assert row.outcomes["POV-Ray"].right + row.outcomes["POV-Ray"].wrong == len(row.case.rays)


def test_povray_is_not_asked_about_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred thousand blobs in each of eight million places would take it hours, and another scene to answer for."""
    from blobscript.povray import objects

    monkeypatch.setattr(objects, "_MOST_TERMS", 2)
    assert "POV-Ray" not in run_case(named("bulge/sum"), povray=True).outcomes


def test_wrong_usage(capsys) -> None:
    assert cli.main(["stress", "--only", "nothing"]) == 2
    assert cli.main(["stress", "-o", "x.pdf"]) == 2
    assert cli.main(["stress", "--show", "nowhere"]) == 2
    assert "no case `nowhere`" in capsys.readouterr().err


def test_a_case_can_be_looked_at(capsys) -> None:
    assert cli.main(["stress", "--show", "bulge/max"]) == 0
    script = capsys.readouterr().out
    assert blobscript.compile(script).surfaces


def test_all_forms_tell_the_same() -> None:
    rows = [run_case(named("bulge/max")), run_case(named("input/nothing"))]
    for form in (as_text, as_json, as_markdown, as_html):
        text = form(rows)
        assert "three rods" in text or form is as_text
        assert "refused: E0401" in text or form is as_json
    assert np.isfinite(json.loads(as_json(rows))["cases"][0]["outcomes"]["sandwich"]["conditioned_error"])
