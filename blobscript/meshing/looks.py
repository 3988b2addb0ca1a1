"""Colours of vertices, and one material for each body.

Vertices get the paint of the surface where they are, textures included; the rest of a material is one number for the
whole body: the mean over its vertices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blobscript import field, ir, texture
from blobscript.backends.library import MATERIAL
from blobscript.backends.native import Native

__all__ = ["Look", "look_of", "srgb_bytes"]

Floats = NDArray[np.float64]
_CHUNK = 1 << 15
_COLOR = field.MATERIAL_ROW["color"]


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """color: linear RGB of every vertex, (n, 3) or, where it is the same everywhere, (1, 3); row: the mean material
    as in field.MATERIAL_ROW."""

    color: Floats
    row: Floats

    def part(self, name: str) -> float:
        """One number of the mean material."""
        return float(self.row[field.MATERIAL_ROW[name]][0])

    @property
    def emission(self) -> Floats:
        return self.row[field.MATERIAL_ROW["emission"]]


def look_of(scene: ir.Scene, native: Native, surface: int, points: Floats, threads: int | None = None) -> Look:
    """How the vertices (n, 3) of a surface look."""
    whole = scene.surfaces[surface]
    used = _materials(whole.field, whole.material)
    if len(used) == 1 and scene.materials[used[0]].texture is None:
        row = field.material_row(scene.materials[used[0]])
        return Look(row[_COLOR][None], row)
    rows = _in_threads(lambda part: _blended(scene, native, surface, part), points, threads)
    return Look(np.ascontiguousarray(rows[:, _COLOR]), rows.sum(axis=0) / max(len(rows), 1))


def _materials(tree: ir.Field, own: int) -> list[int]:
    """The materials that a field is painted with."""
    match tree:
        case ir.Leaf():
            return sorted({own if i < 0 else int(i) for i in np.unique(tree.paint)})
        case ir.Node(_, children):
            return sorted({i for child in children for i in _materials(child, own)} or {own})


def _in_threads(work: Callable[[Floats], Floats], points: Floats, threads: int | None) -> Floats:
    parts = [points[i : i + _CHUNK] for i in range(0, max(len(points), 1), _CHUNK)]
    with ThreadPoolExecutor(threads) as pool:
        return np.concatenate(list(pool.map(work, parts)))


def _blended(scene: ir.Scene, native: Native, surface: int, points: Floats) -> Floats:
    """(n, MATERIAL) material rows at points. Textured parts count as 0 in the blend, and are added by the share that
    their material has there."""
    plain = np.array([field.material_row(m) for m in scene.materials])
    textured = [(i, m.texture) for i, m in enumerate(scene.materials) if m.texture is not None]
    for i, one in textured:
        plain[i, [column for column, _ in one.outputs if column < MATERIAL]] = 0.0
    which = np.full(len(points), surface, dtype=np.int32)
    rows = native.paint(points, which, plain)
    for group in _groups(textured):
        marks = np.zeros_like(plain)
        for column, (i, _) in enumerate(group):
            marks[i, column] = 1.0
        shares = native.paint(points, which, marks)
        for column, (_, one) in enumerate(group):
            _add_texture(rows, one, points, shares[:, column])
    return rows


def _groups(textured: list[tuple[int, ir.Texture]]) -> Iterator[list[tuple[int, ir.Texture]]]:
    """As many at a time as a material row has numbers."""
    for first in range(0, len(textured), MATERIAL):
        yield textured[first : first + MATERIAL]


def _add_texture(rows: Floats, one: ir.Texture, points: Floats, share: Floats) -> None:
    here = share > 0.0
    if not here.any():
        return
    values = texture.evaluate(one, points[here])
    for number, (column, _) in enumerate(one.outputs):
        if column < MATERIAL:
            rows[here, column] += share[here] * values[:, number]


def srgb_bytes(linear: Floats) -> NDArray[np.uint8]:
    """Linear RGB (n, 3) as files for the eye have it: (n, 4) sRGB bytes, opaque (IEC 61966-2-1)."""
    x = np.clip(linear, 0.0, 1.0)
    coded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return _opaque(coded)


def linear_bytes(linear: Floats) -> NDArray[np.uint8]:
    """Linear RGB (n, 3) as glTF wants the colours of vertices: (n, 4) linear bytes, opaque."""
    return _opaque(np.clip(linear, 0.0, 1.0))


def _opaque(color: Floats) -> NDArray[np.uint8]:
    out = np.full((len(color), 4), 255, dtype=np.uint8)
    out[:, :3] = np.round(255.0 * color)
    return out
