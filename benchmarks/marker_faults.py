"""Marker faults and flat patterns over many flights: how often the filter is relied on while it is wrong.

    python benchmarks/marker_faults.py faults --runs 1000
    python benchmarks/marker_faults.py flat --runs 500
    python benchmarks/marker_faults.py near --runs 100
    python benchmarks/marker_faults.py long --runs 1000
    python benchmarks/marker_faults.py built --runs 400
    python benchmarks/marker_faults.py healthy --runs 200

Flies what the tests fly a part of, with the same bounds; exit code 1 if one is missed.
"""

import argparse
import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import relnav
from relnav.simulation.as_built import markers_as_built
from relnav.simulation.marker_flight import simulate_flight

TESTS = Path(__file__).parents[1] / "tests" / "navigation" / "test_pose_honesty.py"
FLIGHTS = 40
"""Simulated once each, and flown with every fault."""


def faults(tests, runs, seed):
    """Starts and bursts: epochs in a row beyond 5 sigma and relied on; images after a fault until a state is."""
    mission, good = relnav.load_model("three_marker_vision"), True
    flights = [simulate_flight(mission, tests.FLIGHT, seed=seed + k) for k in range(min(FLIGHTS, runs))]
    each = max(1, -(-runs // len(tests.KINDS)))
    for name, spoil in tests.KINDS.items():
        flown = [
            tests.through_fault(mission, flights[run % len(flights)], spoil, seed + run)[:2] for run in range(each)
        ]
        wrong, waits = np.array(flown).T
        good &= bool(wrong.max() <= 3 and waits.max() <= 10)
        bad = np.flatnonzero((wrong > 3) | (waits > 10))
        print(
            f"{name:<36} {each} runs: relied on beyond 5 sigma at most {wrong.max()} epochs [0, 3], "
            f"after the fault {waits.max()} images to a state [1, 10], in {np.sum(waits == waits.max())} of them; "
            f"{len(bad)} runs missed" + (f", seeds {(seed + bad[:8]).tolist()}" if len(bad) else ""),
            flush=True,
        )
    return good


def flat(tests, runs, seed):
    """Flat patterns from 10 m to 5 m at 4 Hz."""
    return patterns(tests, tests.FLAT, tests.FLAT.duration_s, runs, seed)


def near(tests, runs, seed):
    """The same from 6 m to 1.2 m, where it becomes unambiguous."""
    return patterns(tests, tests.FLAT_NEAR, 20.0, runs, seed)


def long(tests, runs, seed):
    """The same from 8 m to 2 m in 200 s."""
    return patterns(tests, tests.FLAT_LONG, tests.FLAT_LONG.duration_s, runs, seed)


def built(tests, runs, seed):
    """The same with spots of 0.03 px and all that is built within its tolerances, which are considered."""
    mission = relnav.load_model("three_marker_vision_flat", {"spot_noise_px": 0.03})
    mission = replace(mission, tolerances=replace(mission.tolerances, considered=True))
    return patterns(tests, tests.FLAT_LONG, tests.FLAT_LONG.duration_s, runs, seed, mission)


def healthy(tests, runs, seed):
    """Flights without a fault from 10 m to 4 m in 300 s: how much of them is relied on."""
    mission = relnav.load_model("three_marker_vision")
    flown = [tests.healthy_flight(mission, tests.HEALTHY, seed + run) for run in range(runs)]
    wrong, share, unsure_s = (np.array(column) for column in zip(*flown, strict=True))
    print(
        f"healthy: relied on for {share.mean():.3f} [0.95, 1] of the epochs, at least {share.min():.3f} of a flight's;"
    )
    print(f"  none relied on for {np.median(unsure_s):.1f} s in the median flight, {unsure_s.max():.1f} s at most;")
    print(f"  beyond 5 sigma and relied on for at most {wrong.max()} epochs [0, 3]")
    return bool(share.mean() >= 0.95 and wrong.max() <= 3)


def patterns(tests, approach, last_s, runs, seed, considering=None):
    """Flat patterns: flights that rely on a wrong pose, and shares of epochs; those relied on of the last seconds.

    considering: a mission that considers its tolerances; every flight then is of another one built within them.
    """
    mission = relnav.load_model("three_marker_vision_flat") if considering is None else considering
    seeds = range(seed, seed + runs)
    made = [None if considering is None else markers_as_built(mission, each) for each in seeds]
    flown = [tests.flat_flight(mission, approach, each, built=one) for each, one in zip(seeds, made, strict=True)]
    longest, wrong, relied = (np.array(column) for column in zip(*flown, strict=True))
    lost, bound = np.flatnonzero(longest > 3), max(1, runs // 500)
    share = relied[:, -round(last_s * approach.rate_hz) :].mean()
    print(f"flat pattern: wrong and relied on for more than 3 epochs in {len(lost)} of {runs} flights [0, {bound}]")
    print(f"  seeds {(seed + lost[:12]).tolist()}; relied on {share:.3f} of the epochs of the last {last_s:g} s")
    print(f"  wrong of the epochs relied on: {wrong.sum() / max(1, relied.sum()):.1e}")
    return len(lost) <= bound


KINDS = {"faults": faults, "flat": flat, "near": near, "long": long, "built": built, "healthy": healthy}


def main() -> int:
    """Fly."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=tuple(KINDS))
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=50000)
    options = parser.parse_args()
    spec = importlib.util.spec_from_file_location("honesty", TESTS)
    tests = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tests)
    return 0 if KINDS[options.what](tests, options.runs, options.seed) else 1


if __name__ == "__main__":
    sys.exit(main())
