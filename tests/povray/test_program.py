"""Running POV-Ray: it is stopped for sure, cleaned up after, and explained where it is missing or fails."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from blobscript.cli import main
from blobscript.povray.program import FailedError, find, version, workshop

OPTIONS = ("+Oo.png", "+W4", "+H4", "-D", "-A")


def test_a_run_that_hangs_is_killed_and_cleaned_up() -> None:
    start = time.monotonic()
    with workshop() as shop:
        folder = shop.folder
        with pytest.raises(FailedError, match=r"stopped after 1\.5 seconds") as caught:
            shop.run("#while(1) #end\n", OPTIONS, 1.5)
    assert time.monotonic() - start < 8
    assert not folder.exists()
    assert [d.code for d in caught.value.diagnostics] == ["E1003"]
    assert not _running(folder)


def _running(folder: Path) -> list[str]:
    """Processes whose working directory is the folder, a moment later: the dead take some time to go."""
    end = time.monotonic() + 3
    while (found := _at_work_in(folder)) and time.monotonic() < end:
        time.sleep(0.05)
    return found


def _at_work_in(folder: Path) -> list[str]:
    found = []
    for process in Path("/proc").glob("[0-9]*/cwd"):
        try:
            if os.readlink(process).startswith(str(folder)):
                found.append(process.parent.name)
        except OSError:
            continue
    return found


def test_what_does_not_listen_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that ignores SIGTERM stands for POV-Ray while it reads some texts."""
    stubborn = tmp_path / "povray"
    stubborn.write_text('#!/bin/sh\ntrap "" TERM INT\nwhile :; do sleep 0.1; done\n', encoding="utf-8")
    stubborn.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    with workshop() as shop:
        with pytest.raises(FailedError, match="stopped"):
            shop.run("", OPTIONS, 0.3)
        assert not _running(shop.folder)


def test_an_error_names_the_line_of_the_script() -> None:
    text = "#version 3.7;\n// ---- surface 1 (hello.blob:7)\nblob { threshold 0.5\n  // hello.blob:9\n  nonsense\n}\n"
    with workshop() as shop, pytest.raises(FailedError, match=r"made from hello\.blob:9"):
        shop.run(text, OPTIONS, 30)


def test_where_povray_is_missing_it_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "a.blob"
    script.write_text("surface { ball(radius = 1) }", encoding="utf-8")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["compare", str(script), "-o", str(tmp_path / "r.html")]) == 3
    told = capsys.readouterr().err
    assert "E1004" in told
    assert "apt-get install povray" in told
    assert not (tmp_path / "r.html").exists()


def test_a_program_that_cannot_run_is_no_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "povray").write_bytes(b"\x7fELF but not really")
    (tmp_path / "povray").chmod(0o755)
    script = tmp_path / "a.blob"
    script.write_text("surface { ball(radius = 1) }", encoding="utf-8")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["compare", str(script), "-o", str(tmp_path / "r.html")]) == 4
    assert "E1003" in capsys.readouterr().err


def test_it_says_which_it_is() -> None:
    assert find()
    assert version().startswith("3.")
