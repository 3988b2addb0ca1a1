"""Small scenes, made by hand, for the tests of pictures."""

from __future__ import annotations

import math

import numpy as np

from blobscript import ir
from blobscript.source import Source, Span

CLAY = ir.Material((0.8, 0.3, 0.2), roughness=0.9, specular=0.25)
PLASTIC = ir.Material((0.2, 0.4, 0.8), roughness=0.25)
METAL = ir.Material((0.9, 0.7, 0.4), roughness=0.35, metalness=1.0)
MIRROR = ir.Material((0.5, 0.5, 0.5), roughness=0.6, reflection=0.6, emission=(0.0, 0.1, 0.0))
GLASS = ir.Material((1.0, 1.0, 1.0), roughness=0.0, transmission=1.0, ior=1.5, absorption=(0.1, 0.4, 0.2))
JELLY = ir.Material((0.9, 0.2, 0.3), roughness=0.1, transmission=0.7, ior=1.35, absorption=(0.2, 1.5, 1.0))
MATERIALS = (CLAY, PLASTIC, METAL, MIRROR, GLASS, JELLY)

SUN = ir.Sun((0.5, -0.8, -0.4), (2.5, 2.4, 2.2))
LAMP = ir.Lamp((-3.0, 2.5, 3.0), (9.0, 10.0, 12.0))
SKY = ir.Background((0.8, 0.85, 0.9), default=True)


def points(at: object, reach: float, paint: object = -1) -> ir.Leaf:
    """Summed points of weight 1."""
    places = np.array(at, np.float64).reshape(-1, 3)
    n = len(places)
    paints = np.broadcast_to(np.array(paint, np.int32), n).copy()
    return ir.Leaf(ir.Points(places), ir.Kernel("wyvill"), np.full(n, reach), np.ones(n), paints, np.zeros(n, np.int32))


def look(
    at: tuple[float, float, float],
    to: tuple[float, float, float] = (0.0, 0.0, 0.0),
    up: tuple[float, float, float] = (0.0, 1.0, 0.0),
    fov: float = 0.6,
) -> ir.Camera:
    """As if written in a script: the default camera is fitted anew to each size."""
    return ir.Camera(at, to, up, fov, Span(Source("test", ""), 0, 0))


def camera(distance: float = 7.0, fov: float = 0.6) -> ir.Camera:
    direction = np.array((0.25, 0.3, 1.0))
    at = direction / np.linalg.norm(direction) * distance
    return look((float(at[0]), float(at[1]), float(at[2])), fov=fov)


def scene(
    *surfaces: ir.Surface,
    materials: tuple[ir.Material, ...] = MATERIALS,
    lights: tuple[ir.Light, ...] = (SUN, LAMP),
    background: ir.Background = SKY,
    view: ir.Camera | None = None,
) -> ir.Scene:
    return ir.Scene(surfaces, materials, view or camera(), lights, background, 48, 36)


def surface(field: ir.Field, material: int = 0) -> ir.Surface:
    return ir.Surface("surface", field, 0.5, material, None)


def ball(material: int = 0, at: tuple[float, float, float] = (0, 0, 0), radius: float = 1.0) -> ir.Surface:
    """A sphere: the Wyvill kernel is 1/2 at half its reach."""
    return surface(points(at, 2 * radius), material)


def row(count: int = len(MATERIALS)) -> ir.Scene:
    """One lumpy blob of each material, near enough to shade and mirror one another."""
    rng = np.random.default_rng(7)
    blobs = [
        surface(points(rng.standard_normal((6, 3)) * 0.35 + (1.3 * (i % 3) - 1.3, 1.3 * (i // 3) - 0.7, 0), 0.9), i)
        for i in range(count)
    ]
    return scene(*blobs)


def painted() -> ir.Scene:
    """A sum whose blobs have several materials, opaque ones and a transparent one."""
    at = [(-0.8, 0, 0), (0, 0.4, 0), (0.8, 0, 0), (0, -0.6, 0.3)]
    return scene(surface(points(at, 1.1, (0, 1, 2, 5)), 0), ball(0, (0.2, 0.1, -1.8), 0.6))


def plain() -> ir.Scene:
    """A background of one colour, in mirrors and in glass."""
    pair = (ball(2, (-0.8, 0, 0), 0.8), ball(4, (0.9, 0, 0.4), 0.7))
    return scene(*pair, background=ir.Background((0.9, 0.7, 0.5)), lights=(SUN,))


def crowd(n: int = 200) -> ir.Scene:
    rng = np.random.default_rng(11)
    return scene(surface(points(rng.standard_normal((n, 3)) * 0.8, 0.5)), view=camera(6.0, math.radians(35)))
