"""The searches and indexes that the suites run through; a new one is one word here."""

from __future__ import annotations

__all__ = ["INDEXES", "SEARCHES"]

#: Searches that miss nothing.
SEARCHES = ("sandwich", "bernstein", "interval")
INDEXES = ("bvh", "grid", "octree", "bsp", "none")
