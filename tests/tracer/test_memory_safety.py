"""The C reads and writes only what it may, on scenes as they are and on scenes with random bytes changed: refused, or
traced without an error of memory or arithmetic. harness.c says how; tests/bench/campaigns.py runs a hundred
times as many."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tracer import harness
from tracer.methods import INDEXES

SCENES = dict(harness.scenes())


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The harness under AddressSanitizer and UndefinedBehaviorSanitizer."""
    return harness.build(tmp_path_factory.mktemp("harness"), sanitize=True)


@pytest.mark.parametrize("index", INDEXES)
@pytest.mark.parametrize("name", SCENES)
def test_scenes_as_they_are(name: str, index: str, watched: Path, tmp_path: Path):
    done = harness.run(watched, tmp_path, SCENES[name], first=0, count=1, index=index)
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout == "1 runs, 1 accepted and traced, 0 cancelled\n"


@pytest.mark.parametrize("name", SCENES)
def test_corrupted_scenes(name: str, watched: Path, tmp_path: Path):
    """A thousand in all. Most changes are harmless digits of some number, or refused; both must occur."""
    count = 1000 // len(SCENES)
    done = harness.run(watched, tmp_path, SCENES[name], first=1, count=count)
    assert done.returncode == 0, done.stderr[-3000:]
    traced = int(done.stdout.split()[2])
    assert 0 < traced < count or name == "empty"
    assert int(done.stdout.split()[-2]) <= 0.05 * count, done.stdout


def test_valgrind(tmp_path: Path):
    """No use of a value that was never set, which the sanitizers do not see. One scene of everything."""
    if not shutil.which("valgrind"):
        pytest.skip("valgrind is not installed")
    plain = harness.build(tmp_path, sanitize=False)
    options = ("valgrind", "-q", "--error-exitcode=9", "--leak-check=full", "--track-origins=no")
    done = harness.run(plain, tmp_path, SCENES["tree 1"], first=0, count=1, under=options)
    assert done.returncode == 0, done.stderr[-3000:]
