"""How fast a single-field frame is solved: relnav beside tetra3rs, the same centroids, one run, answers checked first.

    pip install tetra3rs==0.14.0
    python benchmarks/star_speed.py --frames 200 --out star_speed.json

Both know the camera. relnav is timed with brightness compared (the catalogue's magnitudes with 0.15 mag noise) and
without; every figure is the minimum over rounds of one frame, then the median over frames; only ratios mean anything on
another machine. Truth is Hipparcos at 2024.0, seen from rest. Exit status 1 if relnav with brightness is less than four
times as fast in a case, or solves fewer frames.
"""

import argparse
import dataclasses
import json
import statistics
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import tetra3rs

import relnav
from relnav.sensors.dual_field.sensor import Fold, StarCamera
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

WIDTH_PX = 1024.0
FOCAL_PX = 0.5 * WIDTH_PX / np.tan(np.radians(7.0))
LEAST_RATIO = 4.0
# name: (spot noise px, faintest magnitude, false spots, missing)
CASES = {
    "clean": (0.1, 5.75, 0, 0.0),
    "3 false, 5 % missing": (0.1, 5.75, 3, 0.05),
    "0.3 px, 5 false, 10 % missing": (0.3, 5.75, 5, 0.10),
    "sparse, 2 false": (0.1, 5.3, 2, 0.0),
}


def make_sensor(noise_px):
    """A camera of 14 deg across 1024 px, one field."""
    base = relnav.load_model("dual_field_star")
    camera = StarCamera(FOCAL_PX, (0.0, 0.0), (0.0, 0.0), (WIDTH_PX, WIDTH_PX), noise_px)
    identification = dataclasses.replace(base.identification, epoch_jyear=2024.0)
    return dataclasses.replace(base, camera=camera, fold=Fold("none"), identification=identification)


def right(dcm, truth):
    """Whether an attitude is within 0.05 deg of the truth."""
    return np.trace(np.asarray(dcm) @ truth.T) > 1.0 + 2.0 * np.cos(np.radians(0.05))


def timed(function, rounds):
    """The result of a call, and its shortest time in us."""
    best, result = np.inf, None
    for _ in range(rounds):
        began = time.perf_counter_ns()
        result = function()
        best = min(best, time.perf_counter_ns() - began)
    return result, best / 1000.0


def race(database, view, case, frames, rounds):
    """Median time in us and number of frames solved rightly, by name."""
    noise, faintest, false, missing = case
    sensor, rng = make_sensor(noise), np.random.default_rng(5)
    conditions = SkyConditions(faintest, 0.15, missing, false, np.radians(9.8))  # the square's corners
    simulator = StarFieldSimulator(sensor, conditions)
    names = ("relnav", "no brightness", "tetra3rs")
    times, solved = {name: [] for name in names}, dict.fromkeys(names, 0)
    for _ in range(frames):
        frame = simulator.frame(rng)
        inside = np.all(np.abs(frame.spots_px) < 0.5 * WIDTH_PX, axis=1)
        spots, magnitude = np.ascontiguousarray(frame.spots_px[inside]), frame.magnitude[inside]
        table = np.column_stack([spots, 10.0 ** (-0.4 * magnitude)])
        calls = {
            "relnav": partial(relnav.dual_field.measure, spots, sensor, magnitude=magnitude),
            "no brightness": partial(relnav.dual_field.measure, spots, sensor),
            "tetra3rs": partial(database.solve_from_centroids, table, camera_model=view),
        }
        for name, call in calls.items():
            call()
            result, shortest = timed(call, rounds)
            times[name].append(shortest)
            good = bool(result) if name == "tetra3rs" else result.ok
            dcm = good and (result.rotation_matrix_icrs_to_camera if name == "tetra3rs" else result.dcm_cam_from_icrs)
            solved[name] += bool(good and right(dcm, frame.dcm_cam_from_icrs))
    return {name: statistics.median(values) for name, values in times.items()}, solved


def main() -> int:
    """Solve every frame by each, print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    database = tetra3rs.SolverDatabase.generate_from_gaia(
        max_fov_deg=20.0, min_fov_deg=10.0, epoch_proper_motion_year=2024
    )
    view = tetra3rs.CameraModel.from_fov(fov_deg=14.0, image_width=int(WIDTH_PX), image_height=int(WIDTH_PX))
    rows = []
    print(f"{'':<32}{'relnav':>18}{'no brightness':>18}{'tetra3rs':>18}{'ratio':>9}{'':>3}no brightness")
    for name, case in CASES.items():
        median, solved = race(database, view, case, options.frames, options.rounds)
        ratio = median["tetra3rs"] / median["relnav"], median["tetra3rs"] / median["no brightness"]
        rows.append({"case": name, "frames": options.frames, "us": median, "solved": solved, "ratios": ratio})
        cells = "".join(f"{median[who]:>8.1f} us, {solved[who]:>4}" for who in median)
        print(f"{name:<32}{cells}{ratio[0]:>9.1f}{ratio[1]:>12.1f}")
    if options.out is not None:
        options.out.write_text(json.dumps({"rounds": options.rounds, "rows": rows}, indent=2) + "\n")
    slowest = min(row["ratios"][0] for row in rows)
    met = slowest >= LEAST_RATIO and all(row["solved"]["relnav"] >= row["solved"]["tetra3rs"] for row in rows)
    print(f"at least {slowest:.1f} times as fast, {LEAST_RATIO:g} required: {'met' if met else 'MISSED'}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
