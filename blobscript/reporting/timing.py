"""Honest timing on a machine that does other things as well.

Processor time of the process; all methods warm up once and then run in rounds, each round in a new random
order, so that a slow moment of the machine meets all of them; the minimum of at least ten rounds is the figure,
with median and quartiles beside it. One thread. Results are kept, so nothing is left out as unused.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

__all__ = ["REPEATS", "Timing", "measure", "once", "summed_up"]

#: Least number of rounds.
REPEATS = 10


@dataclass(frozen=True, slots=True)
class Timing:
    """Seconds of processor time per item."""

    least: float
    median: float
    low: float  # first quartile
    high: float  # third quartile
    repeats: int

    @property
    def spread(self) -> float:
        """From the least to the third quartile, as a share of the least."""
        return (self.high - self.least) / self.least if self.least > 0.0 else 0.0

    def per(self, items: float) -> Timing:
        """The same for one of so many items."""
        return Timing(self.least / items, self.median / items, self.low / items, self.high / items, self.repeats)


def once(run: Callable[[], object]) -> float:
    """Seconds of processor time of one run."""
    before = time.process_time()
    run()
    return time.process_time() - before


def measure(
    runs: Mapping[str, Callable[[], object]],
    repeats: int = REPEATS,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Timing]:
    """Of each run by its name. In a thread of its own: the tracer then needs no other for Ctrl-C's sake."""
    rng = np.random.default_rng(seed)
    names = list(runs)
    seconds: dict[str, list[float]] = {name: [] for name in names}
    total = len(names) * (repeats + 1)
    with ThreadPoolExecutor(1) as pool:
        for name in names:
            pool.submit(runs[name]).result()
        for round_number in range(repeats):
            for i in rng.permutation(len(names)):
                seconds[names[i]].append(pool.submit(once, runs[names[i]]).result())
            if progress:
                progress((round_number + 2) * len(names), total)
    return {name: summed_up(seconds[name]) for name in names}


def summed_up(seconds: list[float]) -> Timing:
    """Of the seconds of some runs."""
    low, median, high = (float(x) for x in np.percentile(seconds, [25, 50, 75]))
    return Timing(min(seconds), median, low, high, len(seconds))
