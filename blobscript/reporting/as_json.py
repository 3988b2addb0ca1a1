"""A report as JSON: every figure of it, NaN and infinity as null."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any, cast

from blobscript.reporting.content import Report
from blobscript.reporting.judging import Judgement
from blobscript.reporting.pov import PovRay
from blobscript.reporting.summary import best_search, pareto, search_sentences

__all__ = ["report_json"]


def report_json(report: Report) -> str:
    best = best_search(report.searches)
    front = pareto(report.searches)
    facts: dict[str, object] = {
        "summary": search_sentences(report.searches),
        "quick": report.quick,
        "header": asdict(report.header),
        "searches": [
            {
                **asdict(r.method),
                "setting_in_units": r.setting,
                "proved": r.method.proved,
                "faultless": r.faultless,
                "taken": r is best,
                "pareto": any(r is other for other in front),
                "seconds_per_ray": asdict(r.time),
                "timed_rays": r.timed_rays,
                **_judgement(r.judgement),
            }
            for r in report.searches
        ],
        "normals": [asdict(r) for r in report.normals],
        "indexes": [
            {
                "index": r.index,
                "build_seconds": asdict(r.build),
                "seconds_per_ray": asdict(r.trace),
                "total_seconds": r.total,
                "bytes": r.bytes,
                **_judgement(r.judgement),
            }
            for r in report.indexes
        ],
        "meshes": None if report.meshes is None else [asdict(r) for r in report.meshes],
        "sampling": asdict(report.sampling),
        "povray": None if report.povray is None else _povray(report.povray),
    }
    return json.dumps(_finite(facts), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _povray(povray: PovRay) -> dict[str, object]:
    return {
        "version": povray.version,
        "forms": povray.forms,
        "refused": povray.refused,
        "variants": [
            {
                "form": r.form,
                "accuracy": r.accuracy,
                "share_of_max_gradient": r.gradient,
                "seconds_per_ray": asdict(r.time),
                **_judgement(r.judgement),
            }
            for r in povray.results
        ],
    }


def _judgement(judgement: Judgement) -> dict[str, object]:
    return {
        "errors": asdict(judgement.errors),
        "picture": asdict(judgement.picture),
        "grazing": asdict(judgement.grazing),
        "evaluations_per_ray": judgement.evaluations,
        "evaluations_per_grazing_ray": judgement.grazing_evaluations,
    }


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(v) for key, v in cast("dict[str, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in cast("list[Any]", value)]
    return None if isinstance(value, float) and not math.isfinite(value) else value
