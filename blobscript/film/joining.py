"""Frames in, a film out; by the ending of its name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from blobscript.film.apng import write_apng
from blobscript.film.gif import shown_fps, write_gif
from blobscript.film.video import check_video, write_video
from blobscript.outputs import FormatError, check_ending, check_output, pending

__all__ = ["ENDINGS", "check_film", "join", "tempo_note"]

ENDINGS = (".gif", ".png", ".apng", ".mp4", ".webm")
_VIDEO = (".mp4", ".webm")


def check_film(path: Path, width: int, height: int) -> None:
    """Raises what `join` would raise, before a frame is there: FormatError, WriteError, MissingError."""
    ending = check_ending(path, "film", ENDINGS)
    check_output(path)
    if ending in _VIDEO:
        check_video(ending)
        if width % 2 or height % 2:
            even = f"--size {width + width % 2}x{height + height % 2}"
            raise FormatError(f"{ending} films have even sides, not {width}x{height}", path, even)


def join(path: Path, frames: Sequence[Path], fps: float, told: Callable[[int], None] | None = None) -> None:
    """Writes the film whole or not at all; `told` gets the number of frames written. Raises WriteError."""
    with pending(path) as part:
        match path.suffix.lower():
            case ".gif":
                write_gif(part, frames, fps, told or (lambda _: None))
            case ".png" | ".apng":
                write_apng(part, frames, fps)
            case ending:
                write_video(part, ending, frames, fps, told or (lambda _: None))


def tempo_note(path: Path, fps: float) -> str:
    """What to tell where the format cannot hold the film's tempo."""
    shown = shown_fps(fps)
    if path.suffix.lower() != ".gif" or abs(shown - fps) < 1e-6 * fps:
        return ""
    return f"a GIF holds whole hundredths of a second: it plays at {shown:.4g} frames per second instead of {fps:g}"
