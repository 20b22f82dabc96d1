"""The target-attitude filter: a thousand starts and bursts of outliers, and what a call costs.

    python benchmarks/target_attitude.py faults --runs 1000
    python benchmarks/target_attitude.py inertia --runs 200
    python benchmarks/target_attitude.py speed

`faults` flies what the tests fly a tenth of, with bounds; exit code 1 if one is missed. Then targets that turn faster
than was told. `inertia`: targets whose moments are off by what is stated, drawn once a run, at several rates, with
bounds too. `speed` is for information: the fastest of many batches, and the processor time of the first calls with
nothing compiled.
"""

import argparse
import importlib.util
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import relnav
from relnav.navigation.attitude.target_attitude import METHODS

TESTS = Path(__file__).parents[1] / "tests" / "navigation"
MOMENTS_OFF = (
    ((3000, 4200, 4700), 0.05, 0.5, 100.0, 0.1, 0.5),
    ((3000, 4200, 4700), 0.05, 2.0, 200.0, 0.1, 0.5),
    ((3000, 4200, 4700), 0.05, 5.0, 200.0, 0.1, 0.5),
    ((3000, 4200, 4700), 0.02, 2.0, 200.0, 0.1, 0.5),
    ((3000, 4200, 4700), 0.10, 1.0, 200.0, 0.1, 0.5),
    ((1000, 4000, 4200), 0.05, 2.0, 200.0, 0.1, 0.5),
    ((3000, 3100, 3200), 0.05, 2.0, 200.0, 0.1, 0.5),
    ((3000, 4200, 4700), 0.05, 3.0, 200.0, 0.5, 1.0),
    ((3000, 4200, 4700), 0.05, 5.0, 200.0, 0.5, 1.0),
    ((3000, 4200, 4700), 0.05, 3.0, 200.0, 1.0, 2.0),
    ((3000, 4200, 4700), 0.05, 5.0, 200.0, 1.0, 2.0),
)
"""Moments, by what share of them they are off, rate and duration of the flights of `inertia`, noise (deg), interval."""
INERTIA, N = np.diag([3000.0, 4200.0, 4700.0]), 1.1313666536110223e-3
NOISE = math.radians(0.5) ** 2 * np.eye(3)
COLD = """
import time
from benchmark import new_filter, np, NOISE
nav = new_filter({method!r})
begin = time.process_time()
for k in range(3):
    nav.step(0.1 * k, np.eye(3), NOISE)
print(time.process_time() - begin)
"""


def new_filter(method):
    return relnav.TargetAttitude(
        INERTIA, N, rate_noise_density_rad2_s3=1e-14, initial_rate_sigma_rad_s=2e-3, method=method
    )


def loaded(name: str):
    """A module of the tests."""
    spec = importlib.util.spec_from_file_location(name, TESTS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def flights():
    """What the tests fly with, and how bodies turn there."""
    return loaded("test_target_attitude_honesty"), loaded("conftest").tumbling_bodies


def faults(runs: int) -> bool:
    """Starts among outliers and bursts of them."""
    (tests, turning), good = flights(), True
    for method in METHODS:
        for rate_hz in (10.0, 1.0):
            worst, waits = tests.fly_through_faults(turning, method, runs, seed=11, rate_hz=rate_hz)
            met = worst.max() <= 3 and waits.max() <= 10
            good &= bool(met)
            print(
                f"{method:<15} {rate_hz:g} Hz, {runs} runs: relied on beyond 5 sigma at most {worst.max()} epochs "
                f"[0, 3]; after a fault at most {waits.max()} attitudes to a state [0, 10] "
                f"{'met' if met else 'NOT MET'}",
                flush=True,
            )
        for true_deg_s in (1.0, 2.0, 3.0, 5.0, 10.0):
            few = max(1, runs // 10)
            longest = [tests.longest_far_off(turning, method, true_deg_s, few, hz).max() for hz in (10.0, 1.0)]
            alone = tests.longest_far_off(turning, method, true_deg_s, few, 10.0, by_the_gate_alone=True).max()
            print(
                f"{method:<15} 0.2 deg/s told, {true_deg_s:g} true, {few} runs: relied on beyond "
                f"5 sigma at most {longest[0]} epochs at 10 Hz ({alone} by the gate alone), {longest[1]} at 1 Hz",
                flush=True,
            )
    return good


def inertia(runs: int) -> bool:
    """NEES where the stated sigmas of the moments are what is off: joint and by component, from 20 s on."""
    (tests, turning), good = flights(), True
    for moments, tolerance, deg_s, duration_s, noise_deg, every_s in MOMENTS_OFF:
        body = np.diag([float(moment) for moment in moments])
        by, joint = tests.nees_of_moments_off(
            turning, "multiplicative", runs, deg_s, duration_s, tolerance, body, noise_deg=noise_deg, every_s=every_s
        )
        met = by.max() <= 1.3 and 0.7 <= joint <= 1.3
        good &= bool(met)
        print(
            f"moments {moments} kg m^2, {100 * tolerance:g} % off, {deg_s:g} deg/s (1-sigma an axis), "
            f"{noise_deg:g} deg every {every_s:g} s, {duration_s:g} s, {runs} runs: "
            f"NEES by component {by.min():.2f} to {by.max():.2f} [0, 1.3], "
            f"joint NEES / 6 {joint:.2f} [0.7, 1.3] {'met' if met else 'NOT MET'}",
            flush=True,
        )
    _, joint = tests.nees_of_moments_off(turning, "multiplicative", runs, 2.0, 200.0, 0.05, second_order=False)
    print(f"  the second of these with the effect taken for linear: joint NEES / 6 {joint:.1f}")
    return good


def fastest_us(call, batches=200, calls=10):
    """Time of one call in the fastest batch."""
    best = math.inf
    for _ in range(batches):
        begin = time.perf_counter()
        for _ in range(calls):
            call()
        best = min(best, (time.perf_counter() - begin) / calls)
    return 1e6 * best


def speed() -> None:
    """A time step, a measured attitude, and the first calls of a fresh installation."""
    for method in METHODS:
        nav = new_filter(method)
        clock = [0.0]

        def measure(nav=nav, clock=clock):
            clock[0] += 0.01
            nav.step(clock[0], np.eye(3), NOISE)

        def predict(nav=nav, clock=clock):
            clock[0] += 0.001
            nav.step(clock[0])

        with_measurement, alone = fastest_us(measure), fastest_us(predict)
        with tempfile.TemporaryDirectory() as cache:
            code = COLD.format(method=method).replace("benchmark import", f"{Path(__file__).stem} import")
            here = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
            environment = os.environ | {"NUMBA_CACHE_DIR": cache, "PYTHONPATH": here}
            done = subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True)
        print(
            f"{method:<15} time step {alone:.1f} us, measured attitude {with_measurement:.1f} us, "
            f"first calls, nothing compiled: {float(done.stdout):.1f} s of processor time"
        )


def main() -> int:
    """Fly or time."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("faults", "inertia", "speed"))
    parser.add_argument("--runs", type=int, default=1000)
    options = parser.parse_args()
    if options.what == "speed":
        speed()
        return 0
    return 0 if {"faults": faults, "inertia": inertia}[options.what](options.runs) else 1


if __name__ == "__main__":
    sys.exit(main())
