"""Random stress cases against certified answers: trees, kernels to a = 1e8, weights to 1e15, scales 1e-150 to 1e150.

    python tests/bench/stress_fuzz.py --first 0 --count 1000

Each prints a line where something is wrong, and at the end how many were right and how many refused. What teaches
something becomes a case of `blobscript stress`, or a seed in tests/stress/test_extremes.py.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from extremes import faults, random_case


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=1000)
    arguments = parser.parse_args()
    totals: Counter[str] = Counter()
    for seed in range(arguments.first, arguments.first + arguments.count):
        found = faults(random_case(seed))
        totals["refused" if found == ["refused"] else "wrong" if found else "right"] += 1
        if found and found != ["refused"]:
            print("\n".join(found), flush=True)
    print(", ".join(f"{count} {word}" for word, count in sorted(totals.items())))
    return 1 if totals["wrong"] else 0


if __name__ == "__main__":
    raise SystemExit(main())
