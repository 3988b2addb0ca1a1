"""Where a function changes its sign, proved by interval arithmetic on its Taylor series.

The function is given by its series: about a place, or over an interval (see `intervals`). Near the
ends of the interval, where it may vanish, the first coefficient c[k] that is certainly not 0 decides:
f(r) = c[k](x) (r - lo)^k for some x between, and c[k] over [lo, r] has one sign if r is near enough.
Between, the interval is halved until f has one sign by its mean value form, or is monotone with
one root, which is enclosed. A coefficient below 2^-100 counts as 0: what the proof says is then true
of a function that differs by 1e-30, far below all rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

from blobscript import intervals
from blobscript.effort import UndecidedError
from blobscript.intervals import BITS, Interval, Series, UndefinedError

__all__ = ["NOTHING", "Signs", "signs_of_series"]

Signs = list[tuple[Fraction, Fraction, int]]
SeriesOf = Callable[[Interval, int], Series]

#: In units of 2^-BITS: smaller numbers count as 0.
NOTHING = 1 << (BITS - 100)
_ORDER = 9
_MOST_HALVINGS = 64
_BUDGET = 600


def signs_of_series(series: SeriesOf, lo: Fraction, hi: Fraction) -> Signs:
    """(from, to, sign) in turn on [lo, hi]; one entry of sign 0 where the function is 0 all along."""
    whole = _over(series, lo, hi, 0)
    if whole is not None and intervals.magnitude(whole[0]) <= NOTHING:
        return [(lo, hi, 0)]
    left, first = _near_end(series, lo, hi, 1)
    right, last = _near_end(series, hi, left, -1)
    search = _Search(series)
    found = [(lo, left, first), *(search.between(left, right) if left < right else []), (right, hi, last)]
    return _joined([part for part in found if part[0] < part[1]])


def _joined(parts: Signs) -> Signs:
    result: Signs = []
    for a, b, sign in parts:
        if result and result[-1][2] == sign:
            result[-1] = (result[-1][0], b, sign)
        else:
            result.append((a, b, sign))
    return result


def _sign(x: Interval) -> int:
    return 1 if x[0] > 0 else -1 if x[1] < 0 else 0


def _over(series: SeriesOf, lo: Fraction, hi: Fraction, order: int) -> Series | None:
    """The series over an interval; None if that is too wide to tell whether the function is defined."""
    try:
        return series(intervals.over(lo, hi), order)
    except UndefinedError:
        return None


def _near_end(series: SeriesOf, end: Fraction, other: Fraction, direction: int) -> tuple[Fraction, int]:
    """A place near `end` up to which the function has one sign, and that sign."""
    coefficients = series(intervals.from_fraction(end), _ORDER)
    order = next((k for k, c in enumerate(coefficients) if intervals.magnitude(c) > NOTHING), None)
    if order is None or _sign(coefficients[order]) == 0:
        raise UndecidedError(f"it vanishes to a high order at {float(end):.4g}")
    reach = other - end
    for _ in range(_MOST_HALVINGS):
        place = end + reach
        found = _over(series, min(end, place), max(end, place), order)
        sign = _sign(found[order]) if found else 0
        if sign:
            return place, sign * (direction if order % 2 else 1)
        reach /= 2
    raise UndecidedError(f"its sign near {float(end):.4g} stays open")


class _Search:
    """Halving between two places where the function is not 0."""

    def __init__(self, series: SeriesOf) -> None:
        self.series, self.steps = series, 0

    def between(self, lo: Fraction, hi: Fraction) -> Signs:
        parts: Signs = []
        stack = [(lo, hi)]
        while stack:
            self.steps += 1
            if self.steps > _BUDGET:
                raise UndecidedError("more than the budget of the proof is needed")
            a, b = stack.pop()
            found = self._decided(a, b)
            if found is None:
                # off the middle, so that a root in the middle does not stay on a boundary
                middle = a + (b - a) * Fraction(511, 1024)
                stack += [(middle, b), (a, middle)]
            else:
                parts += found
        return _joined(parts)

    def _decided(self, a: Fraction, b: Fraction) -> Signs | None:
        found = _over(self.series, a, b, 1)
        if found is None:
            return None
        value, rate = found
        sign = _sign(value)
        if sign:
            return [(a, b, sign)]
        at_middle = self.series(intervals.from_fraction((a + b) / 2), 0)[0]
        half = intervals.over(-(b - a) / 2, (b - a) / 2)
        sign = _sign(intervals.plus(at_middle, intervals.times(rate, half)))
        if sign:
            return [(a, b, sign)]
        slope = _sign(rate)
        if not slope:
            return None
        at_a, at_b = (_sign(self.series(intervals.from_fraction(x), 0)[0]) for x in (a, b))
        if at_a and at_a == at_b:
            return [(a, b, at_a)]
        if at_a and at_b:
            root = self._root(a, b, at_b)
            return [(a, root, at_a), (root, b, at_b)]
        return None

    def _root(self, a: Fraction, b: Fraction, above: int) -> Fraction:
        for _ in range(BITS - 30):
            middle = (a + b) / 2
            sign = _sign(self.series(intervals.from_fraction(middle), 0)[0])
            if sign == 0:
                return middle
            a, b = (a, middle) if sign == above else (middle, b)
        return (a + b) / 2
