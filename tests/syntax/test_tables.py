"""The tables kept on disk: found again, never trusted blindly, never in the way."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from blobscript import tables

PARSE = "import sys; from blobscript.parse import parse; from blobscript.source import Source; "
PARSE += "s, d = parse(Source('t', 'let a = 1')); assert len(s.items) == 1 and not d; print('lark' in sys.modules)"


def start(cache, code: str = PARSE) -> str:
    import os

    env = {**os.environ, "BLOBSCRIPT_CACHE": str(cache)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def kept(cache) -> list:
    return sorted((cache / "blobscript").glob("tables-*.json"))


def test_a_second_start_needs_no_lark(tmp_path) -> None:
    assert start(tmp_path) == "True"
    assert len(kept(tmp_path)) == 1
    assert start(tmp_path) == "False"


@pytest.mark.parametrize("damage", [b"", b"nonsense", b"0" * 64 + b"\n{}"], ids=["empty", "nonsense", "wrong sum"])
def test_a_damaged_cache_is_built_again(tmp_path, damage: bytes) -> None:
    start(tmp_path)
    (file,) = kept(tmp_path)
    file.write_bytes(damage)
    assert start(tmp_path) == "True"
    assert start(tmp_path) == "False"


def test_a_cut_cache_is_built_again(tmp_path) -> None:
    start(tmp_path)
    (file,) = kept(tmp_path)
    file.write_bytes(file.read_bytes()[:-100])
    assert start(tmp_path) == "True"


def test_without_a_folder_there_is_no_cache(tmp_path) -> None:
    (tmp_path / "file").write_text("in the way")
    assert start(tmp_path / "file") == "True"
    assert start("/dev/null/nowhere") == "True"


def test_starts_at_the_same_time_leave_one_whole_file(tmp_path) -> None:
    with ThreadPoolExecutor(4) as pool:
        assert len(list(pool.map(lambda _: start(tmp_path), range(4)))) == 4
    assert [file.name for file in (tmp_path / "blobscript").iterdir()] == [file.name for file in kept(tmp_path)]
    assert start(tmp_path) == "False"


def test_another_grammar_has_another_file() -> None:
    assert tables._cache_path('start: "a"') != tables._cache_path('start: "b"')


def test_a_grammar_with_conflicts_is_refused() -> None:
    from lark.exceptions import GrammarError

    with pytest.raises(GrammarError):
        tables.build('start: a | b\na: "x"\nb: "x"\nlone_block: a\nlone_expr: b\n')


def test_reading_tables_is_quick(tmp_path) -> None:
    """A guard against an order of magnitude (building instead of reading), not a benchmark."""
    code = "import time; t = time.process_time(); " + PARSE + "; print(time.process_time() - t)"
    start(tmp_path)
    best = min(float(start(tmp_path, code).split()[-1]) for _ in range(3))
    assert best < 0.5, f"{best} s"
