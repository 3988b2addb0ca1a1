"""Rules for whole constructions of other languages: comments, transforms in front, comprehensions, lambdas."""

from __future__ import annotations

from blobscript.diagnostics import Diagnostic, Edit, Help
from blobscript.stuck import Repair, Snag, Stuck
from blobscript.tokens import END, NEWLINE, Token
from blobscript.words import FOREIGN_CALLS, TRANSFORMS

__all__ = [
    "block_comment",
    "braces_for_a_record",
    "lambda_word",
    "list_for_a_range",
    "transform_in_front",
    "turned_comprehension",
]


def block_comment(s: Stuck) -> Snag | None:
    """`/* ... */`."""
    first = s.at if s.token.kind == "OVER" else s.at - 1
    slash, star = s.tokens[first], s.tokens[min(first + 1, len(s.tokens) - 1)]
    if slash.kind != "OVER" or star.kind != "TIMES" or slash.end != star.start:
        return None
    text = s.source.text
    stop = text.find("*/", star.end)
    end = len(text) if stop < 0 else stop + 2
    last = first
    while s.tokens[last].kind != END and s.tokens[last].start < end:
        last += 1
    whole = s.place(slash.start, end)
    helps: tuple[Help, ...] = (Help("begin each line of it with `//`"),)
    if stop >= 0 and "\n" not in whole.text and not text[end:].partition("\n")[0].strip():
        helps = (Help("write", (Edit(whole, f"// {whole.text[2:-2].strip()}"),), "safe"),)
    found = Diagnostic("E0109", "comments start with `//`", whole, "`/*` and `*/` mean nothing here", helps=helps)
    after = s.tokens[last]
    ends = first > s.item and after.kind not in (NEWLINE, END) and "\n" in text[whole.start : after.start]
    return Snag(found, (Repair(first, last - first, (Token(NEWLINE, end, end),) if ends else ()),))


def transform_in_front(s: Stuck) -> Snag | None:
    """`translate([1, 0, 0]) ball(...)`: what happens to a thing stands behind it."""
    if s.before.kind != "RPAR" or s.token.kind != "NAME" or not s.on_same_line():
        return None
    opener = s.opener(s.at - 1)
    if opener - 1 != s.item or s.kind(s.item) != "NAME":
        return None
    word = s.text(s.tokens[s.item])
    name = FOREIGN_CALLS[word][1] if word in FOREIGN_CALLS else word
    if name not in TRANSFORMS:
        return None
    end = s.line_end()
    first, last = s.tokens[s.item].start, s.tokens[end - 1].end
    thing = s.source.text[s.token.start : last]
    arguments = s.source.text[s.tokens[opener].start : s.before.end]
    found = s.snag(
        f"`{word}` stands behind the thing that it changes",
        s.place(first, s.before.end),
        "in front, as in OpenSCAD",
        Help("write", (Edit(s.place(first, last), f"{thing}.{name}{arguments}"),)),
    )
    called = s.tokens[s.item] if word == name else Token("NAME", first, first)  # said once is enough
    moved = (*s.tokens[s.at : end], Token("DOT", last, last), called, *s.tokens[opener : s.at])
    return Snag(found.diagnostic, (Repair(s.item, end - s.item, moved),))


def turned_comprehension(s: Stuck) -> Snag | None:
    """`[2 * i for i in 0..5]`, as in Python: the `for` comes first, in parentheses."""
    if s.token.kind != "FOR" or s.inside() != "LSQB" or s.after.kind != "NAME":
        return None
    end = s.line_end()
    middle = next((i for i in range(s.at, end) if s.kind(i) == "IN"), None)
    opener = _list_start(s)
    if middle is None or middle + 1 == end or opener is None or s.kind(end) != "RSQB":
        return None
    test = next((i for i in range(middle, end) if s.kind(i) == "IF"), end)
    value, loop = s.tokens[opener + 1 : s.at], s.tokens[s.at + 1 : test]
    condition = s.tokens[test + 1 : end]
    if not value or not loop or (test < end and not condition):
        return None
    written = f"for ({_text(s, loop)}) " + (f"if ({_text(s, condition)}) " if condition else "") + _text(s, value)
    place = s.token.start
    left, right = Token("LPAR", place, place), Token("RPAR", place, place)
    tokens = (s.token, left, *loop, right)
    if condition:
        tokens += (s.tokens[test], left, *condition, right)
    found = s.snag(
        "in a list the `for` comes first, in parentheses",
        s.place(s.token.start, s.tokens[end - 1].end),
        "behind the value, as in Python",
        Help("write", (Edit(s.place(value[0].start, s.tokens[end - 1].end), written),)),
    )
    return Snag(found.diagnostic, (Repair(opener + 1, end - opener - 1, (*tokens, *value)),))


def _list_start(s: Stuck) -> int | None:
    """The index of the `[` that is open, if no comma stands between it and the stuck token."""
    depth = 0
    for index in range(s.at - 1, s.item - 1, -1):
        kind = s.kind(index)
        if kind in ("RPAR", "RSQB", "RBRACE"):
            depth += 1
        elif kind in ("LPAR", "LSQB", "LBRACE"):
            if depth == 0:
                return index if kind == "LSQB" else None
            depth -= 1
        elif kind == "COMMA" and depth == 0:
            return None
    return None


def _text(s: Stuck, tokens: list[Token]) -> str:
    return s.source.text[tokens[0].start : tokens[-1].end]


def lambda_word(s: Stuck) -> Snag | None:
    """`lambda x: 2 * x`, as in Python."""
    if s.before.kind != "NAME" or s.text(s.before) != "lambda" or s.token.kind not in ("NAME", "COLON"):
        return None
    colon = next((i for i in range(s.at, s.line_end()) if s.kind(i) == "COLON"), None)
    if colon is None:
        return None
    names = s.tokens[s.at : colon]
    head = s.place(s.before.start, s.tokens[colon].end)
    written = f"fn({_text(s, names) if names else ''}) ="
    found = s.snag(
        "a function without a name is written `fn(x) = ...`",
        head,
        "as in Python",
        Help("write", (Edit(head, written),)),
    )
    start, stop = s.before.start, s.tokens[colon].end
    tokens = (
        Token("FN", start, s.before.end),
        Token("LPAR", s.before.end, s.before.end),
        *names,
        Token("RPAR", stop, stop),
        Token("EQUAL", stop, stop),
    )
    return Snag(found.diagnostic, (Repair(s.at - 1, colon - s.at + 2, tokens),))


def list_for_a_range(s: Stuck) -> Snag | None:
    """`for (i = [0:10])`, as in OpenSCAD."""
    if s.kind(s.at - 2) != "LPAR" or s.kind(s.at - 3) != "FOR" or s.token.kind not in ("EQUAL", "IN"):
        return None
    if s.after.kind != "LSQB" or s.token.kind == "IN":
        return None
    end = s.line_end()
    colons = [i for i in range(s.at, end) if s.kind(i) == "COLON"]
    if not colons or s.kind(end - 1) != "RSQB":
        return None
    first, last = s.tokens[s.at + 2 : colons[0]], s.tokens[colons[-1] + 1 : end - 1]
    if not first or not last:
        return None
    whole = s.place(s.token.start, s.tokens[end - 1].end)
    written = f"in {_text(s, first)}..{_text(s, last)}"
    helps = Help("write", (Edit(whole, written),))
    if len(colons) > 1:
        helps = Help("for other steps than 1: for (i in 0..<8) { let x = 0.5 * i ... }")
    found = s.snag("a `for` goes over a list or a range: `in 0..8`", whole, "as in OpenSCAD", helps)
    place = s.tokens[colons[0]]
    tokens = (Token("IN", s.token.start, s.token.end), *first, Token("RANGE", place.start, place.end), *last)
    return Snag(found.diagnostic, (Repair(s.at, end - s.at, tokens),))


def braces_for_a_record(s: Stuck) -> Snag | None:
    """`{x: 1}` and `{"x": 1}`."""
    if s.token.kind != "LBRACE" or s.after.kind not in ("NAME", "STRING") or s.kind(s.at + 2) != "COLON":
        return None
    if s.before.kind in ("NAME", "RPAR"):
        return None
    return s.snag(
        "a record is written in parentheses, with `=`",
        s.span(s.token),
        "{ } are for blocks",
        Help("as in: (x = 1, y = 2)"),
    )
