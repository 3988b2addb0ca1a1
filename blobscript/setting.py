"""The text of a `--set name=value`; messages about it quote the command line."""

from __future__ import annotations

__all__ = ["Setting"]


class Setting(str):
    """A parameter's value as written on the command line."""

    __slots__ = ()
