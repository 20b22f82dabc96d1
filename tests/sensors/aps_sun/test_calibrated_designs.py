"""Sensors of other dimensions than the shipped one's are calibrated, and their directions have true covariances."""

from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.accuracy.aps_sun import design
from relnav.estimation.consistency import chi_square_interval
from relnav.sensors.aps_sun.calibration import calibrate
from relnav.sensors.aps_sun.physical import default_free, fit_physical
from relnav.sensors.aps_sun.rays import project

FRESH = 40
"""Directions of each design: few, as one calibration's error is in all of them."""


def drawn(model, rng):
    """A dome over a bare hole: dimensions drawn, and everything that assembly leaves."""
    height, half = rng.uniform(2e-3, 8e-3), np.radians(rng.uniform(25.0, 55.0))
    radius, size = height * rng.uniform(3.0, 6.0), 1024
    sensor = replace(
        model.sensor,
        hole_height_m=height,
        glass_thickness_m=0.0,
        glass_tilt_rad=(0.0, 0.0),
        detector_tilt_rad=tuple(rng.normal(size=2) * 3e-3),
        detector_rotation_rad=float(rng.normal() * 4e-3),
        misalignment_rad=(*(rng.normal(size=2) * 2e-3).tolist(), 0.0),
        pixel_pitch_m=2.5 * height * np.tan(half) / size,
        detector_size_px=(size, size),
        zero_spot_px=tuple(size / 2.0 + 3.0 * rng.normal(size=2)),
        field_half_angle_rad=half,
    )
    dome = replace(
        model.dome,
        radius_m=radius,
        thickness_m=radius * rng.uniform(0.05, 0.15),
        centre_m=tuple(rng.normal(size=3) * 0.02 * radius),
        wedge_m=tuple(rng.normal(size=2) * 1e-5),
    )
    return replace(model, sensor=sensor, dome=dome)


def as_designed(truth):
    """What a drawing says of it."""
    flat = {"detector_tilt_rad": (0.0, 0.0), "detector_rotation_rad": 0.0, "misalignment_rad": (0.0, 0.0, 0.0)}
    sensor = replace(truth.sensor, zero_spot_px=(511.5, 511.5), **flat)
    return replace(truth, sensor=sensor, dome=replace(truth.dome, centre_m=(0.0, 0.0, 0.0), wedge_m=(0.0, 0.0)))


def test_a_dome_without_a_glass(model, unit):
    """The detector's tilt is not fitted, and directions are as good as stated: behind the dome it is a pinhole."""
    nees, designs = [], 10
    for seed in range(designs):
        rng = np.random.default_rng([9, seed])
        truth = drawn(model, rng)
        start, half = as_designed(truth), np.degrees(truth.sensor.field_half_angle_rad)
        assert not any("tilt" in name for name in default_free(start))
        noise, along = truth.sensor.spot_noise_px, np.linspace(-half, half, 9)
        s = unit(np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2))
        result = calibrate(project(truth, s) + noise * rng.normal(size=(81, 2)), s, start)
        assert result.calibration.method == "rays"
        fresh = unit(rng.uniform(-half, half, (FRESH, 2)))
        seen = project(truth, fresh) + noise * rng.normal(size=(FRESH, 2))
        for true, spot in zip(fresh, seen, strict=True):
            told = relnav.aps_sun.measure(spot, start, calibration=result.calibration)
            across = np.linalg.svd(true[None])[2][1:]
            e = across @ (told.direction - true)
            nees.append(e @ np.linalg.solve(across @ told.covariance @ across.T, e))
    low, high = chi_square_interval(2 * len(nees), 0.999)
    assert low < np.mean(nees) / 2.0 < high


@pytest.mark.parametrize("dome_m", [0.0, 1e-3])
def test_what_tilts_a_detector_moves_it(model, unit, grid, dome_m):
    """Without a glass a tilt is a misalignment, a shift and a dome turned with them: to a hundredth of the noise."""
    sensor = replace(model.sensor, glass_thickness_m=0.0, glass_tilt_rad=(0.0, 0.0), detector_tilt_rad=(4e-3, -3e-3))
    truth = replace(model, sensor=sensor, dome=replace(model.dome, thickness_m=dome_m, wedge_m=(0.0, 0.0)))
    s = unit(grid(9))
    level = replace(truth, sensor=replace(sensor, detector_tilt_rad=(0.0, 0.0)))
    result = calibrate(project(truth, s), s, level)
    assert result.fit.rms_px < 0.01 * sensor.spot_noise_px
    assert result.fit.model.sensor.detector_tilt_rad == (0.0, 0.0)


@pytest.mark.parametrize(("side", "strays"), [(7, 1), (9, 3)])
def test_strays_far_off_are_left_out(model, unit, grid, side, strays):
    """Anywhere on the detector, eight draws: they are the points left out, and the fit is that without them."""
    s = unit(grid(side))
    for seed in range(8):
        rng = np.random.default_rng([seed, strays])
        spots = project(model, s) + model.sensor.spot_noise_px * rng.normal(size=(len(s), 2))
        bad = rng.choice(len(s), strays, replace=False)
        spots[bad] = rng.uniform(0.0, 1023.0, (strays, 2))
        result = calibrate(spots, s, design(model), method="rays")
        assert np.flatnonzero(~result.used).tolist() == sorted(bad.tolist())
        clean = fit_physical(spots[result.used], s[result.used], design(model))
        np.testing.assert_allclose(result.fit.values, clean.values, rtol=1e-6, atol=1e-9)


def test_too_many_strays_are_no_strays(model, unit, grid):
    """A fifth of the points: all of them are fitted, as nothing says which ones are right."""
    s, rng = unit(grid(7)), np.random.default_rng(1)
    spots = project(model, s) + model.sensor.spot_noise_px * rng.normal(size=(49, 2))
    spots[rng.choice(49, 10, replace=False)] += rng.uniform(-3.0, 3.0, (10, 2))
    assert calibrate(spots, s, design(model), method="rays").used.all()
