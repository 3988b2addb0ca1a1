"""Ctrl-C is heard wherever it comes."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest

from blobscript.interruption import held, import_whole


def test_an_import_that_swallows_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As trimesh does, which tries what is installed and takes every exception for a no."""
    press = "try:\n    os.kill(os.getpid(), signal.SIGINT)\nexcept BaseException:\n    pass\n"
    text = f"import os, signal\n{press}whole = True\n"
    (tmp_path / "greedy_package.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        import_whole("greedy_package")
    assert signal.getsignal(signal.SIGINT) is before
    assert sys.modules.pop("greedy_package").whole


def test_held_until_the_end() -> None:
    done = []

    def pressed() -> None:
        with held():
            os.kill(os.getpid(), signal.SIGINT)
            done.append(True)

    with pytest.raises(KeyboardInterrupt):
        pressed()
    assert done == [True]
