"""Checks of first hits on any number of random rays: a small share runs in the suite (test_first_hit.py),
millions of rays in tests/bench/campaigns.py.

Each function makes its own scene from a seed and returns a `Tally`; `faults` is empty where all is well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import conditioning
import numpy as np
import oracle
import random_scenes

from blobscript import field as reference
from blobscript import ir
from blobscript.backends.native import ENTER, EXIT, GRAZE, MISS, Hits, Native

__all__ = [
    "MAKERS",
    "SEARCHES",
    "Maker",
    "Tally",
    "against_each_other",
    "against_oracle",
    "against_samples",
    "scene_of",
    "smooth_of",
    "sum_of",
]

#: Searches that miss nothing.
SEARCHES = ("sandwich", "interval", "bernstein")


Maker = Callable[[int], tuple[np.random.Generator, ir.Scene]]


@dataclass
class Tally:
    """rays: how many were judged. unstable: how many were not, as either answer is right in double
    precision. worst: the largest conditioned error. faults: what was missed, false or a wrong root."""

    rays: int = 0
    hits: int = 0
    unstable: int = 0
    worst: float = 0.0
    faults: list[str] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        self.rays += other.rays
        self.hits += other.hits
        self.unstable += other.unstable
        self.worst = max(self.worst, other.worst)
        self.faults += other.faults


def scene_of(seed: int, **leaf) -> tuple[np.random.Generator, ir.Scene]:
    """A random tree of one to some twenty elements of all skeletons and kernels; now and then two surfaces."""
    rng = np.random.default_rng([seed, 4])
    return rng, random_scenes.random_scene(rng, depth=seed % 4, surfaces=1 + (seed % 5 == 4), **leaf)


def sum_of(seed: int) -> tuple[np.random.Generator, ir.Scene]:
    """One sum of points and lines that share a kind of kernel, user kernels too, what sum.h searches: lines of no
    length and weights of both signs among them."""
    rng = np.random.default_rng([seed, 5])
    kernels = random_scenes.BUILT_IN + random_scenes.USER
    kernel = (kernels[seed // 3 % len(kernels)],)
    kinds = (("points",), ("lines",), ("points", "lines"))[seed % 3]
    leaves = [
        random_scenes.random_leaf(rng, (kind,), kernel, 0.3 * (seed % 2), 0.0)
        for kind in kinds
        for _ in range(rng.integers(1, 5))
    ]
    field = ir.Node("sum", tuple(leaves)) if len(leaves) > 1 else leaves[0]
    return rng, random_scenes.make_scene((field, float(rng.uniform(0.1, 0.6))))


def smooth_of(seed: int) -> tuple[np.random.Generator, ir.Scene]:
    """Smooth maxima and minima over and under the other nodes, of all skeletons and kernels."""
    rng = np.random.default_rng([seed, 6])
    ops = ("smooth_min", "smooth_max", "sum", "max", "min")
    first, second = ops[seed % 2], ops[seed // 2 % 5]
    under = [random_scenes.random_leaf(rng) for _ in range(rng.integers(1, 4))]
    beside = [random_scenes.random_leaf(rng, negative=0.0) for _ in range(rng.integers(1, 3))]
    outer, inner = (first, second) if seed // 10 % 2 else (second, first)
    tree = ir.Node(outer, (ir.Node(inner, tuple(under)), *beside))  # pyright: ignore[reportArgumentType]
    lo, hi = reference.extent(tree)
    top = float(reference.field_value(tree, rng.uniform(lo, hi, (256, 3))).max())
    return rng, random_scenes.make_scene((tree, float(rng.uniform(0.15, 0.7)) * (top if top > 0.01 else 1.0)))


#: All kinds of scenes that the certified reference judges.
MAKERS: tuple[Maker, ...] = (scene_of, sum_of, smooth_of)


def windows_of(rng: np.random.Generator, scene: ir.Scene, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(t_min, t_max] of each ray: half of them begin or end somewhere within the scene."""
    lo, hi = random_scenes._extent(scene)
    size = float(np.linalg.norm(hi - lo))
    begin = np.where(rng.random(count) < 0.25, rng.uniform(0.0, 2.5, count) * size, 0.0)
    end = np.where(rng.random(count) < 0.25, begin + rng.uniform(0.0, 2.0, count) * size, np.inf)
    return begin, end


def rays_of(rng: np.random.Generator, scene: ir.Scene, count: int) -> tuple[np.ndarray, np.ndarray]:
    """A third of them nearly tangent, 1e-2 to 1e-9 above or below a surface."""
    o, d = random_scenes.random_rays(rng, scene, count - count // 3)
    p, e = random_scenes.grazing_rays(rng, scene, count // 3)
    return np.concatenate([o, p]), np.concatenate([d, e])


# ---- certified answers -----------------------------------------------------------------------------


def against_oracle(seed: int, rays: int, make: Maker = scene_of, windows: bool = False, **options) -> Tally:
    """Status, kind and surface as certified, distance within the conditioned error. windows: not of whole rays only."""
    case = _certified(seed, rays, make, windows)
    hits = Native(case.scene).first_hit(*case.rays, threads=1, **options)
    origins, directions = case.rays[:2]
    tally = Tally()
    for i, answer in enumerate(case.answers):
        if answer is None or not answer.stable:
            tally.unstable += 1
            continue
        tally.rays += 1
        one = slice(i, i + 1)
        _judge(tally, case.scene, origins[one], directions[one], hits, i, answer, f"seed {seed}, ray {i}")
    return tally


@dataclass(frozen=True)
class Certified:
    """rays: origins, directions, t_min and t_max. answers: None where the reference gave up."""

    scene: ir.Scene
    rays: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    answers: list[oracle.Answer | None]


@lru_cache(maxsize=64)  # every search and index is asked the same
def _certified(seed: int, rays: int, make: Maker, windows: bool) -> Certified:
    rng, scene = make(seed)
    origins, directions = rays_of(rng, scene, rays)
    count = len(origins)
    begin, end = windows_of(rng, scene, count) if windows else (np.zeros(count), np.full(count, np.inf))
    answers: list[oracle.Answer | None] = []
    for i in range(count):
        try:
            answers.append(oracle.certain_hit(scene, origins[i], directions[i], float(begin[i]), float(end[i])))
        except oracle.Undecided:
            answers.append(None)
    return Certified(scene, (origins, directions, begin, end), answers)


def _judge(
    tally: Tally, scene: ir.Scene, origin, direction, hits: Hits, i: int, answer: oracle.Answer, name: str
) -> None:
    expected = {"miss": MISS, "hit": EXIT if answer.kind == "exit" else ENTER}[answer.status]
    found = int(hits.status[i])
    if found == GRAZE and expected == MISS:
        found = MISS  # it came within rounding of a surface and passed
    if found != expected or (expected != MISS and hits.surface[i] != answer.surface):
        tally.faults.append(f"{name}: status {found} at {hits.t[i]}, certified {expected} at {answer.distance}")
        return
    if expected == MISS:
        return
    tally.hits += 1
    surface = scene.surfaces[answer.surface]
    allowed = float(conditioning.tolerance(surface, origin, direction, np.array([answer.distance]))[0])
    error = abs(float(hits.t[i]) - answer.distance) / allowed
    tally.worst = max(tally.worst, error)
    if error > 1.0:
        tally.faults.append(f"{name}: t = {hits.t[i]}, certified {answer.distance}: conditioned error {error:.3g}")


# ---- one search against another ----------------------------------------------------------------------


def against_each_other(seed: int, rays: int, make: Maker = scene_of) -> Tally:
    """The searches that miss nothing: the same status, surface and, within twice the conditioned error, distance.
    Where they differ the certified reference is asked whether both answers are right in double precision."""
    rng, scene = make(seed)
    origins, directions = (np.concatenate(r) for r in zip(many_rays(rng, scene, rays), block(rng, scene), strict=True))
    native = Native(scene)
    first, *others = (native.first_hit(origins, directions, search=search, threads=1) for search in SEARCHES)
    tally = Tally(rays=len(origins), hits=int(first.hit.sum()))
    for name, other in zip(SEARCHES[1:], others, strict=True):
        differs = (first.hit | other.hit) & ((first.status != other.status) | (first.surface != other.surface))
        both = np.flatnonzero(first.hit & other.hit & ~differs)
        far = both[np.abs(first.t[both] - other.t[both]) > 1e-12]
        for i in [*np.flatnonzero(differs), *far[_too_far(scene, origins, directions, first, other, far)]]:
            if _either_is_right(scene, origins[i], directions[i]):
                tally.unstable += 1
                continue
            found = f"{first.status[i]} at {first.t[i]!r} or {other.status[i]} at {other.t[i]!r}"
            tally.faults.append(f"seed {seed}, ray {i}: {SEARCHES[0]} and {name} differ, {found}")
    return tally


def block(rng: np.random.Generator, scene: ir.Scene) -> tuple[np.ndarray, np.ndarray]:
    """256 neighbouring rays of a picture, which are searched by teams of packets."""
    o, d = random_scenes.random_rays(rng, scene, 1)
    side = np.cross(d[0], rng.normal(size=3))
    spread = 10.0 ** rng.uniform(-3, -1) * side / np.linalg.norm(side)
    row, column = np.mgrid[-1:1:16j, -1:1:16j].reshape(2, -1, 1)
    return np.tile(o, (256, 1)), d + row * spread + column * np.cross(d[0], spread)


def many_rays(rng: np.random.Generator, scene: ir.Scene, count: int) -> tuple[np.ndarray, np.ndarray]:
    """As rays_of, but all tangents at a few hundred places."""
    o, d = random_scenes.random_rays(rng, scene, count - count // 3)
    p, e = random_scenes.grazing_rays(rng, scene, min(count // 3, 200))
    if not len(p):
        return o, d
    pick = rng.integers(len(p), size=count // 3)
    turned = e[pick] + rng.normal(size=(len(pick), 3)) * 10.0 ** rng.uniform(-9, -3, (len(pick), 1))
    return np.concatenate([o, p[pick]]), np.concatenate([d, turned])


def _too_far(scene: ir.Scene, origins, directions, first: Hits, other: Hits, rows: np.ndarray) -> np.ndarray:
    """Which of these rays have distances that differ by more than twice the conditioned error."""
    allowed = np.zeros(len(rows))
    for index, surface in enumerate(scene.surfaces):
        mine = first.surface[rows] == index
        if mine.any():
            at = rows[mine]
            allowed[mine] = conditioning.tolerance(surface, origins[at], directions[at], first.t[at])
    return np.abs(first.t[rows] - other.t[rows]) > 2.0 * allowed


def _either_is_right(scene: ir.Scene, origin: np.ndarray, direction: np.ndarray) -> bool:
    try:
        return not oracle.certain_hit(scene, origin, direction).stable
    except oracle.Undecided:
        return True


# ---- samples before the hit ----------------------------------------------------------------------------


def against_samples(seed: int, rays: int, samples: int = 200, **leaf) -> Tally:
    """The field in NumPy or C, on `samples` places before each hit: none may lie on the other side of the
    threshold by more than rounding, the hit lies on the surface, and behind it the side changes."""
    rng, scene = scene_of(seed, **leaf)
    native = Native(scene)
    origins, directions = rays_of(rng, scene, rays)
    hits = native.first_hit(origins, directions)
    tally = Tally(rays=len(origins), hits=int(hits.hit.sum()))
    lo, hi = random_scenes._extent(scene)
    far = np.linalg.norm(origins, axis=1) + float(np.abs(np.stack([lo, hi])).sum())
    end = np.where(hits.hit, hits.t, far)
    for index, surface in enumerate(scene.surfaces):
        bad = _crossed(native, index, surface, origins, directions, end, rng.random((len(origins), samples)))
        tally.faults += [f"seed {seed}, ray {i}: surface {index} is crossed before {end[i]}" for i in bad]
        mine = np.flatnonzero(hits.surface == index)
        tally.faults += [f"seed {seed}, ray {mine[i]}: {text}" for i, text in _off(surface, hits, mine, origins)]
    return tally


def _crossed(native: Native, index: int, surface: ir.Surface, o, d, end, shares) -> np.ndarray:
    """Rays that are on the other side than at their start somewhere before `end`."""
    t = end[:, None] * shares
    points = (o[:, None, :] + t[:, :, None] * d[:, None, :]).reshape(-1, 3)
    above = (native.field(points, index) - surface.threshold).reshape(t.shape)
    start = native.field(o, index) - surface.threshold
    # where a hit is ill-conditioned its distance is; the field is not
    suspects = np.flatnonzero((above * np.sign(start)[:, None] < 0.0).any(axis=1) & (start != 0.0))
    bad = []
    for i in suspects:
        wrong = np.flatnonzero(above[i] * np.sign(start[i]) < 0.0)
        at = o[i] + t[i, wrong, None] * d[i]
        position = conditioning.position_error(o[i : i + 1], end[i : i + 1])
        error = conditioning.rounding(surface, np.concatenate([at, o[i : i + 1]]), position)
        if (np.abs(above[i, wrong]) > 2.0 * error[:-1]).any() and abs(start[i]) > 2.0 * error[-1]:
            bad.append(i)
    return np.array(bad, dtype=np.int64)


def _off(surface: ir.Surface, hits: Hits, mine: np.ndarray, origins: np.ndarray) -> list[tuple[int, str]]:
    """Hits that do not lie on the surface."""
    if not len(mine):
        return []
    at = hits.position[mine]
    residual = np.abs(reference.field_value(surface.field, at) - surface.threshold)
    position = conditioning.position_error(origins[mine], hits.t[mine])
    allowed = 2.0 * conditioning.rounding(surface, at, position)
    return [(int(i), f"off the surface by {residual[i]:.3g}") for i in np.flatnonzero(residual > allowed)]
