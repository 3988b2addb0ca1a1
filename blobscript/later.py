"""What the API has names for and this version cannot do yet: refused in one sentence, never ignored."""

from __future__ import annotations

from blobscript.diagnostics import BlobscriptError

__all__ = ["NotYetError", "require_index", "require_search"]

_SEARCHES = frozenset({"bernstein", "interval", "segment", "sphere", "march"})
_INDEXES = frozenset({"grid", "octree", "bsp", "none"})


class NotYetError(BlobscriptError):
    """Part of the plan, but not of this version."""

    def __init__(self, what: str, instead: str) -> None:
        super().__init__(f"{what} is not in this version yet; {instead}")


def require_search(name: str) -> None:
    """Raises NotYetError; unknown names are the tracer's to refuse."""
    if name in _SEARCHES:
        raise NotYetError(f"the search `{name}`", "`sandwich` finds every hit to the last bits")


def require_index(name: str) -> None:
    """Raises NotYetError; unknown names are the tracer's to refuse."""
    if name in _INDEXES:
        raise NotYetError(f"the index `{name}`", "`bvh` is there")
