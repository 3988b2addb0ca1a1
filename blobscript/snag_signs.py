"""Rules for numbers, `=`, `:` and operators that are written in another way here."""

from __future__ import annotations

from blobscript.diagnostics import Diagnostic, Edit, Help
from blobscript.source import Span
from blobscript.stuck import DEFINERS, LITERALS, VALUE_STARTS, Repair, Snag, Stuck
from blobscript.tokens import END, NEWLINE, Token
from blobscript.words import UNITS

__all__ = [
    "assignment",
    "chained",
    "colon",
    "double_equal",
    "doubled",
    "half_number",
    "loop_in",
    "missing_equal",
    "missing_let",
]


def half_number(s: Stuck) -> Snag | None:
    """`.5`, `1.`, `0,5` and `5 deg`."""
    if s.token.kind == "COMMA" and _is_decimal(s):
        point = s.replaced(s.token, ".")
        found = s.snag(
            "a decimal number has a point, not a comma", s.place(s.before.start, s.after.end), "one number or two?",
            Help("write", (point,)), code="E0108",
        )  # fmt: skip
        return Snag(found.diagnostic, (Repair(s.at - 1, 3, (Token("NUMBER", s.before.start, s.after.end),)),))
    if s.token.kind == "DOT" and s.after.kind == "NUMBER" and s.token.end == s.after.start:
        if not s.machine.accepts("NUMBER"):
            return None
        return _number_snag(
            s, "a number starts with a digit", s.token.start, s.after.end, s.insert(s.token.start, "0"), s.at, 2
        )
    if s.before.kind == "DOT" and s.token.kind != "NAME" and s.kind(s.at - 2) == "NUMBER":
        start = s.tokens[s.at - 2].start
        return _number_snag(
            s, "a number ends with a digit", start, s.before.end, s.insert(s.before.end, "0"), s.at - 2, 2
        )
    if s.before.kind == "NUMBER" and s.token.kind == "NAME" and s.text(s.token) in UNITS and s.on_same_line():
        gap = Edit(s.place(s.before.end, s.token.start), "")
        message = f"the unit `{s.text(s.token)}` stands right behind its number"
        return _number_snag(s, message, s.before.start, s.token.end, gap, s.at - 1, 2)
    return None


def _is_decimal(s: Stuck) -> bool:
    """Whole numbers on both sides of a comma, without a space, where the comma has no other meaning."""
    numbers = (
        s.before.kind == s.after.kind == "NUMBER" and s.before.end == s.token.start and s.token.end == s.after.start
    )
    return numbers and s.text(s.before).isdigit() and s.text(s.after).isdigit() and s.inside() in ("", "LBRACE")


def _number_snag(s: Stuck, message: str, start: int, end: int, edit: Edit, index: int, count: int) -> Snag:
    unit = s.token.kind == "NAME"
    token = Token("ANGLE" if unit else "NUMBER", start, end)
    found = s.snag(
        message, s.place(start, end), "a space too many" if unit else "a digit is missing",
        Help("write", (edit,), "safe"), code="E0108",
    )  # fmt: skip
    return Snag(found.diagnostic, (Repair(index, count, (token,)),))


# ---- = and : and the like ----------------------------------------------------------------------


def doubled(s: Stuck) -> Snag | None:
    """Operators of other languages, cut in two by the lexer: `=>`, `**`, `+=`, `:=`, `++`."""
    for sign, rule in ((s.token, _pair(s, s.before, s.token)), (s.after, _pair(s, s.token, s.after))):
        if rule is None:
            continue
        first = s.before if sign is s.token else s.token
        span = s.place(first.start, sign.end)
        message, label, text, kind, advice = rule
        helps = (Help("write", (Edit(span, text),)),) if text else (Help(advice),)
        index = s.at - 1 if sign is s.token else s.at
        if span.text == "=>" and s.kind(index - 1) == "RPAR" and s.kind(s.item) != "FN":
            return _arrow_function(s, span, index)
        repairs = (Repair(index, 2, (Token(kind, span.start, span.end),)),) if kind else ()
        return Snag(Diagnostic("E0103", message, span, label, helps=helps), repairs)
    return None


def _arrow_function(s: Stuck, arrow: Span, index: int) -> Snag:
    """`(x) => e`."""
    opener = s.opener(index - 1)
    start = s.tokens[opener].start
    found = s.snag(
        "a function is written `fn(x) = ...`", arrow, "not used",
        Help("write", (s.insert(start, "fn"), Edit(arrow, "="))),
    )  # fmt: skip
    repairs = (
        Repair(index, 2, (Token("EQUAL", arrow.start, arrow.end),)),
        Repair(opener, 0, (Token("FN", start, start),)),
    )
    return Snag(found.diagnostic, repairs)


def _pair(s: Stuck, first: Token, second: Token) -> tuple[str, str, str, str, str] | None:
    """(message, label, what to write, its kind, advice) for two signs that stand together."""
    if first.end != second.start or second.start == second.end:
        return None
    text = s.source.text[first.start : second.end]
    match text:
        case "=>":
            return "a function is written without `=>`", "not used", "=", "EQUAL", ""
        case "**":
            return "powers are written with `^`", "not an operator", "^", "POWER", ""
        case ":=":
            return "definitions are written with `=`", "not used", "=", "EQUAL", ""
        case "+=" | "-=" | "*=" | "/=" | "++" | "--" if s.at <= s.item + 2:
            advice = "give the new value a new name with `let`; to add up, use `sum { }` or a function"
            return "a name keeps its value", f"`{text}` would change it", "", "", advice
        case "<-":
            return "definitions are written with `=`", "not used", "=", "EQUAL", ""
        case _:
            return None


def assignment(s: Stuck) -> Snag | None:
    """`x = 5` without `let`, `a.x = 5`, and `=` where `==` compares."""
    if s.token.kind != "EQUAL":
        return None
    if s.at == s.item + 1 and s.before.kind == "NAME" and s.inside() in ("", "LBRACE"):
        return missing_let(s, s.before, s.token)
    if s.machine.accepts("COMPARE"):
        if s.inside() in ("", "LBRACE") and s.kind(s.item) not in ("ASSERT", "LET", "FN", "DEBUG"):
            return s.snag("nothing is ever changed, only defined", s.span(s.token), "no new value can be given here")
        found = s.snag(
            "`=` gives a name to something, `==` compares",
            s.span(s.token),
            "a comparison is meant",
            Help("write", (s.replaced(s.token, "=="),)),
        )
        return Snag(found.diagnostic, (Repair(s.at, 1, (Token("COMPARE", s.token.start, s.token.end),)),))
    return None


def missing_let(s: Stuck, name: Token, equal: Token) -> Snag:
    """`x = 5` on a line of its own."""
    found = s.snag(
        f"a definition of `{s.text(name)}` starts with `let`",
        s.place(name.start, equal.end),
        "nothing is ever changed, only defined",
        Help("write", (s.insert(name.start, "let "),)),
    )
    index = s.at if name is s.token else s.at - 1
    return Snag(found.diagnostic, (Repair(index, 0, (Token("LET", name.start, name.start),)),))


def colon(s: Stuck) -> Snag | None:
    """`radius: 1` for `radius = 1`."""
    if s.token.kind != "COLON" or s.before.kind != "NAME" or not s.machine.accepts("EQUAL"):
        return None
    if s.kind(s.at - 2) not in ("LPAR", "COMMA"):
        return None
    start = s.before.end if s.source.text[s.before.end : s.token.start].isspace() else s.token.start
    edit = Edit(s.place(start, s.token.end), " =")
    found = s.snag(
        f"the value of `{s.text(s.before)}` is given with `=`", s.span(s.token), "`:` is for types",
        Help("write", (edit,), "safe"),
    )  # fmt: skip
    return Snag(found.diagnostic, (Repair(s.at, 1, (Token("EQUAL", s.token.start, s.token.end),)),))


def double_equal(s: Stuck) -> Snag | None:
    """`let x == 1`."""
    if s.token.kind != "COMPARE" or s.text(s.token) != "==" or not s.machine.accepts("EQUAL"):
        return None
    found = s.snag(
        f"`{s.text(s.before)}` is defined with one `=`", s.span(s.token), "`==` compares",
        Help("write", (s.replaced(s.token, "="),), "safe"),
    )  # fmt: skip
    return Snag(found.diagnostic, (Repair(s.at, 1, (Token("EQUAL", s.token.start, s.token.end),)),))


def loop_in(s: Stuck) -> Snag | None:
    """`for (x of xs)`, `for (x = 0..8)`."""
    if not s.machine.accepts("IN") or s.kind(s.item) in ("PARAM", "AT"):
        return None
    replaces = s.token.kind in ("EQUAL", "COLON", "FROM") or (s.token.kind == "NAME" and s.after.kind != "RPAR")
    if replaces:
        span, edit = s.span(s.token), s.replaced(s.token, "in")
        repair = Repair(s.at, 1, (Token("IN", s.token.start, s.token.end),))
    else:
        span, edit = s.place(s.before.end, s.before.end), s.insert(s.before.end, " in")
        repair = Repair(s.at, 0, (Token("IN", s.before.end, s.before.end),))
    found = s.snag("`in` is missing in this header", span, "between the name and the list", Help("write", (edit,)))
    return Snag(found.diagnostic, (repair,))


def missing_equal(s: Stuck) -> Snag | None:
    """`let x 5`, `fn f(x) x + 1`, `(threshold 0.5)`."""
    if not s.machine.accepts("EQUAL") or s.token.kind in (NEWLINE, END):
        return None
    starts_value = s.token.kind in VALUE_STARTS | {"MINUS"}
    if s.inside() in ("LPAR", "LSQB"):
        named = s.before.kind == "NAME" and s.token.kind in LITERALS and s.kind(s.at - 2) in ("LPAR", "COMMA")
        if not named:
            return None
    elif not starts_value or s.kind(s.item) not in (*DEFINERS, "AT") or not s.on_same_line():
        return None
    what = f"`{s.text(s.before)}`" if s.before.kind == "NAME" else "the body"
    where = "after" if s.before.kind == "NAME" else "before"
    found = s.snag(
        f"`=` is missing {where} {what}", s.span(s.token), "the value starts here",
        Help("write", (s.insert(s.before.end, " ="),)),
    )  # fmt: skip
    return Snag(found.diagnostic, (Repair(s.at, 0, (Token("EQUAL", s.before.end, s.before.end),)),))


def chained(s: Stuck) -> Snag | None:
    """`0 < x < 1` and `0..1..2`."""
    if s.token.kind == "COMPARE" and s.machine.accepts("AND"):
        found = s.snag(
            "comparisons do not chain", s.span(s.token), "a second comparison",
            Help("write both out: a < b and b < c"),
        )  # fmt: skip
        repair = Repair(s.at, 0, (Token("AND", s.before.end, s.before.end), s.hole()))
        return Snag(found.diagnostic, (repair,))
    if s.token.kind == "RANGE" and s.machine.accepts("COMPARE"):
        return s.snag(
            "a range has two ends", s.span(s.token), "a third end",
            Help("for other steps: [for (i in 0..<8) 0.5 * i]"),
        )  # fmt: skip
    return None
