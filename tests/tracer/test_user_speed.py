"""User kernels cost about twice what built-in ones do at most, however many pieces their proof makes."""

from __future__ import annotations

import os
import time
from dataclasses import replace

import numpy as np
import pytest
from user_kernels import proved

import blobscript
from blobscript.pack import pack

#: Kernels and the built-in one that is the same or nearest.
PAIRS = {
    "soft3": ("kernel own(r) = (1 - r^2)^3", "soft3"),
    "metaball": ("kernel own(r) = if (r < 1/3) 1 - 3*r^2 else 1.5*(1-r)^2", "metaball"),
    "steep": ("kernel own(r) = (1 - r^2)^1.5", "soft3"),
    "cosine": ("kernel own(r) = (1 + cos(180deg * r)) / 2", "soft3"),
    "shoulder": ("kernel own(r, k: int = 2) = (1 - r^2)^k * (1 + k * r^2)", "soft3"),
    "rational": ("kernel own(r) = (1 - r^2)^2 / (1 + 2 * r^2)", "soft3"),
}

#: What the proof cuts into the most pieces (5 and 51): 1.8 to 2.4 were measured since built-in kernels got faster.
SLACK = {"rational": 1.35, "steep": 1.35}


def balls(kernel: str, definition: str) -> blobscript.Scene:
    """300 of them."""
    return blobscript.compile(
        f"""
        {definition}
        surface {{
          sum(kernel = {kernel}) {{
            for (i in 0..<300) {{
              ball((3 * rand(i), 3 * rand(i, seed = 1), 3 * rand(i, seed = 2)), reach = 0.7)
            }}
          }}
        }}
        """
    )


def rays_through(kernel: str, definition: str = ""):
    """Asks for 10 000 first hits; gives the processor time."""
    scene = balls(kernel, definition)
    rng = np.random.default_rng(1)
    origins = np.column_stack([rng.uniform(-0.5, 3.5, (10_000, 2)), np.full(10_000, 9.0)])
    directions = np.tile([0.0, 0.0, -1.0], (10_000, 1))

    def seconds() -> float:
        start = time.process_time()
        scene.first_hit(origins, directions, threads=1)
        return time.process_time() - start

    return seconds


def picture_of(kernel: str, definition: str = ""):
    """Renders, with shadows and normals; gives the processor time."""
    scene = balls(kernel, definition)

    def seconds() -> float:
        start = time.process_time()
        scene.render(width=160, height=120, samples=1, threads=1)
        return time.process_time() - start

    return seconds


@pytest.mark.skipif("libasan" in os.environ.get("LD_PRELOAD", ""), reason="sanitizers take time of their own")
@pytest.mark.parametrize(
    ("name", "measured"),
    [(name, rays_through) for name in PAIRS] + [(name, picture_of) for name in PAIRS],
)
def test_a_factor_of_two(name: str, measured) -> None:
    """1.3 to 1.5 were measured; up to 2.2 for rational, and 2.4 for pictures of steep, which has 51 pieces."""
    definition, built_in = PAIRS[name]
    own, other = measured("own", definition), measured(built_in)
    most = 2.0 * SLACK.get(name, 1.0)
    times: list[tuple[float, float]] = []
    for _ in range(4):  # as often as it takes on a busy machine, at most
        times += [(own(), other()) for _ in range(5)]
        if min(a for a, _ in times) <= most * min(b for _, b in times):
            return
    pytest.fail(f"{min(a for a, _ in times) / min(b for _, b in times):.2f} times as long")


def runs(definition: str) -> list[tuple[int, bool]]:
    kernel = proved(definition)
    scene = blobscript.compile("surface { ball(radius = 1) }").ir
    surface = scene.surfaces[0]
    packed = pack(replace(scene, surfaces=(replace(surface, field=replace(surface.field, kernel=kernel)),)))
    return [(int(row["run"]), bool(row["joined"])) for row in packed.arrays["pieces"]]


def test_pieces_that_bend_one_way_are_one_run() -> None:
    """51 pieces towards a place where derivatives have no bound, a stub at the end, and nothing beyond."""
    assert set(runs("kernel steep(r) = (1 - r^2)^1.5")) == {(1, True)}
    assert runs("kernel meta(r) = if (r < 1/3) 1 - 3*r^2 else 1.5*(1-r)^2") == [(1, True), (1, True)]


def test_a_run_ends_where_it_bends_the_other_way_or_has_a_crease() -> None:
    flat = "kernel k(r) = if (r <= 1/4) 1 else if (r < 3/4) 1 - 3 * (2*r - 1/2)^2 + 2 * (2*r - 1/2)^3 else 0"
    assert runs(flat) == [(-1, True), (-1, False), (2, True), (2, True)]
    assert runs("@allow(crease)\nkernel cap(r) = 1 - r^4") == [(-1, False)]
    assert runs("@allow(crease)\nkernel dent(r) = if (r < 0.5) 1 - r^2 else 3 * (1 - r)^2") == [(1, False), (2, True)]
