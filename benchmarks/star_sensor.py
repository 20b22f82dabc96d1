"""The star sensor against its bars, by simulation; exit status 1 if one is missed.

    python benchmarks/star_sensor.py                           # a tenth of every campaign, two minutes
    python benchmarks/star_sensor.py --full                    # every campaign whole, ten times that
    python benchmarks/star_sensor.py frames --count 100000     # one of them, of any size
    python benchmarks/star_sensor.py false --count 1000000 --part 3/20 --out false.jsonl

frames: two fields superimposed, 3 false spots, 5 % missing, observer at 30.3 km/s, the fold known exactly. edges: the
detector turned against the mirror, mirrored images, noise beyond the stated, the fold off by its stated error, an axis
beside the image's centre. false: 4 to 16 false spots and nothing else. patent: the patent's method beside ours, 0 to 5
false spots. blind: other cameras, focal length known to 3 %. hidden: the same, half of the sky hidden. fold: the
mirror from one frame without a prior. pictures: from pictures with stray light, overlaps and a mirror of unequal
halves. held: 27 frames of other cameras with a focal length known to 30 %. --part i/n runs one of n equal parts with a
seed of its own.
Speed is `star_speed.py`.
"""

import argparse
import csv
import dataclasses
import json
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

import relnav
from relnav.accuracy.dual_field_blind import fly_blind, fly_hidden
from relnav.accuracy.dual_field_edges import fly_edges
from relnav.accuracy.dual_field_pictures import fly_pictures
from relnav.accuracy.dual_field_runs import calibrated, fly_frames, identification_rates
from relnav.files.star_frames import StarFrame
from relnav.files.star_solving import solve_frame
from relnav.sensors.dual_field.fold import mirror_fold
from relnav.sensors.dual_field.fold_calibration import estimate_fold, normal_error
from relnav.sensors.dual_field.optics import plane_points, ray_sigma, rays
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator, random_velocity

FALSE_SPOTS = (0, 1, 2, 3, 5)
HELD = Path(__file__).parents[1] / "tests" / "data" / "held_sky"


class Bar(NamedTuple):
    """One requirement, what was measured, and whether it is met; `required` is empty where nothing is."""

    quantity: str
    measured: str
    required: str = ""
    met: bool = True


def frames(count, seed):
    """Superimposed frames: solved, wrong, errors, NEES."""
    model = calibrated(relnav.load_model("dual_field_star"))
    runs = fly_frames(model, SkyConditions(), count, seed, two_fields=True)
    figures = dataclasses.asdict(runs) | {
        "rms_rad": runs.rms_rad.tolist(),
        "predicted_rad": runs.predicted_rad.tolist(),
    }
    allowance = 0.1 if count >= 1000 else 9.8 / np.sqrt(count)  # four sigma of the mean of a chi^2 of 3, (6 / n)^(1/2)
    axes = ", ".join(f"{value * 1e6:.2f}" for value in runs.rms_rad)
    return figures, [
        Bar("wrong attitudes", f"{runs.wrong} of {count}", "0", runs.wrong == 0),
        Bar(
            "frames of 3 or more stars in each field not solved",
            f"{runs.missed} of {runs.solvable}",
            "0",
            runs.missed == 0,
        ),
        Bar("rms about x, y, z, 1e-6 rad", axes, "each < 3", bool(np.all(runs.rms_rad < 3e-6))),
        Bar("mean NEES", f"{runs.nees:.3f}", f"3 +- {allowance:.1f}", abs(runs.nees - 3.0) <= allowance),
        Bar("spots given another star", f"{runs.wrong_stars} of {runs.true_stars}"),
    ]


def false(count, seed):
    """Frames of false spots alone: how many are given an attitude."""
    model = relnav.load_model("dual_field_star")
    simulator, rng = StarFieldSimulator(model, SkyConditions()), np.random.default_rng(seed)
    accepted = tried = 0
    for _ in range(count):
        spots, magnitude = simulator.false_frame(rng, int(rng.integers(4, 17)))
        solution = relnav.dual_field.measure(spots, model, magnitude=magnitude, velocity_km_s=random_velocity(rng))
        accepted += solution.ok
        tried += solution.tried
    figures = {"frames": count, "accepted": accepted, "attitudes_tried": tried}
    return figures, [Bar("all-false frames accepted", f"{accepted} of {count}", "0", accepted == 0)]


def patent(count, seed):
    """Share of frames solved by pairs, by the patent's method, and by it with 90 deg -+ a, for 0 to 5 false spots."""
    model = relnav.load_model("dual_field_star")
    conditions = [SkyConditions(false_spots=spots, missing=0.03) for spots in FALSE_SPOTS]
    rates = identification_rates(model, conditions, count, seed)
    ours = [row[0] for row in rates]
    columns = (", ".join(f"{row[k]:.3f}" for row in rates) for k in range(3))
    text = ", ".join(str(spots) for spots in FALSE_SPOTS)
    names = ("solved by pairs", "by the patent's method", "by it with 90 deg -+ a")
    bars = [
        Bar(f"{name}, {text} false", measured, "1 each" if k == 0 else "", k > 0 or min(ours) == 1.0)
        for k, (name, measured) in enumerate(zip(names, columns, strict=True))
    ]
    fewest, known = refused(model, conditions, count, seed)
    shown = f"{len(fewest)} of {count * len(conditions)}; {max(fewest, default=0)}"
    bars.append(Bar("no attitude by pairs; true stars in the poorer field, at most", shown))
    bars.append(Bar("of these solved if the fold is known exactly", f"{known} of {len(fewest)}"))
    return {"frames": count, "false_spots": FALSE_SPOTS, "rates": rates, "refused_stars": fewest}, bars


def refused(model, conditions, count, seed):
    """Of the frames of `identification_rates` without an attitude: true stars in the poorer field, solved if told."""
    rng, exact, fewest, known = np.random.default_rng(seed), calibrated(model), [], 0
    velocity = random_velocity(rng)
    for each in conditions:
        simulator = StarFieldSimulator(model, each)
        for _ in range(count):
            frame = simulator.frame(rng, velocity_km_s=velocity)
            arguments = {"magnitude": frame.magnitude, "velocity_km_s": velocity}
            if not relnav.dual_field.measure(frame.spots_px, model, **arguments).ok:
                fewest.append(int(np.bincount(frame.field[frame.field >= 0], minlength=2).min()))
                known += relnav.dual_field.measure(frame.spots_px, exact, **arguments).ok
    return fewest, known


def blind(count, seed):
    """Frames of cameras of many kinds, solved with a focal length that is up to 3 % wrong."""
    figures = fly_blind(relnav.load_model("ground_camera").catalogue, count, seed)
    refusal, again = (
        f"{figures[name + '_median']:.2f}, {figures[name + '_most']:.2f}" for name in ("refusal_s", "refusal_again_s")
    )
    late = f"{figures['refused_late']} of {figures['refusals']}"
    return figures, [
        Bar("wrong attitudes of unknown cameras", f"{figures['wrong']} of {count}", "0", figures["wrong"] == 0),
        Bar("true frames solved", f"{figures['solved']} of {figures['true_frames']}"),
        Bar("to refuse a frame, processor s, median and most", refusal),
        Bar("the same where its sky is at hand", again),
        Bar("refused after more than 0.3 s", late),
        Bar("to solve a frame whose sky is at hand, processor ms, median", f"{1e3 * figures['again_s_median']:.1f}"),
    ]


def hidden(count, seed):
    """Frames half hidden by a roof with lights on it."""
    catalogue, bars, figures = relnav.load_model("ground_camera").catalogue, [], {}
    for lights in (0, 5, 15):
        row = figures[f"lights_{lights}"] = fly_hidden(catalogue, count // 3, seed, lights)
        said = f"{row['wrong']} of {row['frames']}; {row['solved']} solved"
        bars.append(Bar(f"half hidden, {lights} lights: wrong attitudes", said, "0", row["wrong"] == 0))
    return figures, bars


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
    wrong = int(np.sum(np.abs(e).max(axis=1) > 10.0))
    figures = {"frames": count, "five_stars_in_each": int(possible), "found": len(e), "wrong": wrong}
    return figures | {"rms_in_sigmas": np.sqrt(np.mean(e**2, axis=0)).tolist()}, [
        Bar("mirrors wrong", f"{wrong} of {count}", "0", wrong == 0),
        Bar(
            "found without a prior, of frames with 5 stars in each field",
            f"{len(e)} of {possible}",
            ">= 99 %",
            len(e) >= 0.99 * possible,
        ),
    ]


def edges(count, seed):
    """Frames that are not what the model says: how many are solved more than 5 sigma off."""
    figures = fly_edges(relnav.load_model("dual_field_star"), count, seed)
    bars = []
    for kind, row in figures.items():
        measured = f"{row['far']:.0f} of {row['solved']:.0f} solved, {row['frames']:.0f} frames, NEES {row['nees']:.2f}"
        bars.append(Bar(f"{kind}: more than 5 sigma off", measured, "0", row["far"] == 0))
    return figures, bars


def pictures(count, seed):
    """Pictures of spots of 7 x 7 px, dark, with stray light, with overlaps, of unequal halves."""
    figures = fly_pictures(relnav.load_model("dual_field_star"), count, seed)
    bars = []
    for kind, row in figures.items():
        share = row["found"] / row["stars"]
        said = f"{row['far']:.0f} of {row['pictures']:.0f}, {row['solved']:.0f} solved, {share:.1%} found"
        bars.append(Bar(f"pictures, {kind}: more than 5 sigma off", said, "0", row["far"] == 0))
    return figures, bars


def held(count, seed):
    """27 frames of other cameras, given a focal length up to 30 % off: how many are solved, and none wrong."""
    rows = {}
    with (HELD / "frames.csv").open() as file:
        for row in csv.DictReader(file):
            rows.setdefault(row["frame"], []).append([float(row[key]) for key in ("x_px", "y_px", "flux")])
    reference, rng = json.loads((HELD / "reference.json").read_text()), np.random.default_rng(seed)
    solved, wrong, unsolved = 0, 0, []
    for name, table in list(rows.items())[:count]:
        spots, focal = np.array(table), reference[name]["focal_px"]
        given = focal * rng.uniform(0.77, 1.3)  # so that the true one is within 30 % of it
        frame = StarFrame(Path(name), spots[:, :2], spots[:, 2], None)
        solution = solve_frame(frame, None, given, focal_error=0.3)
        if not solution.ok:
            unsolved.append(name)
            continue
        solved += 1
        off = abs(solution.focal_length_px / focal - 1.0) > 5e-3
        if "tetra3rs" in reference[name]:
            ra, dec = np.radians([reference[name]["tetra3rs"]["ra_deg"], reference[name]["tetra3rs"]["dec_deg"]])
            other = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
            off |= np.linalg.norm(solution.dcm_cam_from_icrs[2] - other) * focal > 1.5
        wrong += off
    whole, frames = count >= len(rows), min(count, len(rows))
    required = ">= 25" if whole else ""
    return {"frames": frames, "solved": solved, "wrong": int(wrong), "unsolved": unsolved}, [
        Bar("frames of other cameras wrong", f"{wrong} of {frames}", "0", wrong == 0),
        Bar("solved, focal length known to 30 %", f"{solved} of {frames}", required, solved >= 25 or not whole),
    ]


CAMPAIGNS = {
    "frames": (frames, 100_000),
    "edges": (edges, 10_000),
    "false": (false, 1_000_000),
    "patent": (patent, 1000),
    "blind": (blind, 2000),
    "hidden": (hidden, 300),
    "fold": (fold, 300),
    "pictures": (pictures, 200),
    "held": (held, 270),
}
"""Each with its full size."""


def run(name, count, seed, part, parts, out):
    """Run one campaign, print its bars, add a line to `out`; whether all are met."""
    began = time.perf_counter()
    figures, bars = CAMPAIGNS[name][0](count // parts, seed + 1000 * part)
    seconds = time.perf_counter() - began
    print(f"{name}: {count // parts} in {seconds:.0f} s")
    for bar in bars:
        verdict = "" if not bar.required else f"{bar.required:>12}  {'met' if bar.met else 'MISSED'}"
        print(f"  {bar.quantity:<62}{bar.measured:>34}{verdict}", flush=True)
    if out is not None:
        with out.open("a") as file:
            file.write(json.dumps(figures | {"campaign": name, "part": f"{part}/{parts}", "seconds": seconds}) + "\n")
    return all(bar.met for bar in bars)


def main() -> int:
    """Run one campaign or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", nargs="?", choices=CAMPAIGNS, help="all of them if left out")
    parser.add_argument("--count", type=int, help="frames of the one campaign")
    parser.add_argument("--full", action="store_true", help="the whole of what is run, instead of a tenth")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--part", default="1/1")
    parser.add_argument("--out", type=Path, help="add every campaign's figures to this file, a line of JSON each")
    options = parser.parse_args()
    if options.count is not None and options.campaign is None:
        parser.error("--count belongs to one campaign: name it")
    part, parts = (int(text) for text in options.part.split("/"))
    met = True
    for name, (_, full) in CAMPAIGNS.items():
        if options.campaign in (None, name):
            count = options.count or (full if options.full else full // 10)
            met &= run(name, count, options.seed, part, parts, options.out)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
