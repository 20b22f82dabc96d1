"""How fast: relnav beside what a user writes with numpy, filterpy and others, same data, one process, answers first.

    python benchmarks/speed.py --out speed.json          (a few minutes; needs the extra `bench` for all peers)
    python benchmarks/speed.py --short                   (what stays in memory alone)
    python benchmarks/speed.py --long                    (adds a log of 1e8 epochs, filtered and smoothed: an hour)

Every figure is thread CPU time (a call with its answer and files: process CPU time), minimum and median over
interleaved rounds; only the ratios mean anything on another machine. The problem: images of the three-beacon sensor;
closed form exact for central projection, R from the analytic Jacobian, Clohessy-Wiltshire prediction, update. relnav
also gates, computes NIS and stores everything.
"""

import argparse
import dataclasses
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import call_with_answer
import numpy as np
from call_with_answer import PEER_EPOCHS, START
from long_logs import PEAK, streaming
from peers import linear
from peers.by_hand import ByHand, OnFilterpy, OnKalmanPy, filterpy_smoother
from rounds import installed, measure, table

import relnav
from relnav.accuracy.campaign import noise_alone
from relnav.dynamics.clohessy_wiltshire import transition
from relnav.files.filter_file import filter_file
from relnav.files.simulated import write_log
from relnav.mission import ProcessNoise
from relnav.navigation.log import Epochs, LogFilter, controls
from relnav.navigation.smoothing import nothing_later
from relnav.sensors.three_beacon.calibrate import HIGHEST_ORDER
from relnav.sensors.three_beacon.calibration import Calibration, exponents
from relnav.simulation.detector import Faults, image
from relnav.simulation.scenario import SimulatedLog

EPOCHS = 2000
PACKAGE_OF = {"kalman_py": "kalman-py", "stonesoup": "Stone Soup", "cv2": "OpenCV", "kalman": "fast-kalman"}
FILE_EPOCHS = 200_000


def prepare(epochs=EPOCHS):
    """A mission without errors of control or attitude, as peers have it; images of a chaser that drifts in from 9 m."""
    model = noise_alone(relnav.load_model("three_beacon_psd"), "spots")
    density = model.process_noise.acceleration_noise_density_m2_s3
    model = dataclasses.replace(model, process_noise=ProcessNoise(density))
    phi, x = transition(model.orbit.mean_motion_rad_s, 0.1), np.array([9.0, 0.2, -0.1, -0.01, 0.0, 0.0])
    truth = np.empty((epochs, 6))
    for e in range(epochs):
        truth[e], x = x, phi @ x
    spots = image(model, truth, Faults(), np.random.default_rng(1))
    return model, SimulatedLog(np.arange(epochs) * 0.1, spots, np.zeros((epochs, 3)), truth)


class Problem:
    """Data, answers of relnav, and the peers ready to run."""

    def __init__(self):
        """Simulate, filter, and check every peer's answers: states within 1e-6 sigma over 300 epochs."""
        self.model, self.log = prepare()
        self.hand = ByHand(self.model)
        self.phi, self.q = self.hand.transition(0.1)
        self.solution = relnav.filter_epochs(self.model, self.log.t_s, self.log.spots_m, method="fix")
        self.x, self.covariance = self.solution.state[START], self.solution.covariance[START]
        self.images = list(self.log.spots_m)
        self.peer_images = self.images[START + 1 : START + 1 + PEER_EPOCHS]
        self.check()

    def check(self):
        """Assert that all compute the same."""
        users = {"filterpy": self.user(OnFilterpy)}
        if installed("kalman_py"):
            users["kalman-py"] = self.user(OnKalmanPy)
        x, covariance = self.x, self.covariance
        for k, spots in enumerate(self.peer_images):
            e = START + 1 + k
            x, covariance, nis = self.hand.step(x, covariance, self.phi, self.q, spots)
            for name, state in [("numpy", x)] + [(name, user.step(spots)) for name, user in users.items()]:
                worst = np.max(np.abs(state - self.solution.state[e]) / self.solution.sigma[e])
                assert worst < 1e-6, f"{name} differs by {worst:.1e} sigma at epoch {e}"
            assert abs(nis - self.solution.nis[e]) < 1e-6 * (1.0 + nis)

    def user(self, cls):
        """A peer's filter, started."""
        return cls(self.hand, self.x, self.covariance, self.phi, self.q)

    def peers(self):
        """Name -> (epochs, function that filters that many)."""

        def stepping(cls):
            def run():
                user = self.user(cls)
                for spots in self.peer_images:
                    user.step(spots)

            return run

        def by_hand():
            x, covariance = self.x, self.covariance
            for spots in self.peer_images:
                x, covariance, _ = self.hand.step(x, covariance, self.phi, self.q, spots)

        entries = {"filterpy user": (PEER_EPOCHS, stepping(OnFilterpy)), "numpy user": (PEER_EPOCHS, by_hand)}
        if installed("kalman_py"):
            entries["kalman-py user"] = (PEER_EPOCHS, stepping(OnKalmanPy))
        return entries

    def ours(self):
        """Name -> (epochs, function)."""

        def per_epoch(method):
            def run():
                step = relnav.Navigator(self.model, method).step
                for t, z in zip(times, self.images, strict=True):
                    step(t, z)

            return run

        def whole_log(method, smooth):
            def run():
                relnav.filter_epochs(self.model, self.log.t_s, self.log.spots_m, method=method, smooth=smooth)

            return run

        times = self.log.t_s.tolist()
        return {
            "relnav per epoch, fix": (EPOCHS, per_epoch("fix")),
            "relnav per epoch, spots": (EPOCHS, per_epoch("spots")),
            "relnav log, fix": (EPOCHS, whole_log("fix", False)),
            "relnav log, spots": (EPOCHS, whole_log("spots", False)),
            "relnav log smoothed, fix": (EPOCHS, whole_log("fix", True)),
        }

    def linear_peers(self):
        """Name -> (epochs, function): packages that only know linear filters, on positions with one R."""
        fixes = np.array([self.hand.dock.T @ self.hand.closed_form(z) for z in self.peer_images])
        h, r = np.eye(3, 6), 4e-4 * np.eye(3)
        arguments = (self.phi, self.q, h, r, self.x, self.covariance, fixes)
        expected = linear.numpy_filter(*arguments)
        found = {"pykalman": linear.pykalman_filter, "simdkalman": linear.simdkalman_filter}
        found |= {"kalman_py": linear.kalman_py_filter, "stonesoup": linear.stone_soup_filter}
        found |= {"cv2": linear.opencv_filter, "kalman": linear.fast_kalman_filter}
        entries = {}
        for package, function in found.items():
            if installed(package):
                assert np.max(np.abs(function(*arguments) - expected)) < 1e-9, package
                name = f"{PACKAGE_OF.get(package, package)}, linear, no closed form"
                entries[name] = (PEER_EPOCHS, lambda function=function: function(*arguments))
        if installed("kalman"):
            assert np.max(np.abs(linear.fast_kalman_last(*arguments) - expected[-1])) < 1e-9
            entries["fast-kalman, its loop in C++, last state alone"] = (
                PEER_EPOCHS,
                lambda: linear.fast_kalman_last(*arguments),
            )
        if installed("simdkalman"):
            name = f"simdkalman, {linear.SERIES:,} series at once"
            entries[name] = (PEER_EPOCHS * linear.SERIES, lambda: linear.simdkalman_series(*arguments))
        return entries

    def smoothers(self):
        """Name -> (epochs, function): the backward pass alone, from the same filtered states."""
        filtered = self.solution.state[START:].copy(), self.solution.covariance[START:].copy()
        log = LogFilter(self.model, "fix")
        epochs = Epochs.empty(EPOCHS, 3)
        nothing = controls(EPOCHS, None, None)
        log.forward(self.log.t_s, self.log.spots_m, nothing, np.empty((0, 4)), epochs)

        def ours():
            state, factor = epochs.state.copy(), epochs.factor.copy()
            part = dataclasses.replace(epochs, state=state, factor=factor)
            log.backward(self.log.t_s, nothing, part, nothing_later())
            return state

        def theirs():
            return filterpy_smoother(self.phi, self.q, *filtered)

        smoothed, spread = theirs()
        sigma = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
        worst = np.max(np.abs(ours()[START:] - smoothed) / sigma)
        assert worst < 1e-6, f"smoothers differ by {worst:.1e} sigma"
        return {
            "filterpy rts_smoother, backward": (EPOCHS - START, theirs),
            "relnav backward": (EPOCHS, ours),
        }


def long_log(log):
    """The problem's images again and again, with noise, FILE_EPOCHS of them."""
    repeats = FILE_EPOCHS // EPOCHS
    spots = np.concatenate([log.spots_m] * repeats) + np.random.default_rng(2).normal(size=(FILE_EPOCHS, 3, 2)) * 1e-7
    t = np.arange(FILE_EPOCHS) * 0.1
    return SimulatedLog(t, spots, np.zeros((FILE_EPOCHS, 3)), np.zeros((FILE_EPOCHS, 6)))


def from_file_to_file(model, log, folder):
    """Name -> (epochs, function): Parquet in, Parquet out, all 43 columns."""
    write_log(long_log(log), folder / "log.parquet")

    def run():
        filter_file(folder / "log.parquet", model, folder / "track.parquet", method="fix")

    return {"relnav Parquet to Parquet, fix": (FILE_EPOCHS, run)}


def growth(model, log):
    """Cost as the work grows: epochs of one log, and beacons."""
    rows = []
    print("\nCost as the work grows (spots, ns per epoch, thread CPU, minimum of 3)")
    for epochs in (1_000, 10_000, 100_000, 1_000_000):
        spots = np.resize(log.spots_m, (epochs, 3, 2))
        t = np.arange(epochs) * 0.1
        times = measure(
            {"": (epochs, lambda t=t, spots=spots: relnav.filter_epochs(model, t, spots, method="spots"))}, 3
        )[""]
        rows.append({"epochs": epochs, "ns": 1000.0 * min(times)})
        print(f"  {epochs:>10} epochs {rows[-1]['ns']:>10.0f}")
    for beacons in (1, 2, 3, 4, 6, 8, 12, 16):
        extra = tuple((0.0, 0.25 * np.cos(k), 0.25 * np.sin(k)) for k in range(max(0, beacons - 3)))
        sensor = dataclasses.replace(model.sensor, extra_beacons_m=extra)
        mission = dataclasses.replace(model, sensor=sensor)
        spots = image(mission, log.truth, Faults(), np.random.default_rng(3))
        spots[100:, beacons:] = np.nan
        run = {
            "": (
                EPOCHS,
                lambda mission=mission, spots=spots: relnav.filter_epochs(mission, log.t_s, spots, method="spots"),
            )
        }
        rows.append({"beacons": beacons, "ns": 1000.0 * min(measure(run, 5)[""])})
        print(f"  {beacons:>10} beacons seen {rows[-1]['ns']:>4.0f}")
    terms = tuple(1e-9 * np.random.default_rng(4).normal(size=len(exponents(HIGHEST_ORDER))))
    calibration = Calibration(HIGHEST_ORDER, (0.0, 0.0), (4e-3, 4e-3), terms, terms, 2.4e-6, 0.0, 225, 1e-5)
    calibrated = dataclasses.replace(model, calibration=calibration)
    tolerances = dataclasses.replace(model.tolerances, considered=True)
    for name, mission in (
        ("of a calibrated detector", calibrated),
        ("the same, tolerances considered", dataclasses.replace(calibrated, tolerances=tolerances)),
    ):
        run = {
            "": (EPOCHS, lambda mission=mission: relnav.filter_epochs(mission, log.t_s, log.spots_m, method="spots"))
        }
        rows.append({"beacons": 3, "of": name, "ns": 1000.0 * min(measure(run, 5)[""])})
        print(f"  3 beacons, {name:<32}{rows[-1]['ns']:>6.0f}")
    return rows


START_UPS = {
    "import relnav": "import relnav",
    "numpy, scipy.linalg": "import numpy, scipy.linalg",
    "filterpy.kalman": "import filterpy.kalman",
    "relnav.Navigator, first step": "import numpy as np, relnav\n"
    "relnav.Navigator(relnav.load_model('three_beacon_psd')).step(0.0, np.zeros((3, 2)))",
}


def start_ups():
    """CPU seconds and peak memory of fresh processes; kernels are cached by now."""
    rows = []
    print("\nStart-up: fresh process, CPU s (minimum of 3), peak MiB")
    report = f"\nimport time; print(time.process_time(), {PEAK})"
    for name, code in START_UPS.items():
        runs = [
            subprocess.run([sys.executable, "-c", code + report], capture_output=True, text=True, check=True).stdout
            for _ in range(3)
        ]
        seconds, peak = min(tuple(map(float, run.split())) for run in runs)
        rows.append({"name": name, "cpu_s": seconds, "peak_mib": peak})
        print(f"  {name:<32}{seconds:>8.2f} s{peak:>8.0f} MiB")
    return rows


def in_memory(problem, rounds, rows):
    """Print and keep the tables of what stays in memory."""
    for method in ("fix", "spots"):
        name = f"filterpy user, {method}, in and out"
        calls = call_with_answer.contenders(problem.model, problem.hand, problem.log.t_s, method)
        table(measure(calls, rounds, time.process_time_ns), name, rows)
    table(measure(problem.peers() | problem.linear_peers() | problem.ours(), rounds), "filterpy user", rows)
    table(measure(problem.smoothers(), rounds), "filterpy rts_smoother, backward", rows)


def of_files(problem, options, rows):
    """Print and keep the table of files; what else is of files and processes, to be kept."""
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        peers = {key: value for key, value in problem.peers().items() if key == "filterpy user"}
        files = peers | from_file_to_file(problem.model, problem.log, folder)
        table(measure(files, min(options.rounds, 7), time.process_time_ns), "filterpy user", rows)
        found = {"growth": growth(problem.model, problem.log), "start_up": start_ups()}
        epochs = 100_000_000 if options.long else options.epochs
        return found | {"streamed": streaming(problem.log, epochs, folder) if epochs else []}


def main() -> None:
    """Check, measure, print, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--short", action="store_true", help="what stays in memory alone, no files")
    parser.add_argument("--epochs", type=int, default=10_000_000, help="of the streamed log; 0 leaves it out")
    parser.add_argument("--long", action="store_true", help="stream 1e8 epochs (75 GB of disk)")
    parser.add_argument("--folder", type=Path, help="where the large files go for a while")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    problem = Problem()
    rows: list[dict[str, object]] = []
    in_memory(problem, options.rounds, rows)
    report: dict[str, object] = {"rounds": options.rounds, "rows": rows}
    if not options.short:
        report |= of_files(problem, options, rows)
    if options.out is not None:
        options.out.write_text(json.dumps(report, indent=2) + "\n")


if __name__ == "__main__":
    main()
