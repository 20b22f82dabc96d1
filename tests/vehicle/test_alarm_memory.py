"""An alarm that ends does not end its fault: it holds, and when it was raised is remembered, in any order of events."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest

import relnav
from relnav.accuracy.rendezvous import true_port
from relnav.accuracy.vehicle_fault_flights import FLIGHT
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import VehicleFault, bent, with_fault
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.alarms import ASKED_EVERY_S, HOLDS_S, AlarmMemory, contradicting
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother


def test_what_holds():
    memory = AlarmMemory().noted(10.0, ("star", "gyro")).noted(11.0, ()).noted(12.0, ("gyro",))
    assert (memory.first_s, memory.last_s) == ({"star": 10.0, "gyro": 10.0}, {"star": 10.0, "gyro": 12.0})
    assert memory.held(12.5) == ("gyro", "star")
    assert memory.held(10.0 + HOLDS_S) == ("gyro", "star")
    assert memory.held(11.0 + HOLDS_S) == ("gyro",)
    assert memory.held(13.0 + HOLDS_S) == ()
    assert memory._replace(holds_from_s=10.0).held(12.5) == ("gyro",)


def test_a_clock_that_stays_off(vehicle):
    """The camera's, by a quarter of a second from 30 s on: alarms come and go, while the port is beyond its level."""
    start = dataclasses.replace(vehicle.hand_over, port_distance_m=(FLIGHT.start_m, 0.0, 0.0))
    run = simulate_rendezvous(dataclasses.replace(vehicle, hand_over=start), FLIGHT, seed=900)
    nav, second, beyond, raised, held = VehicleNavigator(run.truth.vehicle), 1, [], [], []
    for seen in with_fault(run, VehicleFault.CLOCK, "camera", np.random.default_rng(0), size=0.5):
        nav.observe(seen.sensor, seen.t_s, seen.value)
        if second <= nav.newest_s < run.truth.end_s - 0.1:
            now = nav.state(float(second))
            missed = np.abs(true_port(run, now.t_s)[0][:3] - now.port.position_m)
            beyond.append(bool((missed > now.port.protection_level_m()).any()))
            raised.append(bool(contradicting(now.drifts, now.sensors)))
            held.append(bool(now.alarms))
            second += 1
    first = held.index(True)
    assert 29 <= first < 60
    assert all(held[first:])
    assert sum(beyond[first:]) > 50
    assert not all(raised[k] for k in range(first, len(raised)) if beyond[k])  # what was said before
    now = nav.state()
    assert set(now.alarms) <= set(now.last_alarm_s) == set(now.first_alarm_s)
    assert abs(min(now.first_alarm_s.values()) - (first + 1)) <= ASKED_EVERY_S
    assert max(now.last_alarm_s.values()) > min(now.first_alarm_s.values()) + 10.0


@pytest.fixture(scope="module")
def wrong(slow):
    """A star sensor that is off by 3 deg from 5 s to 15 s; in the order in which observations arrive."""
    run = simulate_rendezvous(slow, Rendezvous(start_m=5.5, final_m=4.0, fast_m_s=0.05, slow_m_s=0.05), seed=9)
    off = np.radians(3.0)
    return [
        dataclasses.replace(seen, value=bent(slow, seen, "star", off if 5.0 < seen.t_s < 15.0 else 0.0))
        for seen in run.observations
    ]


def fed(vehicle, observations):
    nav = VehicleNavigator(vehicle)
    for seen in observations:
        nav.observe(seen.sensor, seen.t_s, seen.value)
    return nav


def test_in_any_order_and_in_copies(slow, wrong):
    arrived, in_time = fed(slow, wrong), fed(slow, sorted(wrong, key=lambda seen: seen.t_s))
    one, other = arrived.state(), in_time.state()
    assert "star" in one.first_alarm_s
    assert 5.0 < one.first_alarm_s["star"] < 15.0
    for now in (other, copy.deepcopy(arrived).state(), pickle.loads(pickle.dumps(one))):
        assert now.first_alarm_s == one.first_alarm_s
        assert now.last_alarm_s == one.last_alarm_s
        assert now.alarms == one.alarms
    before = arrived.state(arrived.newest_s - 1.0)
    assert before.last_alarm_s == in_time.state(arrived.newest_s - 1.0).last_alarm_s


def test_smoothed_it_says_what_the_filter_did(slow, wrong):
    smoother = VehicleSmoother(slow)
    for seen in wrong:
        smoother.observe(seen.sensor, seen.t_s, seen.value)
    early, late = smoother.estimates([4.0, 25.0])
    assert (early.alarms, early.last_alarm_s) == ((), {})
    assert "star" in late.alarms
    assert late.first_alarm_s == fed(slow, [seen for seen in wrong if seen.t_s <= 25.0]).state().first_alarm_s


def test_a_search_begins_anew(slow, wrong):
    """What was raised before the target was found does not hold, but is remembered."""
    start = dataclasses.replace(slow.hand_over, target_attitude_sigma_rad=np.pi)
    nav, found_s = VehicleNavigator(dataclasses.replace(slow, hand_over=start)), None
    for seen in sorted(wrong, key=lambda seen: seen.t_s):
        nav.observe(seen.sensor, seen.t_s, seen.value)
        if found_s is None and not nav.state().ambiguous:
            found_s = nav.newest_s
            memory = nav._timeline.newest.alarms
            assert memory.holds_from_s < found_s <= memory.holds_from_s + 1.0
    assert found_s is not None
    assert nav.state().restarts == 0


def test_nothing_is_remembered_of_a_healthy_flight(vehicle, short_run):
    now = fed(vehicle, short_run.observations).state()
    assert (now.alarms, now.first_alarm_s, now.last_alarm_s) == ((), {}, {})
    assert relnav.VehicleNavigator(vehicle).state().last_alarm_s == {}
