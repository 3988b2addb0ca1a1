"""Input that nobody would write: never a traceback, never silence where something is wrong, never long."""

from __future__ import annotations

import gc
import random
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from syntax.mutations import OTHERS
from syntax.scripts import fits, spans

from blobscript.diagnostics import Diagnostic
from blobscript.files import MAX_SIZE, read_source
from blobscript.machine import MAX_NESTING
from blobscript.parse import parse
from blobscript.report import render_all, to_json, to_sarif
from blobscript.source import Source
from blobscript.strays import diagnose

DEEP = 10_000


def survive(text: str) -> list[Diagnostic]:
    """Parse and report in every form; all places lie in the text."""
    source = Source("t.blob", text)
    script, diagnostics = parse(source)
    render_all(diagnostics, color=True)
    to_json(diagnostics)
    to_sarif(diagnostics)
    assert all(d.span is not None and 0 <= d.span.start <= d.span.end <= len(text) for d in diagnostics)
    assert script.source is source
    return diagnostics


@pytest.mark.parametrize(
    "text",
    [
        "let x = " + "(" * DEEP + "1" + ")" * DEEP,
        "let x = " + "[" * DEEP + "1" + "]" * DEEP,
        "sum {\n" * DEEP + "}\n" * DEEP,
        "let x = " + "-" * DEEP + "1",
        "let x = " + "not " * DEEP + "true",
        "let x = " + "1 + " * DEEP + "1",
        "let x = " + "2 ^ " * DEEP + "1",
        "let x = a" + ".b" * DEEP,
        "let x = a" + "()" * DEEP,
        "let x = " + "f(" * DEEP + ")" * DEEP,
        "if (a) { b }" + " else if (a) { b }" * DEEP,
        "let x = " + "if (a) 1 else " * DEEP + "1",
        "let x = " + "fn(a) = " * DEEP + "1",
        "type x = " + "[" * DEEP + "int" + "]" * DEEP,
        "let x = [" + "for (a in b) " * DEEP + "1]",
    ],
    ids=lambda text: text[8:24].replace("\n", " "),
)
def test_nested_ten_thousand_deep(text: str) -> None:
    diagnostics = survive(text)
    assert "E0901" in [d.code for d in diagnostics]
    assert depth(parse(Source("t.blob", text))[0]) < 4 * MAX_NESTING


def depth(script: object) -> int:
    """Levels of tuples and nodes, counted without recursion."""
    import dataclasses

    deepest, todo = 0, [(script, 0)]
    while todo:
        node, level = todo.pop()
        deepest = max(deepest, level)
        if isinstance(node, tuple):
            todo += [(item, level) for item in node]
        elif dataclasses.is_dataclass(node) and not isinstance(node, Source):
            names = [f.name for f in dataclasses.fields(node) if "span" not in f.name]
            todo += [(getattr(node, name), level + 1) for name in names]
    return deepest


@pytest.mark.parametrize("text", ["(" * DEEP, "{" * DEEP, "[" * DEEP, ")" * DEEP, "}\n" * DEEP, "sum {\n" * DEEP])
def test_ten_thousand_brackets_without_partner(text: str) -> None:
    assert {d.code for d in survive(text)} <= {"E0101", "E0102", "E0901"}


def test_as_deep_as_people_write_is_fine() -> None:
    assert not survive("let x = " + "(" * 100 + "1" + ")" * 100)
    assert not survive("let x = " + " + ".join(["1"] * 200))
    assert not survive("sum {\n" * 60 + "a\n" + "}\n" * 60)


ODD = {
    "quotes": '"',
    "escaped quotes": '\\"',
    "line ends": "\n",
    "hashes": "#",
    "commas": ",",
    "semicolons": ";",
    "openers": "(",
    "opener lines": "{\n",
    "closers": ")",
    "closer lines": "}\n",
    "null bytes": "\0",
    "digits": "1",
    "words": "a ",
    "reserved words": "let ",
    "bad definitions": "let = 1\n",
    "missing commas": "f(1 2)\n",
    "colours": "#ff ",
    "dots": ".",
    "texts with holes": '"{" ',
    "blanks": "\u00a0",
}


@pytest.mark.parametrize("piece", ODD.values(), ids=ODD.keys())
def test_a_long_run_of_one_thing(piece: str) -> None:
    before = time.process_time()
    survive(piece * (100_000 // len(piece)))
    assert time.process_time() - before < 10


def test_too_long_is_refused_at_once() -> None:
    before = time.process_time()
    assert [d.code for d in survive("a\n" * 5_000_000)] == ["E0801"]
    assert time.process_time() - before < 5


def test_too_many_words_are_refused() -> None:
    assert [d.code for d in survive("+ " * 1_300_000)] == ["E0801"]


def test_read_source(tmp_path) -> None:
    good = tmp_path / "a.blob"
    good.write_bytes(b"\xef\xbb\xbflet a = 1\r\n")
    source = read_source(good)
    assert isinstance(source, Source)
    assert (source.text, source.folder, source.path) == ("let a = 1\r\n", str(tmp_path), str(good))

    (tmp_path / "binary.blob").write_bytes(b"\x89PNG\0\0")
    (tmp_path / "latin.blob").write_bytes(b"let a = 1\nlet b = \xe4\n")
    (tmp_path / "long.blob").write_bytes(b"a" * (MAX_SIZE + 1))
    (tmp_path / "folder.blob").mkdir()
    for name, words in {
        "missing.blob": "no such file",
        "binary.blob": "not a text",
        "latin.blob": "not UTF-8 (line 2)",
        "long.blob": "larger than",
        "folder.blob": "is a directory",
        "nul\0.blob": "null",
    }.items():
        found = read_source(f"{tmp_path}/{name}")
        assert isinstance(found, Diagnostic)
        assert found.code == "E0801"
        assert words in found.message
        assert found.path == f"{tmp_path}/{name}"
        assert found.message in render_all([found])


# ---- fuzzing: a hundredth of a campaign -----------------------------------------------------------

WORDS = [
    *OTHERS,
    "\n",
    "\n  ",
    " ",
    "// c\n",
    "/// d\n",
    "ball",
    "sum {",
    "surface(",
    "import",
    "type",
    "kernel",
    "param",
]
WORDS += [
    "return",
    "assert",
    "debug",
    "from",
    "as",
    "step",
    "or",
    "not",
    "..<",
    "^",
    "/",
    "<",
    "blobscript 1\n",
    '"{',
    '}"',
]


def test_bytes() -> None:
    pick = random.Random(7)
    for _ in range(100):
        data = bytes(pick.randrange(256) for _ in range(pick.randrange(200)))
        survive(data.decode("latin-1"))
        survive(data.decode("utf-8", errors="replace"))


def test_words_in_any_order() -> None:
    pick = random.Random(11)
    for _ in range(400):
        text = " ".join(pick.choices(WORDS, k=pick.randrange(1, 40)))
        assert bool(survive(text)) or fits(text), text


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.text())
def test_any_text(text: str) -> None:
    survive(text)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.lists(st.sampled_from(WORDS), max_size=30))
def test_any_words(words: list[str]) -> None:
    text = "".join(words)
    assert bool(survive(text)) or fits(text)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.text(min_size=1, max_size=20))
def test_a_stray_sign_is_always_taken(text: str) -> None:
    """The lexer goes on behind every sign that means nothing."""
    stray = diagnose(Source("t.blob", text), 0, len(text), True)
    assert stray.end > 0


def test_spans_of_broken_scripts_lie_in_the_text() -> None:
    pick = random.Random(13)
    for _ in range(200):
        text = " ".join(pick.choices(WORDS, k=20))
        script, _ = parse(Source("t.blob", text))
        assert all(0 <= span.start <= span.end <= len(text) for span in spans(script))


def test_what_was_read_counts_as_old():
    """The collector does not look through a whole tree as soon as it may: an interruption would wait for that."""
    script = "surface {\n" + "  ball((0, 0, 0), radius = 1)\n" * 3000 + "}\n"
    gc.collect()
    tree = parse(Source("long.blob", script, None))
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0
    assert len(gc.get_objects(generation=0)) + len(gc.get_objects(generation=1)) < 3000
    assert tree
