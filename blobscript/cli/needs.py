"""`blobscript info --needs`: what a scene needs, each with the line that causes it, and what it does not need."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from blobscript.source import Span

if TYPE_CHECKING:
    from blobscript.needs import LeftOut, Need
    from blobscript.scene import Scene

__all__ = ["print_needs"]


def print_needs(scene: Scene, arguments: argparse.Namespace) -> int:
    from blobscript.needs import needs_of

    needs, left_out = needs_of(scene.trimmed.scene), scene.trimmed.left_out
    if arguments.format == "json":
        print(json.dumps(_facts(arguments.file, needs, left_out), indent=1, ensure_ascii=False))
        return 0
    print(f"{arguments.file} needs:")
    for line in _need_lines(needs):
        print(f"    {line}")
    print("left out:" if left_out else "nothing is left out: all of the scene is needed")
    for part in left_out:
        where = f" ({_where(part.span)})" if part.span else ""
        print(f"    {part.count} {_plural(part)}: {part.why}{where}")
    return 0


def _facts(path: str, needs: tuple[Need, ...], left_out: tuple[LeftOut, ...]) -> dict[str, object]:
    return {
        "file": path,
        "needs": [
            {"name": need.name, "meaning": need.meaning, "count": need.count, **_place(need.span)} for need in needs
        ],
        "left_out": [
            {"what": part.what, "count": part.count, "why": part.why, **_place(part.span)} for part in left_out
        ],
    }


def _place(span: Span | None) -> dict[str, object]:
    if span is None:
        return {"path": None, "line": None, "column": None, "text": None}
    return {"path": span.source.path, "line": span.line, "column": span.column, "text": _code(span)}


def _need_lines(needs: tuple[Need, ...]) -> list[str]:
    """Name, how often, meaning, and where: in columns."""
    width = max((len(need.name) for need in needs), default=0)
    lines: list[str] = []
    for need in needs:
        where = f"{_where(need.span)}  {_code(need.span)}" if need.span else "(by default)"
        lines += [f"{need.name:<{width}}  {need.meaning}", f"{'':<{width}}  {need.count:>5} x  {where}"]
    return lines


def _plural(part: LeftOut) -> str:
    return part.what if part.count != 1 else part.what.removesuffix("s")


def _where(span: Span) -> str:
    return f"{span.source.path}:{span.line}"


def _code(span: Span) -> str:
    """The line of the script, cut where it gets long."""
    text = span.source.line(span.line).strip()
    return text if len(text) <= 60 else text[:59] + "…"
