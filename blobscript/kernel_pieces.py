"""From smooth formulas to what the tracer evaluates: polynomial pieces with a bounded error.

A polynomial with rational coefficients is kept, about that end (or the middle) of its piece where
its coefficients stay small; even ones become polynomials in s = r^2. Other functions become their
Taylor polynomials, the remainder bounded by the enclosure of the next coefficient over the piece,
which is halved until it is small, and then economised: the highest power x^n is replaced by
x^n - T_n(x) / 2^(n-1), at the price of 1 / 2^(n-1) of its coefficient (Lanczos 1938). They start at
an order well above DEGREE: what is left of them after that follows D on longer pieces, and few
pieces are what makes the tracer fast.

Pieces that start at r = 0 are polynomials in s, or about r = 0, so that D'(r) / r can be computed
there; those that end at r = 1 where D vanishes are about r = 1 if possible, so that values keep
their relative accuracy where they are small.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from heapq import heappop, heappush
from math import frexp

import numpy as np

from blobscript import exact, intervals, terms
from blobscript.exact import Polynomial
from blobscript.intervals import BITS, Interval, Series
from blobscript.ir import KernelPiece
from blobscript.terms import GapError, Smooth

__all__ = ["DEGREE", "Stretch", "Stub", "lipschitz_bound", "made", "made_stub"]

DEGREE = 23  # as the tracer's PIECE_DEGREE
_LOWEST, _HIGHEST = 8, 48  # orders of Taylor polynomials, before they are economised
_SHORT = 8  # after as many halvings pieces are too short to matter for speed: DEGREE does
_SMALL = Fraction(1, 2**60)
_LARGE = 64.0
_MOST_PIECES = 96
_DEEPEST = 64  # halvings: places as near as that to a singular one are stubs


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of a smooth piece on which D is monotone, and convex or concave in s."""

    lo: Fraction
    hi: Fraction
    convex: int
    falling: bool


@dataclass(frozen=True, slots=True)
class Stub:
    """A short part beside a place where derivatives have no bound, as of (1 - r)^1.5 at r = 1: there D
    differs from `first` and `last`, its values at both ends, by no more than `error`."""

    lo: Fraction
    hi: Fraction
    first: Fraction
    last: Fraction
    error: Fraction


@dataclass(frozen=True, slots=True)
class _Fitted:
    """A polynomial in x = (r or s - centre) / half on lo <= r <= hi, and its error."""

    lo: Fraction
    hi: Fraction
    variable: str
    centre: Fraction
    half: Fraction
    coefficients: Polynomial
    error: Fraction


def made(smooth: Smooth, stretches: list[Stretch]) -> tuple[list[KernelPiece], float]:
    """The pieces of a smooth formula, cut at its stretches, and a bound of |pieces - D|."""
    result: list[KernelPiece] = []
    error = Fraction(0)
    for stretch in stretches:
        for fitted in _fitted(smooth.term, stretch.lo, stretch.hi):
            piece, rounding = _rounded(fitted, stretch)
            result.append(piece)
            error = max(error, fitted.error + rounding)
            if len(result) > _MOST_PIECES:
                raise GapError("it needs too many polynomial pieces")
    return result, float(error) * (1.0 + 1e-9)


def made_stub(stub: Stub) -> tuple[KernelPiece, float]:
    """A straight line in s."""
    lo, hi = stub.lo**2, stub.hi**2
    line = (stub.last, stub.last - stub.first)  # in (s - hi) / (hi - lo)
    fitted = _Fitted(stub.lo, stub.hi, "s", hi, hi - lo, line, 2 * stub.error)
    piece, rounding = _rounded(fitted, Stretch(stub.lo, stub.hi, 0, stub.last <= stub.first))
    return piece, float(fitted.error + rounding)


def _fitted(term: terms.Term, lo: Fraction, hi: Fraction) -> Iterator[_Fitted]:
    if isinstance(term, terms.Rational) and term.is_polynomial:
        yield from _kept(exact.scale(term.numerator, 1 / term.denominator[0]), term, lo, hi)
    else:
        yield from _approximated(term, lo, hi)


def _rounded(fitted: _Fitted, stretch: Stretch) -> tuple[KernelPiece, Fraction]:
    """With coefficients, centre and half as floats; what that may change."""
    coefficients = tuple(map(float, fitted.coefficients)) or (0.0,)
    rounding = sum((abs(Fraction(c) - e) for c, e in zip(coefficients, fitted.coefficients, strict=False)), Fraction(0))
    moved = abs(Fraction(float(fitted.centre)) - fitted.centre) + abs(Fraction(float(fitted.half)) - fitted.half)
    steepest = sum((k * abs(c) for k, c in enumerate(fitted.coefficients)), Fraction(0)) / fitted.half
    piece = KernelPiece(
        float(fitted.lo),
        float(fitted.hi),
        fitted.variable,  # pyright: ignore[reportArgumentType]
        float(fitted.centre),
        float(fitted.half),
        coefficients,
        stretch.convex,  # pyright: ignore[reportArgumentType]
        stretch.falling,
    )
    return piece, rounding + moved * steepest


# ---- polynomials, kept -------------------------------------------------------------------------------


def _kept(p: Polynomial, term: terms.Term, lo: Fraction, hi: Fraction, depth: int = 0) -> Iterator[_Fitted]:
    even = not any(p[1::2])
    if even:
        q, ends = p[::2], (lo * lo, hi * hi)
        places = [ends[1], ends[0], (ends[0] + ends[1]) / 2]
    else:
        q, ends = p, (lo, hi)
        places = [hi, lo, (lo + hi) / 2] if lo > 0 else [lo]
    if len(q) - 1 > DEGREE:
        yield from _approximated(term, lo, hi)
        return
    if len(q) > 1 and q[1] != 0 and not even and lo == 0:
        places = [hi, lo]  # a crease at the skeleton has no limit of D'(r) / r to keep
    fits = [_about(q, "s" if even else "r", lo, hi, centre, *ends) for centre in places]
    best = min(fits, key=_size)
    if hi == 1 and _size(fits[0]) <= min(4 * _size(best), _LARGE):
        best = fits[0]
    if (_size(best) > _LARGE or (lo == 0 and not even and len(q) > 2 and hi > Fraction(1, 2))) and depth < 6:
        middle = (lo + hi) / 2
        yield from _kept(p, term, lo, middle, depth + 1)
        yield from _kept(p, term, middle, hi, depth + 1)
    else:
        yield best


def _about(
    q: Polynomial, variable: str, lo: Fraction, hi: Fraction, centre: Fraction, first: Fraction, last: Fraction
) -> _Fitted:
    """In x = (v - centre) / half, |x| <= 1, half a power of two, so that scaling is exact."""
    if Fraction(float(centre)) != centre:
        centre = Fraction(float(centre))
    reach = max(abs(first - centre), abs(last - centre))
    mantissa, exponent = frexp(float(reach))
    half = Fraction(2) ** (exponent - 1 if mantissa == 0.5 else exponent)
    return _Fitted(lo, hi, variable, centre, half, exact.shift(q, centre, half), Fraction(0))


def _size(fitted: _Fitted) -> float:
    return float(sum(map(abs, fitted.coefficients)))


# ---- other functions, approximated --------------------------------------------------------------------


def _approximated(term: terms.Term, lo: Fraction, hi: Fraction, depth: int = 0) -> Iterator[_Fitted]:
    try:
        highest = _HIGHEST if depth < _SHORT else DEGREE
        fitted = _at_zero(term, hi, highest) if lo == 0 else _about_middle(term, lo, hi, highest)
    except intervals.UndefinedError as gap:
        if depth > _DEEPEST:
            raise GapError(f"{gap}, near r = {float(lo):.4g}") from None
        fitted = None
    if fitted is not None:
        yield fitted
        return
    if depth > _DEEPEST:
        raise GapError(f"it is too steep near r = {float(lo):.4g}")
    middle = (lo + hi) / 2
    yield from _approximated(term, lo, middle, depth + 1)
    yield from _approximated(term, middle, hi, depth + 1)


def _centred(c: Series, step: Fraction) -> tuple[list[Fraction], Fraction]:
    """Coefficients in x = (r - place) / step, and what their enclosures leave open."""
    coefficients: list[Fraction] = []
    factor, open_ = Fraction(1), Fraction(0)
    for lo, hi in c:
        coefficients.append(Fraction(lo + hi, 2 << BITS) * factor)
        open_ += Fraction(hi - lo, 2 << BITS) * factor
        factor *= step
    return coefficients, open_


def _bound(x: Interval) -> Fraction:
    return Fraction(intervals.magnitude(x), 1 << BITS)


def _order(over: Series, step: Fraction) -> tuple[int, Fraction]:
    """The lowest order at which the remainder within `step` is small, else the highest one, and the
    remainder; `over` encloses coefficients over the piece."""
    for order in range(_LOWEST, len(over) - 1):
        rest = _bound(over[order + 1]) * step ** (order + 1)
        if rest <= _SMALL / 2:
            return order, rest
    return len(over) - 2, _bound(over[-1]) * step ** (len(over) - 1)


def _about_middle(term: terms.Term, lo: Fraction, hi: Fraction, highest: int) -> _Fitted | None:
    centre, half = _float_middle(lo, hi)
    order, rest = _order(terms.series(term, intervals.over(lo, hi), highest + 1), half)
    if rest > _SMALL:
        return None
    coefficients, open_ = _centred(terms.series(term, intervals.from_fraction(centre), order), half)
    coefficients, economy = _economised(coefficients)
    if rest + open_ > _SMALL or len(coefficients) > DEGREE + 1:
        return None
    return _Fitted(lo, hi, "r", centre, half, coefficients, rest + open_ + economy)


def _float_middle(lo: Fraction, hi: Fraction) -> tuple[Fraction, Fraction]:
    """Centre and half that are floats and cover [lo, hi]."""
    centre = Fraction(float((lo + hi) / 2))
    reach = max(hi - centre, centre - lo)
    half = Fraction(float(reach))
    return centre, half if half >= reach else Fraction(float(np.nextafter(float(half), 2.0)))


def _at_zero(term: terms.Term, hi: Fraction, highest: int) -> _Fitted | None:
    order, rest = _order(terms.series(term, intervals.over(Fraction(0), hi), highest + 1), hi)
    if rest > _SMALL:
        return None
    c = terms.series(term, intervals.from_fraction(Fraction(0)), order)
    even = all(intervals.magnitude(x) < 1 << (BITS - 120) for x in c[1::2])
    if even:
        odd = sum((_bound(x) * hi ** (2 * k + 1) for k, x in enumerate(c[1::2])), Fraction(0))
        in_s, open_ = _centred(c[::2], hi * hi)
        centre, half = _float_middle(Fraction(0), hi * hi)
        about = exact.shift(exact.trimmed(in_s), centre / (hi * hi), half / (hi * hi))
        coefficients, economy = _economised(list(about))
        if rest + open_ + odd > _SMALL or len(coefficients) > DEGREE + 1:
            return None
        return _Fitted(Fraction(0), hi, "s", centre, half, coefficients, rest + open_ + odd + economy)
    coefficients, open_ = _centred(c, Fraction(float(hi)))
    if intervals.magnitude(c[1]) < 1 << (BITS - 120):
        coefficients[1] = Fraction(0)
    while len(coefficients) > 2 and abs(coefficients[-1]) < _SMALL / 64:
        open_ += abs(coefficients.pop())
    if rest + open_ > _SMALL or len(coefficients) > DEGREE + 1:
        return None
    return _Fitted(Fraction(0), hi, "r", Fraction(0), Fraction(float(hi)), exact.trimmed(coefficients), rest + open_)


@lru_cache(maxsize=64)
def _chebyshev(n: int) -> Polynomial:
    if n < 2:
        return (Fraction(1),) if n == 0 else (Fraction(0), Fraction(1))
    return exact.subtract((Fraction(0), *exact.scale(_chebyshev(n - 1), 2)), _chebyshev(n - 2))


def _economised(coefficients: list[Fraction]) -> tuple[Polynomial, Fraction]:
    """Lower degree on |x| <= 1 at a cost of at most _SMALL."""
    p, cost = exact.trimmed(coefficients), Fraction(0)
    while len(p) > 2:
        n = len(p) - 1
        price = abs(p[n]) / 2 ** (n - 1)
        if cost + price > _SMALL:
            break
        p = exact.subtract(p, exact.scale(_chebyshev(n), p[n] / 2 ** (n - 1)))
        cost += price
    return p, cost


# ---- the steepest slope --------------------------------------------------------------------------------


def lipschitz_bound(pieces: list[KernelPiece]) -> float:
    """max |dD/dr|, from above and within 1e-4 of it: halves the part with the largest bound."""
    heap: list[tuple[float, int, float, float]] = []
    reached = 0.0

    def push(index: int, lo: float, hi: float) -> float:
        bound, value = _steepest(pieces[index], lo, hi)
        heappush(heap, (-bound, index, lo, hi))
        return value

    for i, piece in enumerate(pieces):
        reached = max(reached, push(i, piece.r_lo, piece.r_hi))
    for _ in range(4000):
        bound, i, lo, hi = heap[0]
        if -bound <= reached * 1.0001 + 1e-12:
            break
        heappop(heap)
        middle = 0.5 * (lo + hi)
        reached = max(reached, push(i, lo, middle), push(i, middle, hi))
    return -heap[0][0] * (1.0 + 1e-9)


def _steepest(piece: KernelPiece, lo: float, hi: float) -> tuple[float, float]:
    """A bound of |dD/dr| on [lo, hi] by a Taylor sum about the middle, and a value that is reached."""
    in_s = piece.variable == "s"
    first, last = (lo * lo, hi * hi) if in_s else (lo, hi)
    place = 0.5 * (first + last)
    x, h = (place - piece.centre) / piece.half, 0.5 * (last - first) / piece.half
    slope, rest, power = _taylor(piece.coefficients, x)
    rest = sum(abs(c) * h**k for k, c in enumerate(power, 2)) + abs(rest) * h
    outer, inner = (2.0 * hi, 2.0 * place**0.5) if in_s else (1.0, 1.0)
    return (abs(slope) + rest) / piece.half * outer, abs(slope) / piece.half * inner


def _taylor(coefficients: tuple[float, ...], x: float) -> tuple[float, float, list[float]]:
    """Of p' about x: the first coefficient, the second, and the others."""
    rows = [k * c for k, c in enumerate(coefficients)][1:]
    found: list[float] = []
    while rows:  # synthetic division by (variable - x), again and again
        for k in range(len(rows) - 2, -1, -1):
            rows[k] += x * rows[k + 1]
        found.append(rows[0])
        rows = rows[1:]
    found += [0.0] * (2 - len(found))
    return found[0], found[1], found[2:]
