"""What is said about a user kernel that is none: E0501 to E0506."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from blobscript import intervals, syntax, terms
from blobscript.diagnostics import Diagnostic, Help, Label
from blobscript.intervals import Interval
from blobscript.source import Span
from blobscript.terms import GapError, Smooth

__all__ = [
    "Bend",
    "Ends",
    "Jump",
    "Subject",
    "jumps",
    "kinks",
    "needless",
    "not_flat",
    "not_made",
    "not_proved",
    "place",
    "rises",
    "wrong_ends",
]


@dataclass(frozen=True, slots=True)
class Subject:
    """The kernel that is talked about."""

    name: str
    variable: str
    body: syntax.Expr


@dataclass(frozen=True, slots=True)
class Ends:
    """Values or slopes at r = 0 and r = 1; None: nothing is wrong with that one."""

    first: Interval | None
    last: Interval | None


@dataclass(frozen=True, slots=True)
class Jump:
    """Two pieces that meet, and what differs there: values or slopes."""

    left: Smooth
    right: Smooth
    before: Interval
    after: Interval


@dataclass(frozen=True, slots=True)
class Bend:
    """D rises on [lo, hi]; the terms that hold at its ends."""

    lo: Fraction
    hi: Fraction
    first: terms.Term
    last: terms.Term
    is_exact: bool


# ---- numbers ------------------------------------------------------------------------------------------


def place(r: Fraction) -> str:
    """1/3, or 0.471 where there is no short fraction."""
    return str(r) if r.denominator <= 64 else f"{float(r):.3g}"


def _value(x: Interval | None, digits: int = 4) -> str:
    """Four digits; 0 for what is 0 to 30 digits."""
    number = 0.0 if x is None else float(intervals.middle(x))
    return "0" if abs(number) < 1e-29 else f"{number:.{digits}g}"


def _two_values(x: Interval, y: Interval) -> tuple[str, str]:
    """With as many digits as it takes to tell them apart."""
    digits = 4
    while _value(x, digits) == _value(y, digits) and digits < 16:
        digits += 1
    return _value(x, digits), _value(y, digits)


# ---- the curve ------------------------------------------------------------------------------------------

_ROWS, _COLUMNS = 4, 12


def curve(pieces: list[Smooth]) -> str:
    """A small picture of D, one column per r, as lines of a note."""
    heights = [_height(pieces, Fraction(2 * j + 1, 2 * _COLUMNS)) for j in range(_COLUMNS)]
    ends = [_height(pieces, Fraction(0)), _height(pieces, Fraction(1))]
    top, bottom = max(heights + ends), min(heights + ends)
    span = (top - bottom) or 1.0
    filled = [1.0 + (_ROWS - 1) * (h - bottom) / span for h in heights]
    width = max(len(f"{top:.4g}"), len(f"{bottom:.4g}"))
    lines: list[str] = []
    for row in range(_ROWS, 0, -1):
        bar = "".join("#" if f >= row - 0.25 else "." if f >= row - 0.38 else " " for f in filled).rstrip()
        number = f"{top:.4g}" if row == _ROWS else f"{bottom:.4g}" if row == 1 else ""
        lines.append(f"{'D(r)' if row == _ROWS else '':6}{number:>{width}} |{bar}")
    lines[-1] = f"{lines[-1]:<{6 + width + 2 + _COLUMNS}}   r = 0 .. 1"
    return "\n".join(lines)


def _height(pieces: list[Smooth], r: Fraction) -> float:
    piece = next(p for p in pieces if r <= p.hi)
    try:
        return float(intervals.middle(terms.value(piece.term, r)))
    except intervals.UndefinedError:
        return 0.0


# ---- the errors -------------------------------------------------------------------------------------------


def wrong_ends(subject: Subject, pieces: list[Smooth], ends: Ends, last_is_right: bool) -> Diagnostic:
    first, last = _value(ends.first), _value(ends.last)
    if last_is_right:
        message = f"kernel `{subject.name}` must start at 1, but D(0) = {first}"
        label = f"at r = 0 this is {first}"
        why = "The weight of a blob is what it has at its skeleton"
    else:
        message = f"kernel `{subject.name}` must end at 0, but D(1) = {last}"
        label = f"at r = 1 this is {last}, and at r = 0 it is {first}"
        why = "A jump at r = 1 would tear the surface along a sphere"
    text = f"a kernel is 1 at the skeleton (r = 0) and 0 at the reach (r = 1).\n{why}"
    notes = (curve(pieces),)
    return Diagnostic("E0501", message, subject.body.span, label, helps=(Help(text),), notes=notes)


def not_flat(subject: Subject, pieces: list[Smooth], ends: Ends) -> Diagnostic:
    """`ends`: the slopes that are not 0."""
    slopes = [(0, ends.first, pieces[0]), (1, ends.last, pieces[-1])]
    wrong = [(r, _value(slope), piece) for r, slope, piece in slopes if slope is not None]
    where = " and ".join(f"r = {r}" for r, _, _ in wrong)
    shapes = {0: "a sharp tip or ridge at the skeleton", 1: "a crease where the blob ends"}
    text = f"a slope there makes {' and '.join(shapes[r] for r, _, _ in wrong)}"
    return Diagnostic(
        "E0502",
        f"kernel `{subject.name}` is not flat at {where}",
        _branch_span(subject, wrong[0][2]) if len(wrong) == 1 else subject.body.span,
        f"its slope is {' and '.join(f'{slope} at r = {r}' for r, slope, _ in wrong)}, it should be 0",
        helps=(Help(f"{text}.\nIf that is what you want, say so on the line above:\n@allow(crease)"),),
        notes=(curve(pieces),),
    )


def rises(subject: Subject, pieces: list[Smooth], rising: list[Bend]) -> Diagnostic:
    first = rising[0]
    low, high = _two_values(terms.value(first.first, first.lo), terms.value(first.last, first.hi))
    then = ", then falls" if first.hi < 1 else ""
    probe = _probe(first.lo, first.hi)
    slope = terms.series(first.first, intervals.from_fraction(probe), 1)[1]
    how = "proved exactly" if first.is_exact else "proved"
    return Diagnostic(
        "E0503",
        f"kernel `{subject.name}` rises: it should only fall",
        subject.body.span,
        f"rises from D({place(first.lo)}) = {low} to D({place(first.hi)}) = {high}{then}",
        helps=(Help("if the hollow shell is what you want, say so on the line above:\n@allow(nonmonotone)"),),
        notes=(f"{how}: D'({probe}) = {_value(slope)} > 0", curve(pieces)),
    )


def _probe(lo: Fraction, hi: Fraction) -> Fraction:
    """A place well within, with a small power of two below the line."""
    denominator = 2
    while True:
        probe = Fraction(round((lo + hi) / 2 * denominator), denominator)
        if lo + (hi - lo) / 8 < probe < hi - (hi - lo) / 8:
            return probe
        denominator *= 2


def jumps(subject: Subject, pieces: list[Smooth], jump: Jump) -> Diagnostic:
    at = place(jump.left.hi)
    sides = "branches" if _split(jump) else "sides"
    helps = (Help(f"make both {sides} agree in value and slope at r = {at}{_example(subject, jump)}"),)
    return _at_joint(
        "E0504",
        f"kernel `{subject.name}` jumps at r = {at}",
        subject,
        pieces,
        jump,
        (f"{_value(jump.before)} at r = {at}", f"{_value(jump.after)} at r = {at}"),
        helps,
    )


def kinks(subject: Subject, pieces: list[Smooth], jump: Jump) -> Diagnostic:
    at = place(jump.left.hi)
    return _at_joint(
        "E0505",
        f"kernel `{subject.name}` has a kink at r = {at}: its slope goes from {_value(jump.before)}"
        f" to {_value(jump.after)}",
        subject,
        pieces,
        jump,
        (f"slope {_value(jump.before)} at r = {at}", f"slope {_value(jump.after)} at r = {at}"),
        (
            Help(
                f"make both sides agree in slope at r = {at}, or,\n"
                "if the crease is what you want, say so on the line above:\n@allow(crease)"
            ),
        ),
    )


def _at_joint(
    code: str,
    message: str,
    subject: Subject,
    pieces: list[Smooth],
    jump: Jump,
    texts: tuple[str, str],
    helps: tuple[Help, ...],
) -> Diagnostic:
    split, notes = _split(jump), (curve(pieces),)
    if split is None:
        return Diagnostic(code, message, subject.body.span, " | ".join(texts), helps=helps, notes=notes)
    branches = sorted(((p.branch, text) for p, text in zip((jump.left, jump.right), texts, strict=True)), key=_start)
    labels = tuple(Label(branch.span, text) for branch, text in branches if branch is not None)
    if not _is_within(split, subject.body):
        labels += (Label(subject.body.span, f"in the kernel `{subject.name}`"),)
    return Diagnostic(code, message, _header(split), "the two branches meet here", labels, helps, notes)


def _start(entry: tuple[syntax.Expr | None, str]) -> int:
    return entry[0].span.start if entry[0] is not None else 0


def _split(jump: Jump) -> syntax.IfExpr | None:
    """The `if` whose branches meet, if that is what happens."""
    split = jump.left.split
    if split is None or jump.right.split is None or jump.left.branch is jump.right.branch:
        return None
    return split


def _header(split: syntax.IfExpr) -> Span:
    """`if (condition)`."""
    text = split.span.source.text
    end = text.find(")", split.condition.span.end, split.then.span.start)
    return Span(split.span.source, split.span.start, end + 1 if end >= 0 else split.condition.span.end)


def _example(subject: Subject, jump: Jump) -> str:
    """Two parabolas that meet with one slope: 1 - r^2 / c and (1 - r)^2 / (1 - c)."""
    split, c, r = _split(jump), jump.left.hi, subject.variable
    if split is None or not _is_within(split, subject.body) or not 0 < c < 1 or c.denominator > 64:
        return ""  # in a function of the script, the variable has another name
    inner = f"1 - {_factor(1 / c)}{r}^2"
    outer = f"{_factor(1 / (1 - c))}(1 - {r})^2"
    first, second = (inner, outer) if _is_first(split, jump.left) else (outer, inner)
    return f",\nfor example: {_header(split).text} {first} else {second}"


def _is_within(node: syntax.Expr, whole: syntax.Expr) -> bool:
    own, around = node.span, whole.span
    return own.source is around.source and around.start <= own.start and own.end <= around.end


def _is_first(split: syntax.IfExpr, left: Smooth) -> bool:
    return left.branch is split.then


def _factor(x: Fraction) -> str:
    return f"{x.numerator} * " if x.denominator == 1 else f"{x.numerator} / {x.denominator} * "


def _branch_span(subject: Subject, piece: Smooth) -> Span:
    return piece.branch.span if piece.branch is not None else subject.body.span


def not_proved(subject: Subject, reason: str, gap: GapError | None) -> Diagnostic:
    node = gap.node if gap is not None else None
    return Diagnostic(
        "E0506",
        f"kernel `{subject.name}` could not be proved: {reason}",
        node.span if node is not None else subject.body.span,
        "here the proof ends",
        tuple(Label(span, f"in {name}, called here") for span, name in (gap.calls if gap is not None else ())),
        helps=(
            Help(
                "formulas with + - * / ^, exp, sqrt, sin, cos, ..., min, max, abs and if can be proved,\n"
                "and functions of the script made of these.\n"
                "To use the kernel as it is, unproved, say so on the line above:\n@allow(unproved)"
            ),
        ),
    )


def not_made(subject: Subject, reason: str) -> Diagnostic:
    return Diagnostic(
        "E0506",
        f"kernel `{subject.name}` cannot be used: {reason}",
        subject.body.span,
        "not even unproved",
        helps=(Help("a kernel needs a value at every r from 0 to 1, without jumps, 1 at r = 0 and 0 at r = 1"),),
    )


def needless(name: str, waivers: list[str], span: Span) -> Diagnostic:
    words = ", ".join(f"@allow({waiver})" for waiver in waivers)
    return Diagnostic(
        "W0501",
        f"kernel `{name}` does not need {words}",
        span,
        "it is proved without",
        helps=(Help("leave it out, so that the check stays on"),),
    )
