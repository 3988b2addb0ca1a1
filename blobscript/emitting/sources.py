"""The tracer's sources as one text: each file where it is first included, system headers once and first.

Conditions of the preprocessor whose outcome does not depend on the compiler (include guards, other languages and
systems, the instruction sets of the library) are decided here.
"""

from __future__ import annotations

import re
from functools import lru_cache
from importlib import resources

__all__ = ["HEADING", "joined_sources"]

#: How the heading of a file starts.
HEADING = "/* ==== "

#: Macros whose absence or presence is known: other languages and systems, and instruction sets beyond the portable
#: ones, which `joined_sources` may be told to have.
_DECIDED = re.compile(r"__cplusplus|BLOB_X86|_WIN32|__(AVX|FMA|SSE|BMI)\w*")

_INCLUDE = re.compile(r'\s*#\s*include\s*([<"])([^>"]+)[>"]')
_CONDITION = re.compile(r"\s*#\s*(ifdef|ifndef|if|elif|else|endif)\b\s*(.*?)\s*")


@lru_cache(maxsize=4)
def joined_sources(files: tuple[str, ...], defined: frozenset[str] = frozenset()) -> tuple[tuple[str, ...], str]:
    """System headers (names, sorted) and the text of the files with all that they include. defined: of the macros
    that are decided here, those that the compiler defines."""
    headers: set[str] = set()
    seen: set[str] = set()
    text = "\n".join(_file(name, headers, seen, defined) for name in files)
    # one instruction set: its suffix is part of the names
    return tuple(sorted(headers)), re.sub(r"\b(?:ENGINE|PLAIN)_NAME\((\w+)\)", r"\1_baseline", text)


def _file(name: str, headers: set[str], seen: set[str], defined: frozenset[str]) -> str:
    if name in seen:
        return ""
    seen.add(name)
    text = resources.files("blobscript").joinpath("tracer", name).read_text(encoding="utf-8")
    out: list[str] = [heading(text), ""]
    for line in _decided(text.splitlines(), defined):
        include = _INCLUDE.match(line)
        if include is None:
            out.append(line)
        elif include[1] == "<":
            headers.add(include[2])
        else:
            out.append(_file(include[2], headers, seen, defined))
    return "\n".join(out)


def heading(text: str) -> str:
    """The first line of the comment that opens a file: what it is about."""
    first = text.split("\n", 1)[0].removeprefix("/*").strip().removesuffix("*/").strip()
    return f"{HEADING}{first} ==== */"


def _decided(lines: list[str], defined: frozenset[str]) -> list[str]:
    """Without the branches of conditions that are known, and without their directives."""
    out: list[str] = []
    stack: list[tuple[bool, bool]] = []  # (known, lines are taken)
    for number, line in enumerate(lines):
        made = _CONDITION.fullmatch(line)
        if made is None:
            if all(taken for _, taken in stack):
                out.append(line)
            continue
        word, rest = made[1], made[2]
        if word in ("if", "ifdef", "ifndef"):
            stack.append(_outcome(word, rest, lines[number + 1] if number + 1 < len(lines) else "", defined))
            if not stack[-1][0] and all(taken for _, taken in stack):
                out.append(line)
            continue
        known, taken = stack[-1]
        if word == "endif":
            stack.pop()
        elif known:
            stack[-1] = (True, not taken)
        if not known and all(taken for _, taken in stack):
            out.append(line)
    return out


def _outcome(word: str, rest: str, after: str, defined: frozenset[str]) -> tuple[bool, bool]:
    """Is a condition decided, and is what follows taken?"""
    if word == "ifndef" and re.fullmatch(rf"\s*#\s*define\s+{re.escape(rest)}\s*", after):
        return True, True  # an include guard: its define is dropped as an unused macro
    names = re.findall(r"defined\s*\(?\s*(\w+)\s*\)?", rest) if word == "if" else [rest]
    if not names or not all(_DECIDED.fullmatch(name) for name in names):
        return False, True
    there = [name in defined for name in names]
    if word == "ifndef":
        return True, not there[0]
    return True, any(there) if "||" in rest else all(there)
