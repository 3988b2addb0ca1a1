"""The catalogue of stiff and extreme cases: scripts and rays with certified answers, and what tracers make of them."""

from __future__ import annotations

from blobscript.stress.cases import GROUPS, Case, Ray
from blobscript.stress.catalogue import Expected, all_cases, expected

__all__ = ["GROUPS", "Case", "Expected", "Ray", "all_cases", "expected"]
