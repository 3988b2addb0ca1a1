"""Certified first hits of the report's rays: every one by interval branch and bound in ball arithmetic.

Slow in Python, so the rays are shared out over processes. Before a ray is searched, elements of bounded reach
that its line does not come near are left out: they are 0 all along it, exactly.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import pickle
import signal
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blobscript import ir, kernels
from blobscript.conditioning import tolerance
from blobscript.diagnostics import MissingError
from blobscript.interruption import held
from blobscript.plots.elements import Ray
from blobscript.reporting.rays import Rays

__all__ = ["HIT", "MISS", "TOUCH", "UNDECIDED", "Reference", "certify"]

Array = NDArray[np.float64]

#: Contact without a crossing: TOUCH. The budget of the proof ran out: UNDECIDED.
MISS, HIT, TOUCH, UNDECIDED = range(4)
_KINDS = {"": 0, "enter": 1, "exit": 2}
_STATUS = {"miss": MISS, "hit": HIT, "touch": TOUCH}
#: Rays per task, and from how many on processes are worth their start.
_TASK = 64
_FEW = 400


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Of n rays: status; t as the sum of two doubles (inf unless HIT); kind 0, 1 enter, 2 exit; surface or -1;
    tolerance: the conditioned error (NaN unless HIT), see `blobscript.conditioning`.

    stable: a tracer in double precision has to agree; not so for touches and where F stays within rounding."""

    status: NDArray[np.int8]
    t: Array
    t_low: Array
    kind: NDArray[np.int8]
    surface: NDArray[np.int32]
    tolerance: Array
    stable: NDArray[np.bool_]

    @property
    def hit(self) -> NDArray[np.bool_]:
        return self.status == HIT

    def part(self, rows: NDArray[np.int64]) -> Reference:
        """Of some of the rays."""
        return Reference(
            self.status[rows],
            self.t[rows],
            self.t_low[rows],
            self.kind[rows],
            self.surface[rows],
            self.tolerance[rows],
            self.stable[rows],
        )

    @property
    def digest(self) -> str:
        return hashlib.sha256(self.status.tobytes() + self.t.astype("<f8").tobytes()).hexdigest()

    def error(self, t: Array) -> Array:
        """|t - exact|; inf where there is no exact hit."""
        with np.errstate(invalid="ignore"):
            return np.where(self.hit, np.abs((t - self.t) - self.t_low), np.inf)


Row = tuple[int, float, float, int, int, bool]


def certify(
    scene: ir.Scene, rays: Rays, workers: int | None = None, progress: Callable[[int, int], None] | None = None
) -> Reference:
    """All rays; grazing ones are also tried with thresholds shifted by rounding. Raises MissingError without flint."""
    try:
        import flint  # noqa: F401  # pyright: ignore[reportUnusedImport]
    except ImportError as error:
        raise MissingError(
            "certified references need python-flint, which is not installed\n  = help: pip install 'blobscript[report]'"
        ) from error
    rows: list[Row] = [(MISS, np.inf, 0.0, 0, -1, True)] * len(rays)
    done = 0
    for first, found in _all_tasks(scene, rays, workers or os.cpu_count() or 1):
        rows[first : first + len(found)] = found
        done += len(found)
        if progress:
            progress(done, len(rays))
    status, t, t_low, kind, surface, stable = (np.array(column) for column in zip(*rows, strict=True))
    reference = Reference(
        status.astype(np.int8),
        t.astype(np.float64),
        t_low.astype(np.float64),
        kind.astype(np.int8),
        surface.astype(np.int32),
        np.full(len(rays), np.nan),
        stable.astype(np.bool_),
    )
    return replace(reference, tolerance=_tolerances(scene, rays, reference))


def _all_tasks(scene: ir.Scene, rays: Rays, workers: int) -> Iterator[tuple[int, list[Row]]]:
    firsts = list(range(0, len(rays), _TASK))
    if workers == 1 or len(rays) < _FEW:
        for first in firsts:
            yield first, _task(scene, rays, first)
        return
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with tempfile.TemporaryDirectory(prefix="blobscript-") as folder:
        shared = Path(folder) / "shared.pickle"
        shared.write_bytes(pickle.dumps((scene, rays)))
        with ProcessPoolExecutor(workers, context, _begin, (shared,)) as pool:
            try:
                with held():
                    futures = {pool.submit(_work, first): first for first in firsts}
                for future in as_completed(futures):
                    yield futures[future], future.result()
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                for worker in set(multiprocessing.active_children()) - others:
                    worker.kill()  # a task may take seconds
                raise


_given: tuple[ir.Scene, Rays] | None = None


def _begin(shared: Path) -> None:
    """In a new process: what its tasks share, from a file, as a pipe would make the parent wait until this process is
    there. Ctrl-C is the parent's business."""
    global _given
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _given = pickle.loads(shared.read_bytes())


def _work(first: int) -> list[Row]:
    assert _given is not None
    return _task(*_given, first)


def _task(scene: ir.Scene, rays: Rays, first: int) -> list[Row]:
    last = min(first + _TASK, len(rays))
    return [_certified(scene, rays.origins[i], rays.directions[i], i >= rays.picture) for i in range(first, last)]


def _certified(scene: ir.Scene, origin: Array, direction: Array, grazing: bool) -> Row:
    from flint import arb, ctx

    from blobscript.certified import PRECISION, UndecidedError, certain_hit, first_hit

    near = _near(scene, Ray(origin, direction))
    try:
        answer = (certain_hit if grazing else first_hit)(near, origin, direction)
    except UndecidedError:
        return UNDECIDED, np.inf, 0.0, 0, -1, False
    if answer.t is None:
        return _STATUS[answer.status], np.inf, 0.0, 0, -1, answer.stable and answer.status == "miss"
    before, ctx.prec = ctx.prec, PRECISION
    try:
        t = answer.distance
        low = float((answer.t - arb(t)).mid())
    finally:
        ctx.prec = before
    return HIT, t, low, _KINDS[answer.kind], answer.surface, answer.stable


def _near(scene: ir.Scene, ray: Ray) -> ir.Scene:
    """Without the elements of bounded reach that the line stays away from."""
    return replace(scene, surfaces=tuple(replace(s, field=_pruned(s.field, ray)) for s in scene.surfaces))


def _pruned(tree: ir.Field, ray: Ray) -> ir.Field:
    if isinstance(tree, ir.Node):
        return replace(tree, children=tuple(_pruned(child, ray) for child in tree.children))
    if not isinstance(tree.skeleton, ir.Points | ir.Lines) or not np.isfinite(kernels.support(tree.kernel)):
        return tree
    from blobscript.plots.elements import near_line

    kept = np.flatnonzero(near_line(tree, ray, tree.reach))
    if len(kept) == tree.count:
        return tree
    if len(kept) == 0:
        return ir.Node("sum", ())
    return replace(
        tree,
        skeleton=_part(tree.skeleton, kept),
        reach=tree.reach[kept],
        weight=tree.weight[kept],
        paint=tree.paint[kept],
        origin=tree.origin[kept],
    )


def _part(skeleton: ir.Points | ir.Lines, kept: NDArray[np.int64]) -> ir.Points | ir.Lines:
    if isinstance(skeleton, ir.Points):
        return ir.Points(skeleton.at[kept])
    return ir.Lines(skeleton.a[kept], skeleton.b[kept])


def _tolerances(scene: ir.Scene, rays: Rays, reference: Reference) -> Array:
    result = np.full(len(rays), np.nan)
    for number, surface in enumerate(scene.surfaces):
        rows = np.flatnonzero(reference.hit & (reference.surface == number))
        if len(rows):
            result[rows] = tolerance(surface, rays.origins[rows], rays.directions[rows], reference.t[rows])
    return result
