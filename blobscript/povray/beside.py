"""The files that go with a scene's text, under names that are safe in it."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

__all__ = ["Beside"]

#: Samples along the longest side of a surface that is sampled.
_GRID = 200


@dataclass(slots=True)
class Beside:
    """The files that go with a text: `stem` starts their names, `files` holds them. grid: samples along
    the longest side of one."""

    stem: str
    grid: int = _GRID
    files: dict[str, bytes] = field(default_factory=dict[str, bytes])

    def add(self, kind: str, ending: str, data: bytes) -> str:
        """The name of a new file: letters, digits, - and _ only, but for its ending."""
        stem = re.sub(r"[^A-Za-z0-9_-]", "_", self.stem)[:60] or "scene"
        name = f"{stem}-{kind}-{1 + len(self.files)}.{ending}"
        self.files[name] = data
        return name
