"""The body of a user kernel as smooth pieces: a formula in r on each of some intervals of [0, 1].

`if`, `min`, `max`, `abs`, `clamp`, `sign`, `floor`, ... split the interval at the places where their
conditions change, which are exact for rational functions and certain to 40 digits for others. What
stays is a rational function with rational coefficients (decimal literals and `/` are exact) or a
tree of functions that interval arithmetic can follow. Functions of the script are read where they
are called: their parameters stand for the pieces of the arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from itertools import pairwise
from math import pi

from blobscript import intervals, syntax
from blobscript.effort import UndecidedError, spend
from blobscript.formulas import Formula, Labelled, arguments_of, call_parts, callees, lambda_of, named
from blobscript.signs import Signs
from blobscript.terms import (
    HALF_TURN,
    VARIABLE,
    GapError,
    Smooth,
    Term,
    applied,
    minus,
    number,
    over,
    plus,
    series,
    signs,
    times,
    to_power,
    value,
)

__all__ = ["Reader"]

_MOST_STEPS = 64  # jumps of `floor` within [0, 1]
_CALL = 50  # what a call costs, in the units of `effort`
_SHORT = 4096  # denominators up to here count as written

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
class _Closure:
    """A function, and what reads its body."""

    name: str
    parameters: tuple[syntax.Parameter, ...]
    statements: tuple[syntax.Let | syntax.Assert | syntax.Debug, ...]
    body: syntax.Expr
    reader: Reader


@dataclass(frozen=True, slots=True)
class _Condition:
    """A condition by name, and what reads it."""

    node: syntax.Expr
    reader: Reader


Bound = list[Smooth] | _Closure | _Condition


@dataclass(frozen=True, slots=True)
class Reader:
    """Reads an expression in `variable`, with numbers or functions of the script for the other names.

    `bound`: what the parameters and local names of a function stand for, on at least the interval read.
    """

    variable: str
    values: Mapping[str, float | int]
    formulas: Mapping[str, Formula] = field(default_factory=dict[str, Formula])
    bound: Mapping[str, Bound] = field(default_factory=dict[str, Bound])

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
            case syntax.Name(text) if text in self.bound:
                return self._part(text, node, lo, hi)
            case _:
                return [Smooth(lo, hi, self._atom(node))]

    def _part(self, text: str, node: syntax.Expr, lo: Fraction, hi: Fraction) -> list[Smooth]:
        pieces = self.bound[text]
        if not isinstance(pieces, list):
            raise GapError(f"`{text}` is not a number", node)
        return [replace(p, lo=max(p.lo, lo), hi=min(p.hi, hi)) for p in pieces if p.lo < hi and p.hi > lo]

    def _atom(self, node: syntax.Expr) -> Term:
        match node:
            case syntax.Number(_, span):
                return number(Fraction(span.text))
            case syntax.Angle(value, unit):
                size = number(Fraction(repr(value)))
                return size if unit == "rad" else times(times(size, number(_TURNS[unit])), HALF_TURN)
            case syntax.Name(text):
                return self._name(text, node)
            case syntax.Member(syntax.Name(module), name):
                return self._name(f"{module}.{name.text}", node)
            case _:
                raise GapError("only numbers and formulas of numbers can be followed", node)

    def _name(self, text: str, node: syntax.Expr) -> Term:
        if text == self.variable:
            return VARIABLE
        if text in self.values:
            return _constant(self.values[text])
        if text == "pi":
            return HALF_TURN
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
            case syntax.Name(text) if isinstance(condition := self.bound.get(text), _Condition):
                return condition.reader._truth(condition.node, lo, hi)
            case syntax.Name(text) if isinstance(value := self.values.get(text), bool):
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
        for callee, given in callees(node):
            closure = self._closure(callee)
            if closure is not None:
                return self._called(closure, node, given, lo, hi)
        name, given = call_parts(node)
        if name in ("min", "max"):
            return self._extreme(node, name, [self.pieces(a, lo, hi) for _, a in given])
        if name not in _NAMES or node.block is not None:
            what = f"`{name}`" if name else "this call"
            raise GapError(f"{what} cannot be followed", node)
        ordered = _ordered(node, name, given)
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
                return self._combined(node, partial(applied, name), *operands)

    def _closure(self, node: syntax.Expr) -> _Closure | None:
        """The function of the script that an expression is."""
        own = lambda_of(node)
        if own is not None:
            return _Closure("the function", own.parameters, (), own.body, self)
        if isinstance(node, syntax.Name) and node.text in self.bound:
            known = self.bound[node.text]
            return known if isinstance(known, _Closure) else None
        formula = named(node, self.formulas)
        if formula is None:
            return None
        if formula.recursive:
            raise GapError(f"`{formula.name}` calls itself, and only a formula that ends can be followed", node)
        reader = Reader("", formula.values, formula.formulas)
        return _Closure(f"`{formula.name}`", formula.parameters, formula.statements, formula.body, reader)

    def _called(
        self, closure: _Closure, node: syntax.Call, given: list[Labelled], lo: Fraction, hi: Fraction
    ) -> list[Smooth]:
        spend(_CALL)
        inner = closure.reader
        try:
            for parameter, argument in arguments_of(closure.parameters, given):
                if argument is not None:
                    made = self._bound(argument, lo, hi)
                elif parameter.default is not None:
                    made = inner._bound(parameter.default, lo, hi)
                else:
                    raise GapError(f"{closure.name} has other arguments", node)
                inner = inner._with(parameter.name.text, made)
            return inner._body(closure, lo, hi)
        except GapError as gap:
            gap.calls.append((node.span, closure.name))
            raise

    def _body(self, closure: _Closure, lo: Fraction, hi: Fraction) -> list[Smooth]:
        inner = self
        for statement in closure.statements:
            match statement:
                case syntax.Let(name, _, value):
                    inner = inner._with(name.text, inner._bound(value, lo, hi))
                case syntax.Assert(condition):
                    if not all(true for _, _, true in inner._truth(condition, lo, hi)):
                        raise GapError("this does not hold at every r", condition)
                case syntax.Debug():
                    pass
        return inner.pieces(closure.body, lo, hi)

    def _bound(self, node: syntax.Expr, lo: Fraction, hi: Fraction) -> Bound:
        """What a name stands for that is bound to an expression."""
        if _is_condition(node):
            return _Condition(node, self)
        if isinstance(node, syntax.Name) and isinstance(known := self.bound.get(node.text), _Condition):
            return known
        return self._closure(node) or self.pieces(node, lo, hi)

    def _with(self, name: str, made: Bound) -> Reader:
        return replace(self, bound={**self.bound, name: made})

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


def _ordered(node: syntax.Call, name: str, given: list[Labelled]) -> list[syntax.Expr]:
    """The arguments in the order of the parameters; labels have been checked before."""
    names = _NAMES[name]
    found = dict(zip(names, [a for label, a in given if label is None], strict=False))
    found |= {label: a for label, a in given if label is not None}
    if set(found) != set(names):
        raise GapError(f"`{name}` has other arguments", node)
    return [found[parameter] for parameter in names]


def _is_condition(node: syntax.Expr) -> bool:
    match node:
        case syntax.Group(inner):
            return _is_condition(inner)
        case syntax.IfExpr(_, then, _):
            return _is_condition(then)
        case syntax.Bool() | syntax.Unary("not") | syntax.Binary("and" | "or" | "<" | "<=" | ">" | ">=" | "==" | "!="):
            return True
        case _:
            return False


def _constant(x: float | int) -> Term:
    """A number of the script as what it was meant: 1 / 3 and pi / 2 are not just near that."""
    short = Fraction(x).limit_denominator(_SHORT)
    if float(short) == x:
        return number(short)
    turns = Fraction(x / pi).limit_denominator(_SHORT)
    if turns and abs(float(turns) * pi - x) <= 2.0**-52 * abs(x):
        return times(number(turns), HALF_TURN)
    return number(Fraction(repr(x)))


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
