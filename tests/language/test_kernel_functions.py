"""Functions of the script in the bodies of kernels: proved as if their formulas were written there."""

from __future__ import annotations

from pathlib import Path

import pytest
from language.compiling import run

from blobscript import ir

#: (definitions, body with functions, the same body without), of a kernel in r.
SAME = {
    "a function": ("fn sq(x: number) = x * x", "sq(1 - sq(r))", "(1 - r^2)^2"),
    "called as a member": ("fn sq(x: number) = x * x", "(1 - r.sq()).sq()", "(1 - r^2)^2"),
    "labels and defaults": (
        "fn p(x: number, k: int = 2, *, c = k - 1) = c * x^k",
        "p(k = 3, c = 1, x = 1 - p(r))",
        "(1 - r^2)^3",
    ),
    "let in the body": (
        "fn smooth(x: number) -> number {\n  let s = x * x\n  let t = 1 - s\n  return t * t * (1 + 2 * s)\n}",
        "smooth(r)",
        "(1 - r^2)^2 * (1 + 2 * r^2)",
    ),
    "an assertion that holds": (
        "fn rest(x: number) -> number {\n  assert x <= 1\n  debug x\n  return 1 - x^2\n}",
        "rest(r)^2",
        "(1 - r^2)^2",
    ),
    "branches": (
        "fn meta(x: number) = if (x < 1 / 3) 1 - 3 * x^2 else 1.5 * (1 - x)^2",
        "meta(r)",
        "if (r < 1 / 3) 1 - 3 * r^2 else 1.5 * (1 - r)^2",
    ),
    "a condition as an argument": (
        "fn pick(c: bool, x: number, y: number) = if (c) x else y",
        "pick(r < 1 / 3, 1 - 3 * r^2, 1.5 * (1 - r)^2)",
        "if (r < 1 / 3) 1 - 3 * r^2 else 1.5 * (1 - r)^2",
    ),
    "a third by name": (
        "let third = 1 / 3\nlet inner = true",
        "if (inner and r < third) 1 - 3 * r^2 else 1.5 * (1 - r)^2",
        "if (r < 1 / 3) 1 - 3 * r^2 else 1.5 * (1 - r)^2",
    ),
    "a lambda by name": ("let sq = fn(x: number) = x * x", "sq(1 - sq(r))", "(1 - r^2)^2"),
    "a lambda in a body": (
        "fn f(x: number) -> number {\n  let twice = fn(a: number) = a * x\n  return 1 - twice(x)\n}",
        "f(r)^2",
        "(1 - r^2)^2",
    ),
    "a lambda called at once": ("let k = 2", "(fn(x: number) = (1 - x^k)^k)(r)", "(1 - r^2)^2"),
    "a function as an argument": (
        "fn sq(x: number) = x * x\nfn twice(g: (number) -> number, x: number) = g(1 - g(x))",
        "twice(sq, r)",
        "(1 - r^2)^2",
    ),
    "functions of functions": (
        "let two = 2\nfn up(x: number) = x^two\nfn down(x: number) = 1 - up(x)\nfn both(x: number) = up(down(x))",
        "both(r)",
        "(1 - r^2)^2",
    ),
    "angles": ("fn wave(a: angle) = (1 + cos(a)) / 2", "wave(180deg * r)", "(1 + cos(180deg * r)) / 2"),
}


def kernel_of(definitions: str, body: str, before: str = "", folder: Path | None = None) -> ir.Kernel:
    text = f"{definitions}\n{before}kernel own(r) = {body}\nsurface {{ ball(radius = 1, kernel = own) }}\n"
    scene, found = run(text, folder=folder)
    assert scene is not None, [f"{d.line}: {d.code} {d.message}" for d in found]
    leaf = scene.surfaces[0].field
    assert isinstance(leaf, ir.Leaf)
    return leaf.kernel


@pytest.mark.parametrize("name", SAME)
def test_as_if_written_there(name: str) -> None:
    definitions, with_functions, without = SAME[name]
    assert kernel_of(definitions, with_functions).pieces == kernel_of("", without).pieces


@pytest.mark.parametrize("name", SAME)
def test_unproved_as_well(name: str) -> None:
    definitions, with_functions, without = SAME[name]
    odd = " + 0 * floor(100 * r)"  # more steps than a proof follows
    first = kernel_of(definitions, with_functions + odd, "@allow(unproved)\n")
    second = kernel_of("", without + odd, "@allow(unproved)\n")
    assert first.pieces == second.pieces


def test_names_mean_what_they_mean_in_the_file_of_the_function(tmp_path: Path) -> None:
    (tmp_path / "parts.blob").write_text(
        "let k = 2\nlet half = 1 / 2\nfn fall(r: number) = 1 - help(r)\nfn help(x: number) = x^k\n"
    )
    plain = kernel_of("", "(1 - r^2)^3").pieces
    by_name = 'import fall from "parts.blob"\nlet k = 3'
    assert kernel_of(by_name, "fall(r)^k", folder=tmp_path).pieces == plain
    whole = 'import "parts.blob" as parts\nlet k = 3'
    assert kernel_of(whole, "parts.fall(r)^k", folder=tmp_path).pieces == plain
    assert kernel_of(whole, "parts.fall(r)^(k * parts.half * 2)", folder=tmp_path).pieces == plain


#: (definitions, body, code, a word of the message, the place, the places of labels).
WRONG = {
    "recursion": (
        "fn fact(n: int) -> int = if (n <= 1) 1 else n * fact(n - 1)\nfn f(x: number) = fact(2) * x",
        "1 - f(r)",
        "E0506",
        "`fact` calls itself",
        "fact",
        ["f(r)"],
    ),
    "recursion of two": (
        "fn f(n: int) -> int = g(n)\nfn g(n: int) -> int = if (n < 1) 2 else f(n - 1)",
        "(1 - r^2)^f(2)",
        "E0506",
        "calls itself",
        "f",
        [],
    ),
    "something else": ("fn f(x: number) = len([x])", "1 - f(r) * r", "E0506", "`len`", "len([x])", ["f(r)"]),
    "an assertion that fails": (
        "fn f(x: number) -> number {\n  assert x < 0.5\n  return x\n}",
        "1 - f(r)^2",
        "E0506",
        "does not hold",
        "x < 0.5",
        ["f(r)"],
    ),
    "the end": ("fn f(x: number) = 1 - x / 2", "f(r)^2", "E0501", "D(1) = 0.25", "f(r)^2", []),
    "a jump": (
        "fn f(x: number) = if (x < 0.5) 1 else 0",
        "f(r)",
        "E0504",
        "r = 1/2",
        "if (x < 0.5)",
        ["1", "0", "f(r)"],
    ),
    "a function that is a value": (
        "fn sq(x: number) = x * x\nlet f = if (1 < 2) sq else sq",
        "f(1 - r)",
        "E0506",
        "`f` cannot be followed",
        "f(1 - r)",
        [],
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_goes_wrong_in_a_function(name: str) -> None:
    definitions, body, code, words, place, places = WRONG[name]
    scene, found = run(f"{definitions}\nkernel own(r) = {body}\nsurface {{ ball(radius = 1, kernel = own) }}\n")
    assert scene is None
    (error,) = found
    assert error.code == code
    assert words in error.message
    assert error.span is not None
    assert error.span.text == place
    assert [label.span.text for label in error.labels] == places


def test_calls_that_would_take_for_ever_end() -> None:
    chain = "fn f0(x: number) = x * x\n" + "".join(
        f"fn f{i}(x: number) = f{i - 1}(f{i - 1}(x) / 2)\n" for i in range(1, 40)
    )
    scene, found = run(f"{chain}kernel own(r) = f39(1 - r)\nsurface {{ ball(radius = 1, kernel = own) }}\n")
    assert scene is None
    assert [d.code for d in found] == ["E0506"]
