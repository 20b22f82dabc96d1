"""Commanded acceleration and impulses: logs flown with them are consistent with them, and not without."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import relnav

LIMIT = chi2.isf(1e-6, 6)
N = 1000


@pytest.fixture(scope="module")
def flown(vbar, drift, look):
    """Accelerations held for a second each and an impulse every ten seconds, on uneven epochs."""
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.05, 0.15, size=N))
    acceleration = np.repeat(1e-3 * rng.normal(size=(N // 10, 3)), 10, axis=0)
    impulse = np.zeros((N, 3))
    impulse[50::100] = 0.005 * rng.normal(size=(N // 100, 3))
    truth = drift(vbar, t, [8.5, 0.1, -0.1, 0.0, 0.0, 0.0], acceleration, impulse)
    return t, truth, look(vbar, truth, seed=8), acceleration, impulse


def late(flight, solution, nees):
    _, truth, *_ = flight
    return nees((solution.state - truth)[300:], solution.covariance[300:])


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_told_of_both_the_filter_is_consistent(vbar, flown, nees, method):
    t, _, spots, acceleration, impulse = flown
    solution = relnav.filter_epochs(vbar, t, spots, acceleration_m_s2=acceleration, delta_v_m_s=impulse, method=method)
    values = late(flown, solution, nees)
    assert values.max() < LIMIT
    assert values.mean() < 9.0
    assert solution.restarts == 0


@pytest.mark.parametrize("withheld", ["acceleration_m_s2", "delta_v_m_s"])
def test_not_told_of_one_it_is_not(vbar, flown, nees, withheld):
    t, _, spots, acceleration, impulse = flown
    control = {"acceleration_m_s2": acceleration, "delta_v_m_s": impulse}
    del control[withheld]
    solution = relnav.filter_epochs(vbar, t, spots, **control)
    assert late(flown, solution, nees).mean() > 20.0


def perfect(model):
    """No process noise and no execution error."""
    return replace(
        model,
        process_noise=replace(
            model.process_noise,
            acceleration_noise_density_m2_s3=0.0,
            control_magnitude_sigma=0.0,
            control_direction_sigma_rad=0.0,
        ),
    )


def test_prediction_over_control_is_exact(vbar, drift, look):
    """After the images stop, the state moves as the equations say, from wherever it was."""
    model = perfect(vbar)
    t = np.concatenate([0.1 * np.arange(100), 9.9 + np.array([0.3, 1.7, 40.0])])
    rng = np.random.default_rng(6)
    acceleration, impulse = 1e-3 * rng.normal(size=(2, len(t), 3))
    spots = look(model, drift(model, t, [8.5, 0.1, -0.1, 0.0, 0.0, 0.0], acceleration, impulse))
    spots[100:] = np.nan
    solution = relnav.filter_epochs(
        model, t, spots, acceleration_m_s2=acceleration, delta_v_m_s=impulse, method="spots"
    )
    expected = drift(model, t[99:], solution.state[99], acceleration[99:], impulse[99:])
    np.testing.assert_allclose(solution.state[99:], expected, rtol=0.0, atol=1e-11)


def growth(model, t, **control):
    """What the covariance gains over one step without an image, beyond the transition."""
    navigator = relnav.Navigator(model, method="spots")
    base = relnav.Navigator(perfect(model), method="spots")
    spots = np.array([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]])
    for k in range(3):
        navigator.step(0.1 * k, spots)
        base.step(0.1 * k, spots)
    # The same state and covariance before the step, apart from 0.2 s of process noise.
    nothing = np.full((3, 2), np.nan)
    return navigator.step(t, nothing, **control).covariance - navigator_without(model, t, spots, nothing)


def navigator_without(model, t, spots, nothing):
    other = relnav.Navigator(model, method="spots")
    for k in range(3):
        other.step(0.1 * k, spots)
    return other.step(t, nothing).covariance


def test_execution_error_of_an_impulse(vbar):
    """1 % along and 0.5 deg across, straight into the velocity covariance."""
    added = growth(vbar, 0.3, delta_v_m_s=[0.0, 0.3, 0.0])
    along, across = 0.01 * 0.3, np.radians(0.5) * 0.3
    np.testing.assert_allclose(added[3:, 3:], np.diag([across**2, along**2, across**2]), rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(added[:3, :3], 0.0, atol=1e-12)


def test_execution_error_of_an_acceleration(vbar):
    """(1 % of a)^2 times 30 s as white noise: over dt the velocity variance gains that times dt."""
    a, dt = 0.02, 0.5
    added = growth(vbar, 0.2 + dt, acceleration_m_s2=[a, 0.0, 0.0])
    along, across = (0.01 * a) ** 2 * 30.0, (np.radians(0.5) * a) ** 2 * 30.0
    np.testing.assert_allclose(np.diag(added)[3:], np.array([along, across, across]) * dt, rtol=1e-4)
    np.testing.assert_allclose(np.diag(added)[:3], np.array([along, across, across]) * dt**3 / 3, rtol=1e-4)


def test_the_order_of_an_impulse(vbar):
    """Just before its row: the velocity of that row has it, the position not yet."""
    spots = np.array([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]])
    nothing = np.full((3, 2), np.nan)
    told, untold = relnav.Navigator(vbar, method="spots"), relnav.Navigator(vbar, method="spots")
    for k in range(3):
        told.step(0.1 * k, spots)
        untold.step(0.1 * k, spots)
    difference = told.step(1.0, nothing, delta_v_m_s=[0.1, 0.2, 0.3]).state - untold.step(1.0, nothing).state
    np.testing.assert_allclose(difference, [0, 0, 0, 0.1, 0.2, 0.3], atol=1e-14)
