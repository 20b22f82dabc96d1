"""Is the covariance honest when a sensor is not built as it was drawn: NEES and coverage, errors considered or not.

Sensors are drawn within the model's tolerances (focal length, mountings, beacons), with what a calibration leaves in
every spot coordinate, on a chaser whose attitude differs from the stated one by the model's sigma; each flies one
approach whose dynamics are what the filter assumes. `considered` is a filter with `[tolerances] considered = true`,
the calibration and the attitude's sigma, `ignored` one without them (`fix` keeps the attitude's sigma, by which it
rejects images). Then built sensors approach from 5 m to 0.6 m over two small triads, spot noise by received power (1
um there), and what the gate does. Last the whole chain: a detector with 250 um of distortion, calibrated from 225
points of 10 um, in a built sensor, filtered from raw currents, spot by spot; and nine beacons, three, `fix` and
unknown attitude after a calibration from 81 points.

    python benchmarks/lasting_errors.py [--sensors 200] [--approaches 20] [--chains 100]
"""

import argparse
import dataclasses
import json

import numpy as np

import relnav
from relnav.accuracy.campaign import noise_alone
from relnav.navigation.slots import filter_slots
from relnav.sensors.three_beacon.calibrate import calibrate
from relnav.sensors.three_beacon.calibration import Calibration
from relnav.sensors.three_beacon.psd import currents_of_counts
from relnav.sensors.three_beacon.slots import read_slots
from relnav.simulation.as_built import as_built, attitude_off
from relnav.simulation.distortion import typical_distortion
from relnav.simulation.raw import simulate_raw
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach

RESIDUAL_M = 2.4e-6
SETTLED_S = 30.0
APPROACH = Approach(duration_s=60.0, start_m=(7.0, 0.02, 0.03), assumed_noise=True, assumed_start=True)


def calibrated(model):
    """The model with a calibration that corrects nothing: simulated spots then have what one leaves, and no more."""
    left = Calibration(0, (0.0, 0.0), (3.46e-3, 3.46e-3), (0.0,), (0.0,), RESIDUAL_M, 0.0, 225, 1e-5)
    return dataclasses.replace(model, calibration=left)


def flown(drawn, seed):
    """The sensor as it is built, on a chaser that is not quite turned as it is stated."""
    turn = np.random.default_rng((7, seed)).normal(size=3) * drawn.attitude.sigma_rad
    return as_built(attitude_off(drawn, turn), seed)


def flight(filters, drawn, seed):
    """A row a filter, over the settled part: NEES of 6; share of range, azimuth, elevation within their sigma."""
    log = simulate(flown(calibrated(drawn), seed), APPROACH, seed=seed)
    late, rows = log.t_s > SETTLED_S, []
    p = log.truth[late, :3]  # the camera is in the centre of mass, the port too
    r = np.linalg.norm(p, axis=1)
    docking = np.stack([r, np.arctan2(p[:, 1], p[:, 0]), -np.arcsin(p[:, 2] / r)], axis=1)
    for model, method, smooth in filters:
        track = relnav.filter_epochs(
            model, log.t_s, log.spots_m, acceleration_m_s2=log.acceleration_m_s2, method=method, smooth=smooth
        )
        error = (track.state - log.truth)[late]
        nees = np.einsum("ni,ni->n", error, np.linalg.solve(track.covariance[late], error[..., None])[..., 0])
        within = np.abs(track.docking[late] - docking) < track.docking_sigma[late]
        rows.append([nees.mean(), *within.mean(axis=0)])
    return rows


def triad(a):
    return (0.0, a, 0.0), (0.0, -a, 0.0), (3.0**0.5 * a, 0.0, 0.0)


def close_in(drawn, seed):
    """A row with errors considered, one with errors ignored: share of images used whole, restarts, NEES of 6 or NaN."""
    sensor = dataclasses.replace(drawn.sensor, extra_beacons_m=(*triad(0.06), *triad(0.03)))
    rows = []
    for considered in (True, False):
        tolerances = dataclasses.replace(drawn.tolerances, distortion_limit_m=0.0, considered=considered)
        model = dataclasses.replace(drawn, sensor=sensor, tolerances=tolerances)
        built = flown(model, seed)
        model = model if considered else noise_alone(model, "spots")
        approach = Approach(start_m=(5.0, 0.02, -0.02), final_range_m=0.6, duration_s=250.0)
        log = simulate(built, approach, seed=seed, by_received_power=True)
        track = relnav.filter_epochs(
            model,
            log.t_s,
            log.spots_m,
            acceleration_m_s2=log.acceleration_m_s2,
            spot_sigma_m=log.sigma_m,
            method="spots",
        )
        known = np.isfinite(track.state[:, 0]) & (log.t_s > 5.0)
        error = (track.state - log.truth)[known]
        nees = np.einsum("ni,ni->n", error, np.linalg.solve(track.covariance[known], error[..., None])[..., 0])
        rows.append([track.accepted.mean(), track.restarts, nees.mean() if known.any() else np.nan])
    return rows


def chain(drawn, seed):
    """NEES of 6 of one calibrated, built sensor on a raw log: considered, the same smoothed, tolerances ignored."""
    rng, line = np.random.default_rng((8, seed)), np.linspace(-3.46e-3, 3.46e-3, 15)
    true = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    distortion = typical_distortion(4e-3, 250e-6, length_m=3.46e-3, seed=seed)
    report = calibrate(true, distortion.apply(true) + rng.normal(size=true.shape) * 10e-6)
    approach = Approach(duration_s=120.0, start_m=(9.0, 0.05, -0.05), final_range_m=4.5, assumed_noise=True)
    log = simulate_raw(flown(drawn, seed), approach, seed=seed, distortion=distortion)
    currents = currents_of_counts(drawn.detector, log.counts)
    slots = read_slots(drawn.detector, drawn.pulses, drawn.sensor.detector_size_m, log.t_s, log.beacon, currents)
    late, row = log.t_s > 40.0, []
    for considered, smooth in ((True, False), (True, True), (False, False)):
        tolerances = dataclasses.replace(drawn.tolerances, considered=considered)
        model = dataclasses.replace(drawn, calibration=report.calibration, tolerances=tolerances)
        model = model if considered else noise_alone(model, "spots")
        track = filter_slots(model, slots, acceleration_m_s2=log.acceleration_m_s2, smooth=smooth, method="spots")
        error = (track.state - log.truth)[late]
        nees = np.einsum("ni,ni->n", error, np.linalg.solve(track.covariance[late], error[..., None])[..., 0])
        row.append(nees.mean())
    return row


def layouts(drawn):
    """Models and approaches that lean on a detector's calibration differently."""
    unknown = dataclasses.replace(drawn, attitude=dataclasses.replace(drawn.attitude, mode="unknown"))
    sensor = dataclasses.replace(drawn.sensor, extra_beacons_m=(*triad(0.06), *triad(0.03)))
    nine, away = dataclasses.replace(drawn, sensor=sensor), (9.0, 0.05, -0.05)
    near, hold = (4.0, 0.02, 0.02), (6.0, 0.02, 0.02)
    return (
        ("nine beacons, hold 6 m", nine, "spots", hold, 5.99),
        ("nine beacons, 4 m to 1 m", nine, "spots", near, 1.0),
        ("three beacons, hold 6 m", drawn, "spots", hold, 5.99),
        ("three beacons, 9 m to 4.5 m", drawn, "spots", away, 4.5),
        ("the same, fix", drawn, "fix", away, 4.5),
        ("the same, attitude unknown", unknown, "spots", away, 4.5),
    )


def calibrated_flight(seed, model, method, start_m, final_range_m):
    """NEES of 6 over the second half of a flight before a distorted detector, calibrated from 9 x 9 points."""
    rng, line = np.random.default_rng((9, seed)), np.linspace(-3.4e-3, 3.4e-3, 9)
    true = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    distortion = typical_distortion(4e-3, 250e-6, seed=seed)
    report = calibrate(true, distortion.apply(true) + rng.normal(size=true.shape) * 10e-6)
    approach = Approach(duration_s=120.0, start_m=start_m, final_range_m=final_range_m, assumed_noise=True)
    silent = dataclasses.replace(model, sensor=dataclasses.replace(model.sensor, spot_noise_m=1e-15))
    log = simulate(silent, approach, seed=seed)
    spots = distortion.apply(log.spots_m) + rng.normal(size=log.spots_m.shape) * 10e-6
    told = dataclasses.replace(model, calibration=report.calibration)
    track = relnav.filter_epochs(told, log.t_s, spots, acceleration_m_s2=log.acceleration_m_s2, method=method)
    error = (track.state - log.truth)[log.t_s > 60.0]
    covariance = track.covariance[log.t_s > 60.0]
    return np.nanmean(np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0]))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sensors", type=int, default=200)
    parser.add_argument("--approaches", type=int, default=20)
    parser.add_argument("--chains", type=int, default=100)
    options = parser.parse_args()
    drawn = relnav.load_model("three_beacon_psd")
    considered = calibrated(
        dataclasses.replace(drawn, tolerances=dataclasses.replace(drawn.tolerances, considered=True))
    )
    ways = [(method, smooth) for method in ("spots", "fix") for smooth in (False, True)]
    filters = [(considered, *way) for way in ways] + [(noise_alone(drawn, way[0]), *way) for way in ways]
    runs = np.array([flight(filters, drawn, seed) for seed in range(options.sensors)])
    mean = runs.mean(axis=0)
    spread = runs[:, :, 0].std(axis=0, ddof=1) / np.sqrt(options.sensors)
    for k, (model, method, smooth) in enumerate(filters):
        print(
            json.dumps(
                {
                    "errors": "considered" if model is considered else "ignored",
                    "filter": method + (", smoothed" if smooth else ""),
                    "nees_of_6": round(mean[k, 0], 2),
                    "its_sigma": round(spread[k], 2),
                    "within_1_sigma": [round(x, 2) for x in mean[k, 1:]],
                }
            )
        )
    runs = np.array([close_in(drawn, seed) for seed in range(options.approaches)])
    for k, errors in enumerate(("considered", "ignored")):
        whole, restarts, nees = np.nanmean(runs[:, k], axis=0)
        figures = {"images_used_whole": round(whole, 4), "restarts": round(restarts, 2), "nees_of_6": round(nees, 1)}
        figures["flights_without_a_state"] = int(np.isnan(runs[:, k, 2]).sum())
        print(json.dumps({"errors": errors, "approach": "5 m to 0.6 m"} | figures))
    runs = np.array([chain(drawn, seed) for seed in range(options.chains)])
    mean, spread = runs.mean(axis=0), runs.std(axis=0, ddof=1) / np.sqrt(options.chains)
    for k, errors in enumerate(("considered", "considered, smoothed", "tolerances ignored")):
        figures = {"nees_of_6": round(mean[k], 2), "its_sigma": round(spread[k], 2)}
        print(json.dumps({"errors": errors, "chain": "distortion, calibration, built sensor, raw log"} | figures))
    for name, *case in layouts(noise_alone(drawn, "spots")):
        runs = np.array([calibrated_flight(seed, *case) for seed in range(options.chains)])
        figures = {"nees_of_6": round(runs.mean(), 2), "its_sigma": round(runs.std(ddof=1) / len(runs) ** 0.5, 2)}
        print(json.dumps({"calibrated from 81 points": name} | figures | {"median": round(float(np.median(runs)), 2)}))


if __name__ == "__main__":
    main()
