"""The target-attitude filter through long gaps on tumbling bodies of unequal moments: honest at the end of each.

The truth is scipy's, as in `test_target_attitude_honesty`. After a gap what is known of the attitude is long and thin,
and the path of the body bends: slopes alone do not tell how far off the truth is.
"""

import copy
import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import relnav
from relnav.estimation.consistency import chi_square_interval
from relnav.estimation.factored import compose, factorize
from relnav.navigation.attitude.bending import PAIRS, add_even, thinnest_variance
from relnav.navigation.attitude.target_attitude import METHODS

N, RUNS = 1.1313666536110223e-3, 80
SLENDER, BROAD = np.diag([1000.0, 3000.0, 3800.0]), np.diag([1000.0, 1400.0, 1570.0])
WAITING = relnav.EpochStatus.WAITING


def error_of(record, dcm, rate):
    turn = Rotation.from_matrix(record.dcm_lvlh_from_target.T @ dcm).as_rotvec()
    return np.concatenate([turn, rate - record.rate_rad_s])


def tumbling(turning, t, inertia, deg_s, rng, off=0.0, runs=RUNS):
    """Attitudes and rates (n, runs, ...) of bodies whose moments are off by a share (1-sigma) of them."""
    start = Rotation.random(runs, rng=rng)
    rate = -N * start.as_matrix()[:, 1] + np.radians(deg_s) * rng.normal(size=(runs, 3))
    moments = np.diag(inertia) * (1.0 + off * rng.normal(size=(runs, 3)))
    moments[:, 2] = np.minimum(moments[:, 2], 0.999 * moments[:, :2].sum(axis=1))
    return turning(t, start, rate, moments[:, :, None] * np.eye(3))


def nees(record, dcm, rate):
    error = error_of(record, dcm, rate)
    return error @ np.linalg.solve(record.covariance, error)


def through_a_gap(
    turning, inertia, deg_s, noise_deg, images, gap_s, rng, method="multiplicative", off=0.0, step_s=None
):
    """NEES at the end of a gap after so many attitudes a second apart, and after one more; of the runs that go on."""
    t = np.append(np.arange(images, dtype=float), images - 1 + gap_s)
    dcms, rates = tumbling(turning, t, inertia, deg_s, rng, off)
    sigma, out = np.radians(noise_deg), []
    for run in range(RUNS):
        seen = dcms[:, run] @ Rotation.from_rotvec(sigma * rng.normal(size=(len(t), 3))).as_matrix()
        nav = relnav.TargetAttitude(
            inertia,
            N,
            rate_noise_density_rad2_s3=0.0,
            initial_rate_sigma_rad_s=np.radians(deg_s),
            method=method,
            inertia_sigma_kg_m2=off * inertia,
        )
        for k in range(images):
            nav.step(t[k], seen[k], sigma**2 * np.eye(3))
        for now in np.arange(t[-2], t[-1], step_s)[1:] if step_s else []:
            nav.step(now)
        before = nav.step(t[-1])
        if before.status == WAITING:
            continue
        after = nav.step(t[-1], seen[-1], sigma**2 * np.eye(3))
        out.append([nees(record, dcms[-1, run], rates[-1, run]) for record in (before, after)])
    return np.array(out)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("inertia", "deg_s", "noise_deg", "images", "gap_s", "step_s"),
    [
        (SLENDER, 5.0, 0.1, 20, 60.0, None),
        (SLENDER, 5.0, 0.1, 20, 60.0, 0.5),
        (SLENDER, 5.0, 1.0, 60, 120.0, None),
        (BROAD, 5.0, 1.0, 20, 60.0, 0.5),
        (BROAD, 3.0, 0.3, 20, 90.0, None),
    ],
)
def test_nees_after_a_gap(turning, method, inertia, deg_s, noise_deg, images, gap_s, step_s):
    """A gap in one step and in many; the estimate is used again at once, and honest after it."""
    found = through_a_gap(
        turning, inertia, deg_s, noise_deg, images, gap_s, np.random.default_rng(5), method, step_s=step_s
    )
    print(len(found), (found.mean(axis=0) / 6.0).round(2), (found.max(axis=0) / 6.0).round(1))
    assert len(found) >= 0.7 * RUNS
    low, high = chi_square_interval(6 * len(found), 0.9999)
    assert low <= found.mean(axis=0).min() / 6.0
    assert found.mean(axis=0).max() / 6.0 <= high


@pytest.mark.parametrize(
    ("inertia", "deg_s", "noise_deg", "off", "gap_s"),
    [(BROAD, 5.0, 0.1, 0.002, 60.0), (BROAD, 2.0, 0.5, 0.02, 40.0), (SLENDER, 1.0, 0.5, 0.01, 100.0)],
)
def test_nees_after_a_gap_with_moments_that_are_off(turning, inertia, deg_s, noise_deg, off, gap_s):
    """What the inertia's errors do to the path bends it too."""
    found = through_a_gap(turning, inertia, deg_s, noise_deg, 60, gap_s, np.random.default_rng(6), off=off)
    print(len(found), (found.mean(axis=0) / 6.0).round(2), (found.max(axis=0) / 6.0).round(1))
    assert len(found) >= 0.7 * RUNS
    assert found.mean(axis=0).max() <= 6.0 * 1.7


def gone_into_a_gap(turning, method, steps):
    """A filter some way into a gap, measured once a second before it."""
    dcms, _ = tumbling(turning, np.arange(12.0), SLENDER, 5.0, np.random.default_rng(8), runs=1)
    nav = relnav.TargetAttitude(
        SLENDER, N, rate_noise_density_rad2_s3=1e-14, initial_rate_sigma_rad_s=0.1, method=method
    )
    for k in range(12):
        nav.step(float(k), dcms[k, 0], np.radians(0.1) ** 2 * np.eye(3))
    for k in range(steps):
        nav.step(12.0 + k)
    return nav


@pytest.mark.parametrize("method", METHODS)
def test_points_are_carried_in_a_gap_only(turning, method):
    """None are drawn while attitudes come, in a gap they are, and the next attitude ends it."""
    nav = gone_into_a_gap(turning, method, 0)
    assert nav.memory["bent"]["on"] == 0
    nav = gone_into_a_gap(turning, method, 40)
    assert nav.memory["bent"]["on"] == 1
    nav.step(52.0, nav.step(52.0).dcm_lvlh_from_target, np.radians(0.1) ** 2 * np.eye(3))
    assert nav.memory["bent"]["on"] == 0


@pytest.mark.parametrize("method", METHODS)
def test_a_copy_goes_on_in_a_gap(turning, method):
    nav = gone_into_a_gap(turning, method, 40)
    copies = copy.copy(nav), copy.deepcopy(nav), pickle.loads(pickle.dumps(nav))
    for k in range(52, 70):
        record = nav.step(float(k))
        for one in copies:
            np.testing.assert_array_equal(one.step(float(k)).covariance, record.covariance)


def test_the_thinnest_variance():
    """Between a sixth of the least eigenvalue and that, rates over the fastest."""
    rng = np.random.default_rng(9)
    for _ in range(20):
        root = rng.normal(size=(6, 6)) * 10.0 ** rng.uniform(-2.0, 0.0, 6)
        fastest = 10.0 ** rng.uniform(-3.0, 0.0)
        unit = np.repeat([1.0, 1.0 / fastest], 3)
        scaled = unit[:, None] * (root @ root.T) * unit
        assert_allclose(thinnest_variance(factorize(root @ root.T), fastest), 1.0 / np.linalg.inv(scaled).trace(), 1e-4)


def test_the_even_part_is_added():
    rng = np.random.default_rng(10)
    root, even = rng.normal(size=(6, 6)), rng.normal(size=(6, PAIRS))
    ld = factorize(root @ root.T)
    add_even(ld, even)
    assert_allclose(compose(ld), root @ root.T + even @ even.T / 6.0, atol=1e-12)
