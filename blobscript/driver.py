"""The passes in order: what happens to a script."""

from __future__ import annotations

import os
from collections.abc import Mapping

from blobscript import ir, syntax
from blobscript.check import check
from blobscript.diagnostics import Diagnostic, ProgramError, has_errors
from blobscript.files import read_source
from blobscript.lower import lower
from blobscript.parse import parse
from blobscript.report import sorted_by_place
from blobscript.resolve import resolve
from blobscript.scene import Scene
from blobscript.source import Source
from blobscript.verify import verify

__all__ = ["compile", "compile_source", "load", "scene_of"]


def compile_source(
    source: Source,
    params: Mapping[str, object] | None = None,
    budget: int | None = None,
    time: float = 0.0,
    phase: float = 0.0,
) -> tuple[ir.Scene | None, list[Diagnostic]]:
    """The scene, or None where the program has errors; and everything there is to say, in order of place.

    time (seconds), phase (0 to 1): the moment of a film, what scripts read under these names.
    Nothing is evaluated before the whole program is right in syntax, names and types.
    """
    script, found = parse(source)
    program, more = resolve(script)
    found += more
    typed, more = check(program)
    found += more
    if has_errors(found):
        return None, sorted_by_place(found)
    scene, more = lower(typed, params, budget, time=time, phase=phase)
    found = sorted_by_place([*found, *more])
    if scene is not None:
        verify(scene)
    return scene, found


def check_source(
    source: Source,
    params: Mapping[str, object] | None = None,
    budget: int | None = None,
    time: float = 0.0,
    phase: float = 0.0,
) -> list[Diagnostic]:
    """What there is to say about a script; one that only defines things for others needs no surface."""
    _, found = compile_source(source, params, budget, time, phase)
    codes = {d.code for d in found}
    if "E0401" in codes and "W0402" not in codes and _is_module(parse(source)[0]):
        return [d for d in found if d.code != "E0401"]
    return found


def _is_module(script: syntax.Script) -> bool:
    """Definitions and nothing else."""
    return bool(script.items) and all(
        isinstance(item, (syntax.Let, *syntax.Declaration.__args__)) for item in script.items
    )


def compile(  # noqa: A001 - the public name is the verb
    text: str,
    name: str = "<string>",
    base: str | os.PathLike[str] | None = None,
    params: Mapping[str, object] | None = None,
    budget: int | None = None,
    time: float = 0.0,
    phase: float = 0.0,
) -> Scene:
    """The scene of a program text. Its files are looked for below the folder `base` (None: it may read none).

    Raises ProgramError with all diagnostics if the program has errors.
    """
    folder = os.path.abspath(base) if base is not None else None
    return scene_of(Source(name, text, folder), params, budget, time, phase)


def load(
    path: str | os.PathLike[str],
    params: Mapping[str, object] | None = None,
    budget: int | None = None,
    time: float = 0.0,
    phase: float = 0.0,
) -> Scene:
    """The scene of a script file. Raises ProgramError, also where the file cannot be read (E0801)."""
    source = read_source(path)
    if isinstance(source, Diagnostic):
        raise ProgramError([source])
    return scene_of(source, params, budget, time, phase)


def scene_of(
    source: Source,
    params: Mapping[str, object] | None = None,
    budget: int | None = None,
    time: float = 0.0,
    phase: float = 0.0,
) -> Scene:
    """The scene of a source that has been read. Raises ProgramError."""
    scene, found = compile_source(source, params, budget, time, phase)
    if scene is None:
        raise ProgramError(found)
    return Scene(scene, tuple(found))
