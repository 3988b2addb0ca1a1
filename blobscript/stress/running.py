"""Cases through tracers: what is right, by how much the rest is off, and what it took."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blobscript import ProgramError
from blobscript import compile as compile_script
from blobscript.ir import leaves
from blobscript.scene import Scene
from blobscript.stress.cases import Case
from blobscript.stress.catalogue import Expected, all_cases, expected
from blobscript.stress.images import image_faults

__all__ = ["EXACT", "OTHERS", "Outcome", "Row", "run_case", "run_cases"]

#: Searches that must be right, and those that are shown for comparison.
EXACT = ("sandwich", "bernstein", "interval")
OTHERS = ("march", "sphere", "segment")

_MISS, _ENTER, _EXIT, _GRAZE, _INVALID = range(5)
_REPEATS = 3
#: A hit further off than this part of the smallest reach is another place, however a method defines its error.
_WRONG_ROOT = 1e-3


@dataclass(frozen=True, slots=True)
class Outcome:
    """One tracer on one case. error: the largest conditioned error over hits that are the right ones (1: all that
    double precision gives). evaluations: mean per ray; seconds: per ray, processor time, the least of some runs."""

    right: int
    wrong: int
    error: float
    evaluations: float
    seconds: float
    faults: tuple[str, ...] = ()


@dataclass(slots=True)
class Row:
    """A case and what became of it. outcomes: by search, and "POV-Ray" where it was asked. faults: why it failed;
    load_seconds: to compile and trim."""

    case: Case
    faults: list[str] = field(default_factory=list[str])
    outcomes: dict[str, Outcome] = field(default_factory=dict[str, Outcome])
    load_seconds: float = 0.0

    @property
    def passed(self) -> bool:
        return not self.faults


def run_cases(
    groups: Iterable[str] = (), povray: bool = False, progress: Callable[[int, int], None] | None = None
) -> list[Row]:
    """All cases of some groups (none: all)."""
    wanted = set(groups)
    cases = [case for case in all_cases() if not wanted or case.group in wanted]
    rows: list[Row] = []
    for number, case in enumerate(cases):
        rows.append(run_case(case, povray))
        if progress is not None:
            progress(number + 1, len(cases))
    return rows


def run_case(case: Case, povray: bool = False) -> Row:
    row = Row(case)
    start = time.process_time()
    try:
        scene = compile_script(case.script, name=f"{case.group}/{case.id}.blob")
    except ProgramError as error:
        codes = {found.code for found in error.diagnostics}
        if case.refused not in codes:
            row.faults.append(
                f"refused with {', '.join(sorted(codes))}" + (f", not {case.refused}" if case.refused else "")
            )
        return row
    row.load_seconds = time.process_time() - start
    if case.refused:
        row.faults.append(f"loads, but {case.refused} was expected")
        return row
    codes = {found.code for found in scene.diagnostics}
    if codes != ({case.warned} - {""}):
        row.faults.append(f"loads with {', '.join(sorted(codes)) or 'no warning'}, not {case.warned or 'without any'}")
    answers = expected(case)
    for search in EXACT:
        row.outcomes[search] = _traced(case, scene, search, answers, 0.0)
    for search in OTHERS:
        row.outcomes[search] = _traced(case, scene, search, answers, _WRONG_ROOT * _smallest_reach(scene))
    for search in EXACT:
        row.faults += [f"{search}: {fault}" for fault in row.outcomes[search].faults]
    row.faults += image_faults(scene)
    if povray:
        outcome = _povray(case, scene, answers)
        if outcome is not None:
            row.outcomes["POV-Ray"] = outcome
    return row


# ---- blobscript's searches -------------------------------------------------------------------------


def _smallest_reach(scene: Scene) -> float:
    return min((float(leaf.reach.min()) for s in scene.surfaces for leaf in leaves(s.field)), default=0.0)


def _traced(case: Case, scene: Scene, search: Any, answers: tuple[Expected, ...], near: float) -> Outcome:
    """near: how far off a hit of the right surface may be without counting as wrong."""
    rays = case.arrays()
    seconds = math.inf
    hits: Any = None
    for _ in range(_REPEATS):
        start = time.process_time()
        hits = scene.first_hit(*rays, search=search, threads=1)
        seconds = min(seconds, time.process_time() - start)
        if seconds > 1.0:
            break
    verdicts = [_judged(e, int(s), float(t), near) for e, s, t in zip(answers, hits.status, hits.t, strict=True)]
    faults = [f"{r.name}: {v[0]}" for r, v in zip(case.rays, verdicts, strict=True) if v[0]]
    count = max(len(answers), 1)
    return Outcome(
        count - len(faults),
        len(faults),
        max((v[1] for v in verdicts), default=0.0),
        float(hits.evaluations.mean()) if len(answers) else 0.0,
        seconds / count,
        tuple(faults),
    )


def _judged(answer: Expected, status: int, t: float, near: float) -> tuple[str, float]:
    """What is wrong ("": nothing), and the conditioned error of a right hit."""
    is_hit = status in (_ENTER, _EXIT)
    if answer.status == "invalid":
        return ("" if status == _INVALID else f"status {status}, expected INVALID"), 0.0
    if status == _INVALID:
        return "INVALID", 0.0
    if answer.status != "hit":
        false_hit = is_hit and answer.stable and answer.status == "miss"
        return (f"a hit at {t!r} where there is none" if false_hit else ""), 0.0
    if not is_hit:
        return ("missed" if answer.stable else ""), 0.0
    error = abs(t - answer.t) / answer.tolerance
    if not answer.stable:
        return "", 0.0
    if (status == _ENTER) != (answer.kind == "enter"):
        return f"status {status}, expected {answer.kind}", 0.0
    if error > 1.0 and abs(t - answer.t) > near:
        return f"t = {t!r}, not {answer.t!r}: {error:.3g} times what rounding explains", 0.0
    return "", error


# ---- POV-Ray ------------------------------------------------------------------------------------------


def _povray(case: Case, scene: Scene, answers: tuple[Expected, ...]) -> Outcome | None:
    """The same rays there; None where it cannot express the scene, or a ray's window: a field that it has to be given
    as samples is another scene. Right is what lies within a thousandth of the distance, since no tolerance of it is
    known."""
    from blobscript.diagnostics import BlobscriptError
    from blobscript.povray.program import workshop
    from blobscript.povray.readback import answers as povray_answers

    origins, directions, t_min, t_max = case.arrays()
    if case.manual or (t_min != 0.0).any() or np.isfinite(t_max).any():
        return None
    try:
        made = scene.pov_document()
        with workshop() as shop:
            found = povray_answers(shop, made, origins, _of_length_one(directions), 60.0)
    except (BlobscriptError, ValueError, OverflowError):
        return None
    wrong = [
        e.stable and (hit != (e.status == "hit") or (hit and abs(t - e.t) > 1e-3 * e.t))
        for e, hit, t in zip(answers, found.hit, found.t, strict=True)
    ]
    return Outcome(len(wrong) - sum(wrong), sum(wrong), _worst(answers, found.hit, found.t), 0.0, math.nan)


def _of_length_one(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) about as long, whatever their squares are."""
    return directions / np.abs(directions).max(axis=1, keepdims=True)


def _worst(answers: tuple[Expected, ...], hit: NDArray[np.bool_], t: NDArray[np.float64]) -> float:
    errors = [
        abs(float(a) - e.t) / e.tolerance
        for e, h, a in zip(answers, hit, t, strict=True)
        if e.stable and e.status == "hit" and h and abs(float(a) - e.t) <= 1e-3 * e.t
    ]
    return max(errors, default=0.0)
