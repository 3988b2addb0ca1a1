"""Running POV-Ray: in a folder of its own, with a time limit that holds.

A run gets its own process group. When its time is over, or somebody presses Ctrl-C, the group is killed: POV-Ray does
not listen to SIGTERM while it reads some texts, and needs a second to end if it does. The folder is removed whatever
happens.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

from blobscript.diagnostics import Diagnostic, Help, ProgramError

__all__ = ["FailedError", "MissingError", "Run", "Workshop", "find", "version", "workshop"]

#: Seconds between two looks whether a run has ended, at most.
_LOOK = 0.02


class MissingError(ProgramError):
    """There is no POV-Ray on this machine."""

    def __init__(self) -> None:
        helps = (
            Help("Debian, Ubuntu: apt-get install povray"),
            Help("Fedora: dnf install povray; macOS: brew install povray; others: povray.org/download"),
        )
        super().__init__([Diagnostic("E1004", "POV-Ray is not installed: there is no program `povray`", helps=helps)])


class FailedError(ProgramError):
    """POV-Ray refused a scene, broke, or took too long; `output` is what it said."""

    def __init__(self, message: str, output: str, line: int = 0, help_: str = "") -> None:
        self.output, self.line, self._message = output, line, message
        helps = (Help(help_),) if help_ else ()
        super().__init__([Diagnostic("E1003", message, helps=helps)])

    def about(self, origin: str) -> FailedError:
        """The same, with the line of the script that this was made from."""
        return FailedError(f"{self._message} (made from {origin})" if origin else self._message, self.output, self.line)


@dataclass(frozen=True, slots=True)
class Run:
    """One finished run. seconds: wall clock; output: all that it said; parse, trace: POV-Ray's own times."""

    command: tuple[str, ...]
    seconds: float
    output: str

    @property
    def trace_seconds(self) -> float | None:
        found = re.search(r"Trace Time:[^(]*\(([\d.]+) seconds\)", self.output)
        return float(found[1]) if found else None

    @property
    def parse_seconds(self) -> float | None:
        found = re.search(r"Parse Time:[^(]*\(([\d.]+) seconds\)", self.output)
        return float(found[1]) if found else None


def find() -> str:
    """The program; raises MissingError."""
    path = shutil.which("povray")
    if path is None:
        raise MissingError
    return path


def version() -> str:
    """What the program says it is, such as "3.7.0.10"."""
    try:
        done = subprocess.run([find(), "--version"], capture_output=True, text=True, timeout=30, check=False)
    except (subprocess.TimeoutExpired, OSError) as error:
        raise FailedError("`povray --version` gives no answer", str(error)) from error
    found = re.search(r"POV-Ray\s+(\d[\w.]*)", done.stdout + done.stderr)
    return found[1].removesuffix(".unofficial") if found else "of an unknown version"


@dataclass(frozen=True, slots=True)
class Workshop:
    """A folder for the runs of one comparison."""

    folder: Path

    def add(self, files: dict[str, bytes]) -> None:
        """What a scene reads from its folder."""
        for name, data in files.items():
            (self.folder / name).write_bytes(data)

    def run(self, text: str, options: tuple[str, ...], limit: float, name: str = "scene") -> Run:
        """Runs a scene; what it writes is in the folder afterwards. Raises FailedError after `limit` seconds too."""
        file = self.folder / f"{name}.pov"
        file.write_text(text, encoding="ascii")
        try:
            return self.run_file(file, options, limit)
        except FailedError as error:
            if error.line:
                raise error.about(_origin(text, error.line)) from None
            raise

    def run_file(self, file: Path, options: tuple[str, ...], limit: float) -> Run:
        command = (find(), f"+I{file.name}", *options)
        start = time.perf_counter()
        code, output = _supervised(command, self.folder, limit)
        seconds = time.perf_counter() - start
        if code is None:
            raise FailedError(
                f"POV-Ray was stopped after {limit:g} seconds", output, help_="--timeout 600 gives it more time"
            )
        if code != 0:
            raise _refused(code, output)
        return Run(("povray", *command[1:]), seconds, output)


@contextlib.contextmanager
def workshop() -> Generator[Workshop]:
    with tempfile.TemporaryDirectory(prefix="blobscript-") as folder:
        yield Workshop(Path(folder))


def _supervised(command: tuple[str, ...], folder: Path, limit: float) -> tuple[int | None, str]:
    """Exit code (None: stopped) and everything that was said."""
    said = folder / "output.txt"
    with said.open("wb") as stream:
        process = subprocess.Popen(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=stream,
            start_new_session=True,
            env={**os.environ, "HOME": str(folder)},
        )
        try:
            code = _ended(process, limit)
        finally:
            _end(process)
    return code, said.read_text(encoding="utf-8", errors="replace")


def _ended(process: subprocess.Popen[bytes], limit: float) -> int | None:
    """The exit code, None after `limit` seconds. (`Popen.wait` lets Ctrl-C wait for a quarter of a second.)"""
    start = time.monotonic()
    pause = 0.001
    while process.poll() is None:
        if time.monotonic() - start > limit:
            return None
        time.sleep(pause)
        pause = min(2.0 * pause, _LOOK)
    return process.returncode


def _end(process: subprocess.Popen[bytes]) -> None:
    """The whole group, for sure and at once: all that it could leave behind lies in a folder that goes, too."""
    if process.poll() is not None:
        return
    _signal(process, signal.SIGKILL)
    process.wait()


def _signal(process: subprocess.Popen[bytes], which: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, which)


def _origin(text: str, line: int) -> str:
    """The comment above (or beside) a line that says where in the script it comes from."""
    for written in reversed(text.splitlines()[:line]):
        if found := re.search(r"// (?:.*\()?([^\s()]+:\d+)\)?$", written):
            return found[1]
    return ""


def _refused(code: int, output: str) -> FailedError:
    """POV-Ray's own reason; its messages are wrapped at 80 columns."""
    if code < 0:
        return FailedError(f"POV-Ray broke down with signal {-code}", output)
    flat = re.sub(r"\s*\n\s*", " ", output)
    found = re.search(
        r"File '[^']*' line (\d+): ((?:Possible )?(?:Parse |Fatal )?Error: .*?)(?: Fatal error| Render failed|$)", flat
    )
    if found:
        return FailedError(f"POV-Ray cannot read the scene: {found[2]}", output, int(found[1]))
    lines = [line.strip() for line in output.splitlines() if "rror" in line]
    return FailedError(f"POV-Ray ended with code {code}: {lines[-1] if lines else 'no reason given'}", output)
