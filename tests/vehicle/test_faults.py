"""What `relnav accuracy --faults` does to a vehicle's sensors, and that its bars can fail."""

import dataclasses
import math

import numpy as np
import pytest

from relnav.accuracy import vehicle_fault_flights, vehicle_faults
from relnav.accuracy.vehicle_fault_flights import (
    Flown,
    back_after_s,
    cases,
    fly_fault,
    fly_run,
    lost_flight,
    worse_later,
)
from relnav.accuracy.vehicle_faults import FaultRow, VehicleFaultsReport
from relnav.simulation import vehicle_faults as vehicle_faults_simulated
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import (
    GLINT_RAD,
    JUMP_S,
    LATE_S,
    LEAK_M_S2,
    WEAK_SHARE,
    VehicleFault,
    with_fault,
)
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.navigator import VehicleNavigator

FLIGHT = Rendezvous(start_m=5.5, final_m=2.5, fast_m_s=0.1, slow_m_s=0.1)
BEGINS_S, LASTS_S = 10.0, 10.0


@pytest.fixture(scope="module")
def run(slow):
    return simulate_rendezvous(slow, FLIGHT, seed=72)


@pytest.fixture(autouse=True)
def _soon(monkeypatch):
    """Faults of a short flight."""
    for module in (vehicle_fault_flights, vehicle_faults, vehicle_faults_simulated):
        monkeypatch.setattr(module, "BEGINS_S", BEGINS_S)
        monkeypatch.setattr(module, "LASTS_S", LASTS_S)
    monkeypatch.setattr(vehicle_fault_flights, "RETURNS_S", round(BEGINS_S + LASTS_S))


def changed(run, fault, name):
    """(usual, faulty) observations of one sensor, in order of exposure, and all that a navigator takes."""
    rng = np.random.default_rng(5)
    taken = with_fault(run, fault, name, rng)
    usual = sorted((seen for seen in run.observations if seen.sensor == name), key=lambda seen: seen.t_s)
    return usual, [seen for seen in taken if seen.sensor == name], taken


def test_only_the_named_sensor_is_touched(slow, run):
    others = {fault: name for fault, name in cases(slow) if name}
    for fault, name in others.items():
        taken = with_fault(run, fault, name, np.random.default_rng(5))
        left = [seen for seen in taken if seen.sensor != name]
        assert sorted(map(id, left)) == sorted(id(seen) for seen in run.observations if seen.sensor != name)


def test_lost_is_lost_from_then_until_then(run):
    usual, left, _ = changed(run, VehicleFault.LOST, "star")
    assert left == [seen for seen in usual if not BEGINS_S <= seen.t_s < BEGINS_S + LASTS_S]
    assert len(left) < len(usual) - 10


def test_a_glint_is_one_spot_of_the_first_image(slow, run):
    usual, seen, _ = changed(run, VehicleFault.GLINT, "camera")
    moved = np.linalg.norm(seen[0].value - usual[0].value, axis=1)
    off = GLINT_RAD * slow.models["camera"].camera.focal_length_px[0]
    np.testing.assert_allclose(np.sort(np.nan_to_num(moved))[-2:], [0.0, off], rtol=1e-9)
    assert seen[1:] == usual[1:]


def test_a_clock_jumps_and_stays(run):
    usual, seen, taken = changed(run, VehicleFault.CLOCK, "psd")
    off = [after.t_s - before.t_s for before, after in zip(usual, seen, strict=True)]
    assert off == pytest.approx([JUMP_S if before.t_s >= BEGINS_S else 0.0 for before in usual])
    assert [one.t_s for one in taken] == sorted(one.t_s for one in taken)


@pytest.mark.parametrize(("fault", "most"), [(VehicleFault.WEAK, 0.31), (VehicleFault.TURNED, 0.18)])
def test_faulty_thrusters_give_what_was_flown(run, fault, most):
    """Told is another command from then on, off by a share of it; a leak is not told at all."""
    usual, told, _ = changed(run, fault, "thrust")
    given, ordered = (np.array([seen.value for seen in some]) for some in (usual, told))
    began = np.array([seen.t_s for seen in usual]) >= BEGINS_S
    assert 10 < began.sum() < len(began)
    np.testing.assert_array_equal(ordered[~began], given[~began])
    made = ordered * (1.0 - WEAK_SHARE) if fault == VehicleFault.WEAK else ordered
    np.testing.assert_allclose(np.linalg.norm(made[began], axis=1), np.linalg.norm(given[began], axis=1), rtol=1e-12)
    off = np.linalg.norm((ordered - given)[began], axis=1) / np.linalg.norm(ordered[began], axis=1)
    assert 0.05 < off.max() < most


def test_a_leak_is_one_acceleration_that_nobody_ordered(run):
    usual, told, _ = changed(run, VehicleFault.LEAK, "thrust")
    leak = np.array([one.value - other.value for one, other in zip(usual, told, strict=True) if one.t_s >= BEGINS_S])
    np.testing.assert_allclose(np.linalg.norm(leak, axis=1), LEAK_M_S2, rtol=1e-9)
    np.testing.assert_allclose(leak, leak[:1].repeat(len(leak), axis=0), atol=1e-15)


def test_late_images_end_in_the_same_state(slow, run):
    """Replayed, not fused as current: bit for bit what images in time give, and not what a stamp on arrival gives."""
    early, late, current = (VehicleNavigator(slow, monitor=False) for _ in range(3))
    until_s = BEGINS_S + 8.0
    taken = [seen for seen in changed(run, VehicleFault.LATE, "camera")[2] if seen.t_s < until_s]
    assert [one.arrives_s for one in taken] == sorted(one.arrives_s for one in taken)
    for seen in sorted(taken, key=lambda seen: seen.t_s):
        early.observe(seen.sensor, seen.t_s, seen.value)
    verdicts = {late.observe(seen.sensor, seen.t_s, seen.value).name for seen in taken}
    for seen in taken:
        fresh = dataclasses.replace(seen, t_s=seen.arrives_s) if seen.sensor == "camera" else seen
        current.observe(fresh.sensor, fresh.t_s, fresh.value)
    assert "REPLAYED" in verdicts
    assert not verdicts & {"TOO_OLD"}
    one, other = early.state(until_s), late.state(until_s)
    assert one.values.tobytes() == other.values.tobytes()
    assert one.covariance.tobytes() == other.covariance.tobytes()
    assert max(one.arrives_s - one.t_s for one in taken) == pytest.approx(LATE_S)
    wrong = np.abs(current.state(until_s).port.position_m - one.port.position_m)
    assert (wrong / one.port.sigma[:3]).max() > 3.0


@pytest.mark.parametrize("name", ["gyro", "camera", "psd", "star"])
def test_a_lost_sensor_is_no_alarm_and_comes_back(run, name):
    usual, lost = fly_fault(run, VehicleFault.NOTHING, ""), fly_fault(run, VehicleFault.LOST, name)
    assert lost.inside
    assert not lost.silent
    assert lost.named == ()
    assert 0.0 <= back_after_s(lost, usual) <= 8.0


@pytest.mark.parametrize("name", ["camera", "psd"])
def test_a_clock_that_jumps_is_told_before_the_port_is_lost(run, name):
    flown = fly_fault(run, VehicleFault.CLOCK, name)
    assert BEGINS_S < flown.alarm_s < BEGINS_S + LASTS_S
    assert not flown.silent
    assert flown.one_fault < 1.0


@pytest.mark.parametrize("name", ["camera", "psd"])
def test_a_glint_in_the_first_image_does_no_harm(run, name):
    flown = fly_fault(run, VehicleFault.GLINT, name, seed=3)
    assert (flown.silent, flown.named) == (False, ())
    assert flown.one_fault < 1.0


@pytest.fixture
def two_cases(monkeypatch):
    """Of all that can go wrong, only these."""
    chosen = [(VehicleFault.NOTHING, ""), (VehicleFault.LOST, "star")]
    monkeypatch.setattr(vehicle_faults, "cases", lambda _: chosen)


@pytest.mark.usefixtures("two_cases")
def test_the_report_is_that_of_its_flights(slow):
    """Whatever the order in which runs come back; the second is lost from 30 m."""
    told = []

    def backward(fly, numbers):
        return map(fly, reversed(numbers))

    report = vehicle_faults.measure_faults(slow, runs=2, seed=72, flight=FLIGHT, fly_all=backward, progress=told.append)
    flown = [fly_run(slow, FLIGHT, 72, 1.0, vehicle_faults.cases(slow), k) for k in (0, 1)]
    assert told == [2, 2]
    healthy, lost = report.rows
    assert (healthy.runs, healthy.sensor, healthy.inside) == (2, "", -1)
    assert healthy.one_fault == max(one["nothing", ""].one_fault for _, one, _ in flown) > 0.0
    assert (lost.runs, lost.fault, lost.sensor, lost.inside) == (2, "lost for 60 s", "star", 2)
    assert lost.error == max(one["lost for 60 s", "star"].error for _, one, _ in flown)
    assert lost.back_s == max(back_after_s(one["lost for 60 s", "star"], usual) for _, one, usual in flown)
    assert 1.0 <= lost.later < 1.25


@pytest.mark.usefixtures("two_cases")
def test_of_chosen_sensors_alone(slow):
    """The same rows."""
    every, some = (
        vehicle_faults.measure_faults(slow, runs=2, seed=72, flight=FLIGHT, only=only) for only in (None, [""])
    )
    assert [row.sensor for row in every.rows] == ["", "star"]
    assert repr(some.rows) == repr(every.rows[:1])


@pytest.mark.parametrize(("fault", "name"), [(VehicleFault.CLOCK, "psd"), (VehicleFault.WEAK, "thrust")])
def test_a_fault_of_half_the_size(run, fault, name):
    whole, half = (
        [one for one in with_fault(run, fault, name, np.random.default_rng(5), size=size) if one.sensor == name][-1]
        for size in (1.0, 0.5)
    )
    usual = [seen for seen in run.observations if seen.sensor == name][-1]
    if fault == VehicleFault.CLOCK:
        before, less, more = (one.t_s for one in (usual, half, whole))
    else:
        before, less, more = (1.0 / np.linalg.norm(one.value) for one in (usual, half, whole))
    assert less - before == pytest.approx(0.5 * (more - before))
    assert less != before


def test_a_smaller_ramp_may_pass(slow, monkeypatch):
    """Flown alone, and no missed goal where it raises no alarm."""
    chosen = [(VehicleFault.NOTHING, ""), (VehicleFault.RAMP, "star"), (VehicleFault.LOST, "star")]
    monkeypatch.setattr(vehicle_faults, "cases", lambda _: chosen)
    report = vehicle_faults.measure_faults(slow, runs=1, seed=72, flight=FLIGHT, size=0.01)
    (row,) = report.rows
    assert (row.fault, row.size, row.alarmed, row.ok) == ("ramp", 0.01, 0, True)
    assert any(line.startswith("EVERY FAULT 0.01 TIMES") for line in report.lines())
    missed = dataclasses.replace(row, size=1.0, runs=200)
    assert not missed.ok


def test_losses_are_flown_from_three_distances():
    usual = vehicle_fault_flights.FLIGHT
    first, far, near, again = (lost_flight(usual, k) for k in range(4))
    assert first == again == usual
    assert (near.start_m, near.final_m) == (7.6, usual.final_m)
    assert far.start_m == 30.0
    assert (far.start_m - far.final_m) / far.fast_m_s == pytest.approx(BEGINS_S + LASTS_S + 30.0)


def test_how_long_it_takes_to_be_back():
    def flown(*sigmas):
        """The first of twelve as usual, the second not."""
        seconds = {round(BEGINS_S + LASTS_S) + k: np.array([1.0, sigma, *[1.0] * 10]) for k, sigma in enumerate(sigmas)}
        return Flown(math.nan, (), 0.0, False, 0.0, True, seconds)

    usual = flown(1.0, 1.0, 1.0, 1.0)
    assert back_after_s(usual, usual) == 0.0
    assert back_after_s(flown(2.0, 1.3, 1.2, 1.0), usual) == 2.0
    assert back_after_s(flown(1.0, 1.0, 1.0, 1.3), usual) == 4.0
    assert back_after_s(flown(2.0, 1.3, 1.2, 1.0), usual, (0,)) == 0.0


def test_how_much_is_missing_later():
    first = round(BEGINS_S + LASTS_S)
    usual, lost = (
        Flown(math.nan, (), 0.0, False, 0.0, True, {first + k: np.array([1.0, s]) for k, s in sigmas})
        for sigmas in ([(0, 2.0), (10, 2.0), (11, 2.0)], [(0, 8.0), (10, 2.2), (11, 2.6)])
    )
    assert worse_later(lost, usual) == 1.3


GOOD = FaultRow(
    "lost for 60 s", "psd", 1.0, 200, 0, 0, 0, 0, 0.0, 0.02, math.nan, 0.4, 0.3, 199, 0.97, 0.999, 2.0, 4.0, 1.2
)


@pytest.mark.parametrize(
    "change", [{"fault": "nothing", "sensor": "", "alarmed": 1}, {"fault": "ramp", "alarmed": 198}]
)
def test_what_a_bar_allows(change):
    assert dataclasses.replace(GOOD, **change).ok


@pytest.mark.parametrize(
    "change",
    [
        {"silent_low": 0.03},
        {"one_fault": 1.01},
        {"inside_high": 0.98},
        {"pose_back_s": 11.0},
        {"fault": "nothing", "sensor": "", "alarmed": 2},
        {"fault": "ramp", "alarmed": 197},
    ],
)
def test_every_bar_can_fail(change):
    """Each just beyond what is allowed."""
    row = dataclasses.replace(GOOD, **change)
    assert GOOD.ok
    assert not row.ok
    report = VehicleFaultsReport("demo", 200, 7, 1.0, (GOOD, row))
    assert not report.ok
    assert sum("GOAL NOT MET" in line for line in report.lines()) == 1
    assert "SOME GOALS ARE NOT MET" in report.lines()[-1]
