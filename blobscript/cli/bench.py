"""`blobscript bench`: error against run time over many scenes, beside the peers that are installed."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from blobscript.cli.progress import Progress
from blobscript.cli.report import by_ending, check_report, stages
from blobscript.outputs import write_text

if TYPE_CHECKING:
    from blobscript.reporting.bench import Bench

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
    """Exit code 1 where a script has errors; the others are measured all the same."""
    if arguments.output:
        check_report(arguments.output)
    from blobscript.reporting.bench import bench_markdown, bench_sentences, make_bench

    bars: list[Progress] = []
    files = arguments.items or _examples()
    bench = make_bench(files, stages(bars), quick=arguments.quick, seed=arguments.seed, workers=arguments.threads)
    for bar in bars:
        bar.finish()
    if arguments.output:
        write_text(arguments.output, _text(bench, arguments.output))
        print("\n".join(bench_sentences(bench)))
        print(f"{arguments.output}: bench", file=sys.stderr)
    else:
        sys.stdout.write(bench_markdown(bench))
    for path, why in bench.failed:
        print(f"error: {path} is left out: {why}", file=sys.stderr)
    return 1 if bench.failed else 0


def _examples() -> list[str]:
    from blobscript.resources import folder

    return [str(path) for path in sorted(folder("examples").glob("*.blob"))]


def _text(bench: Bench, path: str) -> str:
    from blobscript.reporting import bench as forms

    return by_ending(
        path,
        json=lambda: forms.bench_json(bench),
        markdown=lambda: forms.bench_markdown(bench),
        html=lambda: forms.bench_page(bench),
    )
