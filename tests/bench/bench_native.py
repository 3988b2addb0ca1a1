"""The tracer compiled for a scene against the bundled one: size, seconds of the compiler, speed.

    python tests/bench/bench_native.py [example ...]

Processor time of 640x480 pictures, one thread, one sample, the least of some interleaved runs.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import blobscript
from blobscript.backends import picture
from blobscript.backends.native import Native
from blobscript.emitting import c_program
from blobscript.emitting.compiled import compiled, find_compiler, library_text

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
REPEATS = 5


def seconds(scene: blobscript.Scene, tracer: Native) -> float:
    start = time.process_time()
    picture.render(scene.trimmed.scene, tracer, width=640, height=480, threads=1)
    return time.process_time() - start


def row(name: str) -> str:
    scene = blobscript.load(EXAMPLES / f"{name}.blob")
    library, compiling = compiled(scene.trimmed.scene)
    bundled, own = Native(scene.trimmed.scene), Native(scene.trimmed.scene, library)
    times = [(seconds(scene, bundled), seconds(scene, own)) for _ in range(REPEATS + 1)][1:]
    theirs, ours = (min(t[k] for t in times) for k in range(2))
    code = Path(library._name).stat().st_size
    lines = c_program(scene.trimmed.scene, scene.ir).count("\n")
    text = len(library_text(scene.trimmed.scene, find_compiler().defined).encode())
    return (
        f"| {name} | {lines} | {text / 1024:.0f} | {code / 1024:.0f} | {bundled.packed.nbytes / 1024:.1f} "
        f"| {compiling:.1f} | {theirs * 1e3:.0f} | {ours * 1e3:.0f} | {theirs / ours:.2f} |"
    )


def main() -> None:
    names = sys.argv[1:] or sorted(path.stem for path in EXAMPLES.glob("*.blob"))
    print("| scene | lines of the C scene | text kB | object kB | data kB | compiler s | bundled ms | own ms | ratio |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in names:
        print(row(name), flush=True)


if __name__ == "__main__":
    main()
