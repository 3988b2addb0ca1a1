"""Antialiasing: how the error of a picture falls with the samples per pixel, against a converged picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from blobscript.images import Image, srgb_encode
from blobscript.reporting.timing import REPEATS, Timing, measure, once

if TYPE_CHECKING:
    from blobscript.scene import Scene

__all__ = ["SamplingResult", "Sampling", "measure_sampling"]

Colors = NDArray[np.float32]

_SAMPLES = (1, 2, 4, 9, 16, 36, 64)
_QUICK = (1, 4, 16)
#: What adaptive pictures are asked for.
_NOISES, _QUICK_NOISES = (0.1, 0.05, 0.02, 0.01), (0.05, 0.02)
_CONVERGED, _CONVERGED_QUICK = 1024, 256
#: Widths of the pictures: as large as the processor seconds allow that all of them together may take.
_WIDTHS, _QUICK_WIDTHS = (24, 120), (24, 80)
_SECONDS, _QUICK_SECONDS = 60.0, 15.0
#: Samples per pixel that an adaptive picture is expected to take.
_EXPECTED = 48


@dataclass(frozen=True, slots=True)
class SamplingResult:
    """samples: per pixel; 0 where each cell took as many as `noise` needs, else noise is 0. rms, worst: difference of
    sRGB values in 0..1 over all pixels; pixels: share farther off than 1/255."""

    samples: int
    noise: float
    rms: float
    worst: float
    pixels: float
    time: Timing  # per pixel

    @property
    def words(self) -> str:
        return f"noise {self.noise:g}" if self.noise else str(self.samples)


@dataclass(frozen=True, slots=True)
class Sampling:
    """Of pictures of width x height, against one with `converged` samples of another seed."""

    width: int
    height: int
    converged: int
    results: list[SamplingResult]

    @property
    def fixed(self) -> list[SamplingResult]:
        return [r for r in self.results if not r.noise]

    @property
    def adaptive(self) -> list[SamplingResult]:
        return [r for r in self.results if r.noise]


def measure_sampling(
    scene: Scene, quick: bool, seed: int, progress: Callable[[int, int], None] | None = None
) -> Sampling:
    """All with light from all around, also the picture of one sample."""
    converged = _CONVERGED_QUICK if quick else _CONVERGED
    width = _affordable(scene, quick, converged, seed)
    height = _height(scene, width)
    exact = _coded(_rendered(scene, width, height, converged, 0.0, seed + 1, None))
    ways = [(n, 0.0) for n in (_QUICK if quick else _SAMPLES)]
    ways += [(0, noise) for noise in (_QUICK_NOISES if quick else _NOISES)]
    runs: dict[str, Callable[[], object]] = {}
    errors: list[tuple[float, float, float]] = []
    for number, (samples, noise) in enumerate(ways):
        errors.append(_difference(_coded(_rendered(scene, width, height, samples, noise, seed, None)), exact))

        def run(samples: int = samples, noise: float = noise) -> object:
            return _rendered(scene, width, height, samples, noise, seed, 1)

        runs[str(number)] = run
    times = measure(runs, REPEATS, seed, progress)
    rows = [
        SamplingResult(*way, *error, times[str(i)].per(width * height))
        for i, (way, error) in enumerate(zip(ways, errors, strict=True))
    ]
    return Sampling(width, height, converged, rows)


def _affordable(scene: Scene, quick: bool, converged: int, seed: int) -> int:
    """The width at which all pictures together take the time that there is for them."""
    least, most = _QUICK_WIDTHS if quick else _WIDTHS
    tried = 4
    seconds = once(lambda: _rendered(scene, least, _height(scene, least), tried, 0.0, seed, 1))
    each = seconds / (tried * least * _height(scene, least))
    once_more = sum(_QUICK if quick else _SAMPLES) + _EXPECTED * len(_QUICK_NOISES if quick else _NOISES)
    pixels = (_QUICK_SECONDS if quick else _SECONDS) / (each * (converged + (REPEATS + 2) * once_more))
    return round(min(max(math.sqrt(pixels * scene.ir.width / scene.ir.height), least), most))


def _height(scene: Scene, width: int) -> int:
    return max(round(width * scene.ir.height / scene.ir.width), 1)


def _rendered(
    scene: Scene, width: int, height: int, samples: int, noise: float, seed: int, threads: int | None
) -> Image:
    return scene.render(
        width=width,
        height=height,
        samples=samples or _CONVERGED,
        noise=noise or None,
        seed=seed,
        indirect="bounce",
        threads=threads,
    )


def _coded(image: Image) -> Colors:
    return srgb_encode(image.rgba[..., :3])


def _difference(a: Colors, b: Colors) -> tuple[float, float, float]:
    """Root mean square, largest, and share of pixels off by more than a step of 8 bits."""
    difference = a.astype(np.float64) - b.astype(np.float64)
    off = np.max(np.abs(difference), axis=2)
    rms = math.sqrt(float(np.vdot(difference, difference)) / difference.size)
    return rms, float(off.max()), float(np.count_nonzero(off > 1.0 / 255.0)) / off.size
