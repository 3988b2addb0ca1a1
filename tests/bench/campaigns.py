"""The campaigns of which the suite runs a hundredth, to be run by hand:

    python tests/bench/campaigns.py oracle     # 10 000 rays against ball arithmetic; some 5 minutes
    python tests/bench/campaigns.py searches   # 10 000 000 rays by the three searches that miss nothing; 20 minutes
    python tests/bench/campaigns.py samples    # 1 000 000 rays, 60 samples of the field before each hit
    python tests/bench/campaigns.py starts     # 4 000 certified starts on a surface in each of four places, and on
                                               # trees of all skeletons
    python tests/bench/campaigns.py corrupt    # 100 000 packed scenes with random bytes changed, under sanitizers

Each prints what went wrong as it goes and a line of totals at the end; the exit code is 1 if anything did.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from tracer import campaigns, harness, test_secondary


def oracle(share: float) -> list[str]:
    total = campaigns.Tally()
    for seed in range(round(1000 * share)):
        make = campaigns.MAKERS[seed % len(campaigns.MAKERS)]
        tally = campaigns.against_oracle(seed // len(campaigns.MAKERS), 10, make, windows=seed % 2 == 1)
        total.add(tally)
        report(tally.faults)
    print(
        f"{total.rays} rays judged, {total.hits} hits, {total.unstable} not judged, conditioned error {total.worst:.3g}"
    )
    return total.faults


def searches(share: float) -> list[str]:
    total = campaigns.Tally()
    for seed in range(round(2000 * share)):
        tally = campaigns.against_each_other(seed // 2, 5000, campaigns.sum_of if seed % 2 else campaigns.scene_of)
        total.add(tally)
        report(tally.faults)
        if seed % 100 == 99:
            print(f"{total.rays} rays so far", flush=True)
    print(f"{total.rays} rays, {total.hits} hits, {total.unstable} where either answer is right")
    return total.faults


def samples(share: float) -> list[str]:
    total = campaigns.Tally()
    for seed in range(round(1000 * share)):
        tally = campaigns.against_samples(seed, 1000, samples=60)
        total.add(tally)
        report(tally.faults)
    print(f"{total.rays} rays, {total.hits} hits")
    return total.faults


def starts(share: float) -> list[str]:
    faults: list[str] = []
    for (scale, shift), name in zip(test_secondary.PLACES, test_secondary.IDS, strict=True):
        judged = 0
        for seed in range(round(160 * share)):
            found, count = test_secondary.certified_starts(np.random.default_rng([seed, 7]), scale, shift, 25)
            faults += [f"{name}, seed {seed}, {fault}" for fault in found]
            report(faults[-len(found) :] if found else [])
            judged += count
        print(f"{name}: {judged} starts judged")
    for make in campaigns.MAKERS:
        judged = 0
        for seed in range(round(60 * share)):
            found, count = test_secondary.starts_at_hits(*make(seed), 25)
            faults += [f"{make.__name__}, seed {seed}, {fault}" for fault in found]
            report(faults[-len(found) :] if found else [])
            judged += count
        print(f"{make.__name__}: {judged} starts judged")
    return faults


def corrupt(share: float) -> list[str]:
    faults: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        program = harness.build(Path(folder), sanitize=True)
        scenes = list(harness.scenes())
        each = round(100_000 * share / len(scenes))
        for name, scene in scenes:
            done = harness.run(program, Path(folder), scene, first=1, count=each, timeout=3600.0)
            print(f"{name}: {done.stdout.strip()}", flush=True)
            if done.returncode:
                faults.append(f"{name}: {done.stderr[-3000:]}")
                report(faults[-1:])
    return faults


def report(faults: list[str]) -> None:
    for fault in faults:
        print(fault, flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("name", choices=("oracle", "searches", "samples", "starts", "corrupt"))
    parser.add_argument("--share", type=float, default=1.0, help="part of the campaign to run")
    arguments = parser.parse_args()
    start = time.perf_counter()
    faults = globals()[arguments.name](arguments.share)
    print(f"{len(faults)} faults, {time.perf_counter() - start:.0f} s")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
