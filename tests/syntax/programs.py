"""Programs made at random from the grammar, and written with random spaces, line ends and comments."""

from __future__ import annotations

import random

from blobscript import lex as lexing
from blobscript.source import Source
from blobscript.tokens import CLOSERS, END, NEWLINE, OPENERS

NAMES = ["a", "b", "ball", "size", "radius", "x1", "kernel"]
ATOMS = ["1", "0.5", "35deg", "#f80", '"t"', '"{a + 1} of {b}"', "true", "false", *NAMES[:5]]
OPERATORS = ["+", "-", "*", "/", "^", "==", "<=", "and", "or", "..", "..<"]
LABELS = ["a", "from", "in", "radius", "kernel", "if"]


class Programs:
    """Writes programs that parse. `pick` decides everything."""

    def __init__(self, pick: random.Random) -> None:
        self.pick = pick

    def program(self, items: int) -> str:
        top = [self.top(index) for index in range(items)]
        return "\n".join((["blobscript 1"] if self.pick.random() < 0.3 else []) + top) + "\n"

    def top(self, index: int) -> str:
        match self.pick.randrange(9):
            case 0:
                return f'import n{index} from std.x\nimport "f.blob" as m{index}'
            case 1:
                return f"type T{index} = {self.type(2)}"
            case 2:
                attribute = self.pick.choice(["", '@group("g")\n', "@a\n@b(1, c = 2)\n"])
                return f"/// Doc {index}.\n{attribute}param p{index}: int = {self.atom()} in 0..9 step 1"
            case 3:
                return f"fn f{index}({self.parameters()}) -> {self.type(1)} = {self.expr(3)}"
            case 4:
                lets = "".join(f"  let v{i} = {self.expr(2)}\n" for i in range(self.pick.randrange(3)))
                return f"fn g{index}() {{\n{lets}  return {self.expr(2)}\n}}"
            case 5:
                return f"@allow(crease)\nkernel k{index}(r, k: int = 2) = {self.expr(2)}"
            case _:
                return self.item(3)

    def item(self, depth: int) -> str:
        if depth <= 0:
            return f"{self.pick.choice(NAMES[:5])}({self.atom()})"
        match self.pick.randrange(8):
            case 0:
                return f"let v = {self.expr(depth)}"
            case 1:
                return f'assert {self.expr(depth)}, "m"'
            case 2:
                return f"for (i, x in {self.expr(depth - 1)}) {self.block(depth - 1)}"
            case 3:
                other = self.pick.choice(
                    ["", f" else {self.block(depth - 1)}", f" else if (a) {self.block(depth - 1)}"]
                )
                return f"if ({self.expr(depth - 1)}) {self.block(depth - 1)}{other}"
            case 4:
                return f"...{self.expr(depth - 1)}"
            case 5:
                return f"debug {self.expr(depth - 1)}"
            case _:
                return f"{self.pick.choice(NAMES[:5])}({self.arguments(depth)}).b {self.block(depth - 1)}"

    def block(self, depth: int) -> str:
        items = [self.item(depth) for _ in range(self.pick.randrange(3))]
        return "{ " + "\n".join(items) + " }"

    def parameters(self) -> str:
        return self.pick.choice(["", "a", "a: int, *, b = 1", "from_: [text] = [],"])

    def arguments(self, depth: int) -> str:
        named = [f"{self.pick.choice(LABELS)} = {self.expr(depth - 1)}" for _ in range(self.pick.randrange(2))]
        return ", ".join([*(self.expr(depth - 1) for _ in range(self.pick.randrange(3))), *named])

    def expr(self, depth: int) -> str:
        if depth <= 0:
            return self.atom()
        match self.pick.randrange(13):
            case 0 | 1 | 2:
                return f"({self.expr(depth - 1)} {self.pick.choice(OPERATORS)} {self.expr(depth - 1)})"
            case 3:
                return f"{self.atom()} {self.pick.choice('+-*/')} {self.pick.choice(['-', ''])}{self.atom()}"
            case 4:
                return f"-{self.pick.choice(NAMES[:5])}"
            case 5:
                return f"({', '.join(self.expr(depth - 1) for _ in range(3))},)"
            case 6:
                return f"(a = {self.expr(depth - 1)}, {self.pick.choice(LABELS[1:])} = {self.expr(depth - 1)})"
            case 7:
                return f"[{', '.join(self.element(depth - 1) for _ in range(self.pick.randrange(4)))}]"
            case 8:
                return f"(if ({self.expr(depth - 1)}) {self.expr(depth - 1)} else {self.expr(depth - 1)})"
            case 9:
                return f"(fn(a, b: int) -> number = {self.expr(depth - 1)})"
            case 10:
                return f"a.b[{self.expr(depth - 1)}].{self.pick.choice(LABELS)}({self.arguments(depth - 1)})"
            case 11:
                return f"sum {self.block(depth - 1)}"
            case _:
                return f"ball({self.arguments(depth)})"

    def element(self, depth: int) -> str:
        match self.pick.randrange(5):
            case 0:
                return f"for (x in {self.expr(depth)}) {self.element(depth - 1) if depth > 0 else self.atom()}"
            case 1:
                return f"if (a) {self.atom()}"
            case 2:
                return f"...{self.atom()}"
            case _:
                return self.expr(depth)

    def atom(self) -> str:
        return self.pick.choice(ATOMS)

    def type(self, depth: int) -> str:
        inner = self.type(depth - 1) if depth else "int"
        return self.pick.choice(
            ["number", f"[{inner}]", f"(a: {inner}, in: text)", f"({inner}) -> bool", "() -> kernel"]
        )


def scrambled(text: str, pick: random.Random) -> str:
    """The same program with other spaces, line ends where they mean nothing, and comments."""
    tokens = lexing.lex(Source("t.blob", text)).tokens
    out: list[str] = []
    stack: list[str] = []
    for before, token in zip([None, *tokens], tokens, strict=False):
        free = bool(stack) and stack[-1] != "LBRACE"
        if before is None:
            out.append(text[: token.start])
        else:
            gap = text[before.end : token.start]
            out.append(gap if NEWLINE in (token.kind, before.kind) else _gap(gap, free, pick))
        if token.kind == END:
            break
        if token.kind == NEWLINE:
            doc = "///" in text[token.start : token.end]
            out.append(
                text[token.start : token.end] if doc else pick.choice(["\n", "\n\n\n", " // end\n", "\n  // own\n  "])
            )
            continue
        out.append(text[token.start : token.end])
        if token.kind in OPENERS:
            stack.append(token.kind)
        elif token.kind in CLOSERS:
            stack.pop()
    return "".join(out)


def _gap(gap: str, free: bool, pick: random.Random) -> str:
    if free and pick.random() < 0.2:
        return pick.choice(["\n", "\n\n", "\t\n   ", " // c\n", "\n// c\n", "\n\n  // c\n\n// d\n"])
    if gap and "\n" not in gap and "/" not in gap and pick.random() < 0.3:
        return pick.choice(["  ", "\t", " "])
    return gap
