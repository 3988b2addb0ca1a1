"""The editors' grammars on all scripts: nothing unknown, and words are what the parser takes them for."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import pytest
from pygments.token import Comment, Error, Keyword, Name, Number, Operator, String
from syntax.scripts import named, scripts

from blobscript import lex as lexing
from blobscript import words
from blobscript.resources import folder
from blobscript.source import Source

GRAMMAR = folder("grammar")


def module(name: str):
    spec = importlib.util.spec_from_file_location(name, GRAMMAR / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


LEXER = module("blobscript_pygments").BlobscriptLexer(stripnl=False, ensurenl=False)
RULES = json.loads((GRAMMAR / "blobscript.tmLanguage.json").read_text(encoding="utf-8"))


def test_written_from_the_tables(capsys) -> None:
    assert module("generate").main(["--check"]) == 0, capsys.readouterr().out


def words_of(text: str) -> list[tuple[int, str]]:
    """(offset, kind) of the parser's words outside of texts."""
    return [(token.start, token.kind) for token in lexing.lex(Source("t.blob", text)).tokens]


@pytest.mark.parametrize("path", scripts(), ids=named)
def test_pygments(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    found = list(LEXER.get_tokens_unprocessed(text))
    assert "".join(value for _, _, value in found) == text
    assert not [(offset, value) for offset, kind, value in found if kind in Error]
    kinds = {offset: kind for offset, kind, _ in found}
    for offset, kind in words_of(text):
        if kind in {word.upper() for word in words.RESERVED}:
            assert kinds[offset] in Keyword or kinds[offset] in Operator.Word, (offset, kind)
        elif kind == "NAME":
            assert kinds[offset] in Name or kinds[offset] in Keyword.Type, (offset, text[offset : offset + 9])
        elif kind in ("NUMBER", "ANGLE", "COLOR"):
            assert kinds[offset] in Number
        elif kind == "STRING":
            assert kinds[offset] in String
    assert sum(kind in Comment for kind in kinds.values()) == len(
        re.findall(r"//[^\n]*", re.sub(r'"[^"\n]*"', "", text))
    )


# ---- TextMate ---------------------------------------------------------------------------------------


def scopes(text: str) -> list[tuple[int, int, str]]:
    """(start, end, scope) by a small reader of TextMate rules: line after line, as editors do."""
    out: list[tuple[int, int, str]] = []
    stack: list[dict] = [RULES]
    offset = 0
    for line in text.splitlines(keepends=True):
        _line(line, offset, stack, out)
        offset += len(line)
    return out


def _line(line: str, offset: int, stack: list[dict], out: list[tuple[int, int, str]]) -> None:
    at = 0
    while at < len(line):
        rule = stack[-1]
        found = re.compile(rule["end"]).search(line, at) if "end" in rule else None
        best, hit = rule, found
        for inner in _flat(rule["patterns"]):
            match = re.compile(inner.get("match") or inner["begin"], re.MULTILINE).search(line, at)
            if match and (hit is None or match.start() < hit.start()):
                best, hit = inner, match
        if hit is None:
            return
        if best is rule:
            stack.pop()
        elif "begin" in best:
            stack.append(best)
        out.append((offset + hit.start(), offset + hit.end(), best.get("name", "")))
        for number, capture in best.get("captures", {}).items():
            out.append((offset + hit.start(int(number)), offset + hit.end(int(number)), capture["name"]))
        if hit.end() == at and best is not rule:
            raise AssertionError(f"an empty match of {best}")
        at = hit.end()


def _flat(patterns: list[dict]) -> list[dict]:
    found: list[dict] = []
    for pattern in patterns:
        if "include" in pattern:
            inner = RULES["repository"][pattern["include"][1:]]
            found += [inner] if "match" in inner or "begin" in inner else _flat(inner["patterns"])
        else:
            found.append(pattern)
    return found


@pytest.mark.parametrize("path", scripts(), ids=named)
def test_textmate(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    found = scopes(text)
    covered = [False] * len(text)
    names: dict[int, set[str]] = {}
    for start, end, scope in found:
        covered[start:end] = [True] * (end - start)
        names.setdefault(start, set()).add(scope)
    for start, kind in words_of(text):
        here = " ".join(sorted(names.get(start, ())))
        if kind in {word.upper() for word in words.RESERVED}:
            assert re.search(r"keyword|constant\.language", here), (start, kind, here)
        elif kind in ("NUMBER", "ANGLE", "COLOR"):
            assert "constant" in here, (start, kind, here)
        elif kind == "STRING":
            assert "string" in here
        elif kind == "NAME":
            assert re.search(r"variable|entity|support|meta\.attribute|^$", here), (start, here)
            assert "keyword" not in here
    inside = re.compile(r'"(?:\\.|[^"\\\n])*"')
    texts = {i for match in inside.finditer(text) for i in range(*match.span())}
    missed = [i for i, sign in enumerate(text) if not covered[i] and not sign.isspace() and i not in texts]
    assert not missed, [text[i : i + 10] for i in missed[:5]]


def test_textmate_knows_the_parts() -> None:
    text = 'let a = clay(coral).b("x {a + 1}", from = 2deg) // c\n@group("A")\n'
    found = {text[start:end]: scope for start, end, scope in scopes(text)}
    assert found["let"] == "keyword.declaration.blobscript"
    assert found["clay"] == "support.function.blobscript"
    assert found["coral"] == "support.constant.blobscript"
    assert found["from"] == "variable.parameter.blobscript"
    assert found["deg"] == "keyword.other.unit.blobscript"
    assert found["+"] == "keyword.operator.blobscript"
    assert found["// c"] == "comment.line.double-slash.blobscript"
    assert found["@group"] == "meta.attribute.blobscript"
