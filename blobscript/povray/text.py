"""Numbers, vectors, names and comments as POV-Ray reads them.

Nothing of a scene becomes code: numbers are written by `number`, names are made here, and texts of the user stand
in comments only, stripped of everything that could end one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blobscript.source import Span

__all__ = ["Array", "comment", "indented", "is_similarity", "joined", "matrix", "number", "place", "vector", "vectors"]

Array = NDArray[np.float64]

_HARMLESS = re.compile(r"[^\w %.,:;()\[\]<>=+#'/^`|-]", re.ASCII)


def number(x: float) -> str:
    """The shortest text that reads back as the same double; raises ValueError for what is not finite."""
    x = float(x)
    if not math.isfinite(x):
        raise ValueError(f"POV-Ray has no number {x}")
    text = repr(x)
    return text[:-2] if text.endswith(".0") else text


def vector(v: ArrayLike) -> str:
    return "<" + ", ".join(map(number, np.asarray(v, dtype=np.float64).tolist())) + ">"


def vectors(rows: Array) -> list[str]:
    """Many at once: (n, 3) -> n texts; all must be finite."""
    if not np.isfinite(rows).all():
        raise ValueError("POV-Ray has no number for what is not finite")
    return [f"<{x!r}, {y!r}, {z!r}>" for x, y, z in rows.tolist()]


def matrix(linear: Array, offset: Array) -> str:
    """p -> linear p + offset; POV-Ray lists the images of the axes, then the offset."""
    rows = [*linear.T.ravel().tolist(), *offset.tolist()]
    return "matrix <" + ", ".join(map(number, rows)) + ">"


def is_similarity(linear: Array) -> float | None:
    """The scale of a map that keeps shapes (mirrors, too); None for others."""
    gram = linear.T @ linear
    square = float(np.trace(gram)) / 3.0
    return math.sqrt(square) if np.abs(gram - square * np.eye(3)).max() <= 1e-14 * square else None


def comment(text: str) -> str:
    """A comment line. What could end it or confuse a reader is replaced."""
    return "// " + _HARMLESS.sub("?", text.replace("\n", " ").strip())


def place(span: Span | None) -> str:
    """`hello.blob:4`, the file without its folder."""
    return f"{re.split(r'[/]', span.source.path)[-1]}:{span.line}" if span else "blobscript"


def indented(lines: Iterable[str], depth: int = 1) -> list[str]:
    return ["  " * depth + line for line in lines]


def joined(parts: Sequence[str], separator: str, width: int = 110) -> list[str]:
    """The parts with a separator between them, on as few lines as fit."""
    lines = [""]
    for i, part in enumerate(parts):
        word = part + (separator if i + 1 < len(parts) else "")
        if lines[-1] and len(lines[-1]) + len(word) > width:
            lines.append("")
        lines[-1] += word
    return lines
