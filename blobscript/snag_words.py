"""Rules for words: reserved and foreign ones, headers of `for` and `if`, and what stands where it may not."""

from __future__ import annotations

from blobscript.build import reserved
from blobscript.diagnostics import Diagnostic, Edit, Help
from blobscript.stuck import DEFINERS, KEYWORDS, OPERATORS, Repair, Snag, Stuck
from blobscript.tokens import NEWLINE, Token
from blobscript.words import FOREIGN

__all__ = [
    "bare_part",
    "else_if",
    "foreign",
    "header",
    "header_goes_on",
    "late_header",
    "lonely_else",
    "lonely_return",
    "reserved_name",
    "top_only",
    "turned_import",
]

_TOP_ONLY = {"IMPORT": "import", "TYPE": "type", "PARAM": "param", "KERNEL": "kernel", "AT": "@"}


def reserved_name(s: Stuck) -> Snag | None:
    """`let type = 1`: a reserved word where a name is defined or used."""
    if s.token.kind not in KEYWORDS or not s.machine.accepts("NAME"):
        return None
    binds = s.before.kind in (*DEFINERS, "IMPORT", "AS") or s.kind(s.at - 2) == "FOR"
    if not binds and not (s.before.kind != NEWLINE and s.machine.accepts("NAME", s.after.kind)):
        return None
    if s.token.kind == "LET" and s.kind(s.at - 2) == "FOR":
        return s.snag(
            "a `for` goes over a list or a range",
            s.span(s.token),
            "no `let` here",
            Help("for eight rounds write: for (i in 0..<8) { }"),
        )
    if s.before.kind == "RPAR" or s.token.kind in ("FOR", "IF", "ELSE", "RETURN") or (binds and s.token.kind == "IN"):
        return None
    repair = Repair(s.at, 1, (Token("NAME", s.token.start, s.token.end),))
    if binds:
        return Snag(reserved(s.span(s.token)), (repair,))
    found = s.snag(
        f"`{s.text(s.token)}` is a reserved word, not a value", s.span(s.token), "cannot stand here", code="E0107"
    )
    return Snag(found.diagnostic, (Repair(s.at, 1, (Token("NAME", s.token.start, s.token.start),)),))


def header(s: Stuck) -> Snag | None:
    """`for i in xs {`: the header of `for` and `if` stands in parentheses."""
    if s.before.kind not in ("FOR", "IF") or s.token.kind == "LPAR":
        return None
    word = s.text(s.before)
    message = f"`{word}` wants its header in parentheses"
    block = s.block_ahead()
    if block is None or block == s.at:
        end = s.line_end() if block is None else s.at
        label = "put ( ) around this" if end > s.at else "a header in ( ) is missing"
        stop = s.tokens[end - 1].end if end > s.at else s.before.end
        example = "for (i in 0..<8) { ... }" if s.before.kind == "FOR" else "if (a > b) { ... } else { ... }"
        help_ = Help(f"and its items in {{ }}: {example}")
        return s.snag(message, s.place(min(s.token.start, stop), stop), label, help_, code="E0106")
    return _wrap_header(s, message, s.at, block)


def _wrap_header(s: Stuck, message: str, first: int, block: int) -> Snag:
    header = s.place(s.tokens[first].start, s.tokens[block - 1].end)
    known = "as in Python, Rust or Swift, but with parentheses"
    return Snag(
        Diagnostic(
            "E0106",
            message,
            header,
            "put ( ) around this",
            helps=(Help(known, (Edit(header, f"({header.text})"),), "safe"),),
        ),
        (
            Repair(block, 0, (Token("RPAR", header.end, header.end),)),
            Repair(first, 0, (Token("LPAR", header.start, header.start),)),
        ),
    )


def header_goes_on(s: Stuck) -> Snag | None:
    """`if (a) and (b) {`: the parentheses end too early."""
    if s.before.kind != "RPAR" or s.token.kind not in OPERATORS | {"DOT", "LSQB", "LPAR"}:
        return None
    opener = s.opener(s.at - 1)
    block = s.block_ahead()
    if block is None or s.kind(opener - 1) != "IF":
        return None
    return _wrap_header(s, "`if` wants its whole header in parentheses", opener, block)


def foreign(s: Stuck) -> Snag | None:
    """`def f(x)`, `var x = 1`, `elif`: words of other languages."""
    word = s.text(s.before)
    here = FOREIGN.get(word)
    if here is None or s.before.kind != "NAME":
        return None
    if here == "else if":
        tokens = (Token("ELSE", s.before.start, s.before.start), Token("IF", s.before.start, s.before.end))
    elif s.token.kind in ("NAME", "STRING") and s.at - 1 == s.item:
        tokens = (Token(here.upper(), s.before.start, s.before.end),)
    else:
        return None
    found = s.snag(
        f"`{word}` is written `{here}` here",
        s.span(s.before),
        "not a word of this language",
        Help("write", (s.replaced(s.before, here),)),
    )
    return Snag(found.diagnostic, (Repair(s.at - 1, 1, tokens),))


def else_if(s: Stuck) -> Snag | None:
    """`elif` after a block begins an item of its own."""
    if s.token.kind != "NAME" or FOREIGN.get(s.text(s.token)) != "else if" or s.before.kind != "RBRACE":
        return None
    tokens = (Token("ELSE", s.token.start, s.token.start), Token("IF", s.token.start, s.token.end))
    found = s.snag(
        f"`{s.text(s.token)}` is written `else if` here",
        s.span(s.token),
        "not a word of this language",
        Help("write", (s.replaced(s.token, "else if"),), "safe"),
    )
    return Snag(found.diagnostic, (Repair(s.at, 1, tokens),))


def turned_import(s: Stuck) -> Snag | None:
    """`from std.curves import helix`, as in Python."""
    if s.token.kind != "FROM" or s.at != s.item:
        return None
    end = s.line_end()
    middle = next((i for i in range(s.at + 1, end) if s.kind(i) == "IMPORT"), None)
    if middle is None or middle == s.at + 1 or middle + 1 == end:
        return None
    origin, names = s.tokens[s.at + 1 : middle], s.tokens[middle + 1 : end]
    whole = s.place(s.token.start, names[-1].end)
    written = [s.source.text[part[0].start : part[-1].end] for part in (names, origin)]
    tokens = (
        Token("IMPORT", s.token.start, s.token.start),
        *names,
        Token("FROM", s.token.start, s.token.end),
        *origin,
    )
    found = s.snag(
        "an import names what it wants first",
        whole,
        "the other way round",
        Help("write", (Edit(whole, f"import {written[0]} from {written[1]}"),), "safe"),
    )
    return Snag(found.diagnostic, (Repair(s.at, end - s.at, tokens),))


def bare_part(s: Stuck) -> Snag | None:
    """`1 + if (a) b else c`."""
    if s.token.kind not in ("IF", "FN") or s.before.kind not in OPERATORS | {"NOT"} or not s.machine.accepts("LPAR"):
        return None
    end = s.line_end()
    for index in range(s.at, end):
        if s.tokens[index].kind == "COMMA":
            end = min(end, index) if s.inside() in ("LPAR", "LSQB") else end
    last = s.tokens[end - 1].end
    word = s.text(s.token)
    found = s.snag(
        f"`{word}` as a part of an expression stands in parentheses", s.span(s.token), f"after `{s.text(s.before)}`",
        Help("put ( ) around all of it"),
    )  # fmt: skip
    repairs = (
        Repair(end, 0, (Token("RPAR", last, last),)),
        Repair(s.at, 0, (Token("LPAR", s.token.start, s.token.start),)),
    )
    return Snag(found.diagnostic, repairs)


def lonely_else(s: Stuck) -> Snag | None:
    if s.token.kind != "ELSE":
        return None
    return s.snag(
        "this `else` belongs to no `if`",
        s.span(s.token),
        "no `if` ends right before it",
        Help("with blocks: if (c) { a } else { b }, as a value: if (c) a else b"),
    )


def late_header(s: Stuck) -> Snag | None:
    if s.token.kind != "BLOBSCRIPT":
        return None
    return s.snag("the edition is named once, before the first item", s.span(s.token), "too late here")


def lonely_return(s: Stuck) -> Snag | None:
    if s.token.kind != "RETURN" or s.machine.accepts(NEWLINE, "RETURN"):
        return None
    return s.snag(
        "`return` stands only at the end of a function's body",
        s.span(s.token),
        "not in a function",
        Help("an item is placed by writing it on a line of its own"),
    )


def top_only(s: Stuck) -> Snag | None:
    """Definitions of functions, kernels and parameters inside a block."""
    token, word = s.token, _TOP_ONLY.get(s.token.kind)
    if s.token.kind == "NAME" and s.before.kind == "FN" and s.inside() == "LBRACE":
        token, word = s.before, "fn"
    if word is None or s.inside() != "LBRACE" or s.at - (token is s.before) != s.item:
        return None
    return s.snag(
        f"`{word}` belongs to the top level of the file",
        s.span(token),
        "not inside { }",
        Help("move it out of the block; inside blocks `let` gives names to values"),
    )
