"""What the scene-making built-ins do: one function per name, `MAKERS[name](context, **arguments)`.

Arguments come by the names in `signatures`, already of the right type; absent ones are not passed.
Makers check what a type cannot say (finite, positive, not degenerate) and raise `MakerError`.
They never look at the scene around them: thresholds and inherited kernels are `assemble`'s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from blobscript import data, ir, looks, queries, shapes, stages, transforms
from blobscript.arguments import (
    count_text,
    direction,
    limits,
    not_negative,
    number,
    numbers,
    positive,
    show,
    vector,
    vectors,
)
from blobscript.diagnostics import Help
from blobscript.values import (
    Animate,
    Blob,
    Camera,
    Changed,
    Cloud,
    Color,
    Combine,
    Context,
    Dot,
    Field,
    Image,
    Maker,
    MakerError,
    Material,
    Paint,
    Segment,
    Skeleton,
    Surface,
    Vec3,
)

__all__ = ["MAKERS"]

Array = NDArray[np.float64]

# ---- skeletons -----------------------------------------------------------------------


def _point(ctx: Context, x: float = 0.0, y: float = 0.0, z: float = 0.0, p: Vec3 | None = None) -> Dot:
    return Dot(vector((x, y, z), "x") if p is None else vector(p, "p"))


def _line(ctx: Context, a: Vec3, b: Vec3) -> Segment:
    return Segment(vector(a, "a"), vector(b, "b"))


def _polyline(ctx: Context, points: Sequence[Vec3] | Array, closed: bool = False) -> Skeleton:
    return shapes.polyline(vectors(points, "points"), closed)


def _polygon(ctx: Context, points: Sequence[Vec3] | Array) -> ir.Polygon:
    return shapes.polygon(vectors(points, "points"))


def _polyhedron(ctx: Context, points: Sequence[Vec3] | Array, faces: Sequence[Sequence[int]]) -> ir.Polyhedron:
    return shapes.polyhedron(vectors(points, "points"), faces)


def _mesh(
    ctx: Context,
    file: str | None = None,
    points: Sequence[Vec3] | Array = (),
    faces: Sequence[Sequence[int]] = (),
    solid: bool = False,
) -> ir.Mesh:
    if file is not None:
        from blobscript.meshfiles import read_mesh

        at, found = read_mesh(ctx, file)
        return shapes.mesh(at, found, solid, f"`{file}`")
    return shapes.mesh(vectors(points, "points"), faces, solid, "the mesh")


def _points(ctx: Context, file: str | None = None, at: Sequence[Vec3] | Array = ()) -> Skeleton:
    return shapes.point_set(data.read_points(ctx, file) if file is not None else vectors(at, "at"))


# ---- fields --------------------------------------------------------------------------

_ANY_TWO = "radius alone means reach = 2 * radius; reach alone means weight = 1"


def _check_sizes(what: str, radius: object, reach: object, weight: object) -> None:
    """Any two of the three, or radius or reach alone."""
    if radius is None and reach is None:
        given = "" if weight is None else "only a weight"
        raise MakerError(
            "E0302",
            f"`{what}` needs a radius or a reach" + (f", but it has {given}" if given else ""),
            label="how large is it?",
            helps=(Help("write `radius = 1` for the size you see, or `reach = 2` for where its influence ends"),),
            notes=(_ANY_TWO,),
        )
    if radius is not None and reach is not None and weight is not None:
        raise MakerError(
            "E0406",
            f"`{what}` has a radius, a reach and a weight: any two determine the third",
            argument="weight",
            label="one too many",
            helps=(Help("leave one of the three out"),),
        )


def _size(value: float | None, argument: str) -> float | None:
    if value is None:
        return None
    return number(value, argument) if argument == "weight" else positive(value, argument)


def _blob(
    ctx: Context,
    skeleton: Skeleton,
    radius: float | None = None,
    reach: float | None = None,
    weight: float | None = None,
    kernel: ir.Kernel | None = None,
) -> Blob:
    _check_sizes("blob", radius, reach, weight)
    return Blob(
        skeleton,
        _size(radius, "radius"),
        _size(reach, "reach"),
        _size(weight, "weight"),
        kernel,
        None,
        ctx.origin(ctx.span),
    )


def _ball(
    ctx: Context,
    at: Vec3 = (0.0, 0.0, 0.0),
    radius: float | None = None,
    reach: float | None = None,
    weight: float | None = None,
    kernel: ir.Kernel | None = None,
) -> Blob:
    _check_sizes("ball", radius, reach, weight)
    return Blob(
        Dot(vector(at, "at")),
        _size(radius, "radius"),
        _size(reach, "reach"),
        _size(weight, "weight"),
        kernel,
        None,
        ctx.origin(ctx.span),
    )


def _balls(
    ctx: Context,
    at: Vec3 | Sequence[Vec3] | Array,
    radius: float | Sequence[float] | Array | None = None,
    reach: float | Sequence[float] | Array | None = None,
    weight: float | Sequence[float] | Array | None = None,
    kernel: ir.Kernel | None = None,
    paint: Paint | Sequence[Paint] | None = None,
) -> Blob:
    _check_sizes("balls", radius, reach, weight)
    single = isinstance(at, tuple) and len(at) == 3 and not isinstance(at[0], (tuple, list, np.ndarray))
    centres = np.array([vector(cast(Vec3, at), "at")]) if single else vectors(cast("Sequence[Vec3]", at), "at")
    n = len(centres)
    return Blob(
        Cloud(centres),
        _sizes(radius, n, "radius"),
        _sizes(reach, n, "reach"),
        _sizes(weight, n, "weight"),
        kernel,
        _paints(paint, n),
        ctx.origin(ctx.span),
    )


def _sizes(value: float | Sequence[float] | Array | None, n: int, argument: str) -> float | Array | None:
    """One size for all, or one for each of n balls."""
    if value is None or isinstance(value, (int, float)):
        return _size(value, argument)
    _check_length(len(value), n, argument)
    sizes = numbers(value)
    smallest, largest = limits(argument)
    wrong = ~(np.abs(sizes) <= largest) if argument == "weight" else ~((sizes <= largest) & (sizes >= smallest))
    if wrong.any():
        i = int(np.argmax(wrong))
        wanted = "finite numbers" if argument == "weight" else "positive numbers"
        raise MakerError(
            "E0405",
            f"`{argument}` must be {wanted}, but number {i} of the list is {show(sizes[i])}",
            argument=argument,
            label=f"[{i}] is {show(sizes[i])} (counted from 0)",
        )
    return sizes


def _paints(value: Paint | Sequence[Paint] | None, n: int) -> Paint | tuple[Paint, ...] | None:
    if value is None or isinstance(value, (Color, Material)):
        return value
    _check_length(len(value), n, "paint")
    return tuple(value)


def _check_length(length: int, n: int, argument: str) -> None:
    if length != n:
        raise MakerError(
            "E0405",
            f"`balls` has {count_text(n, 'point')}, but `{argument}` lists {count_text(length, 'value')}",
            argument=argument,
            label=f"{count_text(length, 'value')} for {count_text(n, 'point')}",
            helps=(Help("give one value for all, or a list with one value for each point"),),
        )


def _fields(children: Field | Sequence[Field]) -> tuple[Field, ...]:
    return (children,) if isinstance(children, (Blob, Combine, Changed)) else tuple(children)


def _sum(ctx: Context, children: Field | Sequence[Field], kernel: ir.Kernel | None = None) -> Combine:
    return Combine("sum", _fields(children), kernel, ctx.origin(ctx.span))


def _max(ctx: Context, children: Field | Sequence[Field], kernel: ir.Kernel | None = None) -> Combine:
    return Combine("max", _fields(children), kernel, ctx.origin(ctx.span))


def _min(ctx: Context, children: Field | Sequence[Field], kernel: ir.Kernel | None = None) -> Combine:
    return Combine("min", _fields(children), kernel, ctx.origin(ctx.span))


def _smooth_max(ctx: Context, children: Field | Sequence[Field], kernel: ir.Kernel | None = None) -> Combine:
    return Combine("smooth_max", _fields(children), kernel, ctx.origin(ctx.span))


def _paint(ctx: Context, field: Field, **arguments: Paint) -> Field:
    """`with` is a keyword of Python, so it comes in `arguments`. Paint inside a field stays."""
    paint = arguments["with"]
    if isinstance(field, Changed) and field.paint is None:
        return Changed(field.inner, field.matrix, field.factor, paint, field.origin)
    return Changed(field, paint=paint, origin=ctx.origin(ctx.span))


# ---- the scene -----------------------------------------------------------------------


def _surface(
    ctx: Context,
    children: Field | Sequence[Field],
    threshold: float = 0.5,
    material: Material | None = None,
    kernel: ir.Kernel | None = None,
) -> Surface:
    field = Combine("sum", _fields(children), kernel, ctx.origin(ctx.span))
    return Surface(
        field,
        number(threshold, "threshold"),
        material or looks.LOOKS["clay"],
        kernel,
        span=ctx.span,
        threshold_span=ctx.places.get("threshold"),
    )


def _camera(
    ctx: Context,
    to: Vec3 = (0.0, 0.0, 0.0),
    up: Vec3 = (0.0, 1.0, 0.0),
    fov: float = math.radians(40),
    aperture: float = 0.0,
    focus: Vec3 | None = None,
    **arguments: Vec3,
) -> Camera:
    """`from` is a keyword of Python, so it comes in `arguments`."""
    at, to, up = vector(arguments["from"], "from"), vector(to, "to"), direction(up, "up")
    view = np.subtract(to, at)
    if not np.any(view):
        helps = (Help("move one of them: the camera stands at `from` and looks at `to`"),)
        raise MakerError("E0405", "the camera looks nowhere: `from` and `to` are the same point", "to", "", helps)
    view = view / np.abs(view).max()
    if np.linalg.norm(np.cross(view, np.divide(up, np.abs(up).max()))) < 1e-9:
        raise MakerError(
            "E0405",
            "the camera looks along its own `up`, so nothing says which way is up in the picture",
            argument="up" if up != (0.0, 1.0, 0.0) else None,
            label=f"`up` is {show(up)}",
            helps=(Help("give an `up` that crosses the view, for example up = (0, 0, 1)"),),
        )
    if not 0 < number(fov, "fov") < math.pi:
        raise MakerError(
            "E0405",
            f"`fov` must lie between 0deg and 180deg, but it is {show(math.degrees(fov))}deg",
            argument="fov",
            helps=(Help("40deg is like a camera, 90deg like a wide-angle lens"),),
        )
    lens = not_negative(aperture, "aperture", "0 is a pinhole: everything is sharp")
    sharp = None if focus is None else _in_front(vector(focus, "focus"), at, view)
    return Camera(at, to, up, float(fov), ctx.span, lens, sharp)


def _in_front(focus: Vec3, at: Vec3, view: Array) -> Vec3:
    if not float(np.dot(np.subtract(focus, at), view)) > 0:
        helps = (Help("give a point of what should be sharp"),)
        raise MakerError("E0405", "`focus` lies behind the camera", "focus", show(focus), helps)
    return focus


def _image(ctx: Context, width: int = 640, height: int = 480) -> Image:
    for argument, value in (("width", width), ("height", height)):
        if not 1 <= value <= ir.LARGEST_SIDE:
            raise MakerError(
                "E0405", f"`{argument}` must lie in 1..{ir.LARGEST_SIDE} pixels, but it is {show(value)}", argument
            )
    return Image(int(width), int(height))


def _animate(ctx: Context, seconds: float, fps: float = 24.0) -> Animate:
    film = Animate(positive(seconds, "seconds"), positive(fps, "fps"))
    frames = round(min(film.seconds * film.fps, 1e9))
    if not 1 <= frames <= ir.MOST_FRAMES:
        number = f"more than {ir.MOST_FRAMES} frames" if frames else "no frame"
        raise MakerError(
            "E0405",
            f"{show(seconds)} seconds at {show(fps)} frames per second are {number}",
            "seconds",
            helps=(Help("`animate(seconds = 4, fps = 24)` is a film of 96 frames"),),
        )
    return film


# ---- kernels -------------------------------------------------------------------------


def _gaussian(name: str) -> Maker:
    def maker(ctx: Context, a: float = 4.0) -> ir.Kernel:
        return ir.Kernel(name, positive(a, "a"))

    return maker


MAKERS: dict[str, Maker] = {
    "point": _point,
    "line": _line,
    "polyline": _polyline,
    "polygon": _polygon,
    "polyhedron": _polyhedron,
    "mesh": _mesh,
    "points": _points,
    "blob": _blob,
    "ball": _ball,
    "balls": _balls,
    "sum": _sum,
    "max": _max,
    "min": _min,
    "smooth_max": _smooth_max,
    "paint": _paint,
    "surface": _surface,
    "camera": _camera,
    **stages.MAKERS,
    "image": _image,
    "animate": _animate,
    **looks.MAKERS,
    "gauss": _gaussian("gauss"),
    "gauss_c1": _gaussian("gauss_c1"),
    **transforms.MAKERS,
    "read_points": data.read_points,
    "read_records": data.read_records,
    "inside": queries.inside,
    "field_at": queries.field_at,
    "bounds": queries.bounds,
}
