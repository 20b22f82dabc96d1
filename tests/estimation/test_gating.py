"""Chi-square limits against scipy.stats, and against draws."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from relnav.estimation.gating import chi_square_limit, chi_square_tail, gate_limits


@pytest.mark.parametrize("probability", [0.5, 0.95, 0.99, 0.9999, 1.0 - 1e-9])
@pytest.mark.parametrize("dof", [1, 2, 3, 6, 100])
def test_against_scipy(probability: float, dof: int) -> None:
    assert chi_square_limit(probability, dof) == pytest.approx(chi2.ppf(probability, dof), rel=1e-9)


@pytest.mark.parametrize("dof", [1, 2, 3, 4, 5, 17, 18, 99, 1000, 1001])
def test_tails_against_scipy(dof: int) -> None:
    for value in dof * np.array([1e-3, 0.1, 0.5, 1.0, 1.5, 3.0, 10.0]):
        assert chi_square_tail(value, dof) == pytest.approx(chi2.sf(value, dof), rel=1e-9, abs=1e-300)
    assert chi_square_tail(0.0, dof) == chi_square_tail(-1.0, dof) == 1.0


def test_printed_table_values() -> None:
    """Bar-Shalom, Li, Kirubarajan (2001), table 1.5.4-1."""
    assert chi_square_limit(0.95, 1) == pytest.approx(3.84, abs=0.005)
    assert chi_square_limit(0.99, 2) == pytest.approx(9.21, abs=0.005)
    assert chi_square_limit(0.95, 6) == pytest.approx(12.6, abs=0.05)


def test_limits_by_degrees_of_freedom() -> None:
    limits = gate_limits(0.9999)
    assert limits.shape == (6,)
    np.testing.assert_allclose(limits, chi2.ppf(0.9999, np.arange(1, 7)), rtol=1e-9)
    assert gate_limits(0.99, most_dof=2).shape == (2,)


def test_a_good_measurement_passes_as_often_as_stated() -> None:
    draws = np.random.default_rng(0).normal(size=(200_000, 3))
    passed = np.mean((draws**2).sum(axis=1) < chi_square_limit(0.99, 3))
    assert passed == pytest.approx(0.99, abs=0.001)


@pytest.mark.parametrize(
    ("probability", "dof"), [(0.0, 1), (1.0, 1), (-0.1, 1), (1.1, 1), (math.nan, 1), (0.9, 0), (0.9, -2)]
)
def test_wrong_use(probability: float, dof: int) -> None:
    with pytest.raises(ValueError, match="0 < probability < 1 and dof >= 1 are expected; got"):
        chi_square_limit(probability, dof)
