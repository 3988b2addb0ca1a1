"""The README's commands, snippets and links."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import blobscript

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def test_ci_runs_the_test_command_of_the_readme() -> None:
    _, test_command = blocks("sh")[:2]
    assert test_command.count("\n") == 1
    assert test_command in (ROOT / ".ci/run").read_text(encoding="utf-8")


def test_picture_command_renders_an_example_that_exists() -> None:
    picture_command = blocks("sh")[0]
    found = re.search(r"blobscript render (\S+\.blob) -o \S+", picture_command)
    assert found
    assert (ROOT / found[1]).is_file()


def test_links_and_pictures_exist() -> None:
    targets = re.findall(r"\]\(([^)#]+)\)|src=\"([^\"]+)\"", README)
    missing = [a or b for a, b in targets if not (a or b).startswith("http") and not (ROOT / (a or b)).exists()]
    assert missing == []


@pytest.mark.parametrize("number", range(len(blocks("blob"))))
def test_snippets_compile_without_a_warning(number: int) -> None:
    scene = blobscript.compile(blocks("blob")[number], name=f"README snippet {number}")
    assert scene.surfaces
    assert [d.message for d in scene.diagnostics] == []


def test_python_snippet_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(blocks("python")[0], names)
    hits = names["hits"]
    assert (hits.t[0], *hits.normal[0]) == (4.0, 0.0, 0.0, 1.0)  # type: ignore[attr-defined]
    assert (tmp_path / "ball.exr").stat().st_size > 0


def test_every_example_is_named() -> None:
    scripts = {path.name for path in (ROOT / "examples").glob("*.blob")}
    assert {name for name in scripts if f"examples/{name}" not in README} == set()


def test_every_verb_is_named() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "blobscript.cli", "--help"], capture_output=True, text=True, check=True
    )
    verbs = re.findall(r"^    ([a-z-]+) ", result.stdout, re.MULTILINE)
    assert len(verbs) >= 8
    assert [verb for verb in verbs if f"blobscript {verb}" not in README] == []
