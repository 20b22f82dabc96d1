"""Every row of every sensor against differences: the state is moved as a correction moves it."""

from types import SimpleNamespace

import numpy as np
import pytest

from relnav.vehicle.layout import MOVING
from relnav.vehicle.port import port_state

STEP = 1e-6


def differences(rows, state, size, value):
    """d(predicted)/d(errors): the residual falls by it."""
    columns = []
    for i in range(size):
        d = np.zeros(size)
        d[i] = STEP
        ahead, back = (rows(state.corrected(s * d, state.covariance), value).residual for s in (1.0, -1.0))
        columns.append((back - ahead) / (2.0 * STEP))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("name", ["camera", "psd"])
def test_lights(navigator, odd_state, name):
    sensor = navigator._sensors[name]
    count = len(navigator.vehicle.points_m(name))
    rows = sensor.rows(odd_state, np.zeros(2 * count), np.eye(2 * count))
    measured = differences(
        lambda s, z: sensor.rows(s, z, np.eye(2 * count)), odd_state, navigator.layout.size, np.zeros(2 * count)
    )
    largest = np.abs(measured).max()
    np.testing.assert_allclose(rows.jacobian, measured, rtol=1e-5, atol=1e-7 * largest)


def test_stars(navigator, odd_state):
    sensor = navigator._sensors["star"]
    at = (sensor.dcm_sensor_from_chaser(odd_state) @ odd_state.dcm_inertial_from_chaser.T).ravel()
    rows = sensor.rows(odd_state, at, np.eye(3))
    np.testing.assert_allclose(rows.residual, 0.0, atol=1e-12)
    measured = differences(lambda s, z: sensor.rows(s, z, np.eye(3)), odd_state, navigator.layout.size, at)
    np.testing.assert_allclose(rows.jacobian, measured, atol=1e-8)
    assert np.abs(measured).max() > 0.9


@pytest.mark.parametrize("name", ["sun_aps", "sun_birefringent"])
def test_sun(navigator, odd_state, name):
    """The measured direction is held: the predicted one must move as the rows say."""
    sensor = navigator._sensors[name]

    def predicted(state):
        return sensor.dcm_sensor_from_chaser(state) @ state.dcm_inertial_from_chaser.T @ sensor.sun(state.t_s)

    direction = predicted(odd_state)
    rows = sensor.rows(odd_state, direction, np.zeros((3, 3)))
    np.testing.assert_allclose(rows.residual, 0.0, atol=1e-12)
    nothing = np.zeros((3, 3))
    measured = differences(lambda s, z: sensor.rows(s, z, nothing), odd_state, navigator.layout.size, direction)
    np.testing.assert_allclose(rows.jacobian, measured, atol=1e-8)
    alone = rows.jacobian[:, 12:15]
    assert np.linalg.matrix_rank(alone) == 2
    line = odd_state.dcm_inertial_from_chaser.T @ sensor.sun(0.0)
    np.testing.assert_allclose(alone @ line, 0.0, atol=1e-12)  # a turn about the sun line is not seen


def test_the_port(navigator, odd_state):
    """All twelve by every error that moves; attitude by its own definition."""
    motion = navigator._motion

    def view(state):
        port, _ = port_state(navigator.vehicle, navigator._frame, state, motion.chaser_rate(state))
        return port

    here, J = port_state(navigator.vehicle, navigator._frame, odd_state, motion.chaser_rate(odd_state))
    size = navigator.layout.size
    for i in range(MOVING):
        d = np.zeros(size)
        d[i] = STEP
        a, b = view(odd_state.corrected(d, odd_state.covariance)), view(odd_state.corrected(-d, odd_state.covariance))
        turn = 0.5 * (a.dcm_target_from_chaser @ b.dcm_target_from_chaser.T)
        theta = -np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        place, speed, rate = (getattr(a, n) - getattr(b, n) for n in ("position_m", "velocity_m_s", "rate_rad_s"))
        moved = np.concatenate([place, speed, theta, rate])
        np.testing.assert_allclose(J[:, i], moved / (2.0 * STEP), rtol=1e-5, atol=1e-7, err_msg=str(i))
    assert np.linalg.eigvalsh(here.covariance).min() > 0.0


def test_an_exact_look_moves_nothing(navigator, odd_state):
    """Spots, attitude and direction as predicted have no residual."""
    for name in ("camera", "psd"):
        sensor, count = navigator._sensors[name], len(navigator.vehicle.points_m(name))
        spots = -sensor.rows(odd_state, np.zeros(2 * count), np.eye(2 * count)).residual
        seen, _ = sensor.taken(spots.reshape(-1, 2), None)
        residual = sensor.rows(odd_state, seen, np.eye(2 * count)).residual
        np.testing.assert_allclose(residual[np.isfinite(residual)], 0.0, atol=1e-9)
        assert np.isfinite(residual).sum() >= 4


def test_simulated_spots_are_those_of_the_filter(navigator, short_run):
    """Without noise, with every lasting error known, truth and filter see the same to rounding."""
    truth, layout = short_run.truth, navigator.layout
    t = np.array([4.07])
    values = np.zeros(layout.size)
    values[:6] = truth.motion(t)[0]
    for name, value in short_run.lasting.items():
        values[layout.by_name[name]] = value
    state = SimpleNamespace(
        t_s=4.07,
        values=values,
        dcm_lvlh_from_target=truth.frame_from_target(t)[0].as_matrix(),
        dcm_inertial_from_chaser=truth.chaser_from_inertial(t)[0].as_matrix().T,
    )
    residuals = {"camera": [], "psd": [], "star": []}
    for seen in short_run.observations:
        if seen.sensor in residuals and abs(seen.t_s - 4.07) < 0.05:
            now = SimpleNamespace(**vars(state))
            at = np.array([seen.t_s])
            now.t_s, now.values = seen.t_s, values.copy()
            now.values[:6] = truth.motion(at)[0]
            now.dcm_lvlh_from_target = truth.frame_from_target(at)[0].as_matrix()
            now.dcm_inertial_from_chaser = truth.chaser_from_inertial(at)[0].as_matrix().T
            value, noise = navigator._sensors[seen.sensor].taken(seen.value, None)
            r = navigator._sensors[seen.sensor].rows(now, value, noise).residual
            residuals[seen.sensor] += (r / np.sqrt(np.diagonal(noise)))[np.isfinite(r)].tolist()
    for name, scaled in residuals.items():
        assert len(scaled) >= 3, name
        assert np.abs(scaled).max() < 4.0, name  # of their noise alone
