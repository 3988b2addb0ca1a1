"""The words of the language in one table: for the parser's messages, the formatter and the editors' lexers."""

from __future__ import annotations

__all__ = [
    "BRACKETS",
    "CONSTANTS",
    "DECLARATIONS",
    "FOREIGN",
    "FOREIGN_ARGUMENTS",
    "FOREIGN_CALLS",
    "FOREIGN_NAMES",
    "OPERATOR_WORDS",
    "RESERVED",
    "STATEMENTS",
    "TRANSFORMS",
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

#: What stands behind a thing and changes it.
TRANSFORMS = frozenset(["move", "rotate", "scale", "mirror", "apply", "paint", "blob"])

BRACKETS = {"(": ")", "[": "]", "{": "}"}

#: What people write who come from other languages -> what it is called here.
FOREIGN = {
    "def": "fn", "function": "fn", "func": "fn", "fun": "fn", "module": "fn", "lambda": "fn",
    "var": "let", "const": "let", "val": "let", "auto": "let", "local": "let", "define": "let", "set": "let",
    "elif": "else if", "elsif": "else if", "elseif": "else if",
    "struct": "type", "typedef": "type", "use": "import", "include": "import", "parameter": "param",
    "print": "debug", "echo": "debug",
}  # fmt: skip

_ANGLES = "angles have a unit: 30deg, 0.5rad, 0.25turn; a number becomes one by x * 1deg"

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
    "cut": ("to cut something away, add a blob with a `reach` and a negative `weight`", ""),
    "carve": ("to cut something away, add a blob with a `reach` and a negative `weight`", ""),
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
    "print": ("a value is shown by `debug`: debug x", ""),
    "echo": ("a value is shown by `debug`: debug x", ""),
    "hull": ("round bodies between places are lines and polygons with a radius: line(a, b).blob(radius = 1)", ""),
    "vec3": ("a vector is written in parentheses: (x, y, z)", ""),
    **dict.fromkeys(("radians", "degrees", *UNITS), (_ANGLES, "")),
    "str": ('a value is put into a text by { }: "{x}"', ""),
}

_NOTHING = ("every name has a value here: leave the argument out, or use an empty list []", "")

#: The same for names that are not called.
FOREIGN_NAMES = {
    "True": ("it is written `true`", "true"),
    "False": ("it is written `false`", "false"),
    "PI": ("it is written `pi`", "pi"),
    **dict.fromkeys(UNITS, (_ANGLES, "")),
    "math": ("functions stand alone: sin(30deg), sqrt(2), pi", ""),
    "Math": ("functions stand alone: sin(30deg), sqrt(2), pi", ""),
    "None": _NOTHING,
    "null": _NOTHING,
    "undef": _NOTHING,
    "nil": _NOTHING,
}

_PAINT = "a field gets its colour behind it: .paint(coral)"
_LOOK = "the colour comes with the material: material = clay(coral)"

#: (callee, argument) -> advice and the argument that is meant ("": none).
FOREIGN_ARGUMENTS = {
    **{("camera", name): ("", "from") for name in ("position", "pos", "at", "location", "eye", "origin")},
    **{("camera", name): ("", "to") for name in ("look_at", "lookat", "target", "toward", "towards", "center")},
    **{("camera", name): ("", "fov") for name in ("angle", "field_of_view")},
    **{("lamp", name): ("", "at") for name in ("position", "pos", "location", "from", "center")},
    **{("sun", name): ("", "toward") for name in ("direction", "dir", "to")},
    **{(light, name): ("", "strength") for light in ("lamp", "sun") for name in ("intensity", "power", "brightness")},
    **{("ball", name): ("", "at") for name in ("center", "centre", "position", "pos", "p", "c")},
    **{("ball", name): ("", "radius") for name in ("size", "d", "diameter")},
    **{(maker, name): (_PAINT, "") for maker in ("ball", "balls", "blob") for name in ("color", "colour", "paint")},
    **{(maker, "material"): (_PAINT, "") for maker in ("ball", "balls", "blob")},
    **{("ball", name): ("a place is one vector: at = (x, y, z)", "") for name in ("x", "y", "z")},
    **{("surface", name): (_LOOK, "") for name in ("color", "colour", "paint")},
    **{("surface", name): ("", "threshold") for name in ("iso", "level", "isovalue")},
    ("image", "size"): ("give both sides: image(width = 640, height = 480)", ""),
}
