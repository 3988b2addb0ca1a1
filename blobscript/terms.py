"""Smooth formulas in r: rational functions with rational coefficients, or trees of functions that
interval arithmetic can follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import comb

from blobscript import exact, intervals, syntax
from blobscript.effort import spend
from blobscript.exact import Polynomial
from blobscript.intervals import Interval, Series
from blobscript.signs import Signs, signs_of_series
from blobscript.source import Span

__all__ = [
    "HALF_TURN",
    "VARIABLE",
    "GapError",
    "Rational",
    "Smooth",
    "Term",
    "applied",
    "minus",
    "number",
    "over",
    "plus",
    "series",
    "signs",
    "times",
    "to_power",
    "value",
]

#: Beyond this degree formulas are no longer multiplied out.
_DEGREE = 240


class GapError(Exception):
    """Something that the proof cannot follow. `calls`: the calls of functions that led there, innermost first."""

    def __init__(self, reason: str, node: syntax.Expr | None = None) -> None:
        super().__init__(reason)
        self.reason, self.node = reason, node
        self.calls: list[tuple[Span, str]] = []


# ---- terms ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Rational:
    numerator: Polynomial
    denominator: Polynomial = (Fraction(1),)

    @property
    def is_polynomial(self) -> bool:
        return len(self.denominator) == 1

    @property
    def constant(self) -> Fraction | None:
        if len(self.denominator) > 1 or len(self.numerator) > 1:
            return None
        return exact.at(self.numerator, Fraction(0)) / exact.at(self.denominator, Fraction(0))


@dataclass(frozen=True, slots=True)
class Applied:
    """+ * / ^ exp log sin cos tan atan asin acos of terms; `^` has its exponent beside it."""

    name: str
    arguments: tuple[Term, ...]
    exponent: Fraction = Fraction(1)


@dataclass(frozen=True, slots=True)
class HalfTurn:
    """pi."""


Term = Rational | Applied | HalfTurn

_ONE = Rational((Fraction(1),))


def number(x: Fraction | int) -> Rational:
    return Rational(exact.trimmed([Fraction(x)]))


VARIABLE = Rational((Fraction(0), Fraction(1)))
HALF_TURN = HalfTurn()


def _fits(*polynomials: Polynomial) -> bool:
    return sum(len(p) for p in polynomials) <= _DEGREE


def _reduced(numerator: Polynomial, denominator: Polynomial) -> Rational:
    if len(denominator) == 1:
        return Rational(exact.scale(numerator, 1 / denominator[0]))
    quotient, rest = exact.divide(numerator, denominator)
    return Rational(quotient) if not rest else Rational(numerator, denominator)


def plus(a: Term, b: Term) -> Term:
    if isinstance(a, Rational) and isinstance(b, Rational) and _fits(a.numerator, b.numerator, a.denominator):
        if a.denominator == b.denominator:
            return _reduced(exact.add(a.numerator, b.numerator), a.denominator)
        left = exact.multiply(a.numerator, b.denominator)
        right = exact.multiply(b.numerator, a.denominator)
        return _reduced(exact.add(left, right), exact.multiply(a.denominator, b.denominator))
    return Applied("+", (a, b))


def times(a: Term, b: Term) -> Term:
    if isinstance(a, Rational) and isinstance(b, Rational) and _fits(a.numerator, b.numerator):
        return _reduced(exact.multiply(a.numerator, b.numerator), exact.multiply(a.denominator, b.denominator))
    return Applied("*", (a, b))


def minus(a: Term, b: Term) -> Term:
    return plus(a, times(number(-1), b))


def over(a: Term, b: Term) -> Term:
    if isinstance(b, Rational):
        if not b.numerator:
            raise GapError("it divides by 0")
        return times(a, _reduced(b.denominator, b.numerator))
    return Applied("/", (a, b))


def to_power(base: Term, exponent: Term) -> Term:
    n = exponent.constant if isinstance(exponent, Rational) else None
    if n is None:
        return Applied("exp", (times(exponent, Applied("log", (base,))),))
    if n.denominator == 1 and abs(n) <= 4096:
        return _whole_power(base, int(n))
    return _root(base, n)


def _root(base: Term, exponent: Fraction) -> Term:
    """base^exponent; of c q^m with q > 0 within (0, 1) it is c^exponent q^(m exponent)."""
    if isinstance(base, Rational) and base.is_polynomial and len(base.numerator) > 2:
        p = base.numerator
        q = exact.square_free(p)
        m = (len(p) - 1) // (len(q) - 1)
        q = exact.scale(q, 1 if exact.at(q, Fraction(1, 2)) > 0 else -1)
        c = p[-1] / q[-1] ** m
        one_sign = [sign for _, _, sign in exact.signs(q, Fraction(0), Fraction(1))] == [1]
        if m > 1 and c > 0 and one_sign and exact.scale(exact.power(q, m), c) == p:
            power = to_power(Rational(q), number(m * exponent))
            return power if c == 1 else times(Applied("^", (number(c),), exponent), power)
    return Applied("^", (base,), exponent)


def _whole_power(base: Term, n: int) -> Term:
    if n < 0:
        return over(_ONE, _whole_power(base, -n))
    if isinstance(base, Rational) and (len(base.numerator) + len(base.denominator) - 2) * n < _DEGREE:
        return _reduced(exact.power(base.numerator, n), exact.power(base.denominator, n))
    result: Term = _ONE
    for bit in bin(n)[2:]:  # squaring keeps the tree small
        result = times(result, result)
        result = times(result, base) if bit == "1" else result
    return result


def applied(name: str, x: Term) -> Term:
    """Functions of 0 and log 1 are exact, so that exp(0 * r) stays a number."""
    constant = x.constant if isinstance(x, Rational) else None
    if constant == 0 and name in ("exp", "cos"):
        return _ONE
    if (constant == 0 and name in ("sin", "tan", "atan", "asin")) or (constant == 1 and name == "log"):
        return number(0)
    return Applied(name, (x,))


# ---- values ----------------------------------------------------------------------------------------


def series(term: Term, x: Interval, order: int) -> Series:
    """Taylor coefficients of a term about x, or enclosures of them over an interval."""
    spend((order + 1) * (order + 4))
    match term:
        case Rational(numerator, denominator):
            top = _polynomial_series(numerator, x, order)
            if len(denominator) == 1:
                return top
            return intervals.series_quotient(top, _polynomial_series(denominator, x, order))
        case HalfTurn():
            return intervals.constant(intervals.half_turn(), order)
        case Applied(name, arguments, exponent):
            inner = [series(argument, x, order) for argument in arguments]
            return _FUNCTIONS[name](*inner) if name != "^" else intervals.series_power(inner[0], exponent)


def _polynomial_series(p: Polynomial, x: Interval, order: int) -> Series:
    spend(len(p) * (order + 1))
    result: Series = []
    for row in _rows(p, order):
        total = (0, 0)
        for c in row:
            total = intervals.plus(intervals.times(total, x), c)
        result.append(total)
    return result


@lru_cache(maxsize=64)
def _rows(p: Polynomial, order: int) -> list[list[Interval]]:
    """Of each p^(k) / k!, the coefficients, highest power first."""
    return [
        [intervals.from_fraction(comb(j, k) * p[j]) for j in range(len(p) - 1, k - 1, -1)] for k in range(order + 1)
    ]


def _cosine(u: Series) -> Series:
    return intervals.series_cos_sin(u)[0]


def _sine(u: Series) -> Series:
    return intervals.series_cos_sin(u)[1]


def _tangent(u: Series) -> Series:
    cosine, sine = intervals.series_cos_sin(u)
    return intervals.series_quotient(sine, cosine)


def _arccosine(u: Series) -> Series:
    quarter = intervals.constant(
        intervals.times(intervals.half_turn(), intervals.from_fraction(Fraction(1, 2))), len(u) - 1
    )
    return intervals.series_sum(quarter, [(-b, -a) for a, b in intervals.series_arcsin(u)])


_FUNCTIONS: Mapping[str, Callable[..., Series]] = {
    "+": intervals.series_sum,
    "*": intervals.series_product,
    "/": intervals.series_quotient,
    "exp": intervals.series_exp,
    "log": intervals.series_log,
    "cos": _cosine,
    "sin": _sine,
    "tan": _tangent,
    "atan": intervals.series_arctan,
    "asin": intervals.series_arcsin,
    "acos": _arccosine,
}


def value(term: Term, r: Fraction) -> Interval:
    """Enclosure of a term at one place; its limit where that is easily told."""
    return series(term, intervals.from_fraction(r), 0)[0]


def signs(term: Term, lo: Fraction, hi: Fraction) -> Signs:
    """Where a term is negative, positive, or 0 all along."""
    if isinstance(term, Rational):
        return exact.signs(exact.multiply(term.numerator, term.denominator), lo, hi)
    return signs_of_series(lambda x, order: series(term, x, order), lo, hi)


# ---- pieces ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Smooth:
    """`term` on lo <= r <= hi; `branch`: the branch of the `if` (`split`) that it comes from."""

    lo: Fraction
    hi: Fraction
    term: Term
    branch: syntax.Expr | None = None
    split: syntax.IfExpr | None = None
