"""Every built-in with good and bad arguments: from the table of signatures, and by value."""

from __future__ import annotations

import math
import re

import pytest
from language.compiling import errors_of, evaluate, run
from language.test_operators import SAMPLES

from blobscript import explain
from blobscript.builtins import FUNCTIONS, LIST_FUNCTIONS
from blobscript.callables import Parameter, Signature, builtin_signatures, builtin_type
from blobscript.css import CSS_COLORS
from blobscript.makers import MAKERS
from blobscript.signatures import BUILTINS, TYPE_NAMES
from blobscript.types import Choice, FnOf, ListOf, OneOf, Primitive, RecordOf, Type, Variable, describe

CASES = [(name, signature) for name in BUILTINS for signature in builtin_signatures(name)]
IDS = [f"{name}-{i}" for name in BUILTINS for i, _ in enumerate(builtin_signatures(name))]


def sample(kind: Type) -> str:
    """A value of a type in a signature."""
    match kind:
        case Variable(allowed=allowed):
            return sample(allowed[0]) if allowed else "1.5"
        case OneOf(options):
            return sample(options[0])
        case ListOf(element):
            return f"[{sample(element)}]"
        case FnOf(parameters, result):
            kinds = ["number" if isinstance(parameter, Variable) else describe(parameter) for parameter in parameters]
            given = ", ".join(f"p{i}: {kind}" for i, kind in enumerate(kinds))
            return f"fn({given}) = {sample(result) if isinstance(result, Primitive) else '1.5'}"
        case Choice(words):
            return f'"{words[0]}"'
        case RecordOf(fields):
            return "(" + ", ".join(f"{name} = {sample(own)}" for name, own in fields) + ")"
        case _:
            return SAMPLES[describe(kind)]


def call(signature: Signature, values: dict[str, str]) -> str:
    """A call with the first argument in front where it is positional, the others by name."""
    parts = [
        values[p.name] if p.rest or (p.name in ("first", "list")) else f"{p.name} = {values[p.name]}"
        for p in signature.parameters
    ]
    return f"{signature.name}({', '.join(parts)})"


def codes(expression: str) -> list[str]:
    """What checking says; nothing is evaluated, since the assertion is wrong."""
    _, found = run(f'let value = {expression}\nassert "never"\n')
    return sorted(d.code for d in found if "condition" not in d.message)


@pytest.mark.parametrize(("name", "signature"), CASES, ids=IDS)
def test_good_arguments(name: str, signature: Signature) -> None:
    if name == "read_records":  # its type comes from the file, and a script without a folder may read none
        assert codes('read_records("none.csv")') == ["E0207"]
        return
    assert codes(call(signature, {p.name: sample(p.type) for p in signature.parameters})) == []


def wrong_for(parameter: Parameter) -> str:
    """A value that no signature takes there."""
    return "[[true]]" if not isinstance(parameter.type, Variable) or parameter.type.allowed else ""


@pytest.mark.parametrize(("name", "signature"), CASES, ids=IDS)
def test_bad_arguments(name: str, signature: Signature) -> None:
    values = {p.name: sample(p.type) for p in signature.parameters}
    for parameter in signature.parameters:
        wrong = wrong_for(parameter)
        if not wrong or (isinstance(parameter.type, ListOf) and isinstance(parameter.type.element, Variable)):
            continue
        found = codes(call(signature, {**values, parameter.name: wrong}))
        assert found == ["E0304"], f"{name}: {parameter.name}"
        if parameter.type == Primitive("angle"):
            assert codes(call(signature, {**values, parameter.name: "3"})) == ["E0301"]
    assert codes(call(signature, values)[:-1] + ", nonsense = 1)") == ["E0303"]
    required = [p for p in signature.parameters if not p.optional and not p.rest]
    if required:
        assert "E0302" in codes(f"{name}()") or len(builtin_signatures(name)) > 1


#: Functions of lists of anything.
LISTS = ("len", "find", "filter", "map", "fold")

#: What has tests of its own.
APART = (*LISTS, "max", "min", "read_records")

#: What a parameter of a type takes, of SAMPLES; any other type takes only itself.
TAKES = {"number": {"int", "number"}, "[number]": {"[int]"}, "text": {"text"}}


def taken(kind: Type, own: str) -> set[str]:
    """The samples that fit a type in a signature; `own`: the one that stands for its variables."""
    match kind:
        case Variable(allowed=allowed):
            return {own} if not allowed or any(own in taken(one, own) for one in allowed) else set()
        case OneOf(options):
            return {word for option in options for word in taken(option, own)}
        case Choice():
            return set()  # a sample of text is none of its words
        case ListOf(Variable()):
            return {"[int]"}
        case FnOf():
            return {"(number) -> number"} if describe(kind) == "(number) -> number" else set()
        case _:
            return TAKES.get(describe(kind), {describe(kind)} & set(SAMPLES))


def refused(lines: list[str]) -> set[int]:
    """The numbers of the lines, from 0, that are not right."""
    _, found = run("\n".join(f"let v{i} = {line}" for i, line in enumerate(lines)) + '\nassert "never"\n')
    return {d.line - 1 for d in found if "condition" not in d.message and d.severity == "error"}


@pytest.mark.parametrize(
    ("name", "signature"),
    [(n, s) for n, s in CASES if s.parameters and n not in (*LISTS, "max", "min", "read_records")],
)
def test_every_parameter_with_every_type(name: str, signature: Signature) -> None:
    """What is taken is what the table says, and nothing else. (Lists of anything, and functions of it: below.)"""
    wrong: list[str] = []
    for parameter in signature.parameters:
        lines: list[str] = []
        for value in SAMPLES.values():
            values = {p.name: sample(p.type) for p in signature.parameters}
            alike = [p.name for p in signature.parameters if isinstance(p.type, Variable) and p.type == parameter.type]
            lines.append(call(signature, {**values, **dict.fromkeys([parameter.name, *alike], value)}))
        bad = refused(lines)
        for number, own in enumerate(SAMPLES):
            if (number not in bad) != (own in taken(parameter.type, own)):
                wrong.append(f"{parameter.name} = {own}: {'refused' if number in bad else 'taken'}")
    assert wrong == []


@pytest.mark.parametrize("kind", SAMPLES)
def test_functions_of_lists_with_every_type(kind: str) -> None:
    """As their list, as one of its elements, and as their function."""
    value = SAMPLES[kind]
    lines = [
        f"len({value})",
        *[f"{name}({value}, fn(x: int) = true)" for name in ("find", "filter", "map")],
        f"fold({value}, 0, fn(sum: int, x: int) = sum + x)",
        *[f"{name}([{value}], {value})" for name in ("find", "filter", "map", "fold")],
        f"max({value})",
        f"min({value}, 1)",
        f"max([{value}])",
        f"map([{value}], fn(x) = x)",
    ]
    is_list, is_number, is_peer = kind == "[int]", kind in ("int", "number"), kind in ("field", "angle")
    right = [is_list or kind == "text", is_list, is_list, is_list, is_list, False, False, False, False]
    right += [is_list or is_number or is_peer, is_number, is_number or is_peer, True]
    bad = refused(lines)
    assert [lines[i] for i, fine in enumerate(right) if fine == (i in bad)] == []


@pytest.mark.parametrize("name", [name for name, row in BUILTINS.items() if row.value])
def test_bare_values(name: str) -> None:
    assert codes(name) == []
    kind = BUILTINS[name].value
    assert codes(f"[{name}][0]") == []
    _, found = run(f"debug {name}\nsurface {{ ball(radius = 1) }}")
    assert [d.label.partition(":")[0] for d in found] == [kind]


def test_everything_in_the_table_is_there() -> None:
    special = {"time", "phase", "pi", "soft2", "soft3", "wyvill", "metaball"}
    missing = set(BUILTINS) - set(FUNCTIONS) - set(LIST_FUNCTIONS) - set(MAKERS) - special
    assert missing == set()
    for row in BUILTINS.values():
        assert row.value is None or builtin_type(row.value)
        assert row.doc.endswith((".", ")", "?"))
        assert row.signatures or row.value
    assert not set(CSS_COLORS) & set(BUILTINS)
    assert set(TYPE_NAMES) <= set(SAMPLES) | {"text"}


VALUES = [
    ("abs(-3)", "3"),
    ("abs(-1.5)", "1.5"),
    ("abs(-30deg)", "30deg"),
    ("sign(-2.5)", "-1"),
    ("sign(0deg)", "0"),
    ("floor(-1.5)", "-2"),
    ("ceil(-1.5)", "-1"),
    ("round(0.49999999999999994)", "0"),
    ("round(2.5)", "3"),
    ("round(-2.5)", "-3"),
    ("mod(7, 3)", "1"),
    ("mod(-0.5, 1)", "0.5"),
    ("mod(-30deg, 1turn)", "330deg"),
    ("sqrt(16)", "4"),
    ("exp(0)", "1"),
    ("log(1)", "0"),
    ("clamp(5, 0, 3)", "3"),
    ("clamp(-1.5, 0, 3)", "0"),
    ("lerp(1, 3, 0.5)", "2"),
    ("lerp((0, 0, 0), (2, 4, 6), 0.5)", "(1, 2, 3)"),
    ("lerp(0deg, 90deg, 0.5)", "45deg"),
    ("lerp(black, white, 1)", "#ffffff"),
    ("sin(90deg)", "1"),
    ("cos(0.5turn)", "-1"),
    ("atan2(1, 1)", "45deg"),
    ("asin(1)", "90deg"),
    ("acos(1.0000000000000002)", "0deg"),
    ("atan(1)", "45deg"),
    ("dot((1, 2, 3), (4, 5, 6))", "32"),
    ("cross((1, 0, 0), (0, 1, 0))", "(0, 0, 1)"),
    ("length((3, 4, 0))", "5"),
    ("normalize((0, 0, 9))", "(0, 0, 1)"),
    ("normalize((1e200, 0, 0))", "(1, 0, 0)"),
    ("rgb(1, 0.5, 0)", "#ff8000"),
    ("hsl(120deg, 1, 0.5)", "#00ff00"),
    ("hsl(0deg, 0, 1)", "#ffffff"),
    ("oklch(1, 0, 0deg)", "#ffffff"),
    ("oklch(0.627955, 0.257683, 29.234deg)", "#ff0000"),
    ("len([1, 2])", "2"),
    ('len("abc")', "3"),
    ("max(1, 2.5)", "2.5"),
    ("max([1, 7, 3])", "7"),
    ("min(3, 1, 2)", "1"),
    ("max(10deg, 20deg)", "20deg"),
    ("find([1, 2, 3], where = fn(x) = x > 1)", "2"),
    ("filter([1, 2, 3], fn(x) = x > 1)", "[2, 3]"),
    ("map([1, 2], fn(x) = x * 2)", "[2, 4]"),
    ("map(0..2, with = fn(x) = x / 2)", "[0, 0.5, 1]"),
    ('fold(["a", "b"], "", fn(all, x) = "{all}{x}")', '"ab"'),
    ("pi", "3.141592653589793"),
    ("time", "0"),
    ("phase", "0"),
    ("2^3", "8"),
    ("7 / 2", "3.5"),
    ("-(1, 2, 3) * 2", "(-2, -4, -6)"),
    ("(1, 2, 3).y", "2"),
    ('"{1.5} {2} {45deg} {true} {(1, 0.5, 0)} {#ff8800} {[1]} {(a = 2)}"',
     '"1.5 2 45deg true (1, 0.5, 0) #ff8800 [1] (a = 2)"'),
    ("0.1 + 0.2", "0.30000000000000004"),
    ("-0.0", "0"),
    ("1e21", "1e+21"),
    ("#f80", "#ff8800"),
    ("#ff880080", "#ff880080"),
    ("tan(45deg) > 0.99", "true"),
]  # fmt: skip


@pytest.mark.parametrize(("expression", "value"), VALUES, ids=[e for e, _ in VALUES])
def test_values(expression: str, value: str) -> None:
    assert evaluate(expression) == value


def test_every_function_has_a_value_above() -> None:
    named = {word for expression, _ in VALUES for word in re.findall(r"[a-z_0-9]+", expression)}
    assert (set(FUNCTIONS) | set(LIST_FUNCTIONS)) - named == {"rand", "noise"}


# ---- random ------------------------------------------------------------------------------

_MASK = (1 << 64) - 1
_G = 0x9E3779B97F4A7C15


def mix(z: int) -> int:
    """The definition in the documentation, written out once more."""
    z ^= z >> 30
    z = z * 0xBF58476D1CE4E5B9 & _MASK
    z ^= z >> 27
    z = z * 0x94D049BB133111EB & _MASK
    return z ^ z >> 31


@pytest.mark.parametrize(("i", "seed"), [(0, 0), (1, 0), (-1, 7), (10**15, -3), (5, 2**53)])
def test_rand_is_specified_to_the_bit(i: int, seed: int) -> None:
    expected = (mix((mix((seed + _G) & _MASK) + (i + 1) * _G) & _MASK) >> 11) / 2**53
    assert float(evaluate(f"rand({i}, seed = {seed})")) == expected


def test_rand_keeps_its_values() -> None:
    """SplitMix64's first outputs for the state that mix(G) is; these bits never change."""
    assert mix(0x9E3779B97F4A7C15) == 0xE220A8397B1DCDAF  # the published first output for seed 0
    assert [float(evaluate(f"rand({i})")) for i in range(3)] == [FUNCTIONS["rand"](i) for i in range(3)]
    values = [FUNCTIONS["rand"](i, 1) for i in range(10_000)]
    assert all(0 <= value < 1 for value in values)
    assert abs(sum(values) / len(values) - 0.5) < 0.01
    assert len(set(values)) == len(values)


def test_noise() -> None:
    noise = FUNCTIONS["noise"]
    assert evaluate("noise((1, -2, 3))") == "0"
    values = [noise((0.37 * i, 0.71 * i - 20, 1.13 * i), 3) for i in range(3000)]
    assert -1 <= min(values) < -0.5
    assert 0.5 < max(values) <= 1
    a, b = noise((1.9999999, 0.4, 0.3)), noise((2.0000001, 0.4, 0.3))
    assert math.isclose(a, b, abs_tol=1e-6), "continuous where the lattice changes"
    assert noise((0.3, 0.4, 0.5), 1) != noise((0.3, 0.4, 0.5), 2)


def test_noise_is_specified_to_the_bit() -> None:
    edges = [
        (1, 1, 0), (-1, 1, 0), (1, -1, 0), (-1, -1, 0), (1, 0, 1), (-1, 0, 1),
        (1, 0, -1), (-1, 0, -1), (0, 1, 1), (0, -1, 1), (0, 1, -1), (0, -1, -1),
    ]  # fmt: skip

    def gradient(i: int, j: int, k: int, x: float, y: float, z: float, seed: int) -> float:
        h = mix((seed + _G) & _MASK)
        for n in (i, j, k):
            h = mix((h + n * _G) & _MASK)
        e = edges[(h >> 32) % 12]
        return e[0] * x + e[1] * y + e[2] * z

    def fade(t: float) -> float:
        return t * t * t * (t * (t * 6 - 15) + 10)

    def expected(p: tuple[float, float, float], seed: int) -> float:
        (i, j, k), (x, y, z) = map(math.floor, p), [c - math.floor(c) for c in p]
        lines = {}
        for c in (0, 1):
            for b in (0, 1):
                near = gradient(i, j + b, k + c, x, y - b, z - c, seed)
                far = gradient(i + 1, j + b, k + c, x - 1, y - b, z - c, seed)
                lines[b, c] = near + fade(x) * (far - near)
        low = lines[0, 0] + fade(y) * (lines[1, 0] - lines[0, 0])
        high = lines[0, 1] + fade(y) * (lines[1, 1] - lines[0, 1])
        return 0.96 * (low + fade(z) * (high - low))

    for p in [(0.5, 0.5, 0.5), (-3.25, 7.125, 0.0625), (1e6 + 0.3, -0.1, 9.9)]:
        assert FUNCTIONS["noise"](p, 5) == expected(p, 5)


def test_time_and_phase() -> None:
    _, found = run("debug time\ndebug phase\nsurface { ball(radius = 1) }", time=1.5, phase=0.25)
    assert [d.label for d in found if d.severity == "note"] == ["number: 1.5", "number: 0.25"]


def test_points_of_a_list_and_of_one_value() -> None:
    scene, found = run(
        "surface { balls([(0, 0, 0), (2, 0, 0)], radius = [1, 0.5], paint = [red, blue]) }\n"
        "surface { balls((0, 5, 0), radius = 1) }"
    )
    assert scene is not None, found
    assert [
        len(errors_of(f"surface {{ balls([(0, 0, 0)], {bad}) }}")) for bad in ("radius = [1, 2]", "radius = [true]")
    ] == [1, 1]


def test_the_values_in_the_documentation() -> None:
    page = explain.page("random")
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines() if line.startswith("|")]
    values = [row for row in rows if row[0][0] in "(-0123456789" and row[0] != "---"]
    assert len(values) == 9
    for first, seed, value in values:
        name = "noise" if first.startswith("(") else "rand"
        assert evaluate(f"{name}({first}, seed = {seed})") == value
