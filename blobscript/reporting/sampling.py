"""Antialiasing: how the error of a picture falls with the samples per pixel, against a converged picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from blobscript.images import srgb_encode
from blobscript.reporting.timing import REPEATS, Timing, measure

if TYPE_CHECKING:
    from blobscript.scene import Scene

__all__ = ["SamplingResult", "Sampling", "measure_sampling"]

Colors = NDArray[np.float32]

_SAMPLES = (1, 2, 4, 9, 16, 36, 64)
_QUICK = (1, 4, 16)
_CONVERGED, _CONVERGED_QUICK = 1024, 256


@dataclass(frozen=True, slots=True)
class SamplingResult:
    """rms, worst: difference of sRGB values in 0..1 over all pixels; pixels: share farther off than 1/255."""

    samples: int
    rms: float
    worst: float
    pixels: float
    time: Timing  # per pixel


@dataclass(frozen=True, slots=True)
class Sampling:
    """Of pictures of width x height, against one with `converged` samples of another seed."""

    width: int
    height: int
    converged: int
    results: list[SamplingResult]


def measure_sampling(
    scene: Scene, quick: bool, seed: int, progress: Callable[[int, int], None] | None = None
) -> Sampling:
    width = 80 if quick else 120
    height = max(round(width * scene.ir.height / scene.ir.width), 1)
    converged = _CONVERGED_QUICK if quick else _CONVERGED
    exact = _picture(scene, width, height, converged, seed + 1)
    runs: dict[str, Callable[[], object]] = {}
    errors: list[tuple[float, float, float]] = []
    counts = _QUICK if quick else _SAMPLES
    for samples in counts:
        errors.append(_difference(_picture(scene, width, height, samples, seed), exact))

        def run(samples: int = samples) -> object:
            return scene.render(width=width, height=height, samples=samples, threads=1, seed=seed)

        runs[str(samples)] = run
    times = measure(runs, REPEATS, seed, progress)
    rows = [
        SamplingResult(n, *error, times[str(n)].per(width * height)) for n, error in zip(counts, errors, strict=True)
    ]
    return Sampling(width, height, converged, rows)


def _picture(scene: Scene, width: int, height: int, samples: int, seed: int) -> Colors:
    image = scene.render(width=width, height=height, samples=samples, seed=seed)
    return srgb_encode(image.rgba[..., :3])


def _difference(a: Colors, b: Colors) -> tuple[float, float, float]:
    """Root mean square, largest, and share of pixels off by more than a step of 8 bits."""
    difference = a.astype(np.float64) - b.astype(np.float64)
    off = np.max(np.abs(difference), axis=2)
    rms = math.sqrt(float(np.vdot(difference, difference)) / difference.size)
    return rms, float(off.max()), float(np.count_nonzero(off > 1.0 / 255.0)) / off.size
