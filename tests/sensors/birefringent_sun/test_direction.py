"""Two spots to a direction: exact inverses, a fit at its bound, labels, merging, and the public call."""

from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.accuracy.birefringent_sun import direction_sigmas, directions, estimated_sigma, gain_on_the_same_detector
from relnav.sensors.birefringent_sun.direction import fit_two_spots, label_spots
from relnav.sensors.birefringent_sun.spots import (
    project,
    separation_m,
    spots_jacobian,
    spots_of_transverse,
    transverse_from_extraordinary,
    transverse_from_ordinary,
)
from relnav.sensors.measurement import Status

UM = 1e-6
ARCSEC = np.pi / 648000.0


def test_either_spot_alone_gives_the_direction_exactly(crystals, cone):
    for sensor, s in zip(crystals(100), cone(85.0, 100), strict=True):
        spots = spots_of_transverse(sensor, s[:2])
        np.testing.assert_allclose(transverse_from_ordinary(sensor, spots[0]), s[:2], atol=1e-13)
        np.testing.assert_allclose(transverse_from_extraordinary(sensor, spots[1]), s[:2], atol=1e-13)


def test_with_an_air_path(sensor, cone):
    lens = replace(sensor, light_filter="lens", air_path_m=4e-3)
    u = cone(80.0, 200)[:, :2]
    spots = spots_of_transverse(lens, u)
    straight = lens.air_path_m * u / np.sqrt(1.0 - np.sum(u**2, axis=1, keepdims=True))
    np.testing.assert_allclose(
        spots - spots_of_transverse(sensor, u), np.stack([straight, straight], axis=1), atol=1e-15
    )
    np.testing.assert_allclose(transverse_from_ordinary(lens, spots[:, 0]), u, atol=1e-12)
    np.testing.assert_allclose(fit_two_spots(lens, spots, UM**2 * np.eye(4)).u, u, atol=1e-12)
    with pytest.raises(ValueError, match="only without an air path"):
        transverse_from_extraordinary(lens, spots[:, 1])


def test_jacobian(sensor, truth):
    for u in ([0.0, 0.0], [0.5, -0.3], [-0.8, 0.4]):
        numeric = truth.derivative(lambda x: spots_of_transverse(sensor, x), np.array(u), 1e-3)
        np.testing.assert_allclose(spots_jacobian(sensor, np.array(u)), numeric, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("air_path_m", [0.0, 3e-3])
def test_the_fit_is_honest(sensor, cone, air_path_m):
    """Mean NEES of two and mean chi2 of two degrees of freedom, 5000 noisy pairs: within 4 sigma of 2."""
    lens = replace(sensor, air_path_m=air_path_m)
    u = cone(60.0, 5000)[:, :2]
    noisy = spots_of_transverse(lens, u) + UM * np.random.default_rng(1).normal(size=(5000, 2, 2))
    fit = fit_two_spots(lens, noisy, UM**2 * np.eye(4))
    error = fit.u - u
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(fit.covariance, error[..., None])[..., 0])
    assert np.mean(nees) == pytest.approx(2.0, abs=4 * 2 / np.sqrt(5000))
    assert np.mean(fit.chi2) == pytest.approx(2.0, abs=4 * 2 / np.sqrt(5000))


# off axis deg: hole of the same depth, o, e, both, light shared; arcsec at 1 um, sun at 45 deg from the axis's azimuth
TABLE = {
    0.0: (41.3, 68.4, 61.9, 45.8, 64.8),
    30.0: (33.4, 66.9, 59.4, 44.3, 62.7),
    60.0: (16.3, 72.8, 61.0, 46.6, 65.9),
    75.0: (7.8, 107.8, 86.2, 67.0, 94.8),
}


@pytest.mark.parametrize("angle", TABLE)
def test_what_the_second_spot_is_worth(sensor, angle):
    """The bounds, and the estimator within 5 % of its own over 4000 pairs of spots."""
    s = directions(np.radians(angle), np.radians(45.0))
    sigmas = direction_sigmas(sensor, s)
    values = np.array([getattr(sigmas, n) for n in ("hole_same_depth", "ordinary", "extraordinary", "both", "shared")])
    np.testing.assert_allclose(values / ARCSEC, TABLE[angle], rtol=0.005)
    assert estimated_sigma(sensor, s, 4000, np.random.default_rng(2)) == pytest.approx(sigmas.both, rel=0.05)


@pytest.mark.parametrize(("angle", "on_axis", "rms"), [(30.0, 1.18, 1.08), (60.0, 1.98, 1.40), (80.0, 5.35, 2.53)])
def test_on_the_same_detector_the_wide_field_gains(sensor, angle, on_axis, rms):
    assert gain_on_the_same_detector(sensor, np.radians(angle)) == pytest.approx((on_axis, rms), rel=0.01)


def test_labels(sensor, cone):
    """No pair of 2000 is mistaken at 5 um of noise, in either order."""
    u = cone(60.0, 2000)[:, :2]
    noisy = spots_of_transverse(sensor, u) + 5 * UM * np.random.default_rng(3).normal(size=(2000, 2, 2))
    for spots, expected in ((noisy, False), (noisy[:, ::-1], True)):
        swapped, margin = label_spots(sensor, spots, (5 * UM) ** 2 * np.eye(4))
        assert np.all(swapped == expected)
        assert margin.min() > 20.0


def test_where_the_spots_merge(sensor):
    """The refracted wave along the axis: sin(sun) = n_o sin(theta_p), toward the axis; never above 31.5 deg of axis."""
    flat = replace(sensor, axis_polar_rad=np.radians(30.0))
    merge = flat.merging_angle_rad
    assert np.sin(merge) == pytest.approx(sensor.ordinary_index * 0.5)
    assert separation_m(flat, np.array([np.sin(merge), 0.0])) < 1e-12
    assert np.isnan(sensor.merging_angle_rad)
    rim = directions(np.radians(60.0), np.linspace(0, 6.28, 200))[:, :2]
    assert separation_m(sensor, rim).min() > 0.06 * sensor.crystal_thickness_m
    assert separation_m(sensor, np.zeros(2)) == pytest.approx(0.1092 * sensor.crystal_thickness_m, rel=1e-3)


def test_public_call(model, cone):
    """Any order of rows; NEES of 200 noisy pairs; rank 2."""
    rng, nees = np.random.default_rng(4), []
    for k, s in enumerate(cone(58.0, 200)):
        spots = project(model.sensor, s) + model.sensor.spot_noise_px * rng.normal(size=(2, 2))
        seen = relnav.birefringent_sun.measure(spots[::-1] if k % 2 else spots, model)
        assert seen.ok
        values, axes = np.linalg.eigh(seen.covariance)
        assert abs(values[0]) < 1e-9 * values[1]
        nees.append(np.sum((axes[:, 1:].T @ (s - seen.direction)) ** 2 / values[1:]))
    assert np.mean(nees) == pytest.approx(2.0, abs=4 * 2 / np.sqrt(200))


def test_covariance_of_the_rows_goes_with_the_rows(model):
    s = directions(0.4, 1.0)
    spots = project(model.sensor, s)
    noise = np.diag([1.0, 1.0, 0.01, 0.01])
    a = relnav.birefringent_sun.measure(spots, model, covariance_px2=noise)
    b = relnav.birefringent_sun.measure(spots[::-1], model, covariance_px2=noise[::-1, ::-1])
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-6)
    swapped = relnav.birefringent_sun.measure(spots, model, covariance_px2=noise[::-1, ::-1])
    assert not np.allclose(a.covariance, swapped.covariance, rtol=0.01)


def test_statuses(model):
    measure, sensor = relnav.birefringent_sun.measure, model.sensor
    spots = project(sensor, directions(0.4, 1.0))
    assert measure([[np.nan, 1.0], spots[1]], model).status is Status.NOT_SEEN
    assert measure([[-5.0, 1.0], spots[1]], model).status is Status.OFF_DETECTOR
    assert measure([spots[0], spots[0] + 3.0], model).status is Status.DEGENERATE
    assert measure([spots[0], spots[1] + [0.0, 40.0]], model).status is Status.NO_CONVERGENCE
    wide = replace(model, sensor=replace(sensor, detector_size_px=(4096, 4096), zero_spot_px=(2047.5, 2047.5)))
    outside = project(wide.sensor, directions(np.radians(62.0), 1.0))
    assert measure(outside, wide).status is Status.OUTSIDE_FIELD
    assert np.isnan(measure(outside, wide).direction).all()
    unknown = np.full((4, 4), np.nan)
    assert measure(spots, model, covariance_px2=unknown).status is Status.NO_CONVERGENCE
    assert np.isnan(project(sensor, [0.6, 0.0, -0.8])).all()


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (
            lambda m: relnav.birefringent_sun.measure([1.0, 2.0], m),
            r"two spots \(2, 2\) in px or an image .* got \(2,\)",
        ),
        (lambda m: relnav.birefringent_sun.measure(np.zeros((3, 2)), m), r"got \(3, 2\)"),
        (lambda m: relnav.birefringent_sun.measure(np.eye(2), m, covariance_px2=np.eye(2)), r"shape \(4, 4\)"),
        (
            lambda m: relnav.birefringent_sun.measure(
                project(m.sensor, directions(0.4, 1.0)), m, covariance_px2=np.diag([1.0, 1.0, 1.0, -1.0])
            ),
            "covariance_px2 is symmetric and positive definite; got",
        ),
        (lambda m: relnav.birefringent_sun.measure(np.eye(2), m, corner_px=(1.0, np.nan)), "corner_px is two finite"),
        (lambda m: project(m.sensor, [1.0, 0.0]), "3 components"),
        (lambda m: project(m.sensor, [1.0, 0.0, 1.0]), "unit vectors"),
        (lambda m: replace(m.sensor, light_filter="lens"), "air_path must be above zero"),
    ],
)
def test_wrong_use(model, call, text):
    with pytest.raises(ValueError, match=text):
        call(model)
