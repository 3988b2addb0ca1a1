"""The campaigns of meshes of which the suite runs a share, to be run by hand:

    python tests/bench/mesh_campaigns.py closed    # 2 000 random scenes: closed, oriented, on the surface
    python tests/bench/mesh_campaigns.py balls     # ten times a thousand balls of half a cell: none is lost

Each prints what went wrong as it goes and a line of totals at the end; the exit code is 1 if anything did.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from mesh import campaigns


def closed(share: float) -> int:
    count, wrong = round(2000 * share), 0
    for seed in range(count):
        faults = campaigns.closed(seed)
        wrong += bool(faults)
        for fault in faults:
            print(fault, flush=True)
    print(f"{count} scenes, {wrong} with faults")
    return wrong


def balls(share: float) -> int:
    wrong = 0
    for seed in range(max(1, round(10 * share))):
        found, _ = campaigns.tiny_balls(seed, 1000)
        print(f"seed {seed}: {found} of 1000 balls")
        wrong += found != 1000
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaign", choices=("closed", "balls"))
    parser.add_argument("--share", type=float, default=1.0)
    given = parser.parse_args()
    return int({"closed": closed, "balls": balls}[given.campaign](given.share) > 0)


if __name__ == "__main__":
    sys.exit(main())
