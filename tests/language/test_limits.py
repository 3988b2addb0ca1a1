"""No script runs for ever, eats the memory, or ends in a traceback."""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import pytest
from language.compiling import SURFACE, errors_of, run

from blobscript.deep import deeply

BOMBS = {
    "endless recursion": "fn f(n: int) -> int = f(n + 1)\nlet a = f(0)",
    "endless mutual recursion": "fn f(n: int) -> int = g(n)\nfn g(n: int) -> int = f(n)\nlet a = f(0)",
    "exponential recursion": "fn f(n: int) -> int = if (n == 0) 1 else f(n - 1) + f(n - 1)\nlet a = f(900)",
    "nested loops": "let a = [for (i in 0..9999) for (j in 0..9999) for (k in 0..9999) i]",
    "through a lambda": "fn f(g: (int) -> int, n: int) -> int = f(fn(x) = g(g(x)), n - 1)\nlet a = f(fn(x) = x, 9)",
    "doubling": "fn f(x: [int], n: int) -> [int] = if (n == 0) x else f([...x, ...x], n - 1)\nlet a = f([1], 99)",
    "a long range": "let a = 0..9000000000000000",
    "a long range, summed": "let a = max(0..9000000000000000)",
    "comparing long lists": "let a = 0..1999999\nlet b = [for (i in 0..999) a == a]",
    "converting long lists": "fn f(x: [number]) = 1\nlet a = 0..1999999\nlet b = [for (i in 0..999) f(a)]",
    "filtering long lists": "let a = 0..1999999\nlet b = [for (i in 0..999) filter(a, fn(x) = false)]",
    "folding for long": "let a = fold(0..1999999, 0, fn(s, i) = len(filter(0..1999999, fn(x) = false)))",
    "powers": "fn f(n: int, k: int) -> int = if (k == 0) n else f(n * n, k - 1)\nlet a = f(3, 900)",
    "a large power": "let a = 9^999999999",
    "doubling a text": 'fn f(t: text, n: int) -> text = if (n == 0) t else f("{t}{t}", n - 1)\nlet a = f("x", 99)',
    "showing a long list": 'let a = 0..1999999\nlet b = [for (i in 0..999999) "{a}"]',
    "fields of fields": "fn f(x: field, n: int) -> field = if (n == 0) x else f(x + x, n - 1)\n"
    "surface { f(ball(radius = 1), 60) }",
    "many surfaces": "let f = sum { for (i in 0..9999) { ball((i, 0, 0), radius = 1) } }\n"
    "for (i in 0..4999) { surface { f } }",
    "many queries": "let s = surface { for (i in 0..9999) { ball((i, 0, 0), radius = 1) } }\n"
    "let a = [for (i in 0..99999) s.inside((0, 0, 0))]",
    "many surfaces to ask": "let f = sum { for (i in 0..9999) { ball((i, 0, 0), radius = 1) } }\n"
    "let a = [for (i in 0..9999) inside(surface { f }, at = (0, 0, 0))]",
    "large bodies": "for (i in 0..999999) { for (_ in [" + "i + i * i, " * 4_000 + "]) { surface { } } }",
    "large functions": "fn f(i: int) = [" + "i + i * i, " * 4_000 + "]\nlet a = [for (i in 0..999999) f(i)]",
    "much noise": "let a = [for (i in 0..999999) [" + "noise((i, 0, 0)), " * 5_000 + "]]",
    "long lists to makers": "let p = [for (i in 0..9999) (i, i * i, 0)]\nlet a = [for (i in 0..99999) polyline(p)]",
    "many polygons": "let p = [for (i in 0..999) (cos(1turn * i / 1000), sin(1turn * i / 1000), 0)]\n"
    "let a = [for (i in 0..99999) polygon(p)]",
    "deep fields": "fn f(x: field, n: int) -> field = if (n == 0) x else f(max { x }, n - 1)\n"
    "surface { f(ball(radius = 1), 900) }",
    "many balls": "surface { for (i in 0..1000000) { for (j in 0..1000000) { ball((i, j, 0), radius = 1) } } }",
}


@pytest.mark.parametrize("name", BOMBS)
def test_stops(name: str) -> None:
    found = errors_of(BOMBS[name], budget=200_000)
    assert len(found) <= 1
    assert all(code in ("E0901", "E0405") for code, _ in found)
    assert found or name in ("deep fields", "showing a long list")


def test_the_budget_can_be_raised() -> None:
    text = "let a = [for (i in 0..299) for (j in 0..299) i]"
    assert errors_of(text, budget=50_000) == [("E0901", 1)]
    assert errors_of(text, budget=500_000) == []
    deep = "fn f(n: int) -> int = if (n == 0) 0 else 1 + f(n - 1)\nlet a = f(1500)"
    assert errors_of(deep) == [("E0901", 1)]
    assert errors_of(deep, budget=10_000_000) == []


def test_the_message_says_how() -> None:
    _, found = run("fn f(n: int) -> int = f(n + 1)\nlet a = f(0)" + SURFACE)
    (error,) = found
    assert error.span is not None
    assert error.span.text == "f(n + 1)", "the recursive call"
    assert [label.span.text for label in error.labels] == ["f(0)"]
    assert any("--budget 4000000" in help_.text for help_ in error.helps)


NESTED = {
    "parentheses": "let a = " + "(" * 10_000 + "1" + ")" * 10_000,
    "lists": "let a = " + "[" * 10_000 + "1" + "]" * 10_000,
    "calls": "let a = " + "abs(" * 10_000 + "1" + ")" * 10_000,
    "minus": "let a = " + "-" * 10_000 + "1",
    "sum": "let a = " + "+".join(["1"] * 10_000),
    "members": "let a = identity" + ".move(x = 1)" * 10_000,
    "blocks": "surface " + "{ sum " * 3_000 + "{ ball(radius = 1) }" + "}" * 3_000,
    "types": "let a: " + "[" * 10_000 + "int" + "]" * 10_000 + " = []",
    "records": "let a = " + "(a = " * 10_000 + "1" + ")" * 10_000,
    "lambdas": "let a = " + "fn(x: int) = " * 10_000 + "1",
    "conditions": "let a = " + "if (true) 1 else " * 10_000 + "1",
    "a text": 'let a = "' + "{1}" * 20_000 + '"',
    "definitions": "\n".join(f"let a{i} = a{i + 1}" for i in range(3_000)) + "\nlet a3000 = 1",
    "functions": "\n".join(f"fn f{i}(x: int) = f{i + 1}(x)" for i in range(3_000))
    + "\nfn f3000(x: int) = x\nlet a = f0(1)",
    "types of types": "\n".join(f"type T{i} = [T{i + 1}]" for i in range(200)) + "\ntype T200 = int\nlet a: T0 = []",
}


@pytest.mark.parametrize("name", NESTED)
def test_deep_nesting_is_said(name: str) -> None:
    assert {code for code, _ in errors_of(NESTED[name])} <= {"E0901"}


def test_a_long_chain_of_imports(tmp_path: Path) -> None:
    for i in range(400):
        (tmp_path / f"m{i}.blob").write_text(f'import a{i + 1} from "m{i + 1}.blob"\nlet a{i} = a{i + 1}\n')
    (tmp_path / "m400.blob").write_text("let a400 = 1\n")
    assert errors_of('import a0 from "m0.blob"\nassert a0 == 1', folder=tmp_path) == []


# ---- room for calls ------------------------------------------------------------------


def _leaf(*_: int) -> int:
    return 0


def _calls_below(depth: int) -> None:
    """A thousand calls, made from a depth."""
    if depth:
        _calls_below(depth - 1)
    else:
        for _ in range(1000):
            _leaf(1, 2, 3, 4, 5, 6, 7, 8)


def _page_faults() -> int:
    for depth in range(500):
        _calls_below(depth)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


def test_no_depth_is_slow_to_call_from() -> None:
    """CPython maps memory anew for each call at the end of a piece of its stack: that took two thirds of the time of
    some scripts."""
    deeply(_page_faults)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    assert deeply(_page_faults) - before < 500


def test_calls_may_be_deep_and_the_limit_comes_back() -> None:
    def down(left: int) -> int:
        return 1 + down(left - 1) if left else 0

    limit = sys.getrecursionlimit()
    assert deeply(lambda: down(100_000)) == 100_000
    assert sys.getrecursionlimit() == limit
    with pytest.raises(RecursionError):
        down(100_000)
