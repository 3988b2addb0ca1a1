"""Every search strategy with its tolerance swept: errors, mistakes, evaluations, time.

What is slow gets fewer rays, not fewer runs: each setting is first tried on a few rays, and judged and timed on as
many, evenly spread, as its time allows. A sweep ends where that are too few; `Result.last` says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

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
#: Processor seconds that the rays of one run may take when they are timed, and when they are judged.
_TIMED, _JUDGED, _QUICK_JUDGED = 0.1, 2.0, 1.0
#: Rays that a setting is tried on first, and below which a sweep goes no further: they would tell little.
_TRIED, _FEW = 48, 300


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
    """timed_rays: how many of the picture's rays were timed. last: smaller tolerances would have taken too long."""

    method: Method
    judgement: Judgement
    time: Timing  # per picture ray
    timed_rays: int
    setting: float  # tolerance or step in units; the default's too
    last: bool = False

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
            if method.search in given_up and not method.is_default:
                continue
            each = pool.submit(_tried, scene, rays, method).result()
            share = min(1.0, (_QUICK_JUDGED if quick else _JUDGED) / (each * len(rays)))
            if share * len(rays) < _FEW:
                given_up.add(method.search)
            verdict = pool.submit(_judged, scene, rays, reference, unit, method, share).result()
            judged.append((method, verdict, each))
    runs: dict[str, Callable[[], object]] = {}
    counts: list[int] = []
    for number, (method, _, each) in enumerate(judged):
        part = _sample(rays.picture, max(int(_TIMED / each), 64))
        counts.append(len(range(*part.indices(rays.picture))))
        runs[str(number)] = _tracer(scene, rays, part, method, [])
    timings = measure(runs, REPEATS, rays.seed, progress)
    last = {method.search: i for i, (method, _, _) in enumerate(judged) if not method.is_default}
    return [
        Result(
            method,
            judgement,
            timings[str(i)].per(counts[i]),
            counts[i],
            _setting(method, unit),
            method.search in given_up and last[method.search] == i,
        )
        for i, (method, judgement, _) in enumerate(judged)
    ]


def _tried(scene: Scene, rays: Rays, method: Method) -> float:
    """Seconds per ray, from a few of all kinds."""
    part = _sample(len(rays), _TRIED)
    return max(once(_tracer(scene, rays, part, method, [])) / len(range(*part.indices(len(rays)))), 1e-9)


def _judged(scene: Scene, rays: Rays, reference: Reference, unit: float, method: Method, share: float) -> Judgement:
    """On a share of the rays; per ray, those left out are neither right nor wrong."""
    every = max(round(1.0 / share), 1)
    rows = np.concatenate([np.arange(0, rays.picture, every), np.arange(rays.picture, len(rays), every)])
    hits: list[Hits] = []
    _tracer(scene, rays, rows, method, hits)()
    picture = int(np.count_nonzero(rows < rays.picture))
    verdict = judge(hits[0], reference.part(rows), picture, unit, method.tolerance or 0.0)
    error, bad = np.full(len(rays), np.nan), np.zeros(len(rays), np.bool_)
    error[rows], bad[rows] = verdict.error, verdict.bad
    return replace(verdict, error=error, bad=bad)


def _sample(count: int, wanted: int) -> slice:
    """Evenly spread, `wanted` or a few less."""
    return slice(0, count, max(-(-count // wanted), 1))


def _tracer(
    scene: Scene, rays: Rays, part: slice | NDArray[np.int64], method: Method, kept: list[Hits]
) -> Callable[[], object]:
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
