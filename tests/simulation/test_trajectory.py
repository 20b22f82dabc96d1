"""The flown approach: starts where it should, reaches its hold, and logs the control it flew."""

import dataclasses
import math

import numpy as np
import pytest

from relnav.dynamics.clohessy_wiltshire import propagate
from relnav.dynamics.process_noise import NODES
from relnav.dynamics.relative_motion import orbit_vector, propagate_into
from relnav.mission import Camera, Docking, Orbit, ProcessNoise
from relnav.simulation.trajectory import Approach, fly

R_BAR = Docking((0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)), (0.1, -0.2, 1.5))
R_BAR_DCM = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # x_dock = +z, y_dock = +y, z_dock = -x
HARSH = {"j2": True, "air_density_kg_m3": 4e-12, "thrust_scale_error": 0.01}


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.mark.parametrize("given", [{}, HARSH, {"true_anomaly_deg": 130.0, "inclination_deg": 98.0}])
def test_reaches_the_hold_and_stays(make_model, given: dict) -> None:
    """10 m to 4 m at 3 cm/s: steady until 0.5 m are left after 183 s, then a decay of 1/0.06 s: 1 mm after 290 s."""
    t, truth, _ = fly(make_model(), Approach(**given), rng())
    assert t.shape == (3000,)
    np.testing.assert_allclose(t, np.arange(3000) / 10.0, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(truth[0], [10.0, 0.25, -0.15, 0.0, 0.0, 0.0], rtol=0.0, atol=1e-8)
    held = truth[t > 290.0]
    np.testing.assert_allclose(held[:, :3], np.broadcast_to([4.0, 0.0, 0.0], (len(held), 3)), rtol=0.0, atol=0.002)
    np.testing.assert_allclose(held[:, 3:], 0.0, atol=1e-3)
    cruise = truth[(t > 100.0) & (t < 183.0)]
    np.testing.assert_allclose(cruise[:, 3], -0.03, rtol=0.0, atol=1e-3)


def test_r_bar_with_a_port_off_the_centre_of_mass(make_model) -> None:
    t, truth, _ = fly(make_model(docking=R_BAR), Approach(), rng())
    port = np.array([0.1, -0.2, 1.5])
    np.testing.assert_allclose(R_BAR_DCM @ (truth[0, :3] - port), [10.0, 0.25, -0.15], rtol=0.0, atol=1e-8)
    held = (truth[t > 290.0, :3] - port) @ R_BAR_DCM.T
    np.testing.assert_allclose(held, np.broadcast_to([4.0, 0.0, 0.0], held.shape), rtol=0.0, atol=0.015)


def test_eccentric_orbit(make_model, truth) -> None:
    t, states, _ = fly(make_model(orbit=Orbit(truth.n, 0.008)), Approach(), rng())
    np.testing.assert_allclose(states[t > 290.0, :3].mean(axis=0), [4.0, 0.0, 0.0], rtol=0.0, atol=0.015)


def misses(model, approach, orbit) -> np.ndarray:
    """By how much each row (n,) misses what the row before it says, m/s, with the target on an orbit (4,)."""
    t, states, command = fly(model, approach, rng())
    out, phi, q, effect = np.empty(len(t) - 1), np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    for k in range(1, len(t)):
        dt = t[k] - t[k - 1]
        assert propagate_into(
            orbit, t[k - 1], dt, command[k], np.zeros((3, 3)), phi, q, effect, np.empty((NODES, 6, 6)), np.empty((6, 6))
        )
        out[k - 1] = np.linalg.norm((phi @ states[k - 1] + effect - states[k])[3:])
    return out


@pytest.mark.parametrize("given", [{}, {"true_anomaly_deg": 250.0}])
def test_the_logs_clock_is_the_models(make_model, truth, given: dict) -> None:
    """The motion is that of the model's orbit and phase, row by row over a tenth of an orbit; of no other phase."""
    theta = 2.0 if not given else math.radians(250.0)
    model = make_model(orbit=Orbit(truth.n, 0.1, 2.0))
    approach = Approach(duration_s=600.0, rate_hz=1.0, **given)
    assert misses(model, approach, orbit_vector(truth.n, 0.1, theta)).max() < 1e-8
    assert misses(model, approach, orbit_vector(truth.n, 0.1, theta + 0.1)).max() > 1e-7
    assert misses(model, approach, orbit_vector(truth.n)).max() > 1e-6


@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
@pytest.mark.parametrize("scale_error", [0.0, 0.01])
def test_the_command_of_a_row_acted_over_the_interval_that_ends_there(make_model, truth, rate_hz, scale_error) -> None:
    """Row by row with Clohessy-Wiltshire: shifted by one row the difference would be 1e-5 m/s, not 1e-8."""
    approach = Approach(duration_s=60.0, rate_hz=rate_hz, thrust_scale_error=scale_error)
    _, states, command = fly(make_model(), approach, rng())
    np.testing.assert_array_equal(command[0], 0.0)
    for k in range(1, len(states)):
        acted = (1.0 + scale_error) * command[k]
        expected = propagate(states[k - 1], truth.n, 1.0 / rate_hz, acceleration_m_s2=acted)
        np.testing.assert_allclose(states[k, :3], expected[:3], rtol=0.0, atol=2e-8)
        np.testing.assert_allclose(states[k, 3:], expected[3:], rtol=0.0, atol=2e-8)
    changes = np.abs(np.diff(command, axis=0)).max(axis=1)
    assert np.count_nonzero(changes) == (60 if rate_hz == 10.0 else 59)  # the guidance gives one order a second
    assert np.median(changes[changes > 0.0]) > 1e-6


def test_assumed_noise_is_what_the_process_noise_says(make_model, truth) -> None:
    """Kicks whitened by q I + tau (s_m^2 a a^T + s_d^2 (|a|^2 I - a a^T)), times dt: chi-square, 2.5 % at 1-sigma."""
    noise = ProcessNoise(1e-9, 0.05, 0.02, 30.0)
    approach = Approach(duration_s=200.0, assumed_noise=True, start_m=(10.0, 3.0, -2.0))
    _, states, command = fly(make_model(process_noise=noise), approach, rng())
    squares, share = [], []
    for k in range(1, len(states)):
        kick = (states[k] - propagate(states[k - 1], truth.n, 0.1, acceleration_m_s2=command[k]))[3:]
        a = command[k]
        control = 30.0 * (0.05**2 * np.outer(a, a) + 0.02**2 * (a @ a * np.eye(3) - np.outer(a, a)))
        squares.append(kick @ np.linalg.solve((1e-9 * np.eye(3) + control) * 0.1, kick))
        share.append(np.trace(control) / 3e-9)
    assert np.mean(squares) / 3.0 == pytest.approx(1.0, abs=0.08)
    loud = np.array(share) > 1.0  # where control errors dominate
    assert loud.sum() > 300
    assert np.mean(np.array(squares)[loud]) / 3.0 == pytest.approx(1.0, abs=0.2)


def test_assumed_start_draws_the_velocity_from_the_prior(make_model) -> None:
    approach = Approach(duration_s=0.2, assumed_start=True)
    drawn = np.array([fly(make_model(), approach, np.random.default_rng(i))[1][0, 3:] for i in range(400)])
    assert drawn.std() == pytest.approx(0.1, rel=0.1)
    assert abs(drawn.mean()) < 0.015


def test_the_camera_and_its_lever_do_not_matter_to_the_orbit(make_model) -> None:
    plain = fly(make_model(), Approach(duration_s=20.0), rng())[1]
    moved = fly(make_model(camera=Camera((0.5, 0.0, 0.0))), Approach(duration_s=20.0), rng())[1]
    np.testing.assert_array_equal(plain, moved)


@pytest.mark.parametrize("name", ["duration_s", "rate_hz", "final_range_m", "speed_m_s"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_impossible_approach(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} must be positive and finite; got"):
        dataclasses.replace(Approach(), **{name: value})


def test_too_short_to_be_a_log(make_model) -> None:
    with pytest.raises(ValueError, match="two epochs or more; got 1"):
        fly(make_model(), Approach(duration_s=0.1, rate_hz=10.0), rng())
