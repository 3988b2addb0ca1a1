"""Lights, backgrounds, and what stands around the surfaces: floor, fog, tone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from blobscript import ir, looks
from blobscript.arguments import direction, not_negative, number, positive, show, vector
from blobscript.datafiles import located, read_bytes, unreadable
from blobscript.diagnostics import Help
from blobscript.values import (
    Background,
    Color,
    Context,
    Floor,
    Lamp,
    Maker,
    MakerError,
    Material,
    Sun,
    Vec3,
)

__all__ = ["MAKERS"]

#: Largest side of an environment; larger pictures are averaged down to it.
_LARGEST = 2048

#: Brightest radiance of an environment's pixel: what photographs of the sun reach.
_BRIGHTEST = 1e6

# ---- lights ----------------------------------------------------------------------------


def _light_color(color: Color | None, strength: float) -> Vec3:
    factor = not_negative(strength, "strength", "0 switches a light off")
    r, g, b = color.rgb if color else (1.0, 1.0, 1.0)
    return r * factor, g * factor, b * factor


def _sun(
    ctx: Context, toward: Vec3, color: Color | None = None, strength: float = 1.0, angle: float = ir.SUN_ANGLE
) -> Sun:
    if not 0 <= number(angle, "angle") <= math.pi:
        shown = show(math.degrees(angle))
        helps = (Help("0.53deg is the sun, 10deg a large soft light"),)
        raise MakerError("E0405", f"`angle` must lie between 0deg and 180deg, but it is {shown}deg", "angle", "", helps)
    return Sun(direction(toward, "toward"), _light_color(color, strength), float(angle))


def _lamp(ctx: Context, at: Vec3, color: Color | None = None, strength: float = 1.0, size: float = 0.0) -> Lamp:
    return Lamp(
        vector(at, "at"), _light_color(color, strength), not_negative(size, "size", "0 is a point, with hard shadows")
    )


# ---- backgrounds -----------------------------------------------------------------------


def _background(ctx: Context, color: Color) -> Background:
    return Background(color.rgb)


_ZENITH, _HORIZON, _GROUND = ((0x6F, 0xA3, 0xDC), (0xE6, 0xEE, 0xF5), (0x8A, 0x86, 0x80))


def _sky(
    ctx: Context,
    zenith: Color | None = None,
    horizon: Color | None = None,
    ground: Color | None = None,
    strength: float = 1.0,
    shown: Color | None = None,
) -> Background:
    defaults = [Color.from_srgb(r / 255, g / 255, b / 255) for r, g, b in (_ZENITH, _HORIZON, _GROUND)]
    parts = [given or own for given, own in zip((zenith, horizon, ground), defaults, strict=True)]
    up, level, down = (_light_color(color, strength) for color in parts)
    mean = tuple((a + 2 * b + c) / 4 for a, b, c in zip(up, level, down, strict=True))
    return Background(shown.rgb if shown else _vec3(mean), ir.Sky(up, level, down), shown is not None)


def _environment(
    ctx: Context, file: str, strength: float = 1.0, turn: float = 0.0, shown: Color | None = None
) -> Background:
    factor = not_negative(strength, "strength", "0 is darkness")
    pixels = _pixels(ctx, file) * np.float32(factor)
    rows = np.sin((np.arange(len(pixels)) + 0.5) * (math.pi / len(pixels)))
    mean = np.average(pixels.mean(axis=1), axis=0, weights=rows)
    color = shown.rgb if shown else _vec3(mean.tolist())
    return Background(color, ir.Environment(file, pixels, number(turn, "turn")), shown is not None)


def _vec3(values: Sequence[float]) -> Vec3:
    return float(values[0]), float(values[1]), float(values[2])


def _pixels(ctx: Context, file: str) -> Any:
    """(h, w, 3) float32 of a picture below the scene's folder, remembered as a source."""
    from blobscript import images

    read_bytes(ctx, file)  # refuses what may not be read, and keeps its hash
    try:
        pixels = images.read(located(ctx, file)).rgba[:, :, :3]
    except images.ReadError as error:
        raise unreadable(file, error.reason, "an environment is a picture such as studio.exr or field.hdr") from None
    height, width = pixels.shape[:2]
    if not height < width <= 4 * height:
        hint = "an environment shows all directions: twice as wide as high, latitudes by rows"
        raise unreadable(file, f"it has {width} x {height} pixels", hint)
    pixels = np.clip(np.nan_to_num(pixels, nan=0.0, posinf=_BRIGHTEST), 0.0, _BRIGHTEST)
    step = -(-max(width, height) // _LARGEST)
    if step > 1:
        h, w = height // step, width // step
        pixels = pixels[: h * step, : w * step].reshape(h, step, w, step, 3).mean(axis=(1, 3))
    return np.ascontiguousarray(pixels, np.float32)


# ---- the stage -------------------------------------------------------------------------


def _floor(
    ctx: Context, y: float = 0.0, material: Material | None = None, catch: bool = False, fade: float = 0.0
) -> Floor:
    if catch and material is not None:
        helps = (Help("leave one of them out"),)
        raise MakerError("E0405", "a floor that only catches shadows has no material", "material", "", helps)
    own = material or looks.LOOKS["clay"].tinted(Color.from_srgb(0.86, 0.86, 0.85))
    advice = "0 lets the floor go on for ever"
    return Floor(number(y, "y"), own, catch, not_negative(fade, "fade", advice))


def _fog(ctx: Context, distance: float, color: Color | None = None) -> ir.Fog:
    return ir.Fog(positive(distance, "distance"), (color or Color.from_srgb(0.812, 0.847, 0.878)).rgb)


def _tone(ctx: Context, curve: Any = "film", exposure: float = 0.0) -> ir.Tone:
    if not abs(number(exposure, "exposure")) <= 20:
        helps = (Help("1 doubles the light, -1 halves it"),)
        message = f"`exposure` must lie in -20..20 stops, but it is {show(exposure)}"
        raise MakerError("E0405", message, "exposure", "", helps)
    return ir.Tone(curve, float(exposure))


MAKERS: dict[str, Maker] = {
    "sun": _sun,
    "lamp": _lamp,
    "background": _background,
    "sky": _sky,
    "environment": _environment,
    "floor": _floor,
    "fog": _fog,
    "tone": _tone,
}
