"""Checks 100 000 scripts that nobody would write (tests/language/fuzzing.py), of which the suite checks a thousand:

    nice python tests/bench/fuzz.py                     # all of it, some 25 minutes
    nice python tests/bench/fuzz.py --share 0.01        # as the suite does
    nice python tests/bench/fuzz.py --first 1000000     # others

Prints each script that was treated badly (a traceback, no place, longer than 10 s, more than 1 GB) and a
table at the end; the exit code is 1 if there was one.
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
    start, told = time.perf_counter(), 0
    totals: Counter[str] = Counter()
    with Judge() as judge:
        for number in range(max(1, round(100_000 * arguments.share / _ROUND))):
            for name, count in campaign(judge, _ROUND, arguments.first + number * _ROUND):
                totals[name] += count
            for fault in judge.faults[told:]:
                print(fault, flush=True)
            told = len(judge.faults)
    print(", ".join(f"{name} {count}" for name, count in totals.items()))
    codes = ", ".join(f"{code}: {count}" for code, count in sorted(judge.codes.items()))
    print(f"{judge.count} scripts, exit codes {codes}; the longest took {judge.longest:.2f} s of processor time")
    print(f"{told} faults, {time.perf_counter() - start:.0f} s")
    return 1 if told else 0


if __name__ == "__main__":
    sys.exit(main())
