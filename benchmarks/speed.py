"""How fast: relnav beside what a user writes with numpy or filterpy, same data, one process, answers checked first.

    python benchmarks/speed.py --out speed.json

Every figure is thread CPU time, minimum and median over interleaved rounds; only the ratios mean anything on another
machine. The problem: fixes of the three-beacon sensor (closed form exact for central projection, R from the analytic
Jacobian), Clohessy-Wiltshire prediction, update.
"""

import argparse
import dataclasses
import json
import statistics
import time
from pathlib import Path

import numpy as np
from peers.by_hand import ByHand, OnFilterpy

import relnav
from relnav.dynamics.clohessy_wiltshire import transition
from relnav.mission import ProcessNoise
from relnav.simulation.detector import Faults, image
from relnav.simulation.scenario import SimulatedLog

EPOCHS = 2000
PEER_EPOCHS = 300


def prepare():
    """A mission without control errors, and the images of a chaser that drifts in from 9 m."""
    model = relnav.load_model("three_beacon_psd")
    density = model.process_noise.acceleration_noise_density_m2_s3
    model = dataclasses.replace(model, process_noise=ProcessNoise(density))
    phi, x = transition(model.orbit.mean_motion_rad_s, 0.1), np.array([9.0, 0.2, -0.1, -0.01, 0.0, 0.0])
    truth = np.empty((EPOCHS, 6))
    for e in range(EPOCHS):
        truth[e], x = x, phi @ x
    spots = image(model, truth, Faults(), np.random.default_rng(1))
    return model, SimulatedLog(np.arange(EPOCHS) * 0.1, spots, np.zeros((EPOCHS, 3)), truth)


def check_answers(model, log):
    """Assert that all three compute the same: states within 1e-6 sigma over 300 epochs from one start."""
    solution = relnav.filter_epochs(model, log.t_s, log.spots_m, method="fix")
    start = 5
    x, covariance = solution.state[start], solution.covariance[start]
    hand = ByHand(model)
    phi, q = hand.transition(0.1)
    user = OnFilterpy(hand, x, covariance, phi, q)
    for e in range(start + 1, start + PEER_EPOCHS):
        x, covariance, nis = hand.step(x, covariance, phi, q, log.spots_m[e])
        theirs = user.step(log.spots_m[e])
        for name, state in (("numpy", x), ("filterpy", theirs)):
            worst = np.max(np.abs(state - solution.state[e]) / solution.sigma[e])
            assert worst < 1e-6, f"{name} differs by {worst:.1e} sigma at epoch {e}"
        assert abs(nis - solution.nis[e]) < 1e-6 * (1.0 + nis)
    return hand, phi, q, solution.state[start], solution.covariance[start], start


def contenders(model, log, hand, phi, q, x0, covariance0, start):
    """Name -> (epochs, function that filters that many)."""
    spots = log.spots_m[start + 1 :]

    def filterpy_user():
        user = OnFilterpy(hand, x0, covariance0, phi, q)
        for e in range(PEER_EPOCHS):
            user.step(spots[e])

    def numpy_user():
        x, covariance = x0, covariance0
        for e in range(PEER_EPOCHS):
            x, covariance, _ = hand.step(x, covariance, phi, q, spots[e])

    def per_epoch(method):
        def run():
            navigator = relnav.Navigator(model, method)
            step = navigator.step
            for t, z in zip(log.t_s.tolist(), log.spots_m, strict=True):
                step(t, z)

        return run

    def whole_log(method, smooth):
        def run():
            relnav.filter_epochs(model, log.t_s, log.spots_m, method=method, smooth=smooth)

        return run

    return {
        "filterpy user": (PEER_EPOCHS, filterpy_user),
        "numpy user": (PEER_EPOCHS, numpy_user),
        "relnav per epoch, fix": (EPOCHS, per_epoch("fix")),
        "relnav per epoch, spots": (EPOCHS, per_epoch("spots")),
        "relnav log, fix": (EPOCHS, whole_log("fix", False)),
        "relnav log, spots": (EPOCHS, whole_log("spots", False)),
        "relnav log smoothed, fix": (EPOCHS, whole_log("fix", True)),
    }


def main() -> None:
    """Check, measure, print, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    model, log = prepare()
    entries = contenders(model, log, *check_answers(model, log))
    for _, function in entries.values():
        function()
    times = {name: [] for name in entries}
    for _ in range(options.rounds):
        for name, (epochs, function) in entries.items():
            began = time.thread_time_ns()
            function()
            times[name].append((time.thread_time_ns() - began) / epochs / 1000.0)
    reference = times["filterpy user"]
    rows = []
    print(f"{'':<28}{'us per epoch, min':>18}{'median':>10}{'filterpy / it, min':>20}{'median':>10}")
    for name, values in times.items():
        low, middle = min(values), statistics.median(values)
        ratios = min(reference) / low, statistics.median(reference) / middle
        rows.append(
            {"name": name, "us_min": low, "us_median": middle, "ratio_min": ratios[0], "ratio_median": ratios[1]}
        )
        print(f"{name:<28}{low:>18.3f}{middle:>10.3f}{ratios[0]:>20.1f}{ratios[1]:>10.1f}")
    if options.out is not None:
        options.out.write_text(json.dumps({"rounds": options.rounds, "rows": rows}, indent=2) + "\n")


if __name__ == "__main__":
    main()
