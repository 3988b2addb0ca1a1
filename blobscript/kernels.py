"""The kernels: density D as a function of s = r^2 = (distance / reach)^2, 1 at 0 and 0 from s = 1 on.

One row of `KERNELS` per built-in kernel, and the same functions for user kernels, which come as
polynomial pieces (`ir.KernelPiece`, made by `proof`). Everything is written in u = 1 - s, so that
values and slopes keep their relative accuracy up to the rim where they vanish, and inverses go
through expm1, log1p or Newton steps, so that they keep it up to the centre, too.

The invariant that the tracer's bounds stand on: every built-in kernel, continued by 0, falls and
is convex as a function of s. A user kernel is monotone, and convex or concave in s, on each piece.

With p(x) = 1 - (1 + x) e^-x and q(x) = 2 p(x) / x^2 (q(0) = 1) the compensated Gaussian is

    gauss_c1 = (e^(-a s) - e^-a (1 + a u)) / (1 - e^-a (1 + a)) = u^2 e^(-a s) q(a u) / q(a),

which neither cancels near the rim nor for a -> 0 (where it becomes soft2).
Sources: Blinn 1982 (gauss); Nishimura et al. 1985 (metaball); Wyvill et al. 1986 (wyvill).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blobscript.ir import Kernel, KernelPiece

__all__ = [
    "KERNELS",
    "KernelRow",
    "curvature",
    "cut",
    "inverse",
    "is_signed",
    "lipschitz",
    "peak",
    "slope",
    "slope_range",
    "support",
    "value",
    "value_range",
]

Array = NDArray[np.float64]

_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class KernelRow:
    """A built-in kernel; `a` is ignored by all but the Gaussians (`has_parameter`).

    value, slope: D and dD/ds at s >= 0. inverse: the r with D(r) = tau for 0 < tau <= 1.
    lipschitz: max |dD/dr|. curvature: max |d^2 D / dt^2| reach^2 along any line. support: the r
    from which on D is 0.
    """

    name: str
    value: Callable[[Array, float], Array]
    slope: Callable[[Array, float], Array]
    inverse: Callable[[Array, float], Array]
    lipschitz: Callable[[float], float]
    curvature: Callable[[float], float]
    support: float = 1.0
    has_parameter: bool = False


# ---- soft2, soft3, wyvill, metaball ------------------------------------------------------


def _rim(s: Array) -> Array:
    """u = 1 - s, 0 outside."""
    return np.maximum(1.0 - s, 0.0)


def _soft2(s: Array, _a: float) -> Array:
    return _rim(s) ** 2


def _soft2_slope(s: Array, _a: float) -> Array:
    return -2.0 * _rim(s)


def _soft2_inverse(tau: Array, _a: float) -> Array:
    return np.sqrt((1.0 - tau) / (1.0 + np.sqrt(tau)))


def _soft3(s: Array, _a: float) -> Array:
    u = _rim(s)
    return u * u * u


def _soft3_slope(s: Array, _a: float) -> Array:
    return -3.0 * _rim(s) ** 2


def _soft3_inverse(tau: Array, _a: float) -> Array:
    return np.sqrt(-np.expm1(np.log(tau) / 3.0))


def _wyvill(s: Array, _a: float) -> Array:
    u = _rim(s)
    return u * u * (5.0 + 4.0 * u) / 9.0


def _wyvill_slope(s: Array, _a: float) -> Array:
    u = _rim(s)
    return -(2.0 / 9.0) * u * (5.0 + 6.0 * u)


def _wyvill_lipschitz(_a: float) -> float:
    s = (51.0 - math.sqrt(1281.0)) / 60.0
    return 4.0 / 9.0 * math.sqrt(s) * (1.0 - s) * (11.0 - 6.0 * s)


def _wyvill_inverse(tau: Array, _a: float) -> Array:
    """Newton on the side that keeps the relative accuracy: u^2 (5 + 4u) = 9 tau near the rim,
    22 s - 17 s^2 + 4 s^3 = 9 (1 - tau) near the centre. Both start where it converges monotonely."""
    delta = 9.0 * (1.0 - tau)
    s = delta / 22.0
    u = np.minimum(np.sqrt(1.8 * tau), 1.0)
    for _ in range(9):
        s = s + (delta - s * (22.0 - s * (17.0 - 4.0 * s))) / (22.0 - s * (34.0 - 12.0 * s))
        u = u - (u * u * (5.0 + 4.0 * u) - 9.0 * tau) / np.maximum(u * (10.0 + 12.0 * u), 1e-300)
    return np.sqrt(np.where(tau > 0.5, s, 1.0 - u))


def _metaball(s: Array, _a: float) -> Array:
    r = np.sqrt(s)
    outer = 1.5 * (_rim(s) / (1.0 + r)) ** 2
    return np.where(s < 1.0 / 9.0, 1.0 - 3.0 * s, outer)


def _metaball_slope(s: Array, _a: float) -> Array:
    inner = s < 1.0 / 9.0
    r = np.sqrt(np.where(inner, 1.0, s))
    return np.where(inner, -3.0, -1.5 * _rim(s) / (r * (1.0 + r)))


def _metaball_inverse(tau: Array, _a: float) -> Array:
    outer = 1.0 - np.sqrt(np.minimum(tau, 1.0) / 1.5)
    return np.where(tau > 2.0 / 3.0, np.sqrt(np.maximum(1.0 - tau, 0.0) / 3.0), outer)


# ---- gauss -------------------------------------------------------------------------------


def _gauss(s: Array, a: float) -> Array:
    return np.exp(-a * s)


def _gauss_slope(s: Array, a: float) -> Array:
    return -a * np.exp(-a * s)


def _gauss_inverse(tau: Array, a: float) -> Array:
    return np.sqrt(-np.log(tau) / a)


# ---- gauss_c1 ----------------------------------------------------------------------------


def _series(x: Array, sign: float) -> Array:
    """2 (e^y - 1 - y) / y^2 with y = sign x, for 0 <= x <= 1: sum of 2 y^k / (k + 2)!."""
    total = np.ones_like(x)
    for k in range(19, 2, -1):
        total = 1.0 + sign * x * total / k
    return total


def _q(x: Array) -> Array:
    """2 (1 - (1 + x) e^-x) / x^2, 1 at 0; see the head of this file."""
    small = np.minimum(x, 1.0)
    large = np.maximum(x, 1.0)
    series = _series(small, 1.0) * np.exp(-small)
    return np.where(x < 1.0, series, 2.0 * (1.0 - (1.0 + large) * np.exp(-large)) / large / large)


def _k(y: Array) -> Array:
    """2 (e^-y - 1 + y) / y^2, 1 at 0."""
    large = np.maximum(y, 1.0)
    return np.where(y < 1.0, _series(np.minimum(y, 1.0), -1.0), 2.0 * (np.expm1(-large) + large) / large / large)


def _e(x: Array) -> Array:
    """(1 - e^-x) / x, 1 at 0."""
    return np.where(x > 0.0, -np.expm1(-x) / np.where(x > 0.0, x, 1.0), 1.0)


def _gauss_c1(s: Array, a: float) -> Array:
    u = _rim(s)
    return u * u * np.exp(-a * np.minimum(s, 1.0)) * (_q(a * u) / _q(np.asarray(a)))


def _gauss_c1_slope(s: Array, a: float) -> Array:
    u = _rim(s)
    return -2.0 * u * np.exp(-a * np.minimum(s, 1.0)) * (_e(a * u) / _q(np.asarray(a)))


def _gauss_c1_inverse(tau: Array, a: float) -> Array:
    return np.sqrt(np.where(tau > 0.5, _gauss_c1_inverse_centre(tau, a), _gauss_c1_inverse_rim(tau, a)))


def _gauss_c1_inverse_centre(tau: Array, a: float) -> Array:
    """s for tau > 1/2: Newton on 1 - D = s (2 E(a) - s K(a s)) / q(a), concave and rising in s."""
    delta = 1.0 - np.maximum(tau, 0.5)
    e, q = _e(np.asarray(a)), _q(np.asarray(a))
    s = delta * q / (2.0 * e)
    for _ in range(12):
        rest = delta - s * (2.0 * e - s * _k(a * s)) / q
        s = np.minimum(s - rest / _gauss_c1_slope(s, a), 1.0)
    return s


def _gauss_c1_inverse_rim(tau: Array, a: float) -> Array:
    """s for tau <= 1/2: Newton on log D in v = log u, convex and rising, from u = 1; then one
    step in s, which restores the relative accuracy of s where u is near 1."""
    target = np.log(np.minimum(tau, 0.5))
    q_a = _q(np.asarray(a))
    v = np.zeros_like(tau)
    for _ in range(40):
        u = np.exp(v)
        s = -np.expm1(v)
        q = _q(a * u)
        rest = 2.0 * v + np.log(q / q_a) - a * s - target
        v = v - rest / (2.0 * _e(a * u) / q)
        if np.all(np.abs(rest) < 1e-13 * (1.0 + np.abs(target))):
            break
    s = -np.expm1(v)
    u = np.maximum(1.0 - s, 0.01)
    q = _q(a * u)
    rest = np.log(u * (u * q / q_a)) - a * s - target
    return np.where(s < 0.99, s + rest * q * u / (2.0 * _e(a * u)), s)


@lru_cache(maxsize=256)
def _gauss_c1_lipschitz(a: float) -> float:
    """|dD/dr| = 2 r |D_s| is largest where 2 a s = 1 - e^(-a u): bisection on s in [0, 1/2]."""
    lo, hi = 0.0, 0.5
    for _ in range(80):
        s = 0.5 * (lo + hi)
        lo, hi = (s, hi) if 2.0 * s < (1.0 - s) * float(_e(np.asarray(a * (1.0 - s)))) else (lo, s)
    s_max = np.asarray(0.5 * (lo + hi))
    return float(-2.0 * np.sqrt(s_max) * _gauss_c1_slope(s_max, a)) * (1.0 + 1e-12)


def _gauss_c1_curvature(a: float) -> float:
    """d^2 D/dr^2 = 2 D_s + 4 s D_ss = 4 ((2 a s - 1) e^(-a s) + e^-a) / (a q(a)); its extrema lie
    at s = 0 and at a s = 3/2 (or s = 1). For a line, the value lies between that and 2 D_s."""
    q = float(_q(np.asarray(a)))
    s = min(1.0, 1.5 / a)
    highest = 4.0 * math.exp(-a * s) * (2.0 * s - (1.0 - s) * float(_e(np.asarray(a * (1.0 - s))))) / q
    return max(4.0 * float(_e(np.asarray(a))) / q, highest) * (1.0 + 1e-12)


def _constant(number: float) -> Callable[[float], float]:
    return lambda _a: number


#: ORDER kernel: name -> row; pack.py and the tracer number the kernels in this order.
KERNELS: dict[str, KernelRow] = {
    row.name: row
    for row in (
        KernelRow("soft2", _soft2, _soft2_slope, _soft2_inverse, _constant(8.0 / math.sqrt(27.0)), _constant(8.0)),
        KernelRow("soft3", _soft3, _soft3_slope, _soft3_inverse, _constant(96.0 / math.sqrt(3125.0)), _constant(6.0)),
        KernelRow("wyvill", _wyvill, _wyvill_slope, _wyvill_inverse, _wyvill_lipschitz, _constant(44.0 / 9.0)),
        KernelRow(
            "gauss",
            _gauss,
            _gauss_slope,
            _gauss_inverse,
            lambda a: math.sqrt(2.0 * a / math.e),
            lambda a: 2.0 * a,
            support=math.inf,
            has_parameter=True,
        ),
        KernelRow(
            "gauss_c1",
            _gauss_c1,
            _gauss_c1_slope,
            _gauss_c1_inverse,
            _gauss_c1_lipschitz,
            _gauss_c1_curvature,
            has_parameter=True,
        ),
        KernelRow("metaball", _metaball, _metaball_slope, _metaball_inverse, _constant(2.0), _constant(6.0)),
    )
}


# ---- user kernels: polynomial pieces --------------------------------------------------------


def _polynomial(piece: KernelPiece, r: Array, s: Array) -> tuple[Array, Array]:
    """Value and derivative with respect to the piece's own variable x."""
    x = ((s if piece.variable == "s" else r) - piece.centre) / piece.half
    total = np.zeros_like(x)
    derivative = np.zeros_like(x)
    for c in reversed(piece.coefficients):
        derivative = derivative * x + total
        total = total * x + c
    return total, derivative


def _piece_slope(piece: KernelPiece, r: Array, s: Array) -> Array:
    """dD/ds on a piece; -inf or +inf at r = 0 where D has a crease at the skeleton."""
    if piece.variable == "s":
        return _polynomial(piece, r, s)[1] / piece.half
    if piece.centre == 0.0:
        return _slope_from_zero(piece, r)
    with np.errstate(divide="ignore", invalid="ignore"):
        return _polynomial(piece, r, s)[1] / (piece.half * 2.0 * r)


def _slope_from_zero(piece: KernelPiece, r: Array) -> Array:
    """D'(r) / (2 r) for a piece in x = r / half, without the division where it cancels."""
    x = r / piece.half
    total = np.zeros_like(x)
    for k in range(len(piece.coefficients) - 1, 1, -1):
        total = total * x + k * piece.coefficients[k]
    total = total / (2.0 * piece.half**2)
    first = piece.coefficients[1] if len(piece.coefficients) > 1 else 0.0
    if first == 0.0:
        return total
    with np.errstate(divide="ignore"):
        return total + first / (2.0 * piece.half * r)


def _piecewise(kernel: Kernel, s: Array, of_piece: Callable[[KernelPiece, Array, Array], Array]) -> Array:
    """`of_piece` where a piece holds (the inner one at joints), 0 from r = 1 on."""
    r = np.sqrt(s)
    result = np.zeros_like(s)
    last = len(kernel.pieces) - 1
    lower = -1.0
    for i, piece in enumerate(kernel.pieces):
        here = (r > lower) & ((r < 1.0) if i == last else (r <= piece.r_hi))
        if here.any():
            result[here] = of_piece(piece, r[here], s[here])
        lower = piece.r_hi
    return result


def _piece_inverse(kernel: Kernel, tau: Array) -> Array:
    """The largest r with D(r) = tau: bisection on the outermost monotone piece that has it."""
    result = np.full(tau.shape, np.nan)
    for piece in kernel.pieces:  # outer pieces overwrite inner ones
        ends = np.array([piece.r_lo, piece.r_hi])
        at_lo, at_hi = _polynomial(piece, ends, ends * ends)[0]
        here = (tau >= min(at_lo, at_hi)) & (tau <= max(at_lo, at_hi))
        if here.any():
            found = _bisect(piece, tau[here], at_lo > at_hi)
            result[here] = np.where(tau[here] == at_hi, piece.r_hi, np.where(tau[here] == at_lo, piece.r_lo, found))
    return np.where(tau == 0.0, np.where(np.isnan(result), 1.0, np.fmax(result, 0.0)), result)


def _bisect(piece: KernelPiece, tau: Array, falls: bool) -> Array:
    lo = np.full(tau.shape, piece.r_lo)
    hi = np.full(tau.shape, piece.r_hi)
    for _ in range(60):
        r = 0.5 * (lo + hi)
        above = _polynomial(piece, r, r * r)[0] > tau
        outward = above if falls else ~above
        lo, hi = np.where(outward, r, lo), np.where(outward, hi, r)
    return 0.5 * (lo + hi)


# ---- the same questions to any kernel --------------------------------------------------------


def value(kernel: Kernel, s: ArrayLike) -> Array:
    """D at s = (distance / reach)^2."""
    s = np.asarray(s, dtype=np.float64)
    if kernel.pieces:
        return _piecewise(kernel, s, lambda piece, r, s: _polynomial(piece, r, s)[0])
    return KERNELS[kernel.name].value(s, kernel.a)


def slope(kernel: Kernel, s: ArrayLike) -> Array:
    """dD/ds at s; where D has a joint, that of the inner side for user kernels, outside 0."""
    s = np.asarray(s, dtype=np.float64)
    if kernel.pieces:
        return _piecewise(kernel, s, _piece_slope)
    return KERNELS[kernel.name].slope(s, kernel.a)


def inverse(kernel: Kernel, tau: ArrayLike) -> Array:
    """The largest r with D(r) = tau; the support for tau = 0, NaN where there is none."""
    tau = np.asarray(tau, dtype=np.float64)
    if kernel.pieces:
        return _piece_inverse(kernel, np.atleast_1d(tau)).reshape(tau.shape)
    row = KERNELS[kernel.name]
    good = (tau > 0.0) & (tau <= 1.0)
    r = row.inverse(np.where(good, tau, 1.0), kernel.a)
    return np.where(good, r, np.where(tau == 0.0, row.support, np.nan))


def lipschitz(kernel: Kernel) -> float:
    """max |dD/dr|."""
    return kernel.lipschitz if kernel.pieces else KERNELS[kernel.name].lipschitz(kernel.a)


def curvature(kernel: Kernel) -> float:
    """A bound on |d^2 D / dt^2| reach^2 along any line, between joints (inf with a crease at r = 0)."""
    if not kernel.pieces:
        return KERNELS[kernel.name].curvature(kernel.a)
    return max(_piece_curvature(piece) for piece in kernel.pieces)


def _piece_curvature(piece: KernelPiece) -> float:
    """max over 64 subintervals of 2 |D_s| + 4 s |D_ss|, by interval sums of |coefficients|."""
    x_ends = np.linspace(piece.r_lo, piece.r_hi, 65)
    bound = 0.0
    for lo, hi in pairwise(x_ends):
        bound = max(bound, _curvature_on(piece, float(lo), float(hi)))
    return bound


def _curvature_on(piece: KernelPiece, lo: float, hi: float) -> float:
    first, second = _derivative_bounds(piece, lo, hi)
    if piece.variable == "s":  # D_s = first, D_ss = second
        return 2.0 * first + 4.0 * hi * hi * second
    if lo > 0.0:  # between D'/r and D''
        return max(first / lo, second)
    if len(piece.coefficients) > 1 and (piece.centre != 0.0 or piece.coefficients[1] != 0.0):
        return math.inf
    return second  # |D'(r) / r| <= max |D''| where D'(0) = 0


def _derivative_bounds(piece: KernelPiece, lo: float, hi: float) -> tuple[float, float]:
    """max |p'|, max |p''| with respect to the variable itself, by Taylor sums about the middle."""
    ends = np.array([lo, hi]) if piece.variable == "r" else np.array([lo * lo, hi * hi])
    middle, width = float(ends.mean()), float(ends[1] - ends[0]) / 2.0
    x, h = (middle - piece.centre) / piece.half, width / piece.half
    taylor = np.polynomial.Polynomial(piece.coefficients)(np.polynomial.Polynomial([x, 1.0])).coef
    powers = h ** np.arange(len(taylor))
    k = np.arange(len(taylor))
    with np.errstate(divide="ignore", invalid="ignore"):
        first = float(np.sum(np.abs(taylor[1:]) * k[1:] * powers[:-1])) / piece.half
        second = float(np.sum(np.abs(taylor[2:]) * (k * (k - 1))[2:] * powers[: max(len(k) - 2, 0)])) / piece.half**2
    return first, second


def support(kernel: Kernel) -> float:
    """The r from which on D is exactly 0 (inf for gauss)."""
    return 1.0 if kernel.pieces else KERNELS[kernel.name].support


def cut(kernel: Kernel, epsilon: float) -> float:
    """An r outside which D <= epsilon: the support, or where the Gaussian has fallen so far."""
    if math.isfinite(support(kernel)):
        return support(kernel)
    return math.sqrt(max(-math.log(epsilon), 0.0) / kernel.a) * (1.0 + 4.0 * _EPS)


def peak(kernel: Kernel) -> tuple[float, float]:
    """Bounds on D over all r: [0, 1] for every kernel but waived ones."""
    lo, hi = value_range(kernel, np.zeros(1), np.full(1, 4.0))
    return float(lo[0]), float(hi[0])


def is_signed(kernel: Kernel) -> bool:
    """May D be below 0 somewhere? Only a kernel of the script that need not fall may."""
    return not kernel.falls and peak(kernel)[0] < 0.0


def value_range(kernel: Kernel, s_lo: ArrayLike, s_hi: ArrayLike) -> tuple[Array, Array]:
    """An enclosure of D over s_lo <= s <= s_hi, widened by the rounding of its evaluation."""
    s_lo, s_hi = np.asarray(s_lo, dtype=np.float64), np.asarray(s_hi, dtype=np.float64)
    if kernel.pieces:
        return _pieces_range(kernel, s_lo, s_hi)
    row = KERNELS[kernel.name]
    # exp(-a s) has relative error a s eps from the product; value 0 means underflow below 1e-300
    with np.errstate(over="ignore", invalid="ignore"):
        slack = 16.0 * _EPS * (1.0 + (kernel.a * s_hi if row.has_parameter else 0.0))
        lo = row.value(s_hi, kernel.a) * np.maximum(1.0 - slack, 0.0)
    slack_lo = 16.0 * _EPS * (1.0 + (kernel.a * s_lo if row.has_parameter else 0.0))
    hi = row.value(s_lo, kernel.a) * (1.0 + np.minimum(slack_lo, 1.0))
    tail = 1e-290 if row.support == math.inf else 0.0
    return np.where(np.isnan(lo), 0.0, lo), hi + tail


def _rounding(piece: KernelPiece) -> float:
    """Bounds the rounding of Horner's scheme and of x, whose error grows with 1 / half."""
    n = len(piece.coefficients)
    return 4.0 * _EPS * n * (2.0 + 1.0 / piece.half) * sum(map(abs, piece.coefficients))


def _pieces_range(kernel: Kernel, s_lo: Array, s_hi: Array) -> tuple[Array, Array]:
    r_lo, r_hi = np.sqrt(s_lo), np.sqrt(s_hi)
    outside = s_hi >= 1.0
    lo = np.where(outside, 0.0, np.inf)
    hi = np.where(outside, 0.0, -np.inf)
    for piece in kernel.pieces:
        here = (r_hi >= piece.r_lo) & (r_lo <= piece.r_hi)
        for r in (np.clip(r_lo, piece.r_lo, piece.r_hi), np.clip(r_hi, piece.r_lo, piece.r_hi)):
            d = _polynomial(piece, r, r * r)[0]
            slack = kernel.error + _rounding(piece)
            lo = np.where(here, np.minimum(lo, d - slack), lo)
            hi = np.where(here, np.maximum(hi, d + slack), hi)
    return lo, hi


def slope_range(kernel: Kernel, s_lo: ArrayLike, s_hi: ArrayLike) -> tuple[Array, Array]:
    """An enclosure of dD/ds over s_lo <= s <= s_hi, joints included; infinite at s = 0 where D has a
    crease there. The slope of every piece is monotone in s, so its ends enclose it."""
    s_lo, s_hi = np.asarray(s_lo, dtype=np.float64), np.asarray(s_hi, dtype=np.float64)
    if kernel.pieces:
        return _pieces_slope_range(kernel, s_lo, s_hi)
    row = KERNELS[kernel.name]
    with np.errstate(over="ignore", invalid="ignore"):
        slack = 64.0 * _EPS * (1.0 + (kernel.a * s_lo if row.has_parameter else 0.0))
        steep = row.slope(s_lo, kernel.a) * (1.0 + slack)
        flat = row.slope(s_hi, kernel.a) * np.maximum(1.0 - 64.0 * _EPS * (1.0 + kernel.a * s_hi), 0.0)
    tail = 1e-290 if row.support == math.inf else 0.0
    return np.nan_to_num(steep, nan=0.0) - tail, np.nan_to_num(flat, nan=0.0)


def _pieces_slope_range(kernel: Kernel, s_lo: Array, s_hi: Array) -> tuple[Array, Array]:
    r_lo, r_hi = np.sqrt(s_lo), np.sqrt(s_hi)
    lo, hi = (np.where(s_hi >= 1.0, 0.0, end) for end in (np.inf, -np.inf))
    for piece in kernel.pieces:
        here = (r_hi >= piece.r_lo) & (r_lo <= piece.r_hi)
        # rounding of Horner's scheme for the derivative, whose terms are k times larger
        slack = 8.0 * len(piece.coefficients) * _rounding(piece) / piece.half
        for r in (np.clip(r_lo, piece.r_lo, piece.r_hi), np.clip(r_hi, piece.r_lo, piece.r_hi)):
            d = _piece_slope(piece, r, r * r)
            with np.errstate(divide="ignore"):
                room = slack * (1.0 if piece.variable == "s" else np.where(r > 0.0, 1.0 + 0.5 / r, 1.0))
            lo = np.where(here, np.minimum(lo, d - room), lo)
            hi = np.where(here, np.maximum(hi, d + room), hi)
    return lo, hi
