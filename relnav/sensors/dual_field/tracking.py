"""Attitude from a frame when a prior attitude is at hand: two stars are enough, and no pair is looked up."""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.sensors.dual_field.attitude_fit import fit_attitude, forget_slip
from relnav.sensors.dual_field.evidence import FOLD_CHI2, fold_distance2
from relnav.sensors.dual_field.identify import OFF_FOLD_REASON, make_frame, solution_of
from relnav.sensors.dual_field.matching import match_tightly
from relnav.sensors.dual_field.search import WORK_ROWS, count_stars, log_false_alarm
from relnav.sensors.dual_field.sky import Sky
from relnav.sensors.dual_field.solution import StarSolution, StarStatus, no_solution

LEAST_STARS = 2
WIDEST_PRIOR_RAD = 3e-3 / 5.0
"""Five sigma of the prior may not reach farther than the loosest tolerance of a match."""


def track_rays(
    u: Matrix,
    sky: Sky,
    dcm_prior: Matrix,
    sigma_prior_rad: float,
    *,
    sigma_rad: Vector,
    magnitude: Vector | None = None,
    gate: float = 0.6,
    fold: Matrix | None = None,
    fold_covariance: Matrix | None = None,
    velocity_km_s: Vector | None = None,
    false_alarm_probability: float = 1e-7,
) -> StarSolution:
    """Attitude near a prior one; arguments as in `identify`.

    Parameters
    ----------
    dcm_prior : (3, 3)
        Predicted dcm_cam_from_icrs.
    sigma_prior_rad : float
        Its 1-sigma about each axis, at most `WIDEST_PRIOR_RAD` (124 arcsec); the result does not lean on it: the prior
        only says where to look.

    Notes
    -----
    Stars are believed when chance would not put as many within the prior's reach; fewer than two, or a pair that chance
    might make, is TOO_FEW or NO_MATCH, and the caller may go on lost in space.
    """
    n = len(u)
    if n < LEAST_STARS:
        return no_solution(StarStatus.TOO_FEW, f"{n} spots; {LEAST_STARS} or more are needed", n)
    frame = make_frame(u, sigma_rad, magnitude, gate, fold, velocity_km_s, fold_covariance)
    count_stars(frame, sky.arrays)
    A, cov = dcm_prior.copy(), np.eye(3) * sigma_prior_rad**2
    forget_slip(frame, cov)
    match, work, out = np.empty((n, 2), dtype=np.int64), np.empty((WORK_ROWS, 3)), np.empty(3)
    found = match_tightly(frame, sky.arrays, -1, -1, A, cov, match, out)
    first_chance = float(out[0])
    if found >= LEAST_STARS and fit_attitude(frame, sky.arrays, match, A, cov, 2, work[0]):
        found = match_tightly(frame, sky.arrays, -1, -1, A, cov, match, out)
    chance = min(first_chance, float(out[0]))
    log = log_false_alarm(1.0, n + 2, min(found, n), chance)
    if found < LEAST_STARS or log >= math.log(false_alarm_probability):
        return no_solution(
            StarStatus.NO_MATCH,
            f"{found} spots fall on stars near the prior attitude: chance might do as much",
            n,
            tried=1,
        )
    if not fit_attitude(frame, sky.arrays, match, A, cov, 2, work[0]):
        return no_solution(StarStatus.NO_MATCH, "the stars found lie along one line", n, tried=1)
    if fold_distance2(frame) > FOLD_CHI2:
        return no_solution(StarStatus.NO_MATCH, OFF_FOLD_REASON, n, tried=1)
    return solution_of(frame, sky, match, A, cov, np.array([log, 1.0]))
