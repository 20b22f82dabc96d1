"""NIS and NEES with their intervals: against scipy.stats, and as verdicts on filters that are and are not honest."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from relnav.estimation.consistency import (
    Consistency,
    chi_square_interval,
    nees,
    nees_consistency,
    nis_consistency,
)
from relnav.estimation.whiteness import NeighbourSums


@pytest.mark.parametrize("dof", [1, 3, 60, 10_000, 1_000_000])
@pytest.mark.parametrize("probability", [0.5, 0.95, 0.999])
def test_interval(dof: int, probability: float) -> None:
    expected = np.array(chi2.interval(probability, dof)) / dof
    np.testing.assert_allclose(chi_square_interval(dof, probability), expected, rtol=1e-8)


@pytest.mark.parametrize("dof", [1_000_001, 5_000_000, 10**9])
@pytest.mark.parametrize("probability", [0.5, 0.95, 0.999])
def test_interval_of_very_many_degrees_of_freedom(dof: int, probability: float) -> None:
    """Wilson and Hilferty (1931): its error must be far below the interval's width."""
    lower, upper = chi_square_interval(dof, probability)
    expected = np.array(chi2.interval(probability, dof)) / dof
    width = expected[1] - expected[0]
    np.testing.assert_allclose([lower, upper], expected, rtol=0.0, atol=1e-3 * width)
    assert lower < 1.0 < upper


def honest(scale: float = 1.0, n: int = 500, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    dof = np.random.default_rng(seed).integers(1, 7, n)
    return scale * np.random.default_rng(seed + 1).chisquare(dof), dof


def white(rng: np.random.Generator, a: float = 0.0) -> NeighbourSums:
    """Of 500 images of six numbers, each a times the one before it and new noise."""
    v = rng.normal(size=(500, 6))
    for k in range(1, len(v)):
        v[k] = a * v[k - 1] + math.sqrt(1.0 - a * a) * v[k]
    sums = NeighbourSums()
    sums.take(v, np.ones(len(v), dtype=bool))
    return sums


def test_verdicts() -> None:
    assert nis_consistency(*honest()).consistent
    assert str(nis_consistency(*honest())).endswith(": consistent")
    assert str(nis_consistency(*honest(1.3))).endswith(": overconfident")
    unlike = nis_consistency(*honest(0.7), neighbours=white(np.random.default_rng(4)))
    assert str(unlike).endswith(": errors smaller than stated, no fault")
    assert str(nis_consistency(*honest(0.7))).endswith(": errors smaller than stated, or alike from image to image")
    assert not nis_consistency(*honest(1.3)).consistent


def test_errors_that_are_alike_from_image_to_image() -> None:
    """NIS is as it should be, or lower; no interval, or an inconspicuous one, and still overconfident."""
    alike = white(np.random.default_rng(5), 0.5)
    words = "overconfident: errors are alike from image to image (correlation 0.48)"
    for scale, lasting in ((1.0, False), (0.7, False), (1.0, True)):
        told = nis_consistency(*honest(scale), lasting=lasting, neighbours=alike)
        assert told.correlated
        assert not told.consistent
        assert told.overconfident
        assert words in str(told)
    wide = nis_consistency(*honest(1.0 / 3.0), neighbours=alike)  # three times the variance is stated
    assert not wide.correlated
    assert str(wide).endswith(": errors smaller than stated, no fault")


def test_the_sentence() -> None:
    text = str(Consistency("NIS", 1.2345, 0.9, 1.1, 30, 0.95))
    assert text == "NIS per degree of freedom 1.234, 95 % interval [0.900, 1.100]: overconfident"
    assert str(Consistency("NEES", 1.0, 0.9, 1.1, 30, 0.999)) == (
        "NEES per degree of freedom 1.000, 99.9 % interval [0.900, 1.100]: consistent"
    )


def test_sum_over_the_degrees_of_freedom() -> None:
    got = nis_consistency(np.array([2.0, 5.0, 11.0]), np.array([2, 4, 6]), 0.9)
    assert (got.quantity, got.dof, got.probability) == ("NIS", 12, 0.9)
    assert got.ratio == pytest.approx(18.0 / 12.0)
    np.testing.assert_allclose([got.lower, got.upper], np.array(chi2.interval(0.9, 12)) / 12, rtol=1e-9)


def test_missing_epochs_are_left_out_with_their_degrees_of_freedom() -> None:
    values = np.array([2.0, np.nan, 5.0, np.inf, 7.0])
    got = nis_consistency(values, np.array([2, 3, 4, 6, 0]))
    assert got.dof == 6
    assert got.ratio == pytest.approx(7.0 / 6.0)


@pytest.mark.parametrize("values", [np.array([]), np.array([np.nan, np.nan])])
def test_no_data(values: np.ndarray) -> None:
    nothing = nis_consistency(values, np.full(values.shape, 3))
    assert nothing.dof == 0
    assert math.isnan(nothing.ratio)
    assert not nothing.consistent
    assert str(nothing) == "NIS: no data"
    assert str(nees_consistency(values, 6)) == "NEES: no data"


def test_nees_against_an_explicit_inverse() -> None:
    rng = np.random.default_rng(3)
    errors, m = rng.normal(size=(20, 6)), rng.normal(size=(20, 6, 8))
    covariances = m @ np.swapaxes(m, 1, 2)
    expected = [e @ np.linalg.inv(p) @ e for e, p in zip(errors, covariances, strict=True)]
    np.testing.assert_allclose(nees(errors, covariances), expected, rtol=1e-9)


def test_nees_of_draws_from_the_covariance_is_consistent() -> None:
    rng = np.random.default_rng(4)
    m = rng.normal(size=(6, 8))
    p = m @ m.T
    errors = rng.multivariate_normal(np.zeros(6), p, size=400)
    values = nees(errors, np.broadcast_to(p, (400, 6, 6)))
    got = nees_consistency(values, 6, 0.99)
    assert got.consistent
    assert got.dof == 2400
    assert not nees_consistency(nees(1.2 * errors, np.broadcast_to(p, (400, 6, 6))), 6, 0.99).consistent


def test_nees_leaves_missing_runs_out() -> None:
    got = nees_consistency(np.array([6.0, np.nan, 12.0]), 6)
    assert got.dof == 12
    assert got.ratio == pytest.approx(1.5)
