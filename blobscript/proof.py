"""Proofs about user kernels, and the pieces that the tracer needs of them.

A kernel must be 1 at r = 0 and 0 at r = 1, flat at both, must fall, and have neither jumps nor
kinks. All of it is decided, not sampled: exactly for piecewise rational functions (signs of
polynomials in Bernstein form), by interval arithmetic on Taylor series for others. What is found
on the way is kept: where D is convex or concave as a function of s = r^2 (the sign of
r D'' - D', since d^2 D/ds^2 = (r D'' - D') / 4 r^3), where it falls, and its steepest slope.

Differences below 1e-30 count as none, so that cos(180deg) is -1 here.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise

from blobscript import exact, intervals, proof_words, syntax, terms
from blobscript.diagnostics import Diagnostic
from blobscript.effort import UndecidedError, limited
from blobscript.formulas import Formula
from blobscript.intervals import Interval, Series
from blobscript.ir import Kernel, KernelPiece
from blobscript.kernel_pieces import DEGREE, Stretch, Stub, lipschitz_bound, made, made_stub
from blobscript.proof_words import Bend, Ends, Jump, Subject
from blobscript.reader import Reader
from blobscript.sampled import sampled_kernel
from blobscript.signs import NOTHING, Signs, signs_of_series
from blobscript.source import Span
from blobscript.terms import GapError, Smooth

__all__ = ["prove"]

_ZERO, _ONE = Fraction(0), Fraction(1)

#: Work for one kernel (see `effort`): ordinary ones take a tenth of it at most.
_BUDGET = 2_000_000


def prove(
    name: str,
    parameters: Sequence[syntax.Parameter],
    body: syntax.Expr,
    arguments: Mapping[str, float | int],
    waivers: Collection[str],
    span: Span | None = None,
    formulas: Mapping[str, Formula] | None = None,
) -> tuple[Kernel | None, list[Diagnostic]]:
    """Decides whether a kernel is one, and makes it.

    parameters: as declared, the variable first. arguments: the values of all other names in the
    body. waivers: words of `@allow`. span: the kernel's name. formulas: the functions of the script that it calls.
    None, with errors, if a condition fails that is not waived. W0501 if a waiver is not needed.
    """
    given = tuple(sorted(arguments.items()))
    variable = parameters[0].name.text if parameters else "r"
    functions = tuple((formulas or {}).items())
    kernel, found, needed = _proved(name, variable, body, given, functions, frozenset(waivers))
    idle = sorted(set(waivers) - needed)
    if kernel is None or span is None or len(parameters) > 1 or not idle:
        return kernel, list(found)  # with parameters, another instance may need the waiver
    return kernel, [*found, proof_words.needless(name, idle, span)]


@lru_cache(maxsize=256)
def _proved(
    name: str,
    variable: str,
    body: syntax.Expr,
    arguments: tuple[tuple[str, float | int], ...],
    formulas: tuple[tuple[str, Formula], ...],
    waivers: frozenset[str],
) -> tuple[Kernel | None, list[Diagnostic], frozenset[str]]:
    """The kernel, the errors, and the waivers that it needs."""
    subject = Subject(name, variable, body)
    reader = Reader(variable, dict(arguments), dict(formulas))
    try:
        with limited(_BUDGET):
            return _decided(subject, reader.pieces(body, _ZERO, _ONE), waivers)
    except (GapError, UndecidedError, intervals.UndefinedError) as gap:
        place = gap if isinstance(gap, GapError) else None
        if "unproved" not in waivers:
            return None, [proof_words.not_proved(subject, str(gap), place)], waivers
    kernel, reason = sampled_kernel(subject.name, body, variable, dict(arguments), dict(formulas))
    if kernel is None:
        return None, [proof_words.not_made(subject, reason)], waivers
    return kernel, [], waivers


# ---- facts about a smooth piece ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Facts:
    """`slope`, `bend`: where D' and r D'' - D' are negative, positive or 0 all along."""

    smooth: Smooth
    slope: Signs
    bend: Signs

    @property
    def is_exact(self) -> bool:
        return isinstance(self.smooth.term, terms.Rational)


def _facts(smooth: Smooth) -> _Facts:
    term = smooth.term
    if isinstance(term, terms.Rational):
        _refuse_poles(term, smooth)
        slope = _derivative(term)
        bend = _bend(slope)
        return _Facts(smooth, terms.signs(slope, smooth.lo, smooth.hi), terms.signs(bend, smooth.lo, smooth.hi))
    return _Facts(
        smooth,
        signs_of_series(lambda x, order: _slope_series(term, x, order), smooth.lo, smooth.hi),
        signs_of_series(lambda x, order: _bend_series(term, x, order), smooth.lo, smooth.hi),
    )


def _refuse_poles(term: terms.Rational, smooth: Smooth) -> None:
    if term.is_polynomial:
        return
    parts = exact.signs(term.denominator, smooth.lo, smooth.hi)
    places = [a for a, _, _ in parts[1:]] + [x for x in (smooth.lo, smooth.hi) if exact.at(term.denominator, x) == 0]
    if places or _has_double_pole(term, smooth):
        at = f" at r = {proof_words.place(places[0])}" if places else ""
        raise GapError(f"it divides by 0{at}", smooth.branch)


def _has_double_pole(term: terms.Rational, smooth: Smooth) -> bool:
    """The denominator touches 0 without changing its sign: where its derivative changes its own."""
    turns = exact.signs(exact.derivative(term.denominator), smooth.lo, smooth.hi)
    return any(abs(exact.at(term.denominator, a)) < Fraction(1, 2**100) for a, _, _ in turns[1:])


def _derivative(term: terms.Rational) -> terms.Rational:
    p, q = term.numerator, term.denominator
    if term.is_polynomial:
        return terms.Rational(exact.scale(exact.derivative(p), 1 / q[0]))
    top = exact.subtract(exact.multiply(exact.derivative(p), q), exact.multiply(p, exact.derivative(q)))
    return terms.Rational(top, exact.multiply(q, q))


def _bend(slope: terms.Rational) -> terms.Rational:
    """r D'' - D' of D' = p / q: (r (p' q - p q') - p q) / q^2."""
    second = _derivative(slope)
    turned = exact.multiply((_ZERO, _ONE), second.numerator)
    rest = slope.numerator if slope.is_polynomial else exact.multiply(slope.numerator, slope.denominator)
    return terms.Rational(exact.subtract(turned, rest), second.denominator)


def _raised(series: Series) -> Series:
    """The series of the derivative, one shorter."""
    return [(k * lo, k * hi) for k, (lo, hi) in enumerate(series)][1:]


def _slope_series(term: terms.Term, x: Interval, order: int) -> Series:
    return _raised(terms.series(term, x, order + 1))


def _bend_series(term: terms.Term, x: Interval, order: int) -> Series:
    first = _raised(terms.series(term, x, order + 2))
    second = _raised(first)
    product = intervals.series_product(intervals.variable(x, order), second)
    return [intervals.minus(a, b) for a, b in zip(product, first, strict=False)]


# ---- the conditions -------------------------------------------------------------------------------------


def _decided(
    subject: Subject, pieces: list[Smooth], waivers: frozenset[str]
) -> tuple[Kernel | None, list[Diagnostic], frozenset[str]]:
    for piece in pieces:
        if isinstance(piece.term, terms.Rational):
            _refuse_poles(piece.term, piece)
    broken = _ends(subject, pieces) + _jumps(subject, pieces)
    if broken:
        return None, broken, waivers
    slopes = [(_slope_at(p, p.lo), _slope_at(p, p.hi)) for p in pieces]
    creases = _creases(subject, pieces, slopes)
    parts = [part for piece in pieces for part in _without_ends(piece)]
    facts = [part if isinstance(part, Stub) else _facts(part) for part in parts]
    rises = _rises(subject, pieces, [fact for fact in facts if isinstance(fact, _Facts)])
    needed = frozenset(name for name, found in (("crease", creases), ("nonmonotone", rises)) if found)
    if not needed <= waivers:
        return None, ([] if "crease" in waivers else creases) + ([] if "nonmonotone" in waivers else rises), needed
    return _kernel(subject, facts), [], needed


def _ends(subject: Subject, pieces: list[Smooth]) -> list[Diagnostic]:
    """E0501: D(0) = 1 and D(1) = 0."""
    first, last = terms.value(pieces[0].term, _ZERO), terms.value(pieces[-1].term, _ONE)
    if _is(first, 1) and _is(last, 0):
        return []
    ends = Ends(first, last)
    return [proof_words.wrong_ends(subject, pieces, ends, _is(last, 0))]


def _is(x: Interval, number: int) -> bool:
    whole = number << intervals.BITS
    return intervals.magnitude((x[0] - whole, x[1] - whole)) <= NOTHING


def _same(x: Interval, y: Interval) -> bool:
    return _is(intervals.minus(x, y), 0)


def _jumps(subject: Subject, pieces: list[Smooth]) -> list[Diagnostic]:
    """E0504: the same value on both sides of every joint."""
    found: list[Diagnostic] = []
    for left, right in pairwise(pieces):
        values = terms.value(left.term, left.hi), terms.value(right.term, right.lo)
        if not _same(*values):
            found.append(proof_words.jumps(subject, pieces, Jump(left, right, *values)))
    return found


def _slope_at(piece: Smooth, r: Fraction) -> Interval:
    try:
        return _slope_series(piece.term, intervals.from_fraction(r), 0)[0]
    except intervals.UndefinedError:
        raise GapError(f"its slope at r = {proof_words.place(r)} has no bound", piece.branch) from None


def _creases(subject: Subject, pieces: list[Smooth], slopes: list[tuple[Interval, Interval]]) -> list[Diagnostic]:
    """E0502 and E0505: flat at r = 0 and r = 1, the same slope on both sides of every joint."""
    first, last = slopes[0][0], slopes[-1][1]
    found: list[Diagnostic] = []
    if not (_is(first, 0) and _is(last, 0)):
        ends = Ends(None if _is(first, 0) else first, None if _is(last, 0) else last)
        found.append(proof_words.not_flat(subject, pieces, ends))
    for (left, right), (before, after) in zip(pairwise(pieces), pairwise(slopes), strict=True):
        if not _same(before[1], after[0]):
            found.append(proof_words.kinks(subject, pieces, Jump(left, right, before[1], after[0])))
    return found


def _rises(subject: Subject, pieces: list[Smooth], facts: list[_Facts]) -> list[Diagnostic]:
    """E0503: no interval where D' > 0."""
    rising: list[Bend] = []
    for fact in facts:
        for a, b, sign in fact.slope:
            if sign > 0 and rising and rising[-1].hi == a:
                rising[-1] = Bend(rising[-1].lo, b, rising[-1].first, fact.smooth.term, fact.is_exact)
            elif sign > 0:
                rising.append(Bend(a, b, fact.smooth.term, fact.smooth.term, fact.is_exact))
    return [proof_words.rises(subject, pieces, rising)] if rising else []


# ---- the kernel --------------------------------------------------------------------------------------------


def _without_ends(piece: Smooth) -> list[Smooth | Stub]:
    """The piece, with stubs beside ends where its derivatives have no bound."""
    term, lo, hi = piece.term, piece.lo, piece.hi
    first = None if _is_smooth_at(term, lo) else _stub(term, lo, hi)
    last = None if _is_smooth_at(term, hi) else _stub(term, hi, lo)
    core = replace(piece, lo=first.hi if first else lo, hi=last.lo if last else hi)
    return [part for part in (first, core, last) if part is not None]


def _is_smooth_at(term: terms.Term, r: Fraction) -> bool:
    if isinstance(term, terms.Rational):
        return True
    try:
        terms.series(term, intervals.from_fraction(r), DEGREE + 1)
    except intervals.UndefinedError:
        return False
    return True


def _stub(term: terms.Term, end: Fraction, other: Fraction) -> Stub:
    """As long as D stays the same within 2^-57."""
    length = other - end
    for _ in range(64):
        length /= 2
        lo, hi = min(end, end + length), max(end, end + length)
        enclosure = terms.series(term, intervals.over(lo, hi), 0)[0]
        error = intervals.to_fraction(enclosure[1] - enclosure[0])
        if error <= Fraction(1, 2**57):
            first, last = (intervals.middle(terms.value(term, r)) for r in (lo, hi))
            return Stub(lo, hi, _clean(first), _clean(last), error)
    raise GapError(f"it is too steep near r = {proof_words.place(end)}")


def _clean(x: Fraction) -> Fraction:
    """0 and 1 where it is one of them but for 1e-30."""
    nearest = Fraction(round(x))
    return nearest if abs(x - nearest) <= intervals.to_fraction(NOTHING) else x


def _kernel(subject: Subject, facts: Sequence[_Facts | Stub]) -> Kernel:
    pieces: list[KernelPiece] = []
    error = 0.0
    for fact in facts:
        if isinstance(fact, Stub):
            piece, own = made_stub(fact)
            pieces.append(piece)
        else:
            more, own = made(fact.smooth, _stretches(fact))
            pieces += more
        error = max(error, own)
    return Kernel(subject.name, pieces=tuple(pieces), lipschitz=lipschitz_bound(pieces), error=error)


def _stretches(fact: _Facts) -> list[Stretch]:
    """Where both the slope and the curvature in s keep their signs."""
    places = sorted({x for part in fact.slope + fact.bend for x in part[:2]})
    result: list[Stretch] = []
    for a, b in pairwise(places):
        middle = (a + b) / 2
        result.append(Stretch(a, b, _sign_at(fact.bend, middle), _sign_at(fact.slope, middle) <= 0))
    return [stretch for stretch in result if float(stretch.lo) < float(stretch.hi)]


def _sign_at(signs: Signs, place: Fraction) -> int:
    return next(sign for a, b, sign in signs if a <= place <= b)
