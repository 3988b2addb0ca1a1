"""The stress catalogue, tests/data/stress.json: stiff and extreme cases with certified answers.

`cases()` gives each as a scene with rays and expectations, `judge(case, hits)` says what is wrong
with a tracer's answers. Cases that must be refused when they are loaded (`expect_load` "error")
have no scene; their `raw` data are for the makers and for `verify`.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import conditioning
import numpy as np
from random_scenes import make_scene

from blobscript.ir import Field, Kernel, Leaf, Lines, Mesh, Node, Points, Polygon, Polyhedron, Polyline, Scene, Skeleton

__all__ = ["Case", "cases", "judge", "judge_ray"]

MISS, ENTER, EXIT, GRAZE, INVALID = range(5)
_KERNELS = {"D1": "soft3", "D2": "wyvill", "D3": "gauss", "D3c": "gauss_c1", "D4": "metaball", "POV": "soft2"}


@dataclass(frozen=True, eq=False)
class Case:
    """expectations: one dictionary per ray, as in the file; `dist` is a distance along the
    normalised direction wherever a hit is expected."""

    id: str
    group: str
    title: str
    expect_load: str
    raw: dict[str, Any]
    scene: Scene | None
    names: list[str]
    origins: np.ndarray
    directions: np.ndarray
    t_min: np.ndarray
    t_max: np.ndarray
    expectations: list[dict[str, Any]]


@lru_cache(maxsize=1)
def cases() -> tuple[Case, ...]:
    path = Path(__file__).parent / "data" / "stress.json"
    with path.open(encoding="utf-8") as file:
        catalogue = json.load(file)
    return tuple(_case(raw) for raw in catalogue["cases"])


def _case(raw: dict[str, Any]) -> Case:
    rays = raw["rays"]
    vectors = lambda key: np.array([[float(x) for x in ray[key]] for ray in rays]).reshape(-1, 3)  # noqa: E731
    directions = vectors("d")
    with np.errstate(invalid="ignore"):
        largest = np.abs(directions).max(axis=1, initial=0.0)
        scaled = directions / np.where(largest > 0, largest, 1.0)[:, None]
        length = largest * np.sqrt(np.sum(scaled**2, axis=1))
    scene = _scene(raw["scene"]) if raw["expect_load"] != "error" else None
    expectations = [_expectation(ray, size) for ray, size in zip(rays, length, strict=True)]
    if scene is not None:
        _set_tolerances(scene, vectors("o"), directions, expectations)
    return Case(
        raw["id"],
        raw["group"],
        raw["title"],
        raw["expect_load"],
        raw,
        scene,
        [ray["name"] for ray in rays],
        vectors("o"),
        directions,
        np.array([ray.get("tmin", 0.0) * size for ray, size in zip(rays, length, strict=True)]),
        np.array(
            [
                ray.get("tmax", math.inf) * size if "tmax" in ray else math.inf
                for ray, size in zip(rays, length, strict=True)
            ]
        ),
        expectations,
    )


def _expectation(ray: dict[str, Any], length: float) -> dict[str, Any]:
    """What is expected of a ray; entries made by hand get a distance, too."""
    if "expect" in ray:
        return ray["expect"]
    manual = dict(ray["expect_manual"])
    if manual["status"] == "hit":
        manual["dist"] = float(manual.get("t", manual.get("t_f64"))) * length
    return manual


def _set_tolerances(scene: Scene, origins: np.ndarray, directions: np.ndarray, expectations: list[dict]) -> None:
    """The conditioned error as tolerance where the catalogue has none: entries made by hand, whose distances
    were themselves computed in double precision, to 1e-13 or the conditioned error."""
    for i, expected in enumerate(expectations):
        if expected["status"] == "hit" and "tol_dist_f64" not in expected:
            t = np.array([expected["dist"]])
            allowed = conditioning.tolerance(scene.surfaces[0], origins[i : i + 1], directions[i : i + 1], t)
            expected["tol_dist_f64"] = max(1e-13, float(allowed[0]))


# ---- scenes -----------------------------------------------------------------------------------------


def _scene(raw: dict[str, Any]) -> Scene:
    return make_scene((_field(raw["tree"]), float(raw["T"])))


def _field(tree: dict[str, Any]) -> Field:
    if "op" not in tree:
        return _leaf([tree])
    children: list[Field] = []
    together: list[dict[str, Any]] = []
    for child in tree["children"]:
        if tree["op"] == "sum" and together and not _can_join(together[-1], child):
            children.append(_leaf(together))
            together = []
        if tree["op"] == "sum" and "prim" in child:
            together.append(child)
        else:
            children.append(_field(child))
    if together:
        children.append(_leaf(together))
    return Node(tree["op"], tuple(children))


def _can_join(first: dict[str, Any], second: dict[str, Any]) -> bool:
    """Points and lines with one kernel are elements of one leaf."""
    same = all(first.get(key) == second.get(key) for key in ("prim", "kernel", "a"))
    return same and first["prim"] in ("point", "segment")


def _leaf(leaves: list[dict[str, Any]]) -> Leaf:
    first = leaves[0]
    return Leaf(
        _skeleton(leaves),
        Kernel(_KERNELS[first["kernel"]], float(first.get("a", 0.0))),
        np.array([float(leaf["R"]) for leaf in leaves]),
        np.array([float(leaf["w"]) for leaf in leaves]),
        np.full(len(leaves), -1, dtype=np.int32),
        np.zeros(len(leaves), dtype=np.int32),
    )


def _rows(points) -> np.ndarray:
    return np.array([[float(x) for x in p] for p in points])


def _skeleton(leaves: list[dict[str, Any]]) -> Skeleton:
    leaf = leaves[0]
    match leaf["prim"]:
        case "point":
            return Points(_rows(each["c"] for each in leaves))
        case "segment":
            return Lines(_rows(each["a0"] for each in leaves), _rows(each["b0"] for each in leaves))
        case "polyline":
            return Polyline(_rows(leaf["pts"]), False)
        case "triangle":
            return Mesh(_rows(leaf["v"]), np.array([[0, 1, 2]], dtype=np.int32), False)
        case "polygon":
            points = _rows(leaf["v"])
            return Polygon(points, np.array(leaf.get("tris") or _ears(points), dtype=np.int32))
        case "mesh" | "solid_mesh":
            return Mesh(_rows(leaf["v"]), np.array(leaf["f"], dtype=np.int32), leaf["prim"] == "solid_mesh")
        case "convex":
            return Polyhedron(_rows(leaf["v"]), np.array(leaf["f"], dtype=np.int32), True)
        case other:
            raise ValueError(other)


def _ears(points: np.ndarray) -> list[list[int]]:
    """Triangles of a simple planar polygon: cuts off convex corners without a vertex inside."""
    normal = sum(np.cross(p, q) for p, q in zip(points, np.roll(points, -1, axis=0), strict=True))
    axis = int(np.argmax(np.abs(normal)))
    flat = np.delete(points, axis, axis=1) * (1 if (normal[axis] > 0) == (axis != 1) else [-1, 1])

    def turn(i: int, j: int, k: int) -> float:
        (ax, ay), (bx, by) = flat[j] - flat[i], flat[k] - flat[i]
        return ax * by - ay * bx

    left, ears = list(range(len(points))), []
    while len(left) > 3:
        for n in range(len(left)):
            i, j, k = left[n - 1], left[n], left[(n + 1) % len(left)]
            others = [m for m in left if m not in (i, j, k)]
            if turn(i, j, k) > 0 and not any(min(turn(i, j, m), turn(j, k, m), turn(k, i, m)) >= 0 for m in others):
                ears.append([i, j, k])
                del left[n]
                break
        else:
            raise ValueError("not a simple polygon")
    return [*ears, left]


# ---- verdicts ------------------------------------------------------------------------------------------


def judge(case: Case, hits) -> list[str]:
    """What is wrong with `hits` (arrays status, t, normal; t along the normalised direction)."""
    failures = []
    for i, name in enumerate(case.names):
        wrong = judge_ray(case.expectations[i], int(hits.status[i]), float(hits.t[i]), np.asarray(hits.normal[i]))
        failures += [f"{case.id} / {name}: {text}" for text in wrong]
    return failures


def judge_ray(expected: dict[str, Any], status: int, t: float, normal: np.ndarray) -> list[str]:
    """The rules of the catalogue: the certified status unless `f64_may_differ`, a touch is a miss
    or a graze, distances within `tol_dist_f64`."""
    may_differ = expected.get("f64_may_differ", False)
    if status not in (ENTER, EXIT):
        return _judge_no_hit(expected, status, t, normal, may_differ)
    if expected["status"] not in ("hit", "hit_touch"):
        if may_differ or expected["status"] == "touch":
            return []
        return [f"false hit at {t!r}, expected {expected['status']}"]
    failures = []
    kind = {"enter": ENTER, "exit": EXIT}.get(expected.get("kind", ""), status)
    if status != kind:
        failures.append(f"status {status}, expected {kind} ({expected['kind']})")
    tolerance = expected["tol_dist_f64"] + math.ulp(expected["dist"])
    error = abs(t - expected["dist"])
    if not error <= tolerance and not may_differ:
        conditioned = error / expected["tol_dist_f64"]
        failures.append(f"t = {t!r}, expected {expected['dist']!r}: conditioned error {conditioned:.3g}")
    return failures + _judge_normal(expected, normal, may_differ)


def _judge_no_hit(expected: dict[str, Any], status: int, t: float, normal: np.ndarray, may_differ: bool) -> list[str]:
    allowed = {
        "invalid": {INVALID},
        "touch": {MISS, GRAZE},
        "miss": {MISS, GRAZE} if may_differ else {MISS},
    }.get(expected["status"], {MISS, GRAZE} if may_differ else set())
    failures = [] if status in allowed else [f"status {status}, expected {expected['status']}"]
    if not (t == math.inf and np.all(np.isnan(normal))):
        failures.append(f"t = {t!r} and normal {normal} without a hit")
    return failures


def _judge_normal(expected: dict[str, Any], normal: np.ndarray, may_differ: bool) -> list[str]:
    """Within 1e-7 and what a shift by the tolerance turns it by, generously; unit length always."""
    failures = []
    if not abs(float(np.linalg.norm(normal)) - 1.0) < 1e-12:
        failures.append(f"normal {normal} is not of length 1")
    if "normal" not in expected or "normal_ambiguous" in expected or may_differ:
        return failures
    exact = np.array(expected["normal"])
    angle = math.atan2(float(np.linalg.norm(np.cross(normal, exact))), float(normal @ exact))
    if not angle <= 1e-7 + 1e3 * min(expected["tol_dist_f64"], 1e-6):
        failures.append(f"normal {normal.tolist()}, expected {exact.tolist()}: angle {angle:.3g}")
    return failures
