"""Light that facets send on to one another before it leaves, as in tracer/brdf.h."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from blobscript import ir
from blobscript.backends import picture
from blobscript.povray.text import Array

__all__ = ["SINGLES", "gain", "lift", "single", "singles"]

#: The cosines towards the eye where the tracer's table has its nodes, from the least that there is.
SINGLES = np.append(1e-3, (np.arange(1, 16) / 15) ** 2)
_ROOTS = np.sqrt(SINGLES)


@lru_cache(maxsize=64)
def singles(roughness: float) -> Array:
    """What facets that reflect everything return after one reflection, at `SINGLES`; linear in the cosine's root."""
    return picture.single_reflections(roughness, SINGLES)


def single(m: ir.Material, nv: Array) -> Array:
    """The same (n,) of a material by cosines (n,); 1 for what is no metal, of which nothing is added."""
    return np.interp(np.sqrt(nv), _ROOTS, singles(m.roughness)) if m.metalness > 0 else np.ones_like(nv)


def gain(m: ir.Material, nv: Array) -> Array:
    """(n, 3) by cosines (n,): how many times the light of one reflection several make (Turquin 2019)."""
    return 1 + (m.metalness * (1 / single(m, nv) - 1))[:, None] * np.array(m.color)


def lift(cosine: Array) -> Array:
    """What several reflections add to the stretch of a diffuse answer: the product of this by n.l and n.v (EON)."""
    return 0.0009 + cosine * (0.6722 + cosine * (0.3476 - 0.3969 * cosine))
