"""Kernel x skeleton x node x transform x sign of weight against the real POV-Ray: thousands of rays in one run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from random_scenes import BUILT_IN, SKELETONS, USER, make_leaf, make_scene, random_matrix, random_rays, random_skeleton

from blobscript import Scene, field, ir
from blobscript.ir import Field, Kernel, Lines, Node, Points
from blobscript.povray import document
from blobscript.povray.program import workshop
from blobscript.povray.readback import answers

RAYS = 120


@dataclass(frozen=True)
class Case:
    name: str
    field: Field
    threshold: float


def leaf(rng, kind: str, kernel: Kernel, weight=1.0, mapped: bool = False) -> ir.Leaf:
    reach = rng.uniform(0.5, 1.0)
    return make_leaf(random_skeleton(rng, kind), kernel, reach, weight, None, random_matrix(rng) if mapped else None)


def with_ball(rng, other: Field, kernel: Kernel) -> Node:
    """Not alone any more: what would be a skin becomes an isosurface."""
    ball = make_leaf(Points(rng.uniform(-0.5, 0.5, (1, 3))), kernel, 0.8, 1.0)
    return Node("sum", (ball, other))


def few(rng, kernel: Kernel, mapped: bool = False) -> ir.Leaf:
    return make_leaf(Points(rng.uniform(-0.7, 0.7, (3, 3))), kernel, rng.uniform(0.6, 1.0, 3),
                     rng.uniform(0.6, 1.2, 3), None, random_matrix(rng) if mapped else None)  # fmt: skip


def name_of(kernel: Kernel) -> str:
    return f"{kernel.name}{kernel.a or ''}"


def cases() -> Iterator[Case]:
    rng = np.random.default_rng(7)
    wyvill, soft2 = Kernel("wyvill"), Kernel("soft2")
    for kernel in BUILT_IN + USER:
        yield Case(f"points, {name_of(kernel)}", few(rng, kernel), 0.4)
        yield Case(f"alone, {name_of(kernel)}", leaf(rng, "lines", kernel), 0.4)
    for kind in SKELETONS:
        yield Case(f"{kind} alone", leaf(rng, kind, wyvill), 0.5)
        yield Case(f"{kind} and a ball", with_ball(rng, leaf(rng, kind, wyvill), wyvill), 0.5)
        yield Case(f"{kind}, mapped", leaf(rng, kind, soft2, mapped=True), 0.5)
    for kind in ("points", "lines", "polygon"):
        yield Case(f"{kind} that carves", with_ball(rng, leaf(rng, kind, wyvill, -0.8, mapped=True), wyvill), 0.3)
    for kernel in (soft2, wyvill):
        for op in ("max", "min", "smooth_max"):
            children = (few(rng, kernel), few(rng, kernel, mapped=True))
            yield Case(f"{op} of {kernel.name}", Node(op, children), 0.4)
            yield Case(f"{op} in a sum of {kernel.name}", with_ball(rng, Node(op, children), kernel), 0.5)
        # that of positive densities is 0 everywhere
        carving = Node("smooth_min", (leaf(rng, "points", kernel, -0.5), leaf(rng, "lines", kernel, -0.4)))
        yield Case(f"smooth_min in a sum of {kernel.name}", Node("sum", (few(rng, kernel), carving)), 0.3)
    signs = make_leaf(Points(rng.uniform(-0.7, 0.7, (12, 3))), soft2, 0.9, np.where(np.arange(12) % 3, 1.0, -0.7))
    yield Case("blob of both signs", signs, 0.4)
    yield Case("blob of lines", Node("sum", (few(rng, soft2), leaf(rng, "lines", soft2, -0.3))), 0.4)
    yield Case("blob below zero", make_leaf(Points(np.zeros((1, 3))), soft2, 1.0, -1.0), -0.4)
    yield Case("flat line", make_leaf(Lines(np.zeros((1, 3)), np.zeros((1, 3))), soft2, 1.0, 1.0), 0.4)
    many = make_leaf(Points(rng.uniform(-1, 1, (1000, 3))), soft2, 0.2, 1.0)
    yield Case("blob of 1000", many, 0.6)


CASES = list(cases())


@pytest.fixture(scope="module")
def found() -> dict[str, tuple[np.ndarray, np.ndarray, float, float]]:
    """Of each case: differences of the distance where both hit, of the normal, and the share of rays that disagree
    about hit or miss; in parts of the scene's size."""
    made = document(make_scene(*((case.field, case.threshold) for case in CASES)))
    rays, hits = [], []
    for case in CASES:
        origins, directions = random_rays(np.random.default_rng(3), make_scene((case.field, case.threshold)), RAYS)
        # from outside: seen from within, the union of a skin's parts shows what is behind them
        outside = (field.field_value(case.field, origins) >= case.threshold) == (case.threshold <= 0)
        rays.append((origins[outside], directions[outside]))
        hits.append(Scene(make_scene((case.field, case.threshold))).first_hit(*rays[-1]))
    which = np.repeat(np.arange(len(CASES)), [len(o) for o, _ in rays])
    origins, directions = (np.concatenate([ray[k] for ray in rays]) for k in (0, 1))
    with workshop() as shop:
        theirs = answers(shop, made, origins, directions, 120.0, which)
    result = {}
    for number, (case, ours) in enumerate(zip(CASES, hits, strict=True)):
        mine = which == number
        lo, hi = field.extent(case.field)
        size = float(np.linalg.norm(hi - lo))
        both = ours.hit & theirs.hit[mine]
        gap = np.abs(ours.t[both] - theirs.t[mine][both]) / size
        normal = np.where((np.sum(ours.normal * rays[number][1], axis=1) > 0)[:, None], -ours.normal, ours.normal)
        bend = np.linalg.norm(np.cross(normal[both], theirs.normal[mine][both]), axis=1)
        result[case.name] = gap, bend, float(np.mean(ours.hit != theirs.hit[mine])), float(both.mean())
    return result


@pytest.mark.parametrize("name", [case.name for case in CASES])
def test_povray_finds_the_same(found, name: str) -> None:
    """Isosurfaces are asked for 1e-7 of the size of all these scenes together, about that of one."""
    gap, bend, missed, share = found[name]
    assert share > 0.02, "the rays should hit something"
    assert missed == 0.0
    assert (gap <= 1e-6).all()
    assert float(np.median(bend)) < 1e-4
    assert np.quantile(bend, 0.98) < 1e-2, "but for creases"
