"""`blobscript report`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Blob = Callable[..., Any]


@pytest.mark.parametrize(
    ("argv", "code", "told"),
    [
        (("report", "hello.blob"), 2, "-o"),
        (("report", "hello.blob", "-o", "r.pdf"), 2, "E0803"),
        (("report", "nothing.blob", "-o", "r.html"), 3, "E0801"),
        (("report", "hello.blob", "-o", "r.html", "--seed", "x"), 2, "whole number"),
    ],
)
def test_what_cannot_be_is_refused(blob: Blob, argv: tuple[str, ...], code: int, told: str) -> None:
    done = blob(*argv)
    assert done.code == code, done.text
    assert told in done.err


def test_a_report_is_written_and_summed_up(blob: Blob, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("blobscript.reporting.content._QUICK_RAYS", (300, 60))
    monkeypatch.setattr("blobscript.reporting.content.measure_povray", lambda *_: None)
    done = blob("report", "hello.blob", "-o", "r.json", "--quick", "--threads", "1", "--seed", "7")
    assert done.code == 0, done.text
    assert done.out.startswith("Take ")
    facts = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    assert facts["header"]["seed"] == 7
    assert facts["header"]["script"] == "hello.blob"


def test_bench_measures_many_and_says_what_it_leaves_out(
    blob: Blob, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("blobscript.reporting.bench._QUICK_RAYS", (200, 50))
    monkeypatch.setattr("blobscript.reporting.bench.measure_povray", lambda *_, **__: None)
    (tmp_path / "broken.blob").write_text("surface { bll(radius = 1) }", encoding="utf-8")
    done = blob("bench", "hello.blob", "broken.blob", "--quick", "--threads", "1")
    assert done.code == 1
    assert "| hello |" in done.out
    assert "The default search makes no mistake on 2" in done.out
    assert "broken.blob is left out" in done.err
    done = blob("bench", "-o", "b.html", "hello.blob", "--quick", "--threads", "1")
    assert done.code == 0, done.text
    assert (tmp_path / "b.html").read_text(encoding="utf-8").count("<img") == 1
    done = blob("bench", "hello.blob", "-o", "b.json", "--quick", "--threads", "1")
    facts = json.loads((tmp_path / "b.json").read_text(encoding="utf-8"))
    assert facts["scenes"][0]["default"]["picture"]["missed"] == 0
    assert facts["scenes"][0]["meshes"]["ours"]["open_edges"] == 0
    assert blob("bench", "-o", "b.pdf").code == 2
