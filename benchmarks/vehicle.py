"""Whole approaches of the shipped vehicle, in parallel: errors at the port by distance against their bars, and speed.

    python benchmarks/vehicle.py --runs 200 --workers 8
    python benchmarks/vehicle.py --speed

Figures are 3 x rms over runs, the largest axis; NEES over degrees of freedom, one point a run, with its 99.99 % band.
Speed is processor time a second of flight, in which some 127 observations come: the median over pieces of ten seconds,
and the least, in order of time and in the order of arrival.
"""

import argparse
import operator
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import relnav
from relnav.accuracy.rendezvous import RANGES_M, Checkpoint, fly, groups_of, honesty, port_figures
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.vehicle_sensors import Observation, simulate_rendezvous
from relnav.spacecraft import Vehicle
from relnav.vehicle.layout import layout_of

BARS = (
    ("port, mm", slice(0, 3), 1e3, 2.0),
    ("attitude, deg", slice(6, 9), np.degrees(1.0), 0.06),
    ("target rate, deg/s", slice(9, 12), np.degrees(1.0), 0.006),
    ("velocity, mm/s", slice(3, 6), 1e3, 0.15),
)
"""Name, which of the port's twelve, unit, and the goal at the last distance."""


PIECE_S = 10.0
"""Of the flight, timed together."""


def one(seed: int) -> list[Checkpoint]:
    return fly(simulate_rendezvous(relnav.load_model("rendezvous_demo"), seed=seed))


def tell_speed(seed: int) -> None:
    vehicle = relnav.load_model("rendezvous_demo")
    run = simulate_rendezvous(vehicle, seed=seed)
    begin = time.process_time()
    nav = relnav.VehicleNavigator(vehicle)
    for seen in run.observations[:500]:
        nav.observe(seen.sensor, seen.t_s, seen.value)
    print(f"to compile, if there is anything: {time.process_time() - begin:.1f} s of processor time")
    for monitor in (True, False):
        for order, comes in (("time", "t_s"), ("arrival", "arrives_s")):
            spent = ms_a_second(vehicle, sorted(run.observations, key=operator.attrgetter(comes)), comes, monitor)
            both = "both filters" if monitor else "one filter"
            print(
                f"in order of {order}, {both}: {np.median(spent):.2f} ms of processor time "
                f"for a second of flight, {min(spent):.2f} at the least"
            )


def ms_a_second(vehicle: Vehicle, observations: list[Observation], comes: str, monitor: bool) -> list[float]:
    """Processor time of each piece of a flight over its length."""
    nav, spent, ends, begin = relnav.VehicleNavigator(vehicle, monitor=monitor), [], PIECE_S, time.process_time()
    for seen in observations:
        if getattr(seen, comes) >= ends:
            spent.append(1e3 * (time.process_time() - begin) / PIECE_S)
            ends, begin = ends + PIECE_S, time.process_time()
        nav.observe(seen.sensor, seen.t_s, seen.value)
    return spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--speed", action="store_true", help="speed alone, of one flight")
    given = parser.parse_args()
    if given.speed:
        tell_speed(given.seed)
        return
    with ProcessPoolExecutor(given.workers) as pool:
        flights = list(pool.map(one, range(given.seed, given.seed + given.runs)))
    vehicle = relnav.load_model("rendezvous_demo")
    places = layout_of(vehicle).by_name
    for k, range_m in enumerate(RANGES_M):
        points = [flight[k] for flight in flights]
        error, sigma = port_figures(points)
        print(f"at {range_m:g} m, {given.runs} runs")
        for name, part, scale, bar in BARS:
            reached, said = 3.0 * scale * error[part], 3.0 * scale * sigma[part]
            note = f"  (goal {bar:g})" if range_m == RANGES_M[-1] else ""
            print(f"  {name:<20} {np.round(reached, 4)}, says {np.round(said, 4)}{note}")
        for name, blocks in groups_of(vehicle).items():
            ratio, dof = honesty(points, places, blocks)
            low, high = chi_square_interval(dof, 0.9999)
            print(f"  NEES/n {name:<26} {ratio:5.2f}  [{low:.2f}, {high:.2f}]")
    tell_speed(given.seed)


if __name__ == "__main__":
    main()
