"""The numbers of every built-in as large, small, negative or undefined as can be: an error or a scene, no more."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from language.compiling import SURFACE
from language.test_builtins import CASES, IDS, call, sample

from blobscript.callables import Parameter, Signature
from blobscript.driver import compile_source
from blobscript.report import render_all
from blobscript.source import Source
from blobscript.types import ANGLE, COLOR, INT, NUMBER, VEC3, ListOf, OneOf, Type, describe

BEFORE = """
let huge = 1e300 * 1e300
let odd = huge - huge
let dark = lerp(white, black, 3)
let far = lerp(black, white, 1e5)
"""
NUMBERS = ["huge", "-huge", "odd", "1e300", "-1e300", "5e-324", "0.0", "-1.0"]
WHOLE = ["0", "-1", "9007199254740993", "1000000000000000000000"]
VALUES = {
    NUMBER: NUMBERS,
    INT: WHOLE,
    ANGLE: [f"{number} * 1deg" for number in NUMBERS],
    VEC3: [f"({number}, {other}, 0)" for number in NUMBERS for other in ("1", number)],
    COLOR: ["dark", "far", "#00000000"],
}


def values_of(kind: Type) -> list[str]:
    match kind:
        case OneOf(options):
            return [value for option in options for value in values_of(option)]
        case ListOf(element):
            return [f"[{value}, {value}]" for value in values_of(element)] + (["[]"] if values_of(element) else [])
        case _:
            return VALUES.get(kind, [])


def extreme_calls(signature: Signature) -> Iterator[str]:
    """Each parameter in turn, with the optional others and without."""
    plain = {p.name: sample(p.type) for p in signature.parameters}
    for parameter in signature.parameters:
        for value in values_of(parameter.type):
            yield call(signature, {**plain, parameter.name: value})
            if not others(signature, parameter):
                continue
            few = tuple(p for p in signature.parameters if not p.optional or p == parameter)
            yield call(Signature(signature.name, few, signature.result, ""), {**plain, parameter.name: value})


def others(signature: Signature, parameter: Parameter) -> bool:
    return any(p.optional and p != parameter for p in signature.parameters)


#: Type of a value -> how it gets into the scene.
USES = {
    "field": "surface { made }",
    "surface": "made",
    "skeleton": "surface { made.blob(radius = 0.3) }",
    "material": "surface(material = made) { ball(radius = 1) }",
    "light": "made",
    "camera": "made",
    "background": "made",
    "stage": "made",
    "image": "made",
    "animate": "made",
    "color": "surface(material = clay(made)) { ball(radius = 1) }\nbackground(made)\nsun((0, -1, 0), made)",
    "vec3": "surface { ball(made, radius = 1) }\ncamera(from = made)",
    "number": "surface { ball(radius = made) }\nlamp((0, 3, 0), white, made)",
    "angle": "surface { ball(radius = 1).rotate(x = made) }",
    "kernel": "surface { ball(radius = 1, kernel = made) }",
    "transform": "surface { ball(radius = 1).apply(made) }",
}


@pytest.mark.parametrize(("name", "signature"), CASES, ids=IDS)
def test_no_number_makes_the_compiler_stumble(name: str, signature: Signature) -> None:
    for expression in extreme_calls(signature):
        text = f"{BEFORE}let made = {expression}\n{USES.get(describe(signature.result), '')}{SURFACE}"
        scene, found = compile_source(Source("t.blob", text))
        assert render_all(found) or not found
        assert scene is not None or any(d.severity == "error" for d in found), expression
