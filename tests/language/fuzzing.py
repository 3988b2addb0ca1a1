"""Scripts that nobody would write, and whether the compiler treats them well.

Four kinds of input: programs that Hypothesis makes from the lark grammar, with names that mean something;
the project's own scripts with some tokens changed (or some numbers, which leads on into evaluating and
assembling), the same with bytes changed, and bytes without any sense. `Judge` has each checked by a process
of its own, which may take 1 GB and 10 s.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import random
import re
import select
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import TracebackType

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.extra.lark import from_lark
from lark import Lark
from syntax.mutations import OTHERS, mutants
from syntax.programs import Programs
from syntax.scripts import DATA, parsed, scripts

from blobscript import syntax
from blobscript.resources import folder
from blobscript.signatures import BUILTINS
from blobscript.source import Source

SECONDS = 10.0  # of processor time
_PATIENCE = 60.0  # of a clock on the wall, on a machine that has other things to do

Say = Callable[[bytes], None]


class Judge:
    """Has scripts checked; `faults` tells what went wrong, with the script that did it."""

    def __init__(self) -> None:
        self.faults: list[str] = []
        self.codes = {0: 0, 1: 0, 3: 0}
        self.longest = 0.0
        self._folder = Path(tempfile.mkdtemp())
        for place in (DATA, folder("examples")):
            shutil.copytree(place, self._folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*.jpg"))
        self._worker: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Judge:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._stop()
        shutil.rmtree(self._folder)

    @property
    def count(self) -> int:
        return sum(self.codes.values())

    def __call__(self, script: bytes) -> None:
        worker = self._worker or self._start()
        assert worker.stdin
        assert worker.stdout
        with contextlib.suppress(BrokenPipeError):  # it is dead: there is no answer
            worker.stdin.write(b"%d\n" % len(script) + script)
            worker.stdin.flush()
        ready, _, _ = select.select([worker.stdout], [], [], _PATIENCE)
        answer = worker.stdout.readline() if ready else b""
        if not answer:
            self._stop()
            reason = f"dead with {worker.returncode}" if ready else f"longer than {_PATIENCE:.0f} s"
            self._blame(reason, script)
            return
        fault, code, seconds = json.loads(answer)
        self.codes[code] = self.codes.get(code, 0) + 1
        self.longest = max(self.longest, seconds)
        if fault is None and seconds > SECONDS:
            fault = f"{seconds:.1f} s"
        if fault is not None:
            self._blame(fault, script)

    def _blame(self, reason: str, script: bytes) -> None:
        self.faults.append(f"{reason}\n{script!r}")

    def _start(self) -> subprocess.Popen[bytes]:
        program = Path(__file__).with_name("fuzz_worker.py")
        plain = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # each of its threads reserves memory
        self._worker = subprocess.Popen(
            [sys.executable, str(program), str(self._folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=plain,
        )
        assert self._worker.stdout
        if self._worker.stdout.readline() != b"ready\n":
            raise RuntimeError("the compiler does not start")
        return self._worker

    def _stop(self) -> None:
        if self._worker is None:
            return
        self._worker.kill()
        self._worker.wait()
        for stream in (self._worker.stdin, self._worker.stdout):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()
        self._worker = None


# ---- programs of the grammar ------------------------------------------------------------------

_NAMES = ["a", "b", "p", "q", "r", "x", "y", "number", "int", "text", "vec3", "color", "T", "_", "coral", *BUILTINS]
_NUMBERS = [
    "0",
    "1",
    "2",
    "0.5",
    "3",
    "7",
    "1e-3",
    "1e300",
    "1e-300",
    "123456789012345678901234567890",
    "9007199254740993",
]
_STRINGS = ['""', '"a"', '"{a + 1} of {b}"', '"data/caffeine.csv"', '"nowhere.csv"', '"../secret"', '"{"', r'"\{\}"']
_TERMINALS = {
    "NAME": _NAMES,
    "NUMBER": _NUMBERS,
    "ANGLE": ["35deg", "0.5rad", "1turn", "0deg", "1e300deg"],
    "STRING": _STRINGS,
    "WS": [" "],
    "COMMENT": ["// c"],
    "_NL": ["\n"],
}


@cache
def _programs() -> st.SearchStrategy[str]:
    grammar = (folder("grammar") / "blobscript.lark").read_text(encoding="utf-8")
    return from_lark(
        Lark(grammar, parser="lalr", lexer="contextual", start="start"),
        explicit={name: st.sampled_from(words) for name, words in _TERMINALS.items()},
    )


def of_grammar(say: Say, count: int, first: int) -> None:
    """Programs that Hypothesis makes from grammar/blobscript.lark."""

    @settings(
        max_examples=count,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @seed(first)
    @given(_programs(), st.booleans())
    def try_all(program: str, placed: bool) -> None:
        say(f"{program}\nsurface {{ ball(radius = 1) }}\n".encode() if placed else program.encode())

    try_all()


def of_programs(say: Say, count: int, first: int) -> None:
    """Longer ones, by a generator that follows the grammar."""
    for number in range(count):
        pick = random.Random(first + number)
        text = Programs(pick).program(pick.randrange(1, 6))
        for word in ("a", "b", "size", "x1"):
            text = re.sub(rf"\b{word}\b", pick.choice(_NAMES), text) if pick.random() < 0.5 else text
        say(text.encode())


# ---- the project's scripts, changed ---------------------------------------------------------------


@cache
def _texts() -> list[str]:
    return [path.read_text(encoding="utf-8") for path in scripts()]


def of_tokens(say: Say, count: int, first: int) -> None:
    """One to four tokens deleted, doubled, swapped or replaced."""
    texts = _texts()
    for number in range(count):
        pick = random.Random(first + number)
        text = pick.choice(texts)
        for _ in range(pick.choice([1, 1, 2, 4])):
            text = next(mutants(text, 1, pick.randrange(1 << 30))).text
        say(text.encode())


_VALUE = re.compile(r"(?<![\w.#])\d+(\.\d+)?(?![\w.])|\b(?:wyvill|soft2|clay|coral|sum|max|true|false|point|line)\b")
_VALUES = [
    "0",
    "1",
    "-1",
    "1e-9",
    "1e9",
    "1e154",
    "1e300",
    "5e-324",
    "1000000",
    "0.5",
    "(0, 0, 0)",
    "[]",
    "2",
    "7",
    "max",
]
_VALUES += ["gauss(a = 700)", "soft3", "sum", "min", "jelly", "noise((1, 2, 3))", "(1 / 0)", "[1, 2]", "pi", "time"]


def of_values(say: Say, count: int, first: int) -> None:
    """One to three numbers or names replaced by others: most are right programs of odd scenes."""
    texts = [text for text in _texts() if len(_VALUE.findall(text)) > 3]
    for number in range(count):
        pick = random.Random(first + number)
        text = pick.choice(texts)
        for _ in range(pick.choice([1, 1, 2, 3])):
            place = pick.choice(list(_VALUE.finditer(text)))
            text = text[: place.start()] + pick.choice(_VALUES) + text[place.end() :]
        say(text.encode())


def of_grafts(say: Say, count: int, first: int) -> None:
    """One to three expressions replaced by expressions of this or another script."""
    texts, parts = _texts(), _parts()
    for number in range(count):
        pick = random.Random(first + number)
        own = pick.randrange(len(texts))
        text, places = texts[own], list(parts[own])
        for _ in range(pick.choice([1, 1, 2, 3])):
            start, end = pick.choice(places)
            other = own if pick.random() < 0.5 else pick.randrange(len(texts))
            a, b = pick.choice(parts[other])
            text = text[:start] + texts[other][a:b] + text[end:]
            places = [(a, b) for a, b in places if b <= start] or [(start, start + b - a)]
        say(text.encode())


@cache
def _parts() -> list[list[tuple[int, int]]]:
    return [sorted(set(_expressions(parsed(text)))) for text in _texts()]


def _expressions(node: object) -> Iterator[tuple[int, int]]:
    """Start and end of every expression of a tree."""
    if isinstance(node, tuple):
        for item in node:
            yield from _expressions(item)
    elif dataclasses.is_dataclass(node) and not isinstance(node, Source):
        if isinstance(node, syntax.Expr):
            yield node.span.start, node.span.end
        for field in dataclasses.fields(node):
            yield from _expressions(getattr(node, field.name))


def of_pieces(say: Say, count: int, first: int) -> None:
    """Lines of several scripts in any order, some of them cut."""
    lines = [line for text in _texts() for line in text.splitlines()]
    for number in range(count):
        pick = random.Random(first + number)
        chosen = pick.choices(lines, k=pick.randrange(1, 12))
        say("\n".join(line[: pick.randrange(len(line) + 40)] for line in chosen).encode())


def of_changed_bytes(say: Say, count: int, first: int) -> None:
    """One to eight bytes of a script changed, put in or left out."""
    texts = [text.encode() for text in _texts()]
    for number in range(count):
        pick = random.Random(first + number)
        data = bytearray(pick.choice(texts))
        for _ in range(pick.choice([1, 1, 2, 4, 8])):
            at = pick.randrange(len(data))
            data[at : at + pick.randrange(3)] = bytes(pick.choice(_BYTES) for _ in range(pick.randrange(3)))
        say(bytes(data))


# ---- no sense at all ------------------------------------------------------------------------------

_BYTES = [*range(256), *(b"(){}[]\"'=,.#\n \t@-+*/^<>:" * 6)]


def of_bytes(say: Say, count: int, first: int) -> None:
    for number in range(count):
        pick = random.Random(first + number)
        letters = pick.choice([range(256), range(32, 127), _BYTES])
        say(bytes(pick.choice(letters) for _ in range(pick.randrange(300))))


def of_words(say: Say, count: int, first: int) -> None:
    """Words of the language in any order."""
    words = [*OTHERS, *_NAMES, *_NUMBERS, *_STRINGS, "\n", "\n", "kernel", "param", "type", "import", "assert", "debug"]
    for number in range(count):
        pick = random.Random(first + number)
        say(" ".join(pick.choices(words, k=pick.randrange(1, 60))).encode())


#: Name and share of each kind.
KINDS: dict[str, tuple[Callable[[Say, int, int], None], float]] = {
    "grammar": (of_grammar, 0.10),
    "programs": (of_programs, 0.05),
    "tokens": (of_tokens, 0.20),
    "values": (of_values, 0.15),
    "grafts": (of_grafts, 0.15),
    "pieces": (of_pieces, 0.05),
    "changed bytes": (of_changed_bytes, 0.10),
    "bytes": (of_bytes, 0.10),
    "words": (of_words, 0.10),
}


def campaign(judge: Judge, count: int, first: int = 0) -> Iterator[tuple[str, int]]:
    """Runs all kinds; gives the name of each and how many inputs it had when it is done."""
    for name, (kind, share) in KINDS.items():
        before = judge.count
        kind(judge, round(count * share), first)
        yield name, judge.count - before
