"""How much an approximation matters: blobscript's own small picture with what is lost, and without.

What POV-Ray shows is what blobscript shows with one sample a pixel, so light that only many samples find is lost, too.
Differences are means over pixels of coded colours, in steps of 255. Many samples leave some noise in them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.backends import picture
from blobscript.backends.native import Native
from blobscript.backends.picture import Indirect
from blobscript.framing import camera_for, view_rays
from blobscript.images import developed, srgb_encode
from blobscript.povray.text import Array

__all__ = ["Losses"]

#: Width of the pictures, and samples a pixel where one is not enough.
_WIDTH, _SAMPLES = 80, 48

Mask = NDArray[np.bool_]


class Losses:
    """Of one scene, seen in pictures of the shape width x height. Pictures are made when they are asked for, once."""

    def __init__(self, scene: ir.Scene, width: int, height: int) -> None:
        self._scene = scene
        self._size = (_WIDTH, max(1, min(4 * _WIDTH, round(_WIDTH * height / width))))

    def without(self, changed: ir.Scene) -> str:
        """Of another scene, as one sample shows it."""
        return _steps(self._coded(changed) - self._one)

    def without_area(self, changed: ir.Scene) -> str:
        """Of one with points for lens and lights."""
        return _steps(self._coded(changed, _SAMPLES, "occlusion") - self._soft)

    def without_bounces(self, seen: Callable[[Array, Array], Mask] | None = None) -> str:
        """Of light that comes by way of other surfaces, and shadows from the light of the background. seen: which of
        rays (n, 3), (n, 3) count; all pixels without."""
        gap = self._bounced - self._one
        if seen is None:
            return _steps(gap)
        here = seen(*self._rays())
        return _steps(gap.reshape(-1, 3)[here]) if here.any() else "nothing, as it is not in view"

    def without_paint(self, index: int) -> str:
        """Of the paint of one surface."""
        surfaces = list(self._scene.surfaces)
        surfaces[index] = replace(surfaces[index], field=_bare(surfaces[index].field))
        return self.without(replace(self._scene, surfaces=tuple(surfaces)))

    def without_sides(self) -> str:
        """Of an environment that is the same on all sides."""
        light = self._scene.background.light
        assert isinstance(light, ir.Environment)
        even = np.broadcast_to(light.pixels.mean(axis=1, keepdims=True), light.pixels.shape)
        changed = replace(light, pixels=np.ascontiguousarray(even))
        return self.without(replace(self._scene, background=replace(self._scene.background, light=changed)))

    def without_curve(self) -> str:
        tone = self._scene.tone
        return _steps(self._coded(self._scene, tone=ir.Tone("linear", tone.exposure)) - self._one)

    @cached_property
    def _one(self) -> Array:
        return self._coded(self._scene)

    @cached_property
    def _soft(self) -> Array:
        return self._coded(self._scene, _SAMPLES, "occlusion")

    @cached_property
    def _bounced(self) -> Array:
        return self._coded(self._scene, _SAMPLES, "bounce")

    @cached_property
    def _native(self) -> Native:
        return Native(self._scene)

    def _coded(
        self, scene: ir.Scene, samples: int = 1, indirect: Indirect = "even", tone: ir.Tone | None = None
    ) -> Array:
        same = scene.surfaces is self._scene.surfaces and scene.materials is self._scene.materials
        native = self._native if same else Native(scene)
        width, height = self._size
        made = picture.render(scene, native, width=width, height=height, samples=samples, indirect=indirect, tone=tone)
        coded = srgb_encode(developed(made.rgba, made.exposure, made.curve)[:, :, :3])
        return 255.0 * coded.astype(np.float64)

    def _rays(self) -> tuple[Array, Array]:
        width, height = self._size
        origin, directions = view_rays(camera_for(self._scene, width, height), width, height)
        rays = (directions / np.linalg.norm(directions, axis=2, keepdims=True)).reshape(-1, 3)
        return np.broadcast_to(origin, rays.shape), rays

    def seeing(self, material: int, surfaces: set[int]) -> Callable[[Array, Array], Mask]:
        """Which rays meet one of these surfaces, or the floor if it has the material."""

        def seen(origins: Array, rays: Array) -> Mask:
            found = self._native.first_hit(origins, rays)
            here = found.hit & np.isin(found.surface, sorted(surfaces))
            floor = self._scene.floor
            if floor is None or floor.material != material:
                return here
            down = (floor.height - origins[:, 1]) / np.where(rays[:, 1] == 0, np.nan, rays[:, 1])
            return here | ((down > 0) & ~(found.t < down))

        return seen


def _bare(tree: ir.Field) -> ir.Field:
    """Without paint."""
    if isinstance(tree, ir.Node):
        return replace(tree, children=tuple(map(_bare, tree.children)))
    return replace(tree, paint=np.full_like(tree.paint, -1))


def _steps(gap: Array) -> str:
    return f"{float(np.abs(gap).mean()):.1f}/255 in the mean"
