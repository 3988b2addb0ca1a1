"""Random stress cases: trees of nodes, steep kernels, weights to 1e15 that cancel, scales to both ends of what a double
holds. Each is a script, as a user would write it, so what the language refuses is part of the question."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

import blobscript
from blobscript.stress.cases import Case, fan
from blobscript.stress.catalogue import certify
from blobscript.stress.images import image_faults
from blobscript.stress.running import EXACT, _traced

__all__ = ["LIMIT", "faults", "random_case"]

#: Lengths from 1 / LIMIT to LIMIT are for the language to take, others to refuse: products of six have to be doubles.
LIMIT = 1e40
_KERNELS = ("soft2", "soft3", "wyvill", "metaball", "gauss", "gauss_c1")


def random_case(seed: int) -> Case:
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.choice([0.0, rng.uniform(-3, 3), rng.uniform(-38, 38), rng.uniform(-150, 150)])
    body = "\n".join(f"  {line}" for line in _node(rng, scale, int(rng.integers(3))))
    rays = fan((0, 0, 0), 6.0 * scale, 0.8 * scale, 6)
    return Case(
        f"random-{seed}", "load", f"random case {seed}", "Whatever chance made.", f"surface {{\n{body}\n}}\n", rays
    )


def _node(rng: np.random.Generator, scale: float, depth: int) -> Iterator[str]:
    for _ in range(int(rng.integers(1, 4))):
        if depth:
            op = rng.choice(["sum", "max", "smooth_max"])
            inner = "\n".join(_node(rng, scale, depth - 1))
            yield f"{op} {{\n{inner}\n}}"
        else:
            yield from _blobs(rng, scale)


def _blobs(rng: np.random.Generator, scale: float) -> Iterator[str]:
    """One blob, or two at nearly one place whose weights nearly cancel."""
    place, other = rng.uniform(-0.7, 0.7, (2, 3)) * scale
    reach, weight = scale * 10.0 ** rng.uniform(-0.5, 0.2), 10.0 ** rng.choice([0.3, rng.uniform(0.0, 15.0)])
    kernel = str(rng.choice(_KERNELS))
    if kernel.startswith("gauss"):
        kernel += f"(a = {10.0 ** rng.uniform(0.3, 8.0):.6g})"
    line = rng.random() < 0.3
    shape = f"line({_text(place)}, {_text(other)})" if line else f"point({_text(place)})"
    yield f"{shape}.blob(reach = {reach:.9g}, weight = {weight:.9g}, kernel = {kernel})"
    if rng.random() < 0.4:
        near = reach * (1.0 + rng.choice([0.0, 1e-9, 1e-3]))
        yield f"{shape}.blob(reach = {near:.17g}, weight = {-weight * (1.0 - 1e-3):.9g}, kernel = {kernel})"


def _text(place: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:.9g}" for x in place) + ")"


def faults(case: Case, picture: bool = True) -> list[str]:
    """What is wrong; ["refused"] where the language says no, and may."""
    try:
        scene = blobscript.compile(case.script)
    except blobscript.ProgramError as error:
        size = math.log10(abs(case.rays[0].origin[2]))
        refused = {found.code for found in error.diagnostics} <= {"E0405"} and abs(size) > math.log10(LIMIT) - 1.5
        return ["refused"] if refused else [f"{case.id}: {error}"]
    answers = certify(case, scene.ir)
    found = [f"{search}: {text}" for search in EXACT for text in _traced(case, scene, search, answers, 0.0).faults]
    return [f"{case.id}: {text}" for text in [*found, *(image_faults(scene) if picture else [])]]
