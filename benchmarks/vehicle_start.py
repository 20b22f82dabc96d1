"""Starts of a vehicle that does not know how the target is turned: how long they take, how often they end wrong.

    python benchmarks/vehicle_start.py --runs 100

The target is rolled about its port's axis by an angle drawn from all, target and chaser tilted by up to 30 deg about
both other axes; the vehicle file says 180 deg, 1-sigma. Three sets of sensors, from 30 and from 10 m. Wrong: chi-square
of the attitude found is beyond what one in a million exceeds. Time: of the flight, until one explanation is left that
ten images agreed with. NEES is of the attitude then, over its three degrees of freedom.
"""

import argparse
import math

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import relnav
from relnav.accuracy.vehicle_start import rolled, search, turned_vehicle

SETS = {"camera, three lights": ("camera", "star"), "detector, six lights": ("psd", "star"), "all": None}
FROM_M = (30.0, 10.0)
WRONG = float(chi2.isf(1e-6, 3))
"""Chi-square of an attitude's error that one right attitude in a million exceeds."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    vehicle, wrong_ones = relnav.load_model("rendezvous_demo"), 0
    print("sensors                from   explanations  found       median  95 %     wrong  NEES/n")
    for start_m in FROM_M:
        flights = []
        for k in range(arguments.runs):
            rng = np.random.default_rng([arguments.seed, k])
            roll, tilt = rng.uniform(-math.pi, math.pi), rng.uniform(-math.radians(30), math.radians(30), 2)
            flights.append((roll, rolled(vehicle, start_m, roll, tilt, seed=arguments.seed * 100_000 + k)))
        for name, sensors in SETS.items():
            starts = []
            for roll, run in flights:
                back = Rotation.from_rotvec([-roll, 0.0, 0.0])
                told = turned_vehicle(run.truth.vehicle, back, sensors or tuple(vehicle.sensor), math.pi)
                starts.append(search(run, told))
            found = [one for one in starts if one.found_s == one.found_s]
            wrong = sum(one.nees > WRONG for one in found)
            wrong_ones += wrong
            times = np.array([one.found_s if one.found_s == one.found_s else math.inf for one in starts])
            middle, most = np.quantile(times, (0.5, 0.95), method="higher")
            mean = np.mean([one.nees for one in found]) / 3.0
            explained = max(one.most for one in starts)
            print(
                f"{name:22s} {start_m:4.0f} m {explained:6d} at most {len(found):4d} of {len(starts):<4d} "
                f"{middle:6.1f} s {most:6.1f} s {wrong:5d} {mean:7.2f}"
            )
    return 1 if wrong_ones else 0


if __name__ == "__main__":
    raise SystemExit(main())
