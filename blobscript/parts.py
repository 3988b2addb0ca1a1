"""How much there is: blobs of a solved field, and of values before they are put together."""

from __future__ import annotations

from collections.abc import Iterable

from blobscript import ir, values

__all__ = ["count_blobs", "count_parts"]


def count_blobs(field: ir.Field) -> int:
    """The blobs in a field of the scene IR."""
    count = 0
    todo = [field]
    while todo:
        node = todo.pop()
        if isinstance(node, ir.Leaf):
            count += node.count
        else:
            todo += node.children
    return count


def count_parts(surfaces: Iterable[values.Surface], bulk: int = 1) -> int:
    """The blobs that all the surfaces will have; a field that is used twice counts twice.

    bulk: so many points of one array count as one. Values share their parts, so this goes through
    each once (with its own stack: they can be deep).
    """
    known: dict[int, int] = {}
    return sum([_count(surface.field, known, bulk) for surface in surfaces])


def _count(root: values.Field, known: dict[int, int], bulk: int) -> int:
    todo = [root]
    while todo:
        field = todo[-1]
        inner = _inner(field)
        missing = [part for part in inner if id(part) not in known]
        if missing:
            todo += missing
            continue
        known[id(field)] = sum([known[id(part)] for part in inner]) if inner else _own(field, bulk)
        todo.pop()
    return known[id(root)]


def _inner(field: values.Field) -> tuple[values.Field, ...]:
    match field:
        case values.Combine(children=children):
            return children
        case values.Changed(inner=inner):
            return (inner,)
        case _:
            return ()


def _own(field: values.Field, bulk: int) -> int:
    match field:
        case values.Blob(skeleton=values.Cloud(at=at)):
            return 1 + len(at) // bulk
        case values.Blob():
            return 1
        case _:
            return 0
