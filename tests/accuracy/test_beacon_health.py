"""Beacon faults: survived by the filter, and named for what they are; a healthy flight names nothing."""

import dataclasses
import re

import numpy as np
import pytest

import relnav
from relnav.accuracy.beacon_health import beacon_health, findings
from relnav.navigation.slots import filter_slots
from relnav.sensors.three_beacon.psd import SlotStatus, currents_of_counts
from relnav.sensors.three_beacon.slots import read_slots
from relnav.simulation.beacon_faults import BeaconFault, in_slot, shining
from relnav.simulation.raw import simulate_raw
from relnav.simulation.trajectory import Approach

FROM_S = 25.0
APPROACH = Approach(duration_s=60.0, start_m=(7.5, 0.05, -0.05), final_range_m=6.0)


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


@pytest.fixture(scope="module")
def fly(model):
    """fly(*faults) -> (log, slots, track, findings)."""

    def run(*faults, seed=1):
        log = simulate_raw(model, APPROACH, seed, faults=faults)
        currents = currents_of_counts(model.detector, log.counts)
        size = model.sensor.detector_size_m
        slots = read_slots(model.detector, model.pulses, size, log.t_s, log.beacon, currents)
        track = filter_slots(model, slots, acceleration_m_s2=log.acceleration_m_s2, method="spots")
        return log, slots, track, findings(beacon_health(model, slots, track))

    return run


def test_a_healthy_flight_names_nothing(fly):
    _, _, track, said = fly()
    assert said == []
    assert track.restarts == 0


# name: (fault, what is said, largest range error afterwards, m)
FAULTS = {
    "dead A": (BeaconFault("dead", 0, FROM_S), r"beacon A is dead since 24\.9", 0.03),
    "dead C": (BeaconFault("dead", 2, FROM_S), r"beacon C is dead since 24\.9", 0.03),
    "fading": (BeaconFault("fading", 1, FROM_S, time_constant_s=30.0), "beacon B has lost 6. % of its power", 0.03),
    "exchanged A B": (BeaconFault("swapped", 0, FROM_S, other=1), "beacons A and B look exchanged", 0.06),
    "exchanged B C": (BeaconFault("swapped", 2, FROM_S, other=1), "beacons B and C look exchanged", 0.06),
    "glints": (BeaconFault("glint", 2, FROM_S, probability=0.3), "beacon C has glints: .* spots elsewhere", 0.03),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_survived_and_named(fly, name):
    fault, text, largest_m = FAULTS[name]
    log, _, track, said = fly(fault)
    assert len([finding for finding in said if re.match(text, finding)]) == 1, said
    late = log.t_s > FROM_S
    error = (track.state - log.truth)[late]
    assert np.isfinite(error).all()
    assert np.abs(error[:, 0]).max() < largest_m
    assert np.abs(error[:, 1:3]).max() < 0.005
    assert track.restarts == 0
    sigma = track.sigma[late]
    # a mirror image near its beacon passes the gate and biases: a third of the slots mirrored costs some consistency
    assert np.mean(np.abs(error[:, :3]) < 3.0 * sigma[:, :3]) > (0.9 if name == "glints" else 0.97)


def test_a_dead_beacon_gives_no_spots(fly):
    log, slots, _, _ = fly(BeaconFault("dead", 0, FROM_S))
    own = (log.beacon == 0) & (log.t_s >= FROM_S)
    assert (slots.status[own] == SlotStatus.UNDER_RANGE).all()


def test_power_loss_is_carried_into_sigma(fly):
    log, slots, _, _ = fly(BeaconFault("fading", 1, FROM_S, time_constant_s=30.0))
    own = np.flatnonzero(log.beacon == 1)
    near_end, before = own[-20:], own[(log.t_s[own] > 20.0) & (log.t_s[own] < 22.0)]
    # noise goes as one over current, all but the shot noise: a third of the light, about three times the noise
    ratio = slots.sigma_m[near_end].mean() / slots.sigma_m[before].mean()
    light = slots.current_a[near_end].mean() / slots.current_a[before].mean()
    assert ratio == pytest.approx(1.0 / light, rel=0.1)


def test_without_light_in_the_model_no_power_is_judged(model, fly):
    _, slots, track, _ = fly(BeaconFault("fading", 1, FROM_S, time_constant_s=30.0))
    health = beacon_health(dataclasses.replace(model, light=None), slots, track)
    assert all(np.isnan(beacon.power_ratio) for beacon in health)


def test_faults_as_stated():
    t, beacon = np.arange(4.0), np.array([0, 1, 0, 1])
    np.testing.assert_allclose(
        shining((BeaconFault("fading", 2, 1.0, time_constant_s=2.0),), t)[:, 2], np.exp([0, 0, -0.5, -1])
    )
    np.testing.assert_array_equal(in_slot((BeaconFault("swapped", 0, 1.5, other=1),), t, beacon), [0, 1, 1, 0])
    with pytest.raises(ValueError, match='kind is "dead", "fading", "swapped" or "glint"; got \'burnt\''):
        BeaconFault("burnt", 0)
    with pytest.raises(ValueError, match="a beacon is 0, 1 or 2; got 3"):
        BeaconFault("dead", 3)
