"""Builds and runs harness.c: the C of the tracer, with sanitizers, on packed scenes in files."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import random_scenes

from blobscript import ir, pack
from blobscript.backends.library import INDEXES

__all__ = ["build", "run", "scenes"]

TRACER = Path(__file__).parents[2] / "blobscript" / "tracer"
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer"]


def build(folder: Path, *, sanitize: bool) -> Path:
    """One program of the harness and the whole tracer but shading, for the baseline instruction set."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    assert compiler, "the tracer was built on this machine: where is its compiler?"
    program = folder / ("watched" if sanitize else "plain")
    sources = sorted(str(path) for path in TRACER.glob("*.c") if path.name != "shade.c")
    options = [
        "-std=gnu17",
        "-O1",
        "-g1",  # lines are enough; variables double the time it takes
        "-Wno-psabi",
        "-DBLOB_ISA=baseline",
        f"-I{TRACER}",
        *(SANITIZERS if sanitize else []),
    ]
    here = str(Path(__file__).with_name("harness.c"))
    subprocess.run([compiler, *options, here, *sources, "-lm", "-o", str(program)], check=True)
    return program


def write(scene: ir.Scene, path: Path) -> None:
    """The structure, then each array as its size in bytes and its bytes, in the order of the pointers."""
    packed = pack.pack(scene)
    names = [name for name, kind in pack.BlobScene._fields_ if kind is ctypes.c_void_p]
    with path.open("wb") as file:
        file.write(bytes(packed.scene))
        for name in names:
            array = packed.arrays.get(name)
            data = b"" if array is None else np.ascontiguousarray(array).tobytes()
            file.write(np.uint64(len(data)).tobytes() + data)


def run(
    program: Path,
    folder: Path,
    scene: ir.Scene,
    *,
    first: int,
    count: int,
    index: str = "bvh",
    under: tuple[str, ...] = (),
    timeout: float = 120.0,
) -> subprocess.CompletedProcess[str]:
    """Runs first to first + count - 1; run 0 is the scene unchanged."""
    path = folder / "scene.packed"
    write(scene, path)
    command = [*under, str(program), str(path), str(first), str(count), str(INDEXES.index(index))]
    clean = {name: value for name, value in os.environ.items() if name != "LD_PRELOAD"}
    environment = {**clean, "ASAN_OPTIONS": "allocator_may_return_null=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=timeout, check=False)


def scenes() -> Iterator[tuple[str, ir.Scene]]:
    """By name: each skeleton with every kernel, plain and mapped, trees of all nodes, several surfaces, a sum of points
    and lines that teams of packets search, an empty one, and an element of no size."""
    for kind in random_scenes.SKELETONS:
        rng = np.random.default_rng(sum(map(ord, kind)))
        leaves = tuple(
            random_scenes.random_leaf(rng, (kind,), (kernel,), mapped=0.5)
            for kernel in random_scenes.BUILT_IN + random_scenes.USER
        )
        yield kind, random_scenes.make_scene((ir.Node("sum", leaves[:5]), 0.4), (ir.Node("max", leaves[5:]), 0.5))
    joint = tuple(random_scenes.random_field(np.random.default_rng([seed, 8]), 1) for seed in range(4))
    yield "joint", random_scenes.make_scene((ir.Node("sum", (joint[0], ir.Node("smooth_max", joint))), 0.4))
    for seed in range(3):
        rng = np.random.default_rng([seed, 9])
        yield f"tree {seed}", random_scenes.random_scene(rng, depth=3, surfaces=1 + seed)
    rng = np.random.default_rng(10)
    alike = [
        random_scenes.random_leaf(rng, (kind,), random_scenes.BUILT_IN[:1], mapped=0.0) for kind in ("points", "lines")
    ]
    yield "team", random_scenes.make_scene((ir.Node("sum", tuple(alike)), 0.3))
    yield "empty", random_scenes.make_scene((ir.Node("sum", ()), 0.5))
    nothing = ir.Lines(np.zeros((1, 3)), np.zeros((1, 3)))
    yield "no length", random_scenes.make_scene((random_scenes.make_leaf(nothing, ir.Kernel("soft2"), 1.0, 1.0), 0.5))
