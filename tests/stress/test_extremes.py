"""Random stress cases, a few of those that `python tests/bench/stress_fuzz.py` goes through."""

from __future__ import annotations

import pytest
from extremes import LIMIT, faults, random_case

import blobscript


@pytest.mark.parametrize("seed", [0, 2, 4, 9, 21, 22, 45])
def test_random_extremes_are_right_or_refused(seed: int) -> None:
    """9: a rim of 5.6e14 at a scale of 1e-17; 4: 1e-150 and the like; 45: a way out from within E of the surface that
    falls by ten times E within 1e-10, where a `max` passes to a field that rises slowly."""
    assert faults(random_case(seed)) in ([], ["refused"])


@pytest.mark.parametrize(
    ("size", "taken"), [("1e-109", True), ("1e-39", True), ("1e39", True), ("1e-111", False), ("1e150", False)]
)
def test_the_language_takes_what_double_precision_can_answer(size: str, taken: bool) -> None:
    script = f"surface {{ point(0, 0, 0).blob(reach = {size}, weight = 2) }}"
    if taken:
        scene = blobscript.compile(script)
        far = 2 * float(size)
        hits = scene.first_hit([[0, 0, far]], [[0, 0, -1]])
        assert hits.hit.all()
        assert 0 < hits.t[0] < far
        assert scene.render(width=8, height=6).rgba.shape == (6, 8, 4)
        return
    with pytest.raises(blobscript.ProgramError) as caught:
        blobscript.compile(script)
    assert {found.code for found in caught.value.diagnostics} == {"E0405"}
    assert 1e39 < LIMIT < 1e41
