"""C text as declarations and definitions, and those of them that are reached from some names.

A unit is what stands at the outermost level with the comment above it: a directive, a type, a variable, a function,
or a call of a macro that makes one. It provides the names that it declares, and needs every name in it that is not
a member. Reached is what provides a needed name; so a name that means several things costs size, never sense.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from blobscript.emitting.lexing import Token, blank, closing, following, lexed, preceding, printed
from blobscript.emitting.sources import HEADING

__all__ = ["Macro", "Unit", "macros_of", "reached", "split_macro", "units_of"]


@dataclass(slots=True)
class Macro:
    """A function-like macro: its parameters and the tokens of its body."""

    name: str
    parameters: tuple[str, ...]
    body: list[Token]

    def pasted(self, arguments: list[str]) -> set[str]:
        """Names that the body makes with ## from arguments."""
        values = dict(zip(self.parameters, arguments, strict=False))
        words = [token.text for token in self.body if not blank(token)]
        made: set[str] = set()
        for i, word in enumerate(words):
            if word == "##" and 0 < i < len(words) - 1:
                made.add(values.get(words[i - 1], words[i - 1]) + values.get(words[i + 1], words[i + 1]))
        return made

    def declared(self, arguments: list[str]) -> set[str]:
        """Names of the functions that the body declares: parameters and pasted names before a parenthesis."""
        values = dict(zip(self.parameters, (argument.strip() for argument in arguments), strict=False))
        words = [token.text for token in self.body if not blank(token)]
        found: set[str] = set()
        depth = 0
        for i, word in enumerate(words):
            if depth == 0 and word == "(" and i:
                if i > 2 and words[i - 2] == "##":
                    found.add(values.get(words[i - 3], words[i - 3]) + values.get(words[i - 1], words[i - 1]))
                elif words[i - 1] in values:
                    found.add(values[words[i - 1]])
            depth += (word in "({[") - (word in ")}]")
        return found


@dataclass(slots=True)
class Unit:
    """kind: directive, macro (the definition of one), code, or heading (a comment that opens a file). provides, needs:
    names. tight: no empty line stood before it."""

    text: str
    kind: str
    provides: set[str] = field(default_factory=set[str])
    needs: set[str] = field(default_factory=set[str])
    tight: bool = False


_DEFINE = re.compile(r"\s*#\s*define\s+(\w+)(\(([^)]*)\))?(.*)", re.DOTALL)


def macros_of(text: str) -> dict[str, Macro]:
    """The function-like macros that a text defines at the outermost level."""
    found: dict[str, Macro] = {}
    for token in lexed(text):
        made = _DEFINE.fullmatch(token.text) if token.kind == "directive" else None
        if made and made[2]:
            parameters = tuple(name.strip() for name in made[3].split(","))
            found[made[1]] = Macro(made[1], parameters, lexed(made[4]))
    return found


# ---- taking apart -------------------------------------------------------------------------------------


def units_of(text: str, macros: dict[str, Macro]) -> list[Unit]:
    """All units, in order; their texts together are the text, but for the white space around them."""
    tokens = lexed(text)
    units: list[Unit] = []
    start = i = 0
    tight = False
    while i < len(tokens):
        token = tokens[i]
        if token.kind in ("space", "comment"):
            if token.kind == "space" and token.text.count("\n") > 1:
                start, tight = i, False  # a comment that stands alone belongs to no unit
            elif token.text.startswith(HEADING):
                units.append(Unit(token.text, "heading"))
            i += 1
            continue
        end = i if token.kind == "directive" else _end(tokens, i, macros)
        while end + 2 < len(tokens) and tokens[end + 2].kind == "comment" and "\n" not in tokens[end + 1].text:
            end += 2  # a remark behind it
        units.append(_unit(tokens[start : end + 1], macros))
        units[-1].tight = tight
        start, tight = end + 1, True
        i = start
    return units


def _end(tokens: list[Token], i: int, macros: dict[str, Macro]) -> int:
    """The last token of the code that starts at i."""
    first = tokens[i].text
    opening = following(tokens, i)
    if first in macros and opening < len(tokens) and tokens[opening].text == "(" and not _defines(tokens, i, opening):
        end = closing(tokens, opening)
        after = following(tokens, end)
        return after if after < len(tokens) and tokens[after].text == ";" else end
    seen_equal = False
    k = i
    while k < len(tokens):
        text = tokens[k].text
        if tokens[k].kind == "sign" and text in ("(", "["):
            k = closing(tokens, k)
        elif text == "{":
            before = tokens[preceding(tokens, k)].text
            k = closing(tokens, k)
            if before == ")" and not seen_equal:
                return k
        elif text == ";":
            return k
        seen_equal |= text == "="
        k = following(tokens, k)
    return len(tokens) - 1


def _defines(tokens: list[Token], i: int, opening: int) -> bool:
    """NAME(x)(...) {: a macro that gives a function its name."""
    after = following(tokens, closing(tokens, opening))
    return after < len(tokens) and tokens[after].text == "("


def split_macro(text: str) -> tuple[str, str]:
    """A definition of a macro: all up to its body, and the body."""
    made = _DEFINE.fullmatch(text)
    return (text[: made.start(4)], made[4]) if made else (text, "")


def _unit(tokens: list[Token], macros: dict[str, Macro]) -> Unit:
    text = printed(tokens).strip("\n")
    code = [token for token in tokens if token.kind != "space" and token.kind != "comment"]
    if code and code[0].kind == "directive":
        made = _DEFINE.fullmatch(code[0].text)
        if not made:
            return Unit(text, "directive", set(), _names(lexed(code[0].text)))
        own = {name.strip() for name in (made[3] or "").split(",")}
        return Unit(text, "macro", {made[1]}, _names(_without_pasted(lexed(made[4]))) - own)
    provided = _provided(code, macros)
    return Unit(text, "code", provided, (_names(tokens) - _locals(code) | _made(code, macros)) - provided)


def _without_pasted(tokens: list[Token]) -> list[Token]:
    """Parts of names that ## joins mean nothing by themselves."""
    kept: list[Token] = []
    for i, token in enumerate(tokens):
        after = following(tokens, i)
        joined = (after < len(tokens) and tokens[after].text == "##") or tokens[
            max(preceding(tokens, i), 0)
        ].text == "##"
        if not (joined and token.kind == "name"):
            kept.append(token)
    return kept


def _names(tokens: list[Token]) -> set[str]:
    """Names that are not members; those in directives within functions, too."""
    found: set[str] = set()
    for i, token in enumerate(tokens):
        if token.kind == "name" and tokens[max(preceding(tokens, i), 0)].text not in (".", "->"):
            found.add(token.text)
        elif token.kind == "directive":
            found |= _names(lexed(token.text.replace("#", " ", 1)))
    return found


#: Words that no declaration begins with.
_NO_TYPES = frozenset({"return", "else", "case", "goto", "sizeof"})


def _locals(code: list[Token]) -> set[str]:
    """Names of variables that stand behind their type, and are called nowhere."""
    found: set[str] = set()
    for i in range(1, len(code) - 1):
        before, after = code[i - 1], code[i + 1].text
        if code[i].kind == "name" and before.kind == "name" and before.text not in _NO_TYPES:
            found |= {code[i].text} if after == ")" else _declared(code, i)
    return found - {code[i].text for i in range(len(code) - 1) if code[i + 1].text == "("}


def _declared(code: list[Token], i: int) -> set[str]:
    """The name at i and those behind its commas."""
    found: set[str] = set()
    while i + 1 < len(code) and code[i].kind == "name" and code[i + 1].text in ("=", ";", ",", "["):
        found.add(code[i].text)
        i = _to_comma(code, i + 1) + 1
    return found


def _calls(code: list[Token], macros: dict[str, Macro]) -> Iterable[tuple[Macro, list[str]]]:
    """Calls of macros with their arguments as texts."""
    for i, token in enumerate(code[:-1]):
        if token.text in macros and code[i + 1].text == "(":
            end = closing(code, i + 1)
            yield macros[token.text], printed(code[i + 2 : end]).split(",")


def _made(code: list[Token], macros: dict[str, Macro]) -> set[str]:
    """Names that calls of macros paste together, also through other macros."""
    found: set[str] = set()
    for macro, arguments in _calls(code, macros):
        found |= macro.pasted(arguments)
        values = dict(zip(macro.parameters, arguments, strict=False))
        inner = [Token("name", values[t.text]) if t.text in values else t for t in macro.body if not blank(t)]
        for below, given in _calls(inner, {n: m for n, m in macros.items() if n != macro.name}):
            found |= below.pasted(given)
    return found


def _provided(code: list[Token], macros: dict[str, Macro]) -> set[str]:
    """Names that a declaration or definition declares."""
    found: set[str] = set()
    first = code[0].text
    if first in macros and code[1].text == "(":
        end = closing(code, 1)
        if end + 1 >= len(code) or code[end + 1].text != "(":
            return macros[first].declared(printed(code[2:end]).split(","))
    i, depth = 0, 0
    while i < len(code):
        text = code[i].text
        if text in ("enum", "struct", "union"):
            tag = code[i + 1].text if code[i + 1].kind == "name" else ""
            brace = i + 2 if tag else i + 1
            if brace < len(code) and code[brace].text == "{":
                end = closing(code, brace)
                found |= {tag} if tag else set()
                if text == "enum":
                    found |= _enumerators(code[brace + 1 : end])
                i = end
        elif text == "{":
            break
        elif text == "(" and depth == 0:
            if code[0].text == "typedef" and code[i - 1].text == "__attribute__":
                return found | {code[i - 2].text}
            named = _before_parenthesis(code, i, macros)
            if named:
                return found | {named}
            i = closing(code, i)
        elif text in ("=", ";", "[", ",") and code[i - 1].kind == "name":
            found.add(code[i - 1].text)
            if text == "=":
                i = _to_comma(code, i)
        i += 1
    return found


def _enumerators(code: list[Token]) -> set[str]:
    return {token.text for i, token in enumerate(code) if token.kind == "name" and (i == 0 or code[i - 1].text == ",")}


def _before_parenthesis(code: list[Token], i: int, macros: dict[str, Macro]) -> str:
    """What is declared before a parenthesis: a function, a pointer to one; nothing by attributes."""
    name = code[i - 1].text if i else ""
    if name in ("__attribute__", "_Alignas", "static_assert", "_Static_assert"):
        return ""
    if code[i + 1].text == "*" and code[i + 2].kind == "name" and code[i + 3].text == ")":
        return code[i + 2].text
    if name in macros:
        end = closing(code, i)
        pasted = macros[name].pasted([printed(code[i + 1 : end])])
        return next(iter(pasted), code[i + 1].text)
    return name if code[i - 1].kind == "name" else ""


def _to_comma(code: list[Token], i: int) -> int:
    """Behind an initialiser."""
    while i < len(code) and code[i].text not in (",", ";"):
        i = closing(code, i) + 1 if code[i].text in ("(", "[", "{") else i + 1
    return i


# ---- what is reached ------------------------------------------------------------------------------------


def reached(units: list[Unit], roots: Iterable[str], keeps: Callable[[Unit], bool]) -> list[Unit]:
    """The units that provide the roots and all that these need, and those that are kept anyhow, in order."""
    providers: dict[str, list[int]] = {}
    for number, unit in enumerate(units):
        for name in unit.provides:
            providers.setdefault(name, []).append(number)
    waiting = [n for name in roots for n in providers.get(name, [])]
    waiting += [n for n, unit in enumerate(units) if keeps(unit)]
    taken: set[int] = set()
    while waiting:
        number = waiting.pop()
        if number not in taken:
            taken.add(number)
            waiting += [n for name in units[number].needs for n in providers.get(name, [])]
    return [unit for number, unit in enumerate(units) if number in taken]
