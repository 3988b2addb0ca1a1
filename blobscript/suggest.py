"""Did you mean: names within two slips of the pen."""

from __future__ import annotations

import os
from collections.abc import Iterable

__all__ = ["closest", "closest_file", "distance"]

_LIMIT = 2


def distance(a: str, b: str) -> int:
    """Edits from a to b: insert, delete, replace, or swap two neighbours (Damerau 1964), at most 3."""
    if abs(len(a) - len(b)) > _LIMIT:
        return _LIMIT + 1
    before: list[int] = []
    row = list(range(len(b) + 1))
    for i, x in enumerate(a, 1):
        above, before, row = before, row, [i]
        for j, y in enumerate(b, 1):
            best = min(before[j] + 1, row[j - 1] + 1, before[j - 1] + (x != y))
            if i > 1 and j > 1 and x == b[j - 2] and a[i - 2] == y:
                best = min(best, above[j - 2] + 1)
            row.append(best)
        if min(row) > _LIMIT:
            return _LIMIT + 1
    return row[-1]


def closest(name: str, candidates: Iterable[str]) -> str | None:
    """The nearest candidate within two edits; short names allow fewer, lest everything be close."""
    if len(name) < 2:
        return None
    limit = 1 if len(name) <= 3 else _LIMIT
    scored = [(distance(name.lower(), other.lower()), other) for other in candidates if other and other != name]
    near = [(score, other[0] != name[0], other) for score, other in scored if score <= limit]
    return min(near)[2] if near else None


def closest_file(name: str, candidates: Iterable[str]) -> str | None:
    """The nearest file of the same kind, by what stands before its ending; the same name if it is there."""
    stem, ending = os.path.splitext(name)
    same_kind = {os.path.splitext(other)[0]: other for other in candidates if os.path.splitext(other)[1] == ending}
    near = stem if stem in same_kind else closest(stem, same_kind)
    return same_kind[near] if near else None
