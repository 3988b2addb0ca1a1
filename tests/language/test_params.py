"""Parameters: values from outside against type, range and choices, and what `params` shows of them."""

from __future__ import annotations

import math

import pytest
from language.compiling import run

from blobscript import ir
from blobscript.diagnostics import Diagnostic
from blobscript.setting import Setting
from blobscript.values import Color

SCRIPT = """
/// How many.
/// Two lines.
@group("Body")
param count = 7 in 1..20
param size = 0.5 in 0..<2 step 0.25
@group("Body")
param lean = 10deg in -45deg..45deg step 5deg
param skin = "clay" in ["clay", "jelly"]
param pick = 2 in [1, 2, 4]
param on = true
param tint = coral
param at = (1, 2, 3)
param free: number = 3
param twice = 2 * count
let looks = [plastic, clay]
param table = [1, 2]
surface(threshold = 0.5) { for (i in 0..<count) { ball(at, radius = 1 + size + free + twice) } }
"""


def params(**given: object) -> dict[str, ir.ParamInfo]:
    scene, found = run(SCRIPT, params=given)
    assert scene is not None, found
    return {info.name: info for info in scene.params}


def error(**given: object) -> Diagnostic:
    scene, found = run(SCRIPT, params=given)
    assert scene is None
    (one,) = found
    return one


def test_what_is_known_about_them() -> None:
    known = params()
    assert list(known) == ["count", "size", "lean", "skin", "pick", "on", "tint", "at", "free", "twice", "table"]
    assert [p.type for p in known.values()] == (
        ["int", "number", "angle", "text", "int", "bool", "color", "vec3", "number", "int", "[int]"]
    )
    count, size, lean, skin, pick = (known[name] for name in ("count", "size", "lean", "skin", "pick"))
    assert (count.default, count.value, count.range, count.step) == (7, 7, (1, 20), None)
    assert (count.group, count.doc) == ("Body", "How many.\nTwo lines.")
    assert (size.range, size.step, size.group, size.doc) == ((0, 2), 0.25, "", "")
    assert lean.range == (math.radians(-45), math.radians(45))
    assert skin.choices == ("clay", "jelly")
    assert pick.choices == (1, 2, 4)
    assert known["tint"].default == Color.from_srgb(1, 127 / 255, 80 / 255)
    assert isinstance(known["free"].value, float)


ACCEPTED = [
    ("count", 20, 20),
    ("count", 20.0, 20),
    ("count", " 3 ", 3),
    ("size", 1, 1.0),
    ("size", "1.5e0", 1.5),
    ("size", ".25", 0.25),
    ("lean", "-20deg", math.radians(-20)),
    ("lean", "0.1turn", 0.1 * 2 * math.pi),
    ("lean", "0.5rad", 0.5),
    ("skin", "jelly", "jelly"),
    ("skin", '"jelly"', "jelly"),
    ("pick", 4, 4),
    ("on", False, False),
    ("on", "false", False),
    ("tint", "gold", Color.from_srgb(1, 215 / 255, 0)),
    ("tint", "#f80", Color.from_srgb(1, 136 / 255, 0)),
    ("tint", "#ff880080", Color.from_srgb(1, 136 / 255, 0, 128 / 255)),
    ("at", [1, 2.5, 3], (1.0, 2.5, 3.0)),
    ("at", "(1, 2.5, 3)", (1.0, 2.5, 3.0)),
    ("at", "1,2.5,-3", (1.0, 2.5, -3.0)),
    ("free", 100.5, 100.5),
]


@pytest.mark.parametrize(("name", "given", "value"), ACCEPTED, ids=[f"{n}={g}" for n, g, _ in ACCEPTED])
def test_accepted(name: str, given: object, value: object) -> None:
    info = params(**{name: given})[name]
    assert info.value == value
    assert type(info.value) is type(value)


REFUSED = [
    ("count", 21, "E0601"),
    ("count", "0", "E0601"),
    ("size", 2, "E0601"),
    ("size", "2.0", "E0601"),
    ("lean", "46deg", "E0601"),
    ("skin", "stone", "E0601"),
    ("pick", 3, "E0601"),
    ("count", 2.5, "E0603"),
    ("count", "2.5", "E0603"),
    ("count", True, "E0603"),
    ("count", None, "E0603"),
    ("count", [3], "E0603"),
    ("count", "٣", "E0603"),
    ("count", "9" * 400, "E0603"),
    ("size", "wide", "E0603"),
    ("size", math.nan, "E0603"),
    ("size", math.inf, "E0603"),
    ("size", "1e999", "E0603"),
    ("size", "nan", "E0603"),
    ("lean", 20, "E0603"),
    ("lean", "20", "E0603"),
    ("lean", "20 degrees", "E0603"),
    ("skin", 3, "E0603"),
    ("on", 1, "E0603"),
    ("on", "yes", "E0603"),
    ("tint", "nocolour", "E0603"),
    ("tint", "#12345", "E0603"),
    ("tint", 7, "E0603"),
    ("at", [1, 2], "E0603"),
    ("at", "1,2", "E0603"),
    ("at", [1, 2, "x"], "E0603"),
    ("table", [1, 2], "E0603"),
]


@pytest.mark.parametrize(("name", "given", "code"), REFUSED, ids=[f"{n}={str(g)[:12]}" for n, g, _ in REFUSED])
def test_refused(name: str, given: object, code: str) -> None:
    found = error(**{name: given})
    assert found.code == code
    assert f"`{name}`" in found.message
    assert found.span is not None
    assert found.span.text in (name, "1..20", "0..<2", "-45deg..45deg", '["clay", "jelly"]', "[1, 2, 4]")


def test_unknown() -> None:
    found = error(cuont=3)
    assert (found.code, found.span, found.path) == ("E0602", None, "test.blob")
    assert [help_.text for help_ in found.helps] == [
        "did you mean `count`?",
        "`blobscript params test.blob` lists all parameters and their ranges",
    ]
    scene, more = run("surface { ball(radius = 1) }", params={"a": 1})
    assert scene is None
    assert more[0].notes == ("it has no parameters at all",)


def test_where_the_value_came_from() -> None:
    assert error(count=Setting("99")).helps[0].text == (
        "given on the command line: --set count=99\n                                       ^^"
    )
    assert error(count=99).helps[0].text == "given as a parameter: count = 99"


def test_all_mistakes_are_told_at_once() -> None:
    _, found = run(SCRIPT, params={"count": 99, "size": "x", "nope": 1})
    assert sorted(d.code for d in found) == ["E0601", "E0602", "E0603"]


def test_later_defaults_follow() -> None:
    assert params(count=5)["twice"].value == 10
    assert params(count=5)["twice"].default == 10


ONLY_IN_THE_SCRIPT = [
    ("[(1, 2, 3)]", "[(1, 2, 3)]"),
    ("(a = 1, tint = coral)", "(a = 1, tint = #ff7f50)"),
    ("0..3", "[0, 1, 2, 3]"),
    ("[10deg]", "[10deg]"),
    ("wyvill", "wyvill"),
    ("clay(coral)", "a material"),
    ("ball(radius = 1)", "a field"),
]


@pytest.mark.parametrize(("default", "shown"), ONLY_IN_THE_SCRIPT)
def test_what_only_the_script_can_give_is_kept_as_it_is_written(default: str, shown: str) -> None:
    scene, found = run(f"param p = {default}\nsurface {{ ball(radius = 1) }}")
    assert scene is not None, found
    (info,) = scene.params
    assert (info.default, info.value, info.settable) == (shown, shown, False)
