"""The parse tables: built from the grammar by lark, kept on disk as JSON between runs.

Building takes lark about 0.15 s, reading the kept tables 3 ms and no import of lark. A kept
table is used only if it was made from the same grammar by the same lark and Python; it
carries a checksum, so a damaged one is built again. It is written beside its place and
renamed, so that programs started at the same time never see half of it. A folder that
cannot be written means no cache, never an error.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from blobscript import resources

__all__ = ["STARTS", "Pick", "Rule", "Tables", "build", "grammar_text", "load"]

#: What a parse may start with: a file, the block of a broken item, the inside of `{ }` in a text.
STARTS = ("start", "lone_block", "lone_expr")

#: One child of a node: the index of a symbol (-1: an absent optional one), and whether it is a list to splice in.
Pick = tuple[int, bool]


@dataclass(frozen=True, slots=True)
class Rule:
    """`size` symbols become an `origin`. `action` names what is built, "" for a list of helpers.

    `whole`: the picks are all the symbols as they are.
    """

    origin: str
    size: int
    action: str
    picks: tuple[Pick, ...]
    unit: bool
    whole: bool


@dataclass(frozen=True, slots=True)
class Tables:
    """`actions[state][terminal]`: n >= 0 shifts to state n, n < 0 reduces by `rules[~n]`.

    `terminals` are (name, regular expression) in the order of precedence, `words` the reserved words.
    """

    terminals: tuple[tuple[str, str], ...]
    words: dict[str, str]
    rules: tuple[Rule, ...]
    actions: tuple[dict[str, int], ...]
    gotos: tuple[dict[str, int], ...]
    starts: dict[str, int]
    ends: dict[str, int]


@cache
def load() -> Tables:
    """The tables of the installed grammar."""
    grammar = grammar_text()
    path = _cache_path(grammar)
    plain = _read(path)
    if plain is None:
        plain = build(grammar)
        _write(path, plain)
    return _thaw(plain)


def grammar_text() -> str:
    return (resources.folder("grammar") / "blobscript.lark").read_text(encoding="utf-8")


# ---- building -------------------------------------------------------------------------


def build(grammar: str) -> dict[str, Any]:
    """Tables as plain lists and dictionaries. Raises lark's GrammarError for a grammar with conflicts."""
    from lark import Lark

    parser = Lark(grammar, parser="lalr", lexer="basic", start=list(STARTS))
    table = _parse_table(parser)
    rules: dict[Any, int] = {}
    actions: list[dict[str, int]] = []
    gotos: list[dict[str, int]] = []
    for state in range(len(table.states)):
        row: dict[str, int] = {}
        jumps: dict[str, int] = {}
        for symbol, (kind, target) in table.states[state].items():
            if symbol in _nonterminals(parser):
                jumps[symbol] = target
            elif kind.name == "Shift":
                row[symbol] = target
            else:
                row[symbol] = ~rules.setdefault(target, len(rules))
        actions.append(row)
        gotos.append(jumps)
    words = {t.pattern.value: t.name for t in parser.terminals if re.fullmatch("[a-z]+", t.pattern.value)}
    return {
        "terminals": [[t.name, t.pattern.to_regexp()] for t in _ordered(parser) if t.pattern.value not in words],
        "words": words,
        "rules": [_plain_rule(rule) for rule in rules],
        "actions": actions,
        "gotos": gotos,
        "starts": dict(table.start_states),
        "ends": dict(table.end_states),
    }


def _parse_table(parser: Any) -> Any:
    return parser.parser.parser._parse_table


def _nonterminals(parser: Any) -> set[str]:
    return {str(rule.origin.name) for rule in parser.rules}


def _ordered(parser: Any) -> list[Any]:
    """Terminals in the order in which lark tries them."""
    return sorted(parser.terminals, key=lambda t: (-t.priority, -t.pattern.max_width, -len(t.pattern.value), t.name))


def _plain_rule(rule: Any) -> list[Any]:
    """[origin, size, action, picks, unit] of a lark rule (whose optional parts are written out)."""
    origin = str(rule.origin.name)
    absent = rule.options.empty_indices or (False,) * len(rule.expansion)
    picks: list[Pick] = []
    index = 0
    for missing in absent:
        if missing:
            picks.append((-1, False))
            continue
        symbol = rule.expansion[index]
        if not (symbol.is_term and symbol.filter_out):
            picks.append((index, not symbol.is_term and symbol.name.startswith("__")))
        index += 1
    unit = bool(rule.options.expand1) and not rule.alias and len(rule.expansion) == 1
    action = "" if origin.startswith("__") else str(rule.alias or origin)
    return [origin, len(rule.expansion), action, picks, unit]


def _thaw(plain: dict[str, Any]) -> Tables:
    return Tables(
        terminals=tuple((name, pattern) for name, pattern in plain["terminals"]),
        words=plain["words"],
        rules=tuple(
            Rule(
                sys.intern(origin),
                size,
                action,
                tuple((i, splice) for i, splice in picks),
                unit,
                whole=picks == [[i, False] for i in range(size)],
            )
            for origin, size, action, picks, unit in plain["rules"]
        ),
        actions=tuple(plain["actions"]),
        gotos=tuple(plain["gotos"]),
        starts=plain["starts"],
        ends=plain["ends"],
    )


# ---- the cache on disk ------------------------------------------------------------------


def _cache_path(grammar: str) -> Path:
    """The file name says what the tables were made from and by; this module is a part of that."""
    folder = os.environ.get("BLOBSCRIPT_CACHE") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    makers = (grammar, _lark_version(), sys.version, Path(__file__).read_text(encoding="utf-8"))
    name = hashlib.sha256("\0".join(makers).encode()).hexdigest()[:24]
    try:
        return Path(folder).expanduser() / "blobscript" / f"tables-{name}.json"
    except RuntimeError:  # no home directory
        return Path(os.devnull) / name


def _lark_version() -> str:
    """Of the lark that would be imported, without importing it."""
    spec = find_spec("lark")
    if spec is None or spec.origin is None:
        return "unknown"
    return Path(spec.origin).read_text(encoding="utf-8")


def _read(path: Path) -> dict[str, Any] | None:
    """The kept tables, or None where there are none that are whole."""
    try:
        check, _, text = path.read_bytes().partition(b"\n")
        if hashlib.sha256(text).hexdigest().encode() == check:
            return json.loads(text)
    except (OSError, ValueError):
        pass
    return None


def _write(path: Path, plain: dict[str, Any]) -> None:
    import tempfile  # 10 ms, needed once

    text = json.dumps(plain, separators=(",", ":")).encode()
    beside = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, beside = tempfile.mkstemp(dir=path.parent, prefix=path.stem)
        with os.fdopen(handle, "wb") as file:
            file.write(hashlib.sha256(text).hexdigest().encode() + b"\n" + text)
        os.replace(beside, path)
    except OSError:
        if beside:
            Path(beside).unlink(missing_ok=True)
