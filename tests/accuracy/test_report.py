"""The accuracy report: the numbers that must come out. The full campaign is `relnav accuracy`."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.accuracy.campaign import Way, run_campaign
from relnav.accuracy.statistics import nees_band
from relnav.estimation.consistency import chi_square_interval
from relnav.sensors.three_beacon.calibration import Calibration
from relnav.simulation.trajectory import Approach


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


@pytest.fixture(scope="module")
def report(model):
    return relnav.measure_accuracy(model, runs=8, seed=7)


def measured(report, method, quantity, range_m):
    (row,) = [r for r in report.rows if (r.method, r.quantity, r.range_m) == (method, quantity, range_m)]
    return row


@pytest.mark.parametrize(
    ("method", "expected"),
    [
        ("single shot, parallel form, parallel optics", (0.020, 0.176, 0.176)),
        ("single shot, exact form", (0.020, 0.158, 0.162)),
    ],
)
def test_published_figures_from_first_principles(report, method, expected):
    for quantity, value in zip(("range", "azimuth", "elevation"), expected, strict=True):
        row = measured(report, method, quantity, 6.5)
        assert row.measured == pytest.approx(value, rel=0.05)
        assert row.coverage_1 == pytest.approx(0.6827, abs=0.01)
        assert row.coverage_3 == pytest.approx(0.9973, abs=0.001)


def test_fix_filter_is_five_times_better_and_spots_fifty_times(report):
    for quantity in ("range", "azimuth", "elevation"):
        row = measured(report, "fix filter", quantity, 6.5)
        assert row.measured < row.published / 5.0
    for quantity in ("azimuth", "elevation"):
        row = measured(report, "spots filter", quantity, 6.5)
        assert row.measured < row.published / 50.0


def test_every_row_comes_out_as_expected(report):
    wrong = [row for row in report.rows if not row.as_expected]
    assert not wrong
    assert {row.expected for row in report.rows} == {"met", "not met"}


def test_the_printed_form_is_biased_and_overconfident(report):
    row = measured(report, "single shot, parallel form, real optics, 5 deg off axis", "azimuth", 6.5)
    assert row.bias == pytest.approx(0.564, abs=0.01)
    assert not row.met
    (filtered,) = [row for row in report.consistency if row.method == "fix filter, parallel form"]
    assert not filtered.consistent
    assert not filtered.expected_consistent
    assert filtered.nees.mean > 8.0
    assert "biased" in filtered.reason


def test_the_filter_settles_where_the_riccati_equation_says(report):
    assert {(row.method, row.range_m) for row in report.settled} == {
        (m, r) for m in ("fix", "spots") for r in (4, 6.5, 10)
    }
    for row in report.settled:
        assert row.reached_range_m == pytest.approx(row.sigma_range_m, rel=0.01)
        assert row.reached_azimuth_rad == pytest.approx(row.sigma_azimuth_rad, rel=0.01)
        assert row.reached_elevation_rad == pytest.approx(row.sigma_elevation_rad, rel=0.01)
        assert len(row.observability) == 6
        assert len(row.gain) == 6


def test_two_body_truth_alone_is_a_row_of_the_report(report):
    rows = [row for row in report.consistency if row.one_sided]
    assert len(rows) == 4
    assert all(row.consistent and row.nees.mean < 6.3 for row in rows)


def test_json_has_the_contract(report):
    value = report.to_dict()
    keys = {"quantity", "method", "range_m", "published", "measured", "unit", "statistic", "expected", "met"}
    assert all(keys <= set(row) for row in value["rows"])
    assert {"model", "rows", "ok"} <= set(value)
    assert value["ok"] == report.ok


@pytest.mark.parametrize("way", [Way("fix"), Way("spots"), Way("fix", smooth=True), Way("spots", smooth=True)], ids=str)
def test_consistent_when_truth_is_as_assumed(model, way):
    """40 runs of 100 s here; `relnav accuracy` flies 200 of 250 s. Initial velocity is drawn from the prior."""
    approach = Approach(duration_s=100.0, assumed_noise=True, assumed_start=True)
    _, outcomes = run_campaign(model, approach, (way,), runs=40, seed=21)
    band = nees_band(outcomes[way].nees, 6)
    assert band.inside_95 >= 0.9
    assert band.outside_9999 == 0.0


def test_below_the_upper_bound_on_two_body_truth_alone(model):
    _, outcomes = run_campaign(model, Approach(duration_s=100.0), (Way("spots"), Way("fix")), runs=20, seed=5)
    for outcome in outcomes.values():
        band = nees_band(outcome.nees, 6)
        assert band.above_9999 == 0.0
        assert band.mean < 6.3


def test_same_seed_same_report(model, report):
    again = relnav.measure_accuracy(model, runs=8, seed=7)
    assert again.to_dict()["rows"] == report.to_dict()["rows"]


def test_too_few_runs(model):
    with pytest.raises(ValueError, match=r"runs is 2 or more.*; got 1"):
        relnav.measure_accuracy(model, runs=1)


def test_envelopes_cover_the_approach(report):
    range_m, error, sigma = report.envelopes["spots filter"]
    assert range_m.max() > 9.9
    assert range_m.min() < 4.1
    assert np.isfinite(error).all()
    assert np.isfinite(sigma).all()


def test_a_calibrated_model_is_judged_over_runs(model):
    """Its detector is distorted as its calibration says; what is left makes all epochs of a run one draw."""
    terms = tuple(1e-4 * np.array([0.1, 1.0, -0.5, 0.2, 0.3, -0.2]))
    left = Calibration(2, (0.0, 0.0), (3.46e-3, 3.46e-3), terms, terms[::-1], 2.4e-6, 0.0, 225, 1e-5)
    calibrated = relnav.measure_accuracy(dataclasses.replace(model, calibration=left), runs=3, seed=3)
    limit = 6.0 * chi_square_interval(18, 0.9999)[1]
    for row in calibrated.consistency:
        assert row.lasting
        assert row.as_expected
        if row.expected_consistent:
            assert 1.0 < row.nees.mean < limit
    row = calibrated.consistency[0]
    assert not dataclasses.replace(row, nees=dataclasses.replace(row.nees, mean=1.01 * limit)).consistent
    assert dataclasses.replace(row, nees=dataclasses.replace(row.nees, mean=0.99 * limit)).consistent
