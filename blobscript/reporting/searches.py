"""Every search strategy with its tolerance swept: errors, mistakes, evaluations, time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from blobscript.reporting.judging import Judgement, judge
from blobscript.reporting.rays import Rays
from blobscript.reporting.reference import Reference
from blobscript.reporting.timing import REPEATS, Timing, measure, once

if TYPE_CHECKING:
    from blobscript.backends.native import Hits
    from blobscript.scene import Scene, Search

__all__ = ["PROVED", "Method", "Result", "measure_searches", "methods"]

#: Searches that prove what they say; the others look at places.
PROVED = ("sandwich", "bernstein", "interval")
#: Processor seconds that one run may take before it is timed on fewer rays, and before the sweep of its
#: search goes no further.
_LONG, _TOO_LONG = 0.15, 1.0


@dataclass(frozen=True, slots=True)
class Method:
    """tolerance, step: in scene units; None is the default."""

    search: Search
    tolerance: float | None = None
    step: float | None = None

    @property
    def is_default(self) -> bool:
        return self.tolerance is None and self.step is None

    @property
    def proved(self) -> bool:
        return self.search in PROVED


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """timed_rays: how many of the picture's rays were timed."""

    method: Method
    judgement: Judgement
    time: Timing  # per picture ray
    timed_rays: int
    setting: float  # tolerance or step in units; the default's too

    @property
    def faultless(self) -> bool:
        return self.judgement.all.bad == 0


def methods(unit: float, quick: bool) -> Iterator[Method]:
    """In order of decreasing tolerance for each search."""
    exponents = (3, 6, 9, 12) if quick else (2, 3, 4, 5, 6, 8, 10, 12)
    for search in ("sandwich", "bernstein", "interval"):
        for k in exponents:
            yield Method(search, unit * 10.0**-k)
        yield Method(search)
    for search in ("segment", "sphere"):
        for k in exponents:
            yield Method(search, unit * 10.0**-k)
    for step in (0.3, 0.1, 0.03, 0.01) if quick else (0.3, 0.1, 0.05, 0.03, 0.01, 0.003, 0.001):
        yield Method("march", step=unit * step)


def measure_searches(
    scene: Scene,
    rays: Rays,
    reference: Reference,
    unit: float,
    quick: bool,
    progress: Callable[[int, int], None] | None = None,
) -> list[Result]:
    """A search that takes very long is not tried with still smaller tolerances."""
    judged: list[tuple[Method, Judgement, float]] = []
    given_up: set[str] = set()
    with ThreadPoolExecutor(1) as pool:
        for method in methods(unit, quick):
            if method.search in given_up:
                continue
            hits: list[Hits] = []
            seconds = pool.submit(once, _tracer(scene, rays, slice(None), method, hits)).result()
            if seconds > _TOO_LONG:
                given_up.add(method.search)
            verdict = judge(hits[0], reference, rays.picture, unit, method.tolerance or 0.0)
            effort = hits[0].evaluations.astype(np.float64) + 1.0
            share = float(effort[: rays.picture].sum() / effort.sum())
            judged.append((method, verdict, seconds * share))
    runs: dict[str, Callable[[], object]] = {}
    counts: list[int] = []
    for number, (method, _, seconds) in enumerate(judged):
        share = min(1.0, _LONG / max(seconds, 1e-9))
        counts.append(max(int(rays.picture * share), min(rays.picture, 64)))
        runs[str(number)] = _tracer(scene, rays, _sample(rays.picture, counts[-1]), method, [])
    timings = measure(runs, REPEATS, rays.seed, progress)
    return [
        Result(method, judgement, timings[str(i)].per(counts[i]), counts[i], _setting(method, unit))
        for i, (method, judgement, _) in enumerate(judged)
    ]


def _sample(count: int, wanted: int) -> slice:
    """Evenly spread."""
    return slice(0, count, max(1, count // max(wanted, 1))) if wanted < count else slice(0, count)


def _tracer(scene: Scene, rays: Rays, part: slice, method: Method, kept: list[Hits]) -> Callable[[], object]:
    origins, directions = (np.ascontiguousarray(a[part]) for a in (rays.origins, rays.directions))

    def run() -> None:
        hits = scene.first_hit(
            origins, directions, search=method.search, tolerance=method.tolerance, step=method.step, threads=1
        )
        kept[:] = [hits]

    return run


def _setting(method: Method, unit: float) -> float:
    if method.step is not None:
        return method.step / unit
    return 0.0 if method.tolerance is None else method.tolerance / unit
