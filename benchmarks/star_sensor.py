"""Long campaigns of the star sensor; each prints its figures and adds a line of JSON to --out.

    python benchmarks/star_sensor.py frames --count 100000     # two fields, 3 false spots, 5 % missing
    python benchmarks/star_sensor.py false --count 1000000     # 4 to 16 false spots and nothing else
    python benchmarks/star_sensor.py blind --count 2000        # other cameras, focal length known to 3 %
    python benchmarks/star_sensor.py fold --count 300          # the mirror from one frame without a prior

A tenth or less of each is in the ordinary tests. --part i/n runs one of n equal parts with a seed of its own.
"""

import argparse
import dataclasses
import json
import time
from pathlib import Path

import numpy as np

import relnav
from relnav.accuracy.dual_field_blind import fly_blind
from relnav.accuracy.dual_field_runs import fly_frames
from relnav.sensors.dual_field.fold import mirror_fold
from relnav.sensors.dual_field.fold_calibration import estimate_fold, normal_error
from relnav.sensors.dual_field.optics import plane_points, ray_sigma, rays
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

ARCSEC = np.degrees(1.0) * 3600.0


def frames(count, seed):
    """Superimposed frames: solved, wrong, errors, NEES."""
    model = relnav.load_model("dual_field_star")
    runs = fly_frames(model, SkyConditions(), count, seed, two_fields=True)
    result = dataclasses.asdict(runs)
    return result | {"rms_rad": runs.rms_rad.tolist(), "predicted_rad": runs.predicted_rad.tolist()}


def false(count, seed):
    """Frames of false spots alone: how many are given an attitude."""
    model = relnav.load_model("dual_field_star")
    simulator, rng = StarFieldSimulator(model, SkyConditions()), np.random.default_rng(seed)
    accepted = tried = 0
    for _ in range(count):
        spots, magnitude = simulator.false_frame(rng, int(rng.integers(4, 17)))
        solution = relnav.dual_field.measure(spots, model, magnitude=magnitude, velocity_km_s=(0.0, 0.0, 0.0))
        accepted += solution.ok
        tried += solution.tried
    return {"frames": count, "accepted": accepted, "attitudes_tried": tried}


def blind(count, seed):
    """Frames of cameras of many kinds, solved with a focal length that is up to 3 % wrong."""
    return fly_blind(relnav.load_model("ground_camera").catalogue, count, seed)


def fold(count, seed):
    """The mirror's normal from single frames, no prior."""
    model = relnav.load_model("dual_field_star")
    normal = np.array([1.0, 0.03, -1.1]) / np.linalg.norm([1.0, 0.03, -1.1])
    simulator, rng = StarFieldSimulator(model, SkyConditions(), mirror_fold(normal)), np.random.default_rng(seed)
    focal, errors, possible = model.camera.focal_length_px, [], 0
    for _ in range(count):
        frame = simulator.frame(rng)
        points = plane_points(frame.spots_px, focal, (0.0, 0.0), (0.0, 0.0))
        sigma = ray_sigma(points, model.camera.spot_noise_px, focal)
        possible += min(np.sum(frame.field == 0), np.sum(frame.field == 1)) >= 5
        found = estimate_fold(rays(points), model.sky(), sigma_rad=sigma, magnitude=frame.magnitude)
        if found is not None:
            errors.append(normal_error(found, normal) / np.sqrt(np.diagonal(found.covariance)))
    e = np.array(errors)
    return {
        "frames": count,
        "five_stars_in_each": int(possible),
        "found": len(e),
        "wrong": int(np.sum(np.abs(e).max(axis=1) > 10.0)),
        "rms_in_sigmas": np.sqrt(np.mean(e**2, axis=0)).tolist(),
    }


CAMPAIGNS = {"frames": frames, "false": false, "blind": blind, "fold": fold}


def main() -> None:
    """Run one campaign."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", choices=CAMPAIGNS)
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--part", default="1/1")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    part, parts = (int(text) for text in options.part.split("/"))
    began = time.perf_counter()
    result = CAMPAIGNS[options.campaign](options.count // parts, options.seed + 1000 * part)
    result |= {"campaign": options.campaign, "part": options.part, "seconds": time.perf_counter() - began}
    print(json.dumps(result, indent=2))
    if options.out is not None:
        with options.out.open("a") as file:
            file.write(json.dumps(result) + "\n")


if __name__ == "__main__":
    main()
