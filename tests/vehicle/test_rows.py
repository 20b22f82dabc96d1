"""Every row of every sensor against differences: the state is moved as a correction moves it."""

import numpy as np
import pytest

from relnav.geometry.rotation_vector import turned
from relnav.sensors.sun_direction import tangent_basis
from relnav.vehicle.layout import CHASER_ATTITUDE, MOVING, POSITION, TARGET_ATTITUDE
from relnav.vehicle.port import port_state
from relnav.vehicle.rows import Rows

STEP = 1e-6


def rows_of(sensor, at, value, noise):
    """Rows of the only filter, in memory of their own."""
    rows = sensor.rows(at, value, noise)
    return Rows(rows.residual[0].copy(), rows.jacobian[0].copy(), rows.noise[0].copy(), rows.group)


def differences(sensor, at, value, noise):
    """d(predicted)/d(errors): the residual falls by it."""
    columns = []
    for i in range(at.values.shape[1]):
        d = np.zeros_like(at.values)
        d[0, i] = STEP
        ahead, back = (rows_of(sensor, at.corrected(s * d), value, noise).residual for s in (1.0, -1.0))
        columns.append((back - ahead) / (2.0 * STEP))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("name", ["camera", "psd"])
def test_lights(navigator, odd_state, name):
    sensor = navigator._filters.sensors[name]
    count = len(navigator.vehicle.points_m(name))
    spots, noise = np.zeros(2 * count), np.eye(2 * count)
    measured = differences(sensor, odd_state, spots, noise)
    largest = np.abs(measured).max()
    rows = rows_of(sensor, odd_state, spots, noise)
    np.testing.assert_allclose(rows.jacobian, measured, rtol=1e-5, atol=1e-7 * largest)
    assert (rows.noise == noise).all()


def frames(navigator, at, name):
    """C_LT, C_BL and C_SB, with what is known of the mounting."""
    C_BI, mount = at.dcm_inertial_from_chaser.T, at.values[navigator.layout.by_name[f"{name}.mount"]]
    C_SB = turned(np.eye(3), -mount) @ navigator.vehicle.sensor[name].dcm_sensor_from_chaser
    return at.dcm_lvlh_from_target, C_BI @ navigator._filters.frame.dcm_lvlh_from_inertial(at.t_s).T, C_SB


@pytest.mark.parametrize("name", ["camera", "psd"])
def test_lights_are_the_derived_ones(navigator, odd_state, derivatives, name):
    sensor, known, at = navigator._filters.sensors[name], odd_state.values[0], odd_state.of(0)
    optics, points, by_name = sensor._optics, navigator.vehicle.points_m(name), navigator.layout.by_name
    rows = rows_of(sensor, odd_state, np.zeros(2 * len(points)), np.eye(2 * len(points))).jacobian
    focal, lever, first = by_name[f"{name}.focal"], by_name[f"{name}.lever"], by_name[f"{name}.points"].start
    scale, lens = 1.0 + known[focal][0], optics["lens"] + known[lever]
    derived = derivatives.derivative(derivatives.spot_of_light, "spot", "errors", at_zero=True, **derivatives.LIGHT)
    for k, s in enumerate(points):
        place, expected = slice(first + 3 * k, first + 3 * k + 3), np.zeros((2, len(known)))
        given = s + known[place], known[:3], lens, scale * optics["focal_length"], optics["distortion"]
        by = derived(*frames(navigator, at, name), *given)
        blocks = [POSITION, TARGET_ATTITUDE, CHASER_ATTITUDE, by_name[f"{name}.mount"], lever, place]
        for number, block in enumerate(blocks):
            expected[:, block] = by[:, 3 * number : 3 * number + 3]
        expected[:, focal] = by[:, 18:] / scale
        np.testing.assert_allclose(rows[2 * k : 2 * k + 2], expected, rtol=1e-10, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["star", "sun_aps", "sun_birefringent"])
def test_directions_are_the_derived_ones(navigator, odd_state, derivatives, name):
    sensor, at = navigator._filters.sensors[name], odd_state.of(0)
    C_BI, C_SB = at.dcm_inertial_from_chaser.T, frames(navigator, at, name)[2]
    shapes = {"C_BI": (3, 3), "C_SB": (3, 3), "errors": (6,)}
    if name == "star":
        by = derivatives.derivative(derivatives.inertial_attitude, "theta", "errors", True, theta=(3,), **shapes)
        by, value, noise = by(C_BI, C_SB), (C_SB @ C_BI).ravel(), np.eye(3)
    else:
        line = sensor.sun(at.t_s)
        value, noise = C_SB @ C_BI @ line, np.zeros((3, 3))
        shapes |= {"line": (3,), "basis": (3, 2), "across": (2,)}
        by = derivatives.derivative(derivatives.direction, "across", "errors", True, **shapes)
        by = by(C_BI, C_SB, line, tangent_basis(value))
    rows = rows_of(sensor, odd_state, value, noise).jacobian
    expected = np.zeros_like(rows)
    expected[:, CHASER_ATTITUDE], expected[:, navigator.layout.by_name[f"{name}.mount"]] = by[:, :3], by[:, 3:]
    np.testing.assert_allclose(rows, expected, rtol=1e-10, atol=1e-13)


def test_stars(navigator, odd_state):
    sensor = navigator._filters.sensors["star"]
    mounted = navigator.vehicle.sensor["star"].dcm_sensor_from_chaser
    at = (mounted @ odd_state.dcm_inertial_from_chaser[0].T).ravel()
    rows = rows_of(sensor, odd_state, at, np.eye(3))
    np.testing.assert_allclose(rows.residual, 0.0, atol=1e-12)
    measured = differences(sensor, odd_state, at, np.eye(3))
    np.testing.assert_allclose(rows.jacobian, measured, atol=1e-8)
    assert np.abs(measured).max() > 0.9
    unseen = rows_of(sensor, odd_state, np.full(9, np.nan), np.eye(3))
    assert np.isnan(unseen.residual).all()


@pytest.mark.parametrize("name", ["sun_aps", "sun_birefringent"])
def test_sun(navigator, odd_state, name):
    """The measured direction is held: the predicted one must move as the rows say."""
    sensor = navigator._filters.sensors[name]
    line = odd_state.dcm_inertial_from_chaser[0].T @ sensor.sun(0.0)
    direction = navigator.vehicle.sensor[name].dcm_sensor_from_chaser @ line
    nothing = np.zeros((3, 3))
    rows = rows_of(sensor, odd_state, direction, nothing)
    np.testing.assert_allclose(rows.residual, 0.0, atol=1e-12)
    measured = differences(sensor, odd_state, direction, nothing)
    np.testing.assert_allclose(rows.jacobian, measured, atol=1e-8)
    alone = rows.jacobian[:, 12:15]
    assert np.linalg.matrix_rank(alone) == 2
    np.testing.assert_allclose(alone @ line, 0.0, atol=1e-12)  # a turn about the sun line is not seen
    spread = np.diag([1.0, 2.0, 3.0]) + 0.1
    basis = tangent_basis(direction)
    noise = rows_of(sensor, odd_state, direction, spread).noise
    np.testing.assert_allclose(noise, basis.T @ spread @ basis, rtol=1e-6)


def test_the_port(navigator, odd_state):
    """All twelve by every error that moves; attitude by its own definition."""

    def view(at):
        rate = navigator._filters.motion.chaser_rate(at, navigator._filters.samples)
        return port_state(navigator.vehicle, navigator._filters.frame, at.of(0), rate)

    here, J = view(odd_state)
    for i in range(MOVING):
        d = np.zeros_like(odd_state.values)
        d[0, i] = STEP
        a, b = view(odd_state.corrected(d))[0], view(odd_state.corrected(-d))[0]
        turn = 0.5 * (a.dcm_target_from_chaser @ b.dcm_target_from_chaser.T)
        theta = -np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        place, speed, rate = (getattr(a, n) - getattr(b, n) for n in ("position_m", "velocity_m_s", "rate_rad_s"))
        moved = np.concatenate([place, speed, theta, rate])
        np.testing.assert_allclose(J[:, i], moved / (2.0 * STEP), rtol=1e-5, atol=1e-7, err_msg=str(i))
    assert np.linalg.eigvalsh(here.covariance).min() > 0.0


def test_an_exact_look_moves_nothing(navigator, odd_state):
    """Spots, attitude and direction as predicted have no residual."""
    for name in ("camera", "psd"):
        sensor, count = navigator._filters.sensors[name], len(navigator.vehicle.points_m(name))
        spots = -rows_of(sensor, odd_state, np.zeros(2 * count), np.eye(2 * count)).residual
        seen, _ = sensor.taken(spots.reshape(-1, 2), None)
        residual = rows_of(sensor, odd_state, seen, np.eye(2 * count)).residual
        np.testing.assert_allclose(residual[np.isfinite(residual)], 0.0, atol=1e-9)
        assert np.isfinite(residual).sum() >= 4


def test_simulated_spots_are_those_of_the_filter(navigator, odd_state, short_run):
    """Without noise, with every lasting error known, truth and filter see the same to rounding."""
    truth, layout = short_run.truth, navigator.layout
    values = np.zeros((1, layout.size))
    for name, value in short_run.lasting.items():
        values[0, layout.by_name[name]] = value
    residuals = {"camera": [], "psd": [], "star": []}
    for seen in short_run.observations:
        if seen.sensor in residuals and abs(seen.t_s - 4.07) < 0.05:
            t = np.array([seen.t_s])
            values[:, :6] = truth.motion(t)
            now = odd_state._replace(
                t_s=seen.t_s,
                values=values,
                dcm_lvlh_from_target=truth.dcm_frame_from_target(t),
                dcm_inertial_from_chaser=np.ascontiguousarray(truth.dcm_chaser_from_inertial(t).transpose(0, 2, 1)),
            )
            value, noise = navigator._filters.sensors[seen.sensor].taken(seen.value, None)
            r = rows_of(navigator._filters.sensors[seen.sensor], now, value, noise).residual
            residuals[seen.sensor] += (r / np.sqrt(np.diagonal(noise)))[np.isfinite(r)].tolist()
    for name, scaled in residuals.items():
        assert len(scaled) >= 3, name
        assert np.abs(scaled).max() < 4.0, name  # of their noise alone
