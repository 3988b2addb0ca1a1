"""Writes the editors' grammars from the tables of words that the compiler uses.

python grammar/generate.py           write blobscript.tmLanguage.json and the words of blobscript_pygments.py
python grammar/generate.py --check   only say whether they are up to date (exit code 1 if not)
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from blobscript import words
from blobscript.css import CSS_COLORS
from blobscript.signatures import BUILTINS, TYPE_NAMES

HERE = Path(__file__).parent
BEGIN, END = "# --- words, written by generate.py ---\n", "# --- end of words ---\n"


def lists() -> dict[str, tuple[str, ...]]:
    """Kind of word -> the words. `kernel` is reserved only before a name, which has a rule of its own."""
    builtins = BUILTINS.values() if isinstance(BUILTINS, dict) else BUILTINS
    functions = {b.name for b in builtins if b.signatures}
    values = {b.name for b in builtins if not b.signatures} | set(CSS_COLORS)
    return {
        "DECLARATIONS": tuple(word for word in words.DECLARATIONS if word != "kernel"),
        "STATEMENTS": words.STATEMENTS,
        "OPERATORS": words.OPERATOR_WORDS,
        "CONSTANTS": words.CONSTANTS,
        "UNITS": words.UNITS,
        "TYPES": tuple(sorted(TYPE_NAMES)),
        "FUNCTIONS": tuple(sorted(functions)),
        "VALUES": tuple(sorted(values - functions)),
    }


def _any(names: tuple[str, ...]) -> str:
    return r"\b(?:" + "|".join(sorted(names, key=lambda name: (-len(name), name))) + r")\b"


def textmate() -> str:
    """The TextMate grammar. Its expressions keep to what Oniguruma and Python's `re` read alike."""
    w = lists()
    not_label = r"(?!\s*=(?!=))"
    name = r"[A-Za-z_][A-Za-z0-9_]*"
    number = r"[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?"
    repository = {
        "comment": {
            "patterns": [
                {"name": "comment.line.documentation.blobscript", "match": r"///[^\n]*"},
                {"name": "comment.line.double-slash.blobscript", "match": r"//[^\n]*"},
            ]
        },
        "text": {
            "name": "string.quoted.double.blobscript",
            "begin": '"',
            "end": r'"|$',
            "patterns": [
                {"name": "constant.character.escape.blobscript", "match": r"\\."},
                {
                    "name": "meta.interpolation.blobscript",
                    "begin": r"\{",
                    "end": r'\}|(?=["\n])',
                    "beginCaptures": {"0": {"name": "punctuation.section.interpolation.begin.blobscript"}},
                    "endCaptures": {"0": {"name": "punctuation.section.interpolation.end.blobscript"}},
                    "patterns": [{"include": "#expression"}],
                },
            ],
        },
        "definition": {
            "patterns": [
                {
                    "match": rf"\b(fn|kernel)\s+({name})",
                    "captures": {
                        "1": {"name": "keyword.declaration.blobscript"},
                        "2": {"name": "entity.name.function.blobscript"},
                    },
                },
                {
                    "match": rf"\b(type)\s+({name})",
                    "captures": {
                        "1": {"name": "keyword.declaration.blobscript"},
                        "2": {"name": "entity.name.type.blobscript"},
                    },
                },
                {
                    "match": rf"\b(let|param)\s+({name})",
                    "captures": {
                        "1": {"name": "keyword.declaration.blobscript"},
                        "2": {"name": "variable.other.definition.blobscript"},
                    },
                },
                {"name": "meta.attribute.blobscript", "match": rf"@\s*{name}"},
                {"name": "keyword.declaration.blobscript", "match": r"^\s*blobscript(?=\s+[0-9])"},
            ]
        },
        "number": {
            "patterns": [
                {
                    "match": rf"({number})({'|'.join(w['UNITS'])})\b",
                    "captures": {
                        "1": {"name": "constant.numeric.blobscript"},
                        "2": {"name": "keyword.other.unit.blobscript"},
                    },
                },
                {"name": "constant.numeric.blobscript", "match": rf"{number}\b"},
                {
                    "name": "constant.other.color.blobscript",
                    "match": r"#(?:[0-9a-fA-F]{8}|[0-9a-fA-F]{6}|[0-9a-fA-F]{3})\b",
                },
            ]
        },
        "word": {
            "patterns": [
                {
                    "match": rf"(\.)\s*({name})(?=\s*\()",
                    "captures": {"2": {"name": "entity.name.function.member.blobscript"}},
                },
                {"match": rf"(\.)\s*({name})", "captures": {"2": {"name": "variable.other.member.blobscript"}}},
                {"name": "keyword.declaration.blobscript", "match": _any(w["DECLARATIONS"]) + not_label},
                {"name": "keyword.control.blobscript", "match": _any(w["STATEMENTS"]) + not_label},
                {"name": "keyword.operator.word.blobscript", "match": _any(w["OPERATORS"]) + not_label},
                {"name": "constant.language.blobscript", "match": _any(w["CONSTANTS"]) + not_label},
                {"name": "variable.parameter.blobscript", "match": rf"\b{name}(?=\s*=(?!=))"},
                {"name": "support.type.blobscript", "match": rf"(?<=[:>\[])(?<!=>)\s*{_any(w['TYPES'])}"},
                {"name": "support.function.blobscript", "match": _any(w["FUNCTIONS"])},
                {"name": "support.constant.blobscript", "match": _any(w["VALUES"])},
                {"name": "variable.other.blobscript", "match": rf"\b{name}\b"},
            ]
        },
        "operator": {
            "name": "keyword.operator.blobscript",
            "match": r"->|\.\.\.|\.\.<?|==|!=|<=|>=|[-+*/^<>=]",
        },
        "punctuation": {"name": "punctuation.blobscript", "match": r"[(){}\[\],:.]"},
        "expression": {
            "patterns": [
                {"include": f"#{part}"}
                for part in ("comment", "text", "definition", "number", "operator", "word", "punctuation")
            ]
        },
    }
    grammar = {
        "$schema": "https://raw.githubusercontent.com/martinring/tmlanguage/master/tmlanguage.json",
        "comment": "Written by grammar/generate.py.",
        "name": "blobscript",
        "scopeName": "source.blobscript",
        "fileTypes": ["blob"],
        "patterns": [{"include": "#expression"}],
        "repository": repository,
    }
    return json.dumps(grammar, indent=2) + "\n"


def pygments(old: str) -> str:
    """The Pygments lexer with the lists of words between its marks written anew."""
    head, rest = old.split(BEGIN)
    _, tail = rest.split(END)
    rows = []
    for kind, names in lists().items():
        rows.append(f'{kind} = """\n')
        line = "   "
        for name in names:
            if len(line) + len(name) > 110:
                rows.append(line + "\n")
                line = "   "
            line += f" {name}"
        rows.append(line + '\n""".split()\n')
    return head + BEGIN + "".join(rows) + END + tail


def main(arguments: list[str]) -> int:
    lexer = HERE / "blobscript_pygments.py"
    wanted = {
        HERE / "blobscript.tmLanguage.json": textmate(),
        lexer: pygments(lexer.read_text(encoding="utf-8")),
    }
    stale = [path for path, text in wanted.items() if not path.exists() or path.read_text(encoding="utf-8") != text]
    for path in stale:
        if "--check" in arguments:
            print(f"{path.name} is not up to date: python grammar/generate.py")
        else:
            path.write_text(wanted[path], encoding="utf-8")
            print(f"wrote {path.name}")
    return 1 if stale and "--check" in arguments else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
