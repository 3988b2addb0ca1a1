"""The scene as plain data: what a program means, after everything has been evaluated.

Made by `lower`, checked by `verify`, read by the reference evaluator (`field`), by `pack` and
by every back end. Canonical form: weights and transforms stand at the leaves only (factors and
maps of inner nodes have been pushed down; a negative factor turns `max` into `min`), reaches and
weights are solved numbers, and bulk data are arrays. All arrays are C-contiguous; float64 and
int32. Lengths are scene units, angles radians, colours linear RGB.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from blobscript.source import Span

__all__ = [
    "LARGEST_SIDE",
    "MOST_FRAMES",
    "SUN_ANGLE",
    "Animate",
    "Background",
    "Camera",
    "Environment",
    "Field",
    "Floor",
    "Fog",
    "Kernel",
    "KernelPiece",
    "Lamp",
    "Leaf",
    "Light",
    "Lines",
    "Material",
    "Mesh",
    "Node",
    "Op",
    "ParamInfo",
    "Points",
    "Polygon",
    "Polyhedron",
    "Polyline",
    "Scene",
    "Skeleton",
    "Sky",
    "Sun",
    "Surface",
    "Texture",
    "Tone",
    "cut_off",
    "leaves",
    "never_below",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

# ---- kernels -------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class KernelPiece:
    """D on r_lo <= r <= r_hi as a polynomial, lowest power first.

    variable "s": in x = (s - centre) / half with s = r^2; "r": in x = (r - centre) / half.
    convex: D as a function of s is convex (+1), concave (-1) or linear (0) on the piece.
    falling: D does not rise on the piece.
    """

    r_lo: float
    r_hi: float
    variable: Literal["r", "s"]
    centre: float
    half: float
    coefficients: tuple[float, ...]
    convex: Literal[-1, 0, 1]
    falling: bool


@dataclass(frozen=True, slots=True)
class Kernel:
    """A kernel instance. Built in: `pieces` is empty and `name` one of
    soft2 soft3 wyvill gauss gauss_c1 metaball, `a` the parameter of the Gaussians.
    User kernels: `pieces` covers 0 <= r <= 1 and `error` bounds |pieces - D| (rounding level).
    """

    name: str
    a: float = 0.0
    pieces: tuple[KernelPiece, ...] = ()
    lipschitz: float = 0.0  # max |dD/dr|, proved; only set for user kernels
    error: float = 0.0

    @property
    def falls(self) -> bool:
        """Does it never rise with the distance? Only a kernel of the script may, and one that falls is nowhere below
        0 by more than rounding."""
        return all(piece.falling for piece in self.pieces)


# ---- skeletons -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    at: Array  # (n, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    a: Array  # (n, 3)
    b: Array  # (n, 3); a == b is a point


@dataclass(frozen=True, slots=True, eq=False)
class Polyline:
    points: Array  # (m, 3), m >= 2
    closed: bool


@dataclass(frozen=True, slots=True, eq=False)
class Polygon:
    points: Array  # (m, 3), planar, simple, may be concave
    triangles: Ints  # (k, 3): a triangulation of it, indices into points


@dataclass(frozen=True, slots=True, eq=False)
class Polyhedron:
    """Solid: distance 0 inside."""

    points: Array  # (m, 3)
    triangles: Ints  # (k, 3), closed, outward counter-clockwise
    convex: bool


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    points: Array  # (m, 3)
    triangles: Ints  # (k, 3)
    solid: bool  # distance 0 inside (closed meshes only)


Skeleton = Points | Lines | Polyline | Polygon | Polyhedron | Mesh

# ---- fields --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Leaf:
    """n blobs that share kernel and map, summed; n = 1 unless the skeleton is Points or Lines.

    Density of blob i at p: weight[i] * D(dist(M p, skeleton_i) / reach[i]), M = `matrix`.
    """

    skeleton: Skeleton
    kernel: Kernel
    reach: Array  # (n,), > 0
    weight: Array  # (n,), any finite number but 0
    paint: Ints  # (n,) index into Scene.materials; -1: the surface's material
    origin: Ints  # (n,) index into Scene.spans: who made it
    matrix: Array | None = None  # (3, 4) scene -> skeleton space; None: identity

    @property
    def count(self) -> int:
        return len(self.reach)


Op = Literal["sum", "max", "min", "smooth_max", "smooth_min"]


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """No children: 0 everywhere. Children nest alternately (no sum directly below a sum; smooth_max and
    smooth_min, which are no fold of two, may stand below themselves). Of the last two see `joints`: as a formula
    the sum of f^9 over the sum of f^8, f the densities above 0, and minus that of the densities below 0."""

    op: Op
    children: tuple[Field, ...]


Field = Leaf | Node


def leaves(field: Field) -> Iterator[Leaf]:
    """All leaves, in the order of the tree; a leaf that stands twice comes twice."""
    stack = [field]
    while stack:
        top = stack.pop()
        if isinstance(top, Leaf):
            yield top
        else:
            stack.extend(reversed(top.children))


def never_below(field: Field, sign: float = 1.0) -> bool:
    """A sufficient sign that the field (times -1, if that is the sign) is nowhere below 0 by more than rounding.
    (Kernels of the script that need not fall may be below 0.)"""
    return all(bool((sign * leaf.weight >= 0.0).all()) and leaf.kernel.falls for leaf in leaves(field))


def cut_off(op: str, field: Field) -> Op | None:
    """What a node makes of a field that is its only child: None, the field itself; or the field's "max" or "min"
    with 0: a smooth_max counts only what is above 0, a smooth_min what is below."""
    if op == "smooth_max" and not never_below(field):
        return "max"
    return "min" if op == "smooth_min" and not never_below(field, -1.0) else None


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The set where `field` reaches `threshold`; inside is field >= threshold."""

    name: str
    field: Field
    threshold: float
    material: int  # index into Scene.materials
    span: Span | None


# ---- looks ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Texture:
    """Parts of a material that depend on the place, as a straight program over numbers (`texture.py`).

    Registers: 0, 1, 2 hold the place x, y, z; then the constants; then the result of each instruction,
    in order. An instruction is an operation and up to five registers. `outputs`: (column, register);
    columns as in field.MATERIAL_ROW, and BUMP for a height over the surface, in scene units.
    `matrix`: scene place -> the texture's, by rows, where the surface was moved as a whole.
    """

    constants: tuple[float, ...]
    code: tuple[tuple[str | int, ...], ...]
    outputs: tuple[tuple[int, int], ...]
    matrix: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True)
class Material:
    """One surface appearance, the metallic-roughness model (Burley 2012; GGX, Walter 2007).

    color: linear RGB base colour; roughness 0..1 (alpha = roughness^2); metalness 0..1;
    specular: dielectric reflectance at normal incidence F0 = 0.08 * specular; transmission 0..1
    with index of refraction `ior` and `absorption` per scene unit (linear RGB);
    emission: radiance, linear RGB; reflection: 0..1 extra mirror weight.
    """

    color: tuple[float, float, float]
    roughness: float = 0.5
    metalness: float = 0.0
    specular: float = 0.5
    transmission: float = 0.0
    ior: float = 1.5
    absorption: tuple[float, float, float] = (0.0, 0.0, 0.0)
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    reflection: float = 0.0
    name: str = ""
    texture: Texture | None = None  # what it says takes the place of the numbers above


@dataclass(frozen=True, slots=True)
class Camera:
    """Right-handed, `fov` is the full vertical angle in radians. `aperture`: diameter of the lens (0: a
    pinhole, everything is sharp); sharp is the plane through `focus` (None: through `to`) across the view."""

    at: tuple[float, float, float]  # `from` in the script
    to: tuple[float, float, float]
    up: tuple[float, float, float]
    fov: float
    span: Span | None = None  # None: the default camera
    aperture: float = 0.0
    focus: tuple[float, float, float] | None = None


#: The sun's disc as seen from the earth.
SUN_ANGLE = math.radians(0.53)


@dataclass(frozen=True, slots=True)
class Sun:
    """Parallel light; `toward` is the way it travels; `color` is irradiance on what faces it, linear RGB;
    `angle`: diameter of its disc in the sky, which softens shadows."""

    toward: tuple[float, float, float]
    color: tuple[float, float, float]
    angle: float = SUN_ANGLE
    span: Span | None = field(default=None, compare=False)  # None: a default light


@dataclass(frozen=True, slots=True)
class Lamp:
    """A glowing ball of the diameter `size`, 0: a point. Irradiance is color / d^2."""

    at: tuple[float, float, float]
    color: tuple[float, float, float]
    size: float = 0.0
    span: Span | None = field(default=None, compare=False)


Light = Sun | Lamp


@dataclass(frozen=True, slots=True)
class Sky:
    """Radiance, linear RGB, straight up, level, and straight down."""

    zenith: tuple[float, float, float]
    horizon: tuple[float, float, float]
    ground: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Environment:
    """A picture of all directions, latitudes by rows from straight up to straight down; its middle is seen
    towards -z, turned by `turn` radians about the y axis (counter-clockwise from above)."""

    file: str
    pixels: NDArray[np.float32]  # (h, w, 3) radiance, linear RGB
    turn: float = 0.0


@dataclass(frozen=True, slots=True)
class Background:
    """What rays see that hit nothing. `default`: the built-in soft gradient; else one linear RGB colour.

    With `light` it is that in mirrors and as light, and `color` is its mean; `shown`: the camera sees
    `color` all the same.
    """

    color: tuple[float, float, float]
    default: bool = False
    light: Sky | Environment | None = None
    shown: bool = False
    span: Span | None = field(default=None, compare=False)  # None: the default


@dataclass(frozen=True, slots=True)
class Floor:
    """The plane y = `height`, seen from above. `catch`: only its shadows are seen. `fade`: distance from the
    origin's foot within which it passes into the background (0: it never does)."""

    height: float
    material: int  # index into Scene.materials
    catch: bool = False
    fade: float = 0.0
    span: Span | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class Fog:
    """Of what is `distance` away 1/e is left, the rest is `color`, linear RGB."""

    distance: float
    color: tuple[float, float, float]
    span: Span | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class Tone:
    """How light becomes a picture: `exposure` in stops, then the `curve`."""

    curve: Literal["linear", "film"] = "linear"
    exposure: float = 0.0
    span: Span | None = field(default=None, compare=False)  # None: the default


@dataclass(frozen=True, slots=True)
class Animate:
    seconds: float
    fps: float


@dataclass(frozen=True, slots=True)
class ParamInfo:
    """A `param` of the main script, with the value this scene was made with.

    Not `settable`: of a type that only the script can give. Its values stand here in the script's notation.
    """

    name: str
    type: str
    default: object
    value: object
    range: tuple[float, float] | None
    step: float | None
    choices: tuple[object, ...] | None
    group: str
    doc: str
    span: Span
    settable: bool = True


#: Most pixels of a picture along a side; JPEG holds no more.
LARGEST_SIDE = 65535

#: More frames a film does not have: half a day at 24 frames per second.
MOST_FRAMES = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    surfaces: tuple[Surface, ...]
    materials: tuple[Material, ...]
    camera: Camera  # lower fills in the default camera, lights and background
    lights: tuple[Light, ...]
    background: Background
    width: int = 640
    height: int = 480
    animate: Animate | None = None
    params: tuple[ParamInfo, ...] = ()
    spans: tuple[Span, ...] = field(default=(), repr=False)
    sources: tuple[tuple[str, str], ...] = ()  # (path, sha256 of the text) of every file read
    floor: Floor | None = None
    fog: Fog | None = None
    tone: Tone = Tone()
