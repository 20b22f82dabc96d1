"""`relnav accuracy aps_sun` comes out as expected, and the bars beyond the patent hold in a tenth of their size."""

from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.accuracy import aps_sun
from relnav.accuracy import aps_sun_bars as bars
from relnav.accuracy.published import Published


@pytest.fixture(scope="module")
def report():
    return relnav.measure_accuracy("aps_sun", runs=2, seed=3)


@pytest.fixture(scope="module")
def thin():
    return bars.thin_glass(relnav.load_model("aps_sun"))


def figure(report, quantity, method):
    (row,) = [row for row in report.rows if (row.quantity, row.method) == (quantity, method)]
    return row


def test_every_row_is_as_expected(report):
    assert report.ok
    assert len(report.rows) >= 12
    assert any(not row.met for row in report.rows)


def test_the_patents_figures(report):
    assert figure(report, "error before compensation", "plain hole, optical h").measured > 5.0
    assert figure(report, "error after stage one", "patent, optical h").measured < 0.5
    assert figure(report, "error after stage two", "patent, optical h").measured < 0.03
    assert figure(report, "error after stage two", "patent, mechanical h").measured > 0.1
    assert figure(report, "error after stage two, figures", "spots of 0.005 px, patent").met


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(aps_sun, "TEST_POINTS", 300)
    monkeypatch.setattr(aps_sun, "TEST_IMAGES", 5)


def test_the_same_seed_gives_the_same_report(report):
    assert relnav.measure_accuracy("aps_sun", runs=2, seed=3).to_dict() == report.to_dict()


@pytest.mark.usefixtures("small")
def test_another_claim_would_be_unexpected():
    """A claim of 0.001 deg is not met, and nobody said so."""
    claims = relnav.load_published("aps_sun").claims
    claim = replace(claims[2], value=0.001)
    wrong = aps_sun.measure(relnav.load_model("aps_sun"), Published((claim,), ()), runs=2, seed=3)
    assert not wrong.ok


def test_few_points_are_as_good(thin):
    """49 points within 2 %, 25 within 5 % of the patent's 14641 (mean of 20 in the script, of 4 here: twice that)."""
    rng = np.random.default_rng(1)
    for side, bar in ((7, 1.04), (5, 1.10)):
        patent, rays = bars.few_points(thin, side, 4, 2000, rng)
        assert rays < bar * patent
        assert patent < 0.0215


def test_with_little_noise_it_is_several_times_better(thin):
    patent, ours = bars.quiet_spots(thin, 0.001, 25, 2000, np.random.default_rng(2))
    assert ours <= 0.001
    assert patent > 4.0 * ours


def test_from_image_to_direction(thin):
    assert bars.from_images(thin, 7, 60, np.random.default_rng(3)) <= 0.006


def test_no_jumps(thin):
    patent, ours = bars.largest_jumps_deg(thin, np.random.default_rng(4))
    assert patent > 0.01
    assert ours < 1e-8


def test_a_figure_error_that_no_model_contains(thin):
    """0.02 deg rms, correlated over 12 deg: from 625 points better than the patent's 14641, and honest about it."""
    out = bars.figure_error(thin, 0.02, 25, 1500, np.random.default_rng(5))
    assert out.method == "rays and spline"
    assert out.ours_deg < out.patent_deg
    assert 1.3 < out.nees < 2.2


def test_the_figure_errors_are_what_they_say():
    rng = np.random.default_rng(6)
    points = rng.uniform(-1.0, 1.0, (4000, 2))
    fields = [bars.smooth_field(0.01, rng) for _ in range(20)]
    values = np.array([field(points) for field in fields])
    assert np.sqrt(np.mean(values**2)) == pytest.approx(0.01, rel=0.1)
    near = np.array([field(points + np.array([np.radians(12.0), 0.0])) for field in fields])
    assert np.mean(values * near) / np.mean(values**2) == pytest.approx(np.exp(-0.5), abs=0.12)
