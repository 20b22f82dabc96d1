"""Gyro samples in order whatever the order in which they came, and when the gyro is lost and found."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relnav.vehicle import gyro
from relnav.vehicle.gyro import GyroSamples, found_at, lost_at
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.replay import Observed
from relnav.vehicle.smoothing import VehicleSmoother

BEFORE_ANY = np.array([0.0, 0.1, 0.0])


def filled(times):
    samples = GyroSamples(BEFORE_ANY)
    for k, t in enumerate(times):
        samples.insert((t, float(k), 0.0, 0.0))
    return samples


@settings(derandomize=True, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 3)), min_size=1, max_size=40))
def test_they_are_in_order_and_each_is_there_once(given_samples):
    samples, seen = GyroSamples(BEFORE_ANY), []
    for t, x in given_samples:
        sample = float(t), float(x), 0.0, 0.0
        later = samples.insert(sample)
        assert later == (-1 if sample in seen else sum(one > sample for one in seen))
        seen += [sample] if later >= 0 else []
    held = samples.array[: samples.count].tolist()
    assert held[1:] == [list(one) for one in sorted(seen)]
    samples.remove(seen[0])
    assert samples.array[1 : samples.count].tolist() == [list(one) for one in sorted(seen[1:])]


def test_a_later_one_is_appended_as_it_is_inserted(monkeypatch):
    monkeypatch.setattr(gyro, "ROOM", 4)
    appended, inserted, rate = GyroSamples(BEFORE_ANY), filled([1.0, 1.1]), np.array([0.0, 7.0, -1e3])
    assert all(appended.append(t, np.array([x, 0.0, 0.0])) for t, x in ((1.0, 0.0), (1.1, 1.0)))
    for samples in (appended, inserted):
        assert not samples.append(1.1, rate)
        assert not samples.append(1.05, rate)
        assert not samples.append(math.nan, rate)
    for none in (rate * 1.001, np.array([0.0, math.nan, 0.0]), np.zeros(2), np.zeros((3, 1)), np.float64(1.0)):
        assert not appended.append(1.2, none)
    assert not appended.append(1.2, np.zeros((3, 2))[:, 0])  # in pieces
    assert appended.count == inserted.count == 3
    assert appended.array[:3].tobytes() == inserted.array[:3].tobytes()
    assert appended.append(1.2, rate)
    assert not appended.append(1.3, rate)  # no room
    assert appended.array[3].tolist() == [1.2, *rate]


def test_any_array_of_three_numbers_is_a_rate(vehicle):
    read_only, packed = np.array([0.1, 0.2, 0.3]), np.zeros(3, dtype=[("flag", "u1"), ("rate", "f8")])
    read_only.flags.writeable, packed["rate"] = False, read_only
    pieces = np.array([[0.1, 0.0], [0.2, 0.0], [0.3, 0.0]])[:, 0]
    unaligned = np.frombuffer(b"." + read_only.tobytes(), dtype=np.float64, offset=1)
    navigator = VehicleNavigator(vehicle)
    rates = [read_only, packed["rate"], pieces, unaligned, read_only.tolist(), read_only.astype(">f8")]
    for k, rate in enumerate(rates):
        assert navigator.observe("gyro", 0.01 * (k + 1), rate) is Observed.ACCEPTED
        assert navigator.newest_s == 0.01 * (k + 1)
    held = navigator._filters.samples
    assert held.array[1 : held.count, 1:].tolist() == [read_only.tolist()] * 6


@pytest.mark.parametrize("flown", [VehicleNavigator, VehicleSmoother])
@pytest.mark.parametrize("name", ["gyro", "thrust"])
def test_a_covariance_that_is_not_taken_is_refused(vehicle, flown, name):
    """Not left unused without a word."""
    with pytest.raises(ValueError, match=rf"^covariance: {name} takes none, its errors are those of \[{name}\] in the"):
        flown(vehicle).observe(name, 0.1, [0.0, 0.0, 0.0], 1e-6 * np.eye(3))


def test_which_one_holds():
    samples = filled([1.0, 1.1, 1.2])
    assert samples.rate_at(0.9).tolist() == BEFORE_ANY.tolist()
    assert [samples.rate_at(t)[0] for t in (1.0, 1.15, 1.2, 9.0)] == [0.0, 1.0, 2.0, 2.0]
    assert [samples.silent_before(t) for t in (1.0, 1.1)] == [0.0, pytest.approx(0.1)]


def test_room_is_made_by_forgetting_what_no_longer_holds(monkeypatch):
    """But for samples that say whether the rate changes."""
    monkeypatch.setattr(gyro, "ROOM", 4)
    monkeypatch.setattr(gyro, "TREND", 1)
    samples = filled([1.0, 1.1, 1.2])
    assert samples.is_full
    samples.make_room(1.25)
    assert not samples.is_full
    assert len(samples.array) == 4
    assert samples.array[: samples.count, 0].tolist() == [1.1, 1.2]
    samples.make_room(1.25)
    samples.insert((1.3, 0.0, 0.0, 0.0))
    samples.insert((1.05, 7.0, 0.0, 0.0))
    samples.make_room(0.0)  # nothing can be forgotten
    assert len(samples.array) == 8
    assert samples.array[: samples.count, 0].tolist() == [1.05, 1.1, 1.2, 1.3]


def test_when_it_is_lost_and_found():
    samples = filled([1.0, 1.1, 2.0])
    array, count = samples.array, samples.count
    assert lost_at(array, count, 0.25, 1.0, 1.3) == math.inf
    assert lost_at(array, count, 0.25, 1.0, 1.35) == math.inf  # until then it holds
    assert lost_at(array, count, 0.25, 1.0, 3.0) == pytest.approx(1.35)
    assert lost_at(array, count, 0.25, 0.5, 3.0) == 0.5  # no sample yet
    assert found_at(array, count, 1.35) == 2.0
    assert found_at(array, count, 2.25) == math.inf


def bits(nav):
    now = nav.state()
    return now.covariance.tobytes() + now.values.tobytes() + now.port.position_m.tobytes()


@pytest.mark.parametrize("seed", [1, 2])
def test_a_gap_and_any_order_give_the_same_bits(vehicle, short_run, seed):
    """Samples are missing from 0.15 to 0.25 s: lost, found, and what comes late is before, in or after the gap."""
    events = [seen for seen in short_run.observations if seen.t_s < 0.4]
    events = [seen for seen in events if seen.sensor != "gyro" or not 0.15 < seen.t_s < 0.25]
    rng = np.random.default_rng(seed)
    in_order, shuffled = VehicleNavigator(vehicle), VehicleNavigator(vehicle)
    for seen in sorted(events, key=lambda one: one.t_s):
        in_order.observe(seen.sensor, seen.t_s, seen.value)
    verdicts = set()
    for k in rng.permutation(len(events)):
        verdicts.add(shuffled.observe(events[k].sensor, events[k].t_s, events[k].value))
    assert Observed.TOO_OLD not in verdicts
    assert bits(shuffled) == bits(in_order)


def test_samples_alone_take_no_more_room_than_the_window(vehicle, short_run, monkeypatch):
    """Seven seconds without an observation, with room for three: the same bits as with room for all of them."""
    roomy = VehicleNavigator(vehicle)
    monkeypatch.setattr(gyro, "ROOM", 300)
    narrow = VehicleNavigator(vehicle)
    for seen in sorted((seen for seen in short_run.observations if seen.t_s < 9.0), key=lambda one: one.t_s):
        if seen.sensor == "gyro" or not 1.0 < seen.t_s < 8.5:
            for nav in (roomy, narrow):
                nav.observe(seen.sensor, seen.t_s, seen.value)
    assert len(narrow._filters.samples.array) <= 600
    assert bits(narrow) == bits(roomy)
    assert not narrow.state().gyro_lost
