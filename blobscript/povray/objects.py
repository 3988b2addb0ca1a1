"""Forms as objects of POV-Ray: skins, blobs, unions, isosurfaces, with their textures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import assert_never

import numpy as np

from blobscript import geometry, ir
from blobscript.diagnostics import Diagnostic, Help, ProgramError
from blobscript.field import field_value
from blobscript.ir import Field, Leaf, Lines, Node, Points, Surface
from blobscript.povray.beside import Beside
from blobscript.povray.cells import Cell, Group, Single, Terms, cells_of, whole
from blobscript.povray.forms import Blob, Form, Iso, Joined, Nothing, Skin, leaves
from blobscript.povray.functions import Functions
from blobscript.povray.grids import Grid, sampled
from blobscript.povray.text import Array, comment, indented, is_similarity, matrix, number, place, vector, vectors

__all__ = ["FAR_DENSITY", "MOST_COMPONENTS", "SAMPLED_PAINT", "Objects"]

#: POV-Ray counts a sphere as one component of a blob and a cylinder as three.
MOST_COMPONENTS = 999_999
#: From here on POV-Ray's solver by Sturm chains makes more errors than its other one (measured, 10 000 spheres).
_MOST_STURM = 3000
#: More terms than this would be a text that POV-Ray needs minutes to read and hours to trace.
_MOST_TERMS = 20_000
#: Nodes in nodes: the time in which gradients are bounded, and the text, grow with the cube of their number.
_MOST_LEVELS = 100
#: Blobs with paints and negative parts are painted by functions, which is exact, up to so many components.
_MOST_MIXED = 400

#: Places at which the weight of negative components is measured.
_PLACES = 4000

#: POV-Ray's accuracy where a surface is sampled, in steps of the grid: its interpolation is rounded to single
#: precision, and normals from finer steps would show that.
_GRID_ACCURACY = 1 / 200


@dataclass(slots=True)
class Objects:
    """Writes the objects of one scene (in POV-Ray's units). `notes` gathers (text, surface) of what is not exact.

    look: number of a material, and the density that makes the surface, if asked for -> name of its declared texture.
    by_density: such looks are wanted. beside: where files go; without it what needs one
    is refused. off: how far what was sampled is off, at most.
    """

    scene: ir.Scene
    functions: Functions
    accuracy: float
    look: Callable[[int, str | None], str]
    unit: float = 1.0
    beside: Beside | None = None
    by_density: bool = False
    off: float = 0.0
    needs_pieces: bool = False
    grids: list[str] = field(default_factory=list[str])
    mixtures: list[str] = field(default_factory=list[str])
    notes: list[tuple[str, Surface]] = field(default_factory=list[tuple[str, Surface]])
    _mixed: dict[tuple[object, ...], str] = field(default_factory=dict[tuple[object, ...], str])

    def object_of(self, surface: Surface, form: Form, transparent: bool) -> list[str]:
        """The object of a surface; no lines if it is proved empty."""
        match form:
            case Nothing():
                return []
            case Skin():
                return self._skin(surface, form, transparent)
            case Blob():
                return self._blob(surface, form)
            case Joined(op, parts):
                texts = [text for part in parts if (text := self.object_of(surface, part, transparent))]
                word = "intersection" if op == "min" else "merge" if transparent else "union"
                if op == "min" and len(texts) < len(parts):
                    return []
                return self._group(word, texts)
            case Iso():
                return self._iso(surface, form)
            case _:
                assert_never(form)

    def _group(self, word: str, texts: list[list[str]]) -> list[str]:
        if len(texts) <= 1:
            return texts[0] if texts else []
        return [f"{word} {{", *(line for text in texts for line in indented(text)), "}"]

    def _textured(self, material: int, density: str | None = None) -> str:
        return f"texture {{ {self.look(material, density)} }}"

    def _density(self, surface: Surface) -> str | None:
        """The function that makes a whole surface, where looks depend on it and it is not too long for that."""
        if not self.by_density:
            return None
        if sum(len(geometry.simplices(leaf.skeleton)) for leaf in leaves(surface.field)) > _MOST_MIXED:
            self.notes.append((FAR_DENSITY, surface))
            return None
        return self.functions.density(whole(surface), surface.threshold)

    def _material(self, surface: Surface, leaf: Leaf, index: int) -> int:
        paint = int(leaf.paint[index])
        return surface.material if paint < 0 else paint

    def pieces_text(self) -> list[str]:
        """What all pieces of isosurfaces have in common."""
        if not self.needs_pieces:
            return []
        return [
            comment("a piece of an isosurface: the gradient is at most Steepest in the box, which is proved"),
            "#macro Piece(Low, High, Steepest)",
            f"  contained_by {{ box {{ Low, High }} }} max_gradient Steepest accuracy {number(self.accuracy)} "
            "all_intersections open",
            "#end",
        ]

    def _origin(self, leaf: Leaf, index: int) -> str:
        number_ = int(leaf.origin[index]) if len(leaf.origin) > index else -1
        span = self.scene.spans[number_] if 0 <= number_ < len(self.scene.spans) else None
        return comment(place(span))

    # ---- skins ---------------------------------------------------------------------------

    def _skin(self, surface: Surface, form: Skin, transparent: bool) -> list[str]:
        leaf, parts = form.leaf, _skin_parts(form.leaf, form.radius)
        ending = self._textured(self._material(surface, leaf, 0), self._density(surface))
        if leaf.matrix is not None:
            ending = f"{_inverse_text(leaf.matrix)} {ending}"
        where = self._origin(leaf, 0)
        if len(parts) == 1:
            return [where, f"{parts[0][:-1]} {ending} }}"]
        return [where, f"{'merge' if transparent else 'union'} {{", *indented([*parts, ending]), "}"]

    # ---- blobs ---------------------------------------------------------------------------

    def _blob(self, surface: Surface, form: Blob) -> list[str]:
        total = sum(leaf.count * (3 if isinstance(leaf.skeleton, Lines) else 1) for leaf in form.leaves)
        if total > MOST_COMPONENTS:
            raise _refusal(
                surface,
                f"it has {_grouped(total)} components, and a blob of POV-Ray takes {_grouped(MOST_COMPONENTS)} "
                "(a line counts as three)",
                "use fewer blobs, or render the scene with blobscript itself",
            )
        materials = {self._material(surface, leaf, i) for leaf in form.leaves for i in _first_of_each(leaf.paint)}
        mixed, density = len(materials) > 1, self._density(surface)
        weights = np.concatenate([leaf.weight for leaf in form.leaves])
        texture = [] if mixed else [self._textured(materials.pop(), density)]
        if mixed and np.any(weights < 0) and not form.negated:
            if len(weights) <= _MOST_MIXED:
                tree = Group("sum", tuple(Terms(leaf, tuple(range(leaf.count))) for leaf in form.leaves))
                texture, mixed = [self._mixture(tree, surface, density)], False
            else:
                self.notes.append((f"{_NEGATIVE_PAINT}: {_negative_share(form)}", surface))
        lines = ["blob {", f"  threshold {number(form.threshold)}"]
        for leaf in form.leaves:
            lines += indented(self._components(surface, leaf, -1.0 if form.negated else 1.0, mixed, density))
        # without a texture of its own, a component would have the surface's
        return [*lines, *(["  sturm"] if len(weights) <= _MOST_STURM else []), *indented(texture), "}"]

    def _components(self, surface: Surface, leaf: Leaf, sign: float, textured: bool, density: str | None) -> list[str]:
        texts, suffix = _components(leaf, sign)
        if textured:
            looks = [self._textured(self._material(surface, leaf, i), density) for i in range(leaf.count)]
            texts = [f"{text}{suffix} {look} }}" for text, look in zip(texts, looks, strict=True)]
        else:
            texts = [f"{text}{suffix} }}" for text in texts]
        return self._with_origins(leaf, texts)

    def _with_origins(self, leaf: Leaf, texts: list[str]) -> list[str]:
        """A comment wherever another line of the script takes over."""
        origins = leaf.origin.tolist()
        lines: list[str] = []
        for i, text in enumerate(texts):
            if i == 0 or (i < len(origins) and origins[i] != origins[i - 1]):
                lines.append(self._origin(leaf, i))
            lines.append(text)
        return lines

    # ---- isosurfaces -----------------------------------------------------------------------

    def _iso(self, surface: Surface, form: Iso) -> list[str]:
        if form.threshold == 0:
            raise _refusal(
                surface,
                "its threshold is 0: the field is 0 in all of empty space, so the surface has no definite place",
                "use a threshold other than 0",
            )
        if too_large := _too_large(form.field):
            return self._sampled(surface, form, too_large)
        self.needs_pieces = True
        part = Surface(surface.name, form.field, form.threshold, surface.material, surface.span)
        cells = cells_of(part, 2.0 * self.accuracy)
        textures = [self._mixture(cell.tree, part, self._cell_density(part, cell)) for cell in cells]
        shared = textures[0] if len(set(textures)) == 1 else None
        lines = [self._cell(part, cell, None if shared else t) for cell, t in zip(cells, textures, strict=True)]
        if not shared:
            return self._group("union", [[line] for line in lines])
        return ["union {", *indented([*lines, shared]), "}"]

    def _sampled(self, surface: Surface, form: Iso, too_large: str) -> list[str]:
        """Too large for functions: a file of samples."""
        if self.beside is None:
            raise _refusal(
                surface,
                f"it has {too_large}, more than POV-Ray can take as functions in a reasonable time",
                "`compile --to pov -o scene.pov` samples it on a grid, in a file beside the scene; points and lines "
                "of the kernel soft2 become components of a blob, up to a million, and a mesh that is alone in its "
                "surface needs neither",
            )
        part = Surface(surface.name, form.field, form.threshold, surface.material, surface.span)
        grid = sampled(part, self.beside.grid)
        if grid is None:
            return []
        name = self.beside.add("field", "df3", grid.data())
        remark = self._remark(grid, too_large)
        if any((leaf.paint >= 0).any() for leaf in leaves(form.field)):
            self.notes.append((SAMPLED_PAINT, surface))
        self.off = max(self.off, grid.most)
        self.notes.append((remark, surface))
        number_ = len(self.beside.files)
        self.grids += [comment(f"not exact: {remark}"), *_grid_text(f"Grid_{number_}", grid, name)]
        return [
            "union {",
            *[f"  Grid_{number_}({vector(p.lo)}, {vector(p.hi)}, {number(_rounded_up(p.max_gradient))})"
              for p in grid.pieces],
            f"  {self._textured(surface.material)}",
            "}",
        ]  # fmt: skip

    def _remark(self, grid: Grid, too_large: str) -> str:
        nx, ny, nz = grid.counts
        text = (
            f"{too_large} are too many for functions: its field is sampled on {nx} x {ny} x {nz} places; the "
            f"surface is off by {grid.median / self.unit:.1e} in the middle and {grid.most / self.unit:.1e} at most, "
            "measured at some thousand places"
        )
        if grid.lost > 0:
            text += f"; {grid.lost:.2%} of them have no counterpart: parts are smaller than the grid"
        return text + f" (--grid {2 * self.beside.grid if self.beside else 0} is finer)"

    def _cell_density(self, surface: Surface, cell: Cell) -> str | None:
        return self.functions.density(cell.tree, surface.threshold) if self.by_density else None

    def _cell(self, surface: Surface, cell: Cell, texture: str | None) -> str:
        if not math.isfinite(cell.max_gradient):
            raise _refusal(surface, "it is too steep for a double", "give a longer reach or a smaller weight")
        density = self.functions.density(cell.tree, surface.threshold)
        piece = f"Piece({vector(cell.lo)}, {vector(cell.hi)}, {number(_rounded_up(cell.max_gradient))})"
        return f"isosurface {{ function {{ {density}(x,y,z) }} {piece}{' ' + texture if texture else ''} }}"

    def _mixture(self, tree: Group | Terms | Single, surface: Surface, density: str | None) -> str:
        """The texture where several materials blend: each weighs as much as the positive densities of its terms."""
        contributions = self.functions.mixture(tree, surface.material)
        if len(contributions) <= 1:
            return self._textured(next(iter(contributions), surface.material), density)
        key = density, *contributions.items()
        if key not in self._mixed:
            self._mixed[key] = self._declared_mixture(contributions, density)
        return f"texture {{ {self._mixed[key]} }}"

    def _declared_mixture(self, contributions: dict[int, str], density: str | None) -> str:
        """Blended one by one: the k-th takes its share of the first k together."""
        (first, total), *rest = contributions.items()
        texture = self.look(first, density)
        for material, weight in rest:
            total = f"{total}+{weight}"
            name = f"Mix_{len(self.mixtures) + 1}"
            self.mixtures.append(
                f"#declare {name} = texture {{ function {{ ({weight})/max(1e-300,{total}) }} "
                f"texture_map {{ [0 {texture}] [1 {self.look(material, density)}] }} }}"
            )
            texture = name
        return texture


def _negative_share(form: Blob) -> str:
    """What negative components weigh at places near the surface, of some thousand about components."""
    tree = ir.Node("sum", form.leaves)
    sizes = tuple(replace(leaf, weight=np.abs(leaf.weight)) for leaf in form.leaves)
    at = np.concatenate([_around(leaf) for leaf in form.leaves])
    value, size = field_value(tree, at), field_value(ir.Node("sum", sizes), at)
    near = (np.abs(value - form.threshold) < 0.2 * form.threshold) & (size > 0)
    if not near.any():
        return "how much they weigh at the surface is not known"
    share = 0.5 * (1.0 - value[near] / size[near])
    return (
        f"they would weigh {share.mean():.1%} in the mean and {share.max():.1%} at most, at {np.count_nonzero(near)} "
        "places near the surface"
    )


def _around(leaf: Leaf) -> Array:
    """Places about some of a leaf's elements, seeded."""
    chance = np.random.default_rng(0)
    chosen = chance.integers(0, leaf.count, _PLACES)
    way = chance.normal(size=(_PLACES, 3))
    way *= (chance.uniform(0.2, 0.9, _PLACES) * leaf.reach[chosen] / np.linalg.norm(way, axis=1))[:, None]
    places = geometry.simplices(leaf.skeleton)[chosen].mean(axis=1) + way
    if leaf.matrix is None:
        return places
    return (places - leaf.matrix[:, 3]) @ np.linalg.inv(leaf.matrix[:, :3]).T


FAR_DENSITY = "it has so many terms that the environment is mirrored by its mean at each height, not by direction"
SAMPLED_PAINT = "a sampled field has no terms left that could be painted: the surface's own material is everywhere"
_NEGATIVE_PAINT = (
    "POV-Ray also counts negative components when it blends paints; here only those that add to the surface count"
)


def _grid_text(name: str, grid: Grid, file: str) -> list[str]:
    """A macro that makes a piece of the isosurface."""
    sides = grid.step * np.array(grid.counts)
    shares = zip("xyz", grid.lo.tolist(), sides.tolist(), strict=True)
    at = ",".join(f"({axis}-({number(start)}))/{number(side)}" for axis, start, side in shares)
    return [
        f'#declare {name}_samples = function {{ pattern {{ density_file df3 "{file}" interpolate 2 }} }}',
        f"#macro {name}(Low, High, Steepest)",
        f"  isosurface {{ function {{ 0.5-{name}_samples({at}) }}",
        f"    contained_by {{ box {{ Low, High }} }} max_gradient Steepest accuracy "
        f"{number(float(f'{_GRID_ACCURACY * grid.step:.3g}'))} all_intersections open }}",
        "#end",
    ]


def _too_large(field: Field) -> str | None:
    """What a field has too much of for functions, which POV-Ray traces and we bound in a reasonable time."""
    terms = sum(len(geometry.simplices(leaf.skeleton)) for leaf in leaves(field))
    if terms > _MOST_TERMS:
        return f"{_grouped(terms)} terms"
    levels = _levels(field)
    return f"{_grouped(levels)} levels of nodes" if levels > _MOST_LEVELS else None


def _levels(field: Field) -> int:
    deepest, stack = 0, [(field, 0)]
    while stack:
        top, level = stack.pop()
        deepest = max(deepest, level)
        if isinstance(top, Node):
            stack.extend((child, level + 1) for child in top.children)
    return deepest


def _grouped(count: int) -> str:
    return f"{count:,}".replace(",", " ")


def _refusal(surface: Surface, reason: str, remedy: str) -> ProgramError:
    message = f"`{surface.name}` cannot be a scene of POV-Ray: {reason}"
    return ProgramError([Diagnostic("E1001", message, surface.span, helps=(Help(remedy),))])


def _first_of_each(values: np.ndarray[tuple[int], np.dtype[np.int32]]) -> list[int]:
    return np.unique(values, return_index=True)[1].tolist()


def _rounded_up(x: float) -> float:
    """A few digits are enough to read, and no less than x."""
    return float(f"{x * 1.0005:.4g}")


def _inverse_text(map_: Array) -> str:
    """From the space of the skeleton to the scene."""
    back = np.asarray(np.linalg.inv(map_[:, :3]), dtype=np.float64)
    return matrix(back, -back @ map_[:, 3])


# ---- components of a blob -----------------------------------------------------------------------


def _components(leaf: Leaf, sign: float) -> tuple[list[str], str]:
    """Texts without their ending, and the transformation that all of them share."""
    reach, suffix, map_ = leaf.reach, "", leaf.matrix
    corners = geometry.simplices(leaf.skeleton)
    if map_ is not None:
        scale = is_similarity(map_[:, :3])
        if scale is None:
            suffix = " " + _inverse_text(map_)
        else:
            back = np.linalg.inv(map_[:, :3])
            corners, reach = (corners - map_[:, 3]) @ back.T, reach / scale
    strengths = [f"{x!r}" for x in (sign * leaf.weight).tolist()]
    radii = [f"{x!r}" for x in reach.tolist()]
    first = vectors(np.ascontiguousarray(corners[:, 0]))
    if isinstance(leaf.skeleton, Points):
        return [f"sphere {{ {c}, {r}, {s}" for c, r, s in zip(first, radii, strengths, strict=True)], suffix
    second = vectors(np.ascontiguousarray(corners[:, 1]))
    return [
        f"sphere {{ {a}, {r}, {s}" if a == b else f"cylinder {{ {a}, {b}, {r}, {s}"
        for a, b, r, s in zip(first, second, radii, strengths, strict=True)
    ], suffix


# ---- skins ------------------------------------------------------------------------------------------


def _skin_parts(leaf: Leaf, radius: float) -> list[str]:
    """Spheres at the corners, cylinders along the edges, faces moved out on both sides."""
    corners, r = geometry.simplices(leaf.skeleton), number(radius)
    places = np.unique(corners.reshape(-1, 3), axis=0)
    parts = [f"sphere {{ {c}, {r} }}" for c in vectors(places)]
    if corners.shape[1] == 1:
        return parts
    edges = _edges(corners)
    for a, b in zip(vectors(edges[:, 0]), vectors(edges[:, 1]), strict=True):
        if a != b:
            parts.append(f"cylinder {{ {a}, {b}, {r} }}")
    if corners.shape[1] == 3 and len(faces := _faces(corners, radius, geometry.is_solid(leaf.skeleton))):
        parts += ["mesh {", *indented(faces), "}"]
    return parts


def _edges(corners: Array) -> Array:
    """Each once, (m, 2, 3)."""
    pairs = [corners[:, [i, j]] for i, j in ((0, 1), (1, 2), (2, 0))] if corners.shape[1] == 3 else [corners]
    ends = np.concatenate(pairs)
    swap = [tuple(a) > tuple(b) for a, b in ends.tolist()]
    ends[swap] = ends[swap][:, ::-1]
    return np.unique(ends, axis=0)


def _faces(corners: Array, radius: float, solid: bool) -> list[str]:
    """Triangles at the distance; flat ones have only their edges. Of solids, only the outer ones."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    longest = np.sum((corners[:, 1] - corners[:, 0]) ** 2, axis=1)
    good = lengths > 1e-12 * longest
    shift = radius * normals[good][:, None] / lengths[good][:, None, None]
    moved = [corners[good] + shift] if solid else [corners[good] + shift, corners[good] - shift]
    texts = [vectors(np.ascontiguousarray(np.concatenate(moved)[:, k])) for k in range(3)]
    return [f"triangle {{ {a}, {b}, {c} }}" for a, b, c in zip(*texts, strict=True)]
