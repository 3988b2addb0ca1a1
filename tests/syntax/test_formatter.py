"""The formatter keeps the meaning and every comment, and has nothing to add to its own work."""

from __future__ import annotations

import random
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from syntax.programs import Programs, scrambled
from syntax.scripts import named, parsed, scripts, shape

from blobscript.formatter import WIDTH, format_source
from blobscript.parse import parse
from blobscript.source import Source

WIDTHS = [20, 40, 60, 80, 100, 120]


def formatted(text: str, width: int = WIDTH) -> str:
    out, diagnostics = format_source(Source("t.blob", text), width)
    assert out is not None, [d.message for d in diagnostics]
    return out


def comments(text: str) -> list[str]:
    plain = re.sub(r'"(\\.|[^"\\\n])*"', '""', text)
    return [comment.rstrip() for comment in re.findall(r"//[^\n]*", plain)]


def holds(text: str, width: int) -> None:
    out = formatted(text, width)
    assert shape(parsed(out)) == shape(parsed(text))
    assert comments(out) == comments(text)
    assert formatted(out, width) == out
    assert not re.search(r"[ \t]\n|\n\n\n|\t|\A\n", out.replace('"\t"', ""))
    assert out == "" or out.endswith("\n")


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("path", scripts(), ids=named)
def test_scripts(path, width: int) -> None:
    holds(path.read_text(encoding="utf-8"), width)


@pytest.mark.parametrize("path", [p for p in scripts() if "data/language" in p.as_posix()], ids=named)
def test_the_design_is_written_this_way(path) -> None:
    text = path.read_text(encoding="utf-8")
    assert formatted(text) == text


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.integers(0, 2**32), st.sampled_from(WIDTHS))
def test_programs_made_at_random(seed: int, width: int) -> None:
    pick = random.Random(seed)
    text = Programs(pick).program(4)
    assert not parse(Source("t.blob", text))[1], text
    holds(scrambled(text, pick), width)


def test_random_programs_are_scrambled_well() -> None:
    """Scrambling changes layout and comments, not the tree: else the tests above would test little."""
    changed = remarks = 0
    for seed in range(40):
        pick = random.Random(seed)
        text = Programs(pick).program(4)
        other = scrambled(text, pick)
        assert shape(parsed(other))[2:] == shape(parsed(text))[2:]
        changed += other != text
        remarks += len(comments(other)) > len(comments(text))
    assert changed > 35
    assert remarks > 25


@pytest.mark.parametrize(
    ("text", "out"),
    [
        ("", ""),
        ("\n\n// c\n\n\n\na\n", "// c\n\na\n"),
        ("\ufefflet  a=1+2*- 3^2\r\n", "let a = 1 + 2 * -3^2\n"),
        ("a-b\n-c\nd\n(1,2,3)\n", "a - b\n-c\nd\n(1, 2, 3)\n"),
        ("f( a ,b=[ 1 , ... c ] , )", "f(a, b = [1, ...c])\n"),
        ("for(i,x in 0 .. n-1){a}", "for (i, x in 0..n - 1) { a }\n"),
        ("if(a)-1 else(2)\n", "if (a) -1 else (2)\n"),
        ("if (a) { b }\nelse\n{ c }", "if (a) { b } else { c }\n"),
        ("sum\n{\na\n\n\nb }", "sum {\n  a\n\n  b\n}\n"),
        ("sum { }\nf()[1](2).b{ }", "sum {}\nf()[1](2).b {}\n"),
        ("a // c\nb  // d\n// e\n", "a  // c\nb  // d\n// e\n"),
        ("let x = [\n1,2,\n// c\n]", "let x = [\n  1, 2,\n  // c\n]\n"),
        ("f(a,\n\n  b\n)", "f(\n  a,\n\n  b\n)\n"),
        ("f(sum {\na\n}, 1)", "f(sum {\n  a\n}, 1)\n"),
        ("let f=fn(a:int)->number=not (a)", "let f = fn(a: int) -> number = not (a)\n"),
        ("fn f(a,*,b)=a\n@ group ( 1 )\nparam p=1 in[1,2]", "fn f(a, *, b) = a\n@group(1)\nparam p = 1 in [1, 2]\n"),
        ("type T=(a:[int],b:(int)->text)", "type T = (a: [int], b: (int) -> text)\n"),
        ("let x = a\n  .b()\n        .c()", "let x = a\n  .b()\n  .c()\n"),
    ],
)
def test_layout(text: str, out: str) -> None:
    assert formatted(text) == out


def test_long_lines_break_where_people_would() -> None:
    text = (
        "let shown = [(k = soft, tint = coral), (k = metaball, tint = gold)]\n"
        "ball((-0.4, 0.62, 0), radius = 0.41).scale(y = 0.4).move(y = 2)\n"
        "fn wax(tint: color) -> material = material(tint, roughness = 0.3)\n"
        "let total = alpha_of_the_first + beta_of_the_second * gamma_of_it\n"
    )
    assert formatted(text, 44) == (
        "let shown = [\n  (k = soft, tint = coral),\n  (k = metaball, tint = gold)\n]\n"
        "ball((-0.4, 0.62, 0), radius = 0.41)\n  .scale(y = 0.4)\n  .move(y = 2)\n"
        "fn wax(tint: color) -> material =\n  material(tint, roughness = 0.3)\n"
        "let total = alpha_of_the_first\n  + beta_of_the_second * gamma_of_it\n"
    )


def test_lines_keep_to_the_width_where_they_can() -> None:
    for path in scripts():
        for line in formatted(path.read_text(encoding="utf-8")).split("\n"):
            assert len(line.split("//")[0]) <= WIDTH or '"' in line, line


def test_a_script_with_mistakes_is_left_alone() -> None:
    out, diagnostics = format_source(Source("t.blob", "let a = (1\n"))
    assert out is None
    assert [d.code for d in diagnostics] == ["E0101"]
