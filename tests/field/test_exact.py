"""Rational polynomials and interval series, the two halves of the proofs, against other arithmetic."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import pytest
from flint import arb, arb_series, ctx, fmpq
from hypothesis import given, settings
from hypothesis import strategies as st

from blobscript import exact, intervals
from blobscript.effort import UndecidedError
from blobscript.intervals import BITS, UndefinedError
from blobscript.signs import signs_of_series

F = Fraction
SMALL = st.integers(-5, 5)
ROOTS = st.lists(st.fractions(0, 1, max_denominator=30), min_size=0, max_size=5)


@pytest.fixture(autouse=True)
def precision():
    before, ctx.prec = ctx.prec, 400
    yield
    ctx.prec = before


def with_roots(roots: list[Fraction]) -> exact.Polynomial:
    p: exact.Polynomial = (F(1),)
    for root in roots:
        p = exact.multiply(p, (-root, F(1)))
    return p


# ---- polynomials ------------------------------------------------------------------------------------------


@settings(deadline=None)
@given(ROOTS)
def test_signs_change_exactly_at_odd_roots(roots: list[Fraction]):
    found = exact.signs(with_roots(roots), F(0), F(1))
    expected = sorted(r for r in set(roots) if roots.count(r) % 2 and 0 < r < 1)
    assert [a for a, _, _ in found][1:] == expected
    assert found[0][0] == 0
    assert found[-1][1] == 1
    assert found[-1][2] == (-1) ** sum(r == 1 for r in roots)
    assert all(x[2] == -y[2] for x, y in pairwise(found))


def test_irrational_roots_are_found_to_forty_digits():
    found = exact.signs((F(-1, 2), F(0), F(1)), F(0), F(1))
    assert [sign for _, _, sign in found] == [-1, 1]
    assert abs(found[0][1] ** 2 - F(1, 2)) < F(1, 10**39)


def test_roots_close_together_and_multiple_irrational_ones():
    close = with_roots([F(1, 3), F(1, 3) + F(1, 10**9), F(1, 3) + F(2, 10**9)])
    places = [a for a, _, _ in exact.signs(close, F(0), F(1))][1:]
    assert len(places) == 3
    assert all(abs(place - F(1, 3) - F(k, 10**9)) < F(1, 10**39) for k, place in enumerate(places))
    root = (F(-1, 2), F(0), F(1))
    assert len(exact.signs(exact.power(root, 4), F(0), F(1))) == 1
    assert len(exact.signs(exact.power(root, 3), F(0), F(1))) == 2


def test_zero_and_constants():
    assert exact.signs((), F(0), F(1)) == [(0, 1, 0)]
    assert exact.signs((F(-3),), F(0), F(1)) == [(0, 1, -1)]


@given(st.lists(SMALL, max_size=5), st.lists(SMALL, max_size=5), SMALL, st.integers(1, 4))
def test_arithmetic_of_polynomials(p_raw: list[int], q_raw: list[int], centre: int, half: int):
    p, q = (exact.trimmed([F(c) for c in raw]) for raw in (p_raw, q_raw))
    x = F(3, 7)
    assert exact.at(exact.multiply(p, q), x) == exact.at(p, x) * exact.at(q, x)
    assert exact.at(exact.subtract(p, q), x) == exact.at(p, x) - exact.at(q, x)
    assert exact.at(exact.shift(p, F(centre), F(half)), x) == exact.at(p, centre + half * x)
    assert exact.at(exact.power(p, 3), x) == exact.at(p, x) ** 3
    if q:
        quotient, rest = exact.divide(p, q)
        assert exact.add(exact.multiply(quotient, q), rest) == p
        assert len(rest) < len(q)


# ---- intervals -----------------------------------------------------------------------------------------------


def ball(x: intervals.Interval) -> arb:
    unit = arb(2) ** BITS
    return (arb(x[0]) / unit).union(arb(x[1]) / unit)


def as_arb(x: Fraction) -> arb:
    return arb(fmpq(x.numerator, x.denominator))


def agree(found: intervals.Interval, expected: arb) -> bool:
    """The exact value is enclosed, and tightly."""
    width = F(found[1] - found[0], 1 << BITS)
    return bool(ball(found).overlaps(expected)) and width <= F(1, 2**140) * (1 + abs(intervals.middle(found)))


@settings(deadline=None)
@given(st.fractions(-30, 30))
def test_functions_enclose_their_values(x: Fraction):
    at, exactly = intervals.from_fraction(x), as_arb(x)
    assert agree(intervals.exponential(at), exactly.exp())
    cosine, sine = intervals.cosine_sine(at)
    assert agree(cosine, exactly.cos())
    assert agree(sine, exactly.sin())
    assert agree(intervals.arctangent(at), exactly.atan())
    if x > F(1, 1000):
        assert agree(intervals.logarithm(at), exactly.log())
        assert agree(intervals.power_of(at, F(1, 2)), exactly.sqrt())
        assert agree(intervals.power_of(at, F(-2, 3)), exactly ** (arb(-2) / 3))


def test_half_turn():
    assert agree(intervals.half_turn(), arb.pi())


@settings(deadline=None)
@given(st.fractions(-8, 8), st.fractions(0, 7), st.fractions(0, 1))
def test_functions_of_intervals_contain_those_of_their_places(lo: Fraction, width: Fraction, share: Fraction):
    x = intervals.over(lo, lo + width)
    place = intervals.from_fraction(lo + width * share)
    for function in (
        intervals.exponential,
        intervals.arctangent,
        lambda v: intervals.cosine_sine(v)[0],
        lambda v: intervals.cosine_sine(v)[1],
    ):
        whole, part = function(x), function(place)
        assert whole[0] <= part[0] + 2
        assert part[1] - 2 <= whole[1]


FUNCTIONS = {
    "exp": (intervals.series_exp, lambda u: u.exp()),
    "log": (intervals.series_log, lambda u: u.log()),
    "cos": (lambda u: intervals.series_cos_sin(u)[0], lambda u: u.cos()),
    "sin": (lambda u: intervals.series_cos_sin(u)[1], lambda u: u.sin()),
    "atan": (intervals.series_arctan, lambda u: u.atan()),
    "asin": (intervals.series_arcsin, lambda u: u.asin()),
    "sqrt": (lambda u: intervals.series_power(u, F(1, 2)), lambda u: u.sqrt()),
    "inverse": (
        lambda u: intervals.series_quotient(intervals.constant((1 << BITS, 1 << BITS), len(u) - 1), u),
        lambda u: 1 / u,
    ),
    "square": (lambda u: intervals.series_product(u, u), lambda u: u * u),
}


@pytest.mark.parametrize("name", FUNCTIONS)
@settings(deadline=None, max_examples=20)
@given(st.fractions(F(1, 10), F(9, 10), max_denominator=1000))
def test_series_agree_with_those_of_another_library(name: str, x: Fraction):
    ours, theirs = FUNCTIONS[name]
    order = 9
    found = ours(intervals.variable(intervals.from_fraction(x), order))
    before, ctx.cap = ctx.cap, order + 1
    expected = theirs(arb_series([as_arb(x), arb(1)]))
    ctx.cap = before
    for k, coefficient in enumerate(found):
        assert ball(coefficient).overlaps(expected[k]), k
        assert coefficient[1] - coefficient[0] < 1 << (BITS - 90)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_series_over_an_interval_enclose_those_of_its_places(name: str):
    ours, _ = FUNCTIONS[name]
    wide = ours(intervals.variable(intervals.over(F(3, 10), F(4, 10)), 6))
    for x in (F(3, 10), F(33, 100), F(4, 10)):
        for outer, inner in zip(wide, ours(intervals.variable(intervals.from_fraction(x), 6)), strict=True):
            assert outer[0] <= inner[0]
            assert inner[1] <= outer[1]


def test_what_is_not_defined_is_refused():
    zero, around = (0, 0), (-1, 1)
    for call in (
        lambda: intervals.quotient(zero, around),
        lambda: intervals.logarithm(zero),
        lambda: intervals.power_of((-(1 << 100), 0), F(1, 2)),
        lambda: intervals.series_power(intervals.variable(zero, 2), F(3, 2)),
        lambda: intervals.exponential(intervals.from_fraction(F(10**6))),
    ):
        with pytest.raises(UndefinedError):
            call()


# ---- signs of series -------------------------------------------------------------------------------------------


def test_signs_of_a_wave():
    """sin(8 r) on [0, 1]: vanishes at 0, at pi/8 and pi/4."""
    eight = intervals.from_fraction(F(8))

    def wave(x, order):
        return intervals.series_cos_sin(intervals.series_scale(intervals.variable(x, order), eight))[1]

    found = signs_of_series(wave, F(0), F(1))
    assert [sign for _, _, sign in found] == [1, -1, 1]
    for k, (_, end, _) in enumerate(found[:-1], 1):
        assert abs(as_arb(end) - arb.pi() * k / 8) < 1e-30


def test_signs_near_ends_where_the_function_vanishes_to_a_high_order():
    """r^5 - sin(r)^5 > 0, of order 7 at 0."""

    def gap(x, order):
        r = intervals.variable(x, order)
        sine = intervals.series_cos_sin(r)[1]
        powers = [r, sine]
        for i, v in enumerate(powers):
            square = intervals.series_product(v, v)
            powers[i] = intervals.series_product(v, intervals.series_product(square, square))
        return [intervals.minus(a, b) for a, b in zip(*powers, strict=True)]

    assert signs_of_series(gap, F(0), F(1)) == [(0, 1, 1)]


def test_a_touch_in_the_middle_stays_undecided():
    def touch(x, order):
        shifted = intervals.variable(intervals.minus(x, intervals.from_fraction(F(1, 3))), order)
        return intervals.series_product(shifted, shifted)

    with pytest.raises(UndecidedError):
        signs_of_series(touch, F(0), F(1))


def test_a_function_that_is_zero_all_along():
    assert signs_of_series(lambda _x, order: intervals.constant((0, 0), order), F(0), F(1)) == [(0, 1, 0)]
