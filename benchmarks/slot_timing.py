"""What it costs to take a cycle's three slots as simultaneous, at 0.1 m/s and 1 deg/s, and that slot times remove it.

The chaser swings about a place 6.5 m out: sideways with a peak speed, and turning about the camera's y axis with a peak
rate; control and attitude are known (log columns). One raw log is filtered three ways: every spot at its own time,
images joined by interpolation, and images as if a cycle's spots were simultaneous. Errors are rms against truth, of
the filter from 20 s on and of single images.

    python benchmarks/slot_timing.py [--runs 10] [--seconds 60]
"""

import argparse
import dataclasses
import json
import math

import numpy as np
from scipy.spatial.transform import Rotation

import relnav
from relnav.navigation.log import filter_epochs
from relnav.navigation.slots import filter_slots
from relnav.sensors.three_beacon.psd import currents_of_counts
from relnav.sensors.three_beacon.slots import read_slots
from relnav.simulation.raw import slot_counts
from relnav.simulation.swing import swing

RANGE_M = 6.5
SETTLED_S = 20.0


def errors(model, seconds, speed_m_s, turn_rate_rad_s, seed):
    """Rms errors (range m, azimuth deg, elevation deg) and NIS per degree of freedom, by way of filtering."""
    t, beacon = model.pulses.schedule(round(seconds / model.pulses.cycle_s))
    flown = swing(model, t, RANGE_M, speed_m_s, turn_rate_rad_s)
    truth, command, dcm = flown.truth, flown.acceleration_m_s2, flown.dcm_cam_from_lvlh
    counts = slot_counts(model, truth, beacon, np.random.default_rng(seed), dcm_cam_from_lvlh=dcm)
    slots = read_slots(
        model.detector,
        model.pulses,
        model.sensor.detector_size_m,
        t,
        beacon,
        currents_of_counts(model.detector, counts),
    )
    noisy = dataclasses.replace(model.sensor, spot_noise_m=float(np.sqrt(np.nanmean(slots.sigma_m**2))))
    mission = dataclasses.replace(model, sensor=noisy)
    q = Rotation.from_matrix(dcm).as_quat()
    p = truth[:, :3]
    r = np.linalg.norm(p, axis=1)
    true = np.stack([r, np.arctan2(p[:, 1], p[:, 0]), -np.arcsin(p[:, 2] / r)], axis=1)
    given = {"acceleration_m_s2": command, "q_cam_from_lvlh": q, "method": "spots"}
    tracks = {"own times": filter_slots(model, slots, **given)}
    out = {}
    for name, (spots, _) in (("interpolated", slots.images()), ("simultaneous", slots.simultaneous())):
        tracks[name] = filter_epochs(mission, t, spots, **given)
        whole = np.flatnonzero(np.isfinite(spots).all(axis=(1, 2)))
        fixes = np.array([relnav.three_beacon.measure(spots[k], mission).value for k in whole])
        out[f"single image, {name}"] = (*_rms(fixes - true[whole]), math.nan)
    late = t >= SETTLED_S
    for name, track in tracks.items():
        used = late & (track.dof > 0)
        nis = track.nis[used].sum() / track.dof[used].sum()
        out[f"spots filter, {name}"] = (*_rms((track.docking - true)[late]), float(nis))
    return out


def _rms(error):
    rms = np.sqrt(np.nanmean(error**2, axis=0))
    return float(rms[0]), math.degrees(rms[1]), math.degrees(rms[2])


CASES = {"at rest": (0.0, 0.0), "0.1 m/s": (0.1, 0.0), "1 deg/s": (0.0, math.radians(1.0))}
CASES["0.1 m/s and 1 deg/s"] = (0.1, math.radians(1.0))


def campaign(model, runs, seconds):
    """Mean over runs (rms of rms) by case and way: (range m, azimuth deg, elevation deg, NIS per degree of freedom)."""
    out = {}
    for case, motion in CASES.items():
        parts = [errors(model, seconds, *motion, seed) for seed in range(runs)]
        for way in parts[0]:
            values = np.array([part[way] for part in parts])
            out[case, way] = (*np.sqrt(np.mean(values[:, :3] ** 2, axis=0)).tolist(), float(values[:, 3].mean()))
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    model = relnav.load_model("three_beacon_psd")
    for (case, way), (r, az, el, nis) in campaign(model, options.runs, options.seconds).items():
        row = {"case": case, "way": way, "range_m": r, "azimuth_deg": az, "elevation_deg": el, "nis_per_dof": nis}
        print(json.dumps(row))


if __name__ == "__main__":
    main()
