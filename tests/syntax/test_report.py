"""How findings are shown and handed on: alignment, several files, colour, JSON, SARIF, fixes."""

from __future__ import annotations

import json
import re

import pytest

from blobscript.diagnostics import CODES, Diagnostic, Edit, Help, Label
from blobscript.fixes import apply_edits, fixable
from blobscript.report import render, render_all, sorted_by_place, summary, to_json, to_sarif
from blobscript.source import Source, Span


def span(source: Source, piece: str) -> Span:
    start = source.text.index(piece)
    return Span(source, start, start + len(piece))


def found(source: Source, piece: str, label: str = "here", **more) -> Diagnostic:
    return Diagnostic("E0103", "wrong", span(source, piece), label, **more)


def rows(diagnostic: Diagnostic) -> list[str]:
    return render(diagnostic).split("\n")[3:]


@pytest.mark.parametrize(
    ("text", "shown", "marks"),
    [
        ("let a = bad", "let a = bad", "        ^^^ here"),
        ("\tlet\ta = bad", "    let a = bad", "            ^^^ here"),
        ('"日本" bad', '"日本" bad', "       ^^^ here"),
        ('"é\u0301" bad', '"é\u0301" bad', "    ^^^ here"),
        ('"🙂" bad', '"🙂" bad', "     ^^^ here"),
        ('"\x07" bad', '"�" bad', "    ^^^ here"),
        ('"\u200b" bad', '"" bad', "   ^^^ here"),
    ],
    ids=["plain", "tabs", "wide", "combining", "emoji", "control", "invisible"],
)
def test_marks_stand_under_what_they_mean(text: str, shown: str, marks: str) -> None:
    assert rows(found(Source("t.blob", text), "bad"))[:2] == [f"1 | {shown}", f"  | {marks}"]


def test_wide_signs_are_marked_by_their_width() -> None:
    source = Source("t.blob", "a = 日本 ; b")
    assert rows(found(source, "日本"))[1] == "  |     ^^^^ here"


def test_a_long_line_is_cut_around_the_mark() -> None:
    source = Source("t.blob", "x " * 5000 + "bad " + "y " * 5000)
    line, marks = rows(found(source, "bad"))[:2]
    assert len(line) < 230
    assert line[marks.index("^") : marks.rindex("^") + 1] == "bad"
    assert line.startswith("1 | ...")
    assert line.endswith("...")


def test_a_span_of_several_lines_is_marked_on_its_first() -> None:
    source = Source("t.blob", "sum {\n  a\n}\n")
    assert rows(found(source, "sum {\n  a\n}"))[:3] == ["1 | sum {", "  | ^^^^^ here", "  |"]


def test_an_empty_place_at_the_end_has_a_mark() -> None:
    source = Source("t.blob", "let a =")
    diagnostic = Diagnostic("E0103", "wrong", Span(source, 7, 7), "here")
    assert rows(diagnostic)[:2] == ["1 | let a =", "  |        ^ here"]
    assert render(Diagnostic("E0103", "wrong", Span(Source("e.blob", ""), 0, 0), "here"))


def test_lines_between_marks() -> None:
    source = Source("t.blob", "one\ntwo\nthree\nfour\nfive\nsix\nseven\n" + "more\n" * 5)
    labels = (Label(span(source, "three"), "c"), Label(span(source, "seven"), "g"))
    shown = rows(found(source, "one", labels=labels))
    assert shown == [
        "1 | one", "  | ^^^ here", "2 | two", "3 | three", "  | ----- c", "...", "7 | seven", "  | ----- g", "  |",
        "  = more: blobscript explain E0103",
    ]  # fmt: skip


def test_labels_that_overlap_hang_below() -> None:
    source = Source("t.blob", "f(a, b)")
    labels = (Label(span(source, "a"), "inner"), Label(span(source, "f(a, b)"), "outer"))
    assert rows(found(source, "b", "primary", labels=labels))[:8] == [
        "1 | f(a, b)",
        "  | -----^-",
        "  | | |  |",
        "  | | |  primary",
        "  | | |",
        "  | | inner",
        "  | |",
        "  | outer",
    ]
    same = rows(found(source, "a", "primary", labels=(Label(span(source, "a"), "also"),)))
    assert same[1:4] == ["  |   ^ primary", "  |   |", "  |   also"]


def test_labels_in_other_files_follow_under_their_own_head() -> None:
    part = Source("part.blob", "fn f() = bad\n")
    main = Source("main.blob", "\n" * 11 + "f()\n")
    text = render(found(part, "bad", labels=(Label(span(main, "f()"), "called from here"),)))
    assert text.split("\n") == [
        "error[E0103]: wrong",
        "  --> part.blob:1:10",
        "   |",
        " 1 | fn f() = bad",
        "   |          ^^^ here",
        "  ::: main.blob:12:1",
        "   |",
        "12 | f()",
        "   | --- called from here",
        "   |",
        "   = more: blobscript explain E0103",
    ]


def test_without_a_place_the_path_is_named() -> None:
    text = render(Diagnostic("E0801", "cannot read x.blob: no such file", path="x.blob"))
    assert text.split("\n") == [
        "error[E0801]: cannot read x.blob: no such file",
        " --> x.blob",
        "  = more: blobscript explain E0801",
    ]


def edited(source: Source, *edits: Edit) -> list[str]:
    shown = rows(found(source, source.text.split()[0], helps=(Help("do", edits),)))
    return shown[shown.index("  = help: do") + 2 : -1]


def test_edits_show_what_changed() -> None:
    source = Source("t.blob", "one two three\nfour five\n")
    at = span(source, "three").end
    assert edited(source, Edit(Span(source, at, at), "!")) == ["1 | one two three!", "  |              +"]
    assert edited(source, Edit(span(source, "two"), "2")) == ["1 | one 2 three", "  |     ~"]
    assert edited(source, Edit(span(source, "two "), "")) == ["1 | one three", "  |     ~"]
    assert edited(source, Edit(Span(source, at, at), "\n  new")) == ["1 | one two three", "2 |   new", "  | +++++"]
    both = edited(source, Edit(span(source, "one"), "1"), Edit(span(source, "five"), "5"))
    assert both == ["1 | 1 two three", "  | ~", "2 | four 5", "  |      ~"]
    two = edited(source, Edit(Span(source, 0, 0), "("), Edit(Span(source, 3, 3), ")"))
    assert two == ["1 | (one) two three", "  | +   +"]


def test_colour_only_when_asked_and_only_around_the_same_text() -> None:
    source = Source("t.blob", "let a = bad worse")
    help_ = Help("write", (Edit(span(source, "bad"), "good"),), "safe")
    diagnostic = found(source, "bad", labels=(Label(span(source, "worse"), "x"),), helps=(help_,), notes=("n",))
    plain, bright = render(diagnostic), render(diagnostic, color=True)
    assert "\x1b" not in plain
    assert re.sub(r"\x1b\[[0-9;]*m", "", bright) == plain
    assert "\x1b[1;31m" in bright
    warning = Diagnostic("W0402", "unused", span(source, "a"))
    assert "\x1b[1;33m" in render(warning, color=True)


def test_sorted_by_file_and_place_with_a_summary() -> None:
    one, two = Source("1.blob", "aa bb cc"), Source("2.blob", "dd")
    mixed = [found(one, "cc"), found(two, "dd"), found(one, "aa"), Diagnostic("W0402", "w", span(one, "bb"))]
    assert [d.span.text for d in sorted_by_place(mixed) if d.span] == ["aa", "bb", "cc", "dd"]
    assert render_all(mixed).endswith("\n\n3 errors, 1 warning\n")
    assert render_all([]) == ""


@pytest.mark.parametrize(
    ("codes", "certainties", "text"),
    [
        (["E0101"], [], "1 error"),
        (["W0402", "W0402"], [], "2 warnings"),
        (["N0701"], [], "no errors"),
        (["E0101"], ["safe"], "1 error. 1 safe fix (check --fix)"),
        (["E0101"], ["guess", "guess", "safe", "safe", "example"],
         "1 error. 2 safe fixes (check --fix), 2 guesses to confirm (check --fix --ask)"),
    ],
)  # fmt: skip
def test_summary(codes: list[str], certainties: list, text: str) -> None:
    source = Source("t.blob", "a")
    helps = tuple(Help("h", (Edit(Span(source, 0, 1), "b"),), certainty) for certainty in certainties)
    helps += (Help("without an edit", (), "safe"),)
    diagnostics = [
        Diagnostic(code, "m", Span(source, 0, 1), helps=helps if not i else ()) for i, code in enumerate(codes)
    ]
    assert summary(diagnostics) == text


def example() -> Diagnostic:
    source = Source("dir/a b.blob", "let a = 1\nlet b = bad\n")
    return found(
        source, "bad", labels=(Label(span(source, "a"), "first"),), notes=("why",),
        helps=(Help("write", (Edit(span(source, "bad"), "good"),), "safe"), Help("or not")),
    )  # fmt: skip


def test_json() -> None:
    (one,) = json.loads(to_json([example()]))["diagnostics"]
    place = {"path": "dir/a b.blob", "line": 2, "column": 9, "end_line": 2, "end_column": 12}
    assert one == {
        "code": "E0103",
        "severity": "error",
        "message": "wrong",
        **place,
        "labels": [
            {"text": "here", **place},
            {"text": "first", "path": "dir/a b.blob", "line": 1, "column": 5, "end_line": 1, "end_column": 6},
        ],
        "help": [
            {"text": "write", "certainty": "safe", "edits": [{**place, "replacement": "good"}]},
            {"text": "or not", "certainty": None, "edits": []},
        ],
        "notes": ["why"],
    }
    (nowhere,) = json.loads(to_json([Diagnostic("E0801", "m", path="x.blob")]))["diagnostics"]
    assert (nowhere["path"], nowhere["line"]) == ("x.blob", None)
    assert json.loads(to_json([])) == {"diagnostics": []}


def test_sarif() -> None:
    log = json.loads(to_sarif([example(), Diagnostic("W0402", "w", path="/x.blob")], version="1.2.3"))
    assert log["version"] == "2.1.0"
    (run,) = log["runs"]
    driver = run["tool"]["driver"]
    assert (driver["name"], driver["semanticVersion"]) == ("blobscript", "1.2.3")
    assert [rule["id"] for rule in driver["rules"]] == list(CODES)
    error, warning = run["results"]
    assert (error["ruleId"], error["level"], warning["level"]) == ("E0103", "error", "warning")
    assert driver["rules"][error["ruleIndex"]]["id"] == "E0103"
    physical = error["locations"][0]["physicalLocation"]
    assert physical["artifactLocation"]["uri"] == "dir/a%20b.blob"
    region = {"startLine": 2, "startColumn": 9, "endLine": 2, "endColumn": 12}
    assert physical["region"] == region
    assert error["relatedLocations"][0]["message"]["text"] == "first"
    (change,) = error["fixes"][0]["artifactChanges"]
    assert change["replacements"] == [{"deletedRegion": region, "insertedContent": {"text": "good"}}]
    assert warning["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] == "file:///x.blob"


def test_edits_are_applied_once_and_only_the_wanted() -> None:
    source, other = Source("t.blob", "one two three"), Source("o.blob", "one")
    safe = Help("a", (Edit(span(source, "one"), "1"), Edit(span(source, "three"), "3")), "safe")
    guess = Help("b", (Edit(span(source, "two"), "2"),), "guess")
    clash = Help("c", (Edit(span(source, "one two"), "x"),), "safe")
    elsewhere = Help("d", (Edit(span(other, "one"), "x"),), "safe")
    mixed = Help("e", (Edit(span(source, "two"), "x"), Edit(span(other, "one"), "x")), "safe")
    diagnostic = found(source, "one", helps=(safe, guess, clash, elsewhere, mixed, Help("no edit")))
    assert [help_ for _, help_ in fixable(source, [diagnostic], "safe")] == [safe, clash]
    assert [help_ for _, help_ in fixable(source, [diagnostic], "guess")] == [guess]
    assert apply_edits(source, diagnostic.helps, "safe") == ("1 two 3", (safe,))
    assert apply_edits(source, diagnostic.helps) == ("1 2 3", (safe, guess))
    twice = (Help("f", (Edit(Span(source, 3, 3), ","),)), Help("g", (Edit(Span(source, 3, 3), ";"),)))
    assert apply_edits(source, twice).text == "one, two three"
