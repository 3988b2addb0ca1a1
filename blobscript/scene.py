"""The public scene: what a program means, and what can be asked of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blobscript import __version__, ir
from blobscript.diagnostics import Diagnostic

if TYPE_CHECKING:
    import trimesh

    from blobscript.backends.native import Hits, Native
    from blobscript.backends.picture import Indirect
    from blobscript.images import Image
    from blobscript.needs import Trimmed
    from blobscript.povray import Document

__all__ = ["Index", "Normals", "Scene", "Search"]

Search = Literal["sandwich", "bernstein", "interval", "segment", "sphere", "march"]
Index = Literal["bvh", "grid", "octree", "bsp", "none"]
Normals = Literal["analytic", "forward", "central"]
Array = NDArray[np.float64]


class Scene:
    """Made by `blobscript.load` and `blobscript.compile`; `ir` is the scene as plain data.

    Points, origins and directions are (n, 3) in scene units; whatever NumPy can convert is taken.
    `diagnostics` holds the warnings. All methods may be called from several threads.
    """

    def __init__(self, scene: ir.Scene, diagnostics: Sequence[Diagnostic] = ()) -> None:
        self.ir = scene
        self.diagnostics = tuple(diagnostics)

    def __repr__(self) -> str:
        return f"<blobscript.Scene: {', '.join(surface.name for surface in self.surfaces)}>"

    @property
    def surfaces(self) -> tuple[ir.Surface, ...]:
        """Each has `name` and `threshold`, and the rest of what `ir.Surface` says."""
        return self.ir.surfaces

    @cached_property
    def hash(self) -> str:
        """The same for every script that means this picture, whatever its comments and names of files."""
        from blobscript.digest import scene_hash

        return scene_hash(self.ir)

    # ---- the field ---------------------------------------------------------------------

    def field(self, points: ArrayLike, surface: int = 0) -> Array:
        """Combined density of one surface, (n, 3) -> (n,); inside is >= its threshold."""
        return self._native.field(_vectors(points, "points"), self._number(surface))

    def gradient(self, points: ArrayLike, surface: int = 0) -> Array:
        """Analytic gradient of the combined density, (n, 3) -> (n, 3)."""
        return self._native.gradient(_vectors(points, "points"), self._number(surface))

    # ---- rays --------------------------------------------------------------------------

    def first_hit(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = math.inf,
        search: Search = "sandwich",
        index: Index = "bvh",
        normals: Normals = "analytic",
        tolerance: float | None = None,
        step: float | None = None,
        normal_step: float | None = None,
        threads: int | None = None,
        *,
        counters: bool = False,
    ) -> Hits:
        """First crossing of any surface in (t_min, t_max] of each ray.

        `directions` need not have unit length, t is a distance. `t_min` and `t_max` are numbers or
        (n,). The result does not depend on `threads` (None: all cores). `counters`: what each ray took, in
        `hits.counters`: nodes of the index opened and elements (candidates) looked at, for it and the rays beside
        it; stretches (spans) of its way that were searched; sandwiches; fallbacks on another search.
        """
        return self._tracer.first_hit(
            *_rays(origins, directions),
            t_min,
            t_max,
            search=search,
            index=index,
            normals=normals,
            tolerance=tolerance,
            step=step,
            normal_step=normal_step,
            threads=threads,
            counters=counters,
        )

    def any_hit(
        self, origins: ArrayLike, directions: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = math.inf
    ) -> NDArray[np.bool_]:
        """Is there a crossing in (t_min, t_max]? (n, 3), (n, 3) -> (n,)."""
        return self._tracer.any_hit(*_rays(origins, directions), t_min, t_max)

    # ---- results -----------------------------------------------------------------------

    def render(
        self,
        width: int | None = None,
        height: int | None = None,
        samples: int = 1,
        threads: int | None = None,
        aov: Sequence[str] = (),
        *,
        seed: int = 0,
        region: tuple[int, int, int, int] | None = None,
        search: Search = "sandwich",
        index: Index = "bvh",
        normals: Normals = "analytic",
        tolerance: float | None = None,
        step: float | None = None,
        normal_step: float | None = None,
        noise: float | None = None,
        indirect: Indirect | None = None,
        tone: ir.Tone | None = None,
        transparent: bool = False,
        progress: Callable[[int, int], None] | None = None,
    ) -> Image:
        """The picture; `width` and `height` default to what the script asks for. `progress(done, total)`.

        `samples`: 1 is quick and free of noise, without soft shadows and indirect light. `noise`: as many as it
        takes for the error of a pixel to fall below it (white is 1), at most `samples`, or 256 if that is 1.
        `indirect`: "even", "occlusion" or "bounce"; by default "even" for one sample, else "bounce".
        `transparent`: no background; alpha is what hides it, and the shadows on a floor that catches them.
        """
        from blobscript.backends import picture

        image = picture.render(
            self.shown(width, height),
            self._tracer,
            width=width,
            height=height,
            samples=samples,
            threads=threads,
            aov=tuple(aov),
            seed=seed,
            region=region,
            search=search,
            index=index,
            normals=normals,
            tolerance=tolerance,
            step=step,
            normal_step=normal_step,
            noise=noise,
            indirect=indirect,
            tone=tone,
            transparent=transparent,
            progress=progress,
        )
        image.metadata |= {"version": __version__, "hash": self.hash, "parameters": self._parameters()}
        return image

    def to_json(self) -> str:
        """The scene IR as JSON text."""
        from blobscript.ir_json import scene_json

        return scene_json(self.ir)

    def to_pov(self) -> str:
        """The scene as POV-Ray's text. Raises ProgramError (E1001) where it has no counterpart there, or would need
        files beside the text, which `pov_document` makes."""
        return self.pov_document().text

    def pov_document(
        self, width: int | None = None, height: int | None = None, stem: str | None = None, grid: int | None = None
    ) -> Document:
        """The scene for POV-Ray with what is known about it: what is approximated there, which form each surface has.
        With a `stem` for their names it may have `files` beside the text: fields too large for functions are sampled,
        `grid` places along the longest side (200)."""
        from blobscript.povray import Beside, document

        beside = None if stem is None else Beside(stem) if grid is None else Beside(stem, grid)
        return document(self.shown(width, height), width, height, beside)

    def to_c(self) -> str:
        """The scene as a C17 program that renders it: one file with the parts of the tracer that it needs."""
        from blobscript.emitting import c_program

        return c_program(self.trimmed.scene, self.ir)

    def mesh(
        self,
        cell: float | None = None,
        resolution: int | None = None,
        *,
        tolerance: float | None = None,
        adaptive: bool = False,
        relax: int = 0,
        clip: tuple[ArrayLike, ArrayLike] | None = None,
        refine: int | None = None,
        threads: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> trimesh.Trimesh:
        """All surfaces as triangles, with vertex normals and colours: closed, and oriented outwards.

        One of `cell` (scene units), `resolution` (cells along the longest side of the bounds) and `tolerance` (largest
        distance between triangles and surface) says how fine; 128 cells without. `adaptive`: large cells where the
        tolerance lets them. `relax`: rounds of making triangles more even. `clip`: two corners of a box that solids are
        cut to. `refine`: how often cells are halved where they may hide something (2). Raises `meshing.MeshError`.
        """
        from blobscript.meshing import MeshError, Options, bodies, joined
        from blobscript.meshing.grid import REFINEMENTS

        box = None if clip is None else (np.asarray(clip[0], np.float64), np.asarray(clip[1], np.float64))
        options = Options(
            cell=cell,
            resolution=resolution,
            tolerance=tolerance,
            adaptive=adaptive,
            relax=relax,
            clip=box,
            refine=REFINEMENTS if refine is None else refine,
            threads=threads,
        )
        if not self.surfaces:
            raise MeshError("the scene has no surface", "add one: surface { ball(radius = 1) }")
        return joined(bodies(self.ir, self._native, options, progress))

    # ---- what it needs -----------------------------------------------------------------

    @cached_property
    def trimmed(self) -> Trimmed:
        """The scene as every back end gets it, without what cannot matter, and what has been left out."""
        from blobscript.needs import trimmed

        return trimmed(self.ir)

    @cached_property
    def needs(self) -> frozenset[str]:
        """Names of what the scene needs: kernels, kinds of skeletons, nodes, looks (see `info --needs`)."""
        from blobscript.needs import needs_of

        return frozenset(need.name for need in needs_of(self.trimmed.scene))

    # ---- inside ------------------------------------------------------------------------

    @cached_property
    def _native(self) -> Native:
        """All of it: also where no surface is, the field is what the script says."""
        from blobscript.backends.native import Native

        return self._tracer if self.trimmed.scene is self.ir else Native(self.ir)

    @cached_property
    def _tracer(self) -> Native:
        from blobscript.backends.native import Native

        return Native(self.trimmed.scene)

    def specialize(self) -> float:
        """From here on rays are traced by a tracer compiled for what this scene needs: the same hits within the
        conditioned error, with the default search, index and normals. Returns the seconds that the compiler took,
        0 where it had done so before. Raises `emitting.compiled.NativeError` where there is no compiler."""
        from blobscript.backends.native import Native
        from blobscript.emitting.compiled import compiled

        library, seconds = compiled(self.trimmed.scene)
        self.__dict__["_tracer"] = Native(self.trimmed.scene, library)
        return seconds

    def shown(self, width: int | None, height: int | None) -> ir.Scene:
        """The trimmed scene, seen as all of it is seen: the default camera shows everything."""
        from blobscript.framing import camera_for

        size = width or self.ir.width, height or self.ir.height
        if self.trimmed.scene is self.ir or min(size) < 1:
            return self.trimmed.scene
        camera = camera_for(self.ir, *size)
        return replace(self.trimmed.scene, camera=camera, width=size[0], height=size[1])

    def _number(self, surface: int) -> int:
        if not -len(self.surfaces) <= surface < len(self.surfaces):
            raise IndexError(f"there is no surface {surface}: the scene has {len(self.surfaces)}")
        return surface % len(self.surfaces)

    def _parameters(self) -> str:
        from blobscript.notation import settings

        return settings(self.ir.params)


def _vectors(given: ArrayLike, what: str) -> Array:
    array = np.ascontiguousarray(given, dtype=np.float64)
    if array.size == 0:
        return array.reshape(-1, 3)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{what} must have the shape (n, 3), not {array.shape}")
    return array


def _rays(origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    """Both (n, 3); one origin or one direction for all is taken too."""
    a, b = _vectors(origins, "origins"), _vectors(directions, "directions")
    if len(a) != len(b):
        if 1 not in (len(a), len(b)):
            raise ValueError(f"{len(a)} origins and {len(b)} directions do not go together")
        a, b = (np.ascontiguousarray(x) for x in np.broadcast_arrays(a, b))
    return a, b
