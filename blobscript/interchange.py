"""Diagnostics for programs: JSON as the language's design writes it, and SARIF 2.1.0."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import PurePath
from typing import Any
from urllib.parse import quote

from blobscript.diagnostics import CODES, Diagnostic, Edit, Help
from blobscript.source import Span

__all__ = ["to_json", "to_sarif"]


def to_json(diagnostics: Iterable[Diagnostic]) -> str:
    """`{"diagnostics": [...]}`; lines and columns are 1-based, `end_column` is behind the last character."""
    return json.dumps({"diagnostics": [_plain(d) for d in diagnostics]}, indent=2, ensure_ascii=False) + "\n"


def _plain(diagnostic: Diagnostic) -> dict[str, Any]:
    """Without a place, line and column are null."""
    labels = [{"text": label.text, **_place(label.span)} for label in diagnostic.labels]
    if diagnostic.span and diagnostic.label:
        labels.insert(0, {"text": diagnostic.label, **_place(diagnostic.span)})
    nowhere = dict.fromkeys(("line", "column", "end_line", "end_column"))
    return {
        "code": diagnostic.code,
        "severity": diagnostic.severity,
        "message": diagnostic.message,
        **(_place(diagnostic.span) if diagnostic.span else {"path": diagnostic.path or None, **nowhere}),
        "labels": labels,
        "help": [_plain_help(help_) for help_ in diagnostic.helps],
        "notes": list(diagnostic.notes),
    }


def _place(span: Span) -> dict[str, Any]:
    end_line, end_column = span.end_position
    return {
        "path": span.source.path,
        "line": span.line,
        "column": span.column,
        "end_line": end_line,
        "end_column": end_column,
    }


def _plain_help(help_: Help) -> dict[str, Any]:
    edits = [{**_place(edit.span), "replacement": edit.replacement} for edit in help_.edits]
    return {"text": help_.text, "certainty": help_.certainty if edits else None, "edits": edits}


# ---- SARIF ------------------------------------------------------------------------------------


def to_sarif(diagnostics: Iterable[Diagnostic], version: str = "") -> str:
    """A SARIF log with one run; every code is a rule, edits are fixes."""
    codes = list(CODES)
    driver = {
        "name": "blobscript",
        **({"semanticVersion": version} if version else {}),
        "rules": [_rule(code) for code in codes],
    }
    log = {
        "$schema": "https://json.schemastore.org/sarif-2.1.0.json",
        "version": "2.1.0",
        "runs": [
            {
                "tool": {"driver": driver},
                "columnKind": "unicodeCodePoints",
                "results": [_result(d, codes) for d in diagnostics],
            }
        ],
    }
    return json.dumps(log, indent=2, ensure_ascii=False) + "\n"


def _rule(code: str) -> dict[str, Any]:
    level = {"E": "error", "W": "warning", "N": "note"}[code[0]]
    return {
        "id": code,
        "shortDescription": {"text": CODES[code]},
        "help": {"text": f"blobscript explain {code}"},
        "defaultConfiguration": {"level": level},
    }


def _result(diagnostic: Diagnostic, codes: list[str]) -> dict[str, Any]:
    text = f"{diagnostic.message}: {diagnostic.label}" if diagnostic.label else diagnostic.message
    result: dict[str, Any] = {
        "ruleId": diagnostic.code,
        "ruleIndex": codes.index(diagnostic.code),
        "level": diagnostic.severity,
        "message": {"text": text},
        "locations": [],
    }
    if diagnostic.span:
        result["locations"] = [{"physicalLocation": _physical(diagnostic.span)}]
    elif diagnostic.path:
        result["locations"] = [{"physicalLocation": {"artifactLocation": _artifact(diagnostic.path)}}]
    if diagnostic.labels:
        result["relatedLocations"] = [
            {"id": number, "physicalLocation": _physical(label.span), "message": {"text": label.text}}
            for number, label in enumerate(diagnostic.labels, 1)
        ]
    fixes = [_fix(help_) for help_ in diagnostic.helps if help_.edits]
    if fixes:
        result["fixes"] = fixes
    return result


def _physical(span: Span) -> dict[str, Any]:
    return {"artifactLocation": _artifact(span.source.path), "region": _region(span)}


def _artifact(path: str) -> dict[str, str]:
    pure = PurePath(path)
    return {"uri": pure.as_uri() if pure.is_absolute() else quote(pure.as_posix())}  # pyright: ignore[reportDeprecated]


def _region(span: Span) -> dict[str, int]:
    place = _place(span)
    return {
        "startLine": place["line"],
        "startColumn": place["column"],
        "endLine": place["end_line"],
        "endColumn": place["end_column"],
    }


def _fix(help_: Help) -> dict[str, Any]:
    files: dict[str, list[Edit]] = {}
    for edit in help_.edits:
        files.setdefault(edit.span.source.path, []).append(edit)
    changes = [
        {
            "artifactLocation": _artifact(path),
            "replacements": [
                {"deletedRegion": _region(edit.span), "insertedContent": {"text": edit.replacement}} for edit in edits
            ],
        }
        for path, edits in files.items()
    ]
    return {"description": {"text": help_.text}, "artifactChanges": changes}
