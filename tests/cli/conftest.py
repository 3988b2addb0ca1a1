"""Runs the command in this process: `blob("check", "a.blob")` gives code, out and err."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from blobscript.cli import main

HELLO = """\
blobscript 1

surface(threshold = 0.5, material = clay(coral)) {
  ball((-1.2, 0, 0), radius = 1)
  ball((1.2, 0, 0), radius = 1)
}
"""

LAMP = """\
/// How many drops.
@group("Lamp")
param drops = 3 in 1..20
param size = 0.3 in 0.1..1.0 step 0.1
param lean = 10deg in -45deg..45deg
param skin = "clay" in ["clay", "jelly"]
param on = true
param tint = coral
surface(material = if (skin == "clay") clay(tint) else jelly(tint)) {
  for (i in 0..<drops) {
    ball((i, 0, 0), radius = size).rotate(z = lean)
  }
}
"""


@dataclass(frozen=True)
class Result:
    code: int
    out: str
    err: str

    @property
    def text(self) -> str:
        return self.out + self.err


Blob = Callable[..., Result]


@pytest.fixture
def blob(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Blob:
    """Runs in a folder of its own, where `hello.blob` and `lamp.blob` are."""
    monkeypatch.chdir(tmp_path)
    Path("hello.blob").write_text(HELLO, encoding="utf-8")
    Path("lamp.blob").write_text(LAMP, encoding="utf-8")

    def run(*argv: str | os.PathLike[str]) -> Result:
        capsys.readouterr()
        try:
            code = main([os.fspath(arg) for arg in argv])
        except SystemExit as end:  # argparse: --help and --version
            code = int(end.code or 0)
        out, err = capsys.readouterr()
        return Result(code, out, err)

    return run
