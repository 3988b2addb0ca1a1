"""What fits no terminal of the grammar: broken numbers and texts, and signs from elsewhere.

Each is reported and, where one can guess what was meant, replaced by the tokens that were meant,
so that one wrong sign does not spoil the line.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from blobscript.diagnostics import Diagnostic, Edit, Help
from blobscript.source import Source, Span
from blobscript.tokens import NEWLINE, Token
from blobscript.words import UNITS

__all__ = ["Stray", "diagnose"]


class Stray(NamedTuple):
    """A finding, the tokens that stand for it, and where to read on."""

    diagnostic: Diagnostic
    tokens: list[Token]
    end: int


_NUMBER = re.compile(r"[0-9][0-9A-Za-z_]*(?:\.[0-9][0-9A-Za-z_]*)*(?:(?<=[eE])[+-][0-9]+)?°?")
_PLAIN = re.compile(r"[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]+)?")
_HASH = re.compile(r"#[0-9A-Za-z_]*")
_BLANK = re.compile(r"[^\S\n]+")
_WORD = re.compile(r"\w+")

#: Sign -> (the words for it here, the token it stands for). An empty kind: nothing stands for it.
_SIGNS = {
    "&&": ("and", "AND"),
    "||": ("or", "OR"),
    "!": ("not ", "NOT"),
    "−": ("-", "MINUS"),
    "–": ("-", "MINUS"),
    "—": ("-", "MINUS"),
    "×": ("*", "TIMES"),
    "·": ("*", "TIMES"),
    "÷": ("/", "OVER"),
    "≤": ("<=", "COMPARE"),
    "≥": (">=", "COMPARE"),
    "≠": ("!=", "COMPARE"),
    "（": ("(", ""),
    "）": (")", ""),
    "，": (",", "COMMA"),
    "…": ("...", "SPREAD"),
}

_HINTS = {
    "?": "a choice is written: if (condition) a else b",
    "%": "a remainder is written: mod(a, b)",
    "|": "`or` is the word for either of two",
    "&": "`and` is the word for both of two",
    "\\": "a line goes on by itself inside brackets and after an operator",
    "$": "names need no sign: write the name alone",
    "`": 'texts stand in " "',
    "~": "`not` is the word for the opposite",
}

#: Units that people try -> the one here.
_UNITS = {"degree": "deg", "degrees": "deg", "°": "deg", "d": "deg", "radian": "rad", "radians": "rad", "turns": "turn"}
_LENGTHS = ("mm", "cm", "dm", "m", "km", "px", "pt", "inch", "ft", "s", "ms", "u", "f")


def diagnose(source: Source, position: int, stop: int, first: bool) -> Stray:
    """What stands at `position`, where no terminal matches. `first`: nothing stands before it on its line."""
    text = source.text
    sign = text[position]
    if sign == '"':
        return _open_text(source, position, stop)
    if sign == "'":
        return _single_quotes(source, position, stop)
    if sign in "“”„«»":
        return _curly_quotes(source, position, stop)
    if sign.isascii() and sign.isdigit():
        return _number(source, position, stop)
    if sign == "#":
        return _hash(source, position, stop, first)
    if sign == ";":
        return _semicolon(source, position, stop)
    return _sign(source, position, stop)


def _line_end(source: Source, position: int, stop: int) -> int:
    end = source.text.find("\n", position, stop)
    return stop if end < 0 else end


# ---- texts --------------------------------------------------------------------------------


def _open_text(source: Source, start: int, stop: int) -> Stray:
    """E0101: a text ends on its line. The rest of the line up to a comma or bracket is taken for it."""
    line_end = _line_end(source, start, stop)
    found = re.compile(r'"(?:[^,()\[\]{}\n]|\{[^}\n]*\})*').match(source.text, start, line_end)
    end = start + len((found[0] if found else '"').rstrip()) if found else start + 1
    diagnostic = Diagnostic(
        "E0101",
        "this text is never closed",
        Span(source, start, end),
        "a text ends on the line on which it starts",
        helps=(Help('close it with "', (Edit(Span(source, end, end), '"'),)),),
    )
    return Stray(diagnostic, [Token("STRING", start, end)], end)


def _single_quotes(source: Source, start: int, stop: int) -> Stray:
    line_end = _line_end(source, start, stop)
    end = source.text.find("'", start + 1, line_end) + 1
    if not end:
        hint = 'texts stand in " ", and names have no quotes'
        diagnostic = Diagnostic("E0109", "`'` means nothing here", Span(source, start, start + 1), hint)
        return Stray(diagnostic, [], start + 1)
    edits = (Edit(Span(source, start, start + 1), '"'), Edit(Span(source, end - 1, end), '"'))
    plain = '"' not in source.text[start:end]
    diagnostic = Diagnostic(
        "E0109",
        'texts stand in " "',
        Span(source, start, end),
        "in single quotes",
        helps=(Help("write", edits, "safe"),) if plain else (),
    )
    return Stray(diagnostic, [Token("STRING", start, end)], end)


def _curly_quotes(source: Source, start: int, stop: int) -> Stray:
    """Quotes of a word processor."""
    line_end = _line_end(source, start, stop)
    found = re.compile(r'[“”„«»][^“”„«»"\n]*[“”„«»"]').match(source.text, start, line_end)
    if not found:
        return _sign(source, start, stop)
    end = found.end()
    edits = (Edit(Span(source, start, start + 1), '"'), Edit(Span(source, end - 1, end), '"'))
    diagnostic = Diagnostic(
        "E0109", 'texts stand in straight quotes: " "', Span(source, start, end), "in other quotes",
        helps=(Help("write", edits, "safe"),),
    )  # fmt: skip
    return Stray(diagnostic, [Token("STRING", start, end)], end)


# ---- numbers and colours --------------------------------------------------------------------


def _number(source: Source, start: int, stop: int) -> Stray:
    """E0108: digits with something attached that makes no number."""
    found = _NUMBER.match(source.text, start, stop)
    end = found.end() if found else start + 1
    text = source.text[start:end]
    message, label, helps = _number_advice(source, start, text)
    kind = "ANGLE" if helps and helps[0].edits[0].replacement in UNITS else "NUMBER"
    diagnostic = Diagnostic("E0108", message, Span(source, start, end), label, helps=helps)
    return Stray(diagnostic, [Token(kind, start, end)], end)


def _number_advice(source: Source, start: int, text: str) -> tuple[str, str, tuple[Help, ...]]:
    """Message, label and helps for a number that is none."""

    def edit(at: int, length: int, new: str) -> tuple[Edit, ...]:
        return (Edit(Span(source, start + at, start + at + length), new),)

    whole = Span(source, start, start + len(text))
    if re.fullmatch(r"[0-9]+(_[0-9]+)+(\.[0-9]+)?", text):
        return (
            "numbers are written without `_`",
            "not a number",
            (Help("write", (Edit(whole, text.replace("_", "")),), "safe"),),
        )
    if re.fullmatch(r"0[xX][0-9A-Fa-f]+", text):
        return "numbers are written in decimal", "not a number", (Help("write", (Edit(whole, str(int(text, 16))),)),)
    if text.count(".") > 1:
        return f"`{text}` is no number: it has {text.count('.')} points", "one point at most", ()
    plain = _PLAIN.match(text)
    head = plain.end() if plain else 0
    rest = text[head:]
    if re.fullmatch(r"[eE][+-]?", rest):
        return f"`{text}` lacks the digits of its exponent", "not a number", ()
    near = _near_unit(rest)
    if near:
        return (
            f"`{rest}` is no unit",
            f"angles have the units {', '.join(UNITS)}",
            (Help(f"write `{near}`", edit(head, len(rest), near)),),
        )
    if rest in _LENGTHS:
        return (
            f"`{rest}` is no unit",
            "lengths have no unit: they are numbers",
            (Help("leave it out", edit(head, len(rest), "")),),
        )
    return (
        f"`{text}` is no number",
        "a number ends where a letter begins",
        (Help("to multiply, write *", edit(head, 0, " * ")),),
    )


def _near_unit(word: str) -> str | None:
    if word in _UNITS:
        return _UNITS[word]
    lower = word.lower()
    if lower in UNITS or (len(lower) > 3 and lower.rstrip("s") in UNITS):
        return lower.rstrip("s") if lower not in UNITS else lower
    return next((unit for unit in UNITS if len(word) >= 2 and unit.startswith(word.lower())), None)


def _hash(source: Source, start: int, stop: int, first: bool) -> Stray:
    """A colour with the wrong number of digits (E0108), or a comment of another language (E0109)."""
    found = _HASH.match(source.text, start, stop)
    end = found.end() if found else start + 1
    word = source.text[start + 1 : end]
    hexadecimal = re.fullmatch(r"[0-9A-Fa-f]+", word) is not None
    if not word or (first and not hexadecimal):
        line_end = _line_end(source, start, stop)
        help_ = Help("write", (Edit(Span(source, start, start + 1), "//"),), "safe")
        text = source.text[start:line_end].rstrip()
        span = Span(source, start, start + max(len(text), 1))
        return Stray(
            Diagnostic("E0109", "comments start with `//`", span, "a `#` starts a colour", helps=(help_,)), [], line_end
        )
    label = f"{len(word)} digits" if hexadecimal else "0 to 9 and a to f are the digits of a colour"
    diagnostic = Diagnostic(
        "E0108",
        f"`#{word}` is no colour",
        Span(source, start, end),
        label,
        notes=("a colour has 3, 6 or 8 digits: #f80, #ff8800, or with its opacity #ff880080",),
    )
    return Stray(diagnostic, [Token("COLOR", start, end)], end)


# ---- signs ------------------------------------------------------------------------------------


def _semicolon(source: Source, start: int, stop: int) -> Stray:
    """The end of a line ends an item."""
    line_end = _line_end(source, start, stop)
    rest = source.text[start + 1 : line_end]
    after = rest.strip()
    sure = not after or after.startswith("//")
    if sure or after[0] in "})]":
        edit = Edit(Span(source, start, start + 1), "")
    else:
        column = source.position(start)[1]
        line = source.text[start - column + 1 : start]
        indent = line[: len(line) - len(line.lstrip())]
        edit = Edit(Span(source, start, start + 1 + len(rest) - len(rest.lstrip())), "\n" + indent)
    diagnostic = Diagnostic(
        "E0109",
        "`;` is not used: the end of a line ends an item",
        Span(source, start, start + 1),
        "not needed",
        helps=(Help("leave it out" if sure else "write", (edit,), "safe" if sure else "guess"),),
    )
    return Stray(diagnostic, [Token(NEWLINE, start, start + 1)], start + 1)


def _sign(source: Source, start: int, stop: int) -> Stray:
    text = source.text
    sign = text[start : start + 2] if text[start : start + 2] in _SIGNS else text[start]
    if sign in _SIGNS:
        here, kind = _SIGNS[sign]
        span = Span(source, start, start + len(sign))
        return Stray(
            Diagnostic("E0109", f"`{sign}` is written `{here.strip()}`", span, "unknown sign",
                       helps=(Help("write", (Edit(span, here),), "safe"),)),
            [Token(kind or {"（": "LPAR", "）": "RPAR"}[sign], span.start, span.end)],
            span.end,
        )  # fmt: skip
    word = _WORD.match(text, start, stop)
    if word:
        return _foreign_word(source, start, stop)
    blank = _BLANK.match(text, start, stop)
    if blank:
        return _blank(source, start, blank.end())
    return _unknown(source, start, stop)


def _foreign_word(source: Source, at: int, stop: int) -> Stray:
    """A word with letters beyond a-z; it stands for a name, with what was read of it already."""
    text = source.text
    found = _WORD.match(text, at, stop)
    end = found.end() if found else at + 1
    start = at
    while start > 0 and (text[start - 1].isalnum() or text[start - 1] == "_"):
        start -= 1
    start = at if text[start].isdigit() else start
    diagnostic = Diagnostic(
        "E0109",
        f"names are made of a-z, A-Z, 0-9 and _, but here stands `{text[at]}`",
        Span(source, start, end),
        "not a name",
        notes=("texts and comments may hold any letters",),
    )
    return Stray(diagnostic, [Token("NAME", start, end)], end)


def _blank(source: Source, start: int, end: int) -> Stray:
    span = Span(source, start, end)
    diagnostic = Diagnostic(
        "E0109",
        f"this blank is not an ordinary one ({_code(source.text[start])})",
        span,
        "looks like a space",
        helps=(Help("put an ordinary one", (Edit(span, " "),), "safe"),),
    )
    return Stray(diagnostic, [], end)


def _unknown(source: Source, start: int, stop: int) -> Stray:
    """Signs without meaning; a run of them is one finding."""
    end = start + 1
    while end < stop and _meaningless(source.text[end]):
        end += 1
    sign = source.text[start]
    shown = f"`{sign}`" if sign.isprintable() else _code(sign)
    hint = _HINTS.get(sign)
    diagnostic = Diagnostic(
        "E0109",
        f"{shown} means nothing here",
        Span(source, start, end),
        "unknown sign" if end == start + 1 else "unknown signs",
        helps=(Help(hint),) if hint else (Help("leave it out", (Edit(Span(source, start, end), ""),)),),
    )
    return Stray(diagnostic, [], end)


def _meaningless(sign: str) -> bool:
    if sign.isascii():
        return sign in "?%$`~\\&|" or (not sign.isprintable() and sign not in "\n\t\f\r")
    return not sign.isspace() and not sign.isalnum() and sign not in _SIGNS and sign not in "“”„«»"


def _code(sign: str) -> str:
    return f"U+{ord(sign):04X}"
