"""The attitude that one image implies, and x', y', z' of Cai et al. (1996) (12), with their covariance.

Images come from the projection of `tests/conftest.py`, frames from scipy's rotations, derivatives from differences.
"""

import copy
import math
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.sensors.measurement import Status
from relnav.sensors.three_beacon import measure

PLACES = [(6.5, 0.0, 0.0), (6.5, 10.0, 15.0), (3.75, -8.0, 5.0), (2.6, 20.0, -20.0)]
ANGLES = [(0.0, 0.0, 0.0), (40.0, 5.0, -8.0), (-170.0, -12.0, 20.0)]
"""Roll, pitch and yaw beside those of a camera that points at O, deg."""
DRAWS = 2000


def facing(roll, pitch, yaw):
    """Attitude of roll, pitch, yaw rad: forward, right, down are -x, -y, z of the dock, z, x, y of the camera."""
    forward, right, down = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix().T * [-1.0, -1.0, 1.0]
    return np.array([right, down, forward])


def pointed(truth, place, angles_deg):
    """Position (3,), and a camera there that points at O, turned on by (roll, pitch, yaw) deg, with its own three."""
    p = truth.position(place[0], *np.radians(place[1:]))
    yaw, pitch = math.atan2(p[1], p[0]), math.atan2(p[2], math.hypot(p[0], p[1]))  # of -p, along -x, -y and z
    mine = np.array([0.0, pitch, yaw]) + np.radians(angles_deg)
    return p, facing(*mine), mine


@pytest.mark.parametrize("angles_deg", ANGLES)
@pytest.mark.parametrize("place", PLACES)
def test_frames_and_angles(truth, wide_sensor, place, angles_deg):
    p, dcm, mine = pointed(truth, place, angles_deg)
    seen = measure(truth.central(p, dcm), wide_sensor)
    np.testing.assert_allclose(seen.position_m, p, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(seen.dcm_cam_from_dock, dcm, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(Rotation.from_quat(seen.q_cam_from_dock).as_matrix(), dcm, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(seen.roll_pitch_yaw_rad, mine, rtol=0.0, atol=1e-9)


def test_signs(truth):
    """Turned to the right O moves left in the image, turned up it moves down, rolled right side down A does."""
    p, still = np.array([6.5, 0.0, 0.0]), truth.central(np.array([6.5, 0.0, 0.0]), facing(0.0, 0.0, 0.0))
    assert still[0, 0] < 0.0 < still[1, 0]
    roll, pitch, yaw = (truth.central(p, facing(*(0.1 * row))) - still for row in np.eye(3))
    assert yaw[2, 0] < 0.0
    assert pitch[2, 1] > 0.0
    assert roll[0, 1] > 0.0


def test_twelve_holds_for_the_printed_form_too(truth, wide_sensor):
    """(12) is r times the unit vector of (10); no attitude fits the printed form's place under a lens."""
    p = truth.position(6.5, 0.1, -0.05)
    seen = measure(truth.parallel(p), wide_sensor, projection="parallel")
    np.testing.assert_allclose(seen.position_m, p, rtol=0.0, atol=1e-10)
    assert np.isfinite(seen.position_covariance).all()
    for value in (seen.dcm_cam_from_dock, seen.q_cam_from_dock, seen.roll_pitch_yaw_rad, seen.pose_covariance):
        assert np.isnan(value).all()


def test_nothing_where_there_is_no_value(truth, wide_sensor):
    p = truth.position(6.5, 0.0, 0.0)
    spots = truth.central(p, truth.look_at(p))
    spots[1] = np.nan
    seen = measure(spots, wide_sensor)
    assert seen.status is Status.NOT_SEEN
    for name in ("position_m", "position_covariance", "dcm_cam_from_dock", "q_cam_from_dock", "pose_covariance"):
        assert np.isnan(getattr(seen, name)).all()
    assert np.isnan(seen.roll_pitch_yaw_rad).all()
    assert np.isnan(seen.roll_pitch_yaw_covariance).all()


@pytest.mark.parametrize("place", PLACES)
def test_covariances_follow_from_derivatives(truth, wide_sensor, place):
    """s^2 J J^T with J by central differences of the measured position, turn, and angles."""
    p, dcm, _ = pointed(truth, place, ANGLES[1])
    spots = truth.central(p, dcm)
    seen = measure(spots, wide_sensor)

    def pose(values):
        other = measure(values.reshape(3, 2), wide_sensor)
        turn = Rotation.from_matrix(seen.dcm_cam_from_dock.T @ other.dcm_cam_from_dock).as_rotvec()
        return np.concatenate([other.position_m, turn, other.roll_pitch_yaw_rad])

    J = truth.derivative(pose, spots.ravel(), 2e-6)
    expected = wide_sensor.spot_noise_m**2 * J @ J.T
    for got, part in (
        (seen.pose_covariance, slice(0, 6)),
        (seen.position_covariance, slice(0, 3)),
        (seen.roll_pitch_yaw_covariance, slice(6, 9)),
    ):
        np.testing.assert_allclose(got, expected[part, part], rtol=1e-6, atol=1e-6 * np.abs(expected[part, part]).max())


@pytest.mark.parametrize(("place", "angles_deg"), [(PLACES[0], ANGLES[0]), (PLACES[1], ANGLES[1])])
def test_honest_over_many_images(truth, wide_sensor, place, angles_deg):
    """NEES of 3 and of 6 over 2000 images: 4 sigma of their means are 0.073 and 0.052 of one."""
    p, dcm, mine = pointed(truth, place, angles_deg)
    clean, rng = truth.central(p, dcm), np.random.default_rng(41)
    nees = np.empty((DRAWS, 3))
    for k in range(DRAWS):
        seen = measure(clean + wide_sensor.spot_noise_m * rng.normal(size=(3, 2)), wide_sensor)
        turn = Rotation.from_matrix(seen.dcm_cam_from_dock.T @ dcm).as_rotvec()
        angles = (seen.roll_pitch_yaw_rad - mine + np.pi) % (2.0 * np.pi) - np.pi
        errors = np.concatenate([p - seen.position_m, turn]), turn, angles
        covariances = seen.pose_covariance, seen.pose_covariance[3:, 3:], seen.roll_pitch_yaw_covariance
        nees[k] = [e @ np.linalg.solve(P, e) / len(e) for e, P in zip(errors, covariances, strict=True)]
    np.testing.assert_allclose(nees.mean(axis=0), 1.0, rtol=0.0, atol=0.073)


def test_a_measurement_is_a_value(truth, wide_sensor):
    """Spots that change later change nothing; copies and pickles say the same."""
    p = truth.position(6.5, 0.1, 0.1)
    spots = truth.central(p, truth.look_at(p))
    expected = measure(spots, wide_sensor).dcm_cam_from_dock
    seen = measure(spots, wide_sensor)
    spots[:] = 0.0
    others = copy.deepcopy(seen), pickle.loads(pickle.dumps(seen)), seen
    assert all(np.array_equal(other.dcm_cam_from_dock, expected) for other in others)
