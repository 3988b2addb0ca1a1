"""The conditioned error under the name that the tests know it by; see `blobscript.conditioning`."""

from blobscript.conditioning import EPS, leaves, magnitude, position_error, rounding, steepness, tolerance

__all__ = ["EPS", "leaves", "magnitude", "position_error", "rounding", "steepness", "tolerance"]
