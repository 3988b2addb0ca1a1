"""The emitted C scene: one file with the parts of the tracer that a scene needs."""

from __future__ import annotations

from blobscript.emitting.program import c_program

__all__ = ["c_program"]
