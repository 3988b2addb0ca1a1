"""Checks 100 000 scripts that nobody would write (tests/language/fuzzing.py), of which the suite checks a thousand:

    nice python tests/bench/fuzz.py                     # all of it, some 25 minutes
    nice python tests/bench/fuzz.py --share 0.01        # as the suite does
    nice python tests/bench/fuzz.py --first 1000000     # others

Prints each script that was treated badly (a traceback, no place, longer than 10 s, more than 1 GB), a line
for each thousand, and a table at the end or when it is interrupted; the exit code is 1 if there was one.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from language.fuzzing import Judge, campaign

_ROUND = 1000


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--share", type=float, default=1.0, help="part of the campaign to run")
    parser.add_argument("--first", type=int, default=0, help="where the numbers of the scripts start")
    arguments = parser.parse_args()
    start = time.perf_counter()
    totals: Counter[str] = Counter()
    with Judge() as judge:
        try:
            run(judge, totals, max(1, round(100_000 * arguments.share / _ROUND)), arguments.first)
        except KeyboardInterrupt:
            print("interrupted")
    print(", ".join(f"{name} {count}" for name, count in totals.items()))
    codes = ", ".join(f"{code}: {count}" for code, count in sorted(judge.codes.items()))
    print(f"{judge.count} scripts, exit codes {codes}; the longest took {judge.longest:.2f} s of processor time")
    print(f"{len(judge.faults)} faults, {time.perf_counter() - start:.0f} s")
    return 1 if judge.faults else 0


def run(judge: Judge, totals: Counter[str], rounds: int, first: int) -> None:
    told = 0
    for number in range(rounds):
        for name, count in campaign(judge, _ROUND, first + number * _ROUND):
            totals[name] += count
        for fault in judge.faults[told:]:
            print(fault)
        told = len(judge.faults)
        print(f"{judge.count} scripts, {told} faults", flush=True)


if __name__ == "__main__":
    sys.exit(main())
