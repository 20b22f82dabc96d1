"""Is `fix` honest far away, and where does it end: NEES of a chaser that holds on the docking axis.

    python benchmarks/far_fix.py [--runs 600] [--rate 10] [--ranges 30 60 80 100 120 150 200 300]

The truth is that of the filter: white acceleration of its process noise, initial velocity from its prior. Each line
is one epoch of all runs: NEES per component with its 1-sigma, and the mean error of range, azimuth and elevation in
sigmas.
"""

import argparse

import numpy as np

import relnav
from relnav.accuracy.campaign import Way, run_campaign
from relnav.simulation.trajectory import Approach

TIMES_S = (5.0, 10.0, 20.0, 40.0, 100.0)


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=600)
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument(
        "--ranges", type=float, nargs="+", default=[30.0, 60.0, 80.0, 100.0, 120.0, 150.0, 200.0, 300.0]
    )
    asked = parser.parse_args()
    model, way = relnav.load_model("three_beacon_psd"), Way("fix")
    for range_m in asked.ranges:
        hold = Approach(
            duration_s=TIMES_S[-1],
            rate_hz=asked.rate,
            start_m=(range_m, 0.0, 0.0),
            final_range_m=range_m,
            assumed_noise=True,
            assumed_start=True,
        )
        outcome = run_campaign(model, hold, (way,), asked.runs, seed=11)[1][way]
        print(f"{range_m:g} m: {outcome.nis}")
        for t in TIMES_S:
            k = min(round(t * asked.rate), outcome.nees.shape[1] - 1)
            nees = outcome.nees[:, k] / 6.0
            started = np.isfinite(nees)
            if not started.any():
                print(f"  {t:5.0f} s: not started")
                continue
            off = (outcome.docking_error[:, k] / outcome.docking_sigma[:, k])[started].mean(axis=0)
            spread = nees[started].std() / started.sum() ** 0.5
            print(
                f"  {t:5.0f} s: {started.sum()} runs, NEES {nees[started].mean():.3f} +- {spread:.3f}, mean error "
                f"{off[0]:.2f}, {off[1]:.2f}, {off[2]:.2f} sigma"
            )


if __name__ == "__main__":
    main()
