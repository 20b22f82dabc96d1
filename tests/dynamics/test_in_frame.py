"""Frames of a track, states and covariances, against brahe's transformations and against differences."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.dynamics.in_frame import FRAMES, in_frame
from relnav.dynamics.two_body import MU_EARTH_M3_S2, inertial_orbit
from relnav.errors import UsageError
from relnav.geometry.frames import relative_state_rsw
from relnav.mission import Docking, Orbit

ORIENTATION_DEG = (51.6, 130.0, 40.0)
ORBIT = Orbit(1.1e-3, 0.12, math.radians(75.0))


@pytest.fixture(scope="module")
def track():
    """Eight epochs over an orbit with full covariances, one without a state."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(8, 6, 6)) * np.array([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])[:, None]
    state = rng.normal(size=(8, 6)) * np.array([100.0, 30.0, 60.0, 0.1, 0.1, 0.1])
    covariance = root @ np.swapaxes(root, 1, 2)
    state[3], covariance[3] = np.nan, np.nan
    return SimpleNamespace(t_s=np.linspace(0.0, 5700.0, 8), state=state, covariance=covariance, model="test")


@pytest.fixture(scope="module")
def mission(make_model):
    turned = Docking((0.0, math.sin(0.3), 0.0, math.cos(0.3)), (1.0, 0.5, -2.0))
    return make_model(orbit=ORBIT, docking=turned)


def target(t):
    orientation = tuple(math.radians(angle) for angle in ORIENTATION_DEG)
    shape = ORBIT.mean_motion_rad_s, ORBIT.eccentricity, ORBIT.true_anomaly_rad
    return np.hstack(inertial_orbit(*shape, orientation, t))


def test_the_orbit_is_keplers(outside):
    brahe = pytest.importorskip("brahe", reason="brahe is not installed")
    e, nu = ORBIT.eccentricity, ORBIT.true_anomaly_rad
    eccentric = 2.0 * math.atan(math.sqrt((1.0 - e) / (1.0 + e)) * math.tan(0.5 * nu))
    mean = math.degrees(eccentric - e * math.sin(eccentric))
    t = np.array([0.0, 1234.5, 9000.0])
    a = (MU_EARTH_M3_S2 / ORBIT.mean_motion_rad_s**2) ** (1.0 / 3.0)
    inclination, node, perigee = ORIENTATION_DEG
    for found, time in zip(target(t), t, strict=True):
        now = mean + math.degrees(ORBIT.mean_motion_rad_s * time)
        elements = np.array([a, e, inclination, node, perigee, now % 360.0])
        expected = brahe.state_koe_to_eci(elements, brahe.AngleFormat.DEGREES)
        off = np.abs(found / expected - 1.0).max()
        outside("brahe", "inertial orbit from its elements (its mu has fewer digits), relative", off, 2e-8)


def test_states_and_covariances_against_brahe(track, mission, outside):
    brahe = pytest.importorskip("brahe", reason="brahe is not installed")
    rsw, relative = (in_frame(track, name, mission, ORIENTATION_DEG) for name in ("rsw", "eci_relative"))
    absolute = in_frame(track, "eci", mission, ORIENTATION_DEG)
    chief = target(track.t_s)
    for e in (0, 1, 2, 4, 5, 6, 7):
        found = brahe.state_eci_to_rtn(chief[e], absolute.state[e])
        np.testing.assert_allclose(rsw.state[e], found, rtol=1e-6, atol=1e-7)  # 7,000 km in the difference
        turn = brahe.jacobian_eci_to_rtn(chief[e], brahe.OrbitRelativeFrameVariant.ROTATING)
        np.testing.assert_allclose(turn @ relative.state[e], rsw.state[e], rtol=1e-9, atol=1e-10)
        off = np.abs(turn @ relative.state[e] - rsw.state[e]).max()
        outside("brahe", "state from inertial axes into RTN, 100 m away, m and m/s", off, 1e-9)
        expected = turn @ relative.covariance[e] @ turn.T
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        off = np.abs(rsw.covariance[e] / scale - expected / scale).max()
        outside("brahe", "covariance from inertial axes into RTN, of the two sigmas", off, 1e-9)


def test_inertial_states_against_the_definition(track, mission):
    absolute, rsw = (in_frame(track, name, mission, ORIENTATION_DEG) for name in ("eci", "rsw"))
    chief = target(track.t_s)
    for e in (0, 2, 7):
        r, v = np.split(absolute.state[e], 2)
        found = relative_state_rsw(chief[e, :3], chief[e, 3:], r, v)
        np.testing.assert_allclose(found, rsw.state[e], rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("frame", FRAMES)
def test_a_covariance_is_that_of_turned_draws(track, mission, frame):
    """The derivative of the turned state by the state, by differences, turns the covariance."""
    found = in_frame(track, frame, mission, ORIENTATION_DEG)
    columns = []
    for k in range(6):
        moved = replace_state(track, k)
        columns.append(in_frame(moved, frame, mission, ORIENTATION_DEG).state - found.state)
    jacobian = np.stack(columns, axis=2)
    expected = jacobian @ track.covariance @ np.swapaxes(jacobian, 1, 2)
    good = np.isfinite(track.state[:, 0])
    scale = found.sigma[good][:, :, None] * found.sigma[good][:, None, :]
    np.testing.assert_allclose(found.covariance[good] / scale, expected[good] / scale, atol=1e-5)
    assert np.isnan(found.state[3]).all()
    assert found.metadata["frame"].startswith(f"{frame}: ")


def replace_state(track, k):
    state = track.state.copy()
    state[:, k] += 1.0  # the turn is linear: any step
    return SimpleNamespace(**{**vars(track), "state": state})


def test_the_docking_frame_begins_at_the_port(track, mission):
    at_port = SimpleNamespace(**{**vars(track), "state": np.tile([1.0, 0.5, -2.0, 0.0, 0.0, 0.0], (8, 1))})
    np.testing.assert_allclose(in_frame(at_port, "dock", mission).state, 0.0, atol=1e-12)
    c, s = math.cos(0.6), math.sin(0.6)  # about y by the quaternion's angle: v_dock = R v_lvlh
    at_port.state[:, 0] += 1.0
    np.testing.assert_allclose(in_frame(at_port, "dock", mission).state[0, :3], [c, 0.0, -s], atol=1e-12)


@pytest.fixture(scope="module")
def poses(track):
    """The same epochs with an attitude and a rate, and covariances of all twelve errors."""
    rng = np.random.default_rng(6)
    scale = np.repeat([1.0, 1e-3, 0.02, 1e-4], 3)
    root = rng.normal(size=(8, 12, 12)) * scale[:, None]
    attitude, rate = Rotation.random(8, random_state=7).as_matrix(), 1e-3 * rng.normal(size=(8, 3))
    covariance = root @ np.swapaxes(root, 1, 2)
    for array in (attitude, rate, covariance):
        array[3] = np.nan
    return SimpleNamespace(**{**vars(track), "covariance": covariance}, dcm_lvlh_from_target=attitude, rate_rad_s=rate)


def axes_of(frame, mission, t):
    """Rotations v_frame = R v_lvlh at a time, by brahe and by the definitions of the axes."""
    brahe = pytest.importorskip("brahe", reason="brahe is not installed")
    rtn_from_lvlh = Rotation.from_matrix([[0, 0, -1], [1, 0, 0], [0, -1, 0]])  # R = -z, T = x, N = -y
    if frame == "rsw":
        return rtn_from_lvlh
    if frame == "dock":
        return Rotation.from_quat(mission.docking.q_dock_from_lvlh)
    if frame == "lvlh_ccsds":
        return Rotation.identity()
    return Rotation.from_matrix(brahe.rotation_rtn_to_eci(target([t])[0])) * rtn_from_lvlh


@pytest.mark.parametrize("frame", FRAMES)
def test_attitudes_and_whole_covariances_against_draws_turned_by_others(poses, mission, frame):
    """The true attitude and state are turned by scipy and brahe; the errors of the estimate are found again there."""
    found, known = in_frame(poses, frame, mission, ORIENTATION_DEG), [0, 1, 2, 4, 5, 6, 7]
    brahe = pytest.importorskip("brahe", reason="brahe is not installed")
    for e in known:
        turn = axes_of(frame, mission, poses.t_s[e])
        attitude = Rotation.from_matrix(poses.dcm_lvlh_from_target[e])
        expected = turn * attitude
        np.testing.assert_allclose(found.dcm_frame_from_target[e], expected.as_matrix(), atol=1e-12)
        q = expected.as_quat(canonical=True)
        np.testing.assert_allclose(found.q_frame_from_target[e], q, atol=1e-12)
        columns = []
        for k, step in enumerate(np.repeat([1.0, 1.0, 1e-4, 1.0], 3)):
            error = step * np.eye(12)[k]
            true = turn * (attitude * Rotation.from_rotvec(error[6:9]))
            theta = (Rotation.from_matrix(found.dcm_frame_from_target[e]).inv() * true).as_rotvec()
            moved = np.concatenate([turn.apply(error[:3]), turn.apply(error[3:6])])
            if frame in ("eci", "eci_relative"):
                in_rtn = axes_of("rsw", mission, 0.0).apply(error[:6].reshape(2, 3)).ravel()
                turning = brahe.OrbitRelativeFrameVariant.ROTATING
                moved = brahe.jacobian_rtn_to_eci(target(poses.t_s[e : e + 1])[0], turning) @ in_rtn
            columns.append(np.concatenate([moved, theta, error[9:]]) / step)
        jacobian = np.stack(columns, axis=1)
        covariance = jacobian @ poses.covariance[e] @ jacobian.T
        scale = np.outer(found.sigma[e], found.sigma[e])
        np.testing.assert_allclose(found.covariance[e] / scale, covariance / scale, atol=1e-9)
    assert np.isnan(found.q_frame_from_target[3]).all()
    np.testing.assert_array_equal(found.rate_rad_s, poses.rate_rad_s)
    np.testing.assert_array_equal(found.sigma[known, 6:], np.sqrt(np.diagonal(poses.covariance, 0, 1, 2))[known, 6:])
    axes = {"lvlh_ccsds": "lvlh", "eci_relative": "eci"}.get(frame, frame)
    assert found.metadata["attitude"].startswith(f"q_{axes}_from_target: v_{axes} = R v_target, scalar last")


def test_a_track_without_attitude_has_none(track, mission):
    found = in_frame(track, "rsw", mission)
    assert (found.dcm_frame_from_target, found.q_frame_from_target, found.rate_rad_s) == (None, None, None)
    assert found.covariance.shape == (8, 6, 6)


@pytest.mark.parametrize(
    ("frame", "known", "orientation", "said"),
    [
        ("lvlh", True, None, "frame is one of lvlh_ccsds, rsw, dock, eci_relative, eci; got 'lvlh'"),
        ("eci", True, None, "needs the orientation of the target's orbit"),
        ("eci", True, (1.0, 2.0), "needs the orientation of the target's orbit"),
        ("eci", True, (1.0, 2.0, math.nan), "needs the orientation of the target's orbit"),
        ("dock", False, None, "needs the model that was flown, which is no shipped one: pass it as model=$"),
    ],
)
def test_what_is_missing_is_said(track, mission, frame, known, orientation, said):
    with pytest.raises(UsageError, match=said):
        in_frame(track, frame, mission if known else None, orientation)


def test_a_circular_orbit_turns_at_the_mean_motion(mission):
    circular = replace(mission, orbit=Orbit(1.1e-3))
    still = SimpleNamespace(
        t_s=np.zeros(1), state=np.array([[0.0, 0.0, 10.0, 0, 0, 0]]), covariance=np.eye(6)[None], model="test"
    )
    relative = in_frame(still, "eci_relative", circular, (0.0, 0.0, 0.0))
    # 10 m below the target at the x axis of space, turning with it: -x, and slower along +y
    np.testing.assert_allclose(relative.state[0], [-10.0, 0.0, 0.0, 0.0, -0.011, 0.0], atol=1e-12)
