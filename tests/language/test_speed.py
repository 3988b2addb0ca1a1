"""How long a script may take to be checked: processor time, the best of several runs."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from pathlib import Path

from language.compiling import run

from blobscript.driver import compile_source
from blobscript.files import read_source
from blobscript.source import Source

#: 59 lines with imports, parameters, functions, loops and assertions.
SCENE = Path(__file__).parent.parent.parent / "examples" / "lamp.blob"


def test_compiling_sixty_lines_takes_less_than_twenty_milliseconds() -> None:
    source = read_source(SCENE)
    assert isinstance(source, Source)
    assert 55 <= len(source.text.splitlines()) <= 65
    times: list[float] = []
    for _ in range(15):
        start = time.process_time()
        scene, _ = compile_source(source)
        times.append(time.process_time() - start)
        assert scene is not None
    assert min(times) < 0.020


def test_checking_sixty_lines_takes_less_than_0_4_seconds_with_start_up(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "blobscript", "check", str(SCENE)]
    plain = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    env = {**plain, "PYTHONPYCACHEPREFIX": str(tmp_path), "OPENBLAS_NUM_THREADS": "1"}
    times: list[float] = []
    for _ in range(4):  # the first one writes the compiled modules
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, check=False, capture_output=True, env=env)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        assert done.returncode == 0, done.stderr.decode()
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    assert min(times) < 0.4


def test_a_hundred_thousand_balls_of_loops_and_functions_take_less_than_three_seconds() -> None:
    text = """
    fn cell(i: int, j: int, k: int) -> field = ball((i, j, k) + 0.2 * jitter(i + j), radius = 0.4)
    fn jitter(n: int) -> vec3 = (rand(n), rand(n, seed = 1), 0)
    surface {
      for (i in 0..<50) { for (j in 0..<50) { for (k in 0..<40) { cell(i, j, k) } } }
    }
    """
    start = time.process_time()
    scene, _ = run(text)
    assert time.process_time() - start < 3.0
    assert scene is not None
