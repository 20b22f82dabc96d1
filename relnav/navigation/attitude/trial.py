"""A trial of the target-attitude filter: an attitude, and the next one fitted together with it.

What is known of the rate at first may leave half a turn between two measured attitudes. A filter that predicts across
it with the rate that was told has its slopes at the wrong place, and says too small an error of the rate. So the state
at the first attitude is fitted to both, slopes and all, by steps of Gauss and Newton: the most likely x with

    |x - x_told|^2 by P + |log(C(x)^T Z)|^2 by R,   C(x): the attitude that x leads to, Z: the second one

about which all is linear enough: P is carried on with the slopes there, process noise included, and the second attitude
updates it (the iterated filter of Bell and Cathey 1993, over a step of time). What that still moves is small.
"""

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.dynamics.rigid_body import FRAME_RATE, ORBIT, lvlh_rate, propagate_into
from relnav.estimation.attitude import CHASER, TURNING, joseph
from relnav.estimation.factored import compose, factorize
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.navigation.attitude.prediction import carry_trial

UNKNOWN_TURN_RAD = 0.5
"""1-sigma of the turn from one measured attitude to the next, where nothing is known of the rate."""
LARGEST_RATE_SIGMA_RAD_S = 1.0
MOST_STEPS = 20
"""Of the fit: four or five suffice across a turn of 50 deg; what has not settled by then has no one answer."""
SETTLED_RAD = 1e-9
"""Far below any noise, and above rounding: the last step squares what is left."""


def open_trial(memory: Record, measured: Matrix, noise: Matrix, chaser: Matrix, interval_s: float) -> None:
    """Begin a trial at a measured attitude, the last one having come interval_s before.

    memory (1,) of type `prediction.MEMORY`, here and below; chaser (3, 3) is dcm_chaser_from_lvlh.
    """
    m = memory[0]
    trial, sigma = m["trial"], m["rate_sigma"]
    if (m["rate_unknown"] or m["running"]) and interval_s > 0.0:
        sigma = max(sigma, min(LARGEST_RATE_SIGMA_RAD_S, UNKNOWN_TURN_RAD / interval_s))
    covariance = sigma**2 * np.eye(TURNING)
    covariance[:3, :3] = noise
    trial["dcm"], trial["rate"] = measured, lvlh_rate(measured, m["body"][ORBIT, FRAME_RATE])
    trial["ld"], trial["lasting"] = factorize(covariance), 0.0
    trial["lasting"][:3, CHASER] = m["chaser_sigma"] * (chaser @ measured).T
    m["has_trial"], m["agreed"], m["chance"] = 1, 0, 1.0
    m["opened"], m["opened_t"] = trial, m["t"]


def fit_trial(memory: Record, measured: Matrix, noise: Matrix, chaser: Matrix) -> bool:
    """Fit the trial to the attitude that it began with and to one measured now; whether they agree.

    What was compared stands in `compared`.
    """
    m = memory[0]
    opened, trial, compared, dt = m["opened"], m["trial"], m["compared"], float(m["t"] - m["opened_t"])
    fitted = _most_likely(m, measured, noise, dt)
    if fitted is None:
        return False
    trial["dcm"], trial["rate"], told = fitted
    trial["ld"], trial["lasting"] = opened["ld"], opened["lasting"]
    if not carry_trial(memory, dt):
        return False
    p, lasting, dcm = compose(trial["ld"]), trial["lasting"].copy(), trial["dcm"].copy()
    seen = lasting[:3].copy()
    seen[:, CHASER] -= m["chaser_sigma"] * (chaser @ dcm).T
    innovation = rotation_vector_between(measured, dcm) - told[:3]
    spread = p[:3, :3] + seen @ seen.T + noise
    gain = np.linalg.solve(spread, (p[:, :3] + lasting @ seen.T).T).T
    correction = told + gain @ innovation
    trial["dcm"], trial["rate"] = turned(dcm, correction[:3]), trial["rate"] + correction[3:]
    trial["ld"] = factorize(joseph(p, gain, np.eye(3, TURNING), noise))
    trial["lasting"] = lasting - gain @ seen
    compared["track"], compared["innovation"], compared["innovation_covariance"] = trial, innovation, spread
    compared["correction"], compared["nis"] = correction, innovation @ np.linalg.solve(spread, innovation)
    return bool(compared["nis"] <= m["trial_gate"])


def _most_likely(m: Record, measured: Matrix, noise: Matrix, dt: float) -> tuple[Matrix, Vector, Vector] | None:
    """Attitude and rate at the beginning, dt ago, and what was told of them less that, (6,), carried to now."""
    opened, body, density, work = m["opened"], m["body"], float(m["density"]), m["work"]
    p, dcm, rate, told = compose(opened["ld"]), opened["dcm"].copy(), opened["rate"].copy(), np.zeros(TURNING)
    for _ in range(MOST_STEPS):
        then, spin, phi, q = dcm.copy(), rate.copy(), np.empty((TURNING, TURNING)), np.empty((TURNING, TURNING))
        if not propagate_into(body, dt, then, spin, density, phi, q, work):
            return None
        carried = p @ phi[:3].T
        spread = phi[:3] @ carried + noise
        left = rotation_vector_between(measured, then) - phi[:3] @ told
        step = told + carried @ np.linalg.solve(spread, left)
        if max(np.abs(step[:3]).max(), np.abs(step[3:]).max() * dt) < SETTLED_RAD:
            return dcm, rate, phi @ told
        dcm, rate = turned(dcm, step[:3]), rate + step[3:]
        told = np.concatenate([rotation_vector_between(opened["dcm"], dcm), opened["rate"] - rate])
    return None
