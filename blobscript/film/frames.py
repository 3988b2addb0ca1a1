"""Finished frames of a film in a folder beside it: kept over interruptions, taken again if they are right."""

from __future__ import annotations

import contextlib
from pathlib import Path

from blobscript.images import Image, ReadError, read
from blobscript.outputs import WriteError

__all__ = ["FrameFolder"]

#: Under this name a frame's file says what it shows.
_KEY = "frame"


class FrameFolder:
    """`film.gif` has its frames in `film.frames/00000.png`, …"""

    def __init__(self, film: Path) -> None:
        self.path = film.with_suffix(".frames")

    def file(self, number: int) -> Path:
        return self.path / f"{number:05}.png"

    def create(self) -> None:
        """Raises WriteError (E0802)."""
        try:
            self.path.mkdir(exist_ok=True)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise WriteError(
                reason, self.path, "write the film to a folder that exists and that you may write to"
            ) from error

    def has(self, number: int, key: str) -> bool:
        """Is the frame there, whole, and does it show what `key` names? Every pixel is read."""
        if not self.file(number).is_file():
            return False
        with contextlib.suppress(ReadError):
            return read(self.file(number)).metadata.get(_KEY) == key
        return False

    def put(self, number: int, key: str, image: Image) -> None:
        """Whole or not at all. Raises WriteError."""
        image.metadata[_KEY] = key
        image.save(self.file(number))

    def remove(self, numbers: list[int]) -> None:
        """These frames, and the folder if nothing else is in it."""
        for number in numbers:
            self.file(number).unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.path.rmdir()
