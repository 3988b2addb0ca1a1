"""Computed hits against certified ones: what is right, missed, false or another root, and how far off.

Another root: both hit, but farther apart than max(tolerance of the ray, 1e-3 units, 10 times the method's own
tolerance). Such distances are counted, never averaged in. Rays whose status double precision cannot know
(`Reference.stable`) are left out and counted apart.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from blobscript.reporting.reference import HIT, Reference

__all__ = ["Answers", "Counts", "Errors", "Judgement", "RULE_OF_THREE", "error_stats", "judge"]

Array = NDArray[np.float64]

#: None of N seen: with 95 % confidence the share is below 3 / N.
RULE_OF_THREE = 3.0
_GRAZE = 3


@dataclass(frozen=True, slots=True)
class Counts:
    """Of `rays` stable rays. right: hit as it should be; wrong_root and wrong_kind are not among them."""

    rays: int
    hits: int
    right: int
    missed: int
    false: int
    wrong_root: int
    wrong_kind: int
    grazing: int
    unstable: int

    @property
    def bad(self) -> int:
        return self.missed + self.false + self.wrong_root + self.wrong_kind

    def __add__(self, other: Counts) -> Counts:
        mine, its = asdict(self), asdict(other)
        return Counts(**{name: mine[name] + its[name] for name in mine})


@dataclass(frozen=True, slots=True)
class Errors:
    """Of distances of hits that are right; NaN without any. conditioned: largest in units of the ray's tolerance."""

    median: float
    p90: float
    p99: float
    max: float
    conditioned: float


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """picture, grazing: by kind of ray. `error` (n,): per ray, NaN unless right. bad (n,): missed, false or wrong."""

    picture: Counts
    grazing: Counts
    errors: Errors
    error: Array
    bad: NDArray[np.bool_]
    evaluations: float
    grazing_evaluations: float

    @property
    def all(self) -> Counts:
        return self.picture + self.grazing


def error_stats(values: Array, conditioned: Array | None = None) -> Errors:
    """Of any errors (n,)."""
    if len(values) == 0:
        return Errors(*[float("nan")] * 5)
    median, p90, p99 = (float(x) for x in np.percentile(values, [50, 90, 99]))
    worst = float("nan") if conditioned is None else float(conditioned.max())
    return Errors(median, p90, p99, float(values.max()), worst)


class Answers(Protocol):
    """What is judged: (n,) each, as in `backends.native.Hits`."""

    @property
    def status(self) -> NDArray[np.int8]: ...
    @property
    def t(self) -> Array: ...
    @property
    def hit(self) -> NDArray[np.bool_]: ...
    @property
    def evaluations(self) -> NDArray[np.int32]: ...


def judge(hits: Answers, reference: Reference, picture: int, unit: float, tolerance: float = 0.0) -> Judgement:
    """tolerance: the method's own, in scene units. The first `picture` rays are those of the picture."""
    error = reference.error(hits.t)
    far = np.fmax(reference.tolerance, max(1e-3 * unit, 10.0 * tolerance))
    both = reference.hit & hits.hit & reference.stable
    wrong_root = both & ~(error <= far)
    wrong_kind = both & ~wrong_root & (hits.status != reference.kind)
    right = both & ~wrong_root & ~wrong_kind
    masks = {
        "hits": reference.hit,
        "right": right,
        "missed": reference.hit & ~hits.hit,
        "false": (reference.status != HIT) & hits.hit,
        "wrong_root": wrong_root,
        "wrong_kind": wrong_kind,
        "grazing": hits.status == _GRAZE,
    }
    first = np.arange(len(error)) < picture
    groups = [_counts(masks, reference.stable, group) for group in (first, ~first)]
    seen = right & first
    with np.errstate(invalid="ignore", divide="ignore"):
        errors = error_stats(error[seen], (error / reference.tolerance)[seen])
    effort = hits.evaluations.astype(np.float64)
    bad = reference.stable & (masks["missed"] | masks["false"] | wrong_root | wrong_kind)
    shown = np.where(right, error, np.nan)
    return Judgement(groups[0], groups[1], errors, shown, bad, _mean(effort[first]), _mean(effort[~first]))


def _counts(masks: dict[str, NDArray[np.bool_]], stable: NDArray[np.bool_], group: NDArray[np.bool_]) -> Counts:
    numbers = {name: int(np.count_nonzero(mask & stable & group)) for name, mask in masks.items()}
    return Counts(
        rays=int(np.count_nonzero(stable & group)), unstable=int(np.count_nonzero(~stable & group)), **numbers
    )


def _mean(values: Array) -> float:
    return float(values.mean()) if len(values) else 0.0
