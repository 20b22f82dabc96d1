"""A vehicle's estimate in other frames: motion, target's attitude and covariance against brahe and scipy; its table."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.dynamics.in_frame import FRAMES
from relnav.dynamics.two_body import MU_EARTH_M3_S2
from relnav.errors import UsageError
from relnav.files.vehicle_track import TRACK_COLUMNS, write_port_track

T_S = 40.0
LVLH_FROM_RTN = Rotation.from_matrix([[0, 1, 0], [0, 0, -1], [-1, 0, 0]])


@pytest.fixture
def estimate(navigator):
    """Forty seconds after hand-over, with errors of motion, attitude and rate that hang together as if observed."""
    navigator.observe("gyro", 0.0, [1e-3, -2e-3, 5e-4])
    found = navigator.propagate(T_S)
    mixed = np.eye(len(found.covariance)) + 0.1 * np.random.default_rng(3).normal(size=found.covariance.shape)
    sigma = np.sqrt(np.diagonal(found.covariance))
    mixed *= sigma[:, None]
    return replace(found, covariance=mixed @ mixed.T)


@pytest.fixture
def chief(vehicle):
    """The target of the file's orbit, by brahe."""
    brahe = pytest.importorskip("brahe", reason="brahe is not installed")
    orbit = vehicle.orbit
    e, n = orbit.eccentricity, orbit.mean_motion_rad_s
    half = math.sqrt((1.0 - e) / (1.0 + e)) * math.tan(0.5 * orbit.true_anomaly_rad)
    eccentric = 2.0 * math.atan(half)
    mean = eccentric - e * math.sin(eccentric) + n * T_S
    a = (MU_EARTH_M3_S2 / n**2) ** (1.0 / 3.0)
    angles = orbit.inclination_rad, orbit.ascending_node_rad, orbit.perigee_argument_rad, mean % math.tau
    return brahe.state_koe_to_eci(np.array([a, e, *angles]), brahe.AngleFormat.RADIANS)


def test_the_same_motion_and_attitude_in_every_frame(estimate, chief, vehicle):
    brahe = pytest.importorskip("brahe", reason="brahe is not installed")
    rsw, relative, absolute = (estimate.in_frame(name) for name in ("rsw", "eci_relative", "eci"))
    eci_from_rtn = Rotation.from_matrix(brahe.rotation_rtn_to_eci(chief))
    attitude = Rotation.from_matrix(estimate.dcm_lvlh_from_target)
    np.testing.assert_allclose(absolute.state[0] - relative.state[0], chief, rtol=2e-8)
    np.testing.assert_allclose(LVLH_FROM_RTN.apply(rsw.state[0].reshape(2, 3)).ravel(), estimate.motion, atol=1e-12)
    in_rtn = (LVLH_FROM_RTN.inv() * attitude).as_quat(canonical=True)
    np.testing.assert_allclose(rsw.q_frame_from_target[0], in_rtn, atol=1e-12)
    in_eci = (eci_from_rtn * LVLH_FROM_RTN.inv() * attitude).as_quat(canonical=True)
    np.testing.assert_allclose(relative.q_frame_from_target[0], in_eci, atol=1e-7)  # brahe's mu has fewer digits
    turn = np.eye(12)
    turn[:6, :6] = brahe.jacobian_rtn_to_eci(chief, brahe.OrbitRelativeFrameVariant.ROTATING)
    np.testing.assert_allclose(turn[:6, :6] @ rsw.state[0], relative.state[0], rtol=1e-6, atol=1e-6)
    expected = turn @ rsw.covariance[0] @ turn.T
    scale = np.outer(relative.sigma[0], relative.sigma[0])
    np.testing.assert_allclose(relative.covariance[0] / scale, expected / scale, atol=1e-6)
    assert np.abs(relative.covariance[0, :6, 6:] / scale[:6, 6:]).max() > 0.05
    np.testing.assert_array_equal(relative.covariance[0, 6:, 6:], estimate.covariance[6:12, 6:12])
    np.testing.assert_array_equal(relative.rate_rad_s[0], estimate.target_rate_rad_s)
    assert relative.metadata["model"] == vehicle.name
    with pytest.raises(UsageError, match="frame is one of lvlh_ccsds, rsw, dock, eci_relative, eci; got 'hill'"):
        estimate.in_frame("hill")


def test_the_docking_frame_begins_at_the_held_port(estimate, vehicle):
    dock = estimate.in_frame("dock")
    held = Rotation.from_quat(vehicle.target.q_target_from_lvlh)
    expected = held.apply(estimate.motion[:3]) - np.array(vehicle.target.port_position_m)
    np.testing.assert_allclose(dock.state[0, :3], expected, atol=1e-12)
    expected = held.as_matrix() @ estimate.dcm_lvlh_from_target
    np.testing.assert_allclose(Rotation.from_quat(dock.q_frame_from_target[0]).as_matrix(), expected, atol=1e-12)


@pytest.mark.parametrize("frame", FRAMES)
def test_its_table_has_both(estimate, vehicle, tmp_path, frame):
    """Port from port as without a frame, and beside it what the frame has."""
    write_port_track([estimate], vehicle, tmp_path / "plain.csv", {})
    write_port_track([estimate], vehicle, tmp_path / "track.csv", {}, frame=frame)
    texts = []
    for name in ("plain.csv", "track.csv"):
        text = (tmp_path / name).read_text()
        lines = [line for line in text.splitlines() if line[0] != "#"]
        texts.append((text, lines))
    numbers = [[float(text or "nan") for text in lines[1].split(",")] for _, lines in texts]
    names = [lines[0].split(",") for _, lines in texts]
    plain, track = (dict(zip(head, row, strict=True)) for head, row in zip(names, numbers, strict=True))
    assert tuple(plain)[: len(TRACK_COLUMNS)] == TRACK_COLUMNS
    np.testing.assert_array_equal([track[name] for name in plain], list(plain.values()))
    found = estimate.in_frame(frame)
    axes = {"lvlh_ccsds": "lvlh", "eci_relative": "eci"}.get(frame, frame)
    assert [track[f"com_{name}"] for name in ("x_m", "vz_m_s")] == found.state[0, [0, 5]].tolist()
    assert [track[f"q_{axes}_from_target_{axis}"] for axis in "xyzw"] == found.q_frame_from_target[0].tolist()
    assert track["sigma_com_vy_m_s"] == found.sigma[0, 4]
    assert track["sigma_com_turn_z_deg"] == pytest.approx(math.degrees(found.sigma[0, 8]), rel=1e-15)
    assert track["cov_com_x_rate_z"] == found.covariance[0, 0, 11]
    assert f"# frame of com_, q_ and cov_com_ columns = {frame}: {FRAMES[frame]}" in texts[1][0]
    assert ("# target orbit = two-body" in texts[1][0]) == frame.startswith("eci")
