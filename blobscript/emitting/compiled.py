"""A tracer compiled for what one scene needs, with all that this machine can do: `render --native`.

The same sources and the same reduction as for the emitted C scene, as a shared object with the library's own calls:
scene and picture are handed over as always, so the code depends on needs alone and serves every scene, and every
frame of a film, that has them. Objects are kept by the hash of text, compiler and options in the user's cache.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import secrets
import shutil
import subprocess
import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from blobscript import __version__, ir
from blobscript.backends.library import bind
from blobscript.diagnostics import BlobscriptError
from blobscript.emitting.facts import ABSENT, facts_for
from blobscript.emitting.folding import Facts
from blobscript.emitting.program import SOURCES, preamble, present, reduced, tracer_alive
from blobscript.emitting.pruning import tidied
from blobscript.emitting.sources import joined_sources
from blobscript.emitting.units import Macro
from blobscript.needs import needs_of
from blobscript.pack import Packed, pack

__all__ = ["Compiler", "NativeError", "cached", "compiled", "find_compiler", "library_text"]

#: The calls of blob.h and shade.h that rendering makes.
_ROOTS = (
    "blob_abi",
    "blob_isa",
    "blob_index_build",
    "blob_index_free",
    "blob_index_bytes",
    "blob_first_hit",
    "blob_any_hit",
    "blob_field",
    "blob_paint",
    "shade_abi",
    "shade_tile",
    "shade_pattern",
    "shade_evaluate",
    "shade_respond",
    "shade_lobe",
    "shade_sky_look",
    "shade_sky_draw",
)
_OPTIONS = (
    "-O3",
    "-march=native",
    "-std=c17",
    "-ffp-contract=fast",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fopenmp-simd",
    "-fvisibility=hidden",
    "-fPIC",
    "-shared",
)
#: What a call may ask for, whatever the scene.
_ASKED = frozenset(
    (
        "cancel",
        "layers",
        "times",
        "adaptive",
        "paint",
        "refraction",
        "chance",
        "bounces",
        "fog",
        "floor",
        "lanes",
        "teams",
        "plain",
        "queues",
    )
)
#: Seconds after which a compiler is given up.
_PATIENCE = 120.0


class NativeError(BlobscriptError):
    """There is no tracer for this scene, for the reason given; the bundled one does as well."""


@dataclass(frozen=True, slots=True)
class Compiler:
    """path, what it says of its version, and which of the macros that matter it defines for this machine."""

    path: str
    version: str
    defined: frozenset[str]


@lru_cache(maxsize=4)
def find_compiler(wanted: str | None = None) -> Compiler:
    """$CC, or the first of cc, gcc and clang. Raises NativeError where there is none that works."""
    wanted = wanted or os.environ.get("CC")
    names = [wanted] if wanted else ["cc", "gcc", "clang"]
    path = next((found for name in names if (found := shutil.which(name))), None)
    if path is None:
        raise NativeError(f"there is no C compiler ({', '.join(names)})")
    version = _said([path, "--version"]).split("\n", 1)[0]
    macros = _said([path, "-march=native", "-dM", "-E", "-x", "c", os.devnull])
    words = [line.split() for line in macros.splitlines()]
    return Compiler(path, version, frozenset(line[1] for line in words if len(line) > 1 and line[1].startswith("__")))


def _said(command: list[str]) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE, check=True)
    except (OSError, subprocess.SubprocessError) as error:
        raise NativeError(f"the C compiler {command[0]} does not work: {error}") from error
    return done.stdout


def _there(packed: Packed, scene: ir.Scene) -> frozenset[str]:
    """Pictures differ in size, samples, light and layers from call to call: all of that stays in. Needs that decide
    nothing do not make another tracer."""
    return (present(packed, needs_of(scene)) & ABSENT.keys()) | _ASKED


def library_text(scene: ir.Scene, defined: frozenset[str]) -> str:
    """C text of the shared object for a trimmed scene. defined: macros of the compiler."""
    packed = pack(scene)
    headers, sources = joined_sources(SOURCES, defined)

    def facts(kinds: dict[str, list[str]], macros: dict[str, Macro]) -> Facts:
        return facts_for(_there(packed, scene), tracer_alive(packed, kinds, "bvh"), kinds, {}, macros)

    code = reduced(sources, facts, _ROOTS)
    extra = ("immintrin.h",) if "__AVX2__" in defined else ()
    return tidied(f"{preamble((*headers, *extra))}\n\n{code.strip()}\n")


# ---- the cache -------------------------------------------------------------------------------------


def _folder() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(base) / "blobscript" / "native"


@lru_cache(maxsize=1)
def _folding() -> str:
    """The modules that take the sources apart, as text."""
    modules = sorted(Path(__file__).parent.glob("*.py"))
    return "".join(module.read_text(encoding="utf-8") for module in modules)


def _place(scene: ir.Scene, compiler: Compiler) -> Path:
    """By everything that the text follows from: the sources, what the scene has of each thing, and how folding works
    in this version; and by the compiler. Making the text itself takes a second."""
    packed = pack(scene)
    arrays = packed.arrays
    kinds = [np.unique(arrays[n][k]).tolist() for n, k in (("kernels", "id"), ("nodes", "op"), ("shapes", "kind"))]
    parts = [joined_sources(SOURCES, compiler.defined)[1], __version__, _folding(), repr(kinds)]
    parts += [*sorted(_there(packed, scene)), compiler.path, compiler.version, *_OPTIONS, *sorted(compiler.defined)]
    key = "\0".join(parts)
    return _folder() / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.so"


def cached(scene: ir.Scene) -> bool:
    """Is the tracer of a trimmed scene compiled already?"""
    with contextlib.suppress(NativeError):
        compiler = find_compiler()
        return _place(scene, compiler).exists()
    return False


def compiled(scene: ir.Scene) -> tuple[ctypes.CDLL, float]:
    """The tracer of a trimmed scene, and the seconds that the compiler took (0: it was there). Raises NativeError."""
    compiler = find_compiler()
    path = _place(scene, compiler)
    seconds = 0.0
    if not path.exists():
        seconds = _compile(library_text(scene, compiler.defined), compiler, path)
    try:
        return bind(ctypes.CDLL(str(path))), seconds
    except (OSError, BlobscriptError) as error:
        with contextlib.suppress(OSError):
            path.unlink()  # broken: made anew next time
        raise NativeError(f"what the C compiler made cannot be loaded: {error}") from error


def _compile(text: str, compiler: Compiler, path: Path) -> float:
    """Beside the target, then renamed: two runs at once do not meet."""
    start = time.perf_counter()
    part = path.with_name(f".{path.stem}.{secrets.token_hex(6)}")
    source, made = part.with_suffix(".c"), part.with_suffix(".so")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        source.write_text(text, encoding="utf-8")
        command = [compiler.path, *_OPTIONS, str(source), "-o", str(made), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE, check=False)
        if done.returncode:
            first = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr[:200])
            raise NativeError(f"the C compiler refuses the tracer: {first.strip()}")
        os.replace(made, path)
    except OSError as error:
        raise NativeError(f"{path.parent} cannot be written: {error.strerror or error}") from error
    except subprocess.TimeoutExpired as error:
        raise NativeError(f"the C compiler took more than {_PATIENCE:.0f} s") from error
    finally:
        for rest in (source, made):
            with contextlib.suppress(OSError):
                rest.unlink()
    return time.perf_counter() - start
