"""A scene rendered here and with POV-Ray, and how the two differ, in numbers."""

from __future__ import annotations

import math
import shlex
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blobscript import Scene, __version__, images
from blobscript.diagnostics import Diagnostic
from blobscript.framing import camera_for, view_rays
from blobscript.images import Image, developed
from blobscript.povray import judge, program
from blobscript.povray.judge import Verdict
from blobscript.povray.program import Run, Workshop
from blobscript.povray.readback import Answers, camera_answers
from blobscript.povray.scene_text import Document
from blobscript.povray.text import Array

__all__ = ["DEPTH_TOLERANCE", "Colors", "Comparison", "Spread", "compare"]

#: A pixel is an outlier where the distances differ by more than this part of the scene's size (and the accuracy that
#: was asked of isosurfaces), and we are off where the certified reference disagrees with us by more.
DEPTH_TOLERANCE = 1e-6
OUR_TOLERANCE = 1e-9
#: Outliers that are judged and listed at most, others that are judged as a sample, and the seconds for each.
_MOST_JUDGED, _SAMPLE, _SECONDS = 64, 24, 20.0


@dataclass(frozen=True, slots=True)
class Spread:
    """Of some errors."""

    median: float
    p99: float
    max: float

    @staticmethod
    def of(errors: Array) -> Spread:
        if not len(errors):
            return Spread(0.0, 0.0, 0.0)
        return Spread(float(np.median(errors)), float(np.quantile(errors, 0.99)), float(errors.max()))


@dataclass(frozen=True, slots=True)
class Colors:
    """Differences of sRGB values, in steps of 1/255: mean over all pixels, and OpenImageIO's comparison of the coded
    pictures; `visible`: pixels that differ visibly by the model of Yee (2004)."""

    mean: float
    rms: float
    max: float
    psnr: float
    visible: int


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """What was found. Distances in units of the script; `gap` (h, w) and `bend` (h, w): differences of distance and of
    normals (radians), NaN unless both hit; `ours` and `theirs`: pictures (h, w, 3) as they are shown, linear."""

    script: str
    width: int
    height: int
    size: float
    document: Document
    both: int
    only_ours: list[tuple[int, int]]
    only_theirs: list[tuple[int, int]]
    depth: Spread
    normal: Spread
    colors: Colors
    outliers: int
    verdicts: list[Verdict]
    sample: list[Verdict]
    judged: bool
    seconds: dict[str, float]
    versions: dict[str, str]
    commands: list[str]
    notes: tuple[Diagnostic, ...]
    ours: NDArray[np.float32]
    theirs: NDArray[np.float32]
    gap: Array
    bend: Array

    @property
    def mask_share(self) -> float:
        """Pixels on which hit or miss agrees."""
        return 1.0 - (len(self.only_ours) + len(self.only_theirs)) / (self.width * self.height)

    @property
    def ours_off(self) -> list[Verdict]:
        """Where the certified reference says that we are wrong."""
        return [v for v in [*self.verdicts, *self.sample] if v.we_are_off(OUR_TOLERANCE * self.size)]

    @property
    def agrees(self) -> bool:
        """Without a judge, an outlier beyond 0.01 % of the pixels speaks against us."""
        if self.judged:
            return not self.ours_off
        return self.outliers <= 1e-4 * self.width * self.height


def compare(
    scene: Scene,
    script: str,
    width: int,
    height: int,
    timeout: float,
    tell: Callable[[str], None] = lambda _: None,
    grid: int | None = None,
) -> Comparison:
    """Renders both. grid: as of `Scene.pov_document`. Raises ProgramError: E1001, E1003, E1004."""
    versions = {"blobscript": __version__, "POV-Ray": program.version()}
    tell("writing the scene for POV-Ray")
    made = scene.pov_document(width, height, "scene", grid)
    camera = camera_for(scene.ir, width, height)
    rays = view_rays(camera, width, height)
    tell("rendering here")
    image, hits, seconds = _here(scene, rays, width, height)
    with program.workshop() as shop:
        shop.add(made.files)
        tell("rendering with POV-Ray")
        run, theirs = _picture(shop, made, width, height, timeout, scene.ir.tone.curve != "linear")
        tell("reading distances and normals back from POV-Ray")
        answers = camera_answers(shop, made, camera, width, height, timeout)
    seconds |= {"POV-Ray: picture": run.seconds}
    for name, part in (("parse", run.parse_seconds), ("trace", run.trace_seconds)):
        if part is not None:
            seconds[f"POV-Ray: picture, {name}"] = part
    if answers.run is not None:
        seconds["POV-Ray: distances and normals"] = answers.run.seconds
    tell("judging what differs")
    # the scene's text holds the exposure; POV-Ray has no tone curve, so its picture gets ours
    shown = developed(image.rgba, image.exposure, image.curve)
    pictures = np.ascontiguousarray(shown[:, :, :3]), developed(theirs, 0.0, image.curve)
    return _found(scene, script, made, rays, hits, answers, pictures, seconds, versions, [run, answers.run])


# ---- both sides ------------------------------------------------------------------------------


def _here(scene: Scene, rays: tuple[Array, Array], width: int, height: int) -> tuple[Image, Any, dict[str, float]]:
    start = time.perf_counter()
    image = scene.render(width=width, height=height, samples=1)
    rendered = time.perf_counter()
    hits = scene.first_hit(rays[0][None], rays[1].reshape(-1, 3))
    return (
        image,
        hits,
        {"here: picture": rendered - start, "here: distances and normals": time.perf_counter() - rendered},
    )


def _picture(
    shop: Workshop, made: Document, width: int, height: int, limit: float, bright: bool
) -> tuple[Run, NDArray[np.float32]]:
    """bright: with light beyond white, in half floats; else sixteen bits."""
    name, kind = ("picture.exr", "+FE") if bright else ("picture.png", "+FN16")
    run = shop.run(made.text, (f"+O{name}", f"+W{width}", f"+H{height}", "-D", "-A", "-V", kind), limit)
    return run, np.ascontiguousarray(images.read(shop.folder / name).rgba[:, :, :3])


# ---- differences -------------------------------------------------------------------------------


def _found(
    scene: Scene,
    script: str,
    made: Document,
    rays: tuple[Array, Array],
    hits: Any,
    answers: Answers,
    pictures: tuple[NDArray[np.float32], NDArray[np.float32]],
    seconds: dict[str, float],
    versions: dict[str, str],
    runs: list[Run | None],
) -> Comparison:
    height, width = pictures[0].shape[:2]
    hit: NDArray[np.bool_] = hits.hit
    both = hit & answers.hit
    gap, bend = np.full(len(hit), np.nan), np.full(len(hit), np.nan)
    gap[both] = np.abs(hits.t[both] - answers.t[both])
    bend[both] = _angle(_towards_eye(hits.normal, rays[1].reshape(-1, 3))[both], answers.normal[both])
    limit = DEPTH_TOLERANCE * made.size + made.accuracy + _off(made, hits.surface)
    differs = (hit != answers.hit) | (gap > limit)
    verdicts, sample = _verdicts(scene, rays, hits.t, answers.t, differs, both)
    return Comparison(
        script,
        width,
        height,
        made.size,
        made,
        int(both.sum()),
        _pixels(hit & ~answers.hit, width),
        _pixels(answers.hit & ~hit, width),
        Spread.of(gap[both]),
        Spread.of(bend[both]),
        _colors(*pictures),
        int(differs.sum()),
        verdicts,
        sample,
        judge.can_judge(),
        seconds,
        versions,
        [shlex.join(run.command) for run in runs if run is not None],
        made.diagnostics,
        *pictures,
        gap.reshape(height, width),
        bend.reshape(height, width),
    )


def _off(made: Document, surface: NDArray[np.int32]) -> Array:
    """How far POV-Ray's surface may be off along a ray: where it is seen from the side, farther than across."""
    known = np.zeros(len(made.forms) + 1)
    for index, off in made.off.items():
        known[index] = 10.0 * off
    return known[surface]


def _verdicts(
    scene: Scene,
    rays: tuple[Array, Array],
    ours: Array,
    theirs: Array,
    differs: NDArray[np.bool_],
    both: NDArray[np.bool_],
) -> tuple[list[Verdict], list[Verdict]]:
    """On the outliers, evenly spread if there are many, and on a sample of the others."""
    if not judge.can_judge():
        return [], []
    outliers, others = np.flatnonzero(differs), np.flatnonzero(both & ~differs)
    some = outliers[np.linspace(0, len(outliers) - 1, min(len(outliers), _MOST_JUDGED)).astype(np.int64)]
    chance = np.random.default_rng(0).permutation(others)[:_SAMPLE]
    first = judge.judged(scene.ir, some, rays, ours, theirs, _SECONDS)
    return first, judge.judged(scene.ir, chance, rays, ours, theirs, _SECONDS)


def _towards_eye(normal: Array, directions: Array) -> Array:
    """POV-Ray turns normals towards the eye."""
    away = np.einsum("ij,ij->i", normal, directions) > 0
    return np.where(away[:, None], -normal, normal)


def _angle(a: Array, b: Array) -> Array:
    """Accurate for small angles; NaN normals (a vanishing gradient) count as none."""
    across = np.linalg.norm(np.cross(a, b), axis=1)
    return np.nan_to_num(np.arctan2(across, np.einsum("ij,ij->i", a, b)), nan=0.0)


def _pixels(mask: NDArray[np.bool_], width: int) -> list[tuple[int, int]]:
    return [(i % width, i // width) for i in np.flatnonzero(mask).tolist()]


def _colors(ours: NDArray[np.float32], theirs: NDArray[np.float32]) -> Colors:
    oiio: Any = import_module("OpenImageIO")
    coded = [np.ascontiguousarray(images.srgb_encode(picture)) for picture in (ours, theirs)]
    buffers = [oiio.ImageBuf(picture) for picture in coded]
    plain = oiio.ImageBufAlgo.compare(*buffers, 0.02, 0.004)
    yee = oiio.CompareResults()
    oiio.ImageBufAlgo.compare_Yee(*[oiio.ImageBuf(p) for p in (ours, theirs)], yee)
    return Colors(
        255.0 * float(np.mean(np.abs(coded[0] - coded[1]))),
        255.0 * float(plain.rms_error),
        255.0 * float(plain.maxerror),
        float(plain.PSNR) if math.isfinite(plain.PSNR) else math.inf,
        int(yee.nfail),
    )
