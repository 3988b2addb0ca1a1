"""Checks scripts one after the other, each as `blobscript check` does, within 1 GB; the other end is `fuzzing`.

It says that it is ready. On standard input come lengths, each on a line of its own, each followed by as many
bytes: a script. For each one a line of JSON goes to standard output: what was wrong with how it was treated
(or null), the exit code, and the seconds of processor time it took.
"""

from __future__ import annotations

import contextlib
import io
import json
import resource
import sys
import time
import traceback
from pathlib import Path
from typing import Any

MEMORY = 1 << 30


def main(folder: Path) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    from blobscript.cli import main as command

    requests, answers = sys.stdin.buffer, sys.stdout
    answers.write("ready\n")
    answers.flush()
    script = folder / "input.blob"
    for number, line in enumerate(requests):
        script.write_bytes(requests.read(int(line)))
        start = time.process_time()
        fault, code = _judged(command, script, number)
        answers.write(json.dumps([fault, code, time.process_time() - start]) + "\n")
        answers.flush()


def _judged(command: Any, script: Path, number: int) -> tuple[str | None, int]:
    code, out, err = _ran(command, ["check", "--format", "json", str(script)])
    fault = _fault(script, code, out, err)
    others = [["check", str(script)], ["check", "--format", "sarif", str(script)], ["fmt", "--diff", str(script)]]
    if fault is None and number % 3 == 0:  # what else a user does with such a script
        argv = others[number // 3 % 3]
        other, out, err = _ran(command, argv)
        if other not in (0, 1, code) or "Traceback" in err:
            fault = f"{argv[0]} ends with {other}: {out[-2000:]}{err[-4000:]}"
    return fault, code


def _ran(command: Any, argv: list[str]) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = command(argv)
        except BaseException:
            code = 70
            err.write(traceback.format_exc())
    return code, out.getvalue(), err.getvalue()


def _fault(script: Path, code: int, out: str, err: str) -> str | None:
    """None where the script has been treated well."""
    if code not in (0, 1, 3) or "Traceback" in err:
        return f"exit code {code}: {err[-4000:]}"
    if code == 3:  # the file is no text
        return None if '"E0801"' in out + err and script.name in out + err else f"no reason: {out}{err}"
    found = json.loads(out)["diagnostics"]
    errors = [d for d in found if d["severity"] == "error"]
    if bool(errors) != (code == 1):
        return f"exit code {code} with {len(errors)} errors"
    lines = script.read_bytes().decode("utf-8-sig").split("\n")
    return next((f"no place: {d}" for d in found if not _has_place(d, script, lines)), None)


def _has_place(diagnostic: dict[str, Any], script: Path, lines: list[str]) -> bool:
    """In this script, within its text, or in a file that it imports."""
    if not diagnostic["message"] or not diagnostic["path"] or not isinstance(diagnostic["line"], int):
        return False
    if diagnostic["path"] != str(script):
        return diagnostic["line"] >= 1
    line, column = diagnostic["line"], diagnostic["column"]
    return 1 <= line <= len(lines) and 1 <= column <= len(lines[line - 1]) + 1


if __name__ == "__main__":
    main(Path(sys.argv[1]))
