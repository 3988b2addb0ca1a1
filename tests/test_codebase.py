"""Lint, types and formatting of the code base itself."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def run(*command: str) -> None:
    """The tool of the environment that runs the tests, else the one on the path."""
    beside = Path(sys.executable).parent / command[0]
    program = str(beside) if beside.exists() else shutil.which(command[0])
    if program is None:
        pytest.fail(f"{command[0]} is missing: pip install '.[test]'")
    done = subprocess.run([program, *command[1:]], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_ruff_finds_nothing() -> None:
    run("ruff", "check", "--quiet", "blobscript", "tests", "grammar")


def test_python_is_formatted() -> None:
    run("ruff", "format", "--check", "--quiet", "blobscript", "tests", "grammar")


def test_types() -> None:
    run("pyright", "--pythonpath", sys.executable)


def test_c_is_formatted() -> None:
    sources = sorted(str(path) for path in (ROOT / "blobscript/tracer").glob("*.[ch]"))
    assert sources
    run("clang-format", "--dry-run", "--Werror", *sources)


def test_every_c_source_is_built() -> None:
    """A file that nobody compiles would look as if it worked."""
    recipe = (ROOT / "blobscript/tracer/CMakeLists.txt").read_text(encoding="utf-8")
    assert [path.name for path in (ROOT / "blobscript/tracer").glob("*.c") if path.name not in recipe] == []


def test_the_tracer_keeps_no_state() -> None:
    """What is static is a function or constant: blob.h promises that calls know nothing of each other."""
    kept = re.compile(r"^\s*(?:static|_Thread_local|__thread)\b(?![^=;\[]*\bconst\b)[^(]*[=;\[]")
    assert kept.match("static int calls;")
    assert kept.match("    static double last[3] = {0.0};")
    assert not kept.match("static const double EPSILON = 1.0;")
    assert not kept.match("static int search(const int *a) {")
    found = [
        f"{path.name}:{i}: {line}"
        for path in sorted((ROOT / "blobscript/tracer").glob("*.[ch]"))
        for i, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if kept.match(line)
    ]
    assert found == []


def test_modules_say_what_they_offer() -> None:
    silent = [
        str(path.relative_to(ROOT))
        for path in (ROOT / "blobscript").rglob("*.py")
        if "__all__" not in path.read_text(encoding="utf-8") and path.name != "syntax.py"
    ]
    assert silent == []


#: Module -> what it must not import, directly: imports point one way.
FORBIDDEN = {
    "source": ("blobscript.",),
    "diagnostics": ("blobscript.syntax", "blobscript.parse", "lark"),
    "syntax": ("blobscript.parse", "blobscript.resolve", "lark"),
    "resolve": ("blobscript.check", "blobscript.lower", "blobscript.driver", "blobscript.cli"),
    "check": ("blobscript.lower", "blobscript.driver", "blobscript.cli"),
    "lower": ("blobscript.driver", "blobscript.cli", "blobscript.backends"),
    "ir": ("blobscript.syntax", "blobscript.values", "blobscript.lower"),
    "field": ("blobscript.syntax", "blobscript.lower", "blobscript.values", "blobscript.backends"),
    "pack": ("blobscript.syntax", "blobscript.lower", "blobscript.values", "blobscript.backends"),
    "driver": ("blobscript.cli",),
    "scene": ("blobscript.cli", "blobscript.parse"),
}


@pytest.mark.parametrize("module", FORBIDDEN)
def test_imports_point_one_way(module: str) -> None:
    path = ROOT / "blobscript" / f"{module}.py"
    lines = path.read_text(encoding="utf-8").splitlines()
    found = [
        line
        for line in lines
        for name in FORBIDDEN[module]
        if line.lstrip().startswith((f"import {name}", f"from {name}"))
    ]
    assert found == []


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Not for types alone, and not late either."""
    paths = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in (ROOT / "blobscript").rglob("*.py")
    }
    modules = {name: path for name, path in paths.items() if path.stem != "__init__"}
    needs = {name: imported(path) & set(modules) - {name} for name, path in modules.items()}
    while free := [name for name, own in needs.items() if not own & set(needs)]:
        for name in free:
            del needs[name]
    assert needs == {}


def imported(path: Path) -> set[str]:
    """Everything that an import in a file may name."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{one.name}" for one in node.names)}
        elif isinstance(node, ast.Import):
            found |= {one.name for one in node.names}
    return found


def test_only_parse_imports_lark() -> None:
    allowed = {"parse.py"}
    users = {
        path.name
        for path in (ROOT / "blobscript").rglob("*.py")
        if any(line.lstrip().startswith(("import lark", "from lark")) for line in path.read_text("utf-8").splitlines())
    }
    assert users <= allowed | {"recovery.py", "tables.py", "doctor.py"}
