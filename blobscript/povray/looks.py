"""Materials as textures of POV-Ray.

The models differ: blobscript has Oren-Nayar under a layer of microfacets (GGX), POV-Ray a diffuse term with a power of
the cosine, and highlights of Blinn. What a texture can say exactly, it says:

- Light from the background without a lamp depends on the normal and the eye only: `slope` knows the one, `aoi` the
  other, and a table over both, as emission, stands for it.
- The base gets what the layer leaves, which depends on the angle towards the eye: a table of `aoi`. So does what
  the facets of metals send on to one another, which tints their highlights.

The rest is fitted: see `_diffuse` and `_shine`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from blobscript import ir
from blobscript.backends import picture
from blobscript.povray.facets import gain, lift, single
from blobscript.povray.surroundings import Surroundings
from blobscript.povray.text import Array, comment, number, vector
from blobscript.povray.view import height_look

__all__ = ["Local", "Scenery", "interior_text", "look_text", "notes_on"]

#: Tables over a part of the normal, as POV-Ray's `slope` gives it (1: along the axis), over that of floors with bumps
#: and the height of the eye over them, and over n.v, as POV-Ray's `aoi` gives it: from the side much changes fast.
_SLOPES = np.linspace(0.0, 1.0, 17)
_BUMPS, _HEIGHTS = np.linspace(0.75, 1.0, 9), 7
_ANGLES = 0.5 + 0.5 * np.linspace(0.0, 1.0, 17) ** 1.5
_ALL = np.ones(3)
#: Colours between which the answer of rough metals is taken as linear: it holds the square of the colour.
_KNOTS = (0.0, 0.25, 0.5, 0.75, 1.0)
#: Fits that are off by less are not worth a word.
_EXACT = 1e-3


class Scenery:
    """What a look depends on besides its material: where the eye is, as a direction, and the lights about it."""

    def __init__(self, scene: ir.Scene, eye: Array, middle: Array, surroundings: Surroundings | None = None) -> None:
        """eye: unit vector from the scene to the camera; middle: of the scene, in units of the script."""
        self.sky, self.eye, self.surroundings = _Sky(scene.background), eye, surroundings
        self.lights = [_towards(light, middle) for light in scene.lights]
        self.diffuse_error, self.shine_error = 0.0, 0.0

    def fits(self) -> list[str]:
        """How well the looks so far are fitted to POV-Ray's models."""
        if max(self.diffuse_error, self.shine_error) < _EXACT:
            return []
        return [
            "the answer of surfaces to lamps and suns is fitted to POV-Ray's models: in the mean over the normals that "
            f"the camera may see, diffuse light is off by at most {self.diffuse_error:.1%} of white, and highlights "
            f"are by {self.shine_error:.1%}"
        ]


@dataclass(frozen=True, slots=True)
class Local:
    """What of a material depends on the place, as functions of POV-Ray: red, green and blue; `normal { … }`. eye: of a
    level floor, the y of the unit vector to the eye, and between what it lies."""

    colors: tuple[str, str, str] | None = None
    normal: str = ""
    eye: tuple[str, float, float] | None = None


def look_text(
    name: str, material: ir.Material, scenery: Scenery, local: Local = Local(), normals: dict[str, str] | None = None
) -> list[str]:
    """`#declare name = texture { … }`. normals: name -> three expressions, for looks of their own."""
    shown = comment(f"{material.name or 'material'}: roughness {number(material.roughness)}")
    if _through(material) > 0:
        return [shown, *_clear(name, material, scenery, local)]
    if normals and scenery.surroundings is not None:
        return [shown, *_mirroring(material, scenery, scenery.surroundings, local, normals)]
    glow = _pigment(lambda m, mask: _glow(m, scenery, mask, local), material, local)
    return [
        shown,
        f"#declare {name} = texture {{ average texture_map {{",
        *(f"  {line}" for line in _lit(material, scenery, local)),
        f"  [1 pigment {{ {glow} }} {local.normal} finish {{ ambient 0 diffuse 0 emission 1 }}]",
        "} }",
    ]


def _mirroring(
    material: ir.Material, scenery: Scenery, surroundings: Surroundings, local: Local, normals: dict[str, str]
) -> list[str]:
    """One texture for what lamps do, shared, and with each way to a normal one for the environment."""
    first, *_ = normals
    lines = [f"#declare {first}_lit = texture {{", *(f"  {line[3:-1]}" for line in _lit(material, scenery, local)), "}"]
    for name, normal in normals.items():
        glow = surroundings.glow(material, normal, local.colors)
        lines += [
            f"#declare {name} = texture {{ average texture_map {{",
            f"  [1 {first}_lit]",
            f"  [1 pigment {{ {glow} }} finish {{ ambient 0 diffuse 0 emission 1 }}]",
            "} }",
        ]
    return lines


def _pigment(make: Callable[[ir.Material, Array], str], material: ir.Material, local: Local) -> str:
    """What `make` gives for a material and factors by colour; where the colour depends on the place, between black and
    white by each part of it, for the answer of a material is linear in its colour, but for metals."""
    if local.colors is None:
        return make(material, _ALL)
    parts: list[str] = []
    for channel, function in enumerate(local.colors):
        mask = 3.0 * np.eye(3)[channel]
        knots = _KNOTS if material.metalness > 0 else (0.0, 1.0)
        made = [f"[{number(c / 2)} {make(replace(material, color=(c, c, c)), mask)}]" for c in knots]
        parts.append(f"[1 function {{ {function}/2 }} pigment_map {{ {' '.join(made)} }}]")
    return "average pigment_map {\n  " + "\n  ".join(parts) + " }"


def interior_text(material: ir.Material, look: str, unit: float) -> str:
    """What is inside of a transparent thing that looks so; nothing for others. Absorption a per unit of length leaves
    exp(-a d). A medium does so on every way through; POV-Ray's `fade_distance` would leave out what is mirrored inside.
    """
    if _through(material) <= 0:
        return ""
    text = f"ior {number(material.ior)}"
    if max(material.absorption) > 0:
        lost = vector(np.array(material.absorption) / unit)
        text += f" media {{ absorption rgb {lost} method 3 intervals 1 samples 1, 1 }}"
    return f" hollow interior {{ {text} }} interior_texture {{ {look}_inside }}"


def notes_on(material: ir.Material, lost: Callable[[], str]) -> list[str]:
    """What POV-Ray can only come close to. lost: by how much where it is seen, with other light that bounces."""
    name = material.name or "material"
    notes: list[str] = []
    if _through(material) > 0 and material.roughness > 0.05:
        notes.append(
            f"{name}: rough transparent materials are smooth in POV-Ray, which changes colours there by {lost()}"
        )
    if material.metalness > 0 and material.roughness > 0.05:
        notes.append(
            f"{name}: the blurred part of what a rough metal mirrors is the background alone in POV-Ray, which changes "
            f"colours there by {lost()}"
        )
    return notes


def _towards(light: ir.Light, middle: Array) -> tuple[Array, float]:
    """Unit vector to a light and how strong it is."""
    if isinstance(light, ir.Sun):
        way, power = -np.array(light.toward, dtype=np.float64), max(light.color)
    else:
        way = np.array(light.at) - middle
        power = max(light.color) / max(float(way @ way), 1e-300)
    return way / np.linalg.norm(way), power


# ---- the layer and the base, as in tracer/brdf.h -------------------------------------------


def _f0(m: ir.Material) -> Array:
    plain = 0.08 * m.specular
    through = _through(m)
    base = plain + (np.array(m.color) - plain) * m.metalness
    glass = ((m.ior - 1) / (m.ior + 1)) ** 2
    return base + (glass - base) * through


def _through(m: ir.Material) -> float:
    return m.transmission * (1 - m.metalness)


def _layer(m: ir.Material, nv: float) -> Array:
    """Share of the light from everywhere that the layer sends to the eye (Karis 2014), with the gain of metals."""
    x, y = 1 - m.roughness, 0.0425 - 0.0275 * m.roughness
    a004 = min(x * x, 2.0 ** (-9.28 * nv)) * x + y
    scale = -1.04 * a004 + 1.04 - 0.572 * m.roughness
    offset = max(1.04 * a004 - 0.04 + 0.022 * m.roughness, 0.0)
    here = np.array([nv])
    scale += m.metalness * (float(single(m, here)[0]) - offset - scale)
    return np.minimum((_f0(m) * scale + offset) * gain(m, here)[0], 1.0)


def _base(m: ir.Material, nv: float) -> Array:
    return (1 - m.metalness) * (1 - m.transmission) * np.array(m.color) * (1 - _layer(m, nv))


# ---- what lamps do ---------------------------------------------------------------------------


def _lit(m: ir.Material, scenery: Scenery, local: Local) -> list[str]:
    """Twice what is meant: the average of two textures is half of their sum."""
    plain = 1 - m.reflection
    brilliance, table = _diffuse(m, scenery)
    metal = m.metalness > 0.5

    def pigment(m: ir.Material, mask: Array) -> str:
        if metal:
            return _by_angle(lambda nv: mask * np.array(m.color) * gain(m, np.array([nv]))[0])
        return _by_angle(lambda nv: 2 * plain * mask * _base(m, nv) * np.interp(nv, *table))

    finish = (
        f"ambient 0 diffuse {0 if metal else 1} brilliance {number(brilliance)} {_shine(m, scenery, 2.0)}{_mirror(m)}"
    )
    return [f"[1 pigment {{ {_pigment(pigment, m, local)} }} {local.normal} finish {{ {finish} }}]"]


def _diffuse(m: ir.Material, scenery: Scenery) -> tuple[float, tuple[Array, Array]]:
    """The power of n.l and the factor by n.v that come closest to Oren-Nayar (Fujii 2012; several reflections as in
    EON, Portsmouth et al. 2024), over all normals that the eye and a light see: POV-Ray's diffuse term is
    factor(n.v) (n.l)^power."""
    angles = (_ANGLES - 0.5) * math.pi
    nodes = np.sin(angles)
    sigma = m.roughness / 2
    level = 1 / (math.pi + (math.pi / 2 - 2 / 3) * sigma)
    if not scenery.lights or sigma == 0:
        return 1.0, (nodes, np.full(len(angles), level))
    normals = _sphere(3000)
    nv = normals @ scenery.eye
    normals, nv = normals[nv > 0.02], nv[nv > 0.02]
    hats = np.stack([np.interp(np.arcsin(np.minimum(nv, 1)), angles, one) for one in np.eye(len(angles))])
    wanted, best = np.zeros(len(nv)), (math.inf, 1.0, np.full(len(angles), level))
    cosines = [(np.maximum(normals @ way, 0.0), power, float(way @ scenery.eye)) for way, power in scenery.lights]
    for nl, power, vl in cosines:
        s = vl - nl * nv
        stretch = np.where(s > 0, s / np.maximum(np.maximum(nl, nv), 1e-9), s)
        wanted += power * nl * level * (1 + sigma * (stretch + lift(nl) * lift(nv)))
    for brilliance in np.arange(0.5, 1.3, 0.05).tolist():
        made = sum((power * nl**brilliance * (nl > 0) for nl, power, _ in cosines), np.zeros(len(nv)))
        factors = (hats * (nv * wanted * made)).sum(axis=1) / np.maximum((hats * (nv * made**2)).sum(axis=1), 1e-12)
        error = float(np.sum(nv * (factors @ hats * made - wanted) ** 2))
        if error < best[0]:
            best = error, round(brilliance, 3), factors
    made = sum((power * nl ** best[1] * (nl > 0) for nl, power, _ in cosines), np.zeros(len(nv)))
    scenery.diffuse_error = max(scenery.diffuse_error, _off(nv, best[2] @ hats * made, wanted))
    return best[1], (nodes, best[2])


def _off(counts: Array, made: Array, wanted: Array) -> float:
    """The mean difference of what a picture shows, where white is 1."""
    gap = np.abs(np.minimum(made, 1.0) - np.minimum(wanted, 1.0))
    return float(np.sum(counts * gap) / np.sum(counts))


def _sphere(count: int) -> Array:
    """Directions spread evenly (Fibonacci)."""
    k = np.arange(count) + 0.5
    y, turn = 1 - 2 * k / count, math.pi * (1 + math.sqrt(5)) * k
    r = np.sqrt(1 - y * y)
    return np.column_stack([r * np.cos(turn), y, r * np.sin(turn)])


def _shine(m: ir.Material, scenery: Scenery, times: float) -> str:
    """The highlight, which has longer tails than either of POV-Ray's: the sum of both, `specular` by N.H and `phong`
    by R.L, that comes closest to GGX. That of a metal has its colour, and the gain in it."""
    metal = m.metalness > 0.5
    f0 = 1.0 if metal else float(np.mean(_f0(m)))
    nh, rl, weight, wanted, counts, power = _highlight(m, f0, scenery, gained=not metal)
    if f0 == 0 or not len(nh):
        return ""
    best = (math.inf, 0.0, 0.0, 0.0, 0.0)
    with np.errstate(under="ignore"):
        narrow = [(e, nh**e) for e in np.geomspace(2.0, 4000.0, 24).tolist()]
        wide = [(e, rl**e) for e in np.geomspace(0.7, 300.0, 18).tolist()]
    for (e, one), (g, two) in product(narrow, wide):
        heights = _two_heights(weight * one, weight * two, weight * wanted)
        error = float(np.sum((weight * (heights[0] * one + heights[1] * two - wanted)) ** 2))
        best = min(best, (error, e, heights[0], g, heights[1]))
    _, e, height, g, lower = best
    with np.errstate(under="ignore"):
        made = power * (height * nh**e + lower * rl**g)
    scenery.shine_error = max(scenery.shine_error, _off(counts, made, power * wanted))
    text = f"specular {number(round(times * height, 6))} roughness {number(round(1 / e, 6))} "
    text += f"phong {number(round(times * lower, 6))} phong_size {number(round(g, 3))}"
    return f"{text} metallic" if metal else text


def _highlight(m: ir.Material, f0: float, scenery: Scenery, gained: bool) -> tuple[Array, ...]:
    """N.H, R.L, weight, GGX's answer (`brdf_specular`), solid angle towards the eye and strength of the light, at
    normals around the half vectors of eye and lights. gained: with the
    gain of metals, in the mean over the colours. Weighed is by solid angle, and less where it is bright anyway."""
    parts: list[Array] = []
    alpha = max(m.roughness**2, 0.03)
    angles, turns = np.linspace(0.004, 1.3, 160), np.arange(12) * (math.pi / 6)
    for way, power in scenery.lights:
        half = (way + scenery.eye) / max(float(np.linalg.norm(way + scenery.eye)), 1e-9)
        side = np.cross(half, np.eye(3)[np.argmin(np.abs(half))])
        side /= np.linalg.norm(side)
        around = np.cos(turns)[:, None] * side + np.sin(turns)[:, None] * np.cross(half, side)
        n = (np.cos(angles)[:, None, None] * half + np.sin(angles)[:, None, None] * around).reshape(-1, 3)
        solid = np.repeat(np.sin(angles), len(turns))
        nl, nv, nh = n @ way, n @ scenery.eye, n @ half
        rl = np.maximum((2 * nv[:, None] * n - scenery.eye) @ way, 0.0)
        seen = (nl > 0.02) & (nv > 0.02) & (nh > 0)
        nl, nv, nh, rl, solid = nl[seen], nv[seen], nh[seen], rl[seen], solid[seen]
        a2 = alpha * alpha
        bowl = np.maximum(nh * nh * (a2 - 1) + 1, a2)
        masking = nl * np.sqrt(nv * nv * (1 - a2) + a2) + nv * np.sqrt(nl * nl * (1 - a2) + a2)
        schlick = f0 + (1 - f0) * math.pow(1 - min(max(float(half @ scenery.eye), 0.0), 1.0), 5)
        answer = schlick * nl * 0.5 / masking * a2 / (math.pi * bowl * bowl)
        answer = answer * gain(m, np.asarray(nv, np.float64)).mean(axis=1) if gained else answer
        weight = np.sqrt(power * solid * nv) / (0.1 + power * answer)
        parts.append(np.asarray([nh, rl, weight, answer, solid * nv, np.full(len(nh), power)], dtype=np.float64))
    rows: Array = np.concatenate(parts, axis=1) if parts else np.zeros((6, 0))
    return tuple(rows)


def _two_heights(one: Array, two: Array, wanted: Array) -> tuple[float, float]:
    """Of least squares, neither below 0."""
    a, b, c = float(one @ one), float(one @ two), float(two @ two)
    p, q = float(one @ wanted), float(two @ wanted)
    determinant = a * c - b * b
    if determinant > 1e-12 * a * c:
        first, second = (p * c - q * b) / determinant, (q * a - p * b) / determinant
        if first >= 0 and second >= 0:
            return first, second
    alone, other = (p / a if a > 0 else 0.0), (q / c if c > 0 else 0.0)
    return (max(alone, 0.0), 0.0) if p * alone >= q * other else (0.0, max(other, 0.0))


def _mirror(m: ir.Material) -> str:
    """What is mirrored sharply, from the front and from the side."""
    sharp = m.metalness * (1 - m.roughness) ** 2
    front, side = (2 * (m.reflection + (1 - m.reflection) * sharp * _layer(m, nv)) for nv in (1.0, 0.0))
    if float(side.max()) < 1e-3:
        return ""
    return f" reflection {{ rgb {vector(np.round(front, 6))}, rgb {vector(np.round(side, 6))} falloff 5 }}"


def _clear(name: str, m: ir.Material, scenery: Scenery, local: Local) -> list[str]:
    """Of transparent materials: Fresnel's reflection, the rest passes; the base shows where it does not. Lamps shine on
    the outside only."""
    even = scenery.sky.fill * float(np.mean(scenery.sky.ambient))
    clear = _through(m) * (1 - m.reflection)
    mirror = f"reflection {{ {number(m.reflection)}, {number(round(m.reflection + clear, 6))} fresnel }}"
    lit = {"": f"diffuse {number(round(1 / math.pi, 6))} {_shine(m, scenery, 1.0)}", "_inside": "diffuse 0"}
    pigment = f"pigment {{ rgbt {vector([*m.color, clear])} }} {local.normal}"
    return [
        f"#declare {name}{side} = texture {{ {pigment}\n  finish {{ "
        f"ambient 0 emission {number(round(even, 6))} {shine} {mirror} conserve_energy }} }}"
        for side, shine in lit.items()
    ]


# ---- what the background does --------------------------------------------------------------


def _glow(m: ir.Material, scenery: Scenery, mask: Array, local: Local) -> str:
    """Emission by n.y (outside) and n.v (inside); where light comes from the side, also by n.x and n.z."""
    sky, eye = scenery.sky, scenery.eye
    if local.eye is not None and not local.normal:
        return _by_angle(lambda nv: 2.0 * mask * sky.glow(m, 1.0, nv, eye))
    across = [(axis, name) for axis, name in ((0, "x"), (2, "z")) if np.abs(sky.tilt[:, axis]).max() > 1e-6]
    share = 2.0 * mask * (1 + len(across))  # averages are taken of this and of the two textures
    if local.eye is None:
        parts = [_by_slope("y", _SLOPES, lambda n, nv: share * sky.glow(m, n, nv, eye))]
    else:
        parts = [_by_height(*local.eye, lambda y, n, nv: share * sky.glow(m, n, nv, np.array([eye[0], y, eye[2]])))]
    parts += [
        _by_slope(name, _SLOPES, lambda n, nv, axis=axis: share * n * sky.sideways(m, axis, nv))
        for axis, name in across
    ]
    return parts[0] if len(parts) == 1 else f"average pigment_map {{ {' '.join(f'[1 {part}]' for part in parts)} }}"


def _by_height(function: str, low: float, high: float, color: Callable[[float, float, float], Array]) -> str:
    """Of a floor with bumps, a colour as a function of the y of the eye's direction, and of the normal's, and n.v."""
    lines: list[str] = []
    for share in np.linspace(0.0, 1.0, _HEIGHTS).tolist():
        y = low + share * (high - low)
        over = _by_slope("y", _BUMPS, lambda n, nv, y=y: color(y, n, nv))
        lines.append(f"[{number(round(0.9 * share, 6))} {over}]")
    place = f"0.9*min(1,max(0,({function}-({number(low)}))/{number(high - low)}))"
    return f"function {{ {place} }} pigment_map {{\n  " + "\n  ".join(lines) + " }"


def _by_slope(axis: str, places: Array, color: Callable[[float, float], Array]) -> str:
    """A colour as a function of one part of the normal and of n.v."""
    lines: list[str] = []
    for place in places.tolist():
        part = math.sin((place - 0.5) * math.pi)
        lines.append(f"[{number(round(place, 6))} {_by_angle(lambda nv, part=part: color(part, nv))}]")
    return f"slope {{ {axis} }} pigment_map {{\n  " + "\n  ".join(lines) + " }"


class _Sky:
    """The background as light on rough surfaces. look: radiance by height, the mean of all directions there."""

    def __init__(self, background: ir.Background) -> None:
        packed, self._kept = picture.pack_sky(background)
        self.ambient, self.fill = np.array(packed.ambient), float(packed.fill)
        self.tilt = np.array(packed.tilt).reshape(3, 3)  # by colour and axis of the normal
        self.look = height_look(background)

    def glow(self, m: ir.Material, ny: float, nv: float, eye: Array) -> Array:
        """Emission, base and layer under the background's light, but for what goes with n.x and n.z."""
        ry = min(max(2 * nv * ny - _height_of_eye(ny, nv, float(eye[1])), -1.0), 1.0)
        even = np.maximum(self.ambient + self.tilt[:, 1] * ry - self.tilt[:, [0, 2]] @ eye[[0, 2]], 0.0)
        blurred = self.look(np.array([ry]))[0]
        blurred = blurred + (even - blurred) * m.roughness
        base = (1 - m.reflection) * self.fill * _base(m, nv) * (self.ambient + self.tilt[:, 1] * ny)
        return np.array(m.emission) + base + self._layer(m, nv) * blurred

    def sideways(self, m: ir.Material, axis: int, nv: float) -> Array:
        """What goes with n.x or n.z: this times it."""
        base = (1 - m.reflection) * self.fill * _base(m, nv)
        return (base + self._layer(m, nv) * m.roughness * 2 * nv) * self.tilt[:, axis]

    def _layer(self, m: ir.Material, nv: float) -> Array:
        sharp = m.metalness * (1 - m.roughness) ** 2
        kept = (1 - m.reflection) * (1 - sharp) * (1 - _through(m))
        return kept * (self.fill + (1 - self.fill) * m.metalness) * _layer(m, nv)


def _height_of_eye(ny: float, nv: float, usual: float) -> float:
    """The y of the direction to the eye that is next to the usual one of those that make nv with a normal of this ny:
    for a level floor there is but one."""
    off = math.sqrt(max((1 - ny * ny) * (1 - nv * nv), 0.0))
    return min(max(usual, ny * nv - off), ny * nv + off)


def _by_angle(color: Callable[[float], Array]) -> str:
    """A colour as a function of n.v. POV-Ray's `aoi` is 1/2 where the surface is seen from the side and 1 where it is
    seen from the front, in between by the angle."""
    entries: list[tuple[float, str]] = []
    for place in _ANGLES.tolist():
        nv = math.sin((place - 0.5) * math.pi)
        entries.append((round(place, 6), vector(np.round(color(max(nv, 1e-3)), 5))))
    if len({shown for _, shown in entries}) == 1:
        return f"rgb {entries[0][1]}"
    return "aoi color_map { " + " ".join(f"[{number(place)} rgb {shown}]" for place, shown in entries) + " }"
