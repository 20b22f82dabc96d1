"""Calibration: the bar on 225 points of 10 um, what it says when it does not reach it, and where it ends."""

import math

import numpy as np
import pytest

from relnav.sensors.three_beacon.calibrate import calibrate
from relnav.sensors.three_beacon.calibration import Calibration, exponents
from relnav.sensors.three_beacon.smooth_figure import Box, Estimator, Figures, legendre
from relnav.simulation.distortion import Distortion, typical_distortion

HALF_M = 4e-3
INSIDE_M = HALF_M * math.sqrt(0.75)  # 75 % of the area
RUNS = 16


def grid(side, half=INSIDE_M):
    line = np.linspace(-half, half, side)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def trial(seed, side=15, length=1.0, noise_m=10e-6):
    """A distorted detector, its grid, the report, and what is left (3 rms of each axis) on points without noise."""
    distortion = typical_distortion(HALF_M, 250e-6, length_m=length * INSIDE_M, seed=seed)
    rng = np.random.default_rng(1000 + seed)
    true = grid(side)
    measured = distortion.apply(true) + rng.normal(size=true.shape) * noise_m
    report = calibrate(true, measured, detector_size_m=(8e-3, 8e-3))
    test = rng.uniform(-INSIDE_M, INSIDE_M, (2000, 2))
    left = report.calibration.correct(distortion.apply(test)) - test
    return report, 3.0 * np.sqrt(np.mean(left**2, axis=0))


@pytest.fixture(scope="module")
def trials():
    return {length: [trial(seed, length=length) for seed in range(RUNS)] for length in (0.5, 1.0, 2.0, 4.0)}


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def told(seed, length, noise_m=10e-6):
    """What the best estimator leaves that knows size and length of the figure and the noise, of the same grid."""
    distortion = typical_distortion(HALF_M, 250e-6, length_m=length * INSIDE_M, seed=seed)
    rng = np.random.default_rng(1000 + seed)
    true, box = grid(15), Box.around(grid(15))
    noise = rng.normal(size=true.shape) * noise_m
    best = Estimator(box, box.scaled(true), 12, Figures.known(length, distortion.figure_sigma_m, noise_m))
    test = rng.uniform(-INSIDE_M, INSIDE_M, (2000, 2))
    fitted = legendre(box.scaled(test), 12) @ best.coefficients(distortion.error(true) + noise)
    return 3.0 * np.sqrt(np.mean((fitted - distortion.error(test)) ** 2, axis=0))


def test_the_distortion_is_the_papers():
    """+-250 um inside 75 % of the area, whatever the seed."""
    for seed in range(5):
        error = typical_distortion(HALF_M, 250e-6, seed=seed).error(grid(81))
        assert np.abs(error).max() == pytest.approx(250e-6, rel=0.02)


def test_225_points_of_ten_micrometres_reach_ten(trials):
    """3 x rms, each axis: about 1.5 % are above 10 um where the figure is as fine as the half-width, none beyond."""
    left = {length: np.concatenate([left for _, left in runs]) for length, runs in trials.items()}
    assert (left[1.0] > 10e-6).sum() <= 3  # of 32; more have a chance of 0.2 %
    assert rms(left[1.0]) < 7.5e-6
    for length in (2.0, 4.0):
        assert left[length].max() <= 10e-6


@pytest.mark.parametrize("length", [0.5, 1.0, 2.0])
def test_hardly_worse_than_knowing_the_figure(trials, length):
    """No estimator can do better on average than the one that is told the figure's covariance."""
    bound = rms([told(seed, length) for seed in range(RUNS)])
    assert 0.98 < rms([left for _, left in trials[length]]) / bound < 1.08


def test_it_says_what_it_reaches(trials):
    """The reported residual is the true one, for every fineness; so is the share of axes within the target."""
    for length, runs in trials.items():
        ratio = rms([report.reached_m for report, _ in runs]) / rms([left for _, left in runs])
        assert 0.88 < ratio < 1.12, length
    for length in (0.5, 1.0):
        said = 2.0 * sum(report.chance for report, _ in trials[length])
        within = sum((left <= 10e-6).sum() for _, left in trials[length])
        assert said == pytest.approx(within, abs=3.0 * math.sqrt(said * (1.0 - said / (2.0 * RUNS))))


def test_finer_than_it_can_follow_and_few_points_are_said():
    for length, side in ((0.25, 15), (1.0, 5)):
        runs = [trial(seed, side=side, length=length) for seed in range(10)]
        assert 0.85 < rms([report.reached_m for report, _ in runs]) / rms([left for _, left in runs]) < 1.1
    fine, _ = trial(0, length=0.25)
    assert not fine.met
    assert fine.recommended() is None
    assert 3.0 * fine.orders[-1].figure_m > 10e-6


def test_a_finer_figure_is_not_met_and_a_larger_grid_recommended(trials):
    reports = [report for report, _ in trials[0.5]]
    assert np.mean([report.met for report in reports]) < 0.5
    for report in reports:
        assert report.met == (report.chance > 0.5) or abs(report.chance - 0.5) < 0.1
        assert report.recommended() > 15
    lengths = np.array([report.figure_length_m for report in reports]) / INSIDE_M
    assert np.mean((lengths[:, 0] < 0.5) & (lengths[:, 1] > 0.5)) > 0.6


def test_the_order_is_the_one_that_predicts_best():
    """Left-out coordinates are predicted by really leaving them out."""
    true, rng = grid(6), np.random.default_rng(3)
    error = typical_distortion(HALF_M, 250e-6, seed=3).error(true) + rng.normal(size=true.shape) * 1e-5
    report = calibrate(true, true + error)
    assert report.chosen.prediction_m == min(fit.prediction_m for fit in report.orders)
    assert [fit.order for fit in report.orders] == list(range(3, 13))
    estimator, u = report.estimator, report.box.scaled(true)
    wrong = []
    for axis in range(2):
        for k in range(len(true)):
            without = error.copy()
            for _ in range(60):  # a value that its own prediction agrees with says nothing: the point is out
                without[k, axis] = (estimator.terms[k] @ estimator.coefficients(without))[axis]
            wrong.append(error[k, axis] - without[k, axis])
    assert rms(wrong) == pytest.approx(report.chosen.prediction_m, rel=1e-6)
    assert len(u) == report.calibration.points


def test_too_few_points_and_the_recommended_grid_then_does():
    reports = [trial(seed, side=8)[0] for seed in range(10)]
    assert np.mean([report.met for report in reports]) <= 0.4
    sides = [report.recommended() for report in reports]
    assert np.median(sides) > 13
    left = np.concatenate([trial(seed, side=side)[1] for seed, side in enumerate(sides)])
    assert (left > 10e-6).sum() <= 1


def test_the_chance_is_that_of_a_normal_figure():
    """Draws of the coefficients' errors from their covariance: the share of axes within is the one that is said."""
    report, _ = trial(0, length=0.5)
    estimator, p = report.estimator, report.estimator.terms.shape[1]
    root = np.linalg.cholesky(estimator.covariance + 1e-18 * np.eye(2 * p))
    wrong = (root @ np.random.default_rng(1).normal(size=(2 * p, 20000))).reshape(2, p, -1)
    left = 3.0 * np.sqrt((wrong**2).sum(axis=1) + estimator.missed_m**2)
    for target in (9e-6, 10e-6, 12e-6):
        assert estimator.chance(target) == pytest.approx(np.mean(left <= target), abs=0.03)


def test_exact_optics_are_found_without_noise():
    true = np.random.default_rng(1).uniform(-3e-3, 3e-3, (60, 2))
    measured = Distortion(HALF_M, pin_cushion_m=1e-4, tilt_m=(-3e-5, 6e-5)).apply(true) * 1.01 + 1e-4
    report = calibrate(true, measured)
    np.testing.assert_allclose(report.calibration.correct(measured), true, atol=3e-9)
    assert report.reached_m < 1e-8


def test_outside_the_grid_the_correction_is_held_and_its_sigma_grows():
    distortion = Distortion(HALF_M, pin_cushion_m=2e-4)
    true = grid(15)
    report = calibrate(true, distortion.apply(true) + np.random.default_rng(2).normal(size=true.shape) * 1e-6)
    c = report.calibration
    edge = np.array(c.center_m) + np.array(c.half_width_m)
    beyond = edge + np.array([3e-4, 0.0])
    np.testing.assert_allclose(c.correct(beyond) - beyond, c.correct(edge) - edge, atol=1e-15)
    assert (c.corrected(edge * 0.5)[1] == c.residual_sigma_m).all()
    true_beyond = np.array([INSIDE_M + 3e-4, INSIDE_M])
    error = c.correct(distortion.apply(true_beyond)) - true_beyond
    assert (np.abs(error) < 3.0 * c.corrected(distortion.apply(true_beyond))[1]).all()
    assert np.abs(error).max() > 3.0 * c.residual_sigma_m


def test_where_true_spots_are_measured(trials):
    """The inverse of the correction, beyond the box and off the detector too."""
    calibration = trials[1.0][0][0].calibration
    true = np.random.default_rng(5).uniform(-8e-3, 8e-3, (500, 2))
    np.testing.assert_allclose(calibration.correct(calibration.distorted(true)), true, rtol=0.0, atol=1e-12)
    assert np.isnan(calibration.distorted([[np.nan, np.nan]])).all()


def test_missing_spots_stay_missing():
    c = Calibration(0, (0.0, 0.0), (1e-3, 1e-3), (1e-5,), (2e-5,), 1e-6, 0.0, 9, 1e-6)
    got = c.correct(np.array([[np.nan, np.nan], [1e-3, 2e-3]]))
    assert np.isnan(got[0]).all()
    np.testing.assert_allclose(got[1], [1.01e-3, 2.02e-3])


def test_points_that_are_missing_are_left_out_and_holes_are_told():
    true = grid(15)
    measured = true.copy()
    measured[(true > 1.5e-3).all(axis=1)] = np.nan
    report = calibrate(true, measured + np.random.default_rng(3).normal(size=true.shape) * 1e-6)
    assert report.calibration.points < 225
    assert report.empty_cells > 0
    assert not report.met


@pytest.mark.parametrize(
    ("true", "text"),
    [
        (np.zeros((7, 3)), r"have one shape \(n, 2\); got \(7, 3\)"),
        (
            np.random.default_rng(0).normal(size=(5, 2)),
            "twelve different points or more are needed for a calibration; got 5",
        ),
        (np.stack([np.arange(12.0), np.zeros(12)], axis=1), "the points lie on one line"),
        (np.stack([np.arange(12.0), np.arange(12.0)], axis=1), "do not tell shear, pin-cushion and tilt apart"),
    ],
)
def test_wrong_use(true, text):
    with pytest.raises(ValueError, match=text):
        calibrate(true, 1.01 * true)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda true, _: true, "the measured positions are the known ones"),
        (lambda _, measured: measured[:, ::-1], "another unit, or axes that are exchanged or mirrored"),
        (lambda _, measured: measured * [-1.0, 1.0], "another unit, or axes that are exchanged or mirrored"),
        (lambda _, measured: measured * 1e-3, "another unit, or axes that are exchanged or mirrored"),
        (lambda _, measured: np.where(np.arange(225)[:, None] == 7, 1e200, measured), "is measured 1.414e+203 mm from"),
    ],
    ids=["the known ones", "exchanged", "mirrored", "another unit", "absurd"],
)
def test_what_no_detector_measures_is_refused(change, text):
    true = grid(15)
    measured = typical_distortion(HALF_M, 250e-6, seed=1).apply(true)
    with pytest.raises(ValueError, match=text.replace("+", r"\+")):
        calibrate(true, change(true, measured))


def test_spots_off_the_detector_are_refused():
    true = grid(15) * 1e3
    with pytest.raises(ValueError, match="mm off the middle, but the detector has 8 x 8 mm: are the units right"):
        calibrate(true, typical_distortion(HALF_M, 250e-6, seed=1).apply(true), detector_size_m=(8e-3, 8e-3))


def test_an_outlier_is_named():
    """0.1 mm among 225 points of 5 um; without it no point is far from the others."""
    true = grid(15)
    measured = typical_distortion(HALF_M, 250e-6, seed=1).apply(true)
    measured += np.random.default_rng(1).normal(size=true.shape) * 5e-6
    assert calibrate(true, measured).outlier_sigma < 6.0
    measured[100, 0] += 1e-4
    report = calibrate(true, measured)
    assert report.outlier_m == tuple(true[100])
    assert 15.0 < report.outlier_sigma < 25.0


def test_coefficients_must_be_as_many_as_the_order_says():
    assert exponents(2) == [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
    with pytest.raises(ValueError, match="correction_y_m has 3 coefficients for order 1; got 1"):
        Calibration(1, (0.0, 0.0), (1.0, 1.0), (0.0, 0.0, 0.0), (0.0,), 0.0, 0.0, 9, 0.0)
