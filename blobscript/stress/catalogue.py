"""All cases, and their certified answers.

The answers are made by ball arithmetic (`certified`), which shares no line with the tracer, and travel with the
package as `answers.json`; each belongs to a case by the hash of its script and rays. `python -m
blobscript.stress.make` makes them anew where one has changed.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np

from blobscript import ir
from blobscript.stress import doubles, edges, inputs, sizes, skeletons, steep
from blobscript.stress.cases import GROUPS, Case

__all__ = ["Expected", "all_cases", "certify", "expected", "fingerprint"]


@dataclass(frozen=True, slots=True)
class Expected:
    """status: hit, miss, touch or invalid. kind: enter or exit. tolerance: the conditioned error, what a
    double-precision tracer may be off by. stable: whether one must agree at all."""

    status: str
    t: float = math.inf
    kind: str = ""
    surface: int = -1
    tolerance: float = 0.0
    stable: bool = True


#: A hit that rounding can move by less than this part of its distance is one that a tracer must find.
_STEADY = 1e-12


@lru_cache(maxsize=1)
def all_cases() -> tuple[Case, ...]:
    """By group, in the order of GROUPS."""
    made = [case for module in (steep, edges, doubles, skeletons, sizes, inputs) for case in module.cases()]
    order = list(GROUPS)
    return tuple(sorted(made, key=lambda case: order.index(case.group)))


def fingerprint(case: Case) -> str:
    return hashlib.sha256(repr((case.script, case.rays)).encode()).hexdigest()[:16]


@lru_cache(maxsize=1)
def _answers() -> dict[str, Any]:
    text = resources.files("blobscript").joinpath("stress", "answers.json").read_text(encoding="utf-8")
    return json.loads(text)


def expected(case: Case) -> tuple[Expected, ...]:
    """One for each ray. Raises KeyError where the case has changed since its answers were made."""
    found = _answers()[f"{case.group}/{case.id}"]
    if found["of"] != fingerprint(case):
        raise KeyError(f"{case.group}/{case.id} has changed: python -m blobscript.stress.make")
    return tuple(_read(row) for row in found["rays"])


def _read(row: dict[str, Any]) -> Expected:
    t = math.inf if row["t"] is None else row["t"]
    return Expected(row["status"], t, row["kind"], row["surface"], row["tolerance"], row["stable"])


def certify(case: Case, scene: ir.Scene) -> tuple[Expected, ...]:
    """The answers, proved; takes from milliseconds to minutes, and python-flint."""
    manual = dict(case.manual)
    return tuple(
        Expected(manual[r.name])
        if r.name in manual
        else _certified(scene, np.array(r.origin), np.array(r.direction), r)
        for r in case.rays
    )


def _certified(scene: ir.Scene, origin: Any, direction: Any, r: Any) -> Expected:
    from blobscript.certified import UndecidedError, certain_hit
    from blobscript.conditioning import tolerance

    unit = direction / np.abs(direction).max()
    unit = unit / np.linalg.norm(unit)
    try:
        answer = certain_hit(scene, origin, unit, r.t_min, r.t_max)
    except UndecidedError:
        return Expected("touch", stable=False)
    if answer.status != "hit":
        return Expected(answer.status, stable=answer.stable)
    t = np.array([answer.distance])
    allowed = float(tolerance(scene.surfaces[answer.surface], origin[None], unit[None], t)[0])
    # steep crossings stand fast whatever rounding may do to a field of that size elsewhere
    stable = answer.stable or (answer.start == "out" and allowed <= _STEADY * float(t[0]))
    return Expected("hit", float(t[0]), answer.kind, answer.surface, allowed + math.ulp(float(t[0])), stable)
