"""The stress catalogue through the tracer: stiff, cancelling, grazing, thin, huge, tiny and degenerate cases
with certified answers. `stress_data.judge` says what is right; its tolerance is the conditioned error of each ray."""

from __future__ import annotations

import numpy as np
import pytest
import stress_data
from tracer.methods import INDEXES, SEARCHES

from blobscript.backends.native import Native

CASES = [case for case in stress_data.cases() if case.scene is not None]


@pytest.mark.parametrize("index", INDEXES)
@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_every_certified_answer(case: stress_data.Case, search: str, index: str):
    native = Native(case.scene)
    hits = native.first_hit(case.origins, case.directions, case.t_min, case.t_max, search=search, index=index)
    assert stress_data.judge(case, hits) == []


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_one_ray_at_a_time_gives_the_same(case: stress_data.Case):
    """A ray alone in its packet takes another path through the index than one among neighbours; the last bits
    may differ (sums in another order), what is certified may not."""
    native = Native(case.scene)
    together = native.first_hit(case.origins, case.directions, case.t_min, case.t_max)
    for i in range(len(case.names)):
        one = slice(i, i + 1)
        alone = native.first_hit(case.origins[one], case.directions[one], case.t_min[one], case.t_max[one])
        together.status[i], together.t[i] = alone.status[0], alone.t[0]
        together.normal[i], together.surface[i] = alone.normal[0], alone.surface[0]
    assert stress_data.judge(case, together) == []


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_any_hit_agrees(case: stress_data.Case):
    native = Native(case.scene)
    rays = case.origins, case.directions, case.t_min, case.t_max
    np.testing.assert_array_equal(native.any_hit(*rays), native.first_hit(*rays).hit)


def test_effort_is_bounded():
    """Evaluations of the whole field per ray, a machine-independent measure of the time: the mean over the
    catalogue, and what the worst ray of all may cost (grazing, at a distance of a few rounding errors)."""
    counts = np.concatenate([Native(c.scene).first_hit(c.origins, c.directions).evaluations for c in CASES])
    assert counts.mean() < 60
    assert counts.max() < 3000
