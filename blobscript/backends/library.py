"""The C tracer as loaded by ctypes: where it is found, and the types of its functions (`tracer/blob.h`)."""

from __future__ import annotations

import ctypes
import os
import sys
from functools import lru_cache
from importlib import resources
from pathlib import Path

from blobscript.diagnostics import BlobscriptError

__all__ = [
    "INDEXES",
    "MATERIAL",
    "NORMALS",
    "SEARCHES",
    "STATUS",
    "BlobHits",
    "BlobQuery",
    "bind",
    "check_status",
    "load",
]

#: Names in the order of the enums in blob.h.
SEARCHES = ("sandwich", "bernstein", "interval", "segment", "sphere", "march")
INDEXES = ("bvh", "grid", "octree", "bsp", "none")
NORMALS = ("analytic", "forward", "central")
STATUS = ("MISS", "ENTER", "EXIT", "GRAZE", "INVALID")
#: Numbers in a material row (BLOB_MATERIAL).
MATERIAL = 15

_ABI = 3


class BlobQuery(ctypes.Structure):
    _fields_ = [
        ("search", ctypes.c_int32),
        ("normals", ctypes.c_int32),
        ("tolerance", ctypes.c_double),
        ("step", ctypes.c_double),
        ("normal_step", ctypes.c_double),
        ("cancel", ctypes.c_void_p),
    ]


class BlobHits(ctypes.Structure):
    _fields_ = [
        (n, ctypes.c_void_p)
        for n in (
            "status",
            "t",
            "normal",
            "surface",
            "evaluations",
            "nodes",
            "candidates",
            "spans",
            "sandwiches",
            "fallbacks",
        )
    ]


_P, _Z, _I = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int32
_SIGNATURES: dict[str, tuple[type | None, list[type]]] = {
    "blob_abi": (_I, []),
    "blob_isa": (ctypes.c_char_p, []),
    "blob_check": (_I, [_P]),
    "blob_index_build": (_I, [_P, _I, _P]),
    "blob_index_free": (None, [_P]),
    "blob_index_bytes": (_Z, [_P]),
    "blob_first_hit": (_I, [_P, _P, _P, _Z, _P, _P, _P, _P, _P]),
    "blob_any_hit": (_I, [_P, _P, _P, _Z, _P, _P, _P, _P, _P]),
    "blob_field": (_I, [_P, _P, _I, _Z, _P, _P, _P]),
    "blob_paint": (_I, [_P, _P, _Z, _P, _P, _P, _P]),
}


def _candidates() -> list[Path]:
    """BLOBSCRIPT_LIBRARY alone if it is set; else beside the package (installed or editable)."""
    if named := os.environ.get("BLOBSCRIPT_LIBRARY"):
        return [Path(named)]
    name = {"win32": "blob.dll", "darwin": "libblob.dylib"}.get(sys.platform, "libblob.so")
    package = resources.files("blobscript")
    roots = getattr(package, "_paths", None) or [package]
    places = [Path(str(root)) / name for root in roots]
    places += [Path(entry) / "blobscript" / name for entry in sys.path if entry]
    return places


@lru_cache(maxsize=1)
def load() -> ctypes.CDLL:
    """The library, loaded once. Raises BlobscriptError where it is missing or of another version."""
    places = _candidates()
    path = next((p for p in places if p.is_file()), None)
    if path is None:
        where = "" if len(places) > 1 else f" ({places[0]} is no file)"
        raise BlobscriptError(f"the tracer is not installed{where}: run `pip install .` in the project's folder")
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise BlobscriptError(f"the tracer cannot be loaded: {error}") from error
    return bind(library)


def bind(library: ctypes.CDLL) -> ctypes.CDLL:
    """Gives the functions of a tracer their types; one compiled for a scene has only those that rendering needs.
    Raises BlobscriptError where it is of another version."""
    for name, (result, arguments) in _SIGNATURES.items():
        if hasattr(library, name):
            function = getattr(library, name)
            function.restype = result
            function.argtypes = arguments
    if library.blob_abi() != _ABI:
        raise BlobscriptError(f"{library._name} belongs to another version of blobscript: install again")
    return library


def check_status(status: int) -> None:
    """Turn a blob_status into an exception."""
    if status == 1:
        raise MemoryError("the tracer ran out of memory")
    if status == 4:
        raise KeyboardInterrupt
    if status:
        raise AssertionError(f"the tracer refused its input (status {status})")
