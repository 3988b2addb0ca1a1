"""The light of `tracer/shade.c` and `tracer/brdf.h` once more, one ray at a time, in NumPy.

Written from the formulas' sources, not from the C: the tracer only says what a ray hits.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import blobscript
from blobscript import ir
from blobscript.backends import picture
from blobscript.backends.native import ENTER, EXIT, Native

DEPTH = 8
FAINT = 1 / 1024
Vec = NDArray[np.float64]


def unit(v: Vec) -> Vec:
    return v / np.linalg.norm(v)


class Reference:
    def __init__(self, scene: ir.Scene, native: Native) -> None:
        self.scene, self.native = scene, native
        self.rows = np.array([_row(m) for m in scene.materials])
        self._light: Vec | None = None

    # ---- the scene -----------------------------------------------------------------

    def background(self, d: Vec, depth: int = 1) -> Vec:
        b = self.scene.background
        if not b.default and depth == 0:
            return np.array(b.color)
        above, below = (picture.ABOVE, picture.BELOW) if b.default else (b.color, picture.FLOOR * np.array(b.color))
        share = (1 + (d[1] - picture.LEVEL) / math.hypot(d[1] - picture.LEVEL, picture.BEND)) / 2
        return np.array(below) * (1 - share) + np.array(above) * share

    def ambient(self, n: Vec) -> Vec:
        """Irradiance / pi: the background's mean and its linear part, summed over many directions."""
        y = (np.arange(20_000) + 0.5) / 10_000 - 1
        light = np.array([self.background(np.array((0.0, h, 0.0))) for h in y]) if self._light is None else self._light
        self._light = light
        return light.mean(axis=0) + 3 * (light * y[:, None]).mean(axis=0) * n[1] * 2 / 3

    def direction(self, x: float, y: float) -> Vec:
        c = self.scene.camera
        ahead = unit(np.array(c.to) - c.at)
        side = unit(np.cross(ahead, c.up))
        top = np.cross(side, ahead)
        height = math.tan(c.fov / 2)
        across = height * self.scene.width / self.scene.height
        u, v = 2 * x / self.scene.width - 1, 1 - 2 * y / self.scene.height
        return unit(ahead + side * u * across + top * v * height)

    def pixel(self, x: int, y: int) -> Vec:
        return self.radiance(np.array(self.scene.camera.at), self.direction(x + 0.5, y + 0.5), np.ones(3), 0)

    # ---- light ---------------------------------------------------------------------

    def hit(self, o: Vec, d: Vec, end: float = math.inf) -> tuple[int, float, Vec, int]:
        h = self.native.first_hit(o[None], d[None], 0.0, end)
        return int(h.status[0]), float(h.t[0]), h.normal[0], int(h.surface[0])

    def material(self, p: Vec, surface: int) -> ir.Material:
        row = self.native.paint(p[None], [surface], self.rows)[0]
        r, g, b, rough, metal, spec, trans, ior, ar, ag, ab, er, eg, eb, mirror = row
        return ir.Material((r, g, b), rough, metal, spec, trans, ior, (ar, ag, ab), (er, eg, eb), mirror)

    def radiance(self, o: Vec, d: Vec, weight: Vec, depth: int) -> Vec:
        """Light along -d; `weight` only decides what is too faint to follow."""
        status, t, normal, surface = self.hit(o, d)
        if status not in (ENTER, EXIT):
            return self.background(d, depth)
        p, eye, inside = o + t * d, -d, status == EXIT
        n = -normal if inside else normal
        m = self.material(p, surface)
        through = m.transmission * (1 - m.metalness)
        veil = np.exp(-np.array(m.absorption) * t) if inside and through > 0 else np.ones(3)
        nv = max(float(n @ eye), 1e-6)
        f0 = (1 - through) * base_reflectance(m) + through * ((m.ior - 1) / (m.ior + 1)) ** 2
        layer = layer_share(f0, m, nv)
        base = np.array(m.color) * (1 - m.metalness) * (1 - m.transmission) * (1 - layer)
        sharp = 0.0 if inside else m.metalness * (1 - m.roughness) ** 2
        image = 2 * (n @ eye) * n - eye
        plain = 1 - m.reflection
        blurred = (1 - m.roughness) * self.background(image) + m.roughness * self.ambient(image)
        fill = picture.FILL + (1 - picture.FILL) * m.metalness
        light = np.array(m.emission) + plain * picture.FILL * base * self.ambient(n)
        light = light + plain * (1 - sharp) * (1 - through) * fill * layer * blurred
        if not inside:
            light = light + sum(self.lamp(k, p, n, eye, nv, m, f0, base) for k in self.scene.lights)
        fresnel, bent = refract(eye, n, nv, m.ior if inside else 1 / m.ior) if through > 0 else (0.0, None)
        mirror = m.reflection + plain * (through * fresnel + (1 - through) * sharp * layer)
        bounces = [(image, mirror * np.ones(3))]
        if bent is not None:
            bounces.append((bent, plain * through * (1 - fresnel) * np.ones(3)))
        for way, share in bounces:
            carried = weight * veil * share
            if carried.max() < FAINT:
                continue
            seen = self.background(way) if depth >= DEPTH else self.radiance(p, unit(way), carried, depth + 1)
            light = light + share * seen
        return veil * light

    def lamp(self, light: ir.Light, p: Vec, n: Vec, eye: Vec, nv: float, m: ir.Material, f0: Vec, base: Vec) -> Vec:
        if isinstance(light, ir.Sun):
            way, far, arriving = -unit(np.array(light.toward)), math.inf, np.array(light.color)
        else:
            gap = np.array(light.at) - p
            far = float(np.linalg.norm(gap))
            way, arriving = gap / far, np.array(light.color) / far**2
        if n @ way <= 0:
            return np.zeros(3)
        answer = (1 - m.reflection) * base * oren_nayar(m.roughness / 2, n, eye, way, nv)
        answer = answer + gain(m, nv) * ggx(f0, m.roughness, n, eye, way, nv)
        return self.passing(p, way, far) * arriving * answer

    def passing(self, p: Vec, way: Vec, far: float) -> Vec:
        """Share of the light that comes through what is between."""
        share = np.ones(3)
        for _ in range(2 * DEPTH):
            status, t, _, surface = self.hit(p, way, far)
            if status not in (ENTER, EXIT):
                break
            p, far = p + t * way, far - t
            m = self.material(p, surface)
            through = m.transmission * (1 - m.metalness) * (1 - m.reflection)
            share = share * (np.exp(-np.array(m.absorption) * t) if status == EXIT and through > 0 else through)
            if share.max() < FAINT:
                return np.zeros(3)
        return share


def _row(m: ir.Material) -> list[float]:
    plain = [m.roughness, m.metalness, m.specular, m.transmission, m.ior]
    return [*m.color, *plain, *m.absorption, *m.emission, m.reflection]


def base_reflectance(m: ir.Material) -> Vec:
    return 0.08 * m.specular * (1 - m.metalness) + m.metalness * np.array(m.color)


def _singles() -> Vec:
    """The table in brdf.h; test_brdf.py compares it with integrals."""
    text = (Path(blobscript.__file__).parent / "tracer" / "brdf.h").read_text(encoding="utf-8")
    rows = text.split("brdf_singles[BRDF_SINGLES][BRDF_SINGLES] = {")[1].split("};")[0]
    return np.array([float(x) for x in re.findall(r"\d\.\d+", rows)]).reshape(16, 16)


SINGLES = _singles()


def single(roughness: float, nv: float) -> float:
    """What facets that reflect all return after one reflection, linear between the nodes of the table."""
    nodes = np.arange(16) / 15
    columns = [np.interp(math.sqrt(nv), nodes, row) for row in SINGLES]
    return float(np.interp(roughness, nodes, columns))


def gain(m: ir.Material, nv: float) -> Vec:
    """Turquin (2019), for the metal's part."""
    return 1 + m.metalness * np.array(m.color) * (1 / single(m.roughness, nv) - 1)


def layer_share(f0: Vec, m: ir.Material, nv: float) -> Vec:
    """Karis, Physically Based Shading on Mobile (2014): EnvBRDFApprox; for metals the table, and the gain."""
    roughness = m.roughness
    r = roughness * np.array((-1, -0.0275, -0.572, 0.022)) + np.array((1, 0.0425, 1.04, -0.04))
    a004 = min(r[0] * r[0], 2 ** (-9.28 * nv)) * r[0] + r[1]
    scale, offset = -1.04 * a004 + r[2], max(1.04 * a004 + r[3], 0)
    scale += m.metalness * (single(roughness, nv) - offset - scale)
    return np.minimum((f0 * scale + offset) * gain(m, nv), 1)


def oren_nayar(sigma: float, n: Vec, v: Vec, l: Vec, nv: float) -> float:  # noqa: E741
    """Fujii (2012), times n.l, and what several reflections add as in EON (Portsmouth et al. 2024)."""
    nl = float(n @ l)
    s = float(l @ v) - nl * nv
    t = max(nl, nv) if s > 0 else 1.0
    a = 1 / (math.pi + (math.pi / 2 - 2 / 3) * sigma)
    lift = np.polynomial.Polynomial((0.0009, 0.6722, 0.3476, -0.3969))
    return nl * (a + sigma * a * (s / t + lift(nl) * lift(nv)))


def ggx(f0: Vec, roughness: float, n: Vec, v: Vec, l: Vec, nv: float) -> Vec:  # noqa: E741
    """Walter et al. (2007) with Heitz's (2014) masking and Schlick's (1994) Fresnel, times n.l."""
    alpha2 = max(roughness**2, 0.03) ** 2
    h = unit(v + l)
    nl, nh, vh = float(n @ l), float(n @ h), max(float(v @ h), 0)
    d = alpha2 / (math.pi * max(nh * nh * (alpha2 - 1) + 1, alpha2) ** 2)

    def smith(c: float) -> float:  # Lambda
        return (-1 + math.sqrt(1 + alpha2 * (1 - c * c) / (c * c))) / 2

    g = 1 / (1 + smith(nl) + smith(nv))
    return (f0 + (1 - f0) * (1 - vh) ** 5) * d * g / (4 * nl * nv) * nl


def refract(eye: Vec, n: Vec, nv: float, eta: float) -> tuple[float, Vec | None]:
    """Fresnel's reflectance and the direction behind; total reflection: 1 and none."""
    sine = eta * math.sqrt(1 - nv * nv)
    if sine >= 1:
        return 1.0, None
    behind = math.cos(math.asin(sine))
    # amplitude ratios with the indices n1 = eta, n2 = 1
    s = (eta * nv - behind) / (eta * nv + behind)
    p = (nv - eta * behind) / (nv + eta * behind)
    return (s * s + p * p) / 2, -eta * eye + (eta * nv - behind) * n
