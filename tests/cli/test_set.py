"""Parameters from outside: --set and --params."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Blob


def value(blob: Blob, name: str, *argv: str) -> object:
    result = blob("params", "lamp.blob", "--format", "json", *argv)
    assert result.code == 0, result.text
    entry = json.loads(result.out)["properties"][name]
    return entry.get("x-value", entry["default"])


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("drops", "7", 7),
        ("size", "0.5", 0.5),
        ("size", "1", 1),
        ("lean", "-20deg", "-20deg"),
        ("lean", "0.1turn", "36deg"),
        ("skin", "jelly", "jelly"),
        ("skin", '"jelly"', "jelly"),
        ("on", "false", False),
        ("tint", "#ff8800", "#ff8800"),
        ("tint", "gold", "#ffd700"),
    ],
)
def test_set(blob: Blob, name: str, text: str, expected: object) -> None:
    assert value(blob, name, "--set", f"{name}={text}") == expected


WRONG = [
    ("drops=40", "E0601", "`drops`", "1..20"),
    ("drops=0", "E0601", "`drops`", "1..20"),
    ("size=1e300", "E0601", "`size`", "0.1..1"),
    ("skin=stone", "E0601", "`skin`", "clay"),
    ("drop=4", "E0602", "`drop`", "`drops`"),
    ("zzz=4", "E0602", "`zzz`", "blobscript params"),
    ("drops=2.5", "E0603", "`drops`", "int"),
    ("drops=many", "E0603", "`drops`", "int"),
    ("lean=20", "E0603", "`lean`", "20deg"),
    ("on=7", "E0603", "`on`", "true"),
    ("drops=", "", "name=value", "--set"),
    ("drops=((", "E0603", "`drops`", "int"),
    ("drops=" + "(" * 5000, "E0603", "`drops`", "int"),
    ("drops=3\0", "E0603", "`drops`", "int"),
]


@pytest.mark.parametrize(("given", "code", "names", "remedy"), WRONG, ids=[row[0][:20].strip("\0") for row in WRONG])
@pytest.mark.parametrize("verb", [("check",), ("render", "-o", "x.png")], ids=["check", "render"])
def test_wrong_set(blob: Blob, verb: tuple[str, ...], given: str, code: str, names: str, remedy: str) -> None:
    result = blob(verb[0], "lamp.blob", *verb[1:], "--set", given)
    assert result.code == (1 if code else 2)
    assert code in result.text
    assert names in result.text
    assert remedy in result.text
    assert "Traceback" not in result.text
    assert not Path("x.png").exists()


def test_parameter_file(blob: Blob) -> None:
    Path("p.json").write_text('{"drops": 5, "lean": "15deg", "on": false, "tint": "#0000ff"}', encoding="utf-8")
    assert value(blob, "drops", "--params", "p.json") == 5
    assert value(blob, "lean", "--params", "p.json") == "15deg"
    assert value(blob, "on", "--params", "p.json") is False
    assert value(blob, "tint", "--params", "p.json") == "#0000ff"


def test_set_wins_over_the_file(blob: Blob) -> None:
    Path("p.json").write_text('{"drops": 5}', encoding="utf-8")
    assert value(blob, "drops", "--params", "p.json", "--set", "drops=6") == 6
    assert value(blob, "drops", "--set", "drops=6", "--set", "drops=8") == 8


@pytest.mark.parametrize("text", ["", "[1]", "{", "3", '{"drops": NaN', "[" * 100_000])
def test_parameter_file_that_is_no_object(blob: Blob, text: str) -> None:
    Path("p.json").write_text(text, encoding="utf-8")
    result = blob("check", "lamp.blob", "--params", "p.json")
    assert result.code == 3
    assert "E0801" in result.text
    assert "JSON object" in result.text


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ('{"drops": 99}', "E0601"),
        ('{"dropz": 9}', "E0602"),
        ('{"drops": [9]}', "E0603"),
        ('{"drops": null}', "E0603"),
        ('{"size": NaN}', "E0603"),
        ('{"drops": true}', "E0603"),
        ('{"lean": 20}', "E0603"),
    ],
)
def test_parameter_file_with_wrong_values(blob: Blob, text: str, code: str) -> None:
    Path("p.json").write_text(text, encoding="utf-8")
    result = blob("check", "lamp.blob", "--params", "p.json")
    assert result.code == 1
    assert code in result.text


def test_missing_parameter_file(blob: Blob) -> None:
    result = blob("check", "lamp.blob", "--params", "nowhere.json")
    assert result.code == 3
    assert "nowhere.json" in result.text


def test_the_schema_describes_what_params_reads(blob: Blob) -> None:
    schema = json.loads(blob("params", "lamp.blob", "--format", "json").out)
    defaults = {name: entry["default"] for name, entry in schema["properties"].items()}
    assert schema["properties"]["drops"]["minimum"] == 1
    assert schema["properties"]["drops"]["maximum"] == 20
    assert schema["properties"]["drops"]["description"] == "How many drops."
    assert schema["properties"]["drops"]["x-group"] == "Lamp"
    assert schema["properties"]["size"]["x-step"] == 0.1
    assert schema["properties"]["skin"]["enum"] == ["clay", "jelly"]
    assert schema["properties"]["lean"]["x-range"] == ["-45deg", "45deg"]
    Path("p.json").write_text(json.dumps(defaults), encoding="utf-8")
    assert blob("check", "lamp.blob", "--params", "p.json").code == 0


def test_params_as_text(blob: Blob) -> None:
    out = blob("params", "lamp.blob", "--set", "drops=7").out
    assert "  drops: int = 3 in 1..20, now 7\n      How many drops." in out
    assert "  lean: angle = 10deg in -45deg..45deg\n" in out
    assert blob("params", "hello.blob").out == "hello.blob has no parameters\n"


def test_moment_of_a_film(blob: Blob) -> None:
    """--time and --phase are what the script reads as `time` and `phase`."""
    Path("moves.blob").write_text(
        'assert time == 0 and phase == 0, "at {time} and {phase}"\nsurface { ball(radius = 1) }\n', encoding="utf-8"
    )
    assert blob("check", "moves.blob").code == 0
    for verb in (("check",), ("info",), ("render", "-o", "x.png", "--size", "4x4")):
        result = blob(verb[0], "moves.blob", *verb[1:], "--time", "2.5", "--phase", "0.25")
        assert result.code == 1
        assert "at 2.5 and 0.25" in result.text


@pytest.mark.parametrize(
    ("option", "text", "reason"),
    [
        ("--time", "soon", "is not a number"),
        ("--time", "inf", "is not a number"),
        ("--phase", "1.5", "does not lie in 0 to 1"),
        ("--phase", "nan", "is not a number"),
    ],
)
def test_moments_that_are_none(blob: Blob, option: str, text: str, reason: str) -> None:
    result = blob("check", "lamp.blob", option, text)
    assert result.code == 2
    assert f"`{text}` {reason}" in result.err


def test_params_show_what_only_the_script_can_give(blob: Blob) -> None:
    Path("more.blob").write_text(
        "param path = [(1, 2, 3)]\nparam count = 0..2\nsurface { ball(radius = 1) }\n", "utf-8"
    )
    assert blob("params", "more.blob").out == "  path: [vec3] = [(1, 2, 3)]\n  count: [int] = [0, 1, 2]\n"
    entries = json.loads(blob("params", "more.blob", "--format", "json").out)["properties"]
    assert entries["path"] == {"readOnly": True, "x-type": "[vec3]", "x-default": "[(1, 2, 3)]"}
    done = blob("render", "more.blob", "-o", "more.png", "--size", "8x6")
    assert (done.code, "parameters: {}\n" in blob("info", "more.png").out) == (0, True), done.text


@pytest.mark.parametrize("lean", ["-33.3333deg", "0.1rad", "0.0123turn"])
def test_the_notes_of_a_picture_make_it_again(blob: Blob, lean: str) -> None:
    """The parameters in a picture are a file for --params that gives the same scene to the bit."""
    sets = ("--set", f"lean={lean}", "--set", "tint=#12345678", "--set", "size=0.3", "--set", "skin=jelly")
    assert blob("render", "lamp.blob", "-o", "lamp.png", "--size", "8x6", *sets).code == 0
    notes = json.loads(blob("info", "lamp.png", "--format", "json").out)["provenance"]
    Path("p.json").write_text(notes["parameters"], encoding="utf-8")
    again = json.loads(blob("info", "lamp.blob", "--params", "p.json", "--format", "json").out)
    assert again["hash"] == notes["hash"]
