"""What becomes of an alarm while its fault stays: flights of the shipped vehicle with a fault, flown on to their end.

    python benchmarks/vehicle_after_alarm.py --runs 30

Seconds in which the port is off by more than its protection level; how many of them the last observations raise no
alarm (now), and none holds either (held); each with the number of runs. Alarm: share of all seconds with one, raised
and held. Healthy flights come first: what holding does to a false alarm shows there.
"""

import argparse
from dataclasses import replace

import numpy as np

import relnav
from relnav.accuracy.rendezvous import true_port
from relnav.accuracy.vehicle_fault_flights import FLIGHT
from relnav.simulation.vehicle_faults import VehicleFault, with_fault
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.alarms import contradicting

CASES = (
    (VehicleFault.NOTHING, "", 1.0),
    *((VehicleFault.CLOCK, "camera", size) for size in (1.0, 0.5, 0.25)),
    *((VehicleFault.RAMP, name, 1.0) for name in ("camera", "psd", "star")),
    *((fault, "thrust", 1.0) for fault in (VehicleFault.WEAK, VehicleFault.TURNED, VehicleFault.LEAK)),
)


def seconds(run, fault, name, size, seed):
    """Of every second: whether the port is beyond its level, an alarm is raised, and one holds; (n, 3)."""
    nav, second, rows = relnav.VehicleNavigator(run.truth.vehicle), 1, []
    for seen in with_fault(run, fault, name, np.random.default_rng(seed), size=size):
        nav.observe(seen.sensor, seen.t_s, seen.value)
        if second <= nav.newest_s < run.truth.end_s - 0.1:
            now = nav.state(float(second))
            missed = np.abs(true_port(run, now.t_s)[0][:3] - now.port.position_m)
            beyond = not now.ambiguous and bool((missed > now.port.protection_level_m()).any())
            rows.append((beyond, bool(contradicting(now.drifts, now.sensors)), bool(now.alarms)))
            second += 1
    return np.array(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--seed", type=int, default=900)
    given = parser.parse_args()
    vehicle = relnav.load_model("rendezvous_demo")
    start = replace(vehicle.hand_over, port_distance_m=(FLIGHT.start_m, 0.0, 0.0))
    vehicle, flown = replace(vehicle, hand_over=start), {case: [] for case in CASES}
    for seed in range(given.seed, given.seed + given.runs):
        run = simulate_rendezvous(vehicle, FLIGHT, seed=seed)
        for case in CASES:
            flown[case].append(seconds(run, *case, seed))
    print(f"{given.runs} runs a row         times  beyond, s  unsaid now  runs  unsaid, held  runs  alarm now  held")
    for (fault, name, size), runs in flown.items():
        beyond, now, held = np.concatenate(runs).T
        unsaid = [[int((one[:, 0] & ~one[:, k]).sum()) for one in runs] for k in (1, 2)]
        told = "".join(f"{sum(own):>12}{np.count_nonzero(own):>6}  " for own in unsaid)
        what = f"{fault.value} {name}".strip()
        print(f"{what:<28}{size:<5g}{beyond.sum():>9}{told}{now.mean():>9.2f}{held.mean():>6.2f}")


if __name__ == "__main__":
    main()
