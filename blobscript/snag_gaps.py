"""Rules for what is missing, and the last resort."""

from __future__ import annotations

from blobscript.diagnostics import Edit, Help
from blobscript.snag_signs import missing_let
from blobscript.stuck import DEFINERS, ENDS, ITEM_STARTS, OPERATORS, VALUE_STARTS, Repair, Snag, Stuck
from blobscript.tokens import CLOSERS, END, NEWLINE, Token

__all__ = [
    "after_return",
    "anything",
    "block_on_nothing",
    "missing_block",
    "missing_else",
    "missing_member",
    "missing_name",
    "missing_parameters",
    "missing_return",
    "missing_value",
    "unfinished_definition",
]


_ITEMS = "put the items into a list or a block: return sum { a, b on lines of their own }"
_EARLY = "one `return` at the end chooses between values: return if (n == 0) [] else [n]"


def missing_name(s: Stuck) -> Snag | None:
    if s.before.kind not in (*DEFINERS, "IMPORT", "AS") or not s.machine.accepts("NAME"):
        return None
    if s.before.kind == "FN" and s.token.kind == "LPAR":
        return None
    word = s.text(s.before)
    return s.snag(f"a name is missing after `{word}`", s.span(s.before), "what is it called?")


def missing_parameters(s: Stuck) -> Snag | None:
    """`fn f = 1`."""
    if s.kind(s.at - 2) not in ("FN", "KERNEL") or s.before.kind != "NAME" or s.token.kind not in (
        "EQUAL", "LBRACE", "ARROW", "COLON",
    ):  # fmt: skip
        return None
    word = s.text(s.tokens[s.at - 2])
    parameters = "(r)" if word == "kernel" else "()"
    found = s.snag(
        f"the parameters of `{s.text(s.before)}` are missing", s.span(s.before), "parentheses belong behind it",
        Help("write", (s.insert(s.before.end, parameters),)),
    )  # fmt: skip
    tokens = (Token("LPAR", s.before.end, s.before.end), Token("RPAR", s.before.end, s.before.end))
    return Snag(found.diagnostic, (Repair(s.at, 0, tokens),))


def missing_return(s: Stuck) -> Snag | None:
    """A function's body that does not end with `return`."""
    if s.machine.accepts("RETURN"):
        if s.token.kind == "RBRACE":
            found = s.snag(
                "this function returns nothing", s.span(s.token), "`return` and a value are missing before this"
            )
            return Snag(found.diagnostic, (Repair(s.at, 0, (Token("RETURN", s.token.start, s.token.start), s.hole())),))
        if s.token.kind == "NAME" and s.after.kind == "EQUAL":
            return missing_let(s, s.token, s.after)
        if s.token.kind in VALUE_STARTS | {"MINUS"} and s.kind(s.line_end()) == "RBRACE":
            found = s.snag(
                "`return` is missing before the result", s.span(s.token), "a function's body ends with `return`",
                Help("write", (s.insert(s.token.start, "return "),)),
            )  # fmt: skip
            return Snag(found.diagnostic, (Repair(s.at, 0, (Token("RETURN", s.token.start, s.token.start),)),))
        if s.token.kind in ITEM_STARTS:
            return s.snag(
                "a function's body has `let`, `assert` and `debug`, and one `return`", s.span(s.token),
                "not one of these",
                Help(_EARLY if s.token.kind == "IF" else _ITEMS),
            )  # fmt: skip
    if s.token.kind == "RBRACE" and s.machine.accepts(NEWLINE, "RETURN"):
        found = s.snag("this function returns nothing", s.span(s.token), "`return` and a value are missing before this")
        place = s.token.start
        tokens = (Token(NEWLINE, place, place), Token("RETURN", place, place), s.hole())
        return Snag(found.diagnostic, (Repair(s.at, 0, tokens),))
    return None


def after_return(s: Stuck) -> Snag | None:
    if s.token.kind != NEWLINE or not s.machine.accepts("RBRACE") or s.machine.accepts("RETURN"):
        return None
    if not any(isinstance(v, Token) and v.kind == "RETURN" for v in s.machine.values):
        return None
    return s.snag("nothing may stand after `return`", s.span(s.after), "never reached")


def missing_block(s: Stuck) -> Snag | None:
    """`for (x in xs) ball(x)`: the items of a loop stand in { }."""
    if not s.machine.accepts("LBRACE") or s.before.kind not in ("RPAR", "ELSE") or s.inside() not in ("", "LBRACE"):
        return None
    if s.before.kind == "RPAR" and s.kind(s.opener(s.at - 1) - 1) not in ("FOR", "IF"):
        return None
    word = s.text(s.before) if s.before.kind == "ELSE" else s.text(s.tokens[s.opener(s.at - 1) - 1])
    message = f"the items of this `{word}` stand in {{ }}"
    start = s.at + 1 if s.token.kind == NEWLINE and _is_deeper(s, s.after) else s.at
    first = s.tokens[start]
    if first.kind not in ITEM_STARTS | {"MINUS"}:
        return s.snag(message, s.span(s.before), "a block belongs behind this")
    end = s.line_end(start)
    last = s.tokens[end - 1]
    edits = (s.insert(s.before.end if start > s.at else first.start, " {" if start > s.at else "{ "),)
    edits += (s.insert(last.end, " }"),)
    found = s.snag(message, s.place(first.start, last.end), "put { } around this", Help("write", edits))
    repairs = (
        Repair(end, 0, (Token("RBRACE", last.end, last.end),)),
        Repair(s.at, start - s.at, (Token("LBRACE", first.start, first.start),)),
    )
    return Snag(found.diagnostic, repairs)


def _is_deeper(s: Stuck, token: Token) -> bool:
    """Does a token start a line that is indented deeper than the one it is stuck in?"""
    column = s.source.position(token.start)[1]
    line = s.source.position(s.before.start)[0]
    text = s.source.line(line)
    return column > len(text) - len(text.lstrip()) + 1


def missing_else(s: Stuck) -> Snag | None:
    """`let x = if (c) 1`: a value for both cases."""
    if not s.machine.accepts("ELSE") or s.token.kind not in ENDS:
        return None
    if s.kind(s.item) == "IF":
        found = s.snag(
            "the items of this `if` stand in { }", s.place(s.tokens[s.item].start, s.before.end), "a block is missing",
            Help("with a block: if (c) { a }, as a value: if (c) a else b"),
        )  # fmt: skip
    else:
        found = s.snag(
            "an `if` that is a value needs its `else`", s.place(s.before.end, s.before.end),
            "`else` and a value are missing here",
        )  # fmt: skip
    place = s.before.end
    return Snag(found.diagnostic, (Repair(s.at, 0, (Token("ELSE", place, place), s.hole())),))


def missing_value(s: Stuck) -> Snag | None:
    """An operator, `=`, comma or bracket with nothing behind it."""
    if not s.machine.accepts("NAME"):
        return None
    kind, sign = s.before.kind, s.text(s.before)
    if s.token.kind in ITEM_STARTS and not s.on_same_line() and s.inside() in ("", "LBRACE"):
        place = s.before.end
        found = s.snag(f"a value is missing after `{sign}`", s.span(s.before), "nothing follows on this line")
        return Snag(found.diagnostic, (Repair(s.at, 0, (s.hole(), Token(NEWLINE, place, place))),))
    if s.token.kind not in ENDS | OPERATORS | {"EQUAL", "COLON", "DOT", "ELSE"}:
        return None
    drop = (Repair(s.at, 1, ()),)
    if s.token.kind == "COMMA" and kind in ("COMMA", "LPAR", "LSQB"):
        help_ = Help("leave it out", (s.replaced(s.token, ""),))
        what = "two commas, and nothing between them" if kind == "COMMA" else "nothing stands before this comma"
        return Snag(s.snag(what, s.span(s.token), "a value is missing before it", help_).diagnostic, drop)
    hole = (Repair(s.at, 0, (s.hole(),)),)
    if kind == "LPAR" and s.token.kind == "RPAR":
        span = s.place(s.before.start, s.token.end)
        return Snag(s.snag("these parentheses are empty", span, "a value is missing").diagnostic, hole)
    if kind in ("COLON", "ARROW"):
        return Snag(s.snag(f"a type is missing after `{sign}`", s.span(s.before), "no type follows").diagnostic, hole)
    if kind in OPERATORS | {"EQUAL", "NOT", "IN", "STEP", "RETURN", "ASSERT", "DEBUG", "ELSE", "SPREAD", "COMMA"}:
        found = s.snag(f"a value is missing after `{sign}`", s.span(s.before), "nothing follows that it could be")
        return Snag(found.diagnostic, hole)
    if s.token.kind in OPERATORS and kind in ("LPAR", "LSQB", "LBRACE", NEWLINE, "RPAR"):
        sign = s.text(s.token)
        return Snag(
            s.snag(f"a value is missing before `{sign}`", s.span(s.token), "nothing to its left").diagnostic, hole
        )
    return None


def missing_member(s: Stuck) -> Snag | None:
    if s.before.kind != "DOT":
        return None
    found = s.snag("a name is missing after this `.`", s.span(s.before), "of what?")
    return Snag(found.diagnostic, (Repair(s.at, 0, (s.hole(),)),))


def block_on_nothing(s: Stuck) -> Snag | None:
    """`0.5 { }`: a block is the last argument of something callable."""
    if s.token.kind != "LBRACE":
        return None
    if s.before.kind == "EQUAL" and s.kind(s.item) == "FN":
        return _equal_before_body(s)
    return s.snag(
        "a block can only follow a name or a call",
        s.span(s.token),
        "nothing before it takes a block",
        Help("as in: sum { }, surface(threshold = 0.5) { }"),
    )


def _equal_before_body(s: Stuck) -> Snag:
    """`fn f(x: int) = { ... }`."""
    edit = Edit(s.place(s.before.start, s.token.start), "")
    found = s.snag(
        "a body in { } follows without `=`",
        s.span(s.before),
        "not here",
        Help("leave it out; the last line of the body is `return` and the result", (edit,), "safe"),
    )
    return Snag(found.diagnostic, (Repair(s.at - 1, 1, ()),))


def unfinished_definition(s: Stuck) -> Snag | None:
    """`let x` and nothing else."""
    if s.token.kind not in (NEWLINE, END, "RBRACE") or s.kind(s.item) not in (*DEFINERS, "AT", "IMPORT"):
        return None
    first = s.kind(s.item)
    whole = s.place(s.tokens[s.item].start, s.before.end)
    if first == "IMPORT":
        help_ = Help('as in: import leg from "limbs.blob", or: import "limbs.blob" as limbs')
        return s.snag("this import does not say where from, or as what", whole, "not finished", help_)
    if s.machine.accepts("EQUAL"):
        what = "body" if first in ("FN", "KERNEL") else "type" if first == "TYPE" else "value"
        return s.snag(f"the {what} of this definition is missing", whole, f"`=` and a {what} belong behind it")
    if first == "AT":
        return s.snag("no definition follows this attribute", whole, "belongs to the line below")
    return s.snag("this definition is not finished", whole, "something is missing behind it")


def anything(s: Stuck) -> Snag:
    """What no rule knows."""
    if s.token.kind in (NEWLINE, END):
        whole = s.place(s.tokens[s.item].start, max(s.before.end, s.tokens[s.item].start))
        return s.snag("this is not finished", whole, "something is missing behind it")
    text = s.text(s.token)
    if s.token.kind in CLOSERS:
        return s.snag(f"something is missing before this `{text}`", s.span(s.token), "too early")
    after = f" after `{s.text(s.before)}`" if s.before.kind != NEWLINE and s.text(s.before).strip() else " here"
    return s.snag(f"`{text}` makes no sense{after}", s.span(s.token), "does not fit")
