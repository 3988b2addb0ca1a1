"""The smooth maximum of densities: what `smooth_max` does, in NumPy.

With f_i+ = max(f_i, 0) and m = SHARPNESS it is the mean of the densities, each weighted by its own m-th power
(Lehmer's mean; as weights w_i = f_i^m / sum of all f^m it is a partition of unity):

    L = sum f_i+^(m + 1) / sum f_i+^m,    0 where no density is positive

A mean is never above the largest: nothing bulges, wherever and however many meet. Where one density is alone, or
all are equal, L is that density. Everywhere else it is smooth wherever the densities are, so the crease of the
maximum is rounded; what that takes away is at most 0.278 / m of the density (two equal rods end to end: 3.5 %).
`smooth_min` is its mirror image, -smooth_max(-f), which `smooth_max` becomes under a negative factor.

Densities are scaled by the largest before they are raised, so nothing overflows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["SHARPNESS", "STEEPER", "SmoothMax", "smooth_max", "smooth_max_range"]

#: m above. ORDER SHARPNESS: the same number in tracer/joint.h.
SHARPNESS = 8

#: |grad L| <= STEEPER * sum of |grad f_i|: dL/df_i = w_i (1 + m (1 - L / f_i)), and L >= w_i f_i, so it is at most
#: w (1 + m (1 - w)) <= (m + 1)^2 / (4 m); it is nowhere below -((m - 1) / m)^(m - 1).
STEEPER = (SHARPNESS + 1) ** 2 / (4.0 * SHARPNESS)

Array = NDArray[np.float64]

_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class SmoothMax:
    """Of k densities at n places: `value` (n,), `shares` w (k, n) that sum to 1 or are all 0, `rates` dL/df (k, n)."""

    value: Array
    shares: Array
    rates: Array


def smooth_max(values: Array) -> SmoothMax:
    """values: (k, n), k >= 1."""
    positive = np.maximum(values, 0.0)
    top = positive.max(axis=0)
    x = positive / np.where(top > 0.0, top, 1.0)
    power = x ** (SHARPNESS - 1)
    weight = power * x
    total = np.where(top > 0.0, weight.sum(axis=0), 1.0)
    mean = (weight * x).sum(axis=0) / total
    rates = power * ((SHARPNESS + 1) * x - SHARPNESS * mean) / total
    return SmoothMax(top * mean, weight / total, rates)


def smooth_max_range(low: Array, high: Array) -> tuple[Array, Array]:
    """An enclosure of L for densities anywhere in [low, high], (k, n) each, rounding included.

    With shares of at least w_i, L is at least the sum of w_i low_i, and at most that of w_i high_i with what is
    left to 1 given to the largest.
    """
    low, high = np.maximum(low, 0.0), np.maximum(high, 0.0)
    top = high.max(axis=0)
    scale = np.where(top > 0.0, top, 1.0)
    least, most = (low / scale) ** SHARPNESS, (high / scale) ** SHARPNESS
    total = most.sum(axis=0)
    rest = np.maximum(total - most, 0.0) + 4.0 * _EPS * len(low) * total  # the difference may cancel
    shares = least / np.where(least > 0.0, least + rest, 1.0) * (1.0 - 64.0 * _EPS * len(low))
    left = np.maximum(1.0 - shares.sum(axis=0), 0.0)
    slack = 64.0 * _EPS * top
    return np.maximum((shares * low).sum(axis=0) - slack, 0.0), (shares * high).sum(axis=0) + left * top + slack
