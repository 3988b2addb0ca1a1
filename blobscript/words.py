"""The words of the language in one table: for the parser's messages, the formatter and the editors' lexers."""

from __future__ import annotations

__all__ = [
    "BRACKETS",
    "CONSTANTS",
    "DECLARATIONS",
    "FOREIGN",
    "FOREIGN_CALLS",
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

#: Functions of other languages -> what to write here, and the word that can stand in their place ("": none can).
FOREIGN_CALLS = {
    "sphere": ("a blob around a point is a `ball`", "ball"),
    "blob": ("a blob around a point is a `ball`", "ball"),
    "cube": ("a body with corners is a `polyhedron(...).blob(...)`", ""),
    "box": ("a body with corners is a `polyhedron(...).blob(...)`", ""),
    "cylinder": ("a rod is a line with a radius: line(a, b).blob(radius = 1)", ""),
    "torus": ("a ring is a circle with a radius: import circle from std.curves, circle(1).blob(radius = 0.2)", ""),
    "union": ("blobs are joined by `sum`, which melts them, or `max`, which does not", "sum"),
    "smooth_union": ("a joint without crease and without bulge is a `smooth_max`", "smooth_max"),
    "smax": ("a joint without crease and without bulge is a `smooth_max`", "smooth_max"),
    "blend": ("blobs are joined by `sum`, which melts them, or by `smooth_max`, which only rounds the crease", "sum"),
    "difference": ("to cut something away, add a blob with a `reach` and a negative `weight`", ""),
    "subtract": ("to cut something away, add a blob with a `reach` and a negative `weight`", ""),
    "intersection": ("what lies in all of several fields is their `min`", "min"),
    "intersect": ("what lies in all of several fields is their `min`", "min"),
    "translate": ("a thing is moved by `move`", "move"),
    "color": ("a field gets its colour by `paint`", "paint"),
    "colour": ("a field gets its colour by `paint`", "paint"),
    "pigment": ("a field gets its colour by `paint`", "paint"),
    "texture": ("a surface has a `material`, such as plastic(teal)", ""),
    "light": ("a light is a `sun` or a `lamp`", "lamp"),
    "light_source": ("a light is a `sun` or a `lamp`", "lamp"),
    "pow": ("a power is written a ^ b", ""),
    "norm": ("the length of a vector is its `length`", "length"),
    "rands": ("random numbers are made one by one: rand(i)", "rand"),
    "range": ("a range is written 0..<8 (without 8) or 0..8", ""),
    "while": ("there are only loops with an end: for (i in 0..<8) { ... }", ""),
}
