"""`blobscript check`: reports, formats and fixes."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Blob

TWO_MISTAKES = """\
surface(material = clay(corral)) {
  ball((0, 0, 0), radius = 1).rotate(y = 35)
}
"""


def test_a_right_script(blob: Blob) -> None:
    result = blob("check", "hello.blob")
    assert (result.code, result.out, result.err) == (0, "", "hello.blob: no errors\n")
    as_json = blob("check", "hello.blob", "--format", "json")
    assert json.loads(as_json.out) == {"diagnostics": []}
    assert as_json.err == ""


def test_all_mistakes_in_order_of_place(blob: Blob) -> None:
    Path("bad.blob").write_text(TWO_MISTAKES, encoding="utf-8")
    result = blob("check", "bad.blob")
    assert result.code == 1
    assert result.out.index("error[E0201]") < result.out.index("error[E0301]")
    assert " --> bad.blob:1:25" in result.out
    assert " --> bad.blob:2:42" in result.out
    assert "35deg" in result.out
    assert result.out.rstrip().splitlines()[-1].startswith("2 errors")


def test_json_has_the_documented_keys(blob: Blob) -> None:
    Path("bad.blob").write_text(TWO_MISTAKES, encoding="utf-8")
    found = json.loads(blob("check", "bad.blob", "--format", "json").out)["diagnostics"]
    assert [d["code"] for d in found] == ["E0201", "E0301"]
    for d in found:
        assert {"code", "severity", "message", "path", "line", "column", "end_line", "end_column"} <= d.keys()
        assert {"labels", "help", "notes"} <= d.keys()
    assert (found[1]["line"], found[1]["column"], found[1]["end_column"]) == (2, 42, 44)


def test_sarif(blob: Blob) -> None:
    Path("bad.blob").write_text(TWO_MISTAKES, encoding="utf-8")
    log = json.loads(blob("check", "bad.blob", "--format", "sarif").out)
    assert log["version"] == "2.1.0"
    assert [result["ruleId"] for result in log["runs"][0]["results"]] == ["E0201", "E0301"]


def test_a_warning_is_no_error(blob: Blob) -> None:
    Path("odd.blob").write_text("surface { ball(radius = 1) }\nlet spare = surface { ball(radius = 2) }\n", "utf-8")
    result = blob("check", "odd.blob")
    assert result.code == 0
    assert "warning[W0402]" in result.out


def test_a_module_needs_no_surface(blob: Blob) -> None:
    Path("parts.blob").write_text("fn f(x: number) -> field = ball(radius = x)\n", encoding="utf-8")
    assert blob("check", "parts.blob").code == 0
    Path("parts.blob").write_text("fn f(x: number) -> field = ball(radius = y)\n", encoding="utf-8")
    assert blob("check", "parts.blob").code == 1
    assert blob("render", "parts.blob", "-o", "x.png").code == 1


def test_standard_input(blob: Blob, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("surface { ball(radius = 35deg) }"))
    result = blob("check", "-")
    assert result.code == 1
    assert "<stdin>:1:25" in result.out
    assert blob("check", "-", "--fix").code == 2


def test_fix_applies_only_what_is_safe(blob: Blob) -> None:
    """`,` between the items of a block is a safe fix; a name that is merely close is a guess."""
    Path("bad.blob").write_text("surface {\n  ball(radius = 1),\n  ball((1, 0, 0), radius = 1)\n}\n", encoding="utf-8")
    result = blob("check", "bad.blob", "--fix")
    assert result.code == 0, result.text
    assert "applied 1 fix" in result.err
    assert Path("bad.blob").read_text(encoding="utf-8") == (
        "surface {\n  ball(radius = 1)\n  ball((1, 0, 0), radius = 1)\n}\n"
    )
    Path("bad.blob").write_text(TWO_MISTAKES, encoding="utf-8")
    assert blob("check", "bad.blob", "--fix").code == 1
    assert "corral" in Path("bad.blob").read_text(encoding="utf-8")


def test_fix_and_ask(blob: Blob, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("bad.blob").write_text(TWO_MISTAKES, encoding="utf-8")
    monkeypatch.setattr("sys.stdin", io.StringIO("n\n"))
    assert blob("check", "bad.blob", "--fix", "--ask").code == 1
    assert "corral" in Path("bad.blob").read_text(encoding="utf-8")
    monkeypatch.setattr("sys.stdin", io.StringIO("y\ny\n"))
    result = blob("check", "bad.blob", "--fix", "--ask")
    assert result.code == 0, result.text
    text = Path("bad.blob").read_text(encoding="utf-8")
    assert "clay(coral)" in text
    assert "35deg" in text


def test_fix_leaves_a_right_file_untouched(blob: Blob) -> None:
    before = Path("hello.blob").stat()
    assert blob("check", "hello.blob", "--fix").code == 0
    assert Path("hello.blob").stat().st_mtime_ns == before.st_mtime_ns


def test_budget(blob: Blob) -> None:
    Path("far.blob").write_text(
        "fn f(n: int) -> int = if (n == 0) 0 else f(n - 1)\nsurface { ball(radius = 1 + f(900)) }\n", encoding="utf-8"
    )
    assert blob("check", "far.blob").code == 0
    result = blob("check", "far.blob", "--budget", "100")
    assert result.code == 1
    assert "error[E0901]" in result.out
    assert "--budget" in result.out
