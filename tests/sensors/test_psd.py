"""The detector: spots come back from currents, and noise is what the formulas of its parts say."""

import dataclasses
import math

import numpy as np
import pytest

import relnav
from relnav.sensors.three_beacon.psd import (
    SlotStatus,
    counts_of_currents,
    currents_of_counts,
    currents_of_spots,
    noisy_currents,
    slot_status,
    spot_sigma,
    spots_of_currents,
)

SIZE = (8e-3, 8e-3)
SPOTS = np.array([[0.0, 0.0], [1e-3, -2e-3], [-3.9e-3, 3.9e-3]])


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


@pytest.fixture(scope="module")
def detector(model):
    return model.detector


@pytest.mark.parametrize("electrodes", ["tetra_lateral", "duo_lateral"])
def test_difference_over_sum_gives_the_spot_back_and_the_sum_only_intensity(detector, electrodes):
    built = dataclasses.replace(detector, electrodes=electrodes)
    currents = currents_of_spots(built, SIZE, SPOTS, np.array([1e-6, 2e-6, 3e-6]))
    assert (currents >= 0.0).all()
    spots, total = spots_of_currents(SIZE, currents)
    np.testing.assert_allclose(spots, SPOTS, atol=1e-18)
    share = 0.5 if electrodes == "tetra_lateral" else 1.0
    np.testing.assert_allclose(total, share * np.array([[1e-6], [2e-6], [3e-6]]) * [1.0, 1.0], rtol=1e-14)


def test_axes(detector):
    """A spot to the right and down draws more current at x2 and at y2."""
    x1, x2, y1, y2 = currents_of_spots(detector, SIZE, np.array([1e-3, 2e-3]), np.array(1e-6))
    assert x2 > x1
    assert y2 > y1
    assert y2 - y1 == pytest.approx(2.0 * (x2 - x1), rel=1e-12)


def test_noise_by_its_parts(detector):
    """In the middle of a detector with one kind of noise the formulas are short: written out here."""
    current, bandwidth = 2e-7, math.pi / 2 * 35e3
    quiet = dataclasses.replace(
        detector, amplifier_noise_a_sqrt_hz=0.0, adc_bits=32, interelectrode_resistance_ohm=1e30
    )
    middle = np.zeros(2)
    shot = spot_sigma(quiet, SIZE, middle, np.array(current))
    # each electrode carries S/2: dx = (L / 2S)(dI2 - dI1), var = (L / 2S)^2 * 2 * 2 e (S / 2) B
    np.testing.assert_allclose(shot, 4e-3 / current * math.sqrt(2 * 1.602176634e-19 * current * bandwidth), rtol=1e-6)
    thermal = spot_sigma(dataclasses.replace(quiet, interelectrode_resistance_ohm=1e4), SIZE, middle, np.array(current))
    # dI2 = -dI1 = i: dx = L i / S
    i = math.sqrt(4 * 1.380649e-23 * 293.0 * bandwidth / 1e4)
    np.testing.assert_allclose(np.sqrt(thermal**2 - shot**2), 8e-3 * i / current, rtol=1e-6)


def test_ten_micrometres_at_the_working_range(model):
    """Table 1 and the stated assumptions: the paper's resolution at 6.5 m, growing a little faster than r^2."""
    detector, light = model.detector, model.light
    background = light.background_power_w(SIZE, 0.05) * detector.responsivity_a_w * 0.5 * detector.axis_share

    def sigma_um(range_m):
        power = light.received_power_w(np.array(range_m), np.array(0.0), np.array(0.0))
        s = power * detector.responsivity_a_w * detector.axis_share
        return 1e6 * spot_sigma(detector, SIZE, np.zeros(2), s, background, dark_samples=64)[0]

    assert sigma_um(6.5) == pytest.approx(10.0, rel=0.03)
    assert sigma_um(10.0) == pytest.approx(10.0 * (10.0 / 6.5) ** 2, rel=0.05)
    assert sigma_um(3.75) < 4.0


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("spot", SPOTS.tolist())
def test_noise_of_simulated_currents_is_the_stated_one(detector, spot, samples):
    n, background, current = 20_000, 5e-7, 6e-7
    rng = np.random.default_rng(3)

    def converted(clean, count):
        many = np.repeat(clean[:, None], count, axis=1)
        counts = counts_of_currents(detector, noisy_currents(detector, many, rng))
        return currents_of_counts(detector, counts.mean(axis=1))

    clean = currents_of_spots(detector, SIZE, np.tile(spot, (n, 1)), np.full(n, 2.0 * current)) + background
    lit, dark = converted(clean, samples), converted(np.full((n, 4), background), 10 * samples)
    got, _ = spots_of_currents(SIZE, lit - dark)
    expected = spot_sigma(
        detector, SIZE, np.array(spot), np.array(current), background, samples=samples, dark_samples=10 * samples
    )
    np.testing.assert_allclose(got.std(axis=0), expected, rtol=0.03)
    np.testing.assert_allclose(got.mean(axis=0), spot, atol=6e-6 * 4 / math.sqrt(n) + 2e-7)
    assert abs(np.corrcoef(got.T)[0, 1]) < 0.03


def test_background_that_is_not_subtracted_pulls_to_the_middle(detector):
    spot = np.array([2e-3, -1e-3])
    currents = currents_of_spots(detector, SIZE, spot, np.array(1e-6))
    pulled, _ = spots_of_currents(SIZE, currents + 1.25e-7)
    np.testing.assert_allclose(pulled, spot * 0.5 / 0.75, rtol=1e-12)


def test_counts_round_down_and_end(detector):
    step = detector.current_per_count_a
    counts = counts_of_currents(detector, np.array([-1e-9, 0.0, 10.4 * step, 1.0]))
    np.testing.assert_array_equal(counts, [0, 0, 10, 65535])
    currents = currents_of_counts(detector, counts)
    np.testing.assert_allclose(currents[:3], np.array([0.5, 0.5, 10.5]) * step)
    assert currents[3] == np.inf


def test_status_of_slots(detector):
    dark = np.full(4, 1e-7)
    good = currents_of_spots(detector, SIZE, SPOTS[1], np.array(1e-6)) + dark
    rows = np.array([good, good * [1, np.nan, 1, 1], dark, good + np.array([0, 4e-5, 0, 0]), good * [1, np.inf, 1, 1]])
    status = slot_status(detector, rows, np.tile(dark, (5, 1)))
    expected = [SlotStatus.OK, SlotStatus.MISSING, SlotStatus.UNDER_RANGE, SlotStatus.SATURATED, SlotStatus.SATURATED]
    assert status.tolist() == [int(code) for code in expected]


def test_a_detector_that_is_not_linear_any_more_is_saturated(detector):
    small = dataclasses.replace(detector, saturation_current_a=1e-6)
    rows = currents_of_spots(small, SIZE, SPOTS[:2], np.array([0.9e-6, 1.1e-6]))
    assert slot_status(small, rows, np.zeros((2, 4))).tolist() == [int(SlotStatus.OK), int(SlotStatus.SATURATED)]
