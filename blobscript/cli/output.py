"""Writing files whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path

from blobscript.diagnostics import Diagnostic, Help, ProgramError

__all__ = ["write_bytes", "write_text"]


def write_text(path: str | Path, text: str) -> None:
    """In UTF-8, line ends as they are; like `write_bytes`."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | Path, data: bytes) -> None:
    """Writes beside the target and renames: an interruption leaves the old file as it was. Raises E0802."""
    target = Path(os.path.realpath(path))
    part = target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.part")
    try:
        if target.is_dir():
            raise IsADirectoryError("it is a folder")
        with contextlib.suppress(FileNotFoundError):
            mode = target.stat().st_mode & 0o777
            part.touch(mode=mode, exist_ok=False)
        part.write_bytes(data)
        os.replace(part, target)
    except OSError as error:
        raise ProgramError([_cannot_write(path, error)]) from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink()


def _cannot_write(path: str | Path, error: OSError) -> Diagnostic:
    reason = (error.strerror or str(error)).lower()
    return Diagnostic(
        "E0802",
        f"cannot write `{path}`: {reason}",
        helps=(Help("write to a folder that exists and that you may write to"),),
        path=str(path),
    )
