"""POV-Ray on the same rays: its `blob` with and without Sturm chains, its `isosurface` over accuracy and max_gradient.

Places come from `trace()` with 15 decimals. Times are those of its trace phase for a picture at its lowest quality (no
light, no shadow), one thread, processor time as it says itself, per pixel; slow variants are timed in smaller pictures,
all of them ten times.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from blobscript import ir
from blobscript.diagnostics import ProgramError
from blobscript.reporting.judging import Judgement, judge
from blobscript.reporting.rays import Rays
from blobscript.reporting.reference import Reference
from blobscript.reporting.timing import REPEATS, Timing, summed_up

if TYPE_CHECKING:
    from blobscript.povray import Document
    from blobscript.povray.program import Workshop
    from blobscript.scene import Scene

__all__ = ["PovRay", "PovResult", "measure_povray", "variant_words"]

#: Accuracies in those of the scene's usual text (1e-7 of its size), and shares of the proved steepest gradient.
_ACCURACIES, _GRADIENTS = (1e4, 1e3, 1e2, 1e1), (0.5, 0.2, 0.05)
#: Seconds that one run may take, that all answers may take together, and processor seconds that a picture may take.
_LIMIT, _QUICK_LIMIT = 60.0, 30.0
_TOGETHER, _QUICK_TOGETHER = 180.0, 40.0
_LONG, _QUICK_LONG = 1.0, 0.2
#: Widths of the pictures that are timed; slow variants are tried in the least first.
_WIDTH, _LEAST_WIDTH = 160, 32


@dataclass(frozen=True, slots=True)
class Variant:
    """accuracy: in scene units (0: has none). gradient: share of the proved bound (0: has none)."""

    form: str
    accuracy: float
    gradient: float
    change: Callable[[str], str]


@dataclass(frozen=True, slots=True, eq=False)
class PovResult:
    """time: per pixel of a picture of that width."""

    form: str
    accuracy: float
    gradient: float
    judgement: Judgement
    time: Timing
    width: int


@dataclass(frozen=True, slots=True, eq=False)
class PovRay:
    """refused: why it cannot show the scene, or why a variant is left out."""

    version: str
    forms: tuple[str, ...]
    results: list[PovResult]
    refused: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """What `judge` looks at; POV-Ray does not say on which side a ray began."""

    status: NDArray[np.int8]
    t: NDArray[np.float64]
    hit: NDArray[np.bool_]
    evaluations: NDArray[np.int32]


def measure_povray(
    scene: Scene,
    rays: Rays,
    reference: Reference,
    unit: float,
    quick: bool,
    progress: Callable[[int, int], None] | None = None,
    *,
    swept: bool = True,
) -> PovRay | None:
    """None where POV-Ray is not installed. Not swept: only what `compile --to pov` writes."""
    import shutil

    if shutil.which("povray") is None:
        return None
    from blobscript.povray.program import version, workshop

    try:
        made = _unexposed(scene).pov_document(_WIDTH, _height(scene, _WIDTH), "scene")
    except ProgramError as error:
        return PovRay(version(), (), [], (error.diagnostics[0].message,))
    forms = tuple(dict.fromkeys(made.forms.values()))
    refused: list[str] = []
    variants = [v for v in _variants(made, quick) if swept or v.change is _unchanged]
    limit, together, long = (_QUICK_LIMIT, _QUICK_TOGETHER, _QUICK_LONG) if quick else (_LIMIT, _TOGETHER, _LONG)
    judged: list[tuple[Variant, Judgement]] = []
    start = time.monotonic()
    with workshop() as shop:
        shop.add(made.files)
        for number, variant in enumerate(variants):
            if time.monotonic() - start > together:
                refused.append(f"{variant_words(variant)}: the time for POV-Ray was over after {together:g} s")
                continue
            try:
                judged.append((variant, _judged(shop, made, variant, rays, reference, unit, limit)))
            except ProgramError as error:
                refused.append(f"{variant_words(variant)}: {error.diagnostics[0].message}")
            if progress:
                progress(number + 1, 2 * len(variants))
        times = _timed(shop, made, scene, [variant for variant, _ in judged], limit, long)
    results = [
        PovResult(v.form, v.accuracy, v.gradient, judgement, *timed)
        for (v, judgement), timed in zip(judged, times, strict=True)
    ]
    return PovRay(version(), forms, results, tuple(refused))


def variant_words(variant: Variant | PovResult) -> str:
    """`isosurface, accuracy 1e-5, max_gradient x 0.5`."""
    parts = [variant.form]
    if variant.accuracy:
        parts.append(f"accuracy {variant.accuracy:.0e}")
    if variant.gradient:
        parts.append(f"max_gradient x {variant.gradient:g}")
    return ", ".join(parts)


def _height(scene: Scene, width: int) -> int:
    return max(round(width * scene.ir.height / scene.ir.width), 1)


def _variants(made: Document, quick: bool) -> Iterator[Variant]:
    kinds = set(made.forms.values())
    if "isosurface" in kinds:
        for times in _ACCURACIES[::2] if quick else _ACCURACIES:
            yield Variant("isosurface", made.accuracy * times, 1.0, _with_accuracy(made, times))
        yield Variant("isosurface", made.accuracy, 1.0, _unchanged)
        for share in _GRADIENTS[1:2] if quick else _GRADIENTS:
            yield Variant("isosurface", made.accuracy, share, _with_gradient(share))
    elif "blob" in kinds:
        yield Variant("blob, sturm", 0.0, 0.0, _unchanged)
        yield Variant("blob", 0.0, 0.0, lambda text: re.sub(r"(?m)^\s*sturm$\n", "", text))
    elif "primitives" in kinds:
        yield Variant("primitives", 0.0, 0.0, _unchanged)


def _unchanged(text: str) -> str:
    return text


def _unexposed(scene: Scene) -> Scene:
    """An exposure is a filter before the camera, which ends all rays at the quality that is timed."""
    return type(scene)(replace(scene.ir, tone=ir.Tone()))


def _with_accuracy(made: Document, times: float) -> Callable[[str], str]:
    value = f"accuracy {made.accuracy * made.unit * times:.6g}"
    return lambda text: re.sub(r"\baccuracy [\d.eE+-]+", value, text)


def _with_gradient(share: float) -> Callable[[str], str]:
    return lambda text: text.replace("max_gradient Steepest", f"max_gradient Steepest*{share:g}")


def _judged(
    shop: Workshop, made: Document, variant: Variant, rays: Rays, reference: Reference, unit: float, limit: float
) -> Judgement:
    from blobscript.povray.readback import answers

    told = answers(shop, replace(made, surfaces=variant.change(made.surfaces)), rays.origins, rays.directions, limit)
    status = np.where(told.hit, reference.kind, 0).astype(np.int8)
    found = _Found(status, told.t, told.hit, np.zeros(len(told.t), np.int32))
    return judge(found, reference, rays.picture, unit, variant.accuracy)


def _timed(
    shop: Workshop, made: Document, scene: Scene, variants: list[Variant], limit: float, long: float
) -> list[tuple[Timing, int]]:
    """In rounds over all variants, each with a picture of the width that its time allows."""

    def run(variant: Variant, width: int) -> float:
        size = (f"+W{width}", f"+H{_height(scene, width)}")
        options = ("+Opicture.png", *size, "-D", "-A", "-V", "+Q1", "+WT1")
        return _trace_seconds(shop.run(variant.change(made.text), options, limit, "picture").output)

    grown = [math.sqrt(long / max(run(variant, _LEAST_WIDTH), 1e-3)) for variant in variants]
    widths = [min(max(round(_LEAST_WIDTH * times), _LEAST_WIDTH), _WIDTH) for times in grown]
    seconds: list[list[float]] = [[] for _ in variants]
    for _ in range(REPEATS):
        for variant, width, mine in zip(variants, widths, seconds, strict=True):
            mine.append(run(variant, width))
    return [
        (summed_up(mine).per(width * _height(scene, width)), width) for width, mine in zip(widths, seconds, strict=True)
    ]


def _trace_seconds(output: str) -> float:
    """Processor seconds of the trace phase."""
    found = re.search(r"Trace Time:.*?with ([\d.]+) CPU-seconds", output, re.DOTALL)
    found = found or re.search(r"Trace Time:[^(]*\(([\d.]+) seconds\)", output)
    return float(found[1]) if found else float("nan")
