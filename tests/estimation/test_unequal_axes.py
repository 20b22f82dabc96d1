"""A measured attitude of which one axis is known far better than the others, as of markers in a plane."""

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.estimation.attitude import ATTITUDE_TRACK, COMPARED, LASTING, TURNING, compare_attitude
from relnav.estimation.consistency import chi_square_interval
from relnav.estimation.factored import compose, factorize

RUNS = 2000


def test_the_update_is_honest():
    """3, 0.03 and 3 deg measured of an attitude known to 2 deg: NEES/3 after it (2.8 without the turn), and NIS/3."""
    rng, prior = np.random.default_rng(7), np.radians(2.0)
    sigma = np.radians([3.0, 0.03, 3.0])
    noise, nees, nis = np.diag(sigma**2), np.empty(RUNS), np.empty(RUNS)
    track, out = np.zeros(1, ATTITUDE_TRACK)[0], np.zeros(1, COMPARED)[0]
    ld = factorize(np.diag(np.repeat([prior**2, 1e-6], 3)))
    for run in range(RUNS):
        estimate = Rotation.random(rng=rng)
        true = estimate * Rotation.from_rotvec(prior * rng.normal(size=3))
        seen = true * Rotation.from_rotvec(sigma * rng.normal(size=3))
        track["dcm"], track["ld"] = estimate.as_matrix(), ld
        compare_attitude(track, seen.as_matrix(), noise, np.zeros((3, LASTING)), out, np.zeros((14, TURNING))[:, :3])
        error = Rotation.from_matrix(out["track"]["dcm"].T @ true.as_matrix()).as_rotvec()
        nees[run] = error @ np.linalg.solve(compose(out["track"]["ld"])[:3, :3], error)
        nis[run] = out["nis"]
    low, high = chi_square_interval(3 * RUNS, 0.9999)
    assert low < nees.mean() / 3.0 < high
    assert low < nis.mean() / 3.0 < high
