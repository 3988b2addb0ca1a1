"""A scene as POV-Ray's text, in the order that its parts need each other."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from blobscript import __version__, ir
from blobscript.backends.native import Native
from blobscript.diagnostics import Diagnostic
from blobscript.field import field_value
from blobscript.framing import camera_for, view_rays
from blobscript.ir import Surface
from blobscript.povray.beside import Beside
from blobscript.povray.forms import Blob, Form, Iso, Joined, Nothing, Skin, form_of
from blobscript.povray.functions import Functions
from blobscript.povray.looks import Scenery, interior_text, look_text, notes_on
from blobscript.povray.losses import Losses
from blobscript.povray.objects import FAR_DENSITY, SAMPLED_PAINT, Objects
from blobscript.povray.surroundings import Surroundings
from blobscript.povray.text import Array, comment, number, place
from blobscript.povray.textures import Pixels, Textures
from blobscript.povray.units import magnified, scene_box, unit_for
from blobscript.povray.view import (
    background_text,
    camera_text,
    exposure_text,
    faded_text,
    fog_text,
    horizons,
    light_text,
    misty_text,
    notes_on_view,
)

__all__ = ["Document", "document"]

#: Accuracy asked of isosurfaces, as a part of the scene's size.
ACCURACY = 1e-7


@dataclass(frozen=True, slots=True)
class Document:
    """A scene for POV-Ray. `text` is all of it; `surfaces` declares the objects alone, without camera and light.

    unit: POV-Ray's length of one unit of the script. names: declared object -> surface; those that are proved empty
    are not there. forms: surface -> what it became ("blob", "isosurface", …). accuracy of isosurfaces and size of the
    scene are in units of the script. diagnostics: N1001, what was approximated. files: name -> contents of what the
    text reads, from the folder that POV-Ray runs in. off: surface -> how far it is off at most, if it is sampled.
    """

    text: str
    surfaces: str
    names: dict[str, int]
    forms: dict[int, str]
    unit: float
    accuracy: float
    size: float
    diagnostics: tuple[Diagnostic, ...]
    files: dict[str, bytes] = field(default_factory=dict[str, bytes])
    off: dict[int, float] = field(default_factory=dict[int, float])


def document(
    scene: ir.Scene, width: int | None = None, height: int | None = None, beside: Beside | None = None
) -> Document:
    """The scene for a picture of this size (default: the script's). `beside`: names for files of its own; without
    it, what needs one is refused or plain."""
    width, height = width or scene.width, height or scene.height
    camera = camera_for(scene, width, height)
    unit = unit_for(scene, camera)
    large = magnified(scene, unit)
    lo, hi = scene_box(large)
    eye = np.array(camera.at) * unit
    size = float(np.linalg.norm(hi - lo)) or 1.0
    accuracy = float(f"{ACCURACY * size:.2g}")
    surroundings = _surroundings(scene, eye, size, beside)
    losses = Losses(scene, width, height)
    parts = _Parts(large, accuracy, eye, unit, beside, surroundings, losses)
    floor = parts.floor(unit)
    away = eye - 0.5 * (lo + hi)
    away = away / max(float(np.linalg.norm(away)), 1e-300)
    pixels = Pixels(np.array(camera.at), 2 * math.tan(camera.fov / 2) / height, _level(scene))
    textures = Textures(unit, _places(scene, width, height), pixels, beside, _replaced(scene, losses))
    scenery = Scenery(scene, away, 0.5 * (lo + hi) / unit, surroundings)
    looks = parts.looks(scenery, textures, losses)
    files = beside.files if beside else {}
    view = [*camera_text(camera, width, height, unit)]
    for light in scene.lights:
        view += light_text(light, lo, hi, unit)
    view += background_text(scene, lo, hi, eye, surroundings.pigment if surroundings else None)
    view += exposure_text(scene.tone.exposure, eye)
    remarks = notes_on_view(scene, losses) + scenery.fits()
    view += [comment(f"not exact: {remark}") for remark in remarks]
    parts.notes += [Diagnostic("N1001", remark) for remark in remarks]
    objects = parts.objects
    shapes = [*objects.mixtures, *objects.pieces_text(), *parts.lines]
    fog = fog_text(scene.fog, eye, unit)
    around = surroundings.lines if surroundings else []
    declared = [*fog, *around, *parts.functions.lines, *objects.grids, *textures.lines, *looks, *shapes]
    shown = [
        f"object {{ {name}{parts.interior(scene.surfaces[index].material)} }}" for name, index in parts.names.items()
    ]
    text = "\n".join([*_head(scene, unit, list(files)), *view, "", *declared, "", *shown, *floor, ""])
    return Document(
        text,
        "\n".join(["#version 3.7;", *declared, ""]),
        parts.names,
        parts.kinds,
        unit,
        accuracy / unit,
        size / unit,
        tuple(parts.notes),
        files,
        {index: off / unit for index, off in parts.off.items()},
    )


def _surroundings(scene: ir.Scene, eye: Array, size: float, beside: Beside | None) -> Surroundings | None:
    """Of an environment, if it may have a file."""
    light = scene.background.light
    return Surroundings(light, eye, size, beside) if isinstance(light, ir.Environment) and beside else None


def _replaced(scene: ir.Scene, losses: Losses) -> Callable[[int, ir.Material], str]:
    """How colours change with another material."""

    def lost(number_: int, made: ir.Material) -> str:
        materials = (*scene.materials[:number_], made, *scene.materials[number_ + 1 :])
        return losses.without(replace(scene, materials=materials))

    return lost


def _lost_on(text: str, surface: Surface, large: ir.Scene, losses: Losses) -> str:
    """How colours change by what is said of a surface of the large scene, where a picture tells."""
    if text == SAMPLED_PAINT:
        index = next(i for i, one in enumerate(large.surfaces) if one is surface)
        return f", which changes colours by {losses.without_paint(index)}"
    return f", which changes colours by {losses.without_sides()}" if text == FAR_DENSITY else ""


def _places(scene: ir.Scene, width: int, height: int) -> dict[int, Array]:
    """Material -> where the camera sees surfaces that have it, and the floor, some thousand places (n, 3) in all."""
    if all(material.texture is None for material in scene.materials):
        return {}
    origin, directions = view_rays(camera_for(scene, width, height), 160, max(1, 160 * height // width))
    rays = directions.reshape(-1, 3) / np.linalg.norm(directions, axis=2).reshape(-1, 1)
    found = Native(scene).first_hit(np.broadcast_to(origin, rays.shape), rays)
    places: dict[int, list[Array]] = {}
    for number_, surface in enumerate(scene.surfaces):
        here = found.position[found.hit & (found.surface == number_)]
        for material in _materials(surface):
            places.setdefault(material, []).append(here)
    if scene.floor is not None:
        down = (scene.floor.height - origin[1]) / np.where(rays[:, 1] == 0, np.nan, rays[:, 1])
        here = (down > 0) & ~(found.t < down)
        floor = origin + down[here, None] * rays[here]
        if scene.floor.fade > 0:  # farther away nothing of it is left
            middle = np.array(camera_for(scene, width, height).to)
            floor = floor[np.linalg.norm((floor - middle)[:, [0, 2]], axis=1) < scene.floor.fade]
        places.setdefault(scene.floor.material, []).append(floor)
    return {material: np.concatenate(parts) for material, parts in places.items()}


def _materials(surface: Surface) -> set[int]:
    """All that may be seen of it, and -1."""
    paints = [np.unique(leaf.paint) for leaf in ir.leaves(surface.field)]
    return {surface.material, *(int(m) for m in np.concatenate([[-1], *paints]))}


def _level(scene: ir.Scene) -> int | None:
    """The material that the floor alone has."""
    if scene.floor is None or any(scene.floor.material in _materials(surface) for surface in scene.surfaces):
        return None
    return scene.floor.material


def _head(scene: ir.Scene, unit: float, files: list[str]) -> list[str]:
    source = scene.sources[0][0] if scene.sources else "a scene"
    measure = (
        "as in the script" if unit == 1.0 else f"the script's times {number(unit)}: POV-Ray's tolerances are absolute"
    )
    return [
        comment(f"{source.split('/')[-1]}, by blobscript {__version__}. Lengths are {measure}."),
        *([comment(f"It reads {', '.join(files)}: run POV-Ray in their folder, or with +L and it.")] if files else []),
        "#version 3.7;",
        "global_settings { assumed_gamma 1.0 adc_bailout 0 max_trace_level 20 }",
    ]


class _Parts:
    """The surfaces one by one: texts, what was used, what was noted."""

    def __init__(
        self,
        scene: ir.Scene,
        accuracy: float,
        eye: Array,
        unit: float,
        beside: Beside | None,
        surroundings: Surroundings | None,
        losses: Losses,
    ) -> None:
        self._scene, self._eye, self._unit, self._surroundings = scene, eye, unit, surroundings
        self._used: dict[int, dict[str, str]] = {}
        self._said: set[str] = set()
        self.functions = Functions(scene)
        self.objects = Objects(scene, self.functions, accuracy, self._look, unit, beside, surroundings is not None)
        self.names: dict[str, int] = {}
        self.kinds: dict[int, str] = {}
        self.off: dict[int, float] = {}
        self.lines: list[str] = []
        for number_, surface in enumerate(scene.surfaces):
            self._add(number_, surface)
        self.notes = [
            Diagnostic("N1001", f"`{s.name}`: {text}{_lost_on(text, s, scene, losses)}", s.span)
            for text, s in self.objects.notes
        ]

    def _look(self, material: int, density: str | None = None) -> str:
        """density: of the surface that has it, or "level" for that of a level floor."""
        looks = self._used.setdefault(material, {})
        if density is None or self._surroundings is None or self._scene.materials[material].transmission > 0:
            looks[name := f"Look_{material + 1}"] = ""
        else:
            normal = "0,1,0" if density == "level" else self._surroundings.gradient(density)
            looks[name := f"Look_{material + 1}_{density}"] = normal
        return name

    def _add(self, index: int, surface: Surface) -> None:
        form = form_of(surface.field, surface.threshold)
        # seen from within, a union would show the walls between its parts
        seen_inside = bool(field_value(surface.field, self._eye[None])[0] >= surface.threshold)
        transparent = seen_inside or self._scene.materials[surface.material].transmission > 0
        self.objects.off = 0.0
        said = len(self.objects.notes)
        lines = self.objects.object_of(surface, form, transparent)
        remarks = [comment(f"not exact: {text}") for text, _ in self.objects.notes[said:]]
        if self.objects.off > 0:
            self.off[index] = self.objects.off
        title = comment(f"---- {surface.name} ({place(surface.span)})")
        if not lines:
            self.lines += ["", title, comment("proved empty")]
            self.kinds[index] = "nothing"
            return
        first = next(i for i, line in enumerate(lines) if not line.startswith("//"))
        name = f"Surface_{index + 1}"
        lines[first] = f"#declare {name} = {lines[first]}"
        self.lines += ["", title, *remarks, *lines]
        self.names[name] = index
        self.kinds[index] = _kind(form)

    def interior(self, material: int) -> str:
        made = self._scene.materials[material]
        return interior_text(made, self._look(material), self._unit) if made.transmission > 0 else ""

    def floor(self, unit: float) -> list[str]:
        """The plane under the scene; no surface of it, so `trace` does not see it."""
        floor = self._scene.floor
        if floor is None:
            return []
        texture, height = f"texture {{ {self._look(floor.material, 'level')} }}", number(floor.height * unit)
        beyond = self._surroundings.horizon(floor.height * unit) if self._surroundings else None
        if floor.fade <= 0:
            return [f"plane {{ y, {height} {texture} }}"]
        return [
            f"plane {{ y, {height} {faded_text(self._scene, texture, unit, far)}{seen} }}"
            for far, seen in horizons(self._scene, beyond)
        ]

    def _lost(self, material: int, losses: Losses) -> Callable[[], str]:
        """How colours change where a material is seen, by what only many samples find."""
        surfaces = {k for k, surface in enumerate(self._scene.surfaces) if material in _materials(surface)}
        return lambda: losses.without_bounces(losses.seeing(material, surfaces))

    def looks(self, scenery: Scenery, textures: Textures, losses: Losses) -> list[str]:
        lines: list[str] = []
        for material, names in sorted(self._used.items(), key=lambda item: item[0]):
            said = len(textures.notes)
            made, local = textures.local(material, self._scene.materials[material])
            remarks = notes_on(made, self._lost(material, losses)) + textures.notes[said:]
            lines += [comment(f"not exact: {remark}") for remark in remarks]
            self.notes += [Diagnostic("N1001", remark) for remark in remarks if remark not in self._said]
            self._said |= set(remarks)
            plain, normals = [n for n, normal in names.items() if not normal], {n: t for n, t in names.items() if t}
            for name in plain:
                lines += look_text(name, made, scenery, local)
            if normals:
                lines += look_text("", made, scenery, local, normals)
            if self._scene.fog is not None:
                lines += [f"#declare {name} = {misty_text(f'texture {{ {name} }}')}" for name in names]
        return lines


def _kind(form: Form) -> str:
    """The word for a form that a reader of a report knows."""
    match form:
        case Blob():
            return "blob"
        case Skin():
            return "primitives"
        case Iso():
            return "isosurface"
        case Joined(_, parts):
            kinds = {_kind(part) for part in parts}
            return "isosurface" if "isosurface" in kinds else "blob" if "blob" in kinds else "primitives"
        case Nothing():
            return "nothing"
