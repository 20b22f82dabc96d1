"""The correction inverts the distortion over its whole box, or there is none: grids that leave corners open."""

import numpy as np
import pytest

from relnav.sensors.three_beacon.calibrate import calibrate
from relnav.sensors.three_beacon.calibration import Calibration
from relnav.sensors.three_beacon.inverse import LARGEST_SIGMAS, MOST_TIMES
from relnav.sensors.three_beacon.smooth_figure import legendre

HALF_M = 3.6e-3


def square(side):
    line = np.linspace(-HALF_M, HALF_M, side)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def turned(side, angle):
    """A square grid by an angle: the corners of its box hold no point."""
    c, s = np.cos(angle), np.sin(angle)
    return 0.8 * square(side) @ np.array([[c, s], [-s, c]])


class Waves:
    """Distortion by a product of sines for each axis: smooth, and up to a wave and a quarter over the detector."""

    def __init__(self, rng, size_m):
        self.size_m = size_m
        self.number = rng.uniform(0.5, 2.5, (2, 2)) * np.pi / 8e-3
        self.phase = rng.uniform(0.0, 2.0 * np.pi, (2, 2))

    def error(self, true_m):
        """Error (n, 2) m."""
        angle = true_m[:, None, :] * self.number + self.phase
        return 2.0 * self.size_m * np.sin(angle).prod(axis=2)


def trial(grid, seed, size_m, noise_m):
    """The distortion, the report, and what the distortion was fitted as."""
    rng = np.random.default_rng((11, seed))
    waves = Waves(rng, size_m)
    error = waves.error(grid) + noise_m * rng.normal(size=grid.shape)
    report = calibrate(grid, grid + error)
    coefficients = report.estimator.coefficients(error)

    def fitted(true_m):
        return legendre(report.box.scaled(true_m), report.estimator.order) @ coefficients

    return waves, report, fitted


def box_of(calibration, side=61):
    line = np.linspace(-1.0, 1.0, side)
    unit = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    return np.array(calibration.center_m) + np.array(calibration.half_width_m) * unit


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("kind", ["square", "turned", "scattered"])
def test_the_correction_leads_back_all_over_its_box(kind, seed):
    """From a corrected spot the fitted distortion leads to where it was measured, within the residual that is said.

    Noise of 0.3 um asks most of the inverse, which is not of a finite order. Away from the points the correction is of
    the size of their errors, and its slope below one.
    """
    rng = np.random.default_rng((5, seed))
    grid = {
        "square": square(8),
        "turned": turned(6, rng.uniform(0.3, 1.2)),
        "scattered": rng.uniform(-HALF_M, HALF_M, (49, 2)),
    }[kind]
    _, report, fitted = trial(grid, seed, 10.0 ** rng.uniform(1.3, 2.2) * 1e-6, 0.3e-6)
    c = report.calibration
    measured = box_of(c)
    out = c.correct(measured)
    assert np.abs(out - measured).max() < 1.01 * MOST_TIMES * report.raw_max_m
    inside = (np.abs(report.box.scaled(out)) <= 1.0).all(axis=1)
    assert inside.mean() > 0.8
    off = np.abs(out + fitted(out) - measured)[inside]
    assert off.max() < 1.5 * LARGEST_SIGMAS * c.residual_sigma_m  # the distortion's own slope on top
    assert np.sqrt(np.mean(off**2)) < 1.2 * c.residual_sigma_m
    assert c.rim_slope < 1.0


def test_open_corners_do_not_decide_by_points_elsewhere():
    """Points left out are predicted best by an order that is wrong in the corners: what is said holds there too.

    36 points turned by some 45 deg, 0.4 um. True positions all over the box; 2 of 24 may be beyond three times (the
    residual of so few points is an estimate itself).
    """
    ratios, other = [], 0
    for seed in range(24):
        waves, report, fitted = trial(turned(6, 0.8), seed, 100e-6, 0.4e-6)
        true = report.box.grid(41)
        wrong = np.sqrt(np.mean((fitted(true) - waves.error(true)) ** 2))
        ratios.append(wrong / report.calibration.residual_sigma_m)
        other += report.chosen.prediction_m > min(fit.prediction_m for fit in report.orders)
        assert report.chosen.apart_m <= report.chosen.left_m
    assert other > 0  # of these grids: there it matters
    assert np.sum(np.array(ratios) > 3.0) <= 2
    assert np.sqrt(np.mean(np.square(ratios))) < 2.0


def test_points_that_leave_the_box_open_are_refused():
    """A narrow band across the box tells the shear from noise alone: corners beside it would be anything."""
    rng = np.random.default_rng(3)
    along = rng.uniform(-HALF_M, HALF_M, 40)
    grid = np.stack([along, along + rng.normal(size=40) * 2e-5], axis=1)
    text = r"the fit gives a correction of .* mm for a spot at .* mm, and the largest error of the points is .* mm: the"
    with pytest.raises(ValueError, match=text):
        calibrate(grid, grid + rng.normal(size=grid.shape) * 2e-5)


def test_a_correction_that_diverges_is_none():
    """Slope, over a 64th of the box: 0.9 is one, 1.1 is none, and numbers that overflow are none."""

    def with_slope(slope, order=1):
        terms = [0.0] * ((order + 1) * (order + 2) // 2)
        terms[1] = slope * 2e-3
        return Calibration(order, (1e-3, 0.0), (2e-3, 4e-3), (0.0,) * len(terms), tuple(terms), 1e-6, 0.0, 9, 0.0)

    assert with_slope(0.9).order == 1
    for slope in (1.1, -1.1, 1e300, 1e308):
        with pytest.raises(ValueError, match=r"the correction diverges at .* mm: it changes by .* times the way"):
            with_slope(slope)
    corner = [0.0] * 153
    corner[136 + 8] = 6e-4  # u^8 v^8: nothing but in the corners, where it is steep
    with pytest.raises(ValueError, match=r"diverges at \(-4.00, -4.00\) mm: it changes by 1.08 times"):
        Calibration(16, (0.0, 0.0), (4e-3, 4e-3), tuple(corner), (0.0,) * 153, 1e-6, 0.0, 9, 0.0)
