"""The pages behind `blobscript explain`: what a code means, an example that fails, why, and the example put right;
and a few topics of the language.

A page is a text in Markdown, `pages/CODE.md`. Its fences are run by the tests: ```` ```blob ````
must give the code, ```` ```blob fixed ```` must not; `--set name=value` behind them gives a parameter,
```` ```file NAME ```` a file beside the script, ```` ```console ```` is a command.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from blobscript.diagnostics import CODES

__all__ = ["TOPICS", "Fence", "fences", "page"]

#: Pages that belong to no code.
TOPICS = {"random": "what rand and noise compute, to the bit"}

_FENCE = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True, slots=True)
class Fence:
    """A piece between ```: its language, the words behind that, and the text."""

    language: str
    words: tuple[str, ...]
    text: str

    @property
    def fixed(self) -> bool:
        return "fixed" in self.words


def page(code: str) -> str:
    """The page of a code, such as "E0101", or of a topic. Raises KeyError for what is neither."""
    if code not in CODES and code not in TOPICS:
        raise KeyError(code)
    return (Path(__file__).parent / "pages" / f"{code}.md").read_text(encoding="utf-8")


def fences(text: str) -> list[Fence]:
    """The examples of a page, in order."""
    return [Fence(language, tuple(words.split()), body) for language, words, body in _FENCE.findall(text)]
