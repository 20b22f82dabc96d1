"""Light: inverse squares, lobes and the filter's share of the background. Pulses: who is lit when, in step and out."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from relnav.sensors.three_beacon.light import Light
from relnav.sensors.three_beacon.pulses import Pulses

LIGHT = Light(0.1, math.radians(20.0), 0.024, 0.6, 10e-9, 1e8)


@pytest.mark.parametrize("half_angle_deg", [10.0, 20.0, 60.0])
def test_a_lobe_holds_the_beacons_power(half_angle_deg):
    """Integrated over the hemisphere, with a lens that stays turned to the beacon."""
    light = Light(0.1, math.radians(half_angle_deg), 0.024, 1.0, 1e-8, 0.0)

    def ring(angle):
        power = light.received_power_w(np.array(1.0), np.array(angle), np.array(0.0))
        return 2 * math.pi * math.sin(angle) * power / light.aperture_area_m2

    assert quad(ring, 0.0, math.pi / 2)[0] == pytest.approx(0.1, rel=1e-9)


def test_half_of_it_at_the_half_power_angle_and_a_quarter_at_twice_the_distance():
    on, tilted, far = LIGHT.received_power_w(np.array([3.0, 3.0, 6.0]), np.radians([0.0, 20.0, 0.0]), np.zeros(3))
    assert tilted == pytest.approx(0.5 * on, rel=1e-12)
    assert far == pytest.approx(0.25 * on, rel=1e-12)


def test_nothing_from_behind():
    power = LIGHT.received_power_w(np.ones(2), np.radians([100.0, 0.0]), np.radians([0.0, 95.0]))
    np.testing.assert_array_equal(power, 0.0)


def test_the_filter_lets_its_bandwidth_of_the_background_pass():
    """0.1 W/m^2/sr/nm through 10 nm over (8/50)^2 sr and a lens of 24 mm."""
    expected = 0.6 * 0.1 * 10.0 * (8.0 / 50.0) ** 2 * math.pi * 0.012**2
    assert LIGHT.background_power_w((8e-3, 8e-3), 0.05) == pytest.approx(expected, rel=1e-12)


PULSES = Pulses(0.025, 1e-4)


def test_the_schedule():
    t, beacon = PULSES.schedule(2)
    np.testing.assert_allclose(t, np.arange(8) * 0.025)
    np.testing.assert_array_equal(beacon, [0, 1, 2, 3, 0, 1, 2, 3])
    assert PULSES.cycle_s == pytest.approx(0.1)
    _, beacon = Pulses(0.025, 1e-4, dark_slot=False).schedule(2)
    np.testing.assert_array_equal(beacon, [0, 1, 2, 0, 1, 2])


@pytest.mark.parametrize("samples", [1, 5])
@pytest.mark.parametrize("late_s", [0.0, 0.9e-4, -0.9e-4])
def test_within_the_guard_every_slot_sees_its_own_beacon(samples, late_s):
    np.testing.assert_allclose(Pulses(0.025, 1e-4, samples).lit(late_s), np.eye(4))


def test_out_of_step_slots_mix_and_then_exchange():
    pulses = Pulses(0.025, 0.0, samples=10)
    half = pulses.lit(0.0125)
    np.testing.assert_allclose(half.sum(axis=1), 1.0)
    np.testing.assert_allclose(np.diag(half), 0.5, atol=0.11)
    np.testing.assert_allclose(pulses.lit(0.025), np.roll(np.eye(4), 1, axis=1))
    np.testing.assert_allclose(PULSES.lit(0.013), np.roll(np.eye(4), 1, axis=1))


def test_guards_longer_than_the_slot():
    with pytest.raises(ValueError, match=r"guard_s must be less than half of slot_s = 0.025 s.*; got 0.0125 s"):
        Pulses(0.025, 0.0125)
