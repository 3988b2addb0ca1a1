"""Output files: refused before the work where that can be known, and written whole or not at all.

Every file is written under a passing name in its folder and renamed when it is complete: a failure or an
interruption leaves nothing behind and an existing file as it was.
"""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Generator, Sequence
from pathlib import Path

from blobscript.diagnostics import Diagnostic, Help, ProgramError

__all__ = [
    "FileError",
    "FormatError",
    "WriteError",
    "check_ending",
    "check_output",
    "pending",
    "write_bytes",
    "write_text",
]


class FileError(ProgramError):
    """A file that cannot be read or written, outside of any script; `reason` says why."""

    code = ""
    failure = ""

    def __init__(self, reason: str, path: str | Path, *helps: str) -> None:
        self.reason = reason
        message = f"{self.failure} `{path}`: {reason}"
        super().__init__([Diagnostic(self.code, message, helps=tuple(Help(text) for text in helps), path=str(path))])


class WriteError(FileError):
    code = "E0802"
    failure = "cannot write"


class FormatError(FileError):
    code = "E0803"
    failure = "cannot write"


def check_ending(path: str | Path, what: str, endings: Sequence[str]) -> str:
    """The ending of a path in lower case, if it is one of `endings` (".svg", …). Raises FormatError.

    what: the kind of file, for the message; a noun that takes "a".
    """
    ending = Path(path).suffix.lower()
    if ending not in endings:
        has = f"{Path(path).suffix} is no {what} format"
        reason = has if ending else f"a {what} needs an ending that names its format"
        known = f"{', '.join(endings[:-1])} or {endings[-1]}" if len(endings) > 1 else endings[0]
        raise FormatError(reason, path, f"use {known}")
    return ending


def check_output(path: str | Path) -> Path:
    """The file that will really be replaced (links followed), if it can be one. Raises WriteError."""
    target = Path(os.path.realpath(path))
    shown = Path(path)
    if target.is_dir():
        raise WriteError("it is a folder", path, "give a file name in it")
    if target.exists() and not target.is_file():
        raise WriteError("it is not a plain file", path)
    if not target.parent.is_dir():
        raise WriteError(f"there is no folder `{shown.parent}`", path, f"create `{shown.parent}` first")
    if not os.access(target.parent, os.W_OK):
        reason = f"the folder `{shown.parent}` is not writable"
        raise WriteError(reason, path, "choose another folder, or allow writing there")
    return target


@contextlib.contextmanager
def pending(path: str | Path) -> Generator[Path]:
    """A new, empty file beside the target, which replaces it at the end of the block, or goes if that fails.

    Raises WriteError, also for an OSError in the block.
    """
    target = check_output(path)
    part = target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.part")
    try:
        mode = target.stat().st_mode & 0o777 if target.exists() else 0o666
        os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode))
        yield part
        os.replace(part, target)
    except OSError as error:
        raise WriteError((error.strerror or str(error) or "the system refuses").lower(), path) from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink()


def write_text(path: str | Path, text: str) -> None:
    """In UTF-8, line ends as they are. Raises WriteError."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | Path, data: bytes) -> None:
    """Raises WriteError."""
    with pending(path) as part:
        part.write_bytes(data)
