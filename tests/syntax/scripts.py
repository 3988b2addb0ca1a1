"""What the syntax tests share: the scripts of the project, and the parser without any recovery."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from blobscript import lex as lexing
from blobscript.build import Builder
from blobscript.machine import Machine
from blobscript.parse import parse
from blobscript.resources import folder
from blobscript.source import Source, Span

DATA = Path(__file__).parent.parent / "data" / "language"


def scripts() -> list[Path]:
    """Every script that must parse: the design's scenes, the examples, the standard library."""
    return [path for base in (DATA, folder("examples"), folder("stdlib")) for path in sorted(base.rglob("*.blob"))]


def named(path: Path) -> str:
    return "/".join(path.parts[-2:])


def fits(text: str) -> bool:
    """Whether the text is right as it is: the lexer's tokens through the bare automaton."""
    source = Source("t.blob", text)
    scanned = lexing._scan(source, 0, len(text))
    if scanned.diagnostics:
        return False
    builder = Builder(source, lambda start, end: dataclasses.replace)  # type: ignore[arg-type,return-value]
    machine = Machine(source, lexing._filter(scanned.tokens), "start", builder.actions())
    return machine.run()


def shape(node: Any) -> Any:
    """A tree without its places, to compare trees."""
    if dataclasses.is_dataclass(node):
        fields = [f.name for f in dataclasses.fields(node) if f.name not in ("span", "op_span", "path_span", "source")]
        return (type(node).__name__, *(shape(getattr(node, name)) for name in fields))
    if isinstance(node, tuple):
        return tuple(shape(item) for item in node)
    return node


def spans(node: Any) -> list[Span]:
    """All spans of a tree."""
    if isinstance(node, Span):
        return [node]
    if dataclasses.is_dataclass(node) and not isinstance(node, Source):
        return [span for field in dataclasses.fields(node) for span in spans(getattr(node, field.name))]
    if isinstance(node, tuple):
        return [span for item in node for span in spans(item)]
    return []


def parsed(text: str) -> Any:
    """The tree of a text without mistakes."""
    script, diagnostics = parse(Source("t.blob", text))
    assert not diagnostics, [f"{d.line}:{d.column} {d.code} {d.message}" for d in diagnostics]
    return script
