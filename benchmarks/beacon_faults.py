"""Beacon faults on an approach from 9 m to 6 m: what the filter makes of them, and what the health report says.

    python benchmarks/beacon_faults.py [--runs 20]

One JSON line a fault: rms range and cross-track error over the flight after the fault began, mean NEES (6 is honest),
restarts, and how many runs named the fault (for "none": how many named anything).
"""

import argparse
import json

import numpy as np

import relnav
from relnav.accuracy.beacon_health import beacon_health, findings
from relnav.navigation.slots import filter_slots
from relnav.sensors.three_beacon.psd import currents_of_counts
from relnav.sensors.three_beacon.slots import read_slots
from relnav.simulation.beacon_faults import BeaconFault
from relnav.simulation.raw import simulate_raw
from relnav.simulation.trajectory import Approach

FROM_S = 40.0
FAULTS = {
    "none": ((), "beacon"),
    "A dead": ((BeaconFault("dead", 0, FROM_S),), "beacon A is dead"),
    "C dead": ((BeaconFault("dead", 2, FROM_S),), "beacon C is dead"),
    "A and B exchanged": ((BeaconFault("swapped", 0, FROM_S, other=1),), "beacons A and B look exchanged"),
    "B and C exchanged": ((BeaconFault("swapped", 1, FROM_S, other=2),), "beacons B and C look exchanged"),
    "B fading, 50 s": ((BeaconFault("fading", 1, FROM_S, time_constant_s=50.0),), "beacon B has lost"),
    "C glints, 1 in 20": ((BeaconFault("glint", 2, FROM_S, probability=0.05),), "beacon C has glints"),
    "C glints, 1 in 3": ((BeaconFault("glint", 2, FROM_S, probability=0.33),), "beacon C has glints"),
}


def flight(model, faults, seed):
    """Errors and NEES after the fault began, restarts, and the findings."""
    approach = Approach(duration_s=120.0, start_m=(9.0, 0.05, -0.05), final_range_m=6.0)
    log = simulate_raw(model, approach, seed, faults=faults)
    currents = currents_of_counts(model.detector, log.counts)
    size = model.sensor.detector_size_m
    slots = read_slots(model.detector, model.pulses, size, log.t_s, log.beacon, currents)
    track = filter_slots(model, slots, acceleration_m_s2=log.acceleration_m_s2, method="spots")
    late = (log.t_s > FROM_S) & np.isfinite(track.state).all(axis=1)
    error = (track.state - log.truth)[late]
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(track.covariance[late], error[..., None])[..., 0])
    said = findings(beacon_health(model, slots, track))
    lost = 1.0 - late.sum() / (log.t_s > FROM_S).sum()
    return error, nees, track.restarts, said, lost


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=20)
    options = parser.parse_args()
    model = relnav.load_model("three_beacon_psd")
    for name, (faults, said) in FAULTS.items():
        flights = [flight(model, faults, seed) for seed in range(options.runs)]
        error = np.concatenate([run[0] for run in flights])
        row = {
            "fault": name,
            "rms_range_mm": float(np.sqrt(np.mean(error[:, 0] ** 2)) * 1e3),
            "rms_cross_mm": float(np.sqrt(np.mean((error[:, 1:3] ** 2).sum(axis=1))) * 1e3),
            "worst_range_mm": float(np.abs(error[:, 0]).max() * 1e3),
            "nees": float(np.mean(np.concatenate([run[1] for run in flights]))),
            "restarts": sum(run[2] for run in flights),
            "without_a_state": float(np.mean([run[4] for run in flights])),
            "named": sum(any(said in finding for finding in run[3]) for run in flights),
            "runs": options.runs,
            "first_run_says": flights[0][3],
        }
        print(json.dumps(row))


if __name__ == "__main__":
    main()
