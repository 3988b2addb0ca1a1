"""Rays that leave a surface from their own starting point: a false shadow is a speck in a picture."""

from __future__ import annotations

import numpy as np
import pytest

import blobscript
from blobscript.backends.native import Native

SHOULDER = "kernel shoulder(r, k: int = 2) = (1 - r^2)^k * (1 + k * r^2)\n"
PATH = "polyline([(-1, 0, 0), (0, 0, 0), (1, 0.2, 0)]).blob(radius = 0.5, weight = 0.9)\n"
BITE = "polygon([(0.8, 0, -0.3), (1.6, 0.1, -0.3), (1.6, 0.1, 0.3)]).blob(reach = 0.5, weight = -0.6)\n"
BALL = "ball((0, 0.4, 0), radius = 0.3)\n"


@pytest.mark.parametrize("kernel", ["wyvill", "soft2", "gauss(3)", "metaball", "shoulder"])
@pytest.mark.parametrize("shape", [BALL, PATH, PATH + BALL, PATH + BITE + BALL, f"max {{\n{PATH}{BALL}}}"])
def test_leaving_rays_do_not_hit_where_they_start(kernel: str, shape: str) -> None:
    """Random directions into the open from random hits, put on the surface to the last bits."""
    source = f"{SHOULDER}surface {{ sum(kernel = {kernel}) {{\n{shape}}} }}"
    native = Native(blobscript.compile(source).ir)
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = native.first_hit(-6 * directions + 0.4 * rng.standard_normal((3000, 3)), directions)
    places, normals = hits.position[hits.hit], hits.normal[hits.hit]
    gradients = native.gradient(places)
    short = 0.5 - native.field(places)
    places = places + (short / np.sum(gradients**2, axis=1))[:, None] * gradients
    ways = rng.standard_normal(places.shape)
    ways *= np.sign(np.sum(ways * normals, axis=1))[:, None]
    assert len(places) > 300
    assert np.array_equal(native.any_hit(places, ways), native.any_hit(places, ways, t_min=1e-6))
