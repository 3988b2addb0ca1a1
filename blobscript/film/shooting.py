"""The scenes of a film, and a picture of each."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from blobscript import __version__, ir
from blobscript.diagnostics import Diagnostic, Help, ProgramError
from blobscript.driver import compile_source
from blobscript.film.moments import Moment, exposure, moments_of
from blobscript.framing import Extents, default_camera
from blobscript.images import Image
from blobscript.scene import Scene
from blobscript.source import Source

if TYPE_CHECKING:
    from blobscript.backends.picture import Indirect

__all__ = ["Film", "Frame", "Look"]

#: So many moments decide where the camera of a script without one stands.
_SCOUTED = 64


@dataclass(frozen=True, slots=True)
class Look:
    """How every frame is rendered: `samples`, `noise`, `indirect`, `tone` and `transparent` as in `Scene.render`; a
    frame is the mean of `blur` pictures over the part `shutter` of the time to the next frame. `threads` changes no
    pixel."""

    width: int
    height: int
    samples: int = 1
    noise: float | None = None
    indirect: Indirect | None = None
    tone: ir.Tone | None = None
    transparent: bool = False
    seed: int = 0
    blur: int = 1
    shutter: float = 0.5
    threads: int | None = None


@dataclass(frozen=True, slots=True)
class Frame:
    """What one frame of a film shows: the mean of the pictures of its scenes."""

    moment: Moment
    look: Look
    scenes: Sequence[Scene]

    def key(self) -> str:
        """32 hexadecimal digits for the data of the scenes, the options that change pixels, and the version."""
        digest = hashlib.sha256(f"{__version__} {replace(self.look, threads=None)}".encode())
        for scene in self.scenes:
            digest.update(scene.hash.encode())
        return digest.hexdigest()[:32]

    def picture(self, progress: Callable[[float], None] | None = None) -> Image:
        """`progress` gets the finished share of the frame."""
        pictures = [self._part(number, progress) for number in range(len(self.scenes))]
        image = pictures[0]
        if len(pictures) > 1:
            total = np.sum([picture.rgba for picture in pictures], axis=0, dtype=np.float64)
            image.rgba = np.asarray(total / len(pictures), np.float32)
        image.metadata |= {"time": repr(self.moment.time), "phase": repr(self.moment.phase)}
        return image

    def _part(self, number: int, progress: Callable[[float], None] | None) -> Image:
        """One of the pictures, with its share of the samples."""
        look, parts = self.look, len(self.scenes)

        def tell(pixels: int, total: int) -> None:
            if progress is not None:
                progress((number + pixels / total) / parts)

        return self.scenes[number].render(
            width=look.width,
            height=look.height,
            samples=math.ceil(look.samples / parts),
            noise=None if look.noise is None else min(look.noise * math.sqrt(parts), 0.5),
            indirect=look.indirect,
            tone=look.tone,
            transparent=look.transparent,
            threads=look.threads,
            seed=look.seed + number,
            progress=tell,
        )


class Film:
    """A script that has `animate(…)`. Raises ProgramError if it has errors or no `animate` (E1101).

    `diagnostics` are the warnings of all moments seen so far, each once.
    """

    def __init__(self, source: Source, params: Mapping[str, object] | None = None, budget: int | None = None) -> None:
        self._source, self._params, self._budget = source, params, budget
        self.diagnostics: list[Diagnostic] = []
        self._told: set[tuple[str, object]] = set()
        first = self._compile(0.0, 0.0)
        if first.animate is None:
            raise ProgramError([_no_animate(source)])
        self.first = first
        self.animate = first.animate
        self.moments = moments_of(first.animate)

    def frame(self, moment: Moment, look: Look) -> Frame:
        """The scenes of one frame. Raises ProgramError where the script has errors at that time."""
        return Frame(
            moment, look, [self._scene(m, look) for m in exposure(moment, self.animate, look.shutter, look.blur)]
        )

    # ---- inside ------------------------------------------------------------------------

    def _scene(self, moment: Moment, look: Look) -> Scene:
        scene = self._compile(moment.time, moment.phase)
        if scene.camera.span is None:
            camera = default_camera(self._boxes, look.width / look.height)
            scene = replace(scene, camera=camera)
        return Scene(replace(scene, width=look.width, height=look.height))

    @cached_property
    def _boxes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Around all surfaces at moments all over the film: the default camera stands still and shows them all."""
        count = min(len(self.moments), _SCOUTED)
        scouted = {round(i * (len(self.moments) - 1) / max(count - 1, 1)) for i in range(count)}
        scenes = [self._compile(self.moments[k].time, self.moments[k].phase) for k in sorted(scouted)]
        return [box for scene in scenes for box in Extents(scene.surfaces).boxes()]

    def _compile(self, time: float, phase: float) -> ir.Scene:
        scene, found = compile_source(self._source, self._params, self._budget, time, phase)
        if scene is None:
            raise ProgramError([_at(found[0], time, phase), *found[1:]] if time else found)
        for diagnostic in found:
            seen = diagnostic.code, diagnostic.span
            if seen not in self._told:
                self._told.add(seen)
                self.diagnostics.append(diagnostic)
        return scene


def _at(diagnostic: Diagnostic, time: float, phase: float) -> Diagnostic:
    shows = f"`blobscript check --time {time:.6g} --phase {phase:.6g}` shows it, too"
    note = f"this is at time {time:.6g}, phase {phase:.6g}: {shows}"
    return replace(diagnostic, notes=(*diagnostic.notes, note))


def _no_animate(source: Source) -> Diagnostic:
    return Diagnostic(
        "E1101",
        "the script has no `animate`: nobody knows how long the film is",
        helps=(Help("write `animate(seconds = 4, fps = 24)` and use `time` or `phase` where something moves"),),
        path=source.path,
    )
