"""Interval arithmetic for proofs: pairs of integers (lo, hi), in units of 2^-BITS, and Taylor series.

Every operation rounds outward, so the true value lies between. A series is a list of Taylor
coefficients c[0..n] about a place, or, if the place is an interval, enclosures of them for every
place in it; c[k] over [a, b] then bounds the remainder of the series of length k about any place
in [a, b] (automatic differentiation; Moore 1979, "Methods and Applications of Interval Analysis").
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from math import isqrt

__all__ = [
    "BITS",
    "Interval",
    "Series",
    "UndefinedError",
    "arctangent",
    "constant",
    "cosine_sine",
    "exponential",
    "from_fraction",
    "half_turn",
    "joined",
    "logarithm",
    "magnitude",
    "middle",
    "minus",
    "over",
    "plus",
    "power_of",
    "quotient",
    "series_arcsin",
    "series_arctan",
    "series_cos_sin",
    "series_exp",
    "series_log",
    "series_power",
    "series_product",
    "series_quotient",
    "series_scale",
    "series_sum",
    "times",
    "to_fraction",
    "variable",
]

BITS = 160
_GUARD = 40
_ONE = 1 << BITS

Interval = tuple[int, int]
Series = list[Interval]


class UndefinedError(ArithmeticError):
    """A function outside the range where it, or its derivative, is defined."""


def from_fraction(x: Fraction) -> Interval:
    scaled = x.numerator << BITS
    lo = scaled // x.denominator
    return lo, lo if lo * x.denominator == scaled else lo + 1


def over(lo: Fraction, hi: Fraction) -> Interval:
    return from_fraction(lo)[0], from_fraction(hi)[1]


def to_fraction(x: int) -> Fraction:
    return Fraction(x, _ONE)


def middle(x: Interval) -> Fraction:
    return Fraction(x[0] + x[1], 2 * _ONE)


def magnitude(x: Interval) -> int:
    """The largest size, in units of 2^-BITS."""
    return max(-x[0], x[1])


def joined(x: Interval, y: Interval) -> Interval:
    return min(x[0], y[0]), max(x[1], y[1])


def plus(x: Interval, y: Interval) -> Interval:
    return x[0] + y[0], x[1] + y[1]


def minus(x: Interval, y: Interval) -> Interval:
    return x[0] - y[1], x[1] - y[0]


def times(x: Interval, y: Interval) -> Interval:
    if x[0] >= 0 and y[0] >= 0:
        lo, hi = x[0] * y[0], x[1] * y[1]
    else:
        ends = (x[0] * y[0], x[0] * y[1], x[1] * y[0], x[1] * y[1])
        lo, hi = min(ends), max(ends)
    return lo >> BITS, -((-hi) >> BITS)


def quotient(x: Interval, y: Interval) -> Interval:
    if y[0] <= 0 <= y[1]:
        raise UndefinedError("a division by 0")
    ends = [(a << BITS, b) for a in x for b in y]
    return min(a // b for a, b in ends), max(-((-a) // b) for a, b in ends)


# ---- constants ----------------------------------------------------------------------------------


def _arctan_inverse(n: int, bits: int) -> int:
    """arctan(1 / n) in units of 2^-bits, good to a few units."""
    term = (1 << bits) // n
    total, k, square = term, 1, n * n
    while term not in (0, -1):
        term = -term // square
        k += 2
        total += term // k
    return total


@lru_cache(maxsize=1)
def _pi(bits: int = BITS + _GUARD) -> int:
    """Machin 1706: pi / 4 = 4 arctan(1/5) - arctan(1/239)."""
    return (4 * _arctan_inverse(5, bits + 10) - _arctan_inverse(239, bits + 10)) >> 8


@lru_cache(maxsize=1)
def _ln2(bits: int = BITS + _GUARD) -> int:
    """2 artanh(1/3)."""
    bits += 10
    power, total, k = (1 << bits) // 3, 0, 1
    while power:
        total += power // k
        power //= 9
        k += 2
    return total >> 9


def half_turn() -> Interval:
    """pi."""
    return _rounded(_pi())


def _rounded(x: int, slack: int = 1 << (_GUARD // 2)) -> Interval:
    """From guarded units, good to `slack` of them, outward to an interval."""
    return (x - slack) >> _GUARD, -((-(x + slack)) >> _GUARD)


# ---- functions at one place, in guarded units -------------------------------------------------------

_WIDE = BITS + _GUARD


def _exp_at(x: int) -> Interval:
    """x in units of 2^-BITS: e^x by halving the argument eight times after taking out powers of 2."""
    wide = x << _GUARD
    k = (wide + _ln2() // 2) // _ln2()
    r = (wide - k * _ln2()) >> 8
    total = term = 1 << _WIDE
    n = 1
    while term:
        term = ((term * r) >> _WIDE) // n
        total += term
        n += 1
        if n > 60:
            break
    for _ in range(8):
        total = (total * total) >> _WIDE
    slack = (1 << 20) + abs(k)
    if k >= 0:
        return _rounded(total << k, slack << k)
    return _rounded(total >> -k, slack)


def _log_at(x: int) -> Interval:
    """x > 0: log(m 2^e) = e log 2 + 2 artanh((m - 1) / (m + 1)), 2/3 <= m < 4/3."""
    e = x.bit_length() - 1 - BITS
    m = x << _GUARD
    m = m >> e if e >= 0 else m << -e
    if 3 * m > 4 << _WIDE:
        m, e = m >> 1, e + 1
    z = ((m - (1 << _WIDE)) << _WIDE) // (m + (1 << _WIDE))
    square, power, total, k = (z * z) >> _WIDE, z, 0, 1
    while power not in (0, -1):
        total += power // k
        power = (power * square) >> _WIDE
        k += 2
    return _rounded(2 * total + e * _ln2(), (1 << 16) + abs(e))


def _cos_sin_at(x: int) -> tuple[Interval, Interval]:
    """Taylor series after taking out quarter turns."""
    wide, quarter = x << _GUARD, _pi() >> 1
    n = (wide + quarter // 2) // quarter
    r = wide - n * quarter
    cosine = sine = 0
    term, k = 1 << _WIDE, 0
    while term not in (0, -1):
        if k % 2 == 0:
            cosine += term if k % 4 == 0 else -term
        else:
            sine += term if k % 4 == 1 else -term
        k += 1
        term = ((term * r) >> _WIDE) // k
    slack = (1 << 16) + 2 * abs(n)
    turned = ((cosine, sine), (-sine, cosine), (-cosine, -sine), (sine, -cosine))[n % 4]
    return _rounded(turned[0], slack), _rounded(turned[1], slack)


def _arctan_at(x: int) -> Interval:
    """Halves the angle four times, then Taylor: arctan x = 2 arctan(x / (1 + sqrt(1 + x^2)))."""
    wide = x << _GUARD
    for _ in range(4):
        root = isqrt((1 << (2 * _WIDE)) + wide * wide)
        wide = (wide << _WIDE) // ((1 << _WIDE) + root)
    square, power, total, k = (wide * wide) >> _WIDE, wide, 0, 1
    while power not in (0, -1):
        total += power // k if k % 4 == 1 else -(power // k)
        power = (power * square) >> _WIDE
        k += 2
    return _rounded(16 * total, 1 << 16)


# ---- functions of intervals ----------------------------------------------------------------------------


def exponential(x: Interval) -> Interval:
    if x[1] > 10000 << BITS:
        raise UndefinedError("exp of a very large number")
    low = max(x[0], -10000 << BITS)
    return max(_exp_at(low)[0], 0) if x[0] == low else 0, _exp_at(max(x[1], low))[1]


def logarithm(x: Interval) -> Interval:
    if x[0] <= 0:
        raise UndefinedError("the logarithm of a number that is not positive")
    return _log_at(x[0])[0], _log_at(x[1])[1]


def arctangent(x: Interval) -> Interval:
    return _arctan_at(x[0])[0], _arctan_at(x[1])[1]


def cosine_sine(x: Interval) -> tuple[Interval, Interval]:
    cosines, sines = zip(_cos_sin_at(x[0]), _cos_sin_at(x[1]), strict=True)
    quarter = _pi() >> 1
    first = -((-((x[0] << _GUARD) - 4)) // quarter)
    last = ((x[1] << _GUARD) + 4) // quarter
    cosine, sine = joined(*cosines), joined(*sines)
    for n in range(first, min(last, first + 3) + 1):  # quarter turns in between: extremes of one of them
        exact = (_ONE, _ONE) if n % 4 in (0, 1) else (-_ONE, -_ONE)
        cosine, sine = (joined(cosine, exact), sine) if n % 2 == 0 else (cosine, joined(sine, exact))
    return cosine, sine


def power_of(x: Interval, exponent: Fraction) -> Interval:
    """x^exponent for x >= 0, and 0^exponent = 0; the exponent is not a whole number. What is
    below 0 by no more than 2^-100 is taken for rounding."""
    if x[0] < 0 <= x[1] and x[0] >= -(1 << (BITS - 100)):
        x = 0, x[1]
    if x[0] < 0 or (x[0] == 0 and exponent < 0):
        raise UndefinedError("a fractional power of a negative number")
    if exponent == Fraction(1, 2):
        return isqrt(x[0] << BITS), isqrt(x[1] << BITS) + 1
    ends = [(0, 0) if v == 0 else exponential(times(from_fraction(exponent), _log_at(v))) for v in x]
    return (ends[0][0], ends[1][1]) if exponent > 0 else (ends[1][0], ends[0][1])


# ---- series -----------------------------------------------------------------------------------------------


def constant(x: Interval, order: int) -> Series:
    return [x] + [(0, 0)] * order


def variable(x: Interval, order: int) -> Series:
    return [x, (_ONE, _ONE)] + [(0, 0)] * (order - 1) if order else [x]


def series_sum(u: Series, v: Series) -> Series:
    return [plus(a, b) for a, b in zip(u, v, strict=True)]


def series_scale(u: Series, factor: Interval) -> Series:
    return [times(a, factor) for a in u]


def _convolved(u: Series, v: Series, k: int, first: int = 0, last: int | None = None) -> Interval:
    """Sum of u[j] v[k - j] for j from first to last."""
    lo = hi = 0
    for j in range(first, (k if last is None else last) + 1):
        a, b = u[j], v[k - j]
        if a != (0, 0) and b != (0, 0):
            product = times(a, b)
            lo, hi = lo + product[0], hi + product[1]
    return lo, hi


def series_product(u: Series, v: Series) -> Series:
    return [_convolved(u, v, k) for k in range(len(u))]


def series_quotient(u: Series, v: Series) -> Series:
    """q v = u, so q[k] v[0] = u[k] - sum of v[j] q[k - j], j >= 1."""
    q: Series = []
    for k in range(len(u)):
        q.append((0, 0))
        q[k] = quotient(minus(u[k], _convolved(v, q, k, 1)), v[0])
    return q


def _weighted(u: Series) -> Series:
    """k u[k]: of the derivative."""
    return [(k * a[0], k * a[1]) for k, a in enumerate(u)]


def _shared(x: Interval, n: int) -> Interval:
    return x[0] // n, -((-x[1]) // n)


def series_exp(u: Series) -> Series:
    """e' = u' e."""
    e, rate = [exponential(u[0])], _weighted(u)
    for k in range(1, len(u)):
        e.append((0, 0))
        e[k] = _shared(_convolved(rate, e, k, 1), k)
    return e


def series_log(u: Series) -> Series:
    """l' u = u'."""
    result: Series = [logarithm(u[0])]
    for k in range(1, len(u)):
        result.append((0, 0))
        rest = _convolved(_weighted(result), u, k, 1, k - 1)
        result[k] = quotient(minus(u[k], _shared(rest, k)), u[0])
    return result


def series_cos_sin(u: Series) -> tuple[Series, Series]:
    """c' = -u' s, s' = u' c."""
    first = cosine_sine(u[0])
    c, s, rate = [first[0]], [first[1]], _weighted(u)
    for k in range(1, len(u)):
        c.append((0, 0))
        s.append((0, 0))
        falls = _shared(_convolved(rate, s, k, 1), k)
        c[k], s[k] = (-falls[1], -falls[0]), _shared(_convolved(rate, c, k, 1), k)
    return c, s


def series_power(u: Series, exponent: Fraction) -> Series:
    """p' u = exponent u' p."""
    result: Series = [power_of(u[0], exponent)]
    if len(u) > 1 and u[0][0] <= 0:
        return _power_at_zero(u, exponent)
    for k in range(1, len(u)):
        result.append((0, 0))
        total = (0, 0)
        for j in range(1, k + 1):
            weight = from_fraction((exponent * j - (k - j)) / k)
            total = plus(total, times(weight, times(u[j], result[k - j])))
        result[k] = quotient(total, u[0])
    return result


def _power_at_zero(u: Series, exponent: Fraction) -> Series:
    """Without dividing by u: (u^e)' = e u^(e - 1) u', which has a bound as long as e - 1 >= 0."""
    if exponent < len(u) - 1:
        raise UndefinedError("a fractional power at 0, where its derivatives have no bound")
    lower = series_power(u[:-1], exponent - 1)
    rate, factor = _weighted(u), from_fraction(exponent)
    result: Series = [power_of(u[0], exponent)]
    for k in range(1, len(u)):
        result.append(_shared(times(factor, _convolved(rate, lower, k, 1)), k))
    return result


def _integrated(value: Interval, rate: Series) -> Series:
    """The series with this value and this derivative."""
    return [value] + [_shared(a, k + 1) for k, a in enumerate(rate[:-1])]


def _derivative(u: Series) -> Series:
    return [*_weighted(u)[1:], (0, 0)]


def series_arctan(u: Series) -> Series:
    one = constant((_ONE, _ONE), len(u) - 1)
    return _integrated(arctangent(u[0]), series_quotient(_derivative(u), series_sum(one, series_product(u, u))))


def series_arcsin(u: Series) -> Series:
    """asin u = atan(u / sqrt(1 - u^2))."""
    one = constant((_ONE, _ONE), len(u) - 1)
    square = series_product(u, u)
    cosine = series_power(series_sum(one, [(-b, -a) for a, b in square]), Fraction(1, 2))
    return series_arctan(series_quotient(u, cosine))
