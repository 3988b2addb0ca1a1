"""The light of examples/studio.blob: a dark room with three bright panels and a warm floor, in all directions.

python examples/data/studio.py studio.exr
"""

from __future__ import annotations

import sys

import numpy as np

from blobscript.images import Image

WIDTH, HEIGHT = 192, 96

#: Panels: middle and half width in degrees, to the right from -z and up, and linear radiance.
PANELS = (
    ((-58, 34), (24, 17), (9.0, 8.4, 7.4)),
    ((72, 20), (12, 32), (2.6, 3.6, 5.2)),
    ((172, 48), (34, 9), (5.0, 4.6, 4.4)),
)


def studio() -> np.ndarray:
    """(HEIGHT, WIDTH, 3) float32: rows from the zenith down, the middle column towards -z."""
    right = ((np.arange(WIDTH) + 0.5) / WIDTH - 0.5) * 360
    up = 90 - (np.arange(HEIGHT) + 0.5) / HEIGHT * 180
    rise = 0.5 + 0.5 * np.sin(np.radians(up))[:, None, None]
    room = (1 - rise) * (0.30, 0.24, 0.20) + rise * (0.10, 0.12, 0.16)
    light = np.repeat(room, WIDTH, axis=1)
    for (at, height), half, color in PANELS:
        off = (right - at + 180) % 360 - 180
        edges = [np.clip((h - np.abs(x)) / 4 + 0.5, 0, 1) for h, x in zip(half, (off, up - height), strict=True)]
        light += edges[1][:, None, None] * edges[0][None, :, None] * np.array(color)
    return light.astype(np.float32)


if __name__ == "__main__":
    rgba = np.ones((HEIGHT, WIDTH, 4), np.float32)
    rgba[:, :, :3] = studio()
    Image(rgba, {}, {}, "linear", 0.0, {}).save(sys.argv[1], 16)
