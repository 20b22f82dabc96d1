"""The public call: from image or spot to a direction whose covariance is true, and a status where there is none."""

from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.sensors.aps_sun import calibrate, measure
from relnav.sensors.aps_sun.rays import project
from relnav.sensors.measurement import Status
from relnav.simulation.sun_spot import read_out, render_spot


def test_a_spot_gives_the_direction(model, unit, grid):
    """As built and without noise: within what compiling costs."""
    for s in unit(grid(9)):
        seen = measure(project(model, s), model)
        assert seen.ok
        assert np.degrees(np.abs(seen.direction - s).max()) < 6e-4
        assert np.degrees([seen.alpha_rad, seen.beta_rad]) == pytest.approx(
            np.degrees(np.arctan2(s[:2], s[2])), abs=1e-3
        )


def test_covariance_has_rank_two_and_is_true(model, unit):
    """NEES of 2000 noisy spots with a calibration from 49 points: mean 2 within its 99.9 % band and the fit's error."""
    rng = np.random.default_rng(8)
    along = np.linspace(-60.0, 60.0, 7)
    s = unit(np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2))
    spots = project(model, s)
    used = calibrate(spots + 0.03 * rng.normal(size=spots.shape), s, model).calibration
    nees = []
    for s in unit(rng.uniform(-60.0, 60.0, (2000, 2))):
        seen = measure(project(model, s) + 0.03 * rng.normal(size=2), model, calibration=used)
        values, axes = np.linalg.eigh(seen.covariance)
        assert abs(values[0]) < 1e-9 * values[1]
        assert abs(axes[:, 0] @ seen.direction) > 1.0 - 1e-6
        error = axes[:, 1:].T @ (s - seen.direction)
        nees.append(np.sum(error**2 / values[1:]))
        assert seen.sigma_rad == pytest.approx(np.sqrt(values[1:].mean()))
    assert 1.8 < np.mean(nees) < 2.3


def test_an_image_gives_the_direction(model, unit):
    """60 images over the field: errors fit their covariances, which come from the images."""
    rng, nees = np.random.default_rng(1), []
    for s in unit(rng.uniform(-60.0, 60.0, (60, 2))):
        window = render_spot(model, s)
        seen = relnav.aps_sun.measure(read_out(window, model.image, rng), model, corner_px=window.corner_px)
        assert seen.ok
        assert np.degrees(np.linalg.norm(seen.direction - s)) < 0.02
        error = (s - seen.direction)[:2]
        nees.append(error @ np.linalg.solve(seen.covariance[:2, :2], error))
    # the sun's disc pulls the centre outward by up to 0.014 px: a calibration with images contains that, this one not
    assert np.mean(nees) < 8.0


def test_statuses(model, unit):
    spot = project(model, unit([[10.0, -20.0]])[0])
    assert measure([np.nan, 500.0], model).status is Status.NOT_SEEN
    assert measure([-0.6, 500.0], model).status is Status.OFF_DETECTOR
    assert measure([500.0, 1024.0], model).status is Status.OFF_DETECTOR
    assert measure(np.zeros((24, 24)), model).status is Status.NOT_SEEN
    for angles, status in (
        ([60.9, 0.0], Status.OK),
        ([61.2, 0.0], Status.OUTSIDE_FIELD),
        ([0.0, -66.0], Status.OUTSIDE_FIELD),
    ):
        assert measure(project(model, unit([angles])[0]), model).status is status
    none = measure([np.nan, np.nan], model)
    assert not none.ok
    assert np.isnan(none.direction).all()
    assert np.isnan(none.covariance).all()
    assert measure(spot, model).ok
    assert measure(spot - [100.0, 50.0], model, corner_px=(100.0, 50.0)).direction == pytest.approx(
        measure(spot, model).direction
    )


def test_results_do_not_change(model):
    seen = measure([500.0, 500.0], model)
    with pytest.raises(ValueError, match="read-only"):
        seen.direction[0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        seen.covariance[0, 0] = 0.0


def test_more_spot_noise_more_sigma(model):
    noisy = replace(model, sensor=replace(model.sensor, spot_noise_px=0.3))
    assert measure([500.0, 400.0], noisy).sigma_rad == pytest.approx(10.0 * measure([500.0, 400.0], model).sigma_rad)


def test_wrong_use(model):
    for bad in (np.zeros(3), np.zeros((2, 3, 4)), 5.0):
        with pytest.raises(ValueError, match=r"an image \(rows, columns\) of counts or a spot \(2,\)"):
            measure(bad, model)
