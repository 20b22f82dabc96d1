"""Closed forms of the attitude accuracy against random fields, and the patent's formula beside them."""

import numpy as np
import pytest

from relnav.geometry.wahba import solve_wahba
from relnav.sensors.dual_field.prediction import attitude_sigma, patent_roll_readings, patent_roll_sigma

ARCSEC = np.radians(1.0 / 3600.0)
SIGMA = 1.73 * ARCSEC


def cap(rng, count, width):
    z = 1.0 - rng.random(count) * (1.0 - np.cos(0.5 * width))
    angle, r = 2.0 * np.pi * rng.random(count), np.sqrt(1.0 - z * z)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


@pytest.mark.parametrize(("width_deg", "n0", "n1"), [(10, 20, 0), (10, 10, 10), (20, 10, 10), (14, 20, 5)])
def test_against_random_fields(width_deg, n0, n1):
    """Mean variance over fields of stars placed at random; one field's roll is a little worse than its mean count."""
    rng, width = np.random.default_rng(1), np.radians(width_deg)
    variances = []
    for _ in range(400):
        w = np.concatenate([cap(rng, n0, width), cap(rng, n1, width)[:, [2, 1, 0]]])
        variances.append(np.diagonal(solve_wahba(w, w, SIGMA).covariance))
    measured = np.sqrt(np.mean(variances, axis=0))
    assert measured == pytest.approx(attitude_sigma(n0, n1, width, SIGMA), rel=0.06)


def test_the_table_of_the_design():
    """10 + 10 stars in 10 deg: 0.547, 0.387, 0.547 arcsec; 20 in one field: 6.28 arcsec of roll."""
    two = attitude_sigma(10, 10, np.radians(10), SIGMA) / ARCSEC
    assert two == pytest.approx([0.547, 0.387, 0.547], abs=0.001)
    assert attitude_sigma(20, 0, np.radians(10), SIGMA)[2] / ARCSEC == pytest.approx(6.28, abs=0.01)


def test_the_patents_formula_falls_where_the_roll_gets_worse():
    narrow, wide = np.radians(5.0), np.radians(20.0)
    assert attitude_sigma(10, 0, narrow, SIGMA)[2] > attitude_sigma(10, 0, wide, SIGMA)[2]
    assert patent_roll_sigma(10, narrow, SIGMA) < patent_roll_sigma(10, wide, SIGMA)
    right = np.sqrt(2.0) * SIGMA / (np.sqrt(10) * np.sin(0.5 * narrow))
    assert attitude_sigma(10, 0, narrow, SIGMA)[2] == pytest.approx(right, rel=0.001)


def test_no_reading_of_the_patents_formula_is_right_and_those_with_a_fraction_have_the_trend():
    shown, *fractions = (
        [patent_roll_readings(13, np.radians(width), SIGMA)[name] for width in (5.0, 14.0, 20.0)]
        for name in patent_roll_readings(13, 0.1, SIGMA)
    )
    right = [attitude_sigma(13, 0, np.radians(width), SIGMA)[2] for width in (5.0, 14.0, 20.0)]
    assert shown == sorted(shown)
    assert right == sorted(right, reverse=True)
    for share, values in zip((0.7, 0.5), fractions, strict=True):
        assert values == sorted(values, reverse=True)
        assert np.array(values) / right == pytest.approx([share] * 3, rel=0.05)
