"""Animated PNG from the chunks of PNG frames: no pixel is touched, the film is as exact as its frames.

PNG specification (third edition, W3C 2025), sections 11.2 and 11.3.6: acTL, fcTL and fdAT chunks.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

__all__ = ["write_apng"]

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def write_apng(path: Path, frames: Sequence[Path], fps: float) -> None:
    """All frames are PNG files of one size and kind; the film repeats for ever. Raises OSError, ValueError."""
    with open(path, "wb") as out:
        out.write(_SIGNATURE)
        first = list(_chunks(frames[0]))
        pixels = next(i for i, (kind, _) in enumerate(first) if kind == b"IDAT")
        header = first[0][1]
        _put(out, b"IHDR", header)
        _put(out, b"acTL", struct.pack(">II", len(frames), 0))
        for kind, data in first[1:pixels]:
            _put(out, kind, data)
        number = 0
        for frame in frames:
            number = _put_frame(out, frame, header, _delay(fps), number)
        _put(out, b"IEND", b"")


def _put_frame(out: BinaryIO, frame: Path, header: bytes, delay: tuple[int, int], number: int) -> int:
    """Writes one frame; `number` counts the chunks of the animation, the next one is returned."""
    width, height = struct.unpack(">II", header[:8])
    replaces, over_all = 0, 0
    _put(out, b"fcTL", struct.pack(">IIIIIHHBB", number, width, height, 0, 0, *delay, replaces, over_all))
    first = number == 0
    number += 1
    for kind, data in _chunks(frame):
        if kind == b"IHDR" and data != header:
            raise ValueError(f"`{frame}` is not of the size and kind of the first frame")
        if kind == b"IDAT":
            _put(out, *((b"IDAT", data) if first else (b"fdAT", struct.pack(">I", number) + data)))
            number += 0 if first else 1
    return number


def _delay(fps: float) -> tuple[int, int]:
    """Seconds between two frames, as a fraction of two 16-bit numbers."""
    seconds = (1 / Fraction(fps)).limit_denominator(65_535)
    if not 0 < seconds.numerator <= 65_535:
        raise ValueError(f"a PNG film cannot have {fps:g} frames per second")
    return seconds.numerator, seconds.denominator


def _chunks(path: Path) -> Iterator[tuple[bytes, bytes]]:
    data = path.read_bytes()
    at = len(_SIGNATURE)
    while at < len(data):
        (length,) = struct.unpack_from(">I", data, at)
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        at += length + 12


def _put(out: BinaryIO, kind: bytes, data: bytes) -> None:
    out.write(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))
