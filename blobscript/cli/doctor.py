"""`blobscript doctor`: what is installed, and what is missing for what."""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib import metadata

__all__ = ["Finding", "findings", "run"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One line. `needed`: blobscript does not work without it."""

    name: str
    found: str | None
    use: str
    needed: bool = False
    remedy: str = ""


def run(arguments: argparse.Namespace) -> int:
    """Exit code 3 where something that blobscript needs is missing."""
    rows = list(findings())
    if arguments.format == "json":
        print(json.dumps({"findings": [asdict(row) for row in rows]}, indent=1))
    else:
        print("\n".join(_line(row) for row in rows))
    return 3 if any(row.needed and row.found is None for row in rows) else 0


def _line(row: Finding) -> str:
    if row.found is not None:
        return f"ok       {row.name:14} {row.found}"
    return f"{'MISSING' if row.needed else 'missing':8} {row.name:14} needed for {row.use}: {row.remedy}"


def findings() -> Iterator[Finding]:
    from blobscript import __version__

    yield Finding("blobscript", __version__, "")
    yield Finding("python", f"{platform.python_version()}, {sys.executable}", "")
    yield Finding("machine", f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()}", "")
    yield _library()
    yield _examples()
    for name, use, needed in _DISTRIBUTIONS:
        extra = next((extra for extra, names in _EXTRAS.items() if name in names), None)
        remedy = f"pip install 'blobscript[{extra}]'" if extra else f"pip install {name}"
        yield Finding(name, _version(name), use, needed, remedy)
    for name, options, use in _PROGRAMS:
        yield Finding(name, _program(name, *options), use, remedy=f"install {name} with the system's package manager")


#: Distribution, what it is used for, whether nothing works without it.
_DISTRIBUTIONS = (
    ("numpy", "everything", True),
    ("lark", "reading scripts", True),
    ("OpenImageIO", "pictures", True),
    ("trimesh", "mesh files", True),
    ("matplotlib", "reports and plots", False),
    ("python-flint", "certified references in reports", False),
    ("av", "films as MP4 and WebM", False),
)

_EXTRAS = {"report": ("matplotlib", "python-flint"), "video": ("av",)}

#: Program, the options that print its version, what it is used for.
_PROGRAMS = (
    ("cc", ("--version",), "tracers compiled for one scene"),
    ("povray", ("--version",), "comparisons with POV-Ray"),
)


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _library() -> Finding:
    """The C library: found, loadable, and of this version."""
    from blobscript.backends import library
    from blobscript.diagnostics import BlobscriptError

    try:
        loaded = library.load()
    except BlobscriptError as error:
        return Finding("tracer", None, "tracing rays", True, str(error))
    return Finding("tracer", f"{loaded._name}, instruction set {loaded.blob_isa().decode()}", "", True)


def _examples() -> Finding:
    from blobscript import resources

    remedy = "install again: pip install ."
    try:
        return Finding("examples", str(resources.folder("examples")), "")
    except FileNotFoundError:
        return Finding("examples", None, "a first look", False, remedy)


def _program(name: str, *options: str) -> str | None:
    path = shutil.which(name)
    if path is None:
        return None
    try:
        done = subprocess.run([path, *options], capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    lines = (done.stdout + done.stderr).splitlines()
    told = next((line.strip() for line in lines if re.search(r"\d+\.\d+\.\d+", line)), "version unknown")
    return f"{path}, {told}"
