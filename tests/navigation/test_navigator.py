"""`Navigator`, one image at a time, is `filter_epochs` bit for bit, and its records keep what they said."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav

N = 400


@pytest.fixture(scope="module")
def log(vbar, drift, look):
    """Control of both kinds, a turning camera, missing spots, outliers and a false scene that forces a restart."""
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.uniform(0.05, 0.2, size=N))
    acceleration = 1e-3 * rng.normal(size=(N, 3))
    impulse = np.where(rng.uniform(size=(N, 1)) < 0.05, 1e-3 * rng.normal(size=(N, 3)), 0.0)
    truth = drift(vbar, t, [8.0, 0.1, -0.1, -0.01, 0.0, 0.0], acceleration, impulse)
    turn = Rotation.from_rotvec(np.radians(0.5) * rng.normal(size=(N, 3)))
    attitude = turn * Rotation.from_quat(vbar.attitude.q_cam_from_lvlh)
    spots = look(vbar, truth, seed=5, dcm=attitude.as_matrix())
    spots[rng.uniform(size=(N, 3)) < 0.05] = np.nan
    spots[rng.uniform(size=(N, 3)) < 0.05] = 1e-3
    spots[200:240, :, 0] *= 1.05
    return t, spots, acceleration, impulse, attitude


def compare(record, solution, k):
    np.testing.assert_array_equal(record.state, solution.state[k])
    np.testing.assert_array_equal(record.covariance, solution.covariance[k])
    np.testing.assert_array_equal(record.innovation, solution.innovation[k])
    np.testing.assert_array_equal(record.nis, solution.nis[k])
    assert record.t_s == solution.t_s[k]
    assert record.dof == solution.dof[k]
    assert record.status == solution.status[k]
    assert record.measurement_status == solution.measurement_status[k]
    assert record.accepted == solution.accepted[k]
    np.testing.assert_array_equal([record.range_m, record.azimuth_rad, record.elevation_rad], solution.docking[k])
    sigma = [record.sigma_range_m, record.sigma_azimuth_rad, record.sigma_elevation_rad]
    np.testing.assert_array_equal(sigma, solution.docking_sigma[k])
    np.testing.assert_array_equal(record.docking_covariance, solution.docking_covariance[k])


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_bit_for_bit_with_control(vbar, log, method):
    t, spots, acceleration, impulse, _ = log
    solution = relnav.filter_epochs(vbar, t, spots, acceleration_m_s2=acceleration, delta_v_m_s=impulse, method=method)
    navigator = relnav.Navigator(vbar, method)
    for k in range(N):
        record = navigator.step(t[k], spots[k], acceleration_m_s2=acceleration[k], delta_v_m_s=impulse[k])
        compare(record, solution, k)


@pytest.mark.parametrize("method", ["spots", "fix"])
@pytest.mark.parametrize("projection", ["perspective", "parallel"])
def test_bit_for_bit_without_control(vbar, log, method, projection):
    t, spots, *_ = log
    solution = relnav.filter_epochs(vbar, t, spots, method=method, projection=projection)
    navigator = relnav.Navigator(vbar, method, projection=projection)
    for k in range(N):
        compare(navigator.step(t[k], spots[k]), solution, k)


def test_a_turning_camera_is_the_same_by_matrix_and_by_quaternion(vbar, log):
    t, spots, acceleration, impulse, attitude = log
    solution = relnav.filter_epochs(
        vbar,
        t,
        spots,
        acceleration_m_s2=acceleration,
        delta_v_m_s=impulse,
        q_cam_from_lvlh=attitude.as_quat(),
        method="spots",
    )
    navigator = relnav.Navigator(vbar, method="spots")
    dcm = attitude.as_matrix()
    for k in range(N):
        record = navigator.step(
            t[k], spots[k], acceleration_m_s2=acceleration[k], delta_v_m_s=impulse[k], dcm_cam_from_lvlh=dcm[k]
        )
        if np.isfinite(solution.state[k]).all():
            assert np.max(np.abs(record.state - solution.state[k]) / solution.sigma[k]) < 1e-8
        else:
            assert not record.has_state
    assert np.mean(solution.accepted) > 0.5


def test_a_control_or_attitude_once_given_does_not_linger(vbar, log):
    t, spots, _, _, attitude = log
    one, other = relnav.Navigator(vbar, method="spots"), relnav.Navigator(vbar, method="spots")
    for k in range(20):
        one.step(t[k], spots[k])
        other.step(t[k], spots[k])
    told = one.step(t[20], spots[20], acceleration_m_s2=[0.5, 0, 0], delta_v_m_s=[0, 0.1, 0])
    other.step(t[20], spots[20], acceleration_m_s2=[0.5, 0, 0], delta_v_m_s=[0, 0.1, 0])
    next_one = one.step(t[21], spots[21])
    next_other = other.step(t[21], spots[21], acceleration_m_s2=[0, 0, 0], delta_v_m_s=[0, 0, 0])
    assert told.t_s == t[20]
    np.testing.assert_array_equal(next_one.state, next_other.state)
    np.testing.assert_array_equal(next_one.covariance, next_other.covariance)
    one.step(t[22], spots[22], dcm_cam_from_lvlh=attitude[22].as_matrix())
    other.step(t[22], spots[22], dcm_cam_from_lvlh=attitude[22].as_matrix())
    held = other.step(t[23], spots[23], dcm_cam_from_lvlh=vbar.dcm_cam_from_lvlh)
    np.testing.assert_array_equal(one.step(t[23], spots[23]).state, held.state)


def test_records_never_change(vbar, log):
    t, spots, acceleration, impulse, _ = log
    navigator = relnav.Navigator(vbar, method="spots")
    records, kept = [], []
    for k in range(60):
        record = navigator.step(t[k], spots[k], acceleration_m_s2=acceleration[k], delta_v_m_s=impulse[k])
        records.append(record)
        kept.append((record.state, record.covariance, record.nis, record.innovation, record.status, repr(record)))
    for record, (state, covariance, nis, innovation, status, text) in zip(records, kept, strict=True):
        np.testing.assert_array_equal(record.state, state)
        np.testing.assert_array_equal(record.covariance, covariance)
        np.testing.assert_array_equal(record.nis, nis)
        np.testing.assert_array_equal(record.innovation, innovation)
        assert record.status == status
        assert repr(record) == text


def test_nobody_writes_into_what_a_record_gives(vbar, log):
    t, spots, *_ = log
    touched, untouched = relnav.Navigator(vbar, method="spots"), relnav.Navigator(vbar, method="spots")
    for k in range(30):
        record, twin = touched.step(t[k], spots[k]), untouched.step(t[k], spots[k])
        for array in (record.state, record.covariance, record.innovation, record.docking_covariance):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 7.0
        np.testing.assert_array_equal(record.state, twin.state)
        np.testing.assert_array_equal(record.covariance, twin.covariance)
        np.testing.assert_array_equal(record.innovation, twin.innovation)


def test_the_callers_spots_are_neither_kept_nor_changed(vbar, log):
    t, spots, *_ = log
    before = spots.copy()
    navigator, twin = relnav.Navigator(vbar, method="spots"), relnav.Navigator(vbar, method="spots")
    buffer = np.empty((3, 2))
    for k in range(30):
        buffer[:] = spots[k]
        record = navigator.step(t[k], buffer)
        buffer[:] = 0.0
        np.testing.assert_array_equal(record.state, twin.step(t[k], spots[k].tolist()).state)
    relnav.filter_epochs(vbar, t, spots, method="spots")
    np.testing.assert_array_equal(spots, before)
