"""Materials as textures of POV-Ray.

The models differ: blobscript has Oren-Nayar under a layer of microfacets (GGX), POV-Ray a diffuse term with a power of
the cosine, and highlights of Blinn. What a texture can say exactly, it says:

- Light from the background without a lamp depends on the normal and the eye only: `slope` knows the one, `aoi` the
  other, and a table over both, as emission, stands for it.
- The base gets what the layer leaves, which depends on the angle towards the eye: a table of `aoi`.

The rest is fitted: see `_diffuse` and `_highlight`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from blobscript import ir
from blobscript.backends import picture
from blobscript.povray.text import Array, comment, number, vector
from blobscript.povray.view import gradient

__all__ = ["look_text"]

#: Steps of the tables over n.y and over n.v.
_SLOPES, _ANGLES = 9, 9


def look_text(name: str, material: ir.Material, scene: ir.Scene, eye: Array, unit: float) -> list[str]:
    """`#declare name = texture { … }`; eye: unit vector from the scene to the camera."""
    lit, glow = _lit(material, unit), _glow(material, scene, eye)
    shown = f"{material.name or 'material'}: roughness {number(material.roughness)}"
    return [
        comment(shown),
        f"#declare {name} = texture {{ average texture_map {{",
        *(f"  {line}" for line in ["[1", *lit, "]", "[1", *glow, "]"]),
        "} }",
    ]


# ---- the layer and the base, as in tracer/brdf.h -------------------------------------------


def _f0(m: ir.Material) -> Array:
    plain = 0.08 * m.specular
    through = _through(m)
    base = plain + (np.array(m.color) - plain) * m.metalness
    glass = ((m.ior - 1) / (m.ior + 1)) ** 2
    return base + (glass - base) * through


def _through(m: ir.Material) -> float:
    return m.transmission * (1 - m.metalness)


def _layer(m: ir.Material, nv: float) -> Array:
    """Share of the light from everywhere that the layer sends to the eye (Karis 2014)."""
    x, y = 1 - m.roughness, 0.0425 - 0.0275 * m.roughness
    a004 = min(x * x, 2.0 ** (-9.28 * nv)) * x + y
    scale = -1.04 * a004 + 1.04 - 0.572 * m.roughness
    offset = max(1.04 * a004 - 0.04 + 0.022 * m.roughness, 0.0)
    return np.minimum(_f0(m) * scale + offset, 1.0)


def _base(m: ir.Material, nv: float) -> Array:
    return (1 - m.metalness) * (1 - m.transmission) * np.array(m.color) * (1 - _layer(m, nv))


# ---- what lamps do ---------------------------------------------------------------------------


def _lit(m: ir.Material, unit: float) -> list[str]:
    """Twice what is meant: the average of two textures is half of their sum."""
    sigma = m.roughness / 2
    level = 1 / (math.pi + (math.pi / 2 - 2 / 3) * sigma)
    strength, width = _highlight(m)
    diffuse = 2 * level * (1 - m.reflection)
    transmit = _through(m) * (1 - m.reflection)
    lines = ["pigment { " + _by_angle(lambda nv: _base(m, nv) * (1 - transmit)) + " }"]
    finish = [f"ambient 0 diffuse {number(round(diffuse, 6))}"]
    finish.append(f"specular {number(round(2 * strength, 6))} roughness {number(round(width, 6))}")
    return [*lines, "finish { " + " ".join(finish) + " }"]


def _highlight(m: ir.Material) -> tuple[float, float]:
    """Height and POV-Ray's roughness of GGX's lobe, seen and lit from the front: D V F there is F0 / (4 pi a^2), and
    near its middle D falls like (N.H)^(2 / a^2) does."""
    alpha = max(m.roughness**2, 0.03)
    height = float(np.mean(_f0(m))) / (4 * math.pi * alpha**2)
    return height, alpha**2 / 2


# ---- what the background does --------------------------------------------------------------


def _glow(m: ir.Material, scene: ir.Scene, eye: Array) -> list[str]:
    """Emission by n.y (outside) and n.v (inside)."""
    above, below = gradient(scene.background)
    sky = _Sky(above, below)
    lines: list[str] = []
    for k in range(_SLOPES):
        place = k / (_SLOPES - 1)
        ny = math.sin((place - 0.5) * math.pi)
        table = _by_angle(lambda nv, ny=ny: 2 * sky.glow(m, ny, nv, float(eye[1])))
        lines.append(f"  [{number(round(place, 6))} {table}]")
    return [
        "pigment { slope { y } pigment_map {",
        *lines,
        "} }",
        "finish { ambient 0 diffuse 0 emission 1 }",
    ]


class _Sky:
    """The background as light on rough surfaces."""

    def __init__(self, above: Array, below: Array) -> None:
        self.above, self.below = above, below
        y = (np.arange(4096) + 0.5) / 2048 - 1
        share = self._share(y)
        mean, slope = float(np.mean(share)), 3 * float(np.mean(share * y))
        self.ambient, self.tilt = below + (above - below) * mean, (above - below) * slope * (2 / 3)

    def _share(self, y: Array) -> Array:
        rise = y - picture.LEVEL
        return (1 + rise / np.hypot(rise, picture.BEND)) / 2

    def glow(self, m: ir.Material, ny: float, nv: float, vy: float) -> Array:
        """Emission, base and layer under the background's light."""
        ry = min(max(2 * nv * ny - vy, -1.0), 1.0)
        even = self.ambient + self.tilt * ry
        sharp_sky = self.below + (self.above - self.below) * float(self._share(np.array([ry]))[0])
        blurred = sharp_sky + (even - sharp_sky) * m.roughness
        sharp = m.metalness * (1 - m.roughness) ** 2
        kept = (1 - m.reflection) * (1 - sharp) * (1 - _through(m))
        fill = picture.FILL + (1 - picture.FILL) * m.metalness
        base = (1 - m.reflection) * picture.FILL * _base(m, nv) * (self.ambient + self.tilt * ny)
        return np.array(m.emission) + base + kept * fill * _layer(m, nv) * blurred


def _by_angle(color: Callable[[float], Array]) -> str:
    """A colour as a function of n.v. POV-Ray's `aoi` is 1/2 where the surface is seen from the side and 1 where it is
    seen from the front, in between by the angle."""
    entries: list[str] = []
    for k in range(_ANGLES):
        place = 0.5 + 0.5 * k / (_ANGLES - 1)
        nv = math.sin((place - 0.5) * math.pi)
        entries.append(f"[{number(round(place, 6))} rgb {vector(np.round(color(max(nv, 1e-3)), 6))}]")
    return "aoi color_map { " + " ".join(entries) + " }"
