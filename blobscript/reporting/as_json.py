"""A report as JSON: every figure of it, NaN and infinity as null."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any, cast

from blobscript.reporting.content import Report
from blobscript.reporting.judging import Judgement
from blobscript.reporting.pov import PovRay
from blobscript.reporting.searches import Result
from blobscript.reporting.summary import best_search, pareto, search_sentences

__all__ = ["finite", "judgement_facts", "povray_facts", "report_json", "result_facts"]


def report_json(report: Report) -> str:
    facts: dict[str, object] = {
        "summary": search_sentences(report.searches),
        "quick": report.quick,
        "header": asdict(report.header),
        "searches": [result_facts(r, report.searches) for r in report.searches],
        "normals": [asdict(r) for r in report.normals],
        "indexes": [
            {
                "index": r.index,
                "build_seconds": asdict(r.build),
                "seconds_per_ray": asdict(r.trace),
                "total_seconds": r.total,
                "bytes": r.bytes,
                **judgement_facts(r.judgement),
            }
            for r in report.indexes
        ],
        "meshes": [asdict(r) for r in report.meshes],
        "sampling": asdict(report.sampling),
        "povray": None if report.povray is None else povray_facts(report.povray),
    }
    return json.dumps(finite(facts), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def result_facts(result: Result, results: list[Result]) -> dict[str, object]:
    """One of some results."""
    return {
        **asdict(result.method),
        "setting_in_units": result.setting,
        "proved": result.method.proved,
        "faultless": result.faultless,
        "taken": result is best_search(results),
        "pareto": any(result is other for other in pareto(results)),
        "seconds_per_ray": asdict(result.time),
        "timed_rays": result.timed_rays,
        "sweep_ended_here": result.last,
        **judgement_facts(result.judgement),
    }


def povray_facts(povray: PovRay) -> dict[str, object]:
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
                "timed_width": r.width,
                **judgement_facts(r.judgement),
            }
            for r in povray.results
        ],
    }


def judgement_facts(judgement: Judgement) -> dict[str, object]:
    return {
        "errors": asdict(judgement.errors),
        "picture": asdict(judgement.picture),
        "grazing": asdict(judgement.grazing),
        "evaluations_per_ray": judgement.evaluations,
        "evaluations_per_grazing_ray": judgement.grazing_evaluations,
    }


def finite(value: Any) -> Any:
    """NaN and infinity become None, all the way down."""
    if isinstance(value, dict):
        return {key: finite(v) for key, v in cast("dict[str, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [finite(v) for v in cast("list[Any]", value)]
    return None if isinstance(value, float) and not math.isfinite(value) else value
