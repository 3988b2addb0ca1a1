"""GIF films, through OpenImageIO: 256 colours a frame, dithered."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from blobscript.film.codes import codes

__all__ = ["shown_fps", "write_gif"]


def write_gif(path: Path, frames: Sequence[Path], fps: float, told: Callable[[int], None]) -> None:
    """`told` gets the number of frames written so far. Raises OSError."""
    import OpenImageIO as oiio  # noqa: N813 - its own spelling

    output: Any = oiio.ImageOutput.create("gif")
    if output is None:
        raise OSError("this OpenImageIO was built without GIF")
    first = codes(frames[0])
    spec = oiio.ImageSpec(first.shape[1], first.shape[0], 3, "uint8")
    spec.attribute("oiio:Movie", 1)
    spec.attribute("FramesPerSecond", "rational", (round(100 * shown_fps(fps)), 100))
    _check(output.open(str(path), [spec] * len(frames)), output)
    for number, frame in enumerate(frames):
        if number:
            _check(output.open(str(path), spec, "AppendSubimage"), output)
        _check(output.write_image(codes(frame)), output)
        told(number + 1)
    _check(output.close(), output)
    _verify(oiio, path, len(frames))


def shown_fps(fps: float) -> float:
    """The tempo that the format can hold: a frame lasts whole hundredths of a second, at least two of them."""
    return 100 / max(2, round(100 / fps))


def _check(fine: bool, output: Any) -> None:
    if not fine:
        raise OSError(str(output.geterror()).strip() or "the system refuses")


def _verify(oiio: Any, path: Path, count: int) -> None:
    """The writer does not notice a full disk: what is there is read again."""
    source = oiio.ImageInput.open(str(path))
    whole = source is not None and source.seek_subimage(count - 1, 0) and source.read_image("uint8") is not None
    if source is not None:
        source.close()
    if not whole:
        oiio.geterror()
        raise OSError("the file is not whole; is the disk full?")
