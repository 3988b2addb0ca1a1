"""Scripts with their mistakes beside the lines: `//! CODE message` at the end, or `//! line N CODE message`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from blobscript import syntax as s
from blobscript.driver import compile_source
from blobscript.fixes import apply_edits, fixable
from blobscript.parse import MOST_SHOWN, parse
from blobscript.report import render, render_all
from blobscript.source import Source

ERRORS = sorted((Path(__file__).parent / "errors").glob("*.blob"))
EXPECTED = re.compile(r"//! (?:line (\d+) )?([EW]\d{4}) (.*)$")


def expectations(text: str) -> list[tuple[int, str, str]]:
    found = []
    for number, line in enumerate(text.split("\n"), 1):
        match = EXPECTED.search(line)
        if match:
            found.append((int(match[1] or number), match[2], match[3]))
    return found


@pytest.mark.parametrize("path", ERRORS, ids=lambda path: path.stem)
def test_every_mistake_is_found_at_its_line(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    _, diagnostics = parse(Source(path.name, text))
    assert [(d.line, d.code, d.message) for d in diagnostics] == expectations(text)


@pytest.mark.parametrize("path", ERRORS, ids=lambda path: path.stem)
def test_reports_look_as_kept(path: Path, request: pytest.FixtureRequest) -> None:
    text = path.read_text(encoding="utf-8")
    report = render_all(parse(Source(path.name, text))[1])
    golden = path.parent.parent / "golden" / f"{path.stem}.txt"
    if request.config.getoption("--update-golden"):
        golden.write_text(report, encoding="utf-8")
    assert report == golden.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", ERRORS, ids=lambda path: path.stem)
def test_messages_are_in_the_words_of_the_language(path: Path) -> None:
    """No "expected a or b", no name of a terminal, of lark or of Python."""
    report = render_all(parse(Source(path.name, path.read_text(encoding="utf-8")))[1])
    ours = "\n".join(line for line in report.split("\n") if not re.match(r" *\d+ \|", line))
    assert not re.search(r"[Ee]xpected|\b[A-Z]{4,}\b|Token|lark|None|Error\b", ours)


@pytest.mark.parametrize("path", ERRORS, ids=lambda path: path.stem)
def test_safe_fixes_leave_fewer_mistakes_and_make_no_new_ones(path: Path) -> None:
    source = Source(path.name, path.read_text(encoding="utf-8"))
    _, before = parse(source)
    helps = [help_ for _, help_ in fixable(source, before, "safe")]
    fixed = apply_edits(source, helps, "safe")
    _, after = parse(Source(path.name, fixed.text))
    assert len(after) == len(before) - len(fixed.applied)


def test_seven_mistakes_in_fifteen_lines() -> None:
    text = """blobscript 1
param gap = 1.3 in 0.2..2.5 step .05
surface(threshold: 0.5) {
  ball((0, 0, 0), radius = 1),
  for i in 0..3 {
    ball((i 0, 0), radius = 1)
  }
  point(0, 0, 0).blob(radius = 0.5) ball((1, 1, 1), radius = 1)
}
let angle = 35 deg
let fn = 1
camera(from = (0, 3, 20), to = (0, 0, 0))
sun(toward = (-1, -2, -1), strength = 3)
"""
    _, diagnostics = parse(Source("t.blob", text))
    assert [(d.line, d.code) for d in diagnostics] == [
        (2, "E0108"), (3, "E0103"), (4, "E0105"), (5, "E0106"), (6, "E0103"), (8, "E0104"),
        (10, "E0108"), (11, "E0107"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("let a = @", ["a"]),
        ('@group("x")\nparam p = = 1', ["p"]),
        ("fn f(x { 3 }", ["f"]),
        ("kernel k(r) = ) 1 (", ["k"]),
        ("import a, b, c from ]", ["a", "b", "c"]),
        ('import "x" as y z', ["y"]),
        ("type T = @", ["T"]),
    ],
)
def test_an_item_that_failed_still_defines_its_name(text: str, names: list[str]) -> None:
    script, diagnostics = parse(Source("t.blob", f"{text}\nlet last = 1\n"))
    assert diagnostics
    defined: list[str] = []
    for item in script.items:
        match item:
            case s.ImportNames(imported):
                defined += [name.text for name in imported]
            case s.ImportModule(alias=name) | s.Let(name) | s.Param(name) | s.Fn(name) | s.KernelDecl(name):
                defined.append(name.text)
            case s.TypeAlias(name):
                defined.append(name.text)
            case _:
                pass
    assert [name for name in defined if name in names] == names
    assert defined[-1] == "last"


def test_more_than_twenty_are_counted() -> None:
    _, diagnostics = parse(Source("t.blob", "let = 1\n" * 37))
    assert len(diagnostics) == MOST_SHOWN
    assert diagnostics[-1].notes[-1] == "17 more syntax errors not shown"
    assert not any("more syntax" in note for d in diagnostics[:-1] for note in d.notes)


def test_in_order_of_place() -> None:
    _, diagnostics = parse(Source("t.blob", 'let a = (1\nlet = 2\nlet b = 1_0\nlet c = "{x"\nlet d = [1\n'))
    assert [d.line for d in diagnostics] == [1, 2, 3, 4, 5]


MODEL = (Path(__file__).parent / "golden" / "model-errors.txt").read_text(encoding="utf-8").split("\n\n")


@pytest.mark.parametrize(
    ("number", "name", "text"),
    [
        (0, "melt.blob", "blobscript 1\n\nsurface(threshold = 0.5, material = clay(coral) {\n  ball(radius = 1)\n}\n"),
        (1, "ring.blob", "sum {\n  for i in 0..<8 {\n    ball(radius = 1)\n  }\n}\n"),
    ],
)
def test_the_model_texts_from_the_script_on(number: int, name: str, text: str) -> None:
    (diagnostic,) = parse(Source(name, text))[1]
    assert render(diagnostic) == MODEL[number]


@pytest.mark.parametrize(
    "line",
    [
        "let size = (1 + 2",
        "let size = 1 + * 2",
        "let size = .5",
        "let size = 1 2",
        "let size = [1, 2][0",
        "let size: number == 1",
        "let size = if (true) 1",
        "size = 1",
        "var size = 1",
        "let size = 2 radius",
        "let size = f(1 2, oops = 3, x: 4)",
        "fn unused(a: number) { a b }",
        "surface { ball(0 0, radius: 1) oops }",
        "nonsense nonsense nonsense",
        "surface(threshold = 0.5 0.5) {\n  ball(radius = 1)\n}",
        "fn leg(a a: number) {\n  return sum {\n    ball(radius = 1)\n  }\n}",
    ],
)
def test_one_mistake_one_message(line: str) -> None:
    """What was guessed to go on is kept from resolving and checking: no errors that follow from it."""
    text = f"{line}\nlet more = {'size' if 'size' in line else '1'}\nsurface {{ ball(radius = more) }}\n"
    _, diagnostics = compile_source(Source("t.blob", text))
    assert [(d.line, d.code[:3]) for d in diagnostics] == [(1, "E01")]


def test_a_quotient_that_is_a_comment() -> None:
    """What closes the bracket stands behind `//`."""
    _, found = parse(Source("t.blob", "let half = floor(5 // 2)\n"))
    assert [(d.code, d.notes) for d in found] == [
        ("E0101", ("`//` starts a comment: the rest of the line is not read. A whole quotient is floor(a / b)",))
    ]
