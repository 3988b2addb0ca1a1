"""Every operator with every pair of types: what it gives, or that it is refused."""

from __future__ import annotations

import itertools

import pytest
from language.compiling import run

#: A value of every type.
SAMPLES = {
    "int": "3",
    "number": "1.5",
    "angle": "30deg",
    "bool": "true",
    "text": '"a"',
    "vec3": "(1, 2, 3)",
    "color": "coral",
    "[int]": "[1, 2]",
    "(a: int)": "(a = 1)",
    "(number) -> number": "(fn(x: number) = x)",
    "skeleton": "point(0, 0, 0)",
    "field": "ball(radius = 1)",
    "surface": "surface { ball(radius = 1) }",
    "material": "clay",
    "kernel": "soft2",
    "light": "lamp((0, 0, 9))",
    "camera": "camera((0, 0, 9))",
    "background": "background(black)",
    "image": "image()",
    "animate": "animate(1)",
    "stage": "fog(9)",
    "transform": "identity",
}

#: Operator -> what it takes -> what it gives.
DEFINED = {
    "+": {
        ("int", "int"): "int",
        ("int", "number"): "number",
        ("number", "int"): "number",
        ("number", "number"): "number",
        ("angle", "angle"): "angle",
        ("vec3", "vec3"): "vec3",
        ("field", "field"): "field",
    },
    "*": {
        ("int", "int"): "int",
        ("int", "number"): "number",
        ("number", "int"): "number",
        ("number", "number"): "number",
        ("int", "angle"): "angle",
        ("number", "angle"): "angle",
        ("angle", "int"): "angle",
        ("angle", "number"): "angle",
        ("int", "vec3"): "vec3",
        ("number", "vec3"): "vec3",
        ("vec3", "int"): "vec3",
        ("vec3", "number"): "vec3",
        ("int", "field"): "field",
        ("number", "field"): "field",
        ("field", "int"): "field",
        ("field", "number"): "field",
    },
    "/": {
        ("int", "int"): "number",
        ("int", "number"): "number",
        ("number", "int"): "number",
        ("number", "number"): "number",
        ("angle", "int"): "angle",
        ("angle", "number"): "angle",
        ("angle", "angle"): "number",
        ("vec3", "int"): "vec3",
        ("vec3", "number"): "vec3",
        ("field", "int"): "field",
        ("field", "number"): "field",
    },
    "^": {
        ("int", "int"): "int",  # the sample's power is written as a whole number
        ("int", "number"): "number",
        ("number", "int"): "number",
        ("number", "number"): "number",
    },
    "<": {
        ("int", "int"): "bool",
        ("int", "number"): "bool",
        ("number", "int"): "bool",
        ("number", "number"): "bool",
        ("angle", "angle"): "bool",
    },
    "==": {
        ("int", "number"): "bool",
        ("number", "int"): "bool",
        **{(kind, kind): "bool" for kind in ("int", "number", "angle", "bool", "text", "vec3", "color")},
        ("[int]", "[int]"): "bool",
        ("(a: int)", "(a: int)"): "bool",
    },
    "and": {("bool", "bool"): "bool"},
    "..": {("int", "int"): "[int]"},
}
DEFINED["-"] = DEFINED["+"]
DEFINED["..<"] = DEFINED[".."]
for like, others in (("<", ("<=", ">", ">=")), ("==", ("!=",)), ("and", ("or",))):
    for other in others:
        DEFINED[other] = DEFINED[like]

NUMERIC = {"int", "number", "angle"}


def refusal(op: str, left: str, right: str) -> set[str]:
    """The codes that may say no."""
    if op in ("and", "or"):
        return {"E0304"}
    if op in ("..", "..<"):
        return {"E0301", "E0304"}  # numbers and angles have no steps, and do not mix
    if op in ("==", "!="):
        return {"E0310"} if left == right else {"E0311"}
    if {left, right} <= NUMERIC and "angle" in (left, right) and op not in ("*", "/", "^"):
        return {"E0301"}
    return {"E0310"}


def type_and_codes(expression: str) -> tuple[str | None, set[str]]:
    _, found = run(f"let value = {expression}\ndebug value\nsurface {{ ball(radius = 1) }}")
    shown = [d.label.partition(": ")[0] if "=" in d.message else "" for d in found if d.severity == "note"]
    return (shown[0] if shown else None), {d.code for d in found if d.severity == "error"}


@pytest.mark.parametrize("op", DEFINED)
def test_binary(op: str) -> None:
    wrong: list[str] = []
    for left, right in itertools.product(SAMPLES, repeat=2):
        a, b = SAMPLES[left], SAMPLES[right]
        kind, codes = type_and_codes(f"{a} {op} {b}")
        expected = DEFINED[op].get((left, right))
        if expected is not None:
            if kind != expected or codes:
                wrong.append(f"{left} {op} {right}: {kind} {codes}, not {expected}")
        elif not codes or not codes <= refusal(op, left, right):
            wrong.append(f"{left} {op} {right}: {kind} {codes}, not {refusal(op, left, right)}")
    assert wrong == []


NEGATED = {"int": "int", "number": "number", "angle": "angle", "vec3": "vec3", "field": "field"}


@pytest.mark.parametrize("kind", SAMPLES)
def test_unary(kind: str) -> None:
    found, codes = type_and_codes(f"-{SAMPLES[kind]}")
    assert (found, codes) == ((NEGATED[kind], set()) if kind in NEGATED else (None, {"E0310"}))
    found, codes = type_and_codes(f"not {SAMPLES[kind]}")
    assert (found, codes) == (("bool", set()) if kind == "bool" else (None, {"E0304"}))


@pytest.mark.parametrize("kind", SAMPLES)
def test_lists_and_conditions(kind: str) -> None:
    """`[ ]` behind a value, `...` and `for` want a list, an index an int, and `if` a bool."""
    value, wrong = SAMPLES[kind], (None, {"E0304"})
    is_list = kind == "[int]"
    assert type_and_codes(f"{value}[0]") == (("int", set()) if is_list else wrong)
    assert type_and_codes(f"[...{value}]") == (("[int]", set()) if is_list else wrong)
    assert type_and_codes(f"[for (x in {value}) x]") == (("[int]", set()) if is_list else wrong)
    assert type_and_codes(f"if ({value}) 1 else 2") == (("int", set()) if kind == "bool" else wrong)
    if kind != "int":
        assert type_and_codes(f"[1, 2][{value}]") == (None, {"E0301" if kind == "angle" else "E0304"})
