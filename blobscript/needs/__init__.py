"""What a scene needs, and the scene without the rest: `trim` is the pass, `names` names what is left."""

from __future__ import annotations

from blobscript.needs.names import Need, needs_of
from blobscript.needs.trim import LeftOut, Trimmed, trimmed

__all__ = ["LeftOut", "Need", "Trimmed", "needs_of", "trimmed"]
