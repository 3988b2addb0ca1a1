"""The body of a user kernel as smooth pieces: a formula in r on each of some intervals of [0, 1].

`if`, `min`, `max`, `abs`, `clamp`, `sign`, `floor`, ... split the interval at the places where their
conditions change, which are exact for rational functions and certain to 40 digits for others. What
stays is a rational function with rational coefficients (decimal literals and `/` are exact) or a
tree of functions that interval arithmetic can follow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache, partial
from itertools import pairwise
from math import comb

from blobscript import exact, intervals, syntax
from blobscript.effort import UndecidedError, spend
from blobscript.exact import Polynomial
from blobscript.intervals import Interval, Series
from blobscript.signatures import BUILTINS
from blobscript.signs import Signs, signs_of_series

__all__ = ["GapError", "Rational", "Reader", "Smooth", "Term", "series", "signs", "value"]

#: Beyond this degree formulas are no longer multiplied out.
_DEGREE = 240
_MOST_STEPS = 64  # jumps of `floor` within [0, 1]


class GapError(Exception):
    """Something that the proof cannot follow."""

    def __init__(self, reason: str, node: syntax.Expr | None = None) -> None:
        super().__init__(reason)
        self.reason, self.node = reason, node


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


_VARIABLE = Rational((Fraction(0), Fraction(1)))


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


# ---- smooth pieces -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Smooth:
    """`term` on lo <= r <= hi; `branch`: the branch of the `if` (`split`) that it comes from."""

    lo: Fraction
    hi: Fraction
    term: Term
    branch: syntax.Expr | None = None
    split: syntax.IfExpr | None = None


_Stretch = tuple[Fraction, Fraction, bool]
Truth = list[_Stretch]

_NAMES = {
    "abs": ("x",),
    "sign": ("x",),
    "floor": ("x",),
    "ceil": ("x",),
    "round": ("x",),
    "mod": ("x", "by"),
    "sqrt": ("x",),
    "exp": ("x",),
    "log": ("x",),
    "clamp": ("x", "lo", "hi"),
    "lerp": ("a", "b", "t"),
    "sin": ("x",),
    "cos": ("x",),
    "tan": ("x",),
    "asin": ("x",),
    "acos": ("x",),
    "atan": ("x",),
}

_TURNS = {"deg": Fraction(1, 180), "turn": Fraction(2)}


@dataclass(frozen=True, slots=True)
class Reader:
    """Reads an expression in `variable`, with numbers for the other names."""

    variable: str
    values: Mapping[str, float | int]

    def pieces(self, node: syntax.Expr, lo: Fraction, hi: Fraction) -> list[Smooth]:
        """The expression on [lo, hi], in turn."""
        match node:
            case syntax.IfExpr():
                return _merged(list(self._branches(node, lo, hi)))
            case syntax.Group(inner):
                return self.pieces(inner, lo, hi)
            case syntax.Unary("-", operand):
                return [replace(p, term=times(number(-1), p.term)) for p in self.pieces(operand, lo, hi)]
            case syntax.Binary("+" | "-" | "*" | "/" | "^" as op, left, right):
                combine = {"+": plus, "-": minus, "*": times, "/": over, "^": to_power}[op]
                return self._combined(node, combine, self.pieces(left, lo, hi), self.pieces(right, lo, hi))
            case syntax.Call():
                return self._call(node, lo, hi)
            case _:
                return [Smooth(lo, hi, self._atom(node))]

    def _atom(self, node: syntax.Expr) -> Term:
        match node:
            case syntax.Number(_, span):
                return number(Fraction(span.text))
            case syntax.Angle(value, unit):
                size = number(Fraction(repr(value)))
                return size if unit == "rad" else times(times(size, number(_TURNS[unit])), HalfTurn())
            case syntax.Name(text):
                return self._name(text, node)
            case _:
                raise GapError("only numbers and formulas of numbers can be followed", node)

    def _name(self, text: str, node: syntax.Expr) -> Term:
        if text == self.variable:
            return _VARIABLE
        if text in self.values:
            return number(Fraction(repr(self.values[text])))
        if text == "pi":
            return HalfTurn()
        raise GapError(f"`{text}` is not a number that is known here", node)

    def _combined(self, node: syntax.Expr, combine: Callable[..., Term], *operands: list[Smooth]) -> list[Smooth]:
        result: list[Smooth] = []
        for lo, hi, parts in _together(operands):
            split = next((p for p in parts if p.split is not None), parts[0])
            try:
                result.append(Smooth(lo, hi, combine(*(p.term for p in parts)), split.branch, split.split))
            except GapError as gap:
                raise GapError(gap.reason, gap.node or node) from None
        return result

    # ---- branches ----

    def _branches(self, node: syntax.IfExpr, lo: Fraction, hi: Fraction) -> Iterator[Smooth]:
        for a, b, true in self._truth(node.condition, lo, hi):
            branch = node.then if true else node.otherwise
            for piece in self.pieces(branch, a, b):
                yield piece if piece.split is not None else replace(piece, branch=branch, split=node)

    def _truth(self, node: syntax.Expr, lo: Fraction, hi: Fraction) -> Truth:
        """Where a condition holds; single places do not count."""
        match node:
            case syntax.Group(inner):
                return self._truth(inner, lo, hi)
            case syntax.Bool(value):
                return [(lo, hi, value)]
            case syntax.Unary("not", operand):
                return [(a, b, not true) for a, b, true in self._truth(operand, lo, hi)]
            case syntax.Binary("and" | "or" as op, left, right):
                return list(self._joined(op, left, right, lo, hi))
            case syntax.Binary("<" | "<=" | ">" | ">=" | "==" | "!=" as op, left, right):
                return list(self._compared(op, left, right, lo, hi))
            case _:
                raise GapError("this condition cannot be followed", node)

    def _joined(self, op: str, left: syntax.Expr, right: syntax.Expr, lo: Fraction, hi: Fraction) -> Iterator[_Stretch]:
        for a, b, true in self._truth(left, lo, hi):
            if true == (op == "or"):
                yield a, b, true
            else:
                yield from self._truth(right, a, b)

    def _compared(
        self, op: str, left: syntax.Expr, right: syntax.Expr, lo: Fraction, hi: Fraction
    ) -> Iterator[_Stretch]:
        holds = {"<": (-1,), "<=": (-1, 0), ">": (1,), ">=": (0, 1), "==": (0,), "!=": (-1, 1)}[op]
        difference = self._combined(left, minus, self.pieces(left, lo, hi), self.pieces(right, lo, hi))
        for piece in difference:
            for a, b, sign in self._signs(piece.term, piece.lo, piece.hi, left):
                yield a, b, sign in holds

    def _signs(self, term: Term, lo: Fraction, hi: Fraction, node: syntax.Expr) -> Signs:
        try:
            return signs(term, lo, hi)
        except (UndecidedError, intervals.UndefinedError) as gap:
            raise GapError(f"where this changes its sign cannot be told ({gap})", node) from None

    # ---- functions ----

    def _call(self, node: syntax.Call, lo: Fraction, hi: Fraction) -> list[Smooth]:
        name, arguments = _call_parts(node)
        if name in ("min", "max"):
            return self._extreme(node, name, [self.pieces(a, lo, hi) for a in arguments])
        if name not in _NAMES or node.block is not None:
            if name in BUILTINS:
                raise GapError(f"`{name}` cannot be followed", node)
            raise GapError(f"functions of the script cannot be followed, so write the formula of `{name}` here", node)
        ordered = _ordered(node, name, arguments)
        operands = [self.pieces(a, lo, hi) for a in ordered]
        match name:
            case "abs" | "sign":
                return self._by_sign(node, name, operands[0])
            case "clamp":
                return self._extreme(node, "min", [self._extreme(node, "max", operands[:2]), operands[2]])
            case "lerp":
                return self._combined(node, _mixed, *operands)
            case "floor" | "ceil" | "round" | "mod":
                return self._stepped(node, name, operands)
            case "sqrt":
                return self._combined(node, _square_root, *operands)
            case _:
                return self._combined(node, partial(_applied, name), *operands)

    def _extreme(self, node: syntax.Expr, name: str, operands: list[list[Smooth]]) -> list[Smooth]:
        best = operands[0]
        for other in operands[1:]:
            chosen: list[Smooth] = []
            for lo, hi, (p, q) in _together((best, other)):
                for a, b, sign in self._signs(minus(p.term, q.term), lo, hi, node):
                    winner = p if (sign >= 0) == (name == "max") else q
                    chosen.append(replace(winner, lo=a, hi=b))
            best = chosen
        return best

    def _by_sign(self, node: syntax.Expr, name: str, operand: list[Smooth]) -> list[Smooth]:
        result: list[Smooth] = []
        for piece in operand:
            for a, b, sign in self._signs(piece.term, piece.lo, piece.hi, node):
                term = times(number(sign), piece.term) if name == "abs" else number(sign)
                result.append(replace(piece, lo=a, hi=b, term=term))
        return result

    def _stepped(self, node: syntax.Expr, name: str, operands: list[list[Smooth]]) -> list[Smooth]:
        """ceil x = -floor -x; round x = floor(x + 1/2) but at single places; mod x by = x - by floor(x / by)."""
        steps = [part for piece in self._combined(node, _TURNED[name], *operands) for part in self._floor(node, piece)]
        if name == "mod":
            return self._combined(node, _remainder, *operands, steps)
        return [replace(p, term=times(number(-1), p.term)) for p in steps] if name == "ceil" else steps

    def _floor(self, node: syntax.Expr, piece: Smooth) -> Iterator[Smooth]:
        try:
            lo, hi = series(piece.term, intervals.over(piece.lo, piece.hi), 0)[0]
        except intervals.UndefinedError as gap:
            raise GapError(str(gap), node) from None
        first, last = lo >> intervals.BITS, hi >> intervals.BITS
        if last - first > _MOST_STEPS:
            raise GapError("this has too many steps", node)
        places = {piece.lo, piece.hi}
        for n in range(first, last + 1):
            for a, _, _ in self._signs(minus(piece.term, number(n)), piece.lo, piece.hi, node):
                places.add(a)
        for a, b in pairwise(sorted(places)):
            at_middle = value(piece.term, (a + b) / 2)
            yield replace(piece, lo=a, hi=b, term=number(at_middle[0] >> intervals.BITS))


def _negated(x: Term) -> Term:
    return times(number(-1), x)


def _half_more(x: Term) -> Term:
    return plus(x, number(Fraction(1, 2)))


def _itself(x: Term) -> Term:
    return x


#: What `floor` is taken of.
_TURNED: Mapping[str, Callable[..., Term]] = {"floor": _itself, "ceil": _negated, "round": _half_more, "mod": over}


def _mixed(a: Term, b: Term, t: Term) -> Term:
    return plus(a, times(minus(b, a), t))


def _square_root(x: Term) -> Term:
    return to_power(x, number(Fraction(1, 2)))


def _remainder(x: Term, by: Term, steps: Term) -> Term:
    return minus(x, times(by, steps))


def _applied(name: str, x: Term) -> Term:
    """Functions of 0 and log 1 are exact, so that exp(0 * r) stays a number."""
    constant = x.constant if isinstance(x, Rational) else None
    if constant == 0 and name in ("exp", "cos"):
        return _ONE
    if (constant == 0 and name in ("sin", "tan", "atan", "asin")) or (constant == 1 and name == "log"):
        return number(0)
    return Applied(name, (x,))


def _call_parts(node: syntax.Call) -> tuple[str, list[syntax.Expr]]:
    arguments = [argument.value for argument in node.arguments or ()]
    match node.callee:
        case syntax.Name(text):
            return text, arguments
        case syntax.Member(target, name):
            return name.text, [target, *arguments]
        case _:
            raise GapError("this call cannot be followed", node)


def _ordered(node: syntax.Call, name: str, arguments: list[syntax.Expr]) -> list[syntax.Expr]:
    """The arguments in the order of the parameters; labels have been checked before."""
    names = _NAMES[name]
    labels = [argument.label.text if argument.label else None for argument in node.arguments or ()]
    labels = [None] * (len(arguments) - len(labels)) + labels
    given = dict(zip(names, [a for a, label in zip(arguments, labels, strict=True) if label is None], strict=False))
    given |= {label: a for a, label in zip(arguments, labels, strict=True) if label is not None}
    if set(given) != set(names):
        raise GapError(f"`{name}` has other arguments", node)
    return [given[parameter] for parameter in names]


def _together(operands: Sequence[list[Smooth]]) -> Iterator[tuple[Fraction, Fraction, tuple[Smooth, ...]]]:
    """The common refinement of several rows of pieces of one interval."""
    places = sorted({p.lo for row in operands for p in row} | {row[-1].hi for row in operands})
    at = [0] * len(operands)
    for a, b in pairwise(places):
        for i, row in enumerate(operands):
            while row[at[i]].hi <= a:
                at[i] += 1
        yield a, b, tuple(row[k] for row, k in zip(operands, at, strict=True))


def _merged(pieces: list[Smooth]) -> list[Smooth]:
    """Neighbours with one formula are one piece."""
    result: list[Smooth] = []
    for piece in pieces:
        if result and result[-1].term == piece.term:
            result[-1] = replace(result[-1], hi=piece.hi)
        else:
            result.append(piece)
    return result
