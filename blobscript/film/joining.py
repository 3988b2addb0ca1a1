"""Frames in, a film out; by the ending of its name."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Callable, Sequence
from pathlib import Path

from blobscript.film.apng import write_apng
from blobscript.film.gif import shown_fps, write_gif
from blobscript.film.video import check_video, write_video
from blobscript.images import FormatError, WriteError

__all__ = ["ENDINGS", "check_film", "join", "tempo_note"]

ENDINGS = (".gif", ".png", ".apng", ".mp4", ".webm")
_VIDEO = (".mp4", ".webm")


def check_film(path: Path, width: int, height: int) -> None:
    """Raises what `join` would raise, before a frame is there: FormatError, WriteError, MissingError."""
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        what = f"{path.suffix} is no film format" if path.suffix else "a film needs an ending that names its format"
        raise FormatError(what, path, f"use {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}")
    if path.is_dir():
        raise WriteError("it is a folder", path, "give a file name in it")
    if not path.resolve().parent.is_dir():
        raise WriteError(f"there is no folder `{path.parent}`", path, f"create `{path.parent}` first")
    if ending in _VIDEO:
        check_video(ending)
        if width % 2 or height % 2:
            even = f"--size {width + width % 2}x{height + height % 2}"
            raise FormatError(f"{ending} films have even sides, not {width}x{height}", path, even)


def join(path: Path, frames: Sequence[Path], fps: float, told: Callable[[int], None] | None = None) -> None:
    """Writes the film whole or not at all; `told` gets the number of frames written. Raises WriteError."""
    target = Path(os.path.realpath(path))
    part = target.with_name(f".{target.stem[:80]}.{secrets.token_hex(6)}.part{target.suffix.lower()}")
    try:
        _write(part, frames, fps, told or (lambda _: None))
        os.replace(part, target)
    except OSError as error:
        raise WriteError((error.strerror or str(error)).lower(), path) from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink()


def _write(part: Path, frames: Sequence[Path], fps: float, told: Callable[[int], None]) -> None:
    match part.suffix:
        case ".gif":
            write_gif(part, frames, fps, told)
        case ".png" | ".apng":
            write_apng(part, frames, fps)
        case ending:
            write_video(part, ending, frames, fps, told)


def tempo_note(path: Path, fps: float) -> str:
    """What to tell where the format cannot hold the film's tempo."""
    shown = shown_fps(fps)
    if path.suffix.lower() != ".gif" or abs(shown - fps) < 1e-6 * fps:
        return ""
    return f"a GIF holds whole hundredths of a second: it plays at {shown:.4g} frames per second instead of {fps:g}"
