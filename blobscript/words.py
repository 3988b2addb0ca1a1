"""The words of the language in one table: for the parser's messages, the formatter and the editors' lexers."""

from __future__ import annotations

__all__ = [
    "BRACKETS",
    "CONSTANTS",
    "DECLARATIONS",
    "FOREIGN",
    "OPERATOR_WORDS",
    "RESERVED",
    "STATEMENTS",
    "UNITS",
]

#: Words that start a definition, and those that only stand inside one.
DECLARATIONS = ("import", "from", "as", "type", "param", "in", "step", "fn", "return", "kernel", "let")

STATEMENTS = ("for", "if", "else", "assert", "debug")

OPERATOR_WORDS = ("and", "or", "not")

CONSTANTS = ("true", "false")

#: `kernel` is reserved only before a name; `blobscript`, the first word of a script, nowhere else.
RESERVED = frozenset(DECLARATIONS + STATEMENTS + OPERATOR_WORDS + CONSTANTS)

UNITS = ("deg", "rad", "turn")

BRACKETS = {"(": ")", "[": "]", "{": "}"}

#: What people write who come from other languages -> what it is called here.
FOREIGN = {
    "def": "fn", "function": "fn", "func": "fn", "fun": "fn", "module": "fn", "lambda": "fn",
    "var": "let", "const": "let", "val": "let", "auto": "let", "local": "let", "define": "let", "set": "let",
    "elif": "else if", "elsif": "else if", "elseif": "else if",
    "struct": "type", "typedef": "type", "use": "import", "include": "import", "parameter": "param",
    "print": "debug", "echo": "debug",
}  # fmt: skip
