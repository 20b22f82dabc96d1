"""Several readings of a grid point: the error of the stage is in all of them, and the detector has no part in it."""

import numpy as np
import pytest

from relnav.sensors.three_beacon.calibrate import calibrate, calibrate_without_outliers
from relnav.sensors.three_beacon.repeated_points import mean_of_points, odd_readings, points_of
from relnav.simulation.distortion import typical_distortion

INSIDE_M, SIZE_M = 3e-3, (8e-3, 8e-3)
STAGE_M, NOISE_M, RUNS = 3e-6, 1e-6, 10


def bench(seed, side=9, readings=5):
    """Known positions as told (n, 2), measured ones, and the detector: each point is off by the stage's error, once."""
    detector, rng = typical_distortion(4e-3, 250e-6, length_m=INSIDE_M, seed=seed), np.random.default_rng(seed)
    line = np.linspace(-INSIDE_M, INSIDE_M, side)
    told = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    true = told + STAGE_M * rng.normal(size=told.shape)
    measured = np.repeat(detector.apply(true), readings, axis=0)
    return np.repeat(told, readings, axis=0), measured + NOISE_M * rng.normal(size=measured.shape), detector


@pytest.mark.parametrize("readings", [1, 5])
def test_what_is_left_is_what_is_said(readings):
    """Mean of actual over claimed variance: with every reading as a point of its own it is 2 for five readings."""
    ratio, noise = [], []
    for seed in range(RUNS):
        told, measured, detector = bench(seed, readings=readings)
        report, left_out = calibrate_without_outliers(told, measured, detector_size_m=SIZE_M)
        assert left_out == ()
        assert report.calibration.points == 81
        line = np.linspace(-2.9e-3, 2.9e-3, 31)
        at = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        error = report.calibration.correct(detector.apply(at)) - at
        ratio.append(np.mean(error**2) / report.calibration.residual_sigma_m**2)
        noise.append(report.noise_m)
    assert 0.6 < np.mean(ratio) < 1.4
    assert np.mean(noise) == pytest.approx(np.hypot(STAGE_M, NOISE_M / np.sqrt(readings)), rel=0.1)


def test_copies_change_nothing():
    told, measured, _ = bench(1, readings=1)
    once, twice = calibrate(told, measured), calibrate(np.repeat(told, 3, axis=0), np.repeat(measured, 3, axis=0))
    assert twice.chosen.order == once.chosen.order
    assert twice.calibration.residual_sigma_m == pytest.approx(once.calibration.residual_sigma_m, rel=1e-6)


def test_an_odd_reading_and_a_point_that_is_wrong():
    """One reading of a point is 40 um off, and the stage missed another point by 60 um: its readings agree."""
    told, measured, _ = bench(2)
    measured[17] += [40e-6, 0.0]
    measured[200:205] += [0.0, 60e-6]
    assert odd_readings(told, measured).tolist() == [17]
    _, left_out = calibrate_without_outliers(told, measured, detector_size_m=SIZE_M)
    assert left_out == (17, 200, 201, 202, 203, 204)


def test_points_of_readings_in_any_order():
    told, measured, _ = bench(3, side=4, readings=3)
    order = np.random.default_rng(3).permutation(len(told))
    point, count = points_of(told[order])
    assert count == 16
    assert np.array_equal(np.unique(point, return_index=True)[1], np.sort(np.unique(point, return_index=True)[1]))
    true, mean = mean_of_points(told[order], measured[order])
    for k in range(count):
        rows = order[point == k]
        assert len(rows) == 3
        np.testing.assert_allclose(true[k], told[rows[0]], rtol=0, atol=1e-15)
        np.testing.assert_allclose(mean[k], measured[rows].mean(axis=0), rtol=0, atol=1e-15)


def test_a_grid_without_repeats_is_left_as_it_is():
    told, measured, _ = bench(4, readings=1)
    assert mean_of_points(told, measured)[1] is measured
    assert len(odd_readings(told, measured)) == 0


def test_a_grid_in_another_unit_is_refused():
    """Known and measured positions in mm under a header of um."""
    told, measured, _ = bench(5, readings=1)
    with pytest.raises(ValueError, match=r"the grid is .* mm wide, and the detector 8 x 8 mm: are the units right"):
        calibrate(1e-3 * told, 1e-3 * measured, detector_size_m=SIZE_M)
