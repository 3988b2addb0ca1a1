"""What facets send on to one another, against the table and the formulas of the pictures' reference."""

from __future__ import annotations

import math

import numpy as np
import pytest
from picture import reference

from blobscript import ir
from blobscript.povray import facets

COSINES = np.linspace(1e-3, 1.0, 57)


@pytest.mark.parametrize(("roughness", "metalness"), [(0.0, 1.0), (0.35, 1.0), (0.8, 0.4), (1.0, 1.0), (0.5, 0.0)])
def test_metals_gain_what_they_gain_in_pictures(roughness: float, metalness: float) -> None:
    m = ir.Material((0.9, 0.6, 0.3), roughness=roughness, metalness=metalness)
    expected = [reference.gain(m, nv) for nv in COSINES.tolist()]
    np.testing.assert_allclose(facets.gain(m, COSINES), expected, rtol=1e-9)


def test_diffuse_light_is_lifted_as_in_pictures() -> None:
    up, sigma = np.array((0.0, 0.0, 1.0)), 0.4
    level = 1 / (math.pi + (math.pi / 2 - 2 / 3) * sigma)
    for cosine in COSINES.tolist():
        way = np.array((math.sqrt(1 - cosine**2), 0.0, cosine))
        across = np.array((0.0, way[0], cosine))  # the stretch is 0: v.l = n.v n.l
        expected = reference.oren_nayar(sigma, up, way, across, cosine)
        found = cosine * level * (1 + sigma * facets.lift(np.array(cosine)) ** 2)
        assert found == pytest.approx(expected, rel=1e-9)
