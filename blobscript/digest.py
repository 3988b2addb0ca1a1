"""A name for what a scene shows: the same for any script that means the same picture."""

from __future__ import annotations

import dataclasses
import hashlib
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from blobscript import ir

__all__ = ["scene_hash"]

#: What only says where things come from.
_PROVENANCE = frozenset({"span", "spans", "sources", "params", "origin"})


def scene_hash(scene: ir.Scene) -> str:
    """32 hexadecimal digits of SHA-256 over the scene's data: comments, names of files and the way
    a number was computed do not matter, its last bit does."""
    digest = hashlib.sha256()
    _feed(digest, scene)
    return digest.hexdigest()[:32]


def _feed(digest: Any, value: Any) -> None:
    if isinstance(value, np.ndarray):
        array = cast("NDArray[Any]", value)
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    elif isinstance(value, (tuple, list)):
        entries = cast("tuple[Any, ...] | list[Any]", value)
        digest.update(f"({len(entries)}".encode())
        for entry in entries:
            _feed(digest, entry)
    elif dataclasses.is_dataclass(value):
        digest.update(type(value).__name__.encode())
        for field in dataclasses.fields(value):
            if field.name not in _PROVENANCE:
                _feed(digest, getattr(value, field.name))
    else:
        digest.update(f"{value!r};".encode())
