"""What a calibration of the detector reaches, by fineness of its figure, points and noise, and what it does to a track.

Detectors are drawn with +-250 um of distortion (pin-cushion, tilt and a smooth figure). `left` is 3 x rms of an axis on
points without noise inside 75 % of the area; `said` is what the calibration reports. `bound` is the same of the best
estimator there is, which is told size and length of the figure and the noise: on average no other keeps more axes
within 10 um. Then approaches through such detectors are filtered with and without their calibrations: rms range error
against truth over the last two thirds.

    python benchmarks/psd_calibration.py [--detectors 200] [--flights 12] [--grid grid.csv]

`--grid` writes one simulated grid for `relnav calibrate psd` and stops.
"""

import argparse
import dataclasses
import json
import math
from pathlib import Path

import numpy as np

import relnav
from relnav.navigation.slots import filter_slots
from relnav.sensors.three_beacon.calibrate import HIGHEST_ORDER, calibrate
from relnav.sensors.three_beacon.psd import currents_of_counts
from relnav.sensors.three_beacon.slots import read_slots
from relnav.sensors.three_beacon.smooth_figure import Box, Estimator, Figures, legendre
from relnav.simulation.distortion import typical_distortion
from relnav.simulation.raw import simulate_raw
from relnav.simulation.trajectory import Approach

HALF_M = 4e-3
INSIDE_M = HALF_M * math.sqrt(0.75)
LIMIT_M = 250e-6
CASES = (
    (1.0, 15, 10e-6), (2.0, 15, 10e-6), (4.0, 15, 10e-6), (0.75, 15, 10e-6), (0.5, 15, 10e-6),
    (1.0, 8, 10e-6), (1.0, 17, 10e-6), (1.0, 15, 3e-6), (0.5, 25, 10e-6),
)  # fmt: skip
"""Length of the figure in half-widths, side of the grid, noise of a point."""


def grid(side, half_m=INSIDE_M):
    line = np.linspace(-half_m, half_m, side)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def bench(seed, side, noise_m, length):
    """A detector, its grid (true, measured), and points to try a calibration on."""
    detector = typical_distortion(HALF_M, LIMIT_M, length_m=length * INSIDE_M, seed=seed)
    rng = np.random.default_rng((1, seed))
    true = grid(side)
    measured = detector.apply(true) + rng.normal(size=true.shape) * noise_m
    return detector, true, measured, rng.uniform(-INSIDE_M, INSIDE_M, (4000, 2))


def three_rms(error):
    return 3.0 * np.sqrt(np.mean(error**2, axis=0))


def told(detector, true, measured, points, noise_m):
    """What is left of each axis by the estimator that knows the figure's covariance and the noise, m."""
    box = Box.around(true)
    figure = Figures.known(detector.figure_length_m / INSIDE_M, detector.figure_sigma_m, noise_m)
    best = Estimator(box, box.scaled(true), HIGHEST_ORDER, figure)
    fitted = legendre(box.scaled(points), HIGHEST_ORDER) @ best.coefficients(measured - true)
    return three_rms(fitted - detector.error(points))


def campaign(detectors):
    for length, side, noise_m in CASES:
        left, said, chance, bound = [], [], [], []
        for seed in range(detectors):
            detector, true, measured, points = bench(seed, side, noise_m, length)
            report = calibrate(true, measured)
            left.append(three_rms(report.calibration.correct(detector.apply(points)) - points))
            said.append(report.reached_m)
            chance.append(report.chance)
            bound.append(told(detector, true, measured, points, noise_m))
        left, said, bound = np.array(left), np.array(said)[:, None], np.array(bound)
        yield {
            "figure_length_in_half_widths": length,
            "points": side * side,
            "noise_um": noise_m * 1e6,
            "axes": left.size,
            "left_um_rms": rms(left) * 1e6,
            "left_um_median": float(np.median(left) * 1e6),
            "left_um_max": float(left.max() * 1e6),
            "axes_above_10_um": int((left > 10e-6).sum()),
            "said_axes_above_10_um": left.size * (1.0 - float(np.mean(chance))),
            "said_over_left_rms": rms(said) / rms(left),
            "bound_um_rms": rms(bound) * 1e6,
            "bound_axes_above_10_um": int((bound > 10e-6).sum()),
        }


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def flight(model, seed):
    """Rms errors over published figures, without and with calibration: (range, azimuth, elevation); NEES of 6.

    NEES with calibration, with the same if its residual is not considered, and of the same detector undistorted.
    """
    detector, true, measured, _ = bench(seed, 15, 10e-6, 1.0)
    report = calibrate(true, measured)
    approach = Approach(duration_s=120.0, start_m=(9.0, 0.05, -0.05), final_range_m=6.0)

    def flown(distortion):
        log = simulate_raw(model, approach, seed=seed, distortion=distortion)
        currents = currents_of_counts(model.detector, log.counts)
        size = model.sensor.detector_size_m
        return log, read_slots(model.detector, model.pulses, size, log.t_s, log.beacon, currents)

    log, slots = flown(detector)
    late = log.t_s > 40.0
    p = log.truth[late, :3]
    r = np.linalg.norm(p, axis=1)
    true = np.stack([r, np.arctan2(p[:, 1], p[:, 0]), -np.arcsin(p[:, 2] / r)], axis=1)
    published = np.array([0.02, math.radians(0.176), math.radians(0.182)])
    calibrated = dataclasses.replace(model, calibration=report.calibration)
    trusted = dataclasses.replace(report.calibration, residual_sigma_m=0.0, rim_slope=0.0)

    def nees(mission, log, slots):
        track = filter_slots(mission, slots, acceleration_m_s2=log.acceleration_m_s2, method="spots")
        error = (track.state - log.truth)[late]
        weighted = np.linalg.solve(track.covariance[late], error[..., None])[..., 0]
        off = np.sqrt(np.nanmean((track.docking[late] - true) ** 2, axis=0)) / published
        return off, float(np.nanmean(np.einsum("ni,ni->n", error, weighted)))

    without, _ = nees(model, log, slots)
    corrected, considered = nees(calibrated, log, slots)
    _, believed = nees(dataclasses.replace(model, calibration=trusted), log, slots)
    _, undistorted = nees(model, *flown(None))
    return without, corrected, (considered, believed, undistorted)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--detectors", type=int, default=200)
    parser.add_argument("--flights", type=int, default=12)
    parser.add_argument("--grid", type=Path)
    options = parser.parse_args()
    if options.grid is not None:
        detector, true = typical_distortion(HALF_M, LIMIT_M, seed=0), grid(15)
        measured = detector.apply(true) + np.random.default_rng((1, 0)).normal(size=true.shape) * 10e-6
        rows = np.column_stack([true, measured]) * 1e6
        np.savetxt(options.grid, rows, "%.4f", ",", header="true_x_um,true_y_um,spot_x_um,spot_y_um", comments="")
        return
    for row in campaign(options.detectors):
        print(json.dumps(row))
    if options.flights < 1:
        return
    model = relnav.load_model("three_beacon_psd")
    flights = [flight(model, seed) for seed in range(options.flights)]
    for k, name in enumerate(("without", "with")):
        ratio = np.array([run[k] for run in flights])
        worst, median = ratio.max(axis=0).tolist(), np.median(ratio, axis=0).tolist()
        print(json.dumps({"calibration": name, "rms_over_published_median": median, "worst": worst}))
    nees = np.mean([run[2] for run in flights], axis=0).tolist()
    print(json.dumps(dict(zip(("nees_of_6_mean", "if_not_considered", "undistorted"), nees, strict=True))))


if __name__ == "__main__":
    main()
