"""Frames of cameras of many kinds through the solver that knows only a focal length, and that wrong by some percent."""

import time

import numpy as np

from relnav.arrays import Flags, Matrix, Vector
from relnav.sensors.dual_field.blind import Blind, solve_blind
from relnav.sensors.dual_field.catalogue import StarCatalogue
from relnav.sensors.dual_field.optics import plane_points, project, rays
from relnav.simulation.star_field import random_attitude

WIDTHS_DEG = (5.0, 6.0, 8.0, 11.4, 15.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0)
HEIGHTS_PX = (576.0, 768.0, 1024.0)
WIDTH_PX = 1024.0
KINDS = ("true", "true", "true", "false spots", "mirrored", "scrambled")
FOCAL_ERROR = 0.03
WRONG_PX, HIDDEN_WRONG_PX = 3.0, 15.0
LEAST_IN_SIGHT = 14
EPOCH_JYEAR = 2020.0
REFUSAL_GOAL_S = 0.3
"""Processor time within which a frame that cannot be solved should be refused."""


def fly_blind(catalogue: StarCatalogue, count: int, seed: int) -> dict[str, float]:
    """Solve `count` frames with a focal length up to 3 % wrong, no distortion known; how many came out how.

    Cameras: 5 to 90 deg wide, radial distortion up to 15 %, principal point off by 8 px, centroids of 0.1 to 0.5 px,
    0 to 8 false spots, up to 30 % of stars missing, magnitudes off by up to 0.6. Half of the frames are true ones; the
    others are false spots alone, mirrored, or have two quarters of the image swapped in x and y. "wrong" counts
    attitudes more than 3 px off at the image's centre, and every attitude of false spots or of a mirrored frame.
    Processor time of what was refused stands beside it (median, most, how many took more than `REFUSAL_GOAL_S`), and
    that of solving a true frame, or of refusing one, once more.
    """
    rng = np.random.default_rng(seed)
    directions, magnitude = catalogue.directions(EPOCH_JYEAR), np.asarray(catalogue.hp_mag, dtype=np.float64)
    result: dict[str, float] = {"frames": 0, "true_frames": 0, "solved": 0, "refused": 0, "wrong": 0}
    refusals_s, again_s, refused_again_s = [0.0], [0.0], [0.0]
    while result["frames"] < count:
        kind = str(rng.choice(KINDS))
        spots, mag, focal, at_centre, _ = _frame(rng, directions, magnitude, kind)
        if len(spots) < 8:
            continue
        given = focal * (1.0 + rng.uniform(-FOCAL_ERROR, FOCAL_ERROR))
        blind, began = Blind(spots, mag if rng.random() < 0.7 else None, given), time.process_time()
        solution = solve_blind(blind, catalogue, EPOCH_JYEAR)
        result["frames"] += 1
        result["true_frames"] += kind == "true"
        if not solution.ok:
            result["refused"] += kind == "true"
            refusals_s.append(time.process_time() - began)
            refused_again_s.append(_time_of(blind, catalogue))
            continue
        off_px = focal * float(np.linalg.norm(solution.dcm_cam_from_icrs[2] - at_centre))
        close = off_px < WRONG_PX and abs(solution.focal_length_px / focal - 1.0) < 0.02
        if kind in ("false spots", "mirrored") or not close:
            result["wrong"] += 1
        elif kind == "true":
            result["solved"] += 1
            again_s.append(_time_of(blind, catalogue))
    result["again_s_median"] = float(np.median(again_s))
    result |= {"refusal_s_median": float(np.median(refusals_s)), "refusal_s_most": max(refusals_s)}
    result |= {"refusals": len(refusals_s) - 1, "refused_late": int(np.sum(np.array(refusals_s) > REFUSAL_GOAL_S))}
    result |= {
        "refusal_again_s_median": float(np.median(refused_again_s)),
        "refusal_again_s_most": max(refused_again_s),
    }
    return result


def _time_of(blind: Blind, catalogue: StarCatalogue) -> float:
    """Processor time of one frame."""
    began = time.process_time()
    solve_blind(blind, catalogue, EPOCH_JYEAR)
    return time.process_time() - began


def _frame(
    rng: np.random.Generator, directions: Matrix, magnitude: Vector, kind: str
) -> tuple[Matrix, Vector, float, Vector, Flags]:
    """Spots (n, 2) px, magnitudes, focal length px, the centre's true direction (3,), and which spots are stars."""
    width = np.radians(rng.choice(WIDTHS_DEG))
    size = np.array([WIDTH_PX, rng.choice(HEIGHTS_PX)])
    focal = 0.5 * WIDTH_PX / np.tan(0.5 * width)
    k1 = rng.uniform(-0.15, 0.15) if width < 0.5 else rng.uniform(-0.1, 0.05)
    principal, A = rng.normal(size=2) * 8.0, random_attitude(rng)
    seen = directions @ A.T
    front = np.flatnonzero(seen[:, 2] > np.cos(width))
    spots = project(seen[front], focal, principal, (k1, 0.0))
    mag = magnitude[front] + rng.normal(size=len(front)) * rng.choice([0.1, 0.3, 0.6])
    inside = np.all(np.abs(spots) < 0.5 * size, axis=1) & (rng.random(len(front)) > rng.choice([0.0, 0.1, 0.3]))
    spots, mag = spots[inside], mag[inside]
    order = np.argsort(mag)[: rng.choice([12, 20, 40, 80])]
    spots, mag = spots[order] + rng.normal(size=(len(order), 2)) * rng.choice([0.1, 0.2, 0.5]), mag[order]
    false, stars = int(rng.choice([0, 3, 8])), len(mag)
    if len(mag):
        spots = np.concatenate([spots, (rng.random((false, 2)) - 0.5) * size])
        mag = np.concatenate([mag, rng.uniform(mag.min(), mag.max(), false)])
    if kind == "false spots":
        spots = (rng.random(spots.shape) - 0.5) * size
    elif kind == "mirrored":
        spots = spots * (-1.0, 1.0)
    elif kind == "scrambled":
        spots = np.where((spots[:, :1] > 0.0) == (spots[:, 1:] > 0.0), spots, spots[:, ::-1])
    order = np.argsort(mag)
    at_centre = rays(plane_points(np.zeros((1, 2)), focal, principal, (k1, 0.0)))[0] @ A
    return spots[order], mag[order], float(focal), at_centre, order < stars


def fly_hidden(catalogue: StarCatalogue, count: int, seed: int, lights: int) -> dict[str, int]:
    """Solve `count` frames of the same cameras of which a roof hides about half, with so many lights on it.

    Fourteen true stars or more are left, and a focal length up to 3 % wrong is given. "wrong" counts attitudes
    more than `HIDDEN_WRONG_PX` off at the image's centre, which the roof may hide.
    """
    rng = np.random.default_rng(seed)
    directions, magnitude = catalogue.directions(EPOCH_JYEAR), np.asarray(catalogue.hp_mag, dtype=np.float64)
    result = {"frames": 0, "lights": lights, "solved": 0, "wrong": 0}
    while result["frames"] < count:
        spots, mag, focal, at_centre, is_star = _frame(rng, directions, magnitude, "true")
        angle = rng.uniform(0.0, 2.0 * np.pi)
        up, edge = np.array([np.cos(angle), np.sin(angle)]), rng.uniform(-50.0, 100.0)
        sky = spots @ up > edge
        if np.sum(sky & is_star) < LEAST_IN_SIGHT:
            continue
        roof = (rng.random((1000, 2)) - 0.5) * (WIDTH_PX, min(HEIGHTS_PX))
        roof = roof[roof @ up < edge][:lights]
        spots = np.concatenate([spots[sky], roof])
        mag = np.concatenate([mag[sky], rng.uniform(mag.min() - 1.0, mag.max(), len(roof))])
        order, given = np.argsort(mag), focal * (1.0 + rng.uniform(-FOCAL_ERROR, FOCAL_ERROR))
        known = mag[order] if rng.random() < 0.7 else None
        solution = solve_blind(Blind(spots[order], known, given), catalogue, EPOCH_JYEAR)
        result["frames"] += 1
        if solution.ok:
            off_px = focal * float(np.linalg.norm(solution.dcm_cam_from_icrs[2] - at_centre))
            right = off_px < HIDDEN_WRONG_PX and abs(solution.focal_length_px / focal - 1.0) < 0.02
            result["solved" if right else "wrong"] += 1
    return result
