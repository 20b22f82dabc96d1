"""Attitude mode "unknown": only what does not depend on the camera's attitude is used, so it may do what it likes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import relnav
from relnav.navigation.status import STARTED, UPDATED

LIMIT = chi2.isf(1e-6, 6)


@pytest.fixture(scope="module")
def flight(unknown_attitude, drift, look):
    """A drift from 8.5 m with a camera that wobbles by degrees and rolls by tens of degrees."""
    t = 0.1 * np.arange(1500)
    truth = drift(unknown_attitude, t, [8.5, 0.05, -0.2, -0.005, 0.0005, 0.0])
    rng = np.random.default_rng(9)
    wobble = Rotation.from_rotvec(np.radians([1.0, 1.0, 20.0]) * rng.uniform(-1, 1, size=(len(t), 3)))
    dcm = wobble.as_matrix() @ unknown_attitude.dcm_cam_from_lvlh
    return t, truth, look(unknown_attitude, truth, seed=1, dcm=dcm), dcm


def test_three_beacons_give_the_position_of_a_wobbling_camera(unknown_attitude, flight, nees):
    t, truth, spots, _ = flight
    solution = relnav.filter_epochs(unknown_attitude, t, spots, method="spots")
    seen = np.isfinite(spots).all(axis=(1, 2))
    assert seen.mean() > 0.9
    assert np.all(solution.dof[2:][seen[2:]] == 3)
    assert solution.restarts == 0
    values = nees(solution.state[500:] - truth[500:], solution.covariance[500:])
    assert values.max() < LIMIT
    assert values.mean() < 9.0
    used = solution.accepted & (solution.dof > 0)
    assert 0.9 <= solution.nis[used].sum() / solution.dof[used].sum() <= 1.1


def test_the_same_log_defeats_a_filter_that_trusts_the_held_attitude(vbar, flight):
    t, _, spots, _ = flight
    solution = relnav.filter_epochs(vbar, t, spots, method="spots")
    assert np.mean(solution.status == UPDATED) < 0.5


def test_turning_the_camera_changes_nothing(unknown_attitude, drift, look):
    """Noise-free images from a held and from a turned camera lead to the same track."""
    t = 0.1 * np.arange(200)
    truth = drift(unknown_attitude, t, [7.0, 0.1, -0.1, -0.01, 0.0, 0.0])
    held = unknown_attitude.dcm_cam_from_lvlh
    turned = Rotation.from_rotvec([0.005, -0.01, 0.8]).as_matrix() @ held
    one = relnav.filter_epochs(unknown_attitude, t, look(unknown_attitude, truth, noise_m=0.0), method="spots")
    other = relnav.filter_epochs(
        unknown_attitude,
        t,
        look(unknown_attitude, truth, noise_m=0.0, dcm=np.broadcast_to(turned, (200, 3, 3))),
        method="spots",
    )
    # The noise model follows the turned spots (f is not infinite), hence per mille of sigma and not rounding.
    assert np.nanmax(np.abs(one.state - other.state) / one.sigma) < 5e-3


def test_an_attitude_0_05_deg_off_turns_the_spots_track_and_leaves_the_fix_alone(vbar, drift, look, nees):
    """What README says of the two methods, and why `fix` is the default."""
    t, off = 0.1 * np.arange(600), np.radians(0.05)
    truth = drift(vbar, t, [7.0, 0.0, 0.0, -0.01, 0.0, 0.0])
    dcm = Rotation.from_rotvec([0.0, off, 0.0]).as_matrix() @ vbar.dcm_cam_from_lvlh  # about the camera's y axis
    spots = look(vbar, truth, seed=3, dcm=np.broadcast_to(dcm, (len(t), 3, 3)))
    spotted = relnav.filter_epochs(vbar, t, spots, method="spots")
    reference = relnav.filter_epochs(vbar, t, look(vbar, truth, seed=3), method="spots")
    turned = np.hypot(*(spotted.docking[-1] - reference.docking[-1])[1:])
    assert turned == pytest.approx(off, rel=0.1)
    assert spotted.docking_sigma[-1, 1:].max() < off / 20.0
    fix = relnav.filter_epochs(vbar, t, spots)
    assert fix.method == "fix"
    late = slice(300, None)
    assert nees(fix.state[late] - truth[late], fix.covariance[late]).mean() < 9.0
    assert nees(spotted.state[late] - truth[late], spotted.covariance[late]).mean() > 600.0


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_two_beacons_give_one_number(unknown_attitude, flight, nees, lost):
    t, truth, spots, _ = flight
    spots = spots.copy()
    spots[500:, lost] = np.nan
    solution = relnav.filter_epochs(unknown_attitude, t, spots, method="spots")
    pair = np.isfinite(spots[500:]).all(axis=2).sum(axis=1) == 2
    assert np.all(solution.dof[500:][pair] == 1)
    assert np.isfinite(solution.innovation[500:][pair]).sum(axis=1).tolist() == [1] * int(pair.sum())
    values = nees(solution.state[500:] - truth[500:], solution.covariance[500:])
    assert values.max() < LIMIT
    assert values.mean() < 9.0
    nis = solution.nis[500:][pair]
    low, high = chi2.ppf([1e-4, 1 - 1e-4], len(nis)) / len(nis)
    assert low < nis.mean() < high
    blind = spots.copy()
    blind[500:] = np.nan
    sigma_blind = relnav.filter_epochs(unknown_attitude, t, blind, method="spots").sigma[-1, :3]
    assert np.all(solution.sigma[-1, :3] <= sigma_blind)
    assert solution.sigma[-1, :3].min() < 0.9 * sigma_blind.max()


def test_one_beacon_says_nothing_without_attitude(unknown_attitude, flight):
    t, _, spots, _ = flight
    spots = spots.copy()
    spots[500:, :2] = np.nan
    solution = relnav.filter_epochs(unknown_attitude, t, spots, method="spots")
    assert np.all(solution.dof[500:] == 0)
    assert not np.any(np.isin(solution.status[500:], (UPDATED, STARTED)))
    assert np.all(np.diff(solution.sigma[500:, 0]) > 0.0)


def test_a_missing_coordinate_of_an_unknown_attitude_does_not_spoil_the_state(unknown_attitude, flight, nees):
    t, truth, spots, _ = flight
    spots = spots.copy()
    spots[400:600:7, 1, 0] = np.nan
    solution = relnav.filter_epochs(unknown_attitude, t, spots, method="spots")
    assert nees(solution.state[2:] - truth[2:], solution.covariance[2:]).max() < LIMIT


def test_a_given_attitude_is_used_where_it_is_given(unknown_attitude, flight, nees):
    """Epoch by epoch: with the true attitude the bearing is used as well, and without it no more."""
    t, truth, spots, dcm = flight
    navigator = relnav.Navigator(unknown_attitude, method="spots")
    dofs = []
    for k in range(200):
        record = navigator.step(t[k], spots[k], dcm_cam_from_lvlh=dcm[k] if k >= 100 else None)
        dofs.append(record.dof)
    seen = np.isfinite(spots[:200]).all(axis=2).sum(axis=1)
    assert set(np.array(dofs[2:100])[seen[2:100] == 3]) == {3}
    assert set(np.array(dofs[100:])[seen[100:] == 3]) == {6}
    assert nees((record.state - truth[199])[None], record.covariance[None])[0] < LIMIT
    assert record.sigma_azimuth_rad < 5e-4
    assert navigator.step(t[200], spots[200]).dof in (0, 1, 3)
