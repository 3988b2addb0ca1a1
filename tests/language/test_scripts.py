"""Scripts that carry what they expect: `// expect: E0304` beside the line, or with `line 4` anywhere.

`says` followed by a piece of the message (or label, help or note) can stand behind it. What is not
expected must not be said: a script without expectations is fine.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from language.compiling import run

from blobscript.diagnostics import Diagnostic

HERE = Path(__file__).parent / "scripts"
SCRIPTS = sorted(path for path in HERE.rglob("*.blob") if path.parent.name != "parts")
EXPECT = re.compile(r"// expect: (?:error |warning |note )?([EWN]\d{4})(?: line (\d+))?(?: says (.+))?$")


def expectations(text: str) -> list[tuple[str, int, str]]:
    found: list[tuple[str, int, str]] = []
    for number, line in enumerate(text.splitlines(), 1):
        match = EXPECT.search(line)
        assert ("// expect" in line) == bool(match), f"line {number}: not understood"
        if match:
            found.append((match[1], int(match[2] or number), match[3] or ""))
    return sorted(found)


def everything(diagnostic: Diagnostic) -> str:
    labels = [label.text for label in diagnostic.labels]
    helps = [help_.text for help_ in diagnostic.helps]
    return "\n".join([diagnostic.message, diagnostic.label, *labels, *helps, *diagnostic.notes])


@pytest.mark.parametrize("path", SCRIPTS, ids=[str(path.relative_to(HERE).with_suffix("")) for path in SCRIPTS])
def test_script(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    expected = expectations(text)
    _, found = run(text, name=path.name, folder=path.parent)
    said = sorted((d.code, d.line, everything(d)) for d in found)
    assert [(code, line) for code, line, _ in said] == [(code, line) for code, line, _ in expected], said
    for (code, line, piece), (_, _, whole) in zip(expected, said, strict=True):
        assert piece in whole, f"{code} in line {line} says\n{whole}"


def test_there_are_scripts() -> None:
    assert len(SCRIPTS) > 60
