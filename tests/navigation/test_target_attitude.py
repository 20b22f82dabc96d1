"""The target's attitude and rate: gain over the raw attitude, honesty, steady state, what becomes of each epoch."""

import copy
import math
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.accuracy.target_attitude import attitude_trials
from relnav.estimation.attitude import settled_sigmas
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.mission import Orbit
from relnav.navigation.attitude.target_attitude import METHODS, TargetAttitude
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


def names(records):
    return [record.status.name for record in records]


def still(method="multiplicative", **other):
    """A filter of a target at rest."""
    settings = {"rate_noise_density_rad2_s3": DENSITY, "initial_rate_sigma_rad_s": 1e-3, "method": method}
    return TargetAttitude(INERTIA, N, **settings | other)


NOISE = SIGMA**2 * np.eye(3)
WRONG = Rotation.from_rotvec([0.5, 0.0, 0.0]).as_matrix()


@pytest.mark.parametrize("method", METHODS)
def test_a_start_needs_two_attitudes_that_agree(method):
    nav = still(method)
    records = [nav.step(0.0), nav.step(1.0, WRONG, NOISE), nav.step(2.0, np.eye(3), NOISE), nav.step(3.0)]
    assert names(records) == ["WAITING"] * 4
    assert not any(record.accepted for record in records)
    for record in records:
        assert np.isnan(record.covariance).all()
        assert np.isnan(record.dcm_lvlh_from_target).all()
        assert record.dof == 0
    started = nav.step(4.0, np.eye(3), NOISE)
    assert started.status == relnav.EpochStatus.STARTED
    assert started.accepted
    assert started.dof == 3
    np.testing.assert_allclose(started.dcm_lvlh_from_target, np.eye(3), atol=0.01)


@pytest.mark.parametrize("method", METHODS)
def test_gaps_and_outliers(method):
    nav = still(method)
    for k in range(2):
        nav.step(0.1 * k, np.eye(3), NOISE)
    gap = nav.step(3.0, np.full((3, 3), np.nan), NOISE)
    assert (gap.status.name, gap.accepted, gap.dof, gap.rejections) == ("PREDICTED", False, 0, 0)
    wrong = nav.step(4.0, WRONG, NOISE)
    assert (wrong.status.name, wrong.accepted, wrong.dof, wrong.rejections) == ("REJECTED", False, 3, 1)
    assert wrong.nis > 100.0
    later = nav.step(4.5)
    assert (later.status.name, later.accepted, later.dof, later.rejections) == ("REJECTED", False, 0, 1)
    good = nav.step(5.0, np.eye(3), NOISE)
    assert (good.status.name, good.accepted, good.rejections) == ("UPDATED", True, 0)
    assert np.linalg.eigvalsh(good.covariance)[0] > 0.0


@pytest.mark.parametrize("method", METHODS)
def test_a_track_that_is_contradicted_is_replaced(method):
    """By the eighth attitude that disagrees with it and agrees with the others; seven do not."""
    nav = still(method)
    for k in range(20):
        nav.step(0.1 * k, np.eye(3), NOISE)
    records = [nav.step(2.0 + 0.1 * k, WRONG, NOISE) for k in range(7)]
    assert names(records) == ["REJECTED"] * 7
    kept = copy.deepcopy(nav)
    assert kept.step(2.8, np.eye(3), NOISE).status == relnav.EpochStatus.UPDATED
    record = nav.step(2.8, WRONG, NOISE)
    assert (record.status.name, record.rejections) == ("STARTED", 0)
    np.testing.assert_allclose(record.dcm_lvlh_from_target, WRONG, atol=0.01)


@pytest.mark.parametrize("method", METHODS)
def test_a_filter_is_copied_pickled_and_restored(method):
    rng, nav = np.random.default_rng(7), still(method, inertia_sigma_kg_m2=0.05 * INERTIA)
    seen = Rotation.from_rotvec(SIGMA * rng.normal(size=(60, 3))).as_matrix()
    seen[25:30] = WRONG
    for k in range(28):
        nav.step(0.1 * k, seen[k], NOISE)
    kept, others = nav.memory.copy(), [copy.deepcopy(nav), copy.copy(pickle.loads(pickle.dumps(nav)))]
    expected = [nav.step(0.1 * k, seen[k], NOISE) for k in range(28, 60)]
    nav.memory[:] = kept
    for again in (nav, *others):
        for k, record in zip(range(28, 60), expected, strict=True):
            other = again.step(0.1 * k, seen[k], NOISE)
            np.testing.assert_array_equal(other.covariance, record.covariance)
            np.testing.assert_array_equal(other.dcm_lvlh_from_target, record.dcm_lvlh_from_target)
            assert other.status == record.status
    loaded = pickle.loads(pickle.dumps(expected[-1]))
    np.testing.assert_array_equal(loaded.covariance, expected[-1].covariance)
    with pytest.raises(ValueError, match="read-only"):
        expected[-1].covariance[0, 0] = 0.0


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((0.5,), "not before the last epoch"),
        ((math.nan,), "t_s must be finite"),
        ((2.0, np.eye(2), NOISE), r"shape \(3, 3\); got \(2, 2\)"),
        ((2.0, 2.0 * np.eye(3), NOISE), "must be a rotation matrix"),
        ((2.0, np.eye(3)), "covariance_rad2 is missing"),
        ((2.0, np.eye(3), np.eye(2)), r"covariance_rad2 has shape"),
        ((2.0, np.eye(3), np.full((3, 3), np.nan)), "finite and symmetric"),
        ((2.0, np.eye(3), NOISE + np.triu(NOISE[0, 0] * np.ones((3, 3)), 1)), "finite and symmetric"),
        ((2.0, np.eye(3), np.diag([1.0, 1.0, -1e-9])), "positive definite"),
        ((2.0, np.eye(3), np.ones((3, 3))), "positive definite"),
    ],
)
def test_a_refused_call_leaves_the_filter_as_it_was(arguments, text):
    nav = still()
    for k in range(3):
        nav.step(0.5 * k, np.eye(3), NOISE)
    before = nav.memory.copy()
    with pytest.raises(ValueError, match=text):
        nav.step(*arguments)
    assert nav.memory.tobytes() == before.tobytes()


def test_wrong_use():
    for wrong, text in [
        ({"method": "ukf"}, 'method must be "multiplicative" or "unscented"'),
        ({"initial_rate_sigma_rad_s": 0.0}, "initial_rate_sigma_rad_s"),
        ({"rate_noise_density_rad2_s3": -1.0}, "rate_noise_density_rad2_s3"),
        ({"chaser_attitude_sigma_rad": math.nan}, "chaser_attitude_sigma_rad"),
        ({"restart_after": 0}, "restart_after must be 1 or more"),
        ({"inertia_sigma_kg_m2": np.ones(3)}, "inertia_sigma_kg_m2 has shape"),
        ({"inertia_sigma_kg_m2": np.triu(np.ones((3, 3)))}, "symmetric and nowhere below zero"),
    ]:
        with pytest.raises(ValueError, match=text):
            still(**wrong)
    nav = still(chaser_attitude_sigma_rad=1e-3)
    with pytest.raises(ValueError, match="comes with dcm_chaser_from_lvlh"):
        nav.step(0.0, np.eye(3), NOISE)
    with pytest.raises(ValueError, match="dcm_chaser_from_lvlh must be a rotation"):
        nav.step(0.0, np.eye(3), NOISE, dcm_chaser_from_lvlh=np.ones((3, 3)))


def test_arrays_of_any_layout_give_the_same_bits_and_are_not_kept():
    """Fortran order, read-only, lists: no second copy is compiled, and the caller's arrays stay the caller's."""
    plain, other = still(), still()
    turn = Rotation.from_rotvec([0.001, 0.002, 0.003]).as_matrix()
    for k in range(6):
        fortran = np.asfortranarray(turn)
        fortran.setflags(write=False)
        record = plain.step(0.1 * k, turn, NOISE)
        again = other.step(0.1 * k, fortran if k % 2 else turn.tolist(), np.asfortranarray(NOISE))
        np.testing.assert_array_equal(record.covariance, again.covariance)
        np.testing.assert_array_equal(record.dcm_lvlh_from_target, again.dcm_lvlh_from_target)
    np.testing.assert_array_equal(NOISE, SIGMA**2 * np.eye(3))
