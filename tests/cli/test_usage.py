"""Wrong usage: exit code 2, what was wrong in the user's words, what to write instead."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Blob

WRONG = [
    ((), "wants a verb", "blobscript render"),
    (("rendr", "hello.blob"), "no verb `rendr`", "did you mean `render`?"),
    (("hello.blob",), "a verb stands before the script", "blobscript render hello.blob"),
    (("animate", "hello.blob"), "missing: -o", ""),
    (("check",), "missing: FILE.blob", "blobscript check --help"),
    (("check", "a.blob", "b.blob"), "one `b.blob` too many", "--help"),
    (("check", "hello.blob", "--formt", "json"), "no option `--formt`", "did you mean `--format`?"),
    (("check", "hello.blob", "--format", "jsn"), "--format cannot be `jsn`", "did you mean `json`?"),
    (("check", "hello.blob", "--ask"), "--ask goes with --fix", "check --fix --ask"),
    (("check", "hello.blob", "--set", "drops"), "--set wants name=value", "--set drops=12"),
    (("check", "hello.blob", "--set", "=3"), "--set wants name=value", "--set drops=12"),
    (("check", "hello.blob", "--budget", "0"), "--budget: `0` is not a whole number from 1 up", ""),
    (("render", "hello.blob"), "missing: -o", "render --help"),
    (("render", "hello.blob", "-o", "x.png", "--sample", "4"), "no option `--sample`", "did you mean `--samples`?"),
    (("render", "hello.blob", "-o", "x.png", "--size", "640"), "`640` is not a size such as 640x480", ""),
    (("render", "hello.blob", "-o", "x.png", "--size", "0x480"), "`0` is not a whole number from 1 up", ""),
    (("render", "hello.blob", "-o", "x.png", "--size", "9999999x9"), "larger than a picture can be", ""),
    (("render", "hello.blob", "-o", "x.png", "--samples", "-1"), "--samples: `-1` is not a whole number from 1 up", ""),
    (("render", "hello.blob", "-o", "x.png", "--threads", "none"), "`none` is not a whole number", ""),
    (("render", "hello.blob", "-o", "x.png", "--seed", "9" * 19), "--seed: `9999999999999999999` is too large", ""),
    (("render", "hello.blob", "-o", "x.png", "--tolerance", "0"), "`0` is not a positive number", ""),
    (("render", "hello.blob", "-o", "x.png", "--step", "nan"), "`nan` is not a positive number", ""),
    (("render", "hello.blob", "-o", "x.png", "--search", "sandwitch"), "cannot be `sandwitch`", "mean `sandwich`?"),
    (("render", "hello.blob", "-o", "x.png", "--index", "kd"), "--index cannot be `kd`", "bvh, grid"),
    (
        ("render", "hello.blob", "-o", "x.png", "--search", "march", "--step", "1e-300"),
        "--step: 1e-300 is too short",
        "at least",
    ),
    (("render", "hello.blob", "-o", "x.png", "--aov", "deph"), "no layer `deph`", "did you mean `depth`?"),
    (("render", "hello.blob", "-o", "x.png", "--region", "1,2,3"), "not four pixel numbers", ""),
    (("render", "hello.blob", "-o", "x.png", "--region", "5,5,5,9"), "`5,5,5,9` has no pixel", ""),
    (("render", "hello.blob", "-o", "x.png", "--region", "0,0,9999,9"), "not inside the picture of 640x480", ""),
    (("render", "hello.blob", "-o", "x.png", "--step", "0.1"), "--step has no effect on", "--search march"),
    (("render", "hello.blob", "-o", "x.png", "--normal-step", "0.1"), "--normal-step has no effect", "central"),
    (("render", "hello.blob", "-o", "x.gif"), "E0803", ".png"),
    (("render", "hello.blob", "-o", "picture"), "E0803", ".png"),
    (("render", "hello.blob", "-o", "x.jpg", "--bits", "16"), "E0803", "8"),
    (("compile", "hello.blob"), "missing: --to", ""),
    (("compile", "hello.blob", "--to", "obj"), "--to cannot be `obj`", "pov"),
    (("explain", "E9999"), "no code `E9999`", "blobscript explain lists"),
]


@pytest.mark.parametrize(("argv", "mistake", "remedy"), WRONG, ids=[" ".join(row[0]) or "nothing" for row in WRONG])
def test_wrong_usage(blob: Blob, argv: tuple[str, ...], mistake: str, remedy: str) -> None:
    result = blob(*argv)
    assert result.code == 2
    assert result.out == ""
    assert mistake in result.err
    assert remedy in result.err
    assert "Traceback" not in result.err


def test_abbreviations_are_not_guessed(blob: Blob) -> None:
    assert blob("check", "hello.blob", "--form", "json").code == 2


def test_help_and_version(blob: Blob) -> None:
    assert "Exit codes" in blob("--help").out
    assert "--samples" in blob("render", "--help").out
    version = blob("--version")
    assert version.code == 0
    assert version.out.startswith("blobscript ")
