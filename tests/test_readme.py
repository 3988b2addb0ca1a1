"""The README's commands, snippets and links."""

from __future__ import annotations

import re
from pathlib import Path

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
