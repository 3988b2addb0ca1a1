"""`blobscript fmt` on files and standard input."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Blob

UGLY = "surface(threshold=0.5){// one\nball((0,0,0),radius=1)\n}\n"
BAD = "surface {\n  ball((0, 0, 0)\n"


def test_in_place_and_idempotent(blob: Blob) -> None:
    Path("a.blob").write_text(UGLY, encoding="utf-8")
    assert blob("fmt", "a.blob").code == 0
    once = Path("a.blob").read_text(encoding="utf-8")
    assert "threshold = 0.5" in once
    assert "// one" in once
    stamp = Path("a.blob").stat().st_mtime_ns
    assert blob("fmt", "a.blob").code == 0
    assert Path("a.blob").stat().st_mtime_ns == stamp


def test_check_changes_nothing(blob: Blob) -> None:
    Path("a.blob").write_text(UGLY, encoding="utf-8")
    result = blob("fmt", "--check", "a.blob", "hello.blob")
    assert result.code == 1
    assert result.err == "a.blob would change\n"
    assert Path("a.blob").read_text(encoding="utf-8") == UGLY
    assert blob("fmt", "--check", "hello.blob").code == 0


def test_diff(blob: Blob) -> None:
    Path("a.blob").write_text(UGLY, encoding="utf-8")
    result = blob("fmt", "--diff", "a.blob")
    assert result.code == 0
    assert "--- a.blob" in result.out
    assert "-ball((0,0,0),radius=1)" in result.out
    assert "+  ball((0, 0, 0), radius = 1)" in result.out
    assert Path("a.blob").read_text(encoding="utf-8") == UGLY


def test_standard_input(blob: Blob, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(UGLY))
    result = blob("fmt", "-")
    assert result.code == 0
    assert "ball((0, 0, 0), radius = 1)" in result.out


def test_a_file_with_errors_is_left_alone_and_the_others_are_formatted(blob: Blob) -> None:
    Path("bad.blob").write_text(BAD, encoding="utf-8")
    Path("a.blob").write_text(UGLY, encoding="utf-8")
    result = blob("fmt", "bad.blob", "a.blob")
    assert result.code == 1
    assert "error[E0101]" in result.err
    assert Path("bad.blob").read_text(encoding="utf-8") == BAD
    assert Path("a.blob").read_text(encoding="utf-8") != UGLY


def test_missing_file(blob: Blob) -> None:
    result = blob("fmt", "nowhere.blob")
    assert result.code == 3
    assert "E0801" in result.err
