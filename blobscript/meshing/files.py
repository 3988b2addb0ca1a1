"""Mesh files through trimesh: STL, PLY, OBJ, GLB and 3MF, one named body for each surface.

GLB and 3MF say what a number means: metres and millimetres. With a unit, bodies are scaled there to be as large as
they are; STL, PLY and OBJ hold the numbers of the script.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from blobscript import outputs
from blobscript.interruption import import_whole
from blobscript.meshing.build import Part, joined
from blobscript.meshing.looks import Look, linear_bytes

__all__ = ["ENDINGS", "UNITS", "check_output", "save"]

ENDINGS = (".stl", ".ply", ".obj", ".glb", ".3mf")
#: What a unit is in millimetres.
UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
_TRIMESH_UNITS = {"mm": "millimeters", "cm": "centimeters", "m": "meters", "in": "inches"}


def check_output(path: str | Path) -> None:
    """Refuses what could not be written, before the work. Raises FormatError, WriteError."""
    outputs.check_ending(path, "mesh", ENDINGS)
    outputs.check_output(path)


def save(parts: list[Part], path: str | Path, unit: str | None = None) -> None:
    """Whole or not at all. Raises FormatError, WriteError."""
    check_output(path)
    outputs.write_bytes(path, _encoded(parts, Path(path).suffix.lower(), unit))


# ---- formats -------------------------------------------------------------------------------------------


def _encoded(parts: list[Part], ending: str, unit: str | None) -> bytes:
    match ending:
        case ".glb":
            return _bytes(_scene(parts, unit, UNITS[unit] / 1000.0 if unit else 1.0, pbr=True).export(file_type="glb"))
        case ".3mf":
            return _bytes(_scene(parts, unit, UNITS[unit] if unit else 1.0).export(file_type="3mf"))
        case ".obj":
            return _obj(parts, unit)
        case _:
            mesh: Any = joined(parts)
            return _bytes(mesh.export(file_type=ending[1:]))


def _bytes(data: Any) -> bytes:
    return data.encode() if isinstance(data, str) else bytes(data)


def _named(parts: list[Part]) -> list[tuple[str, Part]]:
    """Bodies by names that no two share."""
    seen: dict[str, int] = {}
    out: list[tuple[str, Part]] = []
    for part in parts:
        seen[part.name] = seen.get(part.name, 0) + 1
        out.append((part.name if seen[part.name] == 1 else f"{part.name} ({seen[part.name]})", part))
    return out


def _scene(parts: list[Part], unit: str | None, scale: float, *, pbr: bool = False) -> Any:
    import_whole("trimesh")
    import trimesh

    scene: Any = trimesh.Scene()
    for name, part in _named(parts):
        mesh = part.as_trimesh()
        if pbr:
            mesh.visual = _visual(part)
        mesh.metadata["name"] = name
        matrix = np.diag([scale, scale, scale, 1.0])
        scene.add_geometry(mesh, node_name=name, geom_name=name, transform=matrix)
    if unit:
        scene.units = _TRIMESH_UNITS[unit]
    return scene


def _visual(part: Part) -> Any:
    """Colours of vertices times a white metallic-roughness material, as glTF multiplies them."""
    from trimesh.visual import TextureVisuals

    visual = TextureVisuals(material=_material(part.name, part.look))
    colors = np.broadcast_to(linear_bytes(part.look.color), (len(part.body.vertices), 4))
    visual.vertex_attributes["color"] = np.ascontiguousarray(colors)
    return visual


def _material(name: str, look: Look) -> Any:
    from trimesh.visual.material import PBRMaterial

    clear = look.part("transmission")
    return PBRMaterial(
        name=name,
        baseColorFactor=[1.0, 1.0, 1.0, 1.0 - 0.75 * clear],
        metallicFactor=float(np.clip(look.part("metalness"), 0.0, 1.0)),
        roughnessFactor=float(np.clip(look.part("roughness"), 0.0, 1.0)),
        emissiveFactor=np.clip(look.emission, 0.0, 1.0).tolist(),
        alphaMode="BLEND" if clear > 0.0 else "OPAQUE",
    )


def _obj(parts: list[Part], unit: str | None) -> bytes:
    """Bodies one after the other under their names. trimesh copies the bodies of a scene, which costs them their
    normals, so it is given a scene that hands out its bodies as they are."""
    import_whole("trimesh")
    import trimesh
    from trimesh.exchange import obj

    bodies = [part.as_trimesh() for part in parts]
    for (name, _), body in zip(_named(parts), bodies, strict=True):
        body.metadata["name"] = " ".join(name.split())

    class Scene(trimesh.Scene):
        def dump(self, *_: Any, **__: Any) -> Any:
            return bodies

    size = max(float(np.abs(part.body.vertices).max()) for part in parts)
    digits = max(8, 8 - math.floor(math.log10(size or 1.0)))
    module: Any = obj
    header = "blobscript" + (f", unit: {unit}" if unit else "")
    return _bytes(module.export_obj(Scene(), include_normals=True, digits=digits, header=header))
