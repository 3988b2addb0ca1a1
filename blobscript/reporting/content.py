"""A whole report as data, and how it is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from blobscript.reporting.header import Header, make_header
from blobscript.reporting.indexes import IndexResult, measure_indexes
from blobscript.reporting.meshes import MeshResult, measure_meshes
from blobscript.reporting.normals import NormalResult, measure_normals
from blobscript.reporting.pov import PovRay, measure_povray
from blobscript.reporting.rays import Rays, make_rays, unit_of
from blobscript.reporting.reference import Reference, certify
from blobscript.reporting.sampling import Sampling, measure_sampling
from blobscript.reporting.searches import Result, measure_searches
from blobscript.reporting.timing import REPEATS

if TYPE_CHECKING:
    from blobscript.scene import Scene

__all__ = ["Report", "Stage", "make_report"]

#: Picture rays and grazing rays.
_RAYS, _QUICK_RAYS = (4000, 1000), (2700, 300)

#: stage(what) -> progress(done, total) of that part of the work.
Stage = Callable[[str], Callable[[int, int], None]]


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """povray: None where it is not installed."""

    scene: Scene
    quick: bool
    header: Header
    rays: Rays
    reference: Reference
    searches: list[Result]
    normals: list[NormalResult]
    indexes: list[IndexResult]
    meshes: list[MeshResult]
    sampling: Sampling
    povray: PovRay | None


def _silent(_what: str) -> Callable[[int, int], None]:
    return lambda _done, _total: None


def make_report(
    scene: Scene,
    script: str = "<scene>",
    *,
    quick: bool = False,
    seed: int = 0,
    count: tuple[int, int] | None = None,
    workers: int | None = None,
    povray: bool = True,
    stage: Stage = _silent,
) -> Report:
    """Measures everything; minutes, or with `quick` less than one for most scenes.

    povray: compare with POV-Ray where it is installed. count: picture and grazing rays, if not 4000 and 1000.
    workers: processes that certify (None: one per core);
    whatever is timed runs alone, on one thread."""
    rays = make_rays(scene, *(count or (_QUICK_RAYS if quick else _RAYS)), seed)
    reference = certify(scene.ir, rays, workers, stage("certifying"))
    unit = unit_of(scene.ir)
    return Report(
        scene,
        quick,
        make_header(scene, script, rays, reference, unit, REPEATS),
        rays,
        reference,
        measure_searches(scene, rays, reference, unit, quick, stage("searches")),
        measure_normals(scene, rays, reference, unit, quick, stage("normals")),
        measure_indexes(scene, rays, reference, unit, stage("indexes")),
        measure_meshes(scene, rays, reference, quick, stage("meshes")),
        measure_sampling(scene, quick, seed, stage("samples")),
        measure_povray(scene, rays, reference, unit, quick, stage("POV-Ray")) if povray else None,
    )
