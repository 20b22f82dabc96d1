"""Gyro samples that are wrong, and a star sensor that jumps: how soon the chaser's attitude is right again.

    python benchmarks/vehicle_gyro_glitch.py --runs 20

The shipped vehicle for 50 s at 10 m; what is wrong begins at 10 s, about an axis that is drawn once a run. Right: the
attitude's NEES stays below the chi-square of three that one in 10,000 exceeds. What the alarms mean: docs/vehicle.md,
Integrity. Exit code 1 if a run with a wrong gyro is not right at the end, or does not name the gyro; or one with a
wrong star sensor does not stay right. Rows in which no attitude sensor sees the fault are not judged.
"""

import argparse
import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

import relnav
from relnav.accuracy.rendezvous import checkpoint
from relnav.estimation.gating import chi_square_limit
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous

BEGINS_S, ENDS_S, NEVER = 10.0, 50.0, (0.0, 0.0)
FLIGHT = Rendezvous(start_m=10.0, final_m=8.0, fast_m_s=0.03, slow_m_s=0.03)
LIMIT = chi_square_limit(0.9999, 3)
BLIND = ("star", "sun_aps", "sun_birefringent")
FAULTS = {
    "nothing": ("", 0.0, 0.0, NEVER),
    "one sample off by 0.1 rad/s": ("gyro", 0.1, 0.0099, NEVER),
    "one sample off by 1 rad/s": ("gyro", 1.0, 0.0099, NEVER),
    "one sample off by 5 rad/s": ("gyro", 5.0, 0.0099, NEVER),
    "off by 0.0017 rad/s for 8 s": ("gyro", 0.0017, 8.0, NEVER),
    "off by 0.01 rad/s for 8 s": ("gyro", 0.01, 8.0, NEVER),
    "star sensor off by 1 mrad": ("star", 1e-3, 99.0, NEVER),
    "star sensor off by 5 mrad": ("star", 5e-3, 99.0, NEVER),
    "1 rad/s, star and suns blind": ("gyro", 1.0, 0.0099, (5.0, 30.0)),
}
"""What is wrong: by how much, rad/s or rad, for how long, s, and from when to when no star or sun is seen."""


def fly(vehicle, fault, seed):
    """Of a run: seconds until right, NEES/3 of the attitude and NEES/12 of the port at the end, the alarms."""
    wrong, size, lasts_s, (dark_s, light_s) = FAULTS[fault]
    run, axis = simulate_rendezvous(vehicle, FLIGHT, seed=seed), np.random.default_rng(seed).normal(size=3)
    turn = size * axis / np.linalg.norm(axis)
    nav, asked_s, right_s, nees = relnav.VehicleNavigator(vehicle), BEGINS_S + 0.5, BEGINS_S, 0.0
    for seen in run.observations:
        if seen.t_s > ENDS_S:
            break
        if seen.sensor in BLIND and dark_s <= seen.t_s < light_s:
            continue
        value = seen.value
        if seen.sensor == wrong and BEGINS_S <= seen.t_s < BEGINS_S + lasts_s:
            value = (
                value + turn if wrong == "gyro" else (Rotation.from_rotvec(turn) * Rotation.from_quat(value)).as_quat()
            )
        nav.observe(seen.sensor, seen.t_s, value)
        if seen.t_s >= asked_s:
            asked_s, now = asked_s + 0.5, nav.state()
            point, place = checkpoint(run, now), now.layout.by_name["chaser_attitude"]
            error = point.error[place]
            nees = float(error @ np.linalg.solve(now.covariance[place, place], error))
            right_s = now.t_s if nees > LIMIT else right_s
    port = float(point.port_error @ np.linalg.solve(now.port.covariance, point.port_error))
    return right_s - BEGINS_S, nees / 3.0, port / 12.0, now.first_alarm_s


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    runs, good = parser.parse_args().runs, True
    vehicle = relnav.load_model("rendezvous_demo")
    hand_over = dataclasses.replace(vehicle.hand_over, port_distance_m=(FLIGHT.start_m, 0.0, 0.0), position_sigma_m=0.1)
    vehicle = dataclasses.replace(vehicle, hand_over=hand_over)
    print(
        f"{runs} runs a row              right at the end  after, s: median  longest  NEES/3  port/12  gyro  star named"
    )
    for fault, (wrong, _, _, dark) in FAULTS.items():
        after, nees, port, named = zip(*(fly(vehicle, fault, seed) for seed in range(runs)), strict=True)
        right = sum(s < ENDS_S - BEGINS_S - 1.0 for s in after)
        gyro, star = (sum(name in one for one in named) for name in ("gyro", "star"))
        middle, longest = np.median(after), max(after)
        numbers = f"{right:9} {middle:20.1f} {longest:8.1f} {np.mean(nees):7.2f} {np.mean(port):8.2f} {gyro:5} {star:6}"
        print(f"{fault:30s}{numbers}", flush=True)
        if dark == NEVER:
            good &= right == runs and (wrong != "gyro" or gyro == runs) and (wrong != "star" or longest == 0.0)
    print("every goal is met" if good else "NOT every goal is met")
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
