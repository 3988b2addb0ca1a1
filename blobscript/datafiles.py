"""The one door to data files: they lie below the scene's folder, symbolic links resolved.

A scene from a stranger can read nothing else, and nothing that is no plain file.
"""

from __future__ import annotations

import hashlib
import os
import stat

from blobscript.diagnostics import Help
from blobscript.suggest import closest_file
from blobscript.values import Context, MakerError

__all__ = ["located", "read_bytes", "read_text", "unreadable"]

#: Larger files are refused, so that a scene from a stranger cannot fill the memory.
MAX_SIZE = 200_000_000


def unreadable(file: str, reason: str, *helps: str, label: str = "") -> MakerError:
    return MakerError("E0801", f"cannot read `{file}`: {reason}", "file", label, tuple(map(Help, helps)))


def read_bytes(ctx: Context, file: str) -> bytes:
    """The content of a file below the scene's folder; remembered as a source of the scene."""
    path = located(ctx, file)
    try:
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):
            raise unreadable(file, "it is not a file" if not os.path.isdir(path) else "it is a folder")
        with open(path, "rb") as opened:
            content = opened.read(MAX_SIZE + 1) if status.st_size <= MAX_SIZE else None
    except OSError as error:
        raise unreadable(file, *_reason(ctx, file, error)) from None
    if content is None or len(content) > MAX_SIZE:
        raise unreadable(file, f"it is larger than {MAX_SIZE // 1_000_000} MB")
    ctx.sources.append((file, hashlib.sha256(content).hexdigest()))
    return content


def located(ctx: Context, file: str) -> str:
    """The path of a file, which lies below the scene's folder; it may be missing."""
    if ctx.folder is None:
        raise MakerError("E0207", f"this script may not read files, but it asks for `{file}`", "file", "no files here")
    root = os.path.realpath(ctx.root or ctx.folder)
    try:
        path = os.path.realpath(os.path.join(ctx.folder, file))
    except (OSError, ValueError):
        raise unreadable(ascii(file)[1:-1], "that is no file name") from None
    if path != root and not path.startswith(root.rstrip(os.sep) + os.sep):
        raise MakerError(
            "E0207",
            f"`{file}` lies outside the scene's folder",
            "file",
            "outside",
            (Help("put the file into the scene's folder or below it; scenes can read nothing else"),),
        )
    return path


def _reason(ctx: Context, file: str, error: OSError) -> tuple[str, ...]:
    if not isinstance(error, FileNotFoundError):
        return ((error.strerror or str(error)).lower(),)
    folder = os.path.dirname(os.path.join(ctx.folder or "", file))
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        names = []
    wanted = os.path.basename(file)
    same = [name for name in names if name.lower() == wanted.lower()]
    if same:
        return "there is no such file", f"did you mean `{same[0]}`? Capital letters count"
    near = closest_file(wanted, names)
    if near:
        return "there is no such file", f"did you mean `{os.path.join(os.path.dirname(file), near)}`?"
    return "there is no such file", "file names start from the folder of the script"


def read_text(ctx: Context, file: str) -> str:
    content = read_bytes(ctx, file)
    if b"\0" in content[:4096]:
        raise unreadable(file, "it is not a text")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise unreadable(file, f"line {line} is not UTF-8", "save it as UTF-8") from None
