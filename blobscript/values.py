"""The scene values that a running script passes around, before they become a scene.

Fields are symbolic: a `Blob` keeps radius, reach and weight as given (any two of them, as the
script had them), because the third depends on the threshold of the surface that it ends up in;
`assemble` solves it. What happens to a field later (transform, factor, paint) is wrapped around it
as a `Changed`, so every operation takes constant time and memory and values can be shared. Big
data stay arrays: a `Cloud` holds a million points in one object.

Classes are frozen, slotted and compared by identity; one is made per call in the script.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.diagnostics import BlobscriptError, Help
from blobscript.source import Span

__all__ = [
    "IDENTITY",
    "Affine",
    "Animate",
    "Background",
    "Blob",
    "Camera",
    "Changed",
    "Cloud",
    "Color",
    "Combine",
    "Context",
    "Dot",
    "Field",
    "Floor",
    "Image",
    "Lamp",
    "Light",
    "MakerError",
    "Material",
    "Paint",
    "Segment",
    "Skeleton",
    "Stage",
    "Sun",
    "Surface",
    "Table",
    "Transform",
    "Vec3",
    "absorption",
    "add_fields",
    "compose",
    "kind_name",
    "scale_field",
    "subtract_fields",
]

Array = NDArray[np.float64]
Vec3 = tuple[float, float, float]

#: A 3 x 4 matrix by rows: three factors and a shift for each coordinate.
Affine = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
IDENTITY: Affine = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def compose(outer: Affine, inner: Affine) -> Affine:
    """The map that applies `inner` first, then `outer`."""
    a, b, c, d, e, f, g, h, i, j, k, m = outer
    A, B, C, D, E, F, G, H, I, J, K, M = inner  # noqa: E741, N806 - two matrices, letter by letter
    return (
        a * A + b * E + c * I,
        a * B + b * F + c * J,
        a * C + b * G + c * K,
        a * D + b * H + c * M + d,
        e * A + f * E + g * I,
        e * B + f * F + g * J,
        e * C + f * G + g * K,
        e * D + f * H + g * M + h,
        i * A + j * E + k * I,
        i * B + j * F + k * J,
        i * C + j * G + k * K,
        i * D + j * H + k * M + m,
    )


# ---- how makers talk to the evaluator ------------------------------------------------


class MakerError(BlobscriptError):
    """A call with values that make no sense; becomes a diagnostic at the call or its argument.

    `argument`: name of the argument to blame (None: the call). `label` goes under that place.
    """

    def __init__(
        self,
        code: str,
        message: str,
        argument: str | None = None,
        label: str = "",
        helps: tuple[Help, ...] = (),
        notes: tuple[str, ...] = (),
    ) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.argument = argument
        self.label = label
        self.helps = helps
        self.notes = notes


@dataclass(slots=True, eq=False)
class Context:
    """What makers may know of the call; the evaluator moves `span` along.

    folder: where file names start; root: what they must stay below (default: the folder);
    None where no files are allowed. `places`: where each argument of the call stands. `sources`
    collects (path, sha256) of every data file read; `memory` holds answers to queries by the
    surface's id.
    """

    span: Span
    folder: str | None = None
    root: str | None = None
    places: Mapping[str, Span] = field(default_factory=dict[str, Span])
    spans: list[Span] = field(default_factory=list[Span])
    sources: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    memory: dict[int, Any] = field(default_factory=dict[int, Any])
    _origins: dict[Span, int] = field(default_factory=dict[Span, int])
    _last_span: Span | None = None
    _last_origin: int = -1

    def origin(self, span: Span) -> int:
        """Number of a span in `spans` (Scene.spans later), the same for equal spans."""
        if span is self._last_span:
            return self._last_origin
        number = self._origins.get(span)
        if number is None:
            number = self._origins[span] = len(self.spans)
            self.spans.append(span)
        self._last_span, self._last_origin = span, number
        return number


# ---- plain values --------------------------------------------------------------------


class Color(NamedTuple):
    """Linear RGB and alpha, each 0..1 (light may be brighter)."""

    r: float
    g: float
    b: float
    a: float = 1.0

    @classmethod
    def from_srgb(cls, r: float, g: float, b: float, a: float = 1.0) -> Color:
        """From sRGB as written in scripts (IEC 61966-2-1)."""
        return cls(_linear(r), _linear(g), _linear(b), a)

    @property
    def rgb(self) -> Vec3:
        return self[0], self[1], self[2]


def _linear(x: float) -> float:
    return x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4


@dataclass(frozen=True, slots=True, eq=False)
class Table(Sequence[dict[str, Any]]):
    """A list of records with equal fields, kept by column.

    A column is an (n,) array of numbers, an (n, 3) array of vectors, or a list.
    """

    columns: Mapping[str, Array | NDArray[np.int64] | list[Any]]
    length: int

    def __len__(self) -> int:
        return self.length

    def __iter__(self) -> Iterator[dict[str, Any]]:
        names = list(self.columns)
        plain = [_plain_column(column) for column in self.columns.values()]
        for row in zip(*plain, strict=True) if plain else [()] * self.length:
            yield dict(zip(names, row, strict=True))

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            columns = {name: column[index] for name, column in self.columns.items()}
            return Table(columns, len(range(*index.indices(self.length))))
        if not -self.length <= index < self.length:
            raise IndexError(index)
        return {name: _plain_item(column[index]) for name, column in self.columns.items()}

    def column(self, name: str) -> Any:
        """One field of all records, as it is stored."""
        return self.columns[name]


def _plain_item(item: Any) -> Any:
    if isinstance(item, np.ndarray):
        return tuple(item.tolist())
    return item.item() if isinstance(item, np.generic) else item  # pyright: ignore[reportUnknownVariableType]


def _plain_column(column: Any) -> Any:
    if not isinstance(column, np.ndarray):
        return column
    return map(tuple, column.tolist()) if column.ndim == 2 else column.tolist()


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """A map of space: p -> matrix p."""

    matrix: Affine = IDENTITY


# ---- skeletons -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Dot:
    """One point."""

    at: Vec3


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """The straight piece from a to b."""

    a: Vec3
    b: Vec3


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Many points, each the skeleton of a blob of its own; only `balls` makes it."""

    at: Array  # (n, 3)


Skeleton = Dot | Segment | Cloud | ir.Polyline | ir.Polygon | ir.Polyhedron | ir.Mesh


# ---- looks ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Material:
    """A look, and where its tint is: with `depth` > 0 inside (white light has the tint after so
    many scene units), else, or where not all light is transmitted, on the outside."""

    look: ir.Material
    depth: float = 0.0

    def tinted(self, color: Color) -> Material:
        """The same material in another colour."""
        look = self.look
        if self.depth:
            look = replace(look, absorption=absorption(color, self.depth))
        if look.transmission < 1:
            look = replace(look, color=color.rgb, texture=_uncoloured(look.texture))
        return replace(self, look=look)

    def moved(self, matrix: Affine | None) -> Material:
        """The material of a surface that was moved: its texture moves along."""
        if matrix is None or self.look.texture is None:
            return self
        whole = np.vstack([np.reshape(matrix, (3, 4)), (0.0, 0.0, 0.0, 1.0)])
        back = tuple(np.linalg.inv(whole)[:3].ravel().tolist())
        return replace(self, look=replace(self.look, texture=replace(self.look.texture, matrix=back)))


def _uncoloured(texture: ir.Texture | None) -> ir.Texture | None:
    """What a texture says about other things than the colour."""
    if texture is None:
        return None
    outputs = tuple(output for output in texture.outputs if output[0] > 2)
    return replace(texture, outputs=outputs) if outputs else None


def absorption(color: Color, depth: float) -> Vec3:
    """Beer's law: after `depth` scene units white light has this colour (at least 1/1000)."""
    r, g, b = (-math.log(min(max(c, 1e-3), 1.0)) / depth + 0.0 for c in color.rgb)
    return r, g, b


Paint = Color | Material


# ---- fields --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Blob:
    """A skeleton (or a cloud of n points) with two of radius, reach and weight.

    Numbers are one value, or (n,) arrays for a cloud; kernel None: inherited; `paint` None:
    inherited, a tuple: one for each point. `origin`: who made it.
    """

    skeleton: Skeleton
    radius: float | Array | None
    reach: float | Array | None
    weight: float | Array | None
    kernel: ir.Kernel | None
    paint: Paint | tuple[Paint, ...] | None
    origin: int


@dataclass(frozen=True, slots=True, eq=False)
class Combine:
    """Sum, max, min or smooth maximum of fields; `kernel` is for the blobs in it that have none."""

    op: ir.Op
    children: tuple[Field, ...]
    kernel: ir.Kernel | None
    origin: int


@dataclass(frozen=True, slots=True, eq=False)
class Changed:
    """A field after something happened to it: mapped, multiplied, or painted where it was not."""

    inner: Field
    matrix: Affine | None = None
    factor: float = 1.0
    paint: Paint | None = None
    origin: int = -1


Field = Blob | Combine | Changed


def scale_field(f: Field, factor: float, origin: int = -1) -> Field:
    """factor * f."""
    if isinstance(f, Changed):
        return Changed(f.inner, f.matrix, f.factor * factor, f.paint, f.origin)
    return Changed(f, factor=factor, origin=origin)


def add_fields(a: Field, b: Field, origin: int = -1) -> Field:
    """a + b; a chain of sums becomes one sum."""
    return Combine("sum", _terms(a) + _terms(b), None, origin)


def _terms(f: Field) -> tuple[Field, ...]:
    """The terms of a small sum: copying long ones again and again would take quadratic time."""
    if isinstance(f, Combine) and f.op == "sum" and f.kernel is None and len(f.children) <= 16:
        return f.children
    return (f,)


def subtract_fields(a: Field, b: Field, origin: int = -1) -> Field:
    """a - b."""
    return add_fields(a, scale_field(b, -1.0, origin), origin)


# ---- scene items ---------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    field: Field
    threshold: float
    material: Material
    kernel: ir.Kernel | None = None
    matrix: Affine | None = None
    span: Span | None = None
    threshold_span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Sun:
    toward: Vec3
    color: Vec3  # irradiance, linear RGB
    angle: float = ir.SUN_ANGLE


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    at: Vec3
    color: Vec3  # irradiance at distance 1, linear RGB
    size: float = 0.0


Light = Sun | Lamp


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    at: Vec3  # `from` in the script
    to: Vec3
    up: Vec3
    fov: float
    span: Span | None = None
    aperture: float = 0.0
    focus: Vec3 | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    color: Vec3
    light: ir.Sky | ir.Environment | None = None
    shown: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    height: float
    material: Material
    catch: bool
    fade: float


#: What stands around the surfaces, each kind once in a scene.
Stage = Floor | ir.Fog | ir.Tone


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    width: int
    height: int


@dataclass(frozen=True, slots=True, eq=False)
class Animate:
    seconds: float
    fps: float


_KIND_NAMES: dict[type, str] = {
    Dot: "skeleton",
    Segment: "skeleton",
    Cloud: "skeleton",
    ir.Polyline: "skeleton",
    ir.Polygon: "skeleton",
    ir.Polyhedron: "skeleton",
    ir.Mesh: "skeleton",
    ir.Kernel: "kernel",
    Blob: "field",
    Combine: "field",
    Changed: "field",
    Surface: "surface",
    Material: "material",
    Sun: "light",
    Lamp: "light",
    Camera: "camera",
    Background: "background",
    Floor: "stage",
    ir.Fog: "stage",
    ir.Tone: "stage",
    Image: "image",
    Animate: "animate",
    Transform: "transform",
    Color: "color",
}


def kind_name(value: object) -> str | None:
    """The language's word for the type of a scene value; None if it is none."""
    return _KIND_NAMES.get(type(value))


#: A maker: `maker(context, **arguments)`.
Maker = Callable[..., Any]
