"""With one sensor at fault the port's error stays below the level; the level without faults does not hold."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm

from relnav.accuracy.rendezvous import true_port
from relnav.errors import UsageError
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import bent, ramp_of
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.port import PortState
from relnav.vehicle.separation import protection_level_m

FLIGHT = Rendezvous(start_m=5.5, final_m=2.5, fast_m_s=0.1, slow_m_s=0.1)
SENSORS = ("gyro", "camera", "psd", "star", "sun_aps", "sun_birefringent")
"""Of thrusters: `test_thrust_fault`."""


@pytest.fixture(scope="module")
def run(slow):
    return simulate_rendezvous(slow, FLIGHT, seed=72)


def flown(vehicle, run, name, sigmas):
    """Each second after the fault begins: error over the level with one sensor at fault, and over that without."""
    nav, second, shares = VehicleNavigator(vehicle, separation=True), 9.0, []
    full = ramp_of(vehicle, name) / 5.0 * sigmas if name else 0.0
    for seen in sorted(run.observations, key=lambda observation: observation.t_s):
        share = min(max((seen.t_s - 8.0) / 20.0, 0.0), 1.0)
        nav.observe(seen.sensor, seen.t_s, bent(vehicle, seen, name, share * full))
        if seen.t_s >= second:
            second, now = seen.t_s + 1.0, nav.state()
            off = np.abs(true_port(run, now.t_s)[0][:3] - now.port.position_m)
            shares.append(((off / now.protection_level_m()).max(), (off / now.port.protection_level_m()).max()))
    return np.array(shares)


@pytest.mark.parametrize("sigmas", [5.0, 20.0])
@pytest.mark.parametrize("name", SENSORS)
def test_a_ramp_in_any_one_sensor_stays_below_the_level(slow, run, name, sigmas):
    """All the time, alarm or not: the ramp of the report, and one of four times its size."""
    assert flown(slow, run, name, sigmas)[:, 0].max() < 1.0


def test_the_level_without_faults_does_not_hold_then(slow, run):
    """In a filter that goes on with what it has; usually it would be locked out, and start anew."""
    patient = dataclasses.replace(slow, filter=dataclasses.replace(slow.filter, restart_after_s=1e3))
    with_one_at_fault, without = flown(patient, run, "psd", 20.0).max(axis=0)
    assert with_one_at_fault < 1.0 < without


def test_the_told_estimate_and_the_alarms_are_the_same(slow, run):
    alone, beside = VehicleNavigator(slow), VehicleNavigator(slow, separation=True)
    seen_first = sorted(run.observations, key=lambda observation: observation.t_s)[:200]
    for seen in seen_first:
        assert alone.observe(seen.sensor, seen.t_s, seen.value) is beside.observe(seen.sensor, seen.t_s, seen.value)
    one, other = alone.state(), beside.state()
    assert one.covariance.tobytes() == other.covariance.tobytes()
    assert one.values.tobytes() == other.values.tobytes()
    assert repr(dict(one.sensors)) == repr(dict(other.sensors))
    assert one.without == {}
    assert tuple(other.without) == ("gyro", "thrust", *SENSORS[1:])


@pytest.mark.parametrize("name", ["gyro", "psd"])
def test_a_filter_without_a_sensor_is_one_that_never_saw_it(slow, run, name):
    never, beside = VehicleNavigator(slow, monitor=False), VehicleNavigator(slow, separation=True)
    for seen in sorted(run.observations, key=lambda observation: observation.t_s)[:400]:
        beside.observe(seen.sensor, seen.t_s, seen.value)
        if seen.sensor != name:
            never.observe(seen.sensor, seen.t_s, seen.value)
    t_s = beside.newest_s
    one, other = never.state(t_s).port, beside.state(t_s).without[name]
    np.testing.assert_allclose(other.position_m, one.position_m, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(other.rate_rad_s, one.rate_rad_s, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(other.sigma, one.sigma, rtol=1e-4)


def test_it_is_the_largest_of_separation_and_sigmas():
    def port(x, sigma):
        return PortState(np.array([x, 0.0, 0.0]), np.zeros(3), np.eye(3), np.zeros(3), sigma**2 * np.eye(12))

    own, without = port(1.0, 0.01), {"a": port(1.3, 0.02), "b": port(0.9, 0.01)}
    level = protection_level_m(own, without, 3e-6, 1e-3)
    free, fault = norm.isf(0.5e-6), norm.isf(0.5e-3)
    across = max(0.01 * free, 0.02 * fault)
    np.testing.assert_allclose(level, [0.3 + 0.02 * fault, across, across])
    with pytest.raises(UsageError, match="separation=True"):
        protection_level_m(own, {}, 1e-7, 1e-3)
    for wrong in (-0.1, 0.0, 1.0, 1.5, 2.0, np.nan):
        with pytest.raises(UsageError, match=r"^probability lies between 0 and 1; got"):
            protection_level_m(own, without, wrong, 1e-3)
        with pytest.raises(UsageError, match=r"^probability lies between 0 and 1; got"):
            own.protection_level_m(wrong)
    for wrong in (0.0, 1.1, np.nan):
        with pytest.raises(UsageError, match=r"^fault_probability lies between 0 and 1; got"):
            protection_level_m(own, without, 1e-7, wrong)
    with pytest.raises(ValueError, match=r"^probability"):
        own.protection_level_m("x")
    np.testing.assert_allclose(own.protection_level_m(3e-6), 0.01 * norm.isf(1.5e-6))
    assert (protection_level_m(own, without, 1e-7, 1.0) > protection_level_m(own, without, 1e-7, 0.1)).all()
