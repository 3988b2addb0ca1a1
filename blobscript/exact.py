"""Polynomials with rational coefficients, and the exact signs that they take on an interval.

A polynomial is a tuple of Fractions, lowest power first, without trailing zeros; () is 0. Signs are
found in Bernstein form (integers): as many sign changes of the coefficients as roots in the open
interval, or an even number more; none means none, one means one, else the interval is halved
(Descartes, Vincent; see Eigenwillig 2008, "Real root isolation", chapter 2).
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import ceil, comb, floor, lcm

from blobscript.effort import spend

__all__ = [
    "Polynomial",
    "add",
    "at",
    "derivative",
    "divide",
    "multiply",
    "power",
    "scale",
    "shift",
    "signs",
    "square_free",
    "subtract",
    "trimmed",
]

Polynomial = tuple[Fraction, ...]

#: Roots that are not rational are enclosed to this width; their place is exact to 40 digits.
_ROOT_WIDTH = Fraction(1, 2**135)
#: Nearer to an end a root is the end itself, which may be such a place of another polynomial.
_SAME = Fraction(1, 2**120)
#: From here on a cluster of roots is taken for a multiple one, and the square-free part is used.
_DEPTH = 48
#: Roots are sought between multiples of 1 / _GRID: ends with many digits would slow everything down.
_GRID = 1 << 12


def trimmed(coefficients: list[Fraction] | Polynomial) -> Polynomial:
    n = len(coefficients)
    while n and coefficients[n - 1] == 0:
        n -= 1
    return tuple(coefficients[:n])


def add(p: Polynomial, q: Polynomial) -> Polynomial:
    if len(p) < len(q):
        p, q = q, p
    return trimmed([a + b for a, b in zip(p, q, strict=False)] + list(p[len(q) :]))


def scale(p: Polynomial, factor: Fraction | int) -> Polynomial:
    return trimmed([a * factor for a in p])


def subtract(p: Polynomial, q: Polynomial) -> Polynomial:
    return add(p, scale(q, -1))


def multiply(p: Polynomial, q: Polynomial) -> Polynomial:
    if not p or not q:
        return ()
    spend(len(p) * len(q))
    result = [Fraction(0)] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        if a:
            for j, b in enumerate(q):
                result[i + j] += a * b
    return trimmed(result)


def power(p: Polynomial, n: int) -> Polynomial:
    result: Polynomial = (Fraction(1),)
    while n:
        if n & 1:
            result = multiply(result, p)
        p, n = multiply(p, p), n >> 1
    return result


def derivative(p: Polynomial) -> Polynomial:
    return trimmed([k * a for k, a in enumerate(p)][1:])


def at(p: Polynomial, x: Fraction) -> Fraction:
    total = Fraction(0)
    for a in reversed(p):
        total = total * x + a
    return total


def shift(p: Polynomial, centre: Fraction, half: Fraction) -> Polynomial:
    """q with q(x) = p(centre + half x)."""
    result: Polynomial = ()
    for a in reversed(p):
        result = add(multiply(result, (centre, half)), (a,))
    return result


def divide(p: Polynomial, q: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Quotient and remainder."""
    size = max((c.denominator.bit_length() + c.numerator.bit_length() for c in p), default=0)
    spend(max(len(p) - len(q) + 1, 0) * len(q) * (1 + size // 250))
    rest, quotient = list(p), [Fraction(0)] * max(len(p) - len(q) + 1, 0)
    for k in range(len(quotient) - 1, -1, -1):
        quotient[k] = rest[k + len(q) - 1] / q[-1]
        for j, b in enumerate(q):
            rest[k + j] -= quotient[k] * b
    return trimmed(quotient), trimmed(rest[: len(q) - 1] if len(q) > 1 else [])


def square_free(p: Polynomial) -> Polynomial:
    """Each root once: p / gcd(p, p')."""
    a, b = p, derivative(p)
    while b:
        a, b = b, divide(a, b)[1]
        b = scale(b, 1 / b[-1]) if b else b
    return divide(p, a)[0]


# ---- signs ----------------------------------------------------------------------------------------


def signs(p: Polynomial, lo: Fraction, hi: Fraction) -> list[tuple[Fraction, Fraction, int]]:
    """(from, to, sign) in turn on [lo, hi], where the sign changes; 0 only if p is 0 everywhere.

    Sign changes at irrational places are given to 40 digits.
    """
    if not p:
        return [(lo, hi, 0)]
    whole = _whole(p)
    ends = Fraction(floor(lo * _GRID), _GRID), Fraction(ceil(hi * _GRID), _GRID)
    places = [lo, *(root for root in _roots(p, *ends) if lo + _SAME < root < hi - _SAME), hi]
    result: list[tuple[Fraction, Fraction, int]] = []
    for a, b in pairwise(places):
        sign = _sign_at(whole, _between(a, b))
        if result and result[-1][2] == sign:
            result[-1] = (result[-1][0], b, sign)
        else:
            result.append((a, b, sign))
    return result


def _sign(x: Fraction | int) -> int:
    return (x > 0) - (x < 0)


def _whole(p: Polynomial) -> list[int]:
    """The coefficients times a common denominator."""
    factor = lcm(*(c.denominator for c in p))
    return [int(c * factor) for c in p]


def _sign_at(whole: list[int], x: Fraction) -> int:
    """Horner's scheme in integers: the value times a power of the denominator of x."""
    spend(1 + len(whole) * len(whole) * x.denominator.bit_length() // 40000)
    total, scale_ = 0, 1
    for c in reversed(whole):
        total = total * x.numerator + c * scale_
        scale_ *= x.denominator
    return _sign(total)


def _between(a: Fraction, b: Fraction) -> Fraction:
    """A place between them with few bits."""
    grid = 4
    while True:
        place = Fraction(floor((a + b) / 2 * grid), grid)
        if a < place < b:
            return place
        grid *= 16


def _roots(p: Polynomial, lo: Fraction, hi: Fraction) -> list[Fraction]:
    """All places in (lo, hi) where p changes its sign, in rising order (and some where it does not)."""
    found = _isolated(p, lo, hi)
    if found is None:
        p = square_free(p)
        found = _isolated(p, lo, hi) or []
    return sorted({_located(p, a, b) for a, b in found})


def _isolated(p: Polynomial, lo: Fraction, hi: Fraction) -> list[tuple[Fraction, Fraction]] | None:
    """Intervals with one root each (a == b: the root itself); None where roots cluster."""
    found: list[tuple[Fraction, Fraction]] = []
    stack = [(lo, hi, _bernstein(shift(p, lo, hi - lo)), 0)]
    while stack:
        a, b, coefficients, depth = stack.pop()
        changes = _sign_changes(coefficients)
        if changes == 0:
            continue
        if changes == 1:
            found.append((a, b))
            continue
        if depth > _DEPTH:
            return None
        left, right = _halved(coefficients)
        middle = (a + b) / 2
        if right[0] == 0:
            found.append((middle, middle))
        stack += [(a, middle, left, depth + 1), (middle, b, right, depth + 1)]
    return found


def _bernstein(p: Polynomial) -> list[int]:
    """Coefficients on [0, 1], times a common denominator."""
    n = len(p) - 1
    spend(2 * n * n)
    exact = [sum((Fraction(comb(i, k), comb(n, k)) * p[k] for k in range(i + 1)), Fraction(0)) for i in range(n + 1)]
    factor = lcm(*(c.denominator for c in exact))
    return [int(c * factor) for c in exact]


def _halved(coefficients: list[int]) -> tuple[list[int], list[int]]:
    """De Casteljau at 1/2, both halves times 2^n."""
    n = len(coefficients) - 1
    spend(1 + n * n // 16 * (1 + coefficients[0].bit_length() // 1000))
    row = coefficients
    left: list[int] = []
    right: list[int] = []
    for k in range(n + 1):
        left.append(row[0] << (n - k))
        right.append(row[-1] << (n - k))
        row = [x + y for x, y in pairwise(row)]
    return left, right[::-1]


def _sign_changes(coefficients: list[int]) -> int:
    nonzero = [c for c in coefficients if c]
    return sum((x < 0) != (y < 0) for x, y in pairwise(nonzero))


def _located(p: Polynomial, a: Fraction, b: Fraction) -> Fraction:
    """The simple root in (a, b): exactly if it is a rational with a small denominator."""
    if a == b:
        return a
    whole = _whole(_without_root(_without_root(p, a), b))
    above = _sign_at(whole, b)
    tried = False
    while b - a > _ROOT_WIDTH:
        if not tried and b - a < Fraction(1, 2**40):
            tried = True
            simple = ((a + b) / 2).limit_denominator(1 << 18)
            if a < simple < b and _sign_at(whole, simple) == 0:
                return simple
        middle = (a + b) / 2
        sign = _sign_at(whole, middle)
        if sign == 0:
            return middle
        a, b = (a, middle) if sign == above else (middle, b)
    return (a + b) / 2


def _without_root(p: Polynomial, place: Fraction) -> Polynomial:
    while _sign_at(_whole(p), place) == 0:
        p = divide(p, (-place, Fraction(1)))[0]
    return p
