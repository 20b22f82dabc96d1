"""The target's attitude and rate: gain over the raw attitude, honesty, steady state, traps of a UKF on angles."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.accuracy.target_attitude import attitude_trials
from relnav.estimation.attitude import settled_sigmas
from relnav.estimation.unscented_attitude import (
    UnscentedAttitude,
    body_turn_of_angles,
    dcm_from_euler,
    euler_from_dcm,
)
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.mission import Orbit
from relnav.navigation.target_attitude import METHODS, TargetAttitude
from relnav.simulation.target_rotation import rotate_target

N = 1.1313666536110223e-3
INERTIA = np.diag([3000.0, 4200.0, 4700.0])
FINE = math.radians(0.2)
SIGMA, DENSITY = math.radians(0.5), (2e-6) ** 2


@pytest.fixture(scope="module")
def trials():
    """The issue's case, both filters on the same eight runs."""
    common = {"sigma_rad": SIGMA, "rate_hz": 10.0, "density_rad2_s3": DENSITY, "seed": 5}
    return {
        method: attitude_trials(INERTIA, N, runs=8, duration_s=160.0, method=method, **common) for method in METHODS
    }


@pytest.mark.parametrize("method", METHODS)
def test_the_filter_gains_fifteenfold(trials, method):
    assert trials[method].gain >= 15.0


@pytest.mark.parametrize("method", METHODS)
def test_honest_innovations(trials, method):
    """38,400 of one degree of freedom: 0.05 is 5 sigma."""
    assert 0.95 <= trials[method].nis_ratio <= 1.05


@pytest.mark.parametrize("method", METHODS)
def test_honest_errors(trials, method):
    """Errors 40 s apart are independent: about a hundred of one degree of freedom, 0.2 is 1.4 sigma of their mean."""
    assert 0.8 <= trials[method].nees_ratio <= 1.2


@pytest.mark.parametrize("method", METHODS)
def test_it_settles_where_the_closed_form_says(trials, method):
    attitude, rate = settled_sigmas(SIGMA, 0.1, DENSITY)
    assert trials[method].sigma_rad == pytest.approx(attitude, rel=0.02)
    assert trials[method].sigma_rate_rad_s == pytest.approx(rate, rel=0.02)
    assert trials[method].attitude_rms_rad == pytest.approx(attitude, rel=0.10)
    assert trials[method].rate_rms_rad_s == pytest.approx(rate, rel=0.10)


def test_the_unscented_filter_buys_nothing(trials):
    one, other = trials["multiplicative"], trials["unscented"]
    assert other.raw_rms_rad == one.raw_rms_rad
    assert other.attitude_rms_rad == pytest.approx(one.attitude_rms_rad, rel=0.01)
    assert other.rate_rms_rad_s == pytest.approx(one.rate_rms_rad_s, rel=0.01)
    assert other.nees_ratio == pytest.approx(one.nees_ratio, rel=0.02)


def flight(method, pitch_deg, spin_deg_s, seed=1, seconds=60.0, sigma=FINE):
    """Final attitude error in rad, mean NIS / 3 and records of one flight."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.5)
    start = Rotation.from_euler("ZYX", [170.0, pitch_deg, 30.0], degrees=True)
    w = np.radians([spin_deg_s])
    dcm, _ = rotate_target(t, [start.as_quat()], w, INERTIA, Orbit(N), DENSITY, rng)
    nav = TargetAttitude(
        INERTIA, N, rate_noise_density_rad2_s3=DENSITY, initial_rate_sigma_rad_s=math.radians(2.0), method=method
    )
    records = []
    for k, now in enumerate(t):
        measured = dcm[k, 0] @ Rotation.from_rotvec(sigma * rng.normal(size=3)).as_matrix()
        records.append(nav.step(now, measured, sigma**2 * np.eye(3)))
    error = rotation_vector_between(dcm[-1, 0], records[-1].dcm_lvlh_from_target)
    return float(np.linalg.norm(error)), float(np.nanmean([r.nis for r in records])) / 3.0, records


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("pitch", "spin"), [(0.0, [0, 0, 1.5]), (70.0, [0, 1.0, 0]), (-60.0, [0.3, -1.0, 0.5])])
def test_angles_that_wrap_and_the_pole(method, pitch, spin):
    """Yaw goes through 180 deg, pitch over 90 deg: a UKF that averages angles plainly is off by tens of degrees."""
    error, nis, _ = flight(method, pitch, spin)
    assert error < math.radians(0.25)
    assert 0.8 < nis < 1.2


def test_both_filters_agree():
    one, other = (flight(method, 20.0, [0.2, 0.3, -0.4])[2][-1] for method in METHODS)
    turn = rotation_vector_between(one.dcm_lvlh_from_target, other.dcm_lvlh_from_target)
    assert np.linalg.norm(turn) < 0.05 * math.sqrt(np.trace(one.covariance[:3, :3]))
    np.testing.assert_allclose(np.diag(one.covariance), np.diag(other.covariance), rtol=0.02)


def test_two_updates_without_a_step_between():
    """In filterpy an update keeps the sigma points of the last prediction; used twice they make a variance negative."""
    P = np.diag([0.01] * 3 + [1e-6] * 3)
    track = UnscentedAttitude(np.eye(3), np.zeros(3), P, lambda dcm, rate, _: (dcm, rate))
    for _ in range(2):
        track.measurement_update(np.eye(3), 0.01 * np.eye(3))
    np.testing.assert_allclose(np.diag(track.covariance)[:3], 0.01 / 3.0, rtol=1e-9)


def test_before_the_first_prediction_an_update_counts():
    track = UnscentedAttitude(np.eye(3), np.zeros(3), np.diag([0.01] * 3 + [1e-6] * 3), lambda d, w, _: (d, w))
    track.measurement_update(Rotation.from_rotvec([0.02, 0.0, 0.0]).as_matrix(), 0.01 * np.eye(3))
    assert rotation_vector_between(track.dcm, np.eye(3))[0] == pytest.approx(0.01, rel=1e-6)


def test_euler_angles():
    rng = np.random.default_rng(8)
    for turn in Rotation.random(20, rng=rng):
        angles = euler_from_dcm(turn.as_matrix())
        np.testing.assert_allclose(angles[::-1], turn.as_euler("ZYX"), atol=1e-9)
        np.testing.assert_allclose(dcm_from_euler(angles), turn.as_matrix(), atol=1e-12)
        for i in range(3):
            step = np.zeros(3)
            step[i] = 1e-6
            moved = rotation_vector_between(dcm_from_euler(angles + step), dcm_from_euler(angles - step)) / 2e-6
            np.testing.assert_allclose(moved, body_turn_of_angles(angles)[:, i], atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_gaps_and_outliers(method):
    nav = TargetAttitude(INERTIA, N, rate_noise_density_rad2_s3=DENSITY, initial_rate_sigma_rad_s=1e-3, method=method)
    empty = nav.step(0.0)
    assert np.isnan(empty.covariance).all()
    assert not empty.accepted
    noise = SIGMA**2 * np.eye(3)
    assert nav.step(1.0, np.eye(3), noise).accepted
    gap = nav.step(3.0, np.full((3, 3), np.nan), noise)
    assert not gap.accepted
    assert gap.dof == 0
    wrong = nav.step(4.0, Rotation.from_rotvec([0.5, 0.0, 0.0]).as_matrix(), noise)
    assert not wrong.accepted
    assert wrong.nis > 100.0
    assert np.linalg.eigvalsh(nav.step(5.0, np.eye(3), noise).covariance)[0] > 0.0


def test_wrong_use():
    make = {"rate_noise_density_rad2_s3": DENSITY, "initial_rate_sigma_rad_s": 1e-3}
    with pytest.raises(ValueError, match='method must be "multiplicative" or "unscented"'):
        TargetAttitude(INERTIA, N, **make, method="ukf")
    with pytest.raises(ValueError, match="initial_rate_sigma_rad_s"):
        TargetAttitude(INERTIA, N, **make | {"initial_rate_sigma_rad_s": 0.0})
    nav = TargetAttitude(INERTIA, N, **make)
    nav.step(1.0, np.eye(3), np.eye(3))
    with pytest.raises(ValueError, match="not before the last epoch"):
        nav.step(0.5)
    with pytest.raises(ValueError, match="must be a rotation matrix"):
        nav.step(2.0, 2.0 * np.eye(3), np.eye(3))
    with pytest.raises(ValueError, match="positive definite covariance"):
        nav.step(2.0, np.eye(3))
