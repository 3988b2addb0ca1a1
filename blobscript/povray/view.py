"""Camera, lights and background in POV-Ray's words.

World coordinates are written as they are. A camera with direction f, right vector r and up vector u of its own, and
neither `look_at` nor `angle`, is the same pinhole in right-handed coordinates, exactly.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.backends import picture
from blobscript.framing import camera_for, view_axes
from blobscript.images import Image
from blobscript.povray.beside import Beside
from blobscript.povray.losses import Losses
from blobscript.povray.text import Array, comment, number, place, vector

__all__ = [
    "background_text",
    "camera_text",
    "exposure_text",
    "faded_text",
    "fog_text",
    "height_look",
    "horizons",
    "is_plain",
    "light_text",
    "misty_text",
    "notes_on_view",
    "sky_image",
]

#: A lamp's light falls with the square of the distance; POV-Ray's does so beyond a distance of this share.
_NEAR = 1e-4
#: Radius of a filter around the camera; reaches are a hundred at least.
_FILTER = 0.1


def height_look(background: ir.Background) -> Callable[[Array], Array]:
    """Radiance (n, 3) by the heights (n,) of unit directions; of a picture, the mean of all directions there."""
    match background.light:
        case ir.Sky():
            return lambda y: picture.sky_colors(background.light, y)
        case ir.Environment(_, pixels):
            rows: list[list[float]] = pixels.astype(np.float64).mean(axis=1).T.tolist()
            at = (np.arange(len(pixels)) + 0.5) / len(pixels)

            def mean(y: Array) -> Array:
                down = np.arccos(np.clip(y, -1, 1)) / math.pi
                return np.column_stack([np.interp(down, at, c) for c in rows])

            return mean
        case None:
            above, below = _gradient(background)

            def look(y: Array) -> Array:
                rise = y - picture.LEVEL
                return below + (above - below) * (0.5 + 0.5 * rise / np.hypot(rise, picture.BEND))[:, None]

            return look


def _gradient(background: ir.Background) -> tuple[Array, Array]:
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


def background_text(scene: ir.Scene, lo: Array, hi: Array, eye: Array, image: str | None) -> list[str]:
    """The sky that mirrors see, and in front of a plain one the colour that the camera sees. image: the pigment of an
    environment, where it has one."""
    background, fog = scene.background, scene.fog
    lines = [comment("background, as rays from surfaces see it"), "sky_sphere {"]
    lines += [f"  pigment {{ {_misty(image or _sky_pigment(background), fog)} }}", "}"]
    if not is_plain(background):
        return lines
    far = 4.0 * float(np.linalg.norm(hi - lo) + np.linalg.norm(eye - lo))
    haze = _misty(f"rgb {vector(background.color)}", fog, eye)
    return [
        *lines,
        comment("the camera sees one colour: the inside of a sphere, but only what comes from its middle sees it"),
        f"sphere {{ {vector(eye)}, {number(far)} hollow no_shadow no_reflection",
        f"  texture {{ pigment {{ aoi pigment_map {{ [0.99999 rgbt <0, 0, 0, 1>] [0.99999 {haze}] }} }}",
        "    finish { ambient 0 diffuse 0 emission 1 } } }",
    ]


def exposure_text(exposure: float, eye: Array) -> list[str]:
    """Light times 2^exposure: a filter before the camera, nearer than anything that is seen."""
    if exposure == 0:
        return []
    times = [2.0**exposure] * 3
    return [
        comment(f"exposure: {number(exposure)} stops, a filter before the camera"),
        f"sphere {{ {vector(eye)}, {number(_FILTER)} hollow no_shadow no_reflection",
        f"  texture {{ pigment {{ rgbf {vector([*times, 1])} }} finish {{ ambient 0 diffuse 0 }} }} }}",
    ]


def is_plain(background: ir.Background) -> bool:
    """Does the camera see one colour?"""
    return not background.default and (background.light is None or background.shown)


def _sky_pigment(background: ir.Background) -> str:
    match background.light:
        case ir.Environment():
            return _heights(height_look(background))
        case ir.Sky(zenith, horizon, ground):
            # level is 0.45 of a map that ends at 0.9: POV-Ray takes 1 for 0
            function = "0.45+0.45*select(y, -pow(min(1,-y/0.12),2)*(3-2*min(1,-y/0.12)), 1-pow(1-min(1,max(0,y)),3))"
            colors = f"[0 rgb {vector(ground)}] [0.45 rgb {vector(horizon)}] [0.9 rgb {vector(zenith)}]"
            return f"function {{ {function} }} color_map {{ {colors} }}"
        case None:
            above, below = _gradient(background)
            rise = f"y-({number(picture.LEVEL)})"
            function = f"0.5+0.5*({rise})/sqrt(pow({rise},2)+pow({number(picture.BEND)},2))"
            return f"function {{ {function} }} color_map {{ [0 rgb {vector(below)}] [1 rgb {vector(above)}] }}"


def _heights(look: Callable[[Array], Array]) -> str:
    """By height alone."""
    heights = np.linspace(-1.0, 1.0, 65)
    rows = zip(heights.tolist(), np.round(look(heights), 6).tolist(), strict=True)
    colors = " ".join(f"[{number(0.45 + 0.45 * h)} rgb {vector(color)}]" for h, color in rows)
    return f"function {{ 0.45+0.45*min(1,max(-1,y)) }} color_map {{ {colors} }}"


def sky_image(environment: ir.Environment, beside: Beside) -> str:
    """A picture of all directions in a file of its own. POV-Ray's `map_type 1` has its first column towards +x and goes
    to +z (measured); ours has its middle towards -z and goes to +x, turned about y."""
    name = beside.add("sky", "exr", _exr(environment.pixels))
    return (
        f'image_map {{ exr "{name}" map_type 1 interpolate 2 }} rotate y*{number(math.degrees(environment.turn) - 90)}'
    )


def _exr(pixels: NDArray[np.float32]) -> bytes:
    with tempfile.TemporaryDirectory(prefix="blobscript-") as folder:
        path = Path(folder) / "sky.exr"
        rgba = np.concatenate([pixels, np.ones((*pixels.shape[:2], 1), np.float32)], axis=2)
        Image(np.ascontiguousarray(np.minimum(rgba, 65504.0))).save(path)
        return path.read_bytes()


def _misty(pigment: str, fog: ir.Fog | None, eye: Array | None = None) -> str:
    """Fog lies low: it hides the sky at the horizon only. eye: on a sphere around it, not in the sky itself."""
    if fog is None:
        return pigment
    height = "y"
    if eye is not None:
        x, y, z = (f"({name}-({number(c)}))" for name, c in zip("xyz", eye.tolist(), strict=True))
        height = f"{y}/sqrt(pow({x},2)+pow({y},2)+pow({z},2))"
    function = f"0.9-0.9*exp(-6*max(0,{height}))"
    return f"function {{ {function} }} pigment_map {{ [0 rgb {vector(fog.color)}] [0.9 {pigment}] }}"


def fog_text(fog: ir.Fog | None, eye: Array, unit: float) -> list[str]:
    """POV-Ray's own fog would swallow the sky. Of what is a distance d away exp(-d / distance) is left: the looks fade
    by a function of the place, which is exact for what the camera sees itself."""
    if fog is None:
        return []
    x, y, z = (f"{name}-({number(c)})" for name, c in zip("xyz", eye.tolist(), strict=True))
    return [
        comment("fog: how much of it lies in front of a place"),
        f"#declare FOG = function {{ 1-exp(-sqrt(pow({x},2)+pow({y},2)+pow({z},2))/{number(fog.distance * unit)}) }}",
        f"#declare Mist = texture {{ pigment {{ rgb {vector(fog.color)} }}",
        "  finish { ambient 0 diffuse 0 emission 1 } }",
    ]


def misty_text(texture: str) -> str:
    return f"texture {{ function {{ 0.9*FOG(x,y,z) }} texture_map {{ [0 {texture[10:-2]}] [0.9 Mist] }} }}"


def faded_text(scene: ir.Scene, texture: str, unit: float, far: str) -> str:
    """A floor that passes into another pigment."""
    floor, camera = scene.floor, camera_for(scene, scene.width, scene.height)
    assert floor is not None
    x, z = (f"{name}/{number(unit)}-({number(c)})" for name, c in (("x", camera.to[0]), ("z", camera.to[2])))
    way = f"min(1,max(0,2*sqrt(pow({x},2)+pow({z},2))/{number(floor.fade)}-1))"
    glow = f"pigment {{ {far} }} finish {{ ambient 0 diffuse 0 emission 1 }}"
    return "\n  ".join(
        [
            "texture {",
            f"function {{ 0.9*pow({way},2)*(3-2*{way}) }} texture_map {{ [0 {texture[10:-2]}]",
            f"[0.9 {glow}] }} }}",
        ]
    )


def horizons(scene: ir.Scene, image: str | None) -> list[tuple[str, str]]:
    """Pigments that a floor passes into, the sky at the height of the horizon, and who sees each: the camera may see a
    plain colour in place of the sky, mirrors do not. image: the sky there, where it differs from side to side."""
    if scene.fog is not None:
        return [(f"rgb {vector(scene.fog.color)}", "")]
    sky = image or f"rgb {vector(height_look(scene.background)(np.zeros(1))[0])}"
    if not is_plain(scene.background):
        return [(sky, "")]
    return [(sky, " no_image"), (f"rgb {vector(scene.background.color)}", " no_reflection")]


def notes_on_view(scene: ir.Scene, losses: Losses) -> list[str]:
    """What of camera, light and stage is not exact, and by how much."""
    notes: list[str] = []
    if scene.camera.aperture > 0:
        lost = losses.without_area(replace(scene, camera=replace(scene.camera, aperture=0.0)))
        notes.append(f"the camera is a pinhole in POV-Ray: everything is sharp, which changes colours by {lost}")
    if any(map(_is_large, scene.lights)):
        lost = losses.without_area(replace(scene, lights=tuple(map(_point, scene.lights))))
        notes.append(f"suns and lamps are points in POV-Ray: their shadows are sharp, which changes colours by {lost}")
    if isinstance(scene.background.light, ir.Environment):
        notes.append(
            "an environment lights by its mean and its main direction in POV-Ray, as with one sample here: it casts no "
            f"shadows, which with light from surface to surface changes colours by {losses.without_bounces()}"
        )
    mirrors = any(m.transmission > 0 or m.metalness > 0 or m.reflection > 0 for m in scene.materials)
    if scene.fog is not None and mirrors:
        notes.append(
            "in mirrors and behind glass there is as much fog in POV-Ray as the camera has in front of the place "
            f"({_UNKNOWN})"
        )
    if scene.floor is not None and scene.floor.catch:
        lost = losses.without(replace(scene, floor=replace(scene.floor, catch=False)))
        notes.append(
            f"the floor is a whole plane in POV-Ray: it does not show shadows alone, which changes colours by {lost}"
        )
    clear = any(material.transmission > 0 for material in scene.materials)
    if scene.floor is not None and scene.floor.fade > 0 and scene.fog is None and is_plain(scene.background) and clear:
        notes.append(
            "through glass the floor passes into the colour in front of the camera in POV-Ray, not the sky's "
            f"({_UNKNOWN})"
        )
    if scene.tone.curve != "linear":
        notes.append(
            "the tone curve is not in POV-Ray's picture, which changes colours by "
            f"{losses.without_curve()} (`compare` gives it the same one)"
        )
    return notes


#: Of what no picture of our own can do without.
_UNKNOWN = "not known without a picture of POV-Ray's: `compare` measures it"


def _is_large(light: ir.Light) -> bool:
    return light.angle > ir.SUN_ANGLE if isinstance(light, ir.Sun) else light.size > 0


def _point(light: ir.Light) -> ir.Light:
    return replace(light, angle=min(light.angle, ir.SUN_ANGLE)) if isinstance(light, ir.Sun) else replace(light, size=0)
