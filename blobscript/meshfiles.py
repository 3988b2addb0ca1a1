"""Mesh files: OBJ and binary STL by readers of our own, everything else through trimesh.

trimesh is imported only when a script needs it. Files that a mesh file names in turn (glTF buffers)
go through the same door as every other file: nothing outside the scene's folder is read.
"""

from __future__ import annotations

import io
import os
import traceback
import zipfile
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from blobscript.arguments import LARGEST, count_text
from blobscript.datafiles import read_bytes, unreadable
from blobscript.diagnostics import Help
from blobscript.interruption import import_whole
from blobscript.jsonfiles import refuse_deep_json
from blobscript.shapes import welded
from blobscript.values import Context, MakerError

__all__ = ["read_mesh"]

Array = NDArray[np.float64]
Faces = Sequence[Sequence[int]] | NDArray[np.integer]

#: An archive (3MF is one) must not unpack to more bytes than this.
_LARGEST_ARCHIVE = 500_000_000


def read_mesh(ctx: Context, file: str) -> tuple[Array, Faces]:
    """Points (n, 3) and faces of a file below the scene's folder."""
    ending = os.path.splitext(file)[1].lower().lstrip(".")
    points, faces = _read_obj(ctx, file) if ending == "obj" else _read_other(ctx, file, ending)
    if not len(points) or not len(faces):
        raise unreadable(file, f"it has no {'faces' if len(points) else 'points'}")
    if not all((np.abs(points[:, axis]) <= LARGEST).all() for axis in range(3)):
        raise unreadable(file, "a point of it is not finite")
    return np.ascontiguousarray(points, dtype=np.float64), faces


# ---- OBJ -----------------------------------------------------------------------------


def _read_obj(ctx: Context, file: str) -> tuple[Array, Faces]:
    """Lines `v x y z` and `f i j k …`; the rest (normals, materials, groups) does not matter here."""
    text = read_bytes(ctx, file).decode("utf-8-sig", "replace")
    points: list[list[float]] = []
    faces: list[list[int]] = []
    largest = largest_line = 0
    for number, line in enumerate(text.replace("\\\r\n", " ").replace("\\\n", " ").splitlines(), 1):
        cells = line.split()
        word = cells[0] if cells else ""
        try:
            if word == "v":
                points.append([float(cell) for cell in cells[1:4]])
                if len(cells) < 4:
                    raise ValueError
            elif word == "f":
                face = [int(cell.partition("/")[0]) for cell in cells[1:]]
                faces.append([_index(i, len(points)) for i in face])
                wrong = [i for i, found in zip(face, faces[-1], strict=True) if found < 0]
                if wrong:
                    raise _bad_index(file, number, wrong[0], len(points))
                if max(face, default=0) > largest:
                    largest, largest_line = max(face), number
        except ValueError:
            raise unreadable(file, f"line {number} is no OBJ: `{line[:40]}`", label=f"line {number}") from None
    if largest > len(points) > 0:
        raise _bad_index(file, largest_line, largest, len(points))
    return np.array(points, dtype=np.float64).reshape(-1, 3), faces


def _index(i: int, count: int) -> int:
    """Points are counted from 1; negative numbers count back from the last point. Below 0: there is no such point."""
    return i - 1 if i > 0 else count + i if i < 0 else -1


def _bad_index(file: str, line: int, index: int, count: int) -> MakerError:
    """`count`: of the points in the file or, where the index counts back, before the line."""
    there = f"has {count_text(count, 'point')}" + (" before that" if index < 0 else "")
    label = "-1 is the last point so far" if index < 0 else f"points are numbered 1 to {count}"
    return MakerError("E0403", f"line {line} of `{file}` names point {index}, but it {there}", "file", label)


# ---- binary STL ----------------------------------------------------------------------

_HEADER = 84
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def _read_other(ctx: Context, file: str, ending: str) -> tuple[Array, Faces]:
    content = read_bytes(ctx, file)
    count = int.from_bytes(content[80:_HEADER], "little")
    if ending == "stl" and count and len(content) == _HEADER + count * _TRIANGLE.itemsize:
        return _binary_stl(content)
    return _read_trimesh(ctx, file, ending, content)


def _binary_stl(content: bytes) -> tuple[Array, Faces]:
    """The format repeats each point in every triangle: here they are one again."""
    corners = np.frombuffer(content, dtype=_TRIANGLE, offset=_HEADER)["corners"].reshape(-1, 3)
    points, _, numbers = welded(corners)
    return points.astype(np.float64), numbers.reshape(-1, 3)


# ---- everything else -----------------------------------------------------------------


class _Door:
    """What trimesh asks for the files that a file names."""

    def __init__(self, ctx: Context, file: str) -> None:
        self._ctx = ctx
        self._folder = os.path.dirname(file)

    def get(self, name: str) -> bytes:
        return read_bytes(self._ctx, os.path.join(self._folder, name.strip()))

    __getitem__ = get

    def keys(self) -> list[str]:
        return []

    def namespaced(self, namespace: str) -> _Door:
        return _Door(self._ctx, os.path.join(self._folder, namespace, "x"))


def _read_trimesh(ctx: Context, file: str, ending: str, content: bytes) -> tuple[Array, Faces]:
    import_whole("trimesh")
    import trimesh
    from trimesh.exchange.load import mesh_formats

    if ending not in mesh_formats():
        some = ", ".join(f".{name}" for name in ("obj", "stl", "ply", "off", "glb", "3mf"))
        raise MakerError(
            "E0803", f"cannot read meshes from `{file}`", "file", helps=(Help(f"formats that work: {some}, …"),)
        )
    if not content:
        raise unreadable(file, "it is empty")
    _check_archive(file, content)
    if ending in ("gltf", "glb"):
        refuse_deep_json(file, content.decode("utf-8", "replace") if ending == "gltf" else _json_of_glb(content))
    try:
        door: Any = _Door(ctx, file)
        if ending == "ply" and (plain := _plain_ply(content, door)):
            return plain
        # process=False keeps the points as they are; force="mesh" joins all bodies
        found: Any = trimesh.load(io.BytesIO(content), file_type=ending, resolver=door, force="mesh", process=False)  # pyright: ignore[reportUnknownMemberType]
        return np.asarray(found.vertices, dtype=np.float64), np.asarray(found.faces, dtype=np.int64)
    except MakerError:
        raise
    except Exception as error:  # readers of many formats raise whatever they like
        raise unreadable(file, f"it is no good .{ending} file{_told(error)}") from None


def _plain_ply(content: bytes, door: Any) -> tuple[Array, Faces] | None:
    """Of a file of triangles: without the object around them, and the copies that it makes."""
    from trimesh.exchange.ply import load_ply  # pyright: ignore[reportUnknownVariableType]

    found = cast("dict[str, Any]", load_ply(io.BytesIO(content), resolver=door))
    points, faces = found.get("vertices"), found.get("faces")
    if not isinstance(points, np.ndarray) or not isinstance(faces, np.ndarray):
        return None
    corners = cast("NDArray[np.integer]", faces)
    if corners.ndim != 2 or corners.shape[1] != 3 or corners.dtype.kind not in "iu":
        return None
    return np.asarray(points, dtype=np.float64), corners


def _told(error: Exception) -> str:
    """The reason that a reader gives in words; what it only stumbled over is the reader's business, and what it
    misses says nothing of the file."""
    place = traceback.extract_tb(error.__traceback__)[-1].line or ""
    if isinstance(error, ImportError) or not str(error) or not place.lstrip().startswith("raise"):
        return ""
    return f" ({str(error).splitlines()[0][:80]})"


def _json_of_glb(content: bytes) -> str:
    """The first chunk of a binary glTF: 12 bytes of header, its length, its kind, its text."""
    return content[20 : 20 + int.from_bytes(content[12:16], "little")].decode("utf-8", "replace")


def _check_archive(file: str, content: bytes) -> None:
    """A small archive can unpack to more than the memory holds."""
    if not content.startswith(b"PK"):
        return
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise unreadable(file, f"it is a broken archive ({error})") from None
    if size > _LARGEST_ARCHIVE:
        raise unreadable(file, f"it unpacks to more than {_LARGEST_ARCHIVE // 1_000_000} MB")
