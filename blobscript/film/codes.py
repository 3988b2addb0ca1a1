"""Frames as the bytes that films hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blobscript.images import read, srgb_encode

__all__ = ["codes"]


def codes(frame: Path) -> NDArray[np.uint8]:
    """sRGB, (h, w, 3); where a frame is transparent, white shows. Raises ReadError."""
    rgba = read(frame).rgba
    opaque = rgba[:, :, :3] + (1 - rgba[:, :, 3:])
    return np.rint(srgb_encode(opaque) * 255).astype(np.uint8)
