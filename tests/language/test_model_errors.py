"""The model texts of the design, from script to message, for what resolving to evaluating finds."""

from __future__ import annotations

from pathlib import Path

import pytest
from language.compiling import run

from blobscript.report import render
from blobscript.setting import Setting

MODEL = (Path(__file__).parent.parent / "syntax" / "golden" / "model-errors.txt").read_text(encoding="utf-8")

GECKO = """param bite = 0.25 in 0.0..1.0
assert not inside(gecko, at = (2.4, 0.57, 0)) or bite < 0.2, "the mouth is closed"
let gecko = surface { ball(radius = 3) }
gecko
"""

#: Code -> name of the file, script, parameters.
CASES: dict[str, tuple[str, str, dict[str, object]]] = {
    "E0201": ("melt.blob", "surface(threshold = 0.5, material = clay(corral)) {\n  ball(radius = 1)\n}\n", {}),
    "E0202": ("worm.blob", "let size = 1\nball((0, 0, 0), radius = size)\nlet size = 2\n", {}),
    "E0303": ("melt.blob", "surface(threshold = 0.5) {\n  ball((0, 0, 0), r = 1)\n}\n", {}),
    "E0301": ("gecko.blob", "gecko.rotate(y = 35)\nlet gecko = surface { ball(radius = 1) }\n", {}),
    "E0304": ("melt.blob", "surface(threshold = 0.5) {\n  point(0, 0, 0)\n}\n", {}),
    "E0601": (
        "gecko.blob",
        "surface { ball(radius = 1) }\nparam tail_length = 9 in 3..20\n",
        {"tail_length": Setting("40")},
    ),
    "W0402": (
        "gecko.blob",
        "let slab = ball(radius = 1)\nlet rock = surface(slab, threshold = 0.5)\nsurface { slab }\n",
        {},
    ),
}


def model(code: str) -> str:
    """The section of a code, without the summary at the end of the file."""
    sections = MODEL.split("\n\n")
    (found,) = [section for section in sections if section.startswith((f"error[{code}]", f"warning[{code}]"))]
    return found


def rendered(code: str, name: str, text: str, params: dict[str, object]) -> str:
    _, found = run(text, name=name, params=params)
    (one,) = found
    assert one.code == code
    return render(one)


@pytest.mark.parametrize("code", [code for code in CASES if code != "W0402"])
def test_as_the_model_has_it(code: str) -> None:
    assert rendered(code, *CASES[code]) == model(code)


def test_never_placed() -> None:
    text, wanted = rendered("W0402", *CASES["W0402"]), model("W0402")
    assert text.splitlines()[:5] == wanted.splitlines()[:5]
    assert "write its name on a line of its own: rock" in text
    assert "name it _rock" in text


def test_failed_assertion() -> None:
    text = rendered("E0701", "gecko.blob", GECKO, {})
    wanted = model("E0701").splitlines()
    assert text.splitlines()[:6] == wanted[:6]
    shown = [line.split("(the field")[0].rstrip() for line in text.splitlines()[6:]]
    assert shown == [line.split("(the field")[0].rstrip() for line in wanted[6:]]
    assert "(the field is 0.638646 there, the threshold 0.5)" in text
