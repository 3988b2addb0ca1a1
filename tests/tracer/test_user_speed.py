"""User kernels cost at most about twice what built-in ones do, however many pieces their proof makes."""

from __future__ import annotations

import time

import numpy as np

import blobscript


def seconds(kernel: str) -> tuple[float, int]:
    """Processor time of 10 000 rays through 300 balls, the best of three runs, and the evaluations."""
    scene = blobscript.compile(
        f"""
        kernel steep(r) = (1 - r^2)^1.5
        surface {{
          sum(kernel = {kernel}) {{
            for (i in 0..<300) {{
              ball((3 * rand(i), 3 * rand(i, seed = 1), 3 * rand(i, seed = 2)), reach = 0.7)
            }}
          }}
        }}
        """
    )
    rng = np.random.default_rng(1)
    origins = np.column_stack([rng.uniform(-0.5, 3.5, (10_000, 2)), np.full(10_000, 9.0)])
    directions = np.tile([0.0, 0.0, -1.0], (10_000, 1))
    best, hits = np.inf, None
    for _ in range(3):
        start = time.process_time()
        hits = scene.first_hit(origins, directions, threads=1)
        best = min(best, time.process_time() - start)
    assert hits is not None
    return best, int(hits.evaluations.sum())


def test_many_pieces_cost_little() -> None:
    """55 pieces; with every joint evaluated for every interval it was more than four times as much."""
    built_in, evaluations = seconds("soft3")
    own, more = seconds("steep")
    assert own / more <= 3.0 * built_in / evaluations
