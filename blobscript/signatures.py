"""The table of everything that is built in: names, signatures in the language's notation, docs.

The checker, the did-you-mean, the lexers and the documentation read this table; the makers
(`makers.MAKERS`) and the functions (`builtins.FUNCTIONS`) implement it by name and by argument name.

Notation: `name[T: a | b](positional: type = default, optional?: type, *, by_name: type) -> result`.
`optional?:` may be left out and is then not passed; `inherited` as a default means the same (the
value comes from the scene tree around the call). `...rest: type` takes any number of further
positional arguments and passes them as a list. `"a" | "b"` is a choice of texts. `[T]` is a list,
`(a: T)` a record, `(T) -> U` a function. `[T: a | b]` is a type variable that may only be a or b;
`[T]` may be anything. The first signature that fits is taken.

A name with a `value` can be used bare; with signatures it can be called; some are both
(`clay`, `clay(coral)`; `gauss`, `gauss(a = 3)`). Colours live in `css.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["BUILTINS", "TYPE_NAMES", "Builtin", "Kind", "names"]

Kind = Literal[
    "skeleton",
    "field",
    "transform",
    "scene",
    "material",
    "kernel",
    "maths",
    "vector",
    "color",
    "list",
    "random",
    "data",
    "query",
]


@dataclass(frozen=True, slots=True)
class Builtin:
    """One name. `value`: its type when used bare (None: it can only be called)."""

    name: str
    kind: Kind
    signatures: tuple[str, ...]
    doc: str
    value: str | None = None


#: The types that a script can name.
TYPE_NAMES = (
    "number",
    "int",
    "angle",
    "bool",
    "text",
    "vec3",
    "color",
    "skeleton",
    "kernel",
    "field",
    "surface",
    "material",
    "light",
    "camera",
    "background",
    "stage",
    "image",
    "animate",
    "transform",
)

_MOVABLE = "[T: skeleton | field | surface | light | camera | transform]"
_BLOB = "reach?: number, weight?: number, kernel: kernel = inherited"
_NODE = "(children: field | [field], *, kernel: kernel = inherited) -> field"

_SKELETONS = (
    Builtin(
        "point",
        "skeleton",
        ("(x: number, y: number, z: number) -> skeleton", "(p: vec3) -> skeleton"),
        "A single point.",
    ),
    Builtin("line", "skeleton", ("(a: vec3, b: vec3) -> skeleton",), "The straight piece from a to b."),
    Builtin(
        "polyline",
        "skeleton",
        ("(points: [vec3], closed: bool = false) -> skeleton",),
        "Straight pieces from point to point; `closed` joins the last to the first.",
    ),
    Builtin(
        "polygon",
        "skeleton",
        ("(points: [vec3]) -> skeleton",),
        "A flat area; planar, without crossing edges, may be concave.",
    ),
    Builtin(
        "polyhedron",
        "skeleton",
        ("(points: [vec3], faces: [[int]]) -> skeleton",),
        "A solid body, closed, convex or concave; faces index into points.",
    ),
    Builtin(
        "mesh",
        "skeleton",
        (
            "(file: text, solid: bool = false) -> skeleton",
            "(points: [vec3], faces: [[int]], solid: bool = false) -> skeleton",
        ),
        "A surface of polygons from a file or from lists; `solid` fills a closed one.",
    ),
    Builtin(
        "points",
        "skeleton",
        ("(file: text) -> skeleton", "(at: [vec3]) -> skeleton"),
        "Many points as one skeleton (the nearest counts), from a file or a list.",
    ),
)

_FIELDS = (
    Builtin(
        "blob",
        "field",
        (f"(skeleton: skeleton, radius?: number, {_BLOB}) -> field",),
        "A density around a skeleton; any two of radius, reach and weight determine the third.",
    ),
    Builtin(
        "ball",
        "field",
        (
            "(at: vec3 = (0, 0, 0), radius?: number, *, reach?: number, weight?: number, "
            "kernel: kernel = inherited) -> field",
        ),
        "The blob of one point.",
    ),
    Builtin(
        "balls",
        "field",
        (
            "(at: vec3 | [vec3], radius?: number | [number], *, reach?: number | [number], "
            "weight?: number | [number], kernel: kernel = inherited, "
            "paint?: color | material | [color] | [material]) -> field",
        ),
        "The sum of one ball per point; each argument is one value or a list of them.",
    ),
    Builtin("sum", "field", (_NODE,), "Adds the densities of its fields and blends their paint."),
    Builtin(
        "max",
        "field",
        (
            _NODE,
            "[N: int | number | angle](list: [N]) -> N",
            "[N: int | number | angle](first: N, ...rest: N) -> N",
        ),
        "The largest of its fields (with the winner's paint), or of numbers.",
    ),
    Builtin(
        "min",
        "field",
        (
            _NODE,
            "[N: int | number | angle](list: [N]) -> N",
            "[N: int | number | angle](first: N, ...rest: N) -> N",
        ),
        "The smallest of its fields, or of numbers.",
    ),
    Builtin(
        "smooth_max",
        "field",
        (_NODE,),
        "The maximum without its crease: fields join smoothly and never swell; blends their paint.",
    ),
    Builtin("paint", "field", ("(field: field, with: color | material) -> field",), "Gives a field its own look."),
)

_TRANSFORMS = (
    Builtin("identity", "transform", (), "The transform that changes nothing.", "transform"),
    Builtin(
        "move",
        "transform",
        (f"{_MOVABLE}(it: T, v: vec3) -> T", f"{_MOVABLE}(it: T, x: number = 0, y: number = 0, z: number = 0) -> T"),
        "Shifts a thing.",
    ),
    Builtin(
        "rotate",
        "transform",
        (
            f"{_MOVABLE}(it: T, angle: angle, axis: vec3) -> T",
            f"{_MOVABLE}(it: T, x: angle = 0deg, y: angle = 0deg, z: angle = 0deg) -> T",
        ),
        "Turns a thing about the fixed x, then y, then z axis through the origin, or about any axis.",
    ),
    Builtin(
        "scale",
        "transform",
        (f"{_MOVABLE}(it: T, s: number) -> T", f"{_MOVABLE}(it: T, x: number = 1, y: number = 1, z: number = 1) -> T"),
        "Stretches a thing from the origin; factors are not zero.",
    ),
    Builtin(
        "mirror",
        "transform",
        (f"{_MOVABLE}(it: T, normal: vec3, at: vec3 = (0, 0, 0)) -> T",),
        "Mirrors a thing in the plane through `at`.",
    ),
    Builtin("apply", "transform", (f"{_MOVABLE}(it: T, t: transform) -> T",), "Applies a transform to a thing."),
)

_SCENE = (
    Builtin(
        "surface",
        "scene",
        (
            "(children: field | [field], *, threshold: number = 0.5, material: material = clay, "
            "kernel: kernel = inherited) -> surface",
        ),
        "The set where the sum of its fields reaches the threshold.",
    ),
    Builtin(
        "camera",
        "scene",
        (
            "(from: vec3, to: vec3 = (0, 0, 0), up: vec3 = (0, 1, 0), fov: angle = 40deg, *, "
            "aperture: number = 0, focus?: vec3) -> camera",
        ),
        "Looks from a point to another; `fov` is the full vertical angle. With an aperture (the lens's diameter) "
        "only what is as far as `focus`, or `to`, is sharp.",
    ),
    Builtin(
        "sun",
        "scene",
        ("(toward: vec3, color: color = white, strength: number = 1, *, angle: angle = 0.53deg) -> light",),
        "Parallel light; `toward` is the way it travels, strength its irradiance. A wider `angle`, the sun's "
        "diameter in the sky, makes softer shadows.",
    ),
    Builtin(
        "lamp",
        "scene",
        ("(at: vec3, color: color = white, strength: number = 1, *, size: number = 0) -> light",),
        "Light from a point, or from a ball of the diameter `size`; its irradiance is strength / distance^2.",
    ),
    Builtin("background", "scene", ("(color: color) -> background",), "What rays see that hit nothing."),
    Builtin(
        "sky",
        "scene",
        (
            "(zenith: color = #6fa3dc, horizon: color = #e6eef5, ground: color = #8a8680, *, strength: number = 1, "
            "shown?: color) -> background",
        ),
        "A background that is light: one colour above, one level, one below. `shown`: what the camera sees instead.",
    ),
    Builtin(
        "environment",
        "scene",
        ("(file: text, strength: number = 1, *, turn: angle = 0deg, shown?: color) -> background",),
        "A picture of all directions (latitudes by rows, .exr or .hdr) as background and light; `turn` turns it "
        "about the y axis.",
    ),
    Builtin(
        "fog",
        "scene",
        ("(distance: number, color: color = #cfd8e0) -> stage",),
        "What is `distance` away has faded to 1/e.",
    ),
    Builtin(
        "tone",
        "scene",
        ('(curve: "linear" | "film" = "film", *, exposure: number = 0) -> stage',),
        "How light becomes a picture: exposure in stops, then a curve; `film` keeps highlights from being cut.",
    ),
    Builtin(
        "image", "scene", ("(width: int = 640, height: int = 480) -> image",), "The size of the picture in pixels."
    ),
    Builtin(
        "animate",
        "scene",
        ("(seconds: number, fps: number = 24) -> animate",),
        "Makes a film; frame k shows time k / fps and phase k / N.",
    ),
    Builtin("time", "scene", (), "Seconds since the start of the film; 0 in a still.", "number"),
    Builtin("phase", "scene", (), "Runs from 0 (with 0) to 1 (without 1) over the film; 0 in a still.", "number"),
)


_COLOR_OR_FUNCTION = "color | (vec3) -> color"
_NUMBER_OR_FUNCTION = "number | (vec3) -> number"


def _material(name: str, doc: str) -> Builtin:
    return Builtin(name, "material", (f"(color?: {_COLOR_OR_FUNCTION}) -> material",), doc, "material")


_MATERIALS = (
    _material("clay", "Matt, like unfired clay."),
    _material("plastic", "Smooth, with a white highlight."),
    _material("metal", "Brushed metal."),
    _material("glass", "Clear, refracts."),
    _material("jelly", "Translucent and tinted inside."),
    _material("chrome", "A mirror."),
    _material("stone", "Rough and grey."),
    Builtin(
        "material",
        "material",
        (
            f"(color: {_COLOR_OR_FUNCTION} = white, *, roughness: {_NUMBER_OR_FUNCTION} = 0.5, "
            f"metalness: {_NUMBER_OR_FUNCTION} = 0, specular: number = 0.5, transmission: number = 0, "
            "ior: number = 1.5, absorption: color = black, depth?: number, "
            f"emission: {_COLOR_OR_FUNCTION} = black, glow: number = 1, reflection: number = 0, "
            "bump?: (vec3) -> number) -> material",
        ),
        "A material of one's own, in the metallic-roughness model. Parts may be functions of the place; `bump` is "
        "a height over the surface, which turns its normal.",
    ),
)

_KERNELS = (
    Builtin("soft2", "kernel", (), "(1 - r^2)^2, POV-Ray's blob.", "kernel"),
    Builtin("soft3", "kernel", (), "(1 - r^2)^3, cubic in the squared distance.", "kernel"),
    Builtin("wyvill", "kernel", (), "1 - 4/9 r^6 + 17/9 r^4 - 22/9 r^2; the default.", "kernel"),
    Builtin("gauss", "kernel", ("(a: number = 4) -> kernel",), "exp(-a r^2), Blinn's; never quite ends.", "kernel"),
    Builtin("gauss_c1", "kernel", ("(a: number = 4) -> kernel",), "A Gaussian that ends flat at r = 1.", "kernel"),
    Builtin("metaball", "kernel", (), "Nishimura's two parabolas that meet at r = 1/3.", "kernel"),
)

_SAME = "[N: int | number | angle]"
_LERP = "[V: number | vec3 | color | angle]"

_MATHS = (
    Builtin("pi", "maths", (), "3.14159..., half a turn in radians.", "number"),
    Builtin("abs", "maths", (f"{_SAME}(x: N) -> N",), "The size without the sign."),
    Builtin("sign", "maths", ("[N: number | angle](x: N) -> int",), "-1, 0 or 1."),
    Builtin(
        "floor",
        "maths",
        (
            "(x: number) -> int",
            "(*, y: number = 0, material?: material, catch: bool = false, fade: number = 0) -> stage",
        ),
        "The largest whole number not above x. Or, in a scene, the plane at the height `y`, seen from above: of a "
        "material, or only where shadows fall (`catch`); `fade` lets it pass into the background.",
    ),
    Builtin("ceil", "maths", ("(x: number) -> int",), "The smallest whole number not below x."),
    Builtin("round", "maths", ("(x: number) -> int",), "The nearest whole number; halves go away from 0."),
    Builtin("mod", "maths", (f"{_SAME}(x: N, by: N) -> N",), "x - by * floor(x / by): lies between 0 and `by`."),
    Builtin("sqrt", "maths", ("(x: number) -> number",), "Square root."),
    Builtin("exp", "maths", ("(x: number) -> number",), "e to the power of x."),
    Builtin("log", "maths", ("(x: number) -> number",), "Natural logarithm."),
    Builtin("clamp", "maths", (f"{_SAME}(x: N, lo: N, hi: N) -> N",), "x, but not below lo and not above hi."),
    Builtin("lerp", "maths", (f"{_LERP}(a: V, b: V, t: number) -> V",), "a at t = 0, b at t = 1, straight between."),
    Builtin("sin", "maths", ("(x: angle) -> number",), "Sine."),
    Builtin("cos", "maths", ("(x: angle) -> number",), "Cosine."),
    Builtin("tan", "maths", ("(x: angle) -> number",), "Tangent. (The colour of this name is `#d2b48c`.)"),
    Builtin("asin", "maths", ("(x: number) -> angle",), "The angle with this sine."),
    Builtin("acos", "maths", ("(x: number) -> angle",), "The angle with this cosine."),
    Builtin("atan", "maths", ("(x: number) -> angle",), "The angle with this tangent."),
    Builtin("atan2", "maths", ("(y: number, x: number) -> angle",), "The direction of (x, y), -180deg to 180deg."),
)

_VECTORS = (
    Builtin("dot", "vector", ("(a: vec3, b: vec3) -> number",), "Scalar product."),
    Builtin("cross", "vector", ("(a: vec3, b: vec3) -> vec3",), "Vector product, right-handed."),
    Builtin("length", "vector", ("(v: vec3) -> number",), "The length of a vector."),
    Builtin("normalize", "vector", ("(v: vec3) -> vec3",), "The same direction with length 1."),
)

_COLORS = (
    Builtin(
        "rgb",
        "color",
        ("(r: number, g: number, b: number, a: number = 1) -> color",),
        "sRGB as on the web, each 0 to 1.",
    ),
    Builtin(
        "hsl",
        "color",
        ("(h: angle, s: number, l: number, a: number = 1) -> color",),
        "Hue, saturation and lightness (0 to 1) as in CSS.",
    ),
    Builtin(
        "oklch",
        "color",
        ("(l: number, c: number, h: angle, a: number = 1) -> color",),
        "Perceptual lightness (0 to 1), chroma (0 to about 0.4) and hue.",
    ),
)

_LISTS = (
    Builtin("len", "list", ("[T](list: [T]) -> int", "(text: text) -> int"), "How many elements or characters."),
    Builtin(
        "find",
        "list",
        ("[T](list: [T], where: (T) -> bool) -> T",),
        "The first element that fits; an error if none does.",
    ),
    Builtin("filter", "list", ("[T](list: [T], where: (T) -> bool) -> [T]",), "The elements that fit."),
    Builtin("map", "list", ("[A, B](list: [A], with: (A) -> B) -> [B]",), "The function's value for each element."),
    Builtin(
        "fold",
        "list",
        ("[A, B](list: [A], start: B, with: (B, A) -> B) -> B",),
        "Carries a value through the list: with(... with(start, first) ..., last).",
    ),
)

_RANDOM = (
    Builtin("rand", "random", ("(i: int, seed: int = 0) -> number",), "A fixed random number in [0, 1) for each i."),
    Builtin("noise", "random", ("(p: vec3, seed: int = 0) -> number",), "Smooth gradient noise in [-1, 1]."),
)

_DATA = (
    Builtin(
        "read_points",
        "data",
        ("(file: text) -> [vec3]",),
        "The points of a file (CSV with columns x, y, z; JSON; XYZ).",
    ),
    Builtin(
        "read_records",
        "data",
        ("[R](file: text) -> [R]",),
        "The rows of a file (CSV, JSON, XYZ: kind and at) as records.",
    ),
)

_QUERIES = (
    Builtin("inside", "query", ("(surface: surface, at: vec3) -> bool",), "Does the point lie in the surface?"),
    Builtin(
        "field_at",
        "query",
        ("(surface: surface, at: vec3) -> number",),
        "The combined density at a point (inside: >= threshold).",
    ),
    Builtin(
        "bounds",
        "query",
        ("(surface: surface) -> (lo: vec3, hi: vec3)",),
        "A box that certainly holds the surface.",
    ),
)

#: Everything but the named colours, by name.
BUILTINS: dict[str, Builtin] = {
    row.name: row
    for table in (
        _SKELETONS,
        _FIELDS,
        _TRANSFORMS,
        _SCENE,
        _MATERIALS,
        _KERNELS,
        _MATHS,
        _VECTORS,
        _COLORS,
        _LISTS,
        _RANDOM,
        _DATA,
        _QUERIES,
    )
    for row in table
}


def names(kind: Kind) -> tuple[str, ...]:
    """All names of a kind, in the order of the table."""
    return tuple(name for name, row in BUILTINS.items() if row.kind == kind)
