"""Kernel x skeleton x node x transformation x sign of weight, all of it, against POV-Ray by `trace()`:

    python tests/bench/pov_campaign.py            # 2 730 cases of 60 rays
    python tests/bench/pov_campaign.py --share 0.1

Prints where either is off as it goes, by the certified reference, and a line of totals; exit code 1 if we are anywhere,
or POV-Ray on more than one ray in ten thousand.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from povray import product

#: Cases in one run of POV-Ray.
_BATCH = 30


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--share", type=float, default=1.0)
    parser.add_argument("--rays", type=int, default=60)
    arguments = parser.parse_args()
    count = max(1, round(arguments.share * len(product.PRODUCT)))
    chosen = np.random.default_rng(2).permutation(len(product.PRODUCT))[:count].tolist()
    rays = hits = theirs = ours = 0
    for start in range(0, count, _BATCH):
        found = product.compared(chosen[start : start + _BATCH], arguments.rays)
        rays, hits = rays + found.rays, hits + found.hits
        theirs, ours = theirs + len(found.theirs), ours + len(found.ours)
        for text in found.theirs:
            print(f"POV-Ray is off: {text}", flush=True)
        for text in found.ours:
            print(f"we are off: {text}", flush=True)
    print(f"{count} cases, {rays} rays, {hits} hits: POV-Ray is off on {theirs}, we on {ours}")
    return int(ours > 0 or theirs > 1e-4 * rays)


if __name__ == "__main__":
    sys.exit(main())
