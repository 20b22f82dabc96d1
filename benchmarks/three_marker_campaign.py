"""Whether the covariance of three-marker vision is honest: NEES and wrong roots over thousands of random views.

    python benchmarks/three_marker_campaign.py --runs 2000

For each layout and range: images with a value, mean NEES over 6, the largest NEES, and how many values lie on a wrong
root (NEES beyond 100). Exit code 1 unless every cell with enough values has mean NEES / 6 within 1 +- 0.1 (and what its
number of values leaves), and no value is on a wrong root. Cells with fewer than 100 values are listed as excluded.
"""

import argparse
import dataclasses
import sys

import numpy as np

import relnav
from relnav.accuracy.three_marker_trials import pose_trials

RANGES_M = (0.9, 1.5, 3.0, 7.0, 15.0, 30.0)
FIVE = ((0.0, 0.3, 0.3), (0.0, -0.3, 0.3), (0.0, -0.3, -0.3), (0.0, 0.3, -0.3), (0.3, 0.0, 0.0))
VERTEX = ((0.0, 0.26, 0.15), (0.0, -0.26, 0.15), (0.3, 0.0, -0.3))
LEAST_VALUES = 100
WRONG_ROOT = 100.0


def layouts():
    """Name -> model: one marker raised on the axis, a vertex raised, a square with a raised middle, a flat triangle."""
    raised = relnav.load_model("three_marker_vision")
    yield "T3, third marker raised on the axis", raised
    for name, positions in (("T3 with a vertex raised", VERTEX), ("T5, square and raised middle", FIVE)):
        yield name, dataclasses.replace(raised, markers=dataclasses.replace(raised.markers, positions_m=positions))
    yield "flat triangle", relnav.load_model("three_marker_vision_flat")


def main() -> int:
    """Try, count, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args()
    honest = True
    print(f"{'layout':<38}{'range m':>8}{'values':>8}{'NEES/6':>9}{'largest':>9}{'wrong':>7}")
    for name, model in layouts():
        for range_m in RANGES_M:
            trials = pose_trials(model, range_m, options.runs, options.seed)
            count = int(trials.ok.sum())
            if count < LEAST_VALUES:
                print(f"{name:<38}{range_m:>8g}{count:>8}   excluded: ambiguous or singular")
                continue
            mean, wrong = np.nanmean(trials.nees) / 6.0, int(np.nansum(trials.nees > WRONG_ROOT))
            allowed = 0.1 + 3.0 * np.sqrt(2.0 / (6.0 * count))
            honest &= abs(mean - 1.0) < allowed and wrong == 0
            print(f"{name:<38}{range_m:>8g}{count:>8}{mean:>9.3f}{np.nanmax(trials.nees):>9.1f}{wrong:>7}")
    print("honest in every cell" if honest else "NOT honest in every cell")
    return 0 if honest else 1


if __name__ == "__main__":
    sys.exit(main())
