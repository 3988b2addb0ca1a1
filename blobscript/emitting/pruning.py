"""What folding leaves behind: local variables that nothing reads, and white space."""

from __future__ import annotations

import re

from blobscript.emitting.lexing import Token, blank, closing, following, lexed, preceding, printed

__all__ = ["members_read", "tidied", "without_unread"]


def without_unread(text: str) -> str:
    """A function without locals that are declared and never named again; again until none is left."""
    tokens = lexed(text)
    brace = next((i for i, token in enumerate(tokens) if token.text == "{"), 0)
    if brace == 0 or tokens[preceding(tokens, brace)].text != ")":
        return text  # a type, or data
    while _drop_one(tokens):
        pass
    return printed(tokens)


def _drop_one(tokens: list[Token]) -> bool:
    counts: dict[str, int] = {}
    for i, token in enumerate(tokens):
        if token.kind == "name" and tokens[max(preceding(tokens, i), 0)].text not in (".", "->"):
            counts[token.text] = counts.get(token.text, 0) + 1
        elif token.kind == "directive":
            for inner in lexed(token.text.replace("#", " ", 1)):
                counts[inner.text] = counts.get(inner.text, 0) + 1
    for i, token in enumerate(tokens):
        if token.kind == "name" and counts.get(token.text) == 1 and _is_declared(tokens, i) and _drop(tokens, i):
            return True
    return False


def _is_declared(tokens: list[Token], i: int) -> bool:
    """Is the name a declarator of a local variable: behind a type or a comma, before = ; , or [ ?"""
    after = tokens[following(tokens, i)].text if following(tokens, i) < len(tokens) else ""
    start = _statement_start(tokens, i)
    first = tokens[start]
    if after not in ("=", ";", ",", "[") or start == i or start < 0:
        return False
    typed = first.text in ("const", "static", "int", "double", "float", "size_t", "int32_t") or (
        first.kind == "name" and tokens[following(tokens, start)].kind == "name" and first.text not in _WORDS
    )
    return typed and tokens[preceding(tokens, i)].text not in _OPERATORS and not _is_in_value(tokens, start, i)


def _is_in_value(tokens: list[Token], start: int, i: int) -> bool:
    """Does an = stand between the last comma, or the start, and i?"""
    k = preceding(tokens, i)
    while k >= start and tokens[k].text != ",":
        if tokens[k].text == "=":
            return True
        k = preceding(tokens, k)
    return False


_WORDS = frozenset({"return", "else", "case", "goto", "typedef", "struct", "enum"})
_OPERATORS = frozenset({"(", "=", "+", "-", "/", "%", "<", ">", "?", ":", "&", "|", "!", "[", "{", "&&", "||", "=="})


def _statement_start(tokens: list[Token], i: int) -> int:
    """The first token of the statement around i, at its level; -1: it stands within brackets."""
    k, start = preceding(tokens, i), i
    depth = 0
    while k >= 0:
        text = tokens[k].text
        if text in (")", "]", "}") and not (depth == 0 and text == "}" and _ends_statement(tokens, k)):
            depth += 1
        elif text in ("(", "[", "{"):
            if depth == 0:
                return start if text == "{" and _opens_block(tokens, k) else -1
            depth -= 1
        elif depth == 0 and text in (";", "}"):
            return start
        if depth == 0 and text not in (")", "]"):
            start = k
        k = preceding(tokens, k)
    return -1


def _opens_block(tokens: list[Token], k: int) -> bool:
    return tokens[preceding(tokens, k)].text in (")", "{", "}", ";", "else", "do", ":")


def _ends_statement(tokens: list[Token], k: int) -> bool:
    """Does a block end at this brace? An initialiser is followed by ; or , or a sign."""
    after = following(tokens, k)
    return after < len(tokens) and (tokens[after].kind == "name" or tokens[after].text in ("}", "{", "*"))


def _drop(tokens: list[Token], i: int) -> bool:
    """Removes the declarator at i, and with the last one its statement. A call that may write to something stays:
    `const t x = f(&y);` becomes `f(&y);`."""
    end = following(tokens, i)
    while tokens[end].text not in (",", ";"):
        end = following(tokens, closing(tokens, end) if tokens[end].text in ("(", "[", "{") else end)
    start = _statement_start(tokens, i)
    value = [t.text for t in tokens[i:end]]
    if any(v in ("++", "--", "+=", "-=") for v in value):
        return False
    before = preceding(tokens, i)
    while tokens[before].text == "*":
        before = preceding(tokens, before)
    if _may_write(tokens, i, end):
        alone = tokens[end].text == ";" and tokens[before].text != ","
        if alone:
            del tokens[start : following(tokens, following(tokens, i))]
        return alone
    if tokens[end].text == "," and tokens[before].text != ",":  # the first of several
        del tokens[i : following(tokens, end)]
    elif tokens[before].text == ",":
        del tokens[before:end]
    else:
        while start > 0 and blank(tokens[start - 1]):
            start -= 1
        del tokens[start : end + 1]
    return True


def _may_write(tokens: list[Token], start: int, end: int) -> bool:
    """Is the address of something an argument within [start, end)?"""
    return any(tokens[k].text == "&" and tokens[preceding(tokens, k)].text in ("(", ",") for k in range(start, end))


def members_read(text: str) -> set[str]:
    """Names behind . and ->."""
    return set(re.findall(r"(?:\.|->)\s*([A-Za-z_]\w*)", text))


def tidied(text: str) -> str:
    """No empty lines in macros, none at the start of blocks, never two in a row; no white space before line ends."""
    text = re.sub(r"[ \t]+\\\n", " \\\n", text)
    text = re.sub(r"(?:\n[ \t]*\\)+(?=\n)", "", text)
    text = re.sub(r"[ \t]+\n", "\n", text)
    text = re.sub(r"\{\n\n+", "{\n", text)
    text = re.sub(r"\n\n+(\s*\})", r"\n\1", text)
    return re.sub(r"\n{3,}", "\n\n", text)
