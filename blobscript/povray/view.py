"""Camera, lights and background in POV-Ray's words.

World coordinates are written as they are. A camera with direction f, right vector r and up vector u of its own, and
neither `look_at` nor `angle`, is the same pinhole in right-handed coordinates, exactly.
"""

from __future__ import annotations

import math
from typing import assert_never

import numpy as np

from blobscript import ir
from blobscript.backends import picture
from blobscript.framing import view_axes
from blobscript.povray.text import Array, comment, number, place, vector

__all__ = ["background_text", "camera_text", "fog_text", "gradient", "light_text", "notes_on_view"]

#: A lamp's light falls with the square of the distance; POV-Ray's does so beyond a distance of this share.
_NEAR = 1e-4


def gradient(background: ir.Background) -> tuple[Array, Array]:
    """Radiance far above and far below."""
    if background.default:
        return np.array(picture.ABOVE), np.array(picture.BELOW)
    return np.array(background.color), picture.FLOOR * np.array(background.color)


def camera_text(camera: ir.Camera, width: int, height: int, unit: float) -> list[str]:
    right, up, forward = view_axes(camera)
    tangent = math.tan(camera.fov / 2)
    where = place(camera.span) if camera.span else "chosen so that everything is in view"
    return [
        comment(f"camera: {where}"),
        "camera {",
        f"  perspective location {vector(np.array(camera.at) * unit)}",
        f"  direction {vector(forward)}",
        f"  right {vector(right * (2 * tangent * width / height))}",
        f"  up {vector(up * (2 * tangent))}",
        "}",
    ]


def light_text(light: ir.Light, lo: Array, hi: Array, unit: float) -> list[str]:
    """The colour is the irradiance: finishes divide by pi. lo, hi: the scene's box, which a sun stands outside of."""
    match light:
        case ir.Sun(toward, color):
            way = np.array(toward, dtype=np.float64)
            way = way / np.abs(way).max()
            way /= np.linalg.norm(way)
            middle, size = 0.5 * lo + 0.5 * hi, float(np.linalg.norm(hi - lo))
            at = middle - 4.0 * size * way
            return [f"light_source {{ {vector(at)} rgb {vector(color)} parallel point_at {vector(middle)} }}"]
        case ir.Lamp(at, color):
            place_ = np.array(at) * unit
            reach = _NEAR * max(float(np.linalg.norm(hi - lo)), 1e-12)
            # POV-Ray's falloff is 2 / (1 + (d / fade_distance)^2)
            strength = np.array(color) * (unit / reach) ** 2 / 2.0
            return [
                f"light_source {{ {vector(place_)} rgb {vector(strength)} fade_distance {number(reach)} fade_power 2 }}"
            ]
        case _:
            assert_never(light)


def background_text(background: ir.Background, lo: Array, hi: Array, eye: Array) -> list[str]:
    """The sky that mirrors see, and in front of a plain one the colour that the camera sees."""
    above, below = gradient(background)
    rise = f"y-({number(picture.LEVEL)})"
    lines = [
        comment("background: dark below and bright above, as rays from surfaces see it"),
        "sky_sphere {",
        f"  pigment {{ function {{ 0.5+0.5*({rise})/sqrt(pow({rise},2)+pow({number(picture.BEND)},2)) }}",
        f"    color_map {{ [0 rgb {vector(below)}] [1 rgb {vector(above)}] }} }}",
        "}",
    ]
    if background.default:
        return lines
    far = 4.0 * float(np.linalg.norm(hi - lo) + np.linalg.norm(eye - lo))
    return [
        *lines,
        comment("the camera sees one colour: the inside of a sphere that casts no shadow and shows in no mirror"),
        f"sphere {{ {vector(eye)}, {number(far)} hollow no_shadow no_reflection",
        f"  texture {{ pigment {{ rgb {vector(background.color)} }} finish {{ ambient 0 diffuse 0 emission 1 }} }} }}",
    ]


def fog_text(fog: ir.Fog | None, unit: float) -> list[str]:
    """Of what is a distance d away exp(-d / distance) is left, in both."""
    return [f"fog {{ distance {number(fog.distance * unit)} rgb {vector(fog.color)} }}"] if fog else []


def notes_on_view(scene: ir.Scene) -> list[str]:
    """What of camera, light and stage is not exact."""
    notes: list[str] = []
    if scene.camera.aperture > 0:
        notes.append("the camera is a pinhole in POV-Ray: everything is sharp")
    if any(isinstance(light, ir.Lamp) and light.size > 0 for light in scene.lights):
        notes.append("lamps are points in POV-Ray: their shadows are sharp")
    if any(isinstance(light, ir.Sun) and light.angle > ir.SUN_ANGLE for light in scene.lights):
        notes.append("suns are points in POV-Ray: their shadows are sharp")
    if scene.background.light is not None:
        notes.append("a sky or environment is one colour in POV-Ray, dark below: its mean")
    if scene.floor is not None and (scene.floor.catch or scene.floor.fade > 0):
        notes.append("the floor is a whole plane in POV-Ray: it does not fade, nor show shadows alone")
    if scene.tone != ir.Tone():
        notes.append("exposure and tone curve are not in POV-Ray's picture")
    return notes
