"""The script files that may be imported: those below the scene's folder, and the standard library.

A path starts from the folder of the file that names it. Symbolic links are followed before the
check, so a link that leads out of the scene's folder is outside of it.
"""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

from blobscript import resources, syntax
from blobscript.diagnostics import Diagnostic, Edit, Help
from blobscript.files import read_source
from blobscript.parse import parse
from blobscript.source import Source
from blobscript.suggest import closest, closest_file

__all__ = ["Imports", "Place", "standard_definitions", "standard_modules"]

Import = syntax.ImportNames | syntax.ImportModule


@dataclass(frozen=True, slots=True)
class Place:
    """Where an imported file is. `key` is the same for the same file, `shown` is its name for people."""

    key: str
    shown: str
    folder: str | None


@dataclass(frozen=True, slots=True)
class Imports:
    """Finds and reads what the scene `main` may import."""

    main: Source

    def find(self, source: Source, item: Import) -> Place | Diagnostic:
        """The file that an import in `source` means."""
        return self._find_file(source, item) if item.is_file else _find_module(item)

    def parse(self, place: Place, item: Import) -> tuple[syntax.Script, list[Diagnostic]] | Diagnostic:
        if not _is_regular(place.key):
            return Diagnostic("E0204", f"`{item.path}` is no file that can be read", item.path_span, "not a file")
        found = read_source(place.key)
        if isinstance(found, Diagnostic):
            reason = found.message.rpartition(": ")[2]
            return Diagnostic("E0204", f"`{item.path}` cannot be read: {reason}", item.path_span, "cannot be read")
        if place.folder is None:
            script, diagnostics = _parsed_module(place.shown, found.text)
            return script, list(diagnostics)
        return parse(Source(place.shown, found.text, place.folder))

    def _find_file(self, source: Source, item: Import) -> Place | Diagnostic:
        root = self.main.folder
        if root is None or source.folder is None:
            return _outside(item, "this script has no folder, so it can only import from the standard library")
        root = os.path.realpath(root)
        path = _real(os.path.join(source.folder, item.path))
        if path is None or os.path.isabs(item.path) or not _below(path, root):
            return _outside(
                item, "a scene reads only what lies below its own folder: a stranger's scene is safe to open"
            )
        if not os.path.exists(path):
            return _no_file(item, source.folder)
        shown = os.path.join(os.path.dirname(self.main.path), os.path.relpath(path, root))
        return Place(path, shown, os.path.dirname(path))


def _real(path: str) -> str | None:
    try:
        return os.path.realpath(path)
    except (OSError, ValueError):  # a zero character
        return None


def _below(path: str, root: str) -> bool:
    return os.path.commonpath([path, root]) == root


def _is_regular(path: str) -> bool:
    """Not a folder, and nothing that could wait for ever, like a pipe."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except OSError:
        return False


# ---- the standard library ---------------------------------------------------------------


@lru_cache(maxsize=64)
def _parsed_module(shown: str, text: str) -> tuple[syntax.Script, list[Diagnostic]]:
    """A module of the standard library; read once for all scripts of a process, as nobody changes its tree."""
    return parse(Source(shown, text, None))


def standard_modules() -> dict[str, Path]:
    """Dotted name -> file of every module of the standard library."""
    base = resources.folder("stdlib")
    return {
        "std." + ".".join(path.relative_to(base).with_suffix("").parts): path for path in sorted(base.rglob("*.blob"))
    }


@cache
def standard_definitions() -> dict[str, str]:
    """Name -> the module of the standard library that defines it; for did-you-mean."""
    found: dict[str, str] = {}
    for module, path in standard_modules().items():
        source = read_source(path)
        if isinstance(source, Source):
            for item in parse(source)[0].items:
                if isinstance(item, (syntax.Let, syntax.Fn, syntax.KernelDecl, syntax.TypeAlias)):
                    found.setdefault(item.name.text, module)
    return found


def _find_module(item: Import) -> Place | Diagnostic:
    known = standard_modules()
    name = item.path if item.path.startswith("std.") else "std." + item.path
    path = known.get(name)
    if path is not None:
        return Place(str(path.resolve()), "stdlib/" + name[4:].replace(".", "/") + ".blob", None)
    near = closest(name, known)
    return Diagnostic(
        "E0204",
        f"the standard library has no module `{item.path}`",
        item.path_span,
        "not found",
        helps=(Help(f"did you mean `{near}`?", (Edit(item.path_span, near),)),) if near else (),
        notes=(
            "the standard library has " + ", ".join(f"`{name}`" for name in known),
            'a file beside the script is imported by its name in quotes: from "parts.blob"',
        ),
    )


# ---- what goes wrong ----------------------------------------------------------------------


def _no_file(item: Import, folder: str) -> Diagnostic:
    module = _meant_module(item.path)
    if module:
        quoted = Help(
            f"a module of the standard library is named without quotes: {module}", (Edit(item.path_span, module),)
        )
        return Diagnostic("E0204", f"there is no file `{item.path}`", item.path_span, "not found", helps=(quoted,))
    wanted = os.path.basename(item.path)
    near = closest_file(wanted if wanted.endswith(".blob") else f"{wanted}.blob", _listed(folder, item.path))
    helps: tuple[Help, ...] = ()
    if near:
        path = os.path.join(os.path.dirname(item.path), near)
        helps = (Help(f"did you mean `{path}`?", (Edit(item.path_span, f'"{path}"'),)),)
    return Diagnostic("E0204", f"there is no file `{item.path}`", item.path_span, "not found", helps=helps)


def _meant_module(path: str) -> str | None:
    """std.curves for "std/curves", "curves.blob" and the like."""
    dotted = path.removesuffix(".blob").replace("/", ".").lstrip(".")
    known = standard_modules()
    for name in (dotted, f"std.{dotted}"):
        if name in known:
            return name
    return closest(dotted, known) if dotted.startswith("std.") else None


def _listed(folder: str, path: str) -> list[str]:
    """The files where a path leads."""
    try:
        return os.listdir(os.path.join(folder, os.path.dirname(path)))
    except OSError:
        return []


def _outside(item: Import, note: str) -> Diagnostic:
    return Diagnostic(
        "E0207",
        f"`{item.path}` is outside the scene's folder",
        item.path_span,
        "not below the folder of the scene",
        helps=(Help("copy the file into the scene's folder and name it from there"),),
        notes=(note,),
    )
