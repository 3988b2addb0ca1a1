"""compile, explain, doctor, the progress report, and how the command starts."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from blobscript.cli.progress import Progress
from blobscript.diagnostics import CODES

if TYPE_CHECKING:
    from conftest import Blob


def test_compile_to_json(blob: Blob) -> None:
    result = blob("compile", "hello.blob", "--to", "json")
    assert result.code == 0
    scene = json.loads(result.out)
    [surface] = scene["surfaces"]
    assert surface["threshold"] == 0.5
    leaf = surface["field"]
    assert leaf["kind"] == "leaf"
    assert leaf["skeleton"] == {"kind": "points", "at": [[-1.2, 0.0, 0.0], [1.2, 0.0, 0.0]]}
    assert leaf["reach"] == [2.0, 2.0]
    assert blob("compile", "hello.blob", "--to", "json", "-o", "x.json").out == ""
    assert Path("x.json").read_text(encoding="utf-8") == result.out


def test_explain(blob: Blob) -> None:
    result = blob("explain", "E0301")
    assert result.code == 0
    assert "E0301" in result.out
    assert blob("explain", "e0301").out == result.out
    listed = blob("explain").out
    assert [code for code in CODES if code not in listed] == []
    assert "random" in listed
    assert blob("explain", "random").out.startswith("# Random numbers")
    wrong = blob("explain", "E0399")
    assert wrong.code == 2
    assert "E0301" in wrong.err


def test_doctor(blob: Blob) -> None:
    result = blob("doctor")
    assert result.code == 0, result.text
    assert "tracer" in result.out
    rows = json.loads(blob("doctor", "--format", "json").out)["findings"]
    found = {row["name"]: row for row in rows}
    assert found["numpy"]["found"]
    assert found["tracer"]["found"]
    assert found["povray"]["needed"] is False


def test_doctor_without_a_library(blob: Blob, monkeypatch: pytest.MonkeyPatch) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "blobscript", "doctor"],
        env={"BLOBSCRIPT_LIBRARY": "/nowhere/libblob.so"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 3
    assert "MISSING  tracer" in done.stdout
    assert "/nowhere/libblob.so" in done.stdout


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    stream = Terminal()
    progress = Progress("rendering", stream)
    for done in range(1, 11):
        now[0] += 7.0
        progress(done, 10)
    assert "rendering ███" in stream.getvalue()
    assert " 20%, 0:56 left" in stream.getvalue()
    assert progress.finish() == 70.0
    assert stream.getvalue().endswith("\r\x1b[K")


def test_progress_in_a_log(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    stream = io.StringIO()
    progress = Progress("rendering", stream)
    for done in range(1, 101):
        now[0] += 60.0 if done == 50 else 0.125
        progress(done, 100)
    progress.finish()
    assert stream.getvalue() == "rendering: 40%, 0:08 left\nrendering: 50%, 1:06 left\nrendering: 90%, 0:08 left\n"


def test_a_quick_job_says_nothing() -> None:
    stream = io.StringIO()
    progress = Progress("rendering", stream)
    progress(1, 2)
    progress(2, 2)
    progress.finish()
    assert stream.getvalue() == ""


HEAVY = ("OpenImageIO", "trimesh", "matplotlib", "lark", "scipy")


@pytest.mark.parametrize("argv", [("check", "hello.blob"), ("explain",), ("params", "hello.blob")])
def test_quick_verbs_load_nothing_heavy(blob: Blob, argv: tuple[str, ...]) -> None:
    """Start-up is what `check` in an editor costs: numpy is the only large import."""
    blob("check", "hello.blob")  # the parser's tables are there from now on
    program = (
        "import sys; from blobscript.cli import main; main(sys.argv[1:]); "
        f"print([m for m in {HEAVY} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program, *argv], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_import_is_quick() -> None:
    program = "import sys, blobscript; print([m for m in ('numpy', 'argparse', 'lark') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_closed_pipe_is_no_error(blob: Blob) -> None:
    done = subprocess.run(
        f"{sys.executable} -m blobscript.cli explain | head -1", shell=True, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    assert done.stdout.startswith("E0101")
