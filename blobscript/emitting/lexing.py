"""C text as tokens that keep every character, so that what is not changed is printed as it was written.

Knows as much of C as the tracer's sources use: comments, texts, numbers, names, operators, and directives, which
are one token each, with their continued lines. Back slashes before line ends are white space.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

__all__ = ["BLANK", "Token", "blank", "closing", "following", "lexed", "preceding", "printed"]

#: Kinds of tokens that mean nothing.
BLANK = frozenset({"space", "comment"})

_PATTERN = re.compile(
    r"""(?P<directive>(?<![^\n])[ \t]*\#(?:[^\n\\]|\\\n|\\.)*)
  | (?P<comment>/\*.*?\*/|//[^\n]*)
  | (?P<space>(?:\s|\\\n)+)
  | (?P<text>"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*')
  | (?P<number>\.?[0-9](?:[eEpP][+-]|[\w.])*)
  | (?P<name>[A-Za-z_]\w*)
  | (?P<sign>->|\+\+|--|<<=|>>=|<<|>>|<=|>=|==|!=|&&|\|\||\.\.\.|\#\#|[-+*/%&|^=]=|.)""",
    re.VERBOSE | re.DOTALL,
)


@dataclass(slots=True)
class Token:
    """kind: directive comment space text number name sign."""

    kind: str
    text: str


def lexed(text: str) -> list[Token]:
    return [Token(str(found.lastgroup), found[0]) for found in _PATTERN.finditer(text)]


def printed(tokens: list[Token]) -> str:
    return "".join(token.text for token in tokens)


def blank(token: Token) -> bool:
    return token.kind in BLANK or token.kind == "directive"


def following(tokens: list[Token], i: int) -> int:
    """Index of the next token that means something; len(tokens) at the end."""
    i += 1
    while i < len(tokens) and blank(tokens[i]):
        i += 1
    return i


def preceding(tokens: list[Token], i: int) -> int:
    """Index of the one before; -1 at the start."""
    i -= 1
    while i >= 0 and blank(tokens[i]):
        i -= 1
    return i


_PAIRS = {"(": ")", "[": "]", "{": "}"}


def closing(tokens: list[Token], i: int) -> int:
    """Index of the bracket that closes the one at i. Raises ValueError where there is none."""
    depth = 0
    for k in range(i, len(tokens)):
        if tokens[k].kind == "sign":
            depth += (tokens[k].text in _PAIRS) - (tokens[k].text in _PAIRS.values())
            if depth == 0:
                return k
    raise ValueError("a bracket is never closed")
