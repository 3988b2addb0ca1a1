"""`render --native`: a tracer compiled for the scene, where there is a compiler and, with `auto`, where it pays."""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from blobscript.scene import Scene

__all__ = ["use_native"]

#: What is measured for the examples (tests/bench/bench_native.py): a compilation takes about so many seconds, and about
#: this part of the time that a picture takes is saved.
_SECONDS, _SAVED = 16.0, 0.15
#: The picture that tells how long the whole one takes is smaller by this on each side.
_SMALLER = 8


def use_native(scene: Scene, arguments: argparse.Namespace, width: int, height: int, light: dict[str, Any]) -> None:
    """Lets the scene trace with its own tracer; says on standard error why not, where it does not. light: the options
    of `Scene.render` that say how long a pixel takes."""
    from blobscript.emitting.compiled import NativeError

    if (arguments.search, arguments.index, arguments.normals) != ("sandwich", "bvh", "analytic"):
        _note("it has the default search, index and normals only")
        return
    try:
        if arguments.native == "auto" and not _pays(scene, width, height, light, arguments.threads):
            return
        scene.specialize()
    except NativeError as reason:
        _note(str(reason))


def _note(reason: str) -> None:
    print(f"note: --native: {reason}; the bundled tracer is used", file=sys.stderr)


def _pays(scene: Scene, width: int, height: int, light: dict[str, Any], threads: int | None) -> bool:
    """Is it compiled already, or does the picture take so long that compiling is won back?"""
    from blobscript.emitting.compiled import cached

    if cached(scene.trimmed.scene):
        return True
    small = max(width // _SMALLER, 1), max(height // _SMALLER, 1)
    start = time.perf_counter()
    scene.render(*small, threads=threads, **light)
    seconds = (time.perf_counter() - start) * (width * height) / (small[0] * small[1])
    return seconds * _SAVED > _SECONDS
