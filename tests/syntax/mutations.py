"""One-token mutations: delete, double, swap with the next one, replace by another token."""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import NamedTuple

from blobscript import lex as lexing
from blobscript.source import Source
from blobscript.tokens import END, NEWLINE, Token

OTHERS = ["(", ")", "[", "]", "{", "}", ",", "=", "+", "-", "*", ".", "..", ":", "->", "@", ";", "'", '"', "for", "if"]
OTHERS += ["else", "let", "fn", "in", "return", "x", "0.5", "35deg", "#f80", '"a"', "true", "==", "and", "..."]


class Mutant(NamedTuple):
    text: str
    line: int
    what: str


def mutants(text: str, count: int, seed: int) -> Iterator[Mutant]:
    pick = random.Random(seed)
    source = Source("t.blob", text)
    tokens = [t for t in lexing._scan(source, 0, len(text)).tokens if t.kind not in (NEWLINE, END)]
    for _ in range(count):
        index = pick.randrange(len(tokens) - 1)
        yield _mutant(source, tokens[index], tokens[index + 1], pick)


def _mutant(source: Source, token: Token, after: Token, pick: random.Random) -> Mutant:
    text, line = source.text, source.position(token.start)[0]
    word, head, tail = text[token.start : token.end], text[: token.start], text[token.end :]
    match pick.choice(["delete", "double", "swap", "replace", "insert"]):
        case "delete":
            return Mutant(head + tail, line, f"delete {word!r}")
        case "double":
            return Mutant(f"{head}{word} {word}{tail}", line, f"double {word!r}")
        case "swap":
            between, other = text[token.end : after.start], text[after.start : after.end]
            return Mutant(head + other + between + word + text[after.end :], line, f"swap {word!r} {other!r}")
        case "insert":
            other = pick.choice(OTHERS)
            return Mutant(f"{head}{other} {word}{tail}", line, f"insert {other!r} before {word!r}")
        case _:
            other = pick.choice(OTHERS)
            return Mutant(f"{head} {other} {tail}", line, f"replace {word!r} by {other!r}")
