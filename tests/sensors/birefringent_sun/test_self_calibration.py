"""The opening's place from the sensor's own frames: found, honest, and refused where frames cannot tell."""

from dataclasses import replace

import numpy as np
import pytest

from relnav.estimation.consistency import chi_square_interval
from relnav.sensors.birefringent_sun.self_calibration import self_calibrate, self_calibration_bound
from relnav.sensors.birefringent_sun.spots import project

ZERO = ("zero_spot_x_px", "zero_spot_y_px")


def frames(sensor, s, seed):
    return project(sensor, s) + sensor.spot_noise_px * np.random.default_rng(seed).normal(size=(len(s), 2, 2))


def test_decentre_below_a_micrometre_from_1000_frames(sensor, cone):
    """Within 30 deg, 1 um of noise, no attitude: the bound is 0.84 and 0.26 um, and 20 estimates reach it."""
    s = cone(30.0, 1000)
    bound = np.sqrt(np.diag(self_calibration_bound(sensor, s[:, :2], ZERO))) * sensor.pixel_pitch_m * 1e6
    assert bound == pytest.approx([0.84, 0.26], abs=0.03)
    true = replace(sensor, zero_spot_px=(513.0, 510.5))
    error, chi2 = [], []
    for seed in range(20):
        made = self_calibrate(sensor, frames(true, s, seed))
        error.append((made.values - true.zero_spot_px) * sensor.pixel_pitch_m * 1e6)
        chi2.append(made.chi2_per_dof)
        np.testing.assert_allclose(np.sqrt(np.diag(made.covariance)) * sensor.pixel_pitch_m * 1e6, bound, rtol=0.02)
    # 20 draws know a standard deviation to 16 %
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(error), axis=0)), bound, rtol=0.45)
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.02)
    assert made.sensor.zero_spot_px == tuple(made.values)


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_sigmas_are_of_the_noise_that_is_there(sensor, cone, traced, times):
    """Whether the spots have the noise that the model states or three times as much."""
    rng, logs = np.random.default_rng(83), 80
    nees, found_px = 0.0, []
    for log in range(logs):
        true = np.array([511.5, 511.5]) + 2.0 * rng.normal(size=2)
        spots = traced(replace(sensor, zero_spot_px=tuple(true)), cone(50.0, 150, log))
        made = self_calibrate(sensor, spots + times * sensor.spot_noise_px * rng.normal(size=spots.shape))
        error = made.values - true
        nees += error @ np.linalg.solve(made.covariance, error)
        found_px.append(made.spot_noise_found_px)
    low, high = chi_square_interval(2 * logs, 0.999)
    assert low < nees / (2 * logs) < high
    assert np.mean(found_px) == pytest.approx(times * 0.125, rel=0.02)


def test_thickness_and_index_too(sensor, cone):
    """All of a 60 deg field: thickness to 1.3 um, n_e to 2.2e-5, from values that are off."""
    s, free = cone(60.0, 1000), (*ZERO, "crystal_thickness_m", "extraordinary_index")
    true = replace(sensor, zero_spot_px=(512.5, 510.9), crystal_thickness_m=5.01e-3, extraordinary_index=1.4865)
    made = self_calibrate(sensor, frames(true, s, 1), free=free)
    expected = np.array([512.5, 510.9, 5.01e-3, 1.4865])
    sigma = np.sqrt(np.diag(made.covariance))
    assert np.all(np.abs(made.values - expected) < 4.0 * sigma)
    assert sigma[2] < 2e-6
    assert sigma[3] < 3e-5
    assert made.chi2_per_dof == pytest.approx(1.0, abs=0.15)


def test_a_plain_hole_cannot(sensor, cone):
    """Two rays that are one (n_e = n_o): a shift of the detector is another direction, and nothing is determined."""
    blind = replace(sensor, extraordinary_index=sensor.ordinary_index)
    with pytest.raises(ValueError, match="do not determine zero_spot_x_px, zero_spot_y_px together"):
        self_calibrate(blind, frames(blind, cone(30.0, 100), 0))


@pytest.mark.parametrize(
    ("spots", "free", "text"),
    [
        (np.zeros((1, 2, 2)), ZERO, r"more than 1 frames \(N, 2, 2\)"),
        (np.zeros((5, 2)), ZERO, "frames"),
        (np.full((5, 2, 2), 500.0), ("depth",), "unknown parameter 'depth'; known are zero_spot_x_px"),
        (np.full((5, 2, 2), np.nan), ZERO, "no sun direction; leave it out"),
    ],
)
def test_wrong_use(sensor, spots, free, text):
    with pytest.raises(ValueError, match=text):
        self_calibrate(sensor, spots, free=free)
