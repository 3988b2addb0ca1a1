"""Where the parser is stuck: what to tell people, and how to go on.

`diagnose` asks a list of rules, each for one kind of mistake, from the most particular to the most
general. A rule looks at the tokens around the stuck one and at what the parser would accept, and
answers with a finding and, if it can guess what was meant, the change to the tokens that mends it.
Nobody is told what an LALR automaton expected: a finding says what is missing, in the script's words.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from blobscript.build import reserved
from blobscript.diagnostics import Diagnostic, Edit, Help
from blobscript.machine import Machine
from blobscript.source import Source, Span
from blobscript.tokens import CLOSERS, END, NEWLINE, OPENERS, Token
from blobscript.words import FOREIGN, RESERVED, UNITS

__all__ = ["Repair", "Snag", "diagnose"]


class Repair(NamedTuple):
    """Put `tokens` in the place of `removed` tokens at `place` (before the stuck one: the item is read again)."""

    place: int
    removed: int
    tokens: tuple[Token, ...]


class Snag(NamedTuple):
    diagnostic: Diagnostic
    repairs: tuple[Repair, ...] = ()


_KEYWORDS = frozenset(word.upper() for word in RESERVED)
_LITERALS = frozenset(["NUMBER", "ANGLE", "COLOR", "STRING", "TRUE", "FALSE"])
_VALUE_STARTS = _LITERALS | {"NAME", "LPAR", "LSQB", "NOT", "FN", "IF"}
_ITEM_STARTS = _VALUE_STARTS | {
    "LET", "ASSERT", "DEBUG", "FOR", "SPREAD", "IMPORT", "TYPE", "PARAM", "KERNEL", "AT", "RETURN", "BLOBSCRIPT",
}  # fmt: skip
_OPERATORS = frozenset(["PLUS", "MINUS", "TIMES", "OVER", "POWER", "COMPARE", "RANGE", "AND", "OR"])
_ENDS = frozenset([NEWLINE, END, "RPAR", "RSQB", "RBRACE", "COMMA"])
_DEFINERS = {"LET": "let", "PARAM": "param", "FN": "fn", "KERNEL": "kernel", "TYPE": "type"}
_TOP_ONLY = {"IMPORT": "import", "TYPE": "type", "PARAM": "param", "KERNEL": "kernel", "AT": "@"}


class Scene:
    """The stuck parser with names for what surrounds the stuck token."""

    def __init__(self, machine: Machine, source: Source, item: int) -> None:
        self.machine = machine
        self.source = source
        self.tokens = machine.tokens
        self.at = machine.at
        self.item = item
        self.token = self.tokens[self.at]
        self.before = self.tokens[self.at - 1] if self.at > item else Token(NEWLINE, self.token.start, self.token.start)
        self.after = self.tokens[min(self.at + 1, len(self.tokens) - 1)]

    def kind(self, index: int) -> str:
        """The kind of a token of this item; NEWLINE before it and END behind everything."""
        if index < self.item:
            return NEWLINE
        return self.tokens[index].kind if index < len(self.tokens) else END

    def text(self, token: Token) -> str:
        return self.source.text[token.start : token.end]

    def span(self, token: Token) -> Span:
        return Span(self.source, token.start, token.end)

    def place(self, start: int, end: int) -> Span:
        return Span(self.source, start, end)

    def insert(self, offset: int, text: str) -> Edit:
        return Edit(Span(self.source, offset, offset), text)

    def replaced(self, token: Token, text: str) -> Edit:
        return Edit(self.span(token), text)

    def line(self, token: Token) -> int:
        return self.source.position(token.start)[0]

    def inside(self) -> str:
        """The kind of the innermost open bracket, "" at the top level."""
        closed = 0
        for value in reversed(self.machine.values):
            kind = value.kind if isinstance(value, Token) else ""
            if kind in CLOSERS:
                closed += 1
            elif kind in OPENERS and closed:
                closed -= 1
            elif kind in OPENERS:
                return kind
        return ""

    def on_same_line(self) -> bool:
        return self.at > self.item and self.line(self.token) == self.source.position(self.before.end)[0]

    def block_ahead(self) -> int | None:
        """The index of the `{` that ends this line, at the depth of the stuck token."""
        depth = 0
        for index in range(self.at, len(self.tokens)):
            kind = self.tokens[index].kind
            if kind == "LBRACE" and depth == 0:
                return index
            depth += (kind in OPENERS) - (kind in CLOSERS)
            if depth < 0 or kind in (NEWLINE, END):
                return None
        return None

    def item_end(self) -> int:
        """The index of the NEWLINE, closing bracket or END behind this item."""
        depth = 0
        for index in range(self.item, len(self.tokens)):
            kind = self.tokens[index].kind
            if depth == 0 and (kind in (NEWLINE, END) or kind in CLOSERS):
                return index
            depth += (kind in OPENERS) - (kind in CLOSERS)
        return len(self.tokens) - 1

    def hole(self) -> Token:
        """Stands for a value that is missing; becomes an `Error`."""
        return Token("NAME", self.before.end, self.before.end)

    def snag(self, message: str, span: Span, label: str, *helps: Help, code: str = "E0103") -> Snag:
        return Snag(Diagnostic(code, message, span, label, helps=helps))


def diagnose(machine: Machine, source: Source, item: int) -> Snag:
    """The finding for a stuck parser; `item` is the index of the first token of the item it is in."""
    scene = Scene(machine, source, item)
    for rule in _RULES:
        snag = rule(scene)
        if snag is not None:
            return snag
    return _anything(scene)


# ---- words -----------------------------------------------------------------------------------


def _reserved_name(s: Scene) -> Snag | None:
    """`let type = 1`: a reserved word where a name is defined or used."""
    if s.token.kind not in _KEYWORDS or not s.machine.accepts("NAME"):
        return None
    binds = s.before.kind in (*_DEFINERS, "IMPORT", "AS") or s.kind(s.at - 2) == "FOR"
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


def _header(s: Scene) -> Snag | None:
    """`for i in xs {`: the header of `for` and `if` stands in parentheses."""
    if s.before.kind not in ("FOR", "IF") or s.token.kind == "LPAR":
        return None
    word = s.text(s.before)
    message = f"`{word}` wants its header in parentheses"
    block = s.block_ahead()
    if block is None or block == s.at:
        end = _line_end(s) if block is None else s.at
        label = "put ( ) around this" if end > s.at else "a header in ( ) is missing"
        stop = s.tokens[end - 1].end if end > s.at else s.before.end
        return s.snag(message, s.place(min(s.token.start, stop), stop), label, code="E0106")
    return _wrap_header(s, message, s.at, block)


def _line_end(s: Scene) -> int:
    """Behind the tokens up to the end of the line or the bracket around."""
    depth = 0
    for index in range(s.at, len(s.tokens)):
        kind = s.tokens[index].kind
        depth += (kind in OPENERS) - (kind in CLOSERS)
        if depth < 0 or kind in (NEWLINE, END):
            return index
    return len(s.tokens) - 1


def _wrap_header(s: Scene, message: str, first: int, block: int) -> Snag:
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


def _header_goes_on(s: Scene) -> Snag | None:
    """`if (a) and (b) {`: the parentheses end too early."""
    if s.before.kind != "RPAR" or s.token.kind not in _OPERATORS | {"DOT", "LSQB", "LPAR"}:
        return None
    opener = _opener(s, s.at - 1)
    block = s.block_ahead()
    if block is None or s.kind(opener - 1) != "IF":
        return None
    return _wrap_header(s, "`if` wants its whole header in parentheses", opener, block)


def _opener(s: Scene, closer: int) -> int:
    depth = 0
    for index in range(closer, -1, -1):
        kind = s.tokens[index].kind
        depth += (kind in CLOSERS) - (kind in OPENERS)
        if depth == 0:
            return index
    return closer


def _foreign(s: Scene) -> Snag | None:
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


def _else_if(s: Scene) -> Snag | None:
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


def _bare_part(s: Scene) -> Snag | None:
    """`1 + if (a) b else c`."""
    if s.token.kind not in ("IF", "FN") or s.before.kind not in _OPERATORS | {"NOT"} or not s.machine.accepts("LPAR"):
        return None
    end = _line_end(s)
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


def _lonely_else(s: Scene) -> Snag | None:
    if s.token.kind != "ELSE":
        return None
    return s.snag(
        "this `else` belongs to no `if`",
        s.span(s.token),
        "no `if` ends right before it",
        Help("with blocks: if (c) { a } else { b }, as a value: if (c) a else b"),
    )


def _late_header(s: Scene) -> Snag | None:
    if s.token.kind != "BLOBSCRIPT":
        return None
    return s.snag("the edition is named once, before the first item", s.span(s.token), "too late here")


def _lonely_return(s: Scene) -> Snag | None:
    if s.token.kind != "RETURN" or s.machine.accepts(NEWLINE, "RETURN"):
        return None
    return s.snag(
        "`return` stands only at the end of a function's body",
        s.span(s.token),
        "not in a function",
        Help("an item is placed by writing it on a line of its own"),
    )


def _top_only(s: Scene) -> Snag | None:
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


# ---- numbers ----------------------------------------------------------------------------------


def _half_number(s: Scene) -> Snag | None:
    """`.5`, `1.` and `5 deg`."""
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


def _number_snag(s: Scene, message: str, start: int, end: int, edit: Edit, index: int, count: int) -> Snag:
    unit = s.token.kind == "NAME"
    token = Token("ANGLE" if unit else "NUMBER", start, end)
    found = s.snag(
        message, s.place(start, end), "a space too many" if unit else "a digit is missing",
        Help("write", (edit,), "safe"), code="E0108",
    )  # fmt: skip
    return Snag(found.diagnostic, (Repair(index, count, (token,)),))


# ---- = and : and the like ----------------------------------------------------------------------


def _doubled(s: Scene) -> Snag | None:
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


def _arrow_function(s: Scene, arrow: Span, index: int) -> Snag:
    """`(x) => e`."""
    opener = _opener(s, index - 1)
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


def _pair(s: Scene, first: Token, second: Token) -> tuple[str, str, str, str, str] | None:
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
    return None


def _assignment(s: Scene) -> Snag | None:
    """`x = 5` without `let`, `a.x = 5`, and `=` where `==` compares."""
    if s.token.kind != "EQUAL":
        return None
    if s.at == s.item + 1 and s.before.kind == "NAME" and s.inside() in ("", "LBRACE"):
        found = s.snag(
            f"a definition of `{s.text(s.before)}` starts with `let`",
            s.place(s.before.start, s.token.end),
            "nothing is ever changed, only defined",
            Help("write", (s.insert(s.before.start, "let "),)),
        )
        return Snag(found.diagnostic, (Repair(s.item, 0, (Token("LET", s.before.start, s.before.start),)),))
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


def _colon(s: Scene) -> Snag | None:
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


def _double_equal(s: Scene) -> Snag | None:
    """`let x == 1`."""
    if s.token.kind != "COMPARE" or s.text(s.token) != "==" or not s.machine.accepts("EQUAL"):
        return None
    found = s.snag(
        f"`{s.text(s.before)}` is defined with one `=`", s.span(s.token), "`==` compares",
        Help("write", (s.replaced(s.token, "="),), "safe"),
    )  # fmt: skip
    return Snag(found.diagnostic, (Repair(s.at, 1, (Token("EQUAL", s.token.start, s.token.end),)),))


def _loop_in(s: Scene) -> Snag | None:
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


def _missing_equal(s: Scene) -> Snag | None:
    """`let x 5`, `fn f(x) x + 1`, `(threshold 0.5)`."""
    if not s.machine.accepts("EQUAL") or s.token.kind in (NEWLINE, END):
        return None
    starts_value = s.token.kind in _VALUE_STARTS | {"MINUS"}
    if s.inside() in ("LPAR", "LSQB"):
        named = s.before.kind == "NAME" and s.token.kind in _LITERALS and s.kind(s.at - 2) in ("LPAR", "COMMA")
        if not named:
            return None
    elif not starts_value or s.kind(s.item) not in (*_DEFINERS, "AT") or not s.on_same_line():
        return None
    what = f"`{s.text(s.before)}`" if s.before.kind == "NAME" else "the body"
    where = "after" if s.before.kind == "NAME" else "before"
    found = s.snag(
        f"`=` is missing {where} {what}", s.span(s.token), "the value starts here",
        Help("write", (s.insert(s.before.end, " ="),)),
    )  # fmt: skip
    return Snag(found.diagnostic, (Repair(s.at, 0, (Token("EQUAL", s.before.end, s.before.end),)),))


def _chained(s: Scene) -> Snag | None:
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


# ---- commas and line ends ---------------------------------------------------------------------


def _comma_in_block(s: Scene) -> Snag | None:
    """A comma between the items of a block; all commas at line ends of the same block go along."""
    if s.token.kind != "COMMA" or s.inside() not in ("", "LBRACE"):
        return None
    if not s.machine.accepts(NEWLINE) and not s.machine.accepts("RBRACE"):
        return None
    edits: list[Edit] = []
    repairs: list[Repair] = []
    for index in _commas(s):
        edit, tokens = _without_comma(s, index)
        edits.append(edit)
        repairs.insert(0, Repair(index, 1, tokens))
    where = "in a block" if s.inside() else "between items"
    diagnostic = Diagnostic(
        "E0105",
        f"no comma {where}: the end of a line ends an item",
        s.span(s.token),
        "not needed",
        helps=(Help("leave it out" if len(edits) == 1 else "leave them out", tuple(edits), "safe"),),
    )
    return Snag(diagnostic, tuple(repairs))


def _commas(s: Scene) -> list[int]:
    """The stuck comma and those behind it that end a line of the same block."""
    found = [s.at]
    depth = 0
    for index in range(s.at + 1, len(s.tokens) - 1):
        kind = s.tokens[index].kind
        if depth == 0 and kind in CLOSERS:
            break
        depth += (kind in OPENERS) - (kind in CLOSERS)
        if depth == 0 and kind == "COMMA" and len(found) < 20 and _ends_line(s, index):
            found.append(index)
    return found


def _ends_line(s: Scene, index: int) -> bool:
    after = s.tokens[index + 1]
    return after.kind != "STRING" and s.line(after) > s.line(s.tokens[index])


def _without_comma(s: Scene, index: int) -> tuple[Edit, tuple[Token, ...]]:
    comma, after = s.tokens[index], s.tokens[index + 1]
    if after.kind in (NEWLINE, END, "RBRACE"):
        return s.replaced(comma, ""), ()
    newline = (Token(NEWLINE, comma.start, comma.end),)
    if s.line(after) > s.line(comma):
        return s.replaced(comma, ""), newline
    return Edit(s.place(comma.start, after.start), "\n" + _indent(s)), newline


def _indent(s: Scene) -> str:
    line = s.source.line(s.line(s.tokens[s.item]))
    return line[: len(line) - len(line.lstrip())]


def _two_items(s: Scene) -> Snag | None:
    """E0104: an item that starts where another one has just ended."""
    if not s.on_same_line() or s.token.kind not in _ITEM_STARTS - {"AT"} or s.inside() not in ("", "LBRACE"):
        return None
    if not s.machine.accepts(NEWLINE):
        return None
    gap = s.place(s.before.end, s.token.start)
    diagnostic = Diagnostic(
        "E0104",
        "two items stand on one line",
        s.span(s.token),
        "a new item starts here",
        helps=(Help("put it on a line of its own", (Edit(gap, "\n" + _indent(s)),)),),
    )
    return Snag(diagnostic, (Repair(s.at, 0, (Token(NEWLINE, s.token.start, s.token.start),)),))


def _missing_times(s: Scene) -> Snag | None:
    """`2 x`."""
    if s.before.kind not in ("NUMBER", "ANGLE") or s.token.kind not in ("NAME", "LPAR") or not s.on_same_line():
        return None
    if not s.machine.accepts("TIMES"):
        return None
    found = s.snag(
        "`*` is missing between these two", s.place(s.before.start, s.token.end), "to multiply, write *",
        Help("write", (Edit(s.place(s.before.end, s.token.start), " * "),)),
    )  # fmt: skip
    return Snag(found.diagnostic, (Repair(s.at, 0, (Token("TIMES", s.before.end, s.before.end),)),))


def _missing_comma(s: Scene) -> Snag | None:
    """Two values next to each other inside ( ) or [ ]."""
    if s.inside() not in ("LPAR", "LSQB") or s.token.kind not in _VALUE_STARTS | {"SPREAD", "FOR"}:
        return None
    if not s.machine.accepts("COMMA"):
        return None
    found = s.snag(
        "a comma is missing", s.span(s.token), "before this",
        Help("write", (s.insert(s.before.end, ","),)),
    )  # fmt: skip
    return Snag(found.diagnostic, (Repair(s.at, 0, (Token("COMMA", s.before.end, s.before.end),)),))


# ---- things that are missing --------------------------------------------------------------------


def _missing_name(s: Scene) -> Snag | None:
    if s.before.kind not in (*_DEFINERS, "IMPORT", "AS") or not s.machine.accepts("NAME"):
        return None
    if s.before.kind == "FN" and s.token.kind == "LPAR":
        return None
    word = s.text(s.before)
    return s.snag(f"a name is missing after `{word}`", s.span(s.before), "what is it called?")


def _missing_parameters(s: Scene) -> Snag | None:
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


def _missing_return(s: Scene) -> Snag | None:
    """A function's body that does not end with `return`."""
    if s.machine.accepts("RETURN"):
        if s.token.kind == "RBRACE":
            found = s.snag(
                "this function returns nothing", s.span(s.token), "`return` and a value are missing before this"
            )
            return Snag(found.diagnostic, (Repair(s.at, 0, (Token("RETURN", s.token.start, s.token.start), s.hole())),))
        if s.token.kind in _VALUE_STARTS | {"MINUS"} and s.kind(_line_end(s)) == "RBRACE":
            found = s.snag(
                "`return` is missing before the result", s.span(s.token), "a function's body ends with `return`",
                Help("write", (s.insert(s.token.start, "return "),)),
            )  # fmt: skip
            return Snag(found.diagnostic, (Repair(s.at, 0, (Token("RETURN", s.token.start, s.token.start),)),))
        if s.token.kind in _ITEM_STARTS:
            return s.snag(
                "a function's body has `let`, `assert` and `debug`, and one `return`", s.span(s.token),
                "not one of these",
                Help("put the items into a list or a block: return sum { a, b on lines of their own }"),
            )  # fmt: skip
    if s.token.kind == "RBRACE" and s.machine.accepts(NEWLINE, "RETURN"):
        found = s.snag("this function returns nothing", s.span(s.token), "`return` and a value are missing before this")
        place = s.token.start
        tokens = (Token(NEWLINE, place, place), Token("RETURN", place, place), s.hole())
        return Snag(found.diagnostic, (Repair(s.at, 0, tokens),))
    return None


def _after_return(s: Scene) -> Snag | None:
    if s.token.kind != NEWLINE or not s.machine.accepts("RBRACE") or s.machine.accepts("RETURN"):
        return None
    if not any(isinstance(v, Token) and v.kind == "RETURN" for v in s.machine.values):
        return None
    return s.snag("nothing may stand after `return`", s.span(s.after), "never reached")


def _missing_block(s: Scene) -> Snag | None:
    """`for (x in xs) ball(x)`: the items of a loop stand in { }."""
    if not s.machine.accepts("LBRACE") or s.before.kind not in ("RPAR", "ELSE") or s.inside() not in ("", "LBRACE"):
        return None
    if s.before.kind == "RPAR" and s.kind(_opener(s, s.at - 1) - 1) not in ("FOR", "IF"):
        return None
    word = s.text(s.before) if s.before.kind == "ELSE" else s.text(s.tokens[_opener(s, s.at - 1) - 1])
    message = f"the items of this `{word}` stand in {{ }}"
    if s.token.kind not in _ITEM_STARTS | {"MINUS"}:
        return s.snag(message, s.span(s.before), "a block belongs behind this")
    end = _line_end(s)
    last = s.tokens[end - 1]
    edits = (s.insert(s.token.start, "{ "), s.insert(last.end, " }"))
    found = s.snag(message, s.place(s.token.start, last.end), "put { } around this", Help("write", edits))
    repairs = (
        Repair(end, 0, (Token("RBRACE", last.end, last.end),)),
        Repair(s.at, 0, (Token("LBRACE", s.token.start, s.token.start),)),
    )
    return Snag(found.diagnostic, repairs)


def _missing_else(s: Scene) -> Snag | None:
    """`let x = if (c) 1`: a value for both cases."""
    if not s.machine.accepts("ELSE") or s.token.kind not in _ENDS:
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


def _missing_value(s: Scene) -> Snag | None:
    """An operator, `=`, comma or bracket with nothing behind it."""
    if not s.machine.accepts("NAME"):
        return None
    kind, sign = s.before.kind, s.text(s.before)
    if s.token.kind in _ITEM_STARTS and not s.on_same_line() and s.inside() in ("", "LBRACE"):
        place = s.before.end
        found = s.snag(f"a value is missing after `{sign}`", s.span(s.before), "nothing follows on this line")
        return Snag(found.diagnostic, (Repair(s.at, 0, (s.hole(), Token(NEWLINE, place, place))),))
    if s.token.kind not in _ENDS | _OPERATORS | {"EQUAL", "COLON", "DOT", "ELSE"}:
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
    if kind in _OPERATORS | {"EQUAL", "NOT", "IN", "STEP", "RETURN", "ASSERT", "DEBUG", "ELSE", "SPREAD", "COMMA"}:
        found = s.snag(f"a value is missing after `{sign}`", s.span(s.before), "nothing follows that it could be")
        return Snag(found.diagnostic, hole)
    if s.token.kind in _OPERATORS and kind in ("LPAR", "LSQB", "LBRACE", NEWLINE, "RPAR"):
        sign = s.text(s.token)
        return Snag(
            s.snag(f"a value is missing before `{sign}`", s.span(s.token), "nothing to its left").diagnostic, hole
        )
    return None


def _missing_member(s: Scene) -> Snag | None:
    if s.before.kind != "DOT":
        return None
    found = s.snag("a name is missing after this `.`", s.span(s.before), "of what?")
    return Snag(found.diagnostic, (Repair(s.at, 0, (s.hole(),)),))


def _block_on_nothing(s: Scene) -> Snag | None:
    """`0.5 { }`: a block is the last argument of something callable."""
    if s.token.kind != "LBRACE":
        return None
    return s.snag(
        "a block can only follow a name or a call",
        s.span(s.token),
        "nothing before it takes a block",
        Help("as in: sum { }, surface(threshold = 0.5) { }"),
    )


def _unfinished_definition(s: Scene) -> Snag | None:
    """`let x` and nothing else."""
    if s.token.kind not in (NEWLINE, END, "RBRACE") or s.kind(s.item) not in (*_DEFINERS, "AT", "IMPORT"):
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


def _anything(s: Scene) -> Snag:
    """What no rule knows."""
    if s.token.kind in (NEWLINE, END):
        whole = s.place(s.tokens[s.item].start, max(s.before.end, s.tokens[s.item].start))
        return s.snag("this is not finished", whole, "something is missing behind it")
    text = s.text(s.token)
    if s.token.kind in CLOSERS:
        return s.snag(f"something is missing before this `{text}`", s.span(s.token), "too early")
    after = f" after `{s.text(s.before)}`" if s.before.kind != NEWLINE and s.text(s.before).strip() else " here"
    return s.snag(f"`{text}` makes no sense{after}", s.span(s.token), "does not fit")


_RULES: tuple[Callable[[Scene], Snag | None], ...] = (
    _reserved_name,
    _half_number,
    _header,
    _header_goes_on,
    _foreign,
    _else_if,
    _bare_part,
    _lonely_else,
    _late_header,
    _lonely_return,
    _top_only,
    _doubled,
    _assignment,
    _double_equal,
    _colon,
    _loop_in,
    _missing_parameters,
    _missing_name,
    _missing_equal,
    _chained,
    _missing_return,
    _after_return,
    _comma_in_block,
    _missing_times,
    _two_items,
    _missing_comma,
    _missing_block,
    _missing_else,
    _missing_member,
    _missing_value,
    _block_on_nothing,
    _unfinished_definition,
)
