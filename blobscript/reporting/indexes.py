"""Every spatial index: time to build it, time to trace with it, memory."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from blobscript.backends.library import INDEXES, check_status, load
from blobscript.backends.native import Hits, Native
from blobscript.reporting.judging import Judgement, judge
from blobscript.reporting.rays import Rays
from blobscript.reporting.reference import Reference
from blobscript.reporting.timing import REPEATS, Timing, measure, once

if TYPE_CHECKING:
    from blobscript.scene import Scene

__all__ = ["PICTURE", "IndexResult", "measure_indexes"]

#: Rays of a picture of 640 x 480: what `total` is for.
PICTURE = 640 * 480
#: Processor seconds of one trace from which on an index is timed on fewer rays.
_LONG = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class IndexResult:
    """build: seconds; trace: per picture ray; bytes: of the index."""

    index: str
    build: Timing
    trace: Timing
    bytes: int
    judgement: Judgement

    @property
    def total(self) -> float:
        """Seconds for a picture of 640 x 480, one thread, hits and normals."""
        return self.build.least + PICTURE * self.trace.least


def measure_indexes(
    scene: Scene, rays: Rays, reference: Reference, unit: float, progress: Callable[[int, int], None] | None = None
) -> list[IndexResult]:
    native = Native(scene.ir)
    builds: dict[str, Callable[[], object]] = {}
    traces: dict[str, Callable[[], object]] = {}
    counts: dict[str, int] = {}
    judged: dict[str, Judgement] = {}
    for name in INDEXES:
        builds[name] = _builder(native, name)
        native.index_pointer(name)
        hits: list[Hits] = []
        seconds = once(lambda name=name, hits=hits: hits.append(_traced(native, name, rays)))
        judged[name] = judge(hits[0], reference, rays.picture, unit)
        counts[name] = max(int(rays.picture * min(1.0, _LONG / max(seconds, 1e-9))), min(64, rays.picture))
        traces[name] = _tracer(native, name, rays, counts[name])
    built = measure(builds, REPEATS, rays.seed)
    traced = measure(traces, REPEATS, rays.seed, progress)
    return [
        IndexResult(name, built[name], traced[name].per(counts[name]), _bytes(native, name), judged[name])
        for name in INDEXES
    ]


def _builder(native: Native, name: str) -> Callable[[], object]:
    library, number = load(), INDEXES.index(name)

    def run() -> None:
        pointer = ctypes.c_void_p()
        check_status(library.blob_index_build(native.scene_pointer, number, ctypes.byref(pointer)))
        library.blob_index_free(pointer)

    return run


def _tracer(native: Native, name: str, rays: Rays, count: int) -> Callable[[], object]:
    step = max(1, rays.picture // max(count, 1)) if count < rays.picture else 1
    origins = np.ascontiguousarray(rays.origins[: rays.picture : step][:count])
    directions = np.ascontiguousarray(rays.directions[: rays.picture : step][:count])

    def run() -> object:
        return native.first_hit(origins, directions, index=name, threads=1)

    return run


def _traced(native: Native, name: str, rays: Rays) -> Hits:
    return native.first_hit(rays.origins, rays.directions, index=name, threads=1)


def _bytes(native: Native, name: str) -> int:
    return int(load().blob_index_bytes(native.index_pointer(name)))
