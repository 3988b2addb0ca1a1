"""`blobscript plot` and `blobscript why`."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Blob = Callable[..., Any]


def test_plot_writes_svg_and_png(blob: Blob, tmp_path: Path) -> None:
    done = blob("plot", "kernel", "soft3", "gauss(a = 4)", "shoulder(k = 3)", "-o", "k.svg")
    assert done.code == 0, done.text
    ET.parse(tmp_path / "k.svg")
    assert blob("plot", "slice", "hello.blob", "-o", "s.png").code == 0
    assert (tmp_path / "s.png").read_bytes().startswith(b"\x89PNG")
    assert blob("plot", "ray", "-o", "r.png", "hello.blob", "--pixel", "320,240").code == 0
    assert blob("plot", "ray", "hello.blob", "-o", "q.png", "--from", "9,9,9", "--toward", "1,0,0").code == 0


@pytest.mark.parametrize(
    ("argv", "code", "told"),
    [
        (("plot", "kernel", "-o", "k.svg"), 2, "which kernels"),
        (("plot", "kernel", "sift3", "-o", "k.svg"), 2, "`sift3` is no kernel"),
        (("plot", "slice", "-o", "k.svg"), 2, "wants a script"),
        (("plot", "slice", "hello.blob", "-o", "k.pdf"), 2, "E0803"),
        (("plot", "slice", "hello.blob", "-o", "k.svg", "--pixel", "1,1"), 2, "no effect"),
        (("plot", "slice", "hello.blob", "-o", "k.svg", "--plane", "w=1"), 2, "not a plane"),
        (("plot", "ray", "hello.blob", "-o", "k.svg", "--from", "1,1,1"), 2, "belong together"),
        (("plot", "ray", "hello.blob", "-o", "k.svg", "--surface", "moon"), 2, "no surface `moon`"),
        (("plot", "ray", "hello.blob", "-o", "no/k.svg"), 3, "E0802"),
        (("why", "hello.blob", "640,0"), 2, "no pixel"),
        (("why", "hello.blob", "6"), 2, "not a pixel"),
        (("why", "nothing.blob", "6,6"), 3, "E0801"),
    ],
)
def test_plot_and_why_refuse_in_plain_words(blob: Blob, argv: tuple[str, ...], code: int, told: str) -> None:
    done = blob(*argv)
    assert done.code == code, done.text
    assert told in done.err
    assert "Traceback" not in done.text


def test_why_tells_values_and_lines(blob: Blob, tmp_path: Path) -> None:
    done = blob("why", "hello.blob", "220,240", "-o", "why.svg")
    assert done.code == 0, done.text
    assert "hello.blob:4" in done.out
    assert "threshold 0.5" in done.out
    ET.parse(tmp_path / "why.svg")
    facts = json.loads(blob("why", "hello.blob", "220,240", "--format", "json").out)
    assert facts["status"] == "enter"
    assert facts["density"] == pytest.approx(0.5, abs=1e-9)
    assert blob("why", "hello.blob", "0,0").out.count("no hit") == 1
