"""The filter that is told no command: what it expects, that commands do not reach it, and what it is for."""

import dataclasses
import math

import numpy as np
import pytest

from relnav.accuracy.rendezvous import true_port
from relnav.estimation.consistency import chi_square_interval, nees
from relnav.geometry.rotation_vector import attitude_error
from relnav.simulation.lasting_faults import direction
from relnav.simulation.rendezvous import Rendezvous, Truth
from relnav.simulation.vehicle_numbers import InTurn
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.acquisition import locked_out
from relnav.vehicle.layout import SLOW_ACCELERATION, VELOCITY, layout_of, untold
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.separation import FAULT_PROBABILITY, protection_level_m
from relnav.vehicle.state import start_state

FLIGHT = Rendezvous(start_m=5.5, final_m=2.5, fast_m_s=0.1, slow_m_s=0.1)
BEGINS_S = 8.0


@pytest.fixture(scope="module")
def runs(slow):
    return [simulate_rendezvous(slow, FLIGHT, seed=seed) for seed in range(72, 84)]


def in_order(run):
    return sorted(run.observations, key=lambda seen: seen.t_s)


def port_errors(run, now, port):
    """Truth less one filter's port, (12,)."""
    true, dcm = true_port(run, now.t_s)
    error = true - np.concatenate([port.position_m, port.velocity_m_s, np.zeros(3), port.rate_rad_s])
    error[6:9] = attitude_error(port.dcm_target_from_chaser, dcm)
    return error


def test_no_command_reaches_it(slow, runs):
    """Of the times of commands it takes note, of what they say it does not: bit for bit, late ones too."""
    told, lied = (VehicleNavigator(slow, monitor=False, separation=True) for _ in range(2))
    rng = np.random.default_rng(1)
    for seen in [one for one in runs[0].observations if one.t_s < 12.0]:
        told.observe(seen.sensor, seen.t_s, seen.value)
        lie = 3e-4 * rng.normal(size=3) if seen.sensor == "thrust" and seen.t_s >= 4.0 else None
        value = seen.value if lie is None else seen.value + lie
        lied.observe(seen.sensor, seen.t_s, value)
    one, other = told.state(12.0), lied.state(12.0)
    assert other.restarts == 0
    assert np.abs(one.port.position_m - other.port.position_m).max() > 0.3 * one.port.sigma[0]
    for name in ("position_m", "velocity_m_s", "dcm_target_from_chaser", "rate_rad_s", "covariance"):
        mine, its = getattr(one.without["thrust"], name), getattr(other.without["thrust"], name)
        assert mine.tobytes() == its.tobytes(), name


@pytest.mark.parametrize(("lasts_s", "step_s", "more"), [(10.0, 0.1, 0.006), (3.0, 0.1, 0.02), (10.0, 1.0, 0.06)])
def test_unseen_it_is_pushed_as_singer_says(slow, lasts_s, step_s, more):
    """Of what nobody measures, the double integral over time of w(t - u) w(t - v) sigma^2 exp(-|u - v| / tau).

    w = 1 of velocity, its argument of position. No less than that, and little more: a step holds an acceleration.
    """
    thrust = dataclasses.replace(slow.thrust, largest_m_s2=0.05, lasts_s=lasts_s)
    nav, t_s = VehicleNavigator(dataclasses.replace(slow, thrust=thrust), monitor=False, separation=True), 8.0
    for k in range(round(t_s / step_s)):
        nav.observe("thrust", step_s * k, [0.02, 0.0, 0.0])
    now, begin = nav.state(t_s), slow.hand_over
    u = (np.arange(1000) + 0.5) * t_s / 1000
    together = (0.05 * t_s / 1000) ** 2 * np.exp(-np.abs(u[:, None] - u) / lasts_s)
    speed = math.sqrt(together.sum() + begin.velocity_sigma_m_s**2)
    place = math.sqrt(
        (t_s - u) @ together @ (t_s - u) + begin.position_sigma_m**2 + (begin.velocity_sigma_m_s * t_s) ** 2
    )
    sigma = now.without["thrust"].sigma[:6] / np.repeat([place, speed], 3)
    assert sigma.min() > 0.998
    assert sigma.max() < 1.0 + more
    assert now.without["gyro"].sigma[3:6].max() < 0.1 * speed
    drifted = now.port.velocity_m_s - now.without["thrust"].velocity_m_s
    assert np.abs(drifted).max() == pytest.approx(0.02 * t_s, rel=0.05)  # what it was not told


def test_in_a_step_it_is_pushed_too(slow):
    """Of what was known exactly: the white change of an acceleration, twice integrated, times what is left of it."""
    nav, dt = VehicleNavigator(slow, monitor=False, separation=True), 0.8
    start, f = nav._filters.start.estimates.copied(), list(nav.state().without).index("thrust") + 1
    start.covariance[:] = 0.0
    after = nav._filters.motion.settled(start, nav._filters.samples, dt).covariance[f]
    spread = np.array([[dt**4 / 20, dt**3 / 8, dt**2 / 6], [dt**3 / 8, dt**2 / 3, dt / 2], [dt**2 / 6, dt / 2, 1.0]])
    left = -(slow.thrust.largest_m_s2**2) * math.expm1(-2.0 * dt / slow.thrust.lasts_s)
    for i in range(3):
        place = np.array([i, VELOCITY.start + i, SLOW_ACCELERATION.start + i])
        np.testing.assert_allclose(after[np.ix_(place, place)], left * spread, rtol=1e-3)


def test_after_a_lock_out_it_expects_the_same(slow):
    """Each filter forgets to what it expects itself."""
    layouts = [layout_of(slow), untold(layout_of(slow), slow)]
    filters = VehicleNavigator(slow)._filters
    start = start_state(filters._begin, layouts, filters.frame, 0)
    sigma = np.sqrt(np.diagonal(locked_out(start, layouts, slow).covariance, axis1=1, axis2=2))
    expected = [slow.motion.slow_acceleration_sigma_m_s2], [slow.thrust.largest_m_s2]
    np.testing.assert_allclose(sigma[:, SLOW_ACCELERATION], np.repeat(expected, 3, axis=1), rtol=1e-12)
    np.testing.assert_allclose(sigma[0, VELOCITY], sigma[1, VELOCITY], rtol=0.0)


def test_without_a_fault_it_is_honest(slow, runs):
    """NEES over the port's twelve, two epochs a run: down to a half of them, as nobody pushes as hard as it expects."""
    errors, covariances = [], []
    for run in runs:
        nav, epochs = VehicleNavigator(slow, monitor=False, separation=True), [12.0, 26.0]
        for seen in in_order(run):
            if epochs and seen.t_s > epochs[0]:
                now = nav.state(epochs.pop(0))
                errors.append(port_errors(run, now, now.without["thrust"]))
                covariances.append(now.without["thrust"].covariance)
            nav.observe(seen.sensor, seen.t_s, seen.value)
    ratio = np.mean(nees(np.array(errors), np.array(covariances))) / 12.0
    assert len(errors) == 2 * len(runs)
    assert 0.5 < ratio < chi_square_interval(12 * len(runs), 0.9999)[1]


def levels(vehicle, run, leak_m_s2):
    """Each second after a leak begins: error over the level, over that without the new filter, over that of no fault.

    In a filter that goes on with what it has; and whether there was an alarm.
    """
    patient = dataclasses.replace(vehicle, filter=dataclasses.replace(vehicle.filter, restart_after_s=1e3))
    nav, second, out = VehicleNavigator(patient, separation=True), BEGINS_S + 1.0, []
    leak = leak_m_s2 * direction(np.random.default_rng(5), 3)
    for seen in in_order(run):
        untrue = seen.sensor == "thrust" and seen.t_s >= BEGINS_S
        nav.observe(seen.sensor, seen.t_s, seen.value - leak if untrue else seen.value)
        if seen.t_s >= second:
            second, now = seen.t_s + 1.0, nav.state()
            off = np.abs(true_port(run, now.t_s)[0][:3] - now.port.position_m)
            others = {name: port for name, port in now.without.items() if name != "thrust"}
            bounds = now.protection_level_m(), protection_level_m(now.port, others, 1e-7, FAULT_PROBABILITY)
            out.append([*((off / bound).max() for bound in (*bounds, now.port.protection_level_m())), bool(now.alarms)])
    return np.array(out)


@pytest.mark.parametrize("leak_m_s2", [1e-4, 1e-3, 0.02])
def test_a_leak_of_any_size_stays_below_the_level(slow, runs, leak_m_s2):
    """All the time, alarm or not, up to a valve that is stuck open."""
    worst = np.array([levels(slow, run, leak_m_s2).max(axis=0) for run in runs[:4]])
    assert worst[:, 0].max() < 1.0
    assert worst[:, 3].all()


def test_without_this_filter_the_level_does_not_hold(slow, runs):
    """All others are pushed alike, so that their differences say nothing."""
    with_it, without_it, no_fault, _ = levels(slow, runs[0], 1e-3).max(axis=0)
    assert with_it < 1.0 < without_it < no_fault


def test_guidance_orders_no_more_than_the_thrusters_give(slow):
    weak = dataclasses.replace(slow, thrust=dataclasses.replace(slow.thrust, largest_m_s2=2e-4))
    most = [max(np.abs(a).max() for _, a in Truth(one, FLIGHT, InTurn(72)).commands) for one in (slow, weak)]
    assert most[0] > 1e-3
    assert 1.9e-4 < most[1] < 2.1e-4  # along axes that are some mrad off the chaser's
