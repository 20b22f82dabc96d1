"""P3P beside OpenCV's and PoseLib's: the same views, one process; solutions found first, time second.

    pip install opencv-python-headless poselib
    python benchmarks/three_marker_p3p.py --views 100000 --out p3p.json

Every solver gets the same views, without noise. First comes what each finds: a view is missed if no solution lies
within 1e-6 (attitude rad, position / range) of the truth, and a solution is invalid if it does not reproject to 1e-6
rad. Then time, on views where all find the truth: thread CPU, median of interleaved rounds, with what it takes to read
rotation and position from the result. Only ratios mean anything on another machine.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
import poselib
from scipy.spatial.transform import Rotation

from relnav.codegen.kernel import kernel
from relnav.geometry.p3p import BLOCK, p3p, solve_p3p

MISS = 1e-6
ORACLE_VIEWS = 5000
TIMED_VIEWS = 400


def flat_triangle(radius=0.3):
    """Equilateral, facing the camera."""
    angle = np.radians([90.0, 210.0, 330.0])
    return radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)


T3 = np.array([[-0.3, 0.3, 0.0], [0.3, 0.3, 0.0], [0.0, 0.0, -0.3]])


def random_view(rng):
    """Any triangle in front, at any attitude."""
    while True:
        points, dcm = rng.normal(size=(3, 3)), Rotation.random(random_state=rng).as_matrix()
        position = np.array([*rng.uniform(-3.0, 3.0, 2), rng.uniform(2.0, 20.0)])
        if ((points @ dcm.T + position)[:, 2] > 0.1).all():
            return points, dcm, position


def docking_view(points, largest_deg, nearest_m, farthest_m):
    """A pattern seen at nearly its nominal attitude."""

    def view(rng):
        dcm = Rotation.from_rotvec(np.radians(largest_deg) * rng.uniform(-1.0, 1.0, 3)).as_matrix()
        r = rng.uniform(nearest_m, farthest_m)
        return points, dcm, np.array([*(0.05 * r * rng.uniform(-1.0, 1.0, 2)), r])

    return view


def symmetric_view(rng):
    """Exactly on the axis of an isosceles or equilateral pattern, rolled by any angle."""
    b, c, h, kind = rng.uniform(0.1, 0.6), rng.uniform(0.1, 0.6), rng.uniform(-0.5, 0.5), rng.integers(4)
    points = (
        np.array([[-b, c, 0.0], [b, c, 0.0], [0.0, 0.0, h]]),
        np.array([[-b, c, 0.0], [b, c, 0.0], [0.0, -c, h]]),
        np.array([[-b, 0.0, 0.0], [b, 0.0, 0.0], [0.0, 0.0, 0.6 + h]]),
        flat_triangle(b),
    )[kind]
    roll = Rotation.from_euler("z", rng.choice([0.0, 90.0, 180.0, rng.uniform(0.0, 360.0)]), degrees=True)
    return points, roll.as_matrix(), np.array([0.0, 0.0, rng.uniform(2.0, 100.0)])


SETS = {
    "random": random_view,
    "raised pattern, 1 to 30 m, 10 deg": docking_view(T3, 10.0, 1.0, 30.0),
    "flat pattern, 3 to 30 m, 10 deg": docking_view(flat_triangle(), 10.0, 3.0, 30.0),
    "flat pattern, 10 to 100 m, 2 deg": docking_view(flat_triangle(), 2.0, 10.0, 100.0),
    "exactly symmetric, on axis": symmetric_view,
}


def ours(rays, _image, points):
    """(rotation, position) pairs of this package."""
    return [(pose[:3], pose[3]) for pose in p3p(rays, points)]


def with_poselib(rays, _image, points):
    """PoseLib, read out."""
    return [(pose.R, pose.t) for pose in poselib.p3p(list(rays), list(points))]


def _with_opencv(flag):
    camera = np.eye(3)

    def solve(_rays, image, points):
        _, rotations, positions = cv2.solveP3P(points, image, camera, None, flags=flag)
        return [(cv2.Rodrigues(r)[0], t[:, 0]) for r, t in zip(rotations, positions, strict=True)]

    return solve


SOLVERS = {
    "relnav": ours,
    "poselib": with_poselib,
    "OpenCV P3P": _with_opencv(cv2.SOLVEPNP_P3P),
    "OpenCV AP3P": _with_opencv(cv2.SOLVEPNP_AP3P),
}


def views(name, count, seed):
    """(points, rays, normalised image, rotation, position) of a set."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        points, dcm, position = SETS[name](rng)
        p = points @ dcm.T + position
        yield points, p / np.linalg.norm(p, axis=1)[:, None], p[:, :2] / p[:, 2:], dcm, position


def judge(solutions, view):
    """Error of the solution nearest to the truth, and how many do not reproject."""
    points, rays, _, dcm, position = view
    best, invalid = np.inf, 0
    for rotation, place in solutions:
        if not (np.isfinite(rotation).all() and np.isfinite(place).all()):
            invalid += 1
            continue
        error = max(np.abs(rotation - dcm).max(), np.abs(place - position).max() / np.linalg.norm(position))
        best = min(best, error)
        p = points @ rotation.T + place
        invalid += bool(np.abs(p / np.linalg.norm(p, axis=1)[:, None] - rays).max() > MISS)
    return best, invalid


def completeness(name, count, seed):
    """What each solver finds of a set; ours on `count` views, the others on the first of them."""
    errors, invalid = {solver: [] for solver in SOLVERS}, dict.fromkeys(SOLVERS, 0)
    for k, view in enumerate(views(name, count, seed)):
        points, rays, image, _, _ = view
        for solver, function in SOLVERS.items():
            if solver != "relnav" and k >= ORACLE_VIEWS:
                continue
            error, bad = judge(function(rays, image, points), view)
            errors[solver].append(error)
            invalid[solver] += bad
    rows = []
    for solver, values in errors.items():
        values = np.array(values)
        found = values[values < MISS]
        rows.append(
            {
                "set": name, "solver": solver, "views": len(values), "missed": int((values >= MISS).sum()),
                "found_share": float((values < MISS).mean()), "found_share_same_views":
                float((values[:ORACLE_VIEWS] < MISS).mean()), "worst_of_found": float(found.max()),
                "p99_of_found": float(np.quantile(found, 0.99)), "invalid": invalid[solver],
            }
        )  # fmt: skip
    return rows


@kernel
def _loop(rays, points, poses, times):
    total = 0
    for k in range(times):
        total += solve_p3p(rays[k % rays.shape[0]], points[k % points.shape[0]], False, poses)
    return total


PLAIN = """
import sys, time
import numpy as np
from relnav.geometry.p3p import p3p
given = np.load(sys.argv[1])
views = list(zip(given["rays"], given["points"]))
began = time.thread_time_ns()
for rays, points in views:
    p3p(rays, points)
print((time.thread_time_ns() - began) / len(views) / 1000.0)
"""


def _plain_python(chosen):
    """Microseconds a call of the same lines uncompiled, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "views.npz"
        np.savez(path, rays=[view[0] for view in chosen], points=[view[2] for view in chosen])
        command = [sys.executable, "-c", PLAIN, str(path)]
        done = subprocess.run(command, check=True, capture_output=True, text=True, env=os.environ | {"RELNAV_JIT": "0"})
    return float(done.stdout)


def timing(rounds, seed):
    """Median microseconds a call of each solver, on views that all of them solve alike."""
    chosen = []
    for view in views("raised pattern, 1 to 30 m, 10 deg", 4 * TIMED_VIEWS, seed):
        points, rays, image, _, _ = view
        if all(judge(function(rays, image, points), view)[0] < MISS for function in SOLVERS.values()):
            chosen.append((rays, image, points))
    chosen = chosen[:TIMED_VIEWS]
    assert len(chosen) == TIMED_VIEWS, "the solvers do not agree on enough views to be compared"
    all_rays, all_points = np.array([view[0] for view in chosen]), np.array([view[2] for view in chosen])
    poses = np.empty((BLOCK, 4, 3))
    as_lists = [(list(rays), list(points)) for rays, _, points in chosen]
    camera = np.eye(3)

    def call_ours():
        for rays, _, points in chosen:
            p3p(rays, points)

    def call_poselib():
        for rays, points in as_lists:
            poselib.p3p(rays, points)

    def call_opencv(flag):
        for _, image, points in chosen:
            cv2.solveP3P(points, image, camera, None, flags=flag)

    entries = {
        "relnav, call": call_ours,
        "relnav, inside compiled code": lambda: _loop(all_rays, all_points, poses, TIMED_VIEWS),
        "poselib, call alone": call_poselib,
        "OpenCV P3P, call alone": lambda: call_opencv(cv2.SOLVEPNP_P3P),
        "OpenCV AP3P, call alone": lambda: call_opencv(cv2.SOLVEPNP_AP3P),
    }
    for name, function in SOLVERS.items():
        entries[f"{name}, call and read all poses"] = lambda f=function: [f(*view) for view in chosen]
    times = {name: [] for name in entries}
    for function in entries.values():
        function()
    for _ in range(rounds):
        for name, function in entries.items():
            began = time.thread_time_ns()
            function()
            times[name].append((time.thread_time_ns() - began) / TIMED_VIEWS / 1000.0)
    times["relnav, as plain Python"] = [_plain_python(chosen)]
    reference = statistics.median(times["relnav, call"])
    for name, values in times.items():
        if not name.startswith("relnav"):
            assert statistics.median(values) > reference, f"{name} is faster than a call of ours"
    return [
        {
            "name": name,
            "us_median": statistics.median(values),
            "over_relnav_call": statistics.median(values) / reference,
        }
        for name, values in times.items()
    ]


def main() -> None:
    """Count, compare, time, print, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", type=int, default=20000, help="random views for this package")
    parser.add_argument("--rounds", type=int, default=25)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    found = []
    print(f"{'set':<36}{'solver':<13}{'views':>8}{'missed':>8}{'worst found':>13}{'p99 found':>12}{'invalid':>9}")
    for name in SETS:
        count = {"random": options.views, "exactly symmetric, on axis": 600}.get(name, ORACLE_VIEWS)
        rows = completeness(name, count, options.seed)
        found += rows
        for row in rows:
            print(
                f"{row['set']:<36}{row['solver']:<13}{row['views']:>8}{row['missed']:>8}{row['worst_of_found']:>13.1e}"
                f"{row['p99_of_found']:>12.1e}{row['invalid']:>9}"
            )
        own = rows[0]
        assert own["missed"] == 0, f"{name}: {own['missed']} views missed"
        assert own["worst_of_found"] < 1e-8, f"{name}: worst error {own['worst_of_found']:.1e}"
        assert own["invalid"] == 0, f"{name}: {own['invalid']} solutions are none"
        for row in rows[1:]:
            assert own["found_share_same_views"] >= row["found_share"], f"{name}: {row['solver']} finds more"
    times = timing(options.rounds, options.seed)
    print(f"\n{'':<42}{'us, median':>12}{'over relnav, call':>20}")
    for row in times:
        print(f"{row['name']:<42}{row['us_median']:>12.2f}{row['over_relnav_call']:>20.2f}")
    if options.out is not None:
        options.out.write_text(json.dumps({"found": found, "times": times}, indent=2) + "\n")


if __name__ == "__main__":
    main()
