"""The layout of diagnostics: every case of the design's model texts, built by hand and rendered."""

from __future__ import annotations

from pathlib import Path

import pytest

from blobscript.diagnostics import Diagnostic, Edit, Help, Label
from blobscript.report import render, summary
from blobscript.source import Source, Span

MODEL = (Path(__file__).parent / "golden" / "model-errors.txt").read_text(encoding="utf-8")


class Place:
    """A source that finds its own spans: `at(piece)`, the n-th time it occurs."""

    def __init__(self, path: str, *lines: str) -> None:
        self.source = Source(path, "\n".join(lines) + "\n")

    def at(self, piece: str, nth: int = 0) -> Span:
        start = -1
        for _ in range(nth + 1):
            start = self.source.text.index(piece, start + 1)
        return Span(self.source, start, start + len(piece))

    def edit(self, piece: str, replacement: str) -> Edit:
        return Edit(self.at(piece), replacement)

    def insert(self, before: str, text: str) -> Edit:
        span = self.at(before)
        return Edit(Span(self.source, span.end, span.end), text)


def e0101() -> Diagnostic:
    p = Place("melt.blob", "blobscript 1", "", "surface(threshold = 0.5, material = clay(coral) {", "}")
    return Diagnostic(
        "E0101",
        "this `(` is never closed",
        p.at("("),
        "opened here",
        (Label(p.at("{"), "a block starts here, so the arguments should end before it"),),
        (Help("close it before the block", (p.insert("coral)", ")"),)),),
    )


def e0106() -> Diagnostic:
    p = Place("ring.blob", "sum {", "  for i in 0..<8 {", "  }", "}")
    return Diagnostic(
        "E0106",
        "`for` wants its header in parentheses",
        p.at("i in 0..<8"),
        "put ( ) around this",
        helps=(
            Help("as in Python, Rust or Swift, but with parentheses", (p.edit("i in 0..<8", "(i in 0..<8)"),), "safe"),
        ),
    )


def e0201() -> Diagnostic:
    p = Place("melt.blob", "surface(threshold = 0.5, material = clay(corral)) {", "}")
    help_ = Help("the colour `coral` is close", (p.edit("corral", "coral"),))
    return Diagnostic("E0201", "there is no `corral` here", p.at("corral"), "unknown name", helps=(help_,))


def e0202() -> Diagnostic:
    p = Place("worm.blob", "let size = 1", "ball((0, 0, 0), radius = size)", "let size = 2")
    return Diagnostic(
        "E0202",
        "`size` is defined twice",
        p.at("size", 2),
        "second definition",
        (Label(p.at("size"), "first definition"),),
        (
            Help(
                "a name keeps one value; nothing is ever overwritten.\n"
                "Give the second one its own name, or pass it as an argument"
            ),
        ),
    )


def e0303() -> Diagnostic:
    p = Place("melt.blob", "surface(threshold = 0.5) {", "  ball((0, 0, 0), r = 1)", "}")
    return Diagnostic(
        "E0303",
        "`ball` has no argument `r`",
        p.at("r = 1"),
        "not an argument of `ball`",
        helps=(
            Help(
                "did you mean `radius`?", (Edit(Span(p.source, p.at("r = 1").start, p.at("r =").start + 1), "radius"),)
            ),
        ),
        notes=(
            "ball(at: vec3 = (0, 0, 0), radius: number, *, reach: number, weight: number, "
            "kernel: kernel = inherited) -> field",
        ),
    )


def e0301() -> Diagnostic:
    p = Place("gecko.blob", "gecko.rotate(y = 35)")
    return Diagnostic(
        "E0301",
        "`rotate` wants an angle for `y`, but 35 is a plain number",
        p.at("35"),
        "number",
        helps=(Help("write the unit", (p.edit("35", "35deg"),)),),
        notes=("angles are the only numbers with a unit: deg, rad or turn",),
    )


def e0304() -> Diagnostic:
    p = Place("melt.blob", "surface(threshold = 0.5) {", "  point(0, 0, 0)", "}")
    return Diagnostic(
        "E0304",
        "`sum` adds fields, but a point is a skeleton",
        p.at("point(0, 0, 0)"),
        "skeleton: a place without thickness",
        (Label(p.at("surface(threshold = 0.5)"), "the items of this block are summed"),),
        (Help("give it a radius", (p.insert("point(0, 0, 0)", ".blob(radius = 1)"),), "example"),),
    )


def e0501() -> Diagnostic:
    p = Place("kernels.blob", "kernel soft(r) = (1 - r)^2 + 0.1")
    return Diagnostic(
        "E0501",
        "kernel `soft` must end at 0, but D(1) = 0.1",
        p.at("(1 - r)^2 + 0.1"),
        "at r = 1 this is 0.1, and at r = 0 it is 1.1",
        helps=(
            Help(
                "a kernel is 1 at the skeleton (r = 0) and 0 at the reach (r = 1).\n"
                "A jump at r = 1 would tear the surface along a sphere"
            ),
        ),
        notes=("D(r)  1.1 |#\n          |###\n          |######.\n      0.1 |############   r = 0 .. 1",),
    )


def e0503() -> Diagnostic:
    p = Place("kernels.blob", "kernel shell(r) = (1 - r^2)^2 * (1 + 6 * r^2)")
    return Diagnostic(
        "E0503",
        "kernel `shell` rises: it should only fall",
        p.at("(1 - r^2)^2 * (1 + 6 * r^2)"),
        "rises from D(0) = 1 to D(0.471) = 1.412, then falls",
        helps=(Help("if the hollow shell is what you want, say so on the line above:\n@allow(nonmonotone)"),),
        notes=("proved exactly: D'(1/4) = 1.348 > 0",),
    )


def e0504() -> Diagnostic:
    p = Place("kernels.blob", "kernel halves(r) = if (r < 0.5) 1 - r^2 else (1 - r)^2")
    return Diagnostic(
        "E0504",
        "kernel `halves` jumps at r = 1/2",
        p.at("if (r < 0.5)"),
        "the two branches meet here",
        (Label(p.at("1 - r^2"), "0.75 at r = 1/2"), Label(p.at("(1 - r)^2"), "0.25 at r = 1/2")),
        (
            Help(
                "make both branches agree in value and slope at r = 1/2,\n"
                "for example: if (r < 0.5) 1 - 2 * r^2 else 2 * (1 - r)^2"
            ),
        ),
    )


def e0601() -> Diagnostic:
    p = Place("gecko.blob", '@group("Body")', "param tail_length = 9 in 3..20")
    given = "given on the command line: --set tail_length=40"
    return Diagnostic(
        "E0601",
        "`tail_length` must lie in 3..20, but 40 was given",
        p.at("3..20"),
        "allowed here",
        helps=(
            Help(f"{given}\n{'':{given.index('40')}}^^"),
            Help("`blobscript params gecko.blob` lists all parameters and their ranges"),
        ),
    )


def e0701() -> Diagnostic:
    condition = "not inside(gecko, at = (2.4, 0.57, 0)) or bite < 0.2"
    p = Place("gecko.blob", "", f'assert {condition}, "the mouth is closed"')
    return Diagnostic(
        "E0701",
        "assertion failed: the mouth is closed",
        p.at(condition),
        "false",
        notes=(
            "inside(gecko, at = (2.4, 0.57, 0))  is true   (the field and threshold there)\n"
            "bite                                is 0.25\n"
            "bite < 0.2                          is false",
        ),
    )


def w0401() -> Diagnostic:
    first, second = "ball((-0.9, 0, 0), reach = 1, weight = 0.7)", "ball((0.9, 0, 0), reach = 1, weight = 0.7)"
    p = Place("melt.blob", "surface(threshold = 1.2) {", f"  {first}", f"  {second}", "}")
    return Diagnostic(
        "W0401",
        "this surface is empty: its threshold can never be reached",
        p.at("1.2"),
        "no point has a field this high",
        (Label(p.at(first), "at most 0.7"), Label(p.at(second), "at most 0.7; they barely overlap")),
        (Help("lower the threshold below 0.7, raise the weights, or move the balls together"),),
        ("the highest field value is 0.7 (proved with interval bounds)",),
    )


def w0402() -> Diagnostic:
    p = Place("gecko.blob", "", "let rock = surface(slab, threshold = 0.5)")
    return Diagnostic(
        "W0402",
        "surface `rock` is defined but not in the scene",
        p.at("rock"),
        "never placed",
        helps=(
            Help("to place it, write its name on a line of its own: rock\nto keep it aside on purpose, name it _rock"),
        ),
    )


CASES = [e0101, e0106, e0201, e0202, e0303, e0301, e0304, e0501, e0503, e0504, e0601, e0701, w0401, w0402]


@pytest.mark.parametrize("case", CASES, ids=[case.__name__ for case in CASES])
def test_looks_like_the_model(case) -> None:
    *cases, _ = MODEL.split("\n\n")
    assert render(case()) == cases[CASES.index(case)]


def test_summary_counts_like_the_model() -> None:
    assert summary([case() for case in CASES]) == MODEL.split("\n\n")[-1].strip()
