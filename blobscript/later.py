"""What the API has names for and this version cannot do yet: refused in one sentence, never ignored."""

from __future__ import annotations

from blobscript.diagnostics import BlobscriptError

__all__ = ["NotYetError"]


class NotYetError(BlobscriptError):
    """Part of the plan, but not of this version."""

    def __init__(self, what: str, instead: str) -> None:
        super().__init__(f"{what} is not in this version yet; {instead}")
