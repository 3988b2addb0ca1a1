"""`blobscript animate`: a script in, a film out."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from blobscript.cli.options import UsageError
from blobscript.cli.program import given_parameters, read_script, report_diagnostics
from blobscript.cli.progress import Progress
from blobscript.cli.render import light_options

if TYPE_CHECKING:
    from blobscript.film import Film, FrameFolder, Look, Moment

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    """Frames that an earlier run left are taken if they are what this one would make."""
    from blobscript.film import Film, FrameFolder

    film = Film(read_script(arguments.file), given_parameters(arguments), arguments.budget)
    report_diagnostics(film.diagnostics, "text")
    told = len(film.diagnostics)
    look = _look(film, arguments)
    moments = _chosen(film.moments, arguments)
    output = Path(arguments.output)
    start = time.perf_counter()
    _check_before(output, look, arguments)
    folder = FrameFolder(output)
    folder.create()
    made = _shoot(film, moments, look, folder)
    report_diagnostics(film.diagnostics[told:], "text")
    if arguments.shard is None:
        _join(output, folder, moments, film.animate.fps, arguments.keep)
    _report(arguments, output, folder, moments, made, time.perf_counter() - start)
    return 0


def _look(film: Film, arguments: argparse.Namespace) -> Look:
    from blobscript.film import Look

    width, height = arguments.size or (film.first.width, film.first.height)
    if arguments.shutter is not None and arguments.blur == 1:
        raise UsageError("--shutter has no effect without motion blur\n  = help: --blur 8")
    return Look(
        width,
        height,
        **light_options(arguments, film.first.tone),
        seed=arguments.seed,
        blur=arguments.blur,
        shutter=0.5 if arguments.shutter is None else arguments.shutter,
        threads=arguments.threads,
    )


def _chosen(moments: Sequence[Moment], arguments: argparse.Namespace) -> list[Moment]:
    first, last = arguments.frames or (0, len(moments) - 1)
    if last >= len(moments):
        raise UsageError(f"--frames {first}..{last}: the film has the frames 0..{len(moments) - 1}")
    part, parts = arguments.shard or (1, 1)
    return [moment for moment in moments[first : last + 1] if (moment.number - first) % parts == part - 1]


def _check_before(output: Path, look: Look, arguments: argparse.Namespace) -> None:
    from blobscript.film import check_film

    check_film(output, look.width, look.height)
    if arguments.shard is not None and arguments.keep:
        raise UsageError("--keep has no effect with --shard: the frames of a part are always kept")


def _shoot(film: Film, moments: Sequence[Moment], look: Look, folder: FrameFolder) -> int:
    """Renders the frames that are not there yet; returns how many."""
    progress = Progress("filming")
    finished = made = 0
    try:
        for moment in moments:
            frame = film.frame(moment, look)
            key = frame.key()
            if not folder.has(moment.number, key):

                def part(share: float, so_far: int = finished) -> None:
                    progress(round(1000 * (so_far + share)), 1000 * len(moments))

                folder.put(moment.number, key, frame.picture(part))
                made += 1
            finished += 1
    except BaseException:
        progress.finish()
        folder.remove([])
        if finished:
            kept = f"{finished} of {len(moments)} frames are in {folder.path}"
            print(f"{kept}: the same command goes on there", file=sys.stderr)
        raise
    progress.finish()
    return made


def _join(output: Path, folder: FrameFolder, moments: Sequence[Moment], fps: float, keep: bool) -> None:
    from blobscript.film import join
    from blobscript.film.joining import tempo_note

    progress = Progress("joining")
    numbers = [moment.number for moment in moments]
    join(output, [folder.file(k) for k in numbers], fps, lambda done: progress(done, len(numbers)))
    progress.finish()
    if note := tempo_note(output, fps):
        print(f"note: {note}", file=sys.stderr)
    if not keep:
        folder.remove(numbers)


def _report(
    arguments: argparse.Namespace,
    output: Path,
    folder: FrameFolder,
    moments: Sequence[Moment],
    made: int,
    seconds: float,
) -> None:
    whole = arguments.shard is None
    if arguments.format == "json":
        facts = {"frames": len(moments), "rendered": made, "seconds": seconds}
        print(json.dumps({"diagnostics": [], "files": [str(output)] if whole else [], **facts}))
        return
    kept = f", {len(moments) - made} taken from an earlier run" if made < len(moments) else ""
    if whole:
        print(f"{output}: {len(moments)} frames in {seconds:.1f} s{kept}", file=sys.stderr)
    else:
        print(
            f"{folder.path}: {len(moments)} frames in {seconds:.1f} s{kept}\n"
            "  = help: when all parts are there, the same command without --shard joins them",
            file=sys.stderr,
        )
