"""What a report says about itself: scene, machine, versions, rays."""

from __future__ import annotations

import os
import platform
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from blobscript import __version__
from blobscript.backends.library import load
from blobscript.reporting.rays import Rays
from blobscript.reporting.reference import Reference

if TYPE_CHECKING:
    from blobscript.scene import Scene

__all__ = ["Header", "Machine", "make_header", "this_machine"]


@dataclass(frozen=True, slots=True)
class Machine:
    """compiler: of the tracer's library; instructions: the set it runs with here."""

    processor: str
    cores: int
    system: str
    python: str
    numpy: str
    blobscript: str
    compiler: str
    instructions: str


@dataclass(frozen=True, slots=True)
class Header:
    """unit: the mean reach, in scene units."""

    script: str
    parameters: str
    scene_hash: str
    date: str
    surfaces: int
    elements: int
    unit: float
    seed: int
    picture_rays: int
    grazing_rays: int
    width: int
    height: int
    hits: int
    touches: int
    undecided: int
    unstable: int
    rays_hash: str
    reference_hash: str
    threads: int
    repeats: int
    machine: Machine


def this_machine() -> Machine:
    library = load()
    return Machine(
        processor=_processor(),
        cores=os.cpu_count() or 1,
        system=f"{platform.system()} {platform.release()}",
        python=platform.python_version(),
        numpy=np.__version__,
        blobscript=__version__,
        compiler=_compiler(Path(library._name)),
        instructions=library.blob_isa().decode(),
    )


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    found = re.search(r"model name\s*:\s*(.+)", text)
    return found[1].strip() if found else platform.processor() or platform.machine()


def _compiler(path: Path) -> str:
    """As compilers write it into what they make."""
    try:
        data = path.read_bytes()
    except OSError:
        return "unknown"
    found = re.findall(rb"GCC: \([^)\0]*\) [\d.]+|clang version [\d.]+", data)
    return ", ".join(dict.fromkeys(f.decode("ascii", "replace") for f in found)) or "unknown"


def make_header(scene: Scene, script: str, rays: Rays, reference: Reference, unit: float, repeats: int) -> Header:
    from blobscript.ir import leaves
    from blobscript.notation import settings
    from blobscript.reporting.reference import TOUCH, UNDECIDED

    return Header(
        script=script,
        parameters=settings(scene.ir.params),
        scene_hash=scene.hash,
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        surfaces=len(scene.surfaces),
        elements=sum(leaf.count for surface in scene.ir.surfaces for leaf in leaves(surface.field)),
        unit=unit,
        seed=rays.seed,
        picture_rays=rays.picture,
        grazing_rays=len(rays) - rays.picture,
        width=rays.width,
        height=rays.height,
        hits=int(np.count_nonzero(reference.hit)),
        touches=int(np.count_nonzero(reference.status == TOUCH)),
        undecided=int(np.count_nonzero(reference.status == UNDECIDED)),
        unstable=int(np.count_nonzero(~reference.stable)),
        rays_hash=rays.digest,
        reference_hash=reference.digest,
        threads=1,
        repeats=repeats,
        machine=this_machine(),
    )
