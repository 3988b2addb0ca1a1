"""Normals: analytic ones against differences over a range of steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from blobscript import field
from blobscript.reporting.judging import Errors, error_stats
from blobscript.reporting.rays import Rays
from blobscript.reporting.reference import Reference
from blobscript.reporting.timing import REPEATS, Timing, measure, once

if TYPE_CHECKING:
    from blobscript.scene import Normals, Scene

__all__ = ["NormalResult", "measure_normals"]

Array = NDArray[np.float64]

_STEPS = tuple(10.0**-k for k in range(1, 14))
_QUICK = _STEPS[1::3]
#: Processor seconds that one run may take before it is timed on fewer rays.
_TIMED = 0.05


@dataclass(frozen=True, slots=True)
class NormalResult:
    """step: in units (0: analytic). errors: angles in radians. time: of the whole trace, per picture ray."""

    normals: Normals
    step: float
    errors: Errors
    time: Timing


def measure_normals(
    scene: Scene,
    rays: Rays,
    reference: Reference,
    unit: float,
    quick: bool,
    progress: Callable[[int, int], None] | None = None,
) -> list[NormalResult]:
    """Against the gradient of the NumPy reference at the certified hits of the picture's rays. Left out are hits
    on a crease of the field, where a step of 1e-7 units turns the normal by more than 1e-3."""
    origins, directions = rays.origins[: rays.picture], rays.directions[: rays.picture]
    seconds = once(lambda: scene.first_hit(origins, directions, threads=1))
    every = max(round(seconds / _TIMED), 1)
    timed = (np.ascontiguousarray(origins[::every]), np.ascontiguousarray(directions[::every]))
    exact, good = _exact_normals(scene, rays, reference, unit)
    steps = _QUICK if quick else _STEPS
    ways: list[tuple[Normals, float]] = [("analytic", 0.0)]
    for step in steps:
        ways.append(("forward", step))
        ways.append(("central", step))
    runs: dict[str, Callable[[], object]] = {}
    errors: list[Errors] = []
    for number, (normals, step) in enumerate(ways):

        def run(normals: Normals = normals, step: float = step) -> object:
            length = step * unit if step else None
            return scene.first_hit(*timed, normals=normals, normal_step=length, threads=1)

        found = scene.first_hit(
            origins[good], directions[good], normals=normals, normal_step=step * unit if step else None, threads=1
        )
        both = found.hit
        errors.append(error_stats(_angle(found.normal[both], exact[both])))
        runs[str(number)] = run
    times = measure(runs, REPEATS, rays.seed, progress)
    return [
        NormalResult(normals, step, errors[i], times[str(i)].per(len(timed[0])))
        for i, (normals, step) in enumerate(ways)
    ]


def _exact_normals(scene: Scene, rays: Rays, reference: Reference, unit: float) -> tuple[Array, NDArray[np.int64]]:
    """Unit normals (m, 3) at the certified hits that are no creases, and the numbers of their rays (m,)."""
    rows = np.flatnonzero(reference.hit[: rays.picture] & reference.stable[: rays.picture])
    at = rays.origins[rows] + reference.t[rows, None] * rays.directions[rows]
    surfaces = reference.surface[rows]
    normal, moved = (_gradients(scene, at + shift, surfaces) for shift in (0.0, 1e-7 * unit / np.sqrt(3.0)))
    with np.errstate(invalid="ignore"):
        smooth = _angle(normal, moved) < 1e-3
    return normal[smooth], rows[smooth]


def _gradients(scene: Scene, at: Array, surfaces: NDArray[np.int32]) -> Array:
    """Unit outward normals."""
    result = np.zeros_like(at)
    for number, surface in enumerate(scene.ir.surfaces):
        rows = np.flatnonzero(surfaces == number)
        if len(rows):
            slope = field.gradient(surface.field, at[rows])
            with np.errstate(invalid="ignore", divide="ignore"):
                result[rows] = -slope / np.linalg.norm(slope, axis=1, keepdims=True)
    return result


def _angle(a: Array, b: Array) -> Array:
    """Between unit vectors, exact for small angles too."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
