"""Whole approaches of the shipped vehicle, in parallel: errors at the port by distance against their bars, and speed.

    python benchmarks/vehicle.py --runs 200 --workers 8

Figures are 3 x rms over runs, the largest axis; NEES over degrees of freedom, one point a run, with its 99.99 % band.
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import relnav
from relnav.accuracy.rendezvous import RANGES_M, Checkpoint, fly, groups_of, honesty, port_figures
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import layout_of

BARS = (
    ("port, mm", slice(0, 3), 1e3, 2.0),
    ("attitude, deg", slice(6, 9), np.degrees(1.0), 0.06),
    ("target rate, deg/s", slice(9, 12), np.degrees(1.0), 0.006),
    ("velocity, mm/s", slice(3, 6), 1e3, 0.15),
)
"""Name, which of the port's twelve, unit, and the bar at the last distance."""


def one(seed: int) -> tuple[list[Checkpoint], float, float]:
    vehicle = relnav.load_model("rendezvous_demo")
    run = simulate_rendezvous(vehicle, seed=seed)
    begin = time.process_time()
    points = fly(run)
    return points, time.process_time() - begin, run.truth.end_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1000)
    given = parser.parse_args()
    with ProcessPoolExecutor(given.workers) as pool:
        results = list(pool.map(one, range(given.seed, given.seed + given.runs)))
    vehicle = relnav.load_model("rendezvous_demo")
    places = layout_of(vehicle).by_name
    for k, range_m in enumerate(RANGES_M):
        points = [points[k] for points, _, _ in results]
        error, sigma = port_figures(points)
        print(f"at {range_m:g} m, {given.runs} runs")
        for name, part, scale, bar in BARS:
            reached, said = 3.0 * scale * error[part], 3.0 * scale * sigma[part]
            note = f"  (bar {bar:g})" if range_m == RANGES_M[-1] else ""
            print(f"  {name:<20} {np.round(reached, 4)}, says {np.round(said, 4)}{note}")
        for name, blocks in groups_of(vehicle).items():
            ratio, dof = honesty(points, places, blocks)
            low, high = chi_square_interval(dof, 0.9999)
            print(f"  NEES/n {name:<26} {ratio:5.2f}  [{low:.2f}, {high:.2f}]")
    spent = [1e3 * seconds / length for _, seconds, length in results]
    print(f"filter: {np.median(spent):.1f} ms of processor time for a second of flight, in order of time")


if __name__ == "__main__":
    main()
