"""Scenes made from values, without a script."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from blobscript import ir
from blobscript.assemble import assemble
from blobscript.diagnostics import Diagnostic
from blobscript.makers import MAKERS
from blobscript.source import Source, Span
from blobscript.values import Context
from blobscript.verify import verify

_LINES = 200


class Make:
    """`make.ball(radius=1)` calls the maker; each call stands on a line of its own."""

    def __init__(self, folder: str | None = None) -> None:
        self.source = Source("test.blob", "x\n" * _LINES, folder)
        self.context = Context(Span(self.source, 0, 1), folder)
        self.calls = 0

    def __getattr__(self, name: str) -> Callable[..., Any]:
        start = 2 * min(self.calls, _LINES - 1)
        self.context.span = Span(self.source, start, start + 1)
        self.calls += 1
        return partial(MAKERS[name], self.context)

    def field(self, *children: Any, **arguments: Any) -> ir.Field:
        """The field of a surface with these children."""
        return self.good(self.surface(children=list(children), **arguments)).surfaces[0].field

    def good(self, *placed: Any) -> ir.Scene:
        """A scene without errors."""
        scene, found = self.scene(*placed)
        assert scene is not None, found
        return scene

    def scene(self, *placed: Any, **more: Any) -> tuple[ir.Scene | None, list[Diagnostic]]:
        items = [item if isinstance(item, tuple) else (item, None, None) for item in placed]
        scene, found = assemble(items, self.context, **more)
        if scene is not None:
            verify(scene)
        return scene, found

    def codes(self, *placed: Any, **more: Any) -> list[str]:
        return [d.code for d in self.scene(*placed, **more)[1]]


@pytest.fixture
def make() -> Make:
    return Make()


@pytest.fixture
def make_in() -> Callable[[Any], Make]:
    """Makes scenes that may read a folder."""
    return lambda folder: Make(str(folder))
