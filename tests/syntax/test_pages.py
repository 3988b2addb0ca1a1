"""Every code has a page, and the examples on the pages do what the pages say."""

from __future__ import annotations

from pathlib import Path

import pytest

from blobscript import explain
from blobscript.diagnostics import CODES, Diagnostic, has_errors
from blobscript.driver import compile_source
from blobscript.setting import Setting
from blobscript.source import Source


def test_every_code_has_a_page_and_every_page_a_code() -> None:
    pages = {path.stem for path in (Path(explain.__file__).parent / "pages").glob("*.md")}
    assert pages == {*CODES, *explain.TOPICS}
    with pytest.raises(KeyError):
        explain.page("E9999")


@pytest.mark.parametrize("code", CODES)
def test_a_page_has_title_failure_reason_and_fix(code: str) -> None:
    text = explain.page(code)
    assert text.startswith(f"# {code}: {CODES[code]}\n")
    shown = [fence for fence in explain.fences(text) if fence.language != "file"]
    assert [fence.fixed for fence in shown] == [False, True]
    reason = text.split("```")[-3]
    assert len(reason.split()) > 8
    assert max(len(line) for line in text.split("\n")) <= 132


def compiled(fence: explain.Fence, folder: Path) -> list[Diagnostic]:
    words = iter(fence.words)
    params = {}
    for word in words:
        if word == "--set":
            name, value = next(words).split("=")
            params[name] = Setting(value)
    return compile_source(Source("scene.blob", fence.text, str(folder)), params)[1]


@pytest.mark.parametrize("code", [code for code in CODES if code != "E0802" and code[1:3] not in ("10", "11")])
def test_examples(code: str, tmp_path: Path) -> None:
    examples = explain.fences(explain.page(code))
    for fence in examples:
        if fence.language == "file":
            (tmp_path / fence.words[0]).write_text(fence.text, encoding="utf-8")
    bad, good = (compiled(fence, tmp_path) for fence in examples if fence.language == "blob")
    assert {d.code for d in bad} == {code}, [f"{d.code} {d.message}" for d in bad]
    assert not has_errors(good), [f"{d.code} {d.message}" for d in good]
    assert code not in {d.code for d in good}


def test_the_commands_of_e0802(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    from blobscript.cli import main

    monkeypatch.chdir(tmp_path)
    Path("scene.blob").write_text("surface { ball(radius = 1) }\n", encoding="utf-8")
    bad, good = (fence.text.split()[2:] for fence in explain.fences(explain.page("E0802")))
    assert main(bad) == 3
    assert "error[E0802]" in capsys.readouterr().err
    assert main(good) == 0
    assert Path("picture.png").exists()
