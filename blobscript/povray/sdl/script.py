"""What was found in a scene of POV-Ray as a script.

POV-Ray's usual camera is left-handed, so z changes its sign on the way; a camera that is right-handed already
(`right -x`) leaves everything where it is. A component's map A = U S V^T (singular values) becomes: the ends of the
component turned by V^T, stretched by S, turned by U.
"""

from __future__ import annotations

import math
import re
from itertools import pairwise

import numpy as np

from blobscript.diagnostics import Diagnostic, ProgramError
from blobscript.povray.sdl.scene import Array, Blob, Camera, Component, Found, Light, Look, read_scene
from blobscript.povray.sdl.words import refused, words_of
from blobscript.povray.text import is_similarity
from blobscript.source import Source, Span

__all__ = ["imported"]


def imported(source: Source, names: dict[str, float] | None = None) -> tuple[str, tuple[Diagnostic, ...]]:
    """The script, and notes on what was left out. names: numbers declared from outside. Raises ProgramError (E1002)."""
    found = read_scene(source, names)
    if not found.blobs:
        raise _no_blob(source)
    return _Script(found, source.path).text(), tuple(found.notes)


def _no_blob(source: Source) -> ProgramError:
    """There may be one that was not come by."""
    words = words_of(source)
    for word, following in pairwise(words):
        if word.text == "blob" and following.text == "{":
            message = "no blob of this scene is made: this one stands in a branch, a loop or a macro that is not taken"
            return refused(
                message, word.span, "set the numbers that decide: --declare frame_number=2 --declare clock=1"
            )
    return refused("there is no blob in this scene", Span(source, 0, 0))


class _Script:
    def __init__(self, found: Found, path: str) -> None:
        self.found, self.path = found, path
        camera = found.camera or Camera()
        left_handed = float(np.cross(camera.right, camera.up) @ camera.direction) > 0
        self.turn = np.diag([1.0, 1.0, -1.0 if left_handed else 1.0])
        self.lines: list[str] = []

    def text(self) -> str:
        name = re.sub(r"[^\w .-]", "?", re.split(r"[\\/]", self.path)[-1])
        handed = ", mirrored in z: POV-Ray's axes are left-handed" if self.turn[2, 2] < 0 else ""
        self.lines = [f"// The blobs of {name}{handed}.", "blobscript 1", ""]
        for blob in self.found.blobs:
            self._surface(blob)
        self._view()
        return "\n".join(self.lines) + "\n"

    # ---- blobs ----

    def _surface(self, blob: Blob) -> None:
        own = blob.look or Look()
        head = f"threshold = {_number(blob.threshold)}, material = {_material(own)}, kernel = soft2"
        self.lines += [f"// line {blob.line}", f"surface({head}) {{"]
        last = 0
        for component in blob.components:
            remark = f"  // line {component.line}" if component.line != last else ""
            last = component.line
            paint = "" if component.look is None or component.look == own else f".paint({_material(component.look)})"
            self.lines.append(f"  {self._component(component, blob.map)}{paint}{remark}")
        self.lines += ["}", ""]

    def _component(self, component: Component, outer: Array) -> str:
        whole = outer @ component.map
        linear, offset = self.turn @ whole[:3, :3] @ self.turn, self.turn @ whole[:3, 3]
        ends = [self.turn @ np.array(p) for p in (component.a, component.b) if p is not None]
        strength = _number(component.strength)
        scale = is_similarity(linear)
        if scale is not None:
            places = [linear @ p + offset for p in ends]
            return _blob(places, component.radius * scale, strength)
        u, s, vt = (np.asarray(m, dtype=np.float64) for m in np.linalg.svd(linear))
        if np.linalg.det(u) < 0:
            u[:, 2], vt[2] = -u[:, 2], -vt[2]
        text = _blob([vt @ p for p in ends], component.radius, strength)
        x, y, z = (_number(k) for k in s.tolist())
        return f"{text}.scale(x = {x}, y = {y}, z = {z}){_turned(u)}.move({_vector(offset)})"

    # ---- camera, lights, background ----

    def _view(self) -> None:
        if self.found.camera is not None:
            self._camera(self.found.camera)
        for light in self.found.lights:
            self.lines.append(self._light(light))
        if self.found.lights or self.found.background is not None:
            self.lines.append(f"background({_color(self.found.background or (0.0, 0.0, 0.0))})")

    def _camera(self, camera: Camera) -> None:
        at, ahead = self.turn @ np.array(camera.location), self.turn @ camera.direction
        up, right = float(np.linalg.norm(camera.up)), float(np.linalg.norm(camera.right))
        fov = 2 * math.degrees(math.atan(up / 2 / float(np.linalg.norm(camera.direction))))
        self.lines += [
            f"camera(from = {_vector(at)}, to = {_vector(at + ahead)}, up = {_vector(self.turn @ camera.up)}, "
            f"fov = {_number(fov)}deg)",
            f"image(width = 640, height = {max(1, round(640 * up / right))})",
        ]

    def _light(self, light: Light) -> str:
        """POV-Ray's lights do not fade: their strength here is what arrives where the blobs are. A white surface that
        faces a white light is white there; here that takes an irradiance of pi."""
        at, power = self.turn @ np.array(light.at), max(light.color)
        tint = _color(tuple(c / power for c in light.color)) if power > 0 else "black"
        if light.toward is not None:
            way = self.turn @ np.array(light.toward) - at
            return f"sun(toward = {_vector(way)}, color = {tint}, strength = {_number(round(math.pi * power, 6))})"
        distance = float(np.linalg.norm(at - self._middle()))
        strength = math.pi * power * distance**2
        return f"lamp(at = {_vector(at)}, color = {tint}, strength = {_number(float(f'{strength:.6g}'))})"

    def _middle(self) -> Array:
        places: list[Array] = []
        for blob in self.found.blobs:
            for component in blob.components:
                map_ = blob.map @ component.map
                places.append(self.turn @ (map_[:3, :3] @ np.array(component.a) + map_[:3, 3]))
        return np.mean(places, axis=0)


def _blob(places: list[Array], reach: float, strength: str) -> str:
    ending = f"reach = {_number(reach)}, weight = {strength})"
    if len(places) == 1 or np.array_equal(places[0], places[-1]):
        return f"ball({_vector(places[0])}, {ending}"
    return f"line({_vector(places[0])}, {_vector(places[1])}).blob({ending}"


def _turned(u: Array) -> str:
    """A rotation about x, then y, then z."""
    y = math.asin(max(-1.0, min(1.0, -float(u[2, 0]))))
    if abs(float(u[2, 0])) < 1.0 - 1e-14:
        x, z = math.atan2(u[2, 1], u[2, 2]), math.atan2(u[1, 0], u[0, 0])
    else:
        x, z = math.atan2(-u[1, 2], u[1, 1]), 0.0
    angles = [(name, math.degrees(angle)) for name, angle in (("x", x), ("y", y), ("z", z)) if angle != 0.0]
    return f".rotate({', '.join(f'{name} = {_number(angle)}deg' for name, angle in angles)})" if angles else ""


def _number(x: float) -> str:
    text = repr(float(x))
    return text[:-2] if text.endswith(".0") else text


def _vector(v: Array) -> str:
    return "(" + ", ".join(_number(float(c) + 0.0) for c in v) + ")"


def _color(linear: tuple[float, ...]) -> str:
    """As it is written in scripts: sRGB."""
    coded = [12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055 for c in (max(c, 0.0) for c in linear)]
    return "rgb(" + ", ".join(_number(round(min(c, 1.0), 4)) for c in coded) + ")"


def _material(look: Look) -> str:
    """What a finish comes close to: a highlight as wide, mirrors as bright. Colours include `diffuse`."""
    color = _color(tuple(c * (1.0 if look.metallic or look.clear else look.diffuse) for c in look.color))
    roughness = round(min(1.0, (2.0 / (look.sharpness + 2.0)) ** 0.25), 3) if look.highlight > 0 else 0.9
    words = [color, f"roughness = {_number(roughness)}", f"specular = {0.5 if look.highlight > 0 else 0}"]
    if look.metallic:
        words.append("metalness = 1")
    if look.clear > 0:
        words += [f"transmission = {_number(look.clear)}", f"ior = {_number(max(look.ior, 1.0))}"]
    if look.mirror > 0:
        words.append(f"reflection = {_number(min(look.mirror, 1.0))}")
    return f"material({', '.join(words)})"
