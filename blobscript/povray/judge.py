"""Who is right where the two renderers differ: the certified reference says, ray by ray."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.povray.text import Array

__all__ = ["Verdict", "can_judge", "judged"]


@dataclass(frozen=True, slots=True)
class Verdict:
    """One pixel. Distances along the ray, inf for none: the exact one, ours, POV-Ray's. doubt: what the rounding of
    double precision may cost there; stable: whether it leaves it a hit (or a miss) at all."""

    x: int
    y: int
    exact: float
    ours: float
    theirs: float
    doubt: float
    stable: bool

    @property
    def our_error(self) -> float:
        return _error(self.exact, self.ours)

    @property
    def their_error(self) -> float:
        return _error(self.exact, self.theirs)

    def we_are_off(self, tolerance: float) -> bool:
        return self.stable and self.our_error > max(tolerance, self.doubt)


def _error(exact: float, found: float) -> float:
    """0 where both miss, inf where one does."""
    return 0.0 if exact == found else abs(exact - found)


def can_judge() -> bool:
    from importlib.util import find_spec

    return find_spec("flint") is not None


def judged(
    scene: ir.Scene,
    pixels: NDArray[np.int64],
    rays: tuple[Array, Array],
    ours: Array,
    theirs: Array,
    seconds: float,
) -> list[Verdict]:
    """Verdicts on some pixels (row-major numbers), as many as there is time for. rays: as `framing.view_rays`."""
    from blobscript.certified import UndecidedError, certain_hit

    eye, directions = rays
    width = directions.shape[1]
    found: list[Verdict] = []
    end = time.monotonic() + seconds
    for pixel in pixels.tolist():
        if time.monotonic() > end:
            break
        y, x = divmod(pixel, width)
        try:
            answer = certain_hit(scene, eye, directions[y, x])
        except UndecidedError:
            continue
        exact = answer.distance if answer.status == "hit" else math.inf
        found.append(Verdict(x, y, exact, float(ours[pixel]), float(theirs[pixel]), answer.tolerance, answer.stable))
    return found
