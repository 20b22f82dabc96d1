"""Reported sigma beside the published figure: ratio, and the time from which it is met."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import relnav
from relnav.accuracy.published import Comparison, compare_with_published

N = 80


@pytest.fixture(scope="module")
def published():
    return relnav.load_published("three_beacon_psd")


@pytest.fixture(scope="module")
def solution():
    t = 10.0 + 0.5 * np.arange(N)
    spots = np.tile([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]], (N, 1, 1))
    return relnav.filter_epochs(relnav.load_model("three_beacon_psd"), t, spots, method="spots")


def with_sigma(solution, sigma):
    """What is asked of a solution, with docking sigmas (n, 3) as given."""
    return SimpleNamespace(t_s=solution.t_s, docking_sigma=np.asarray(sigma))


def test_figures_are_in_the_claims_own_unit(solution, published):
    sigma = np.tile([0.01, math.radians(0.044), math.radians(0.364)], (N, 1))
    rows = compare_with_published(with_sigma(solution, sigma), published)
    assert [row.claim.quantity for row in rows] == ["range", "azimuth", "elevation"]
    assert [row.sigma for row in rows] == pytest.approx([0.01, 0.044, 0.364], rel=1e-12)
    assert [row.ratio for row in rows] == pytest.approx([0.5, 0.25, 2.0], rel=1e-12)


def test_value_in_si(published):
    values = {claim.quantity: claim.value_si for claim in published.claims}
    assert values["range"] == 0.02
    assert values["azimuth"] == pytest.approx(0.176 * math.pi / 180.0, rel=1e-15)


def test_met_from_is_the_time_after_the_last_excess(solution, published):
    sigma = np.full((N, 3), 1e-4)
    sigma[:20, 0] = 0.03  # range: met from row 20
    sigma[40, 1] = 1.0  # azimuth: once more at row 40
    sigma[-1, 2] = 1.0  # elevation: at the very end
    rows = compare_with_published(with_sigma(solution, sigma), published)
    assert rows[0].met_from_s == solution.t_s[20]
    assert rows[1].met_from_s == solution.t_s[41]
    assert math.isnan(rows[2].met_from_s)


def test_exactly_the_published_figure_meets_it(solution, published):
    sigma = np.tile([0.02, math.radians(0.176), math.radians(0.182)], (N, 1))
    rows = compare_with_published(with_sigma(solution, sigma * (1 - 1e-15)), published)
    assert [row.met_from_s for row in rows] == [solution.t_s[0]] * 3


def test_epochs_without_a_state_do_not_meet_anything(solution, published):
    sigma = np.full((N, 3), 1e-4)
    sigma[:5] = np.nan
    assert [row.met_from_s for row in compare_with_published(with_sigma(solution, sigma), published)] == [12.5] * 3


def test_a_track_that_never_started(published):
    t = np.arange(5.0)
    solution = relnav.filter_epochs(
        relnav.load_model("three_beacon_psd"), t, np.full((5, 3, 2), np.nan), method="spots"
    )
    rows = compare_with_published(solution, published)
    assert len(rows) == 3
    assert all(math.isnan(row.sigma) and math.isnan(row.met_from_s) and math.isnan(row.ratio) for row in rows)


def test_a_real_track_meets_the_paper(solution, published):
    rows = compare_with_published(solution, published)
    assert all(row.ratio < 1.0 for row in rows)
    assert all(solution.t_s[0] < row.met_from_s <= solution.t_s[-1] for row in rows)
    for j, row in enumerate(rows):
        expected = solution.docking_sigma[-1, j] * (1.0 if row.claim.unit == "m" else 180.0 / math.pi)
        assert row.sigma == pytest.approx(expected, rel=1e-12)


def test_a_claim_about_another_quantity_is_left_out(solution, published):
    other = replace(published.claims[0], quantity="roll rate")
    rows = compare_with_published(solution, replace(published, claims=(other, *published.claims)))
    assert [row.claim.quantity for row in rows] == ["range", "azimuth", "elevation"]


def test_ratio_is_of_sigma_to_figure(published):
    assert Comparison(published.claims[0], 0.005, 0.0).ratio == 0.25
