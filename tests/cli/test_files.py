"""Files that cannot be read or written: code, place, remedy and exit code, and never a traceback."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Blob

VERBS = [("check",), ("render", "-o", "x.png"), ("compile", "--to", "json"), ("info",), ("params",)]


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[0])
@pytest.mark.parametrize("bad", ["missing.blob", ".", "binary.blob", "latin.blob", "huge.blob", "no\0name.blob"])
def test_scene_that_cannot_be_read(blob: Blob, verb: tuple[str, ...], bad: str) -> None:
    Path("binary.blob").write_bytes(bytes(range(256)))
    Path("latin.blob").write_bytes("// caf\xe9".encode("latin-1"))
    if bad == "huge.blob":
        Path(bad).write_bytes(b"// long\n" * 1_310_720)
    result = blob(verb[0], bad, *verb[1:])
    assert result.code == 3
    assert "error[E0801]" in result.text
    assert bad.split("\0")[0] in result.text
    assert "Traceback" not in result.text
    assert not Path("x.png").exists()


def test_unreadable_scene_as_json(blob: Blob) -> None:
    result = blob("check", "missing.blob", "--format", "json")
    assert result.code == 3
    [found] = json.loads(result.out)["diagnostics"]
    assert (found["code"], found["path"], found["severity"]) == ("E0801", "missing.blob", "error")


@pytest.mark.parametrize("text", ["", "\n\n", "// nothing here\n", "blobscript 1\n", "\ufeff"])
def test_empty_script(blob: Blob, text: str) -> None:
    Path("empty.blob").write_text(text, encoding="utf-8")
    result = blob("render", "empty.blob", "-o", "x.png")
    assert result.code == 1
    assert "error[E0401]" in result.err
    assert re.search(r"--> empty\.blob:\d+:1$", result.err, re.MULTILINE)
    assert "help" in result.err
    assert not Path("x.png").exists()


NESTED = {
    "lists": "let a = " + "[" * 10_000 + "]" * 10_000,
    "groups": "let a = " + "(" * 10_000 + "1" + ")" * 10_000,
    "blocks": "sum {\n" * 10_000 + "}\n" * 10_000,
    "calls": "let a = " + "abs(" * 10_000 + "1" + ")" * 10_000,
    "minus": "let a = " + "-" * 10_000 + "1",
    "powers": "let a = " + "1 ^ " * 10_000 + "1",
    "ifs": "let a = " + "if (true) 1 else " * 10_000 + "1",
    "unclosed": "let a = " + "(" * 10_000,
    "texts": 'let a = "' + '{"' * 10_000,
}


@pytest.mark.parametrize("shape", NESTED)
def test_deeply_nested_script(blob: Blob, shape: str) -> None:
    Path("deep.blob").write_text(NESTED[shape] + "\n", encoding="utf-8")
    result = blob("check", "deep.blob")
    assert result.code == 1
    assert "error[E" in result.out
    assert "deep.blob:" in result.out
    assert "help" in result.out
    assert "Traceback" not in result.text


@pytest.mark.parametrize("count", [2_000])
def test_long_but_flat_script_is_fine(blob: Blob, count: int) -> None:
    lines = [f"  ball(({i % 50}, {i // 50}, 0), radius = 0.6)" for i in range(count)]
    Path("long.blob").write_text("\n".join(["surface {", *lines, "}"]), encoding="utf-8")
    assert blob("check", "long.blob").code == 0


def targets(tmp_path: Path) -> dict[str, tuple[Path, str]]:
    (tmp_path / "folder.png").mkdir()
    locked = tmp_path / "locked"
    locked.mkdir()
    locked.chmod(0o500)
    return {
        "folder": (tmp_path / "folder.png", "folder"),
        "no such folder": (tmp_path / "nowhere" / "x.png", "nowhere"),
        "below a file": (tmp_path / "hello.blob" / "x.png", "hello.blob"),
        "device": (Path("/dev/null/x.png"), "/dev/null"),
        "locked": (locked / "x.png", "locked"),
    }


@pytest.mark.parametrize("kind", ["folder", "no such folder", "below a file", "device", "locked"])
def test_picture_that_cannot_be_written(blob: Blob, tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if kind == "locked" and os.geteuid() == 0:  # root may write everywhere: say no in the system's place
        monkeypatch.setattr("blobscript.images.os.access", lambda path, mode: Path(path).name != "locked")
    path, said = targets(tmp_path)[kind]
    before = sorted(tmp_path.rglob("*"))
    result = blob("render", "hello.blob", "-o", path, "--size", "8x6")
    assert result.code == 3
    assert "error[E0802]" in result.err
    assert said in result.err
    assert "help" in result.err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("kind", ["folder", "no such folder", "below a file", "device"])
def test_text_that_cannot_be_written(blob: Blob, tmp_path: Path, kind: str) -> None:
    path, said = targets(tmp_path)[kind]
    before = sorted(tmp_path.rglob("*"))
    result = blob("compile", "hello.blob", "--to", "json", "-o", path)
    assert result.code == 3
    assert "error[E0802]" in result.err
    assert said in result.err
    assert sorted(tmp_path.rglob("*")) == before


def test_program_with_errors_leaves_an_old_picture_alone(blob: Blob) -> None:
    Path("bad.blob").write_text("surface { ball(radius = 0) }\n", encoding="utf-8")
    Path("old.png").write_bytes(b"old")
    assert blob("render", "bad.blob", "-o", "old.png").code == 1
    assert Path("old.png").read_bytes() == b"old"
    assert sorted(p.name for p in Path().iterdir()) == ["bad.blob", "hello.blob", "lamp.blob", "old.png"]
