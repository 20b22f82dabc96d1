"""The start of the target-attitude filter where a target turns far between two measured attitudes.

The truth is scipy's, in inertial space; errors that last are drawn once a run.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import relnav
from relnav.estimation.consistency import chi_square_interval
from relnav.estimation.factored import compose
from relnav.navigation.attitude.target_attitude import METHODS

INERTIA = np.array([[3000.0, 150.0, -80.0], [150.0, 4200.0, 60.0], [-80.0, 60.0, 4700.0]])
RUNS = 60
WAITING = relnav.EpochStatus.WAITING


def tumbling(t, rng, rate_deg_s):
    """Attitudes (n, 3, 3) and rates (n, 3) of a free body in free space, of a rate about any axis."""
    axis = rng.normal(size=3)
    start = np.concatenate([Rotation.random(rng=rng).as_quat(), np.radians(rate_deg_s) * axis / np.linalg.norm(axis)])

    def derivative(_, x):
        v, s, w = x[:3], x[3], x[4:]
        torque = -np.cross(w, INERTIA @ w)
        return np.concatenate([0.5 * (s * w + np.cross(v, w)), [-0.5 * v @ w], np.linalg.solve(INERTIA, torque)])

    x = solve_ivp(derivative, (t[0], t[-1]), start, method="DOP853", t_eval=t, rtol=1e-10, atol=1e-12).y.T
    return Rotation.from_quat(x[:, :4]).as_matrix(), x[:, 4:]


def filter_of(told_deg_s, method="multiplicative", density=1e-14, chaser_deg=0.0):
    return relnav.TargetAttitude(
        INERTIA,
        0.0,
        rate_noise_density_rad2_s3=density,
        initial_rate_sigma_rad_s=np.radians(told_deg_s),
        method=method,
        chaser_attitude_sigma_rad=np.radians(chaser_deg),
    )


def flights(rate_deg_s, every_s, noise_deg, method="multiplicative", told_deg_s=None, chaser_deg=0.0, images=10):
    """Squares of errors by covariance, (runs, images), NaN while WAITING."""
    rng, out, sigma = np.random.default_rng(11), np.full((RUNS, images), np.nan), np.radians(noise_deg)
    t = every_s * np.arange(images, dtype=np.float64)
    for run in range(RUNS):
        dcm, rate = tumbling(t, rng, rate_deg_s)
        nav = filter_of(rate_deg_s if told_deg_s is None else told_deg_s, method, chaser_deg=chaser_deg)
        off = Rotation.from_rotvec(np.radians(chaser_deg) * rng.normal(size=3)).as_matrix()
        for k in range(images):
            chaser = Rotation.random(rng=rng).as_matrix()
            seen = chaser.T @ off @ chaser @ dcm[k] @ Rotation.from_rotvec(sigma * rng.normal(size=3)).as_matrix()
            record = nav.step(t[k], seen, sigma**2 * np.eye(3), dcm_chaser_from_lvlh=chaser)
            if record.status != WAITING:
                turn = Rotation.from_matrix(record.dcm_lvlh_from_target.T @ dcm[k]).as_rotvec()
                error = np.concatenate([turn, rate[k] - record.rate_rad_s])
                out[run, k] = error @ np.linalg.solve(record.covariance, error)
    return out


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("rate_deg_s", "every_s", "noise_deg"), [(5.0, 10.0, 0.5), (5.0, 10.0, 0.1), (25.0, 2.0, 0.5)])
def test_half_a_radian_and_more_between_two_attitudes(method, rate_deg_s, every_s, noise_deg):
    """50 deg of turn: started by the third attitude in all runs, NEES/6 as chance has it.

    Slopes at the rate that was told would be at the wrong place by then.
    """
    squares = flights(rate_deg_s, every_s, noise_deg, method)
    assert np.isfinite(squares[:, 2:]).all()
    low, high = chi_square_interval(6 * RUNS, 0.999)
    for mean in (squares[:, 2].mean(), squares[:, -1].mean()):
        assert low < mean / 6.0 < high


def test_a_rate_that_was_not_told():
    """Ten times what was told: three trials contradict it, then the rate counts as unknown, and the start is honest."""
    squares = flights(5.0, 10.0, 0.5, told_deg_s=0.5, images=12)
    low, high = chi_square_interval(6 * RUNS, 0.999)
    assert np.isfinite(squares[:, -1]).mean() > 0.95
    assert low < np.nanmean(squares[:, -1]) / 6.0 < high


def test_a_chaser_that_is_off():
    """By 1 deg in each run, and turned at each image: both attitudes are off, each in its own way."""
    squares = flights(5.0, 10.0, 0.3, chaser_deg=1.0)
    low, high = chi_square_interval(6 * RUNS, 0.999)
    assert np.isfinite(squares[:, 2:]).all()
    assert low < squares[:, 2].mean() / 6.0 < high


def test_without_noise_the_fit_is_the_truth():
    """A turn of 114 deg from rest: the rate to a part in a million, and the fit settles in a few steps."""
    t = np.array([0.0, 20.0])
    dcm, rate = tumbling(t, np.random.default_rng(3), 5.7)
    nav, noise = filter_of(3.0), 1e-12 * np.eye(3)
    for k in range(2):
        nav.step(t[k], dcm[k], noise)
    trial = nav.memory[0]["trial"]
    np.testing.assert_allclose(trial["rate"], rate[1], atol=1e-6 * np.radians(5.7))
    np.testing.assert_allclose(trial["dcm"], dcm[1], atol=1e-6)
    assert nav.memory[0]["agreed"] == 1


def test_an_attitude_that_contradicts_opens_another_trial():
    """Half a turn in a second, of a target that is told to turn slowly: a trial begins at the new attitude."""
    nav, noise = filter_of(0.1), np.radians(0.5) ** 2 * np.eye(3)
    nav.step(0.0, np.eye(3), noise)
    other = Rotation.from_rotvec([3.0, 0.0, 0.0]).as_matrix()
    assert nav.step(1.0, other, noise).status == WAITING
    m = nav.memory[0]
    assert m["opened_t"] == 1.0
    assert m["contradicted"] == 1
    np.testing.assert_array_equal(m["trial"]["dcm"], other)
    assert m["compared"]["nis"] > m["trial_gate"]


def test_a_body_whose_inertia_is_not_quite_known():
    """Of 4 % in each moment, drawn once a run: a turn of 50 deg between two attitudes, NEES/6 as chance has it."""
    rng, sigma, squares = np.random.default_rng(5), np.radians(0.05), np.empty(RUNS)
    moments_sigma = np.diag(0.04 * np.diag(INERTIA))
    for run in range(RUNS):
        told = INERTIA + np.diag(np.diag(moments_sigma) * rng.normal(size=3))
        nav = relnav.TargetAttitude(
            told,
            0.0,
            rate_noise_density_rad2_s3=1e-14,
            initial_rate_sigma_rad_s=np.radians(5.0),
            inertia_sigma_kg_m2=moments_sigma,
        )
        dcm, rate = tumbling(np.array([0.0, 10.0, 20.0]), rng, 5.0)
        for k in range(2):
            seen = dcm[k] @ Rotation.from_rotvec(sigma * rng.normal(size=3)).as_matrix()
            nav.step(10.0 * k, seen, sigma**2 * np.eye(3))
        trial = nav.memory[0]["trial"]
        turn = Rotation.from_matrix(trial["dcm"].T @ dcm[1]).as_rotvec()
        error = np.concatenate([turn, rate[1] - trial["rate"]])
        covariance = compose(trial["ld"]) + trial["lasting"] @ trial["lasting"].T
        squares[run] = error @ np.linalg.solve(covariance, error)
    low, high = chi_square_interval(6 * RUNS, 0.999)
    assert low < squares.mean() / 6.0 < high
