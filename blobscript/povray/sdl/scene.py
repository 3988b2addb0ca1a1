"""The blobs of a scene of POV-Ray, with what belongs to them: places, strengths, transformations, colours.

Everything is kept in POV-Ray's own coordinates; `script` turns it round.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from blobscript.diagnostics import Diagnostic, ProgramError
from blobscript.povray.sdl.reader import COLOR_WORDS, OBJECTS, Made, Opaque, Reader
from blobscript.povray.sdl.words import Word, refused, words_of
from blobscript.source import Source

__all__ = ["Blob", "Camera", "Component", "Found", "Light", "Look", "read_scene"]

Array = NDArray[np.float64]
Color = tuple[float, float, float]
Place = tuple[float, float, float]

#: The component modifiers and flags that change nothing here.
_FLAGS = ("sturm", "hierarchy", "no_shadow", "no_image", "no_reflection", "inverse", "hollow", "double_illuminate")
_MOVES = ("translate", "rotate", "scale", "matrix", "transform")
_LOOKS = ("texture", "pigment", "finish", "material", "interior", "normal")


@dataclass(frozen=True, slots=True)
class Look:
    """A pigment and what of a finish has a counterpart. clear: 0..1 how much light passes."""

    color: Color = (1.0, 1.0, 1.0)
    clear: float = 0.0
    diffuse: float = 0.6
    highlight: float = 0.0
    sharpness: float = 40.0  # phong_size
    mirror: float = 0.0
    metallic: bool = False
    ior: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """Sphere (b is None) or cylinder. map: (4, 4), its own space to the scene's."""

    a: Place
    b: Place | None
    radius: float
    strength: float
    look: Look | None
    map: Array
    line: int


@dataclass(slots=True, eq=False)
class Blob:
    threshold: float = 1.0
    components: list[Component] = field(default_factory=list[Component])
    look: Look | None = None
    map: Array = field(default_factory=lambda: np.eye(4))
    line: int = 0


@dataclass(slots=True)
class Camera:
    location: Place = (0.0, 0.0, 0.0)
    direction: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    right: Array = field(default_factory=lambda: np.array([1.33, 0.0, 0.0]))
    up: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    sky: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))


@dataclass(frozen=True, slots=True)
class Light:
    at: Place
    color: Color
    toward: Place | None  # of parallel light: the place that it points at


@dataclass(slots=True)
class Found:
    """What a file holds. notes: N1002, what was left out."""

    blobs: list[Blob] = field(default_factory=list[Blob])
    camera: Camera | None = None
    lights: list[Light] = field(default_factory=list[Light])
    background: Color | None = None
    notes: list[Diagnostic] = field(default_factory=list[Diagnostic])


def read_scene(source: Source, names: dict[str, float] | None = None) -> Found:
    """names: numbers declared from outside. Raises ProgramError (E1002) with the place of what cannot be read."""
    return _Scene(source, names or {}).read()


class _Scene:
    def __init__(self, source: Source, names: dict[str, float]) -> None:
        self.reader = Reader(words_of(source), self._object, names)
        self.found = Found()
        self._left_out: dict[str, list[Word]] = {}

    # ---- the whole ----

    def read(self) -> Found:
        while (word := self.reader.peek()).kind != "end":
            self._item(word)
        for what, words in self._left_out.items():
            lines = ", ".join(str(word.span.line) for word in words[:6]) + (", …" if len(words) > 6 else "")
            where = "line" if len(words) == 1 else "lines"
            message = f"`{what}` is left out ({where} {lines})"
            self.found.notes.append(Diagnostic("N1002", message, words[0].span))
        for word in self.reader.included:
            self.found.notes.append(Diagnostic("N1002", f"{word.text} is not read", word.span))
        for word in self.reader.unread:
            self.found.notes.append(Diagnostic("N1002", f"`{word.text}` is not read", word.span))
        return self.found

    def _item(self, word: Word) -> None:
        match word.text:
            case _ if self._is_object(word) or isinstance(self.reader.names.get(word.text), Made):
                self.found.blobs += self._object()
            case "camera":
                self.found.camera = self._camera()
            case "light_source":
                self._light()
            case "background":
                self.reader.take()
                self.reader.expect("{")
                self.found.background = self._color()[0]
                self.reader.expect("}")
            case ";":
                self.reader.take()
            case _:
                self._leave_out(word)

    def _leave_out(self, word: Word) -> None:
        """A thing with braces that is no blob."""
        self.reader.take()
        if word.kind == "name" and self.reader.peek().text == "(":
            self.reader.skip_pair("(", ")")  # a macro
        elif word.kind == "name" and self.reader.peek().text == "{":
            self.reader.skip_braces()
        else:
            raise refused(f"`{word.text}` cannot be imported", word.span)
        self._left_out.setdefault(word.text, []).append(word)

    # ---- objects ----

    def _object(self) -> list[Blob]:
        """The blobs of a blob, of a reference to one, or of a union of such."""
        word = self.reader.take()
        match word.text:
            case "blob":
                return [self._blob(word)]
            case "object":
                return self._reference()
            case "union" | "merge":
                return self._union()
            case "intersection" | "difference":
                return self._cut(word)
            case _:
                return self._declared(word)

    def _is_object(self, word: Word) -> bool:
        return word.text in OBJECTS

    def _reference(self) -> list[Blob]:
        self.reader.expect("{")
        word = self.reader.peek()
        blobs: list[Blob] = []
        if self._is_object(word):
            blobs = self._object()
        elif word.kind == "name" and self.reader.words[self.reader.at + 1].text == "{":
            self._leave_out(word)
        else:
            self.reader.take()
            blobs = self._declared(word)
        self._modified(blobs)
        return blobs

    def _declared(self, word: Word) -> list[Blob]:
        """Copies of a declared object's blobs; none where it is something else."""
        if self.reader.peek().text == "(":
            self.reader.skip_pair("(", ")")
        name = self.reader.full_name(word)
        value = self.reader.names.get(name)
        if isinstance(value, Made):
            return [replace(blob) for blob in cast("list[Blob]", value.thing)]
        self._left_out.setdefault(word.text, []).append(word)
        return []

    def _union(self) -> list[Blob]:
        self.reader.expect("{")
        blobs: list[Blob] = []
        while (word := self.reader.peek()).text != "}":
            if self._is_object(word) or isinstance(self.reader.names.get(word.text), Made):
                blobs += self._object()
            elif word.text in (*_MOVES, *_LOOKS, *_FLAGS):
                self._modify(blobs, word)
            else:
                self._leave_out(word)
        self.reader.expect("}")
        return blobs

    def _cut(self, word: Word) -> list[Blob]:
        """The blobs of an intersection (of a difference those of its first part), whole, and a note that says so."""
        first = self.reader.at
        blobs = self._union()
        if word.text == "difference" and blobs:
            back, self.reader.at = self.reader.at, first
            self.reader.expect("{")
            kept = self._object() if self._is_object(self.reader.peek()) else []
            self.reader.at = back
            for new, old in zip(kept, blobs, strict=False):
                new.map = old.map
            blobs = kept
        if blobs:
            message = f"this `{word.text}` cuts its blobs, and they come over uncut"
            self.found.notes.append(Diagnostic("N1002", message, word.span))
        return blobs

    def _modified(self, blobs: list[Blob]) -> None:
        """Transformations and looks up to the closing brace."""
        while (word := self.reader.peek()).text != "}":
            self._modify(blobs, word)
        self.reader.expect("}")

    def _modify(self, blobs: list[Blob], word: Word) -> None:
        if word.text in _MOVES:
            step = self._move()
            for blob in blobs:
                blob.map = step @ blob.map
        elif word.text in _LOOKS:
            look = self._look(None)
            for blob in blobs:
                blob.look = blob.look or look
        elif word.text in _FLAGS:
            self._flag()
        elif word.text in ("bounded_by", "photons"):
            self.reader.take()
            self.reader.skip_braces()
        else:
            raise refused(f"`{word.text}` in an object cannot be imported", word.span)

    def _flag(self) -> None:
        self.reader.take()
        if (
            self.reader.peek().text in ("on", "off", "yes", "no", "true", "false")
            or self.reader.peek().kind == "number"
        ):
            self.reader.take()

    # ---- blobs ----

    def _blob(self, start: Word) -> Blob:
        blob = Blob(line=start.span.line)
        self.reader.expect("{")
        while (word := self.reader.peek()).text != "}":
            self._blob_item(blob, word)
        self.reader.expect("}")
        if not blob.components:
            raise refused("this blob has no components", start.span)
        return blob

    def _blob_item(self, blob: Blob, word: Word) -> None:
        match word.text:
            case "threshold":
                self.reader.take()
                blob.threshold = self.reader.number()
            case "sphere" | "cylinder":
                blob.components.append(self._component(word))
            case "component":
                blob.components.append(self._old_component(word))
            case ",":
                self.reader.take()
            case _ if isinstance(self.reader.names.get(word.text), Made) and not blob.components:
                inner = self._object()
                if len(inner) != 1:
                    raise refused(f"`{word.text}` is no blob", word.span)
                blob.threshold, blob.components, blob.look, blob.map = (
                    inner[0].threshold,
                    inner[0].components,
                    inner[0].look,
                    inner[0].map,
                )
            case _ if word.text in (*_MOVES, *_LOOKS, *_FLAGS, "bounded_by"):
                self._own_modifier(blob, word)
            case _:
                raise refused(f"`{word.text}` in a blob cannot be imported", word.span)

    def _own_modifier(self, blob: Blob, word: Word) -> None:
        if word.text in _LOOKS:
            blob.look = self._look(blob.look)
        else:
            self._modify([blob], word)

    def _component(self, word: Word) -> Component:
        self.reader.take()
        self.reader.expect("{")
        a = self.reader.vector()
        self.reader.accept(",")
        b = None
        if word.text == "cylinder":
            b = self.reader.vector()
            self.reader.accept(",")
        radius = self.reader.number()
        strength = 1.0
        if self.reader.accept(",") or self.reader.peek().text not in ("}", *_MOVES, *_LOOKS):
            self.reader.accept("strength")
            strength = self.reader.number()
        component = Component(a, b, abs(radius), strength, None, np.eye(4), word.span.line)
        while (modifier := self.reader.peek()).text != "}":
            component = self._component_modified(component, modifier)
        self.reader.expect("}")
        if radius == 0:
            raise refused("a component with the radius 0 does nothing", word.span)
        return component

    def _component_modified(self, component: Component, word: Word) -> Component:
        if word.text in _MOVES:
            return replace(component, map=self._move() @ component.map)
        if word.text in _LOOKS:
            return replace(component, look=self._look(component.look))
        if word.text == ",":
            self.reader.take()
            return component
        raise refused(f"`{word.text}` in a component cannot be imported", word.span)

    def _old_component(self, word: Word) -> Component:
        """component strength, radius, <centre>"""
        self.reader.take()
        strength = self.reader.number()
        self.reader.accept(",")
        radius = self.reader.number()
        self.reader.accept(",")
        return Component(self.reader.vector(), None, abs(radius), strength, None, np.eye(4), word.span.line)

    # ---- transformations ----

    def _move(self) -> Array:
        word = self.reader.take()
        match word.text:
            case "translate":
                result = np.eye(4)
                result[:3, 3] = self.reader.vector()
                return result
            case "scale":
                factors = self.reader.vector()
                if 0.0 in factors:
                    raise refused("a scale of 0", word.span)
                return np.diag([*factors, 1.0])
            case "rotate":
                return _rotation(self.reader.vector())
            case "matrix":
                return self._matrix()
            case _:
                return self._transform()

    def _matrix(self) -> Array:
        self.reader.expect("<")
        numbers = [_float(self.reader)]
        while self.reader.accept(","):
            numbers.append(_float(self.reader))
        word = self.reader.expect(">")
        if len(numbers) != 12:
            raise refused(f"a matrix has 12 numbers, not {len(numbers)}", word.span)
        return np.vstack([np.array(numbers).reshape(4, 3).T, [0.0, 0.0, 0.0, 1.0]])

    def _transform(self) -> Array:
        """`transform { … }` or the name of one."""
        word = self.reader.peek()
        value = self.reader.names.get(word.text)
        if isinstance(value, Opaque) and value.what == "transform":
            back = self.reader.at + 1
            self.reader.at = value.start + 1
            result = self._transform()
            self.reader.at = back
            return result
        self.reader.expect("{")
        result = np.eye(4)
        while self.reader.peek().text != "}":
            if isinstance(self.reader.names.get(self.reader.peek().text), Opaque):
                result = self._transform() @ result
            else:
                result = self._move() @ result
        self.reader.expect("}")
        return result

    # ---- looks ----

    def _look(self, before: Look | None) -> Look:
        """Of texture, pigment, finish, interior, material; unknown parts of them change nothing."""
        look = before or Look()
        word = self.reader.take()
        if word.text == "normal":
            self.reader.skip_braces()
            return look
        self.reader.expect("{")
        return self._look_inside(word.text, look)

    def _look_inside(self, kind: str, look: Look) -> Look:
        while (word := self.reader.peek()).text != "}":
            if word.kind == "end":
                raise refused(f"this `{kind}` is never closed", word.span)
            if word.text in _LOOKS:
                look = self._look(look)
            elif isinstance(value := self.reader.names.get(word.text), Opaque):
                look = self._declared_look(value, look)
            else:
                look = self._look_word(kind, look, word)
        self.reader.expect("}")
        return look

    def _declared_look(self, value: Opaque, look: Look) -> Look:
        back = self.reader.at + 1
        if value.what in _LOOKS:
            self.reader.at = value.start
            look = self._look(look)
        self.reader.at = back
        return look

    def _look_word(self, kind: str, look: Look, word: Word) -> Look:
        if kind in ("pigment", "texture") and self._is_color(word):
            color, clear = self._color()
            return replace(look, color=color, clear=clear)
        self.reader.take()
        if word.text == "{":
            self.reader.at -= 1
            self.reader.skip_braces()
        elif kind in ("finish", "texture", "material", "interior") and word.text in _FINISH:
            look = self._finish(look, word)
        elif word.text in ("color_map", "colour_map", "pigment_map", "texture_map"):
            self._left_out.setdefault(word.text, []).append(word)
            self.reader.skip_braces()
        return look

    def _finish(self, look: Look, word: Word) -> Look:
        if word.text == "reflection" and self.reader.peek().text == "{":
            self.reader.skip_braces()
            return replace(look, mirror=0.3)
        if word.text == "metallic":
            if self.reader.peek().kind == "number":
                self.reader.take()
            return replace(look, metallic=True)
        value = max(self.reader.vector())
        match word.text:
            case "phong" | "specular":
                return replace(look, highlight=value)
            case "phong_size":
                return replace(look, sharpness=value)
            case "roughness":
                return replace(look, sharpness=1.0 / max(value, 1e-6))
            case "reflection":
                return replace(look, mirror=value)
            case "ior":
                return replace(look, ior=value)
            case _:
                return replace(look, diffuse=value)

    # ---- colours ----

    def _is_color(self, word: Word) -> bool:
        known = self.reader.names.get(word.text)
        return (
            word.text in (*COLOR_WORDS, "<")
            or isinstance(known, tuple)
            or (word.text in _COLORS and word.text not in self.reader.names)
        )

    def _color(self) -> tuple[Color, float]:
        """Linear RGB, and how much passes."""
        reader = self.reader
        while reader.peek().text in ("color", "colour"):
            reader.take()
        word = reader.peek()
        if word.text in _COLORS and word.text not in reader.names:
            reader.take()
            parts, clear = _COLORS[word.text], 0.0
        elif isinstance(reader.names.get(word.text), Opaque):
            raise refused(f"`{word.text}` is no colour", word.span)
        else:
            parts, clear = self._color_numbers()
        while reader.peek().text in ("filter", "transmit"):
            reader.take()
            clear += _float(reader)
        if word.text.startswith("srgb"):
            parts = _decoded(parts[0]), _decoded(parts[1]), _decoded(parts[2])
        return parts, min(max(clear, 0.0), 1.0)

    def _color_numbers(self) -> tuple[Color, float]:
        """White for the name of a colour that is not known."""
        start = self.reader.at
        try:
            return _color_of(self.reader.operand())
        except ProgramError:
            word = self.reader.words[start]
            if word.kind != "name":
                raise
            self.reader.at = start + 1
            self._left_out.setdefault(word.text, []).append(word)
            return (1.0, 1.0, 1.0), 0.0

    # ---- camera and lights ----

    def _camera(self) -> Camera:
        self.reader.take()
        self.reader.expect("{")
        camera, angle, look_at = Camera(), None, None
        moves = np.eye(4)
        while (word := self.reader.peek()).text != "}":
            if word.text in ("translate", "rotate", "scale", "matrix", "transform"):
                moves = self._move() @ moves
                continue
            self.reader.take()
            match word.text:
                case "location":
                    camera.location = self.reader.vector()
                case "look_at":
                    look_at = self.reader.vector()
                case "angle":
                    angle = self.reader.number()
                case "right" | "up" | "sky" | "direction":
                    setattr(camera, word.text, np.array(self.reader.vector()))
                case "perspective":
                    pass
                case _:
                    raise refused(f"`{word.text}` in a camera cannot be imported", word.span)
        self.reader.expect("}")
        return _aimed(camera, angle, look_at, moves)

    def _light(self) -> None:
        start = self.reader.take()
        self.reader.expect("{")
        at = self.reader.vector()
        self.reader.accept(",")
        color, _ = self._color()
        parallel, target, moves = False, (0.0, 0.0, 0.0), np.eye(4)
        while (word := self.reader.peek()).text != "}":
            if word.text in _MOVES:
                moves = self._move() @ moves
                continue
            self.reader.take()
            if word.text == "parallel":
                parallel = True
            elif word.text == "point_at":
                target = self.reader.vector()
            elif word.text == "{":
                self.reader.at -= 1
                self.reader.skip_braces()
            elif word.kind == "end":
                raise refused("this light is never closed", start.span)
        self.reader.expect("}")
        self.found.lights.append(Light(_moved(moves, at), color, _moved(moves, target) if parallel else None))


_FINISH = ("diffuse", "phong", "phong_size", "specular", "roughness", "reflection", "metallic", "ior")
#: The plain names of colours that scenes use most.
_COLORS: dict[str, Color] = {
    "Black": (0.0, 0.0, 0.0),
    "White": (1.0, 1.0, 1.0),
    "Red": (1.0, 0.0, 0.0),
    "Green": (0.0, 1.0, 0.0),
    "Blue": (0.0, 0.0, 1.0),
    "Yellow": (1.0, 1.0, 0.0),
    "Cyan": (0.0, 1.0, 1.0),
    "Magenta": (1.0, 0.0, 1.0),
    "Orange": (1.0, 0.5, 0.0),
}


def _float(reader: Reader) -> float:
    """One number between commas: `<` and `>` are no comparisons here."""
    value = reader.operand()
    return value[0] if isinstance(value, tuple) else value


def _color_of(value: float | tuple[float, ...]) -> tuple[Color, float]:
    if not isinstance(value, tuple):
        return (value, value, value), 0.0
    parts = (*value, 0.0, 0.0, 0.0)
    return (parts[0], parts[1], parts[2]), sum(value[3:])


def _decoded(c: float) -> float:
    return c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4


def _rotation(degrees: Place) -> Array:
    """About x, then y, then z."""
    result = np.eye(4)
    for axis, angle in enumerate(degrees):
        i, j = ((1, 2), (2, 0), (0, 1))[axis]
        turn = np.eye(4)
        turn[i, i] = turn[j, j] = math.cos(math.radians(angle))
        turn[j, i] = math.sin(math.radians(angle))
        turn[i, j] = -turn[j, i]
        result = turn @ result
    return result


def _moved(map_: Array, p: Place) -> Place:
    x, y, z = (map_[:3, :3] @ np.array(p) + map_[:3, 3]).tolist()
    return x, y, z


def _aimed(camera: Camera, angle: float | None, look_at: Place | None, moves: Array) -> Camera:
    """POV-Ray's order: the angle sets the length of the direction, then the camera is turned."""
    if angle is not None:
        length = 0.5 * float(np.linalg.norm(camera.right)) / math.tan(math.radians(angle) / 2)
        camera.direction = camera.direction / np.linalg.norm(camera.direction) * length
    if look_at is not None:
        right, up, ahead = (float(np.linalg.norm(v)) for v in (camera.right, camera.up, camera.direction))
        handed = math.copysign(1.0, float(np.cross(camera.up, camera.direction) @ camera.right))
        way = np.array(look_at) - np.array(camera.location)
        camera.direction = way / np.linalg.norm(way) * ahead
        side = np.cross(camera.sky, camera.direction)
        side = side / np.linalg.norm(side)
        camera.right = handed * side * right
        top = np.cross(camera.direction, side)
        camera.up = top / np.linalg.norm(top) * up
    camera.location = _moved(moves, camera.location)
    for name in ("direction", "right", "up"):
        setattr(camera, name, moves[:3, :3] @ getattr(camera, name))
    return camera
