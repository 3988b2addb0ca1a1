"""Local names: parameters, `let` in blocks, loop variables, and the frames they live in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from blobscript.source import Span
from blobscript.types import Type

__all__ = ["Frame", "LocalName", "Scope"]


@dataclass(frozen=True, slots=True)
class LocalName:
    slot: int
    type: Type
    span: Span


@dataclass(slots=True, eq=False)
class Frame:
    """The slots of one function. `captured`: slot in the frame around -> slot here."""

    size: int = 0
    captured: dict[int, int] = field(default_factory=dict[int, int])

    def new_slot(self) -> int:
        self.size += 1
        return self.size - 1


@dataclass(slots=True, eq=False)
class Scope:
    """The names of a block; looks outward through `parent`, perhaps into another frame."""

    frame: Frame
    parent: Scope | None = None
    names: dict[str, LocalName] = field(default_factory=dict[str, LocalName])

    def inner(self) -> Scope:
        """A block in this one."""
        return Scope(self.frame, self)

    def function(self) -> Scope:
        """The inside of a lambda that is written here."""
        return Scope(Frame(), self)

    def add(self, name: str, kind: Type, span: Span) -> int:
        slot = self.frame.new_slot()
        self.names[name] = LocalName(slot, kind, span)
        return slot

    def find(self, name: str) -> LocalName | None:
        """The local name as seen from this frame: names of frames around are captured on the way."""
        own = self.names.get(name)
        if own is not None or self.parent is None:
            return own
        outer = self.parent.find(name)
        if outer is None or self.parent.frame is self.frame:
            return outer
        slot = self.frame.captured.get(outer.slot)
        if slot is None:
            slot = self.frame.captured[outer.slot] = self.frame.new_slot()
        return LocalName(slot, outer.type, outer.span)

    def first(self, name: str) -> Span | None:
        """Where a name that is visible here was introduced (captures nothing)."""
        scope: Scope | None = self
        while scope is not None:
            if name in scope.names:
                return scope.names[name].span
            scope = scope.parent
        return None

    def all(self) -> Iterator[tuple[str, Type]]:
        """Every visible name with its type."""
        scope: Scope | None = self
        while scope is not None:
            for name, local in scope.names.items():
                yield name, local.type
            scope = scope.parent
