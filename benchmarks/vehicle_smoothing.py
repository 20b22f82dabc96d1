"""A vehicle's flights filtered and smoothed: errors at the docking port at some times, and whether both are honest.

    python benchmarks/vehicle_smoothing.py [--runs 50]

From 5.5 m to 4 m at 6 cm/s, truth as the vehicle file states it or (--of-its-own) with another orbit and target. Root
mean square over axes and runs, in brackets what is reported; NEES over twelve with its 99.99 % band.
"""

import argparse
import dataclasses

import numpy as np

import relnav
from relnav.accuracy.rendezvous import checkpoint
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.smoothing import VehicleSmoother

TIMES_S = (2.0, 8.0, 15.0, 22.0)
OF = (("velocity, mm/s", slice(3, 6), 1e3), ("attitude, deg", slice(6, 9), np.degrees(1.0)))


def flown(vehicle, run):
    """Checkpoints at the times, filtered and smoothed."""
    nav, smoother, filtered, left = relnav.VehicleNavigator(vehicle), VehicleSmoother(vehicle), [], list(TIMES_S)
    for seen in sorted(run.observations, key=lambda observation: observation.t_s):
        while left and seen.t_s >= left[0]:
            filtered.append(checkpoint(run, nav.state(left.pop(0))))
        nav.observe(seen.sensor, seen.t_s, seen.value)
        smoother.observe(seen.sensor, seen.t_s, seen.value)
    return filtered, [checkpoint(run, estimate) for estimate in smoother.estimates(TIMES_S)]


def line(points):
    """What one method reaches at one time."""
    words = []
    for name, part, scale in OF:
        error = np.sqrt(np.mean([point.port_error[part] ** 2 for point in points])) * scale
        said = np.sqrt(np.mean([np.diagonal(point.port_covariance)[part] for point in points])) * scale
        words.append(f"{name} {error:.3g} ({said:.3g})")
    nees = [point.port_error @ np.linalg.solve(point.port_covariance, point.port_error) for point in points]
    return "   ".join([*words, f"NEES/12 {np.mean(nees) / 12.0:.2f}"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--of-its-own", action="store_true")
    given = parser.parse_args()
    vehicle = relnav.load_model("rendezvous_demo")
    near = dataclasses.replace(vehicle.hand_over, port_distance_m=(5.5, 0.0, 0.0), position_sigma_m=0.1)
    vehicle = dataclasses.replace(vehicle, hand_over=near)
    flight = Rendezvous(start_m=5.5, final_m=4.0, slow_m_s=0.06, as_believed=not given.of_its_own)
    both = [flown(vehicle, simulate_rendezvous(vehicle, flight, seed=500 + k)) for k in range(given.runs)]
    low, high = chi_square_interval(12 * given.runs, 0.9999)
    print(f"{given.runs} runs; NEES/12 within {low:.2f} to {high:.2f}")
    for k, t_s in enumerate(TIMES_S):
        for column, name in enumerate(("filtered", "smoothed")):
            print(f"  {t_s:4g} s {name}: {line([pair[column][k] for pair in both])}")


if __name__ == "__main__":
    main()
