"""Centroids of rendered spots: near the bound, honest, and flagged where they cannot be trusted."""

from dataclasses import replace

import numpy as np
import pytest

from relnav.estimation.consistency import chi_square_interval
from relnav.sensors.measurement import Status
from relnav.sensors.spot_centroid import centroid, centroid_patent
from relnav.simulation.sun_spot import centroid_bound, read_out, render_spot


@pytest.fixture(scope="module")
def shots(model, unit):
    """shots(signal, angle, count) -> errors (n, 2), covariances, bounds, patent's errors, of noisy images."""

    def of(signal_e, angle_deg, count=100):
        image = replace(model.image, signal_e=signal_e)
        rng = np.random.default_rng(5)
        error, covariance, bound, patent = [], [], [], []
        for _ in range(count):
            s = unit(angle_deg + rng.uniform(-0.5, 0.5, (1, 2)))[0]
            window = render_spot(model, s, signal_e=signal_e)
            quiet = window.electrons
            place = np.array([quiet.sum(axis=0) @ np.arange(24), quiet.sum(axis=1) @ np.arange(24)]) / quiet.sum()
            counts = read_out(window, image, rng)
            spot = centroid(counts, image)
            assert spot.ok
            error.append(np.array([spot.x_px, spot.y_px]) - place)
            covariance.append(spot.covariance_px2)
            bound.append(centroid_bound(window, image))
            patent.append(np.array(centroid_patent(counts, 0.1 * counts.max())) - place)
        return tuple(np.array(part) for part in (error, covariance, bound, patent))

    return of


def rms(error):
    return np.sqrt(np.mean(error**2))


@pytest.mark.parametrize("angle", [0.0, 58.0])
@pytest.mark.parametrize(("signal", "over_bound"), [(2e4, 1.25), (1e5, 1.25), (5e5, 1.6)])
def test_near_the_bound_and_honest(shots, signal, angle, over_bound):
    """Within 25 % of the Cramer-Rao bound up to 1e5 electrons, 60 % at 5e5; mean NEES of 2 numbers below 2.5."""
    error, covariance, bound, _ = shots(signal, angle)
    least = np.sqrt(np.mean(np.trace(bound, axis1=1, axis2=2) / 2.0))
    assert rms(error) < over_bound * least
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    assert 1.0 < np.mean(nees) < 2.5


@pytest.mark.parametrize("signal", [2e4, 1e5, 5e5])
def test_a_sloping_background_is_in_the_covariance(model, signal):
    """2,000 electrons in the middle, a quarter less and more at the edges: NEES of 2 numbers over 200 exposures."""
    image, rng = replace(model.image, signal_e=signal), np.random.default_rng(8)
    spots = np.array([found_on_slope(image, model, rng) for _ in range(200)])
    error, covariance = spots[:, :2], spots[:, 2:6].reshape(-1, 2, 2)
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    lower, upper = chi_square_interval(2 * len(nees), 0.9999)
    assert lower < np.mean(nees) / 2.0 < upper
    assert np.mean(error, axis=0) == pytest.approx(0.0, abs=4.0 * np.sqrt(np.mean(covariance[:, 0, 0]) / 200.0))


def found_on_slope(image, model, rng):
    """Error (2,) and covariance (4,) of one exposure."""
    s = np.array([*np.sin(rng.uniform(-0.01, 0.01, 2)), 1.0])
    window = render_spot(model, s / np.linalg.norm(s), signal_e=image.signal_e)
    quiet, middle = window.electrons, 0.5 * (len(window.electrons) - 1)
    place = np.array([quiet.sum(axis=0) @ np.arange(24), quiet.sum(axis=1) @ np.arange(24)]) / quiet.sum()
    stray = 2000.0 * (1.0 + 0.25 * (np.arange(24) - middle) / middle)
    counts = read_out(replace(window, electrons=quiet + stray), image, rng)
    spot = centroid(counts, image)
    return [spot.x_px - place[0], spot.y_px - place[1], *spot.covariance_px2.ravel()]


def test_what_the_border_does_not_tell_of_the_slope(model, unit):
    """A stretched spot, once with the background known: the centres differ by what the covariances differ by."""
    image, rng, nees, runs = replace(model.image, signal_e=2e5, background_e=2000.0), np.random.default_rng(8), [], 400
    window = render_spot(model, unit(np.array([[45.0, 45.0]]))[0], signal_e=2e5)
    for _ in range(runs):
        counts = read_out(window, image, rng)
        fitted = centroid(counts, image)
        known = centroid(counts, image, background=2000.0 / image.electrons_per_count)
        off = [fitted.x_px - known.x_px, fitted.y_px - known.y_px]
        nees.append(off @ np.linalg.solve(fitted.covariance_px2 - known.covariance_px2, off))
    lower, upper = chi_square_interval(2 * runs, 0.9999)
    assert lower < np.mean(nees) / 2.0 < upper


def test_the_patents_sum_is_pulled_to_the_middle(shots):
    """Counts on an unsubtracted threshold of 10 %: three times the error at 5e5 electrons."""
    error, _, _, patent = shots(5e5, 0.0, 60)
    assert rms(patent) > 2.0 * rms(error)


def test_s_curve_without_noise(model, unit):
    """Over the place within a pixel: 0.008 px subtracted, more than twice that not subtracted."""
    worst = {"ours": 0.0, "patent": 0.0}
    image = replace(model.image, background_e=0.0, bits=16)
    for shift in np.linspace(0.0, 0.32, 9):  # deg: a pixel
        window = render_spot(model, unit([[shift, 0.5 * shift]])[0])
        quiet = window.electrons
        place = np.array([quiet.sum(axis=0) @ np.arange(24), quiet.sum(axis=1) @ np.arange(24)]) / quiet.sum()
        counts = quiet / image.electrons_per_count
        spot = centroid(counts, image, threshold=0.1)
        worst["ours"] = max(worst["ours"], np.abs([spot.x_px - place[0], spot.y_px - place[1]]).max())
        off = np.abs(np.array(centroid_patent(counts, 0.1 * counts.max())) - place).max()
        worst["patent"] = max(worst["patent"], off)
    assert worst["ours"] < 0.009
    assert worst["patent"] > 2.5 * worst["ours"]


@pytest.fixture(scope="module")
def counts(model):
    """A quiet spot of a 24 px window about its middle, counts."""
    window = render_spot(model, [0.0, 0.0, 1.0])
    return np.rint((window.electrons + model.image.background_e) / model.image.electrons_per_count)


def test_flags(model, counts):
    image = model.image
    assert centroid(counts, image).status is Status.OK
    assert centroid(np.full((24, 24), 3.0), image).status is Status.NOT_SEEN
    assert centroid(np.zeros((24, 24)), image).status is Status.NOT_SEEN
    noise = np.random.default_rng(0).normal(2.0, 0.8, (24, 24))
    assert centroid(noise, image).status is Status.NOT_SEEN
    assert centroid(np.minimum(counts * 6.0, image.full_scale), image).status is Status.SATURATED
    assert centroid(counts[:, 9:], image).status is Status.AT_EDGE
    assert centroid(counts[11:, :], image).status is Status.AT_EDGE
    for bad in (np.zeros((24, 24)), np.minimum(counts * 6.0, image.full_scale), counts[:, 9:]):
        spot = centroid(bad, image)
        assert not spot.ok
        assert np.isnan([spot.x_px, spot.y_px, spot.flux_e]).all()
        assert np.isnan(spot.covariance_px2).all()


def test_a_distant_glint_is_not_part_of_the_spot(model, counts):
    glint = counts.copy()
    glint[2, 2:4] = 0.3 * counts.max()
    clean, dirty = centroid(counts, model.image), centroid(glint, model.image)
    assert (dirty.x_px, dirty.y_px) == pytest.approx((clean.x_px, clean.y_px), abs=1e-9)
    assert abs(centroid_patent(glint)[0] - centroid_patent(counts)[0]) > 0.05


def test_background_does_not_matter(model, counts):
    """A window off the spot's middle on a stray-light pedestal: ours stays, the plain sum does not."""
    part = counts[:, :20]
    ours = [centroid(part + pedestal, model.image) for pedestal in (0.0, 100.0)]
    assert ours[1].x_px == pytest.approx(ours[0].x_px, abs=1e-9)
    assert ours[1].covariance_px2[0, 0] > ours[0].covariance_px2[0, 0]
    assert abs(centroid_patent(part + 100.0)[0] - centroid_patent(part)[0]) > 1.0
    stated = centroid(part + 100.0, model.image, background=100.0)
    assert stated.x_px == pytest.approx(ours[0].x_px, abs=1e-2)


def test_axes_are_columns_and_rows(model, counts):
    moved = np.roll(np.roll(counts, 3, axis=1), -2, axis=0)
    a, b = centroid(counts, model.image), centroid(moved, model.image)
    assert (b.x_px - a.x_px, b.y_px - a.y_px) == pytest.approx((3.0, -2.0), abs=1e-9)
    assert centroid_patent(moved, 50.0) == pytest.approx(
        (centroid_patent(counts, 50.0)[0] + 3.0, centroid_patent(counts, 50.0)[1] - 2.0)
    )


def test_flux_is_in_electrons(model, counts):
    assert centroid(counts, model.image).flux_e == pytest.approx(model.image.signal_e, rel=0.15)


def test_wrong_use(model, counts):
    for bad in (counts[0], counts[:3], np.full((24, 24), np.nan)):
        with pytest.raises(ValueError, match=r"two axes \(rows, columns\)"):
            centroid(bad, model.image)
        with pytest.raises(ValueError, match=r"two axes \(rows, columns\)"):
            centroid_patent(bad)
    with pytest.raises(ValueError, match=r"share of the peak between 0 and 0\.9"):
        centroid(counts, model.image, threshold=1.0)
    assert np.isnan(centroid_patent(np.zeros((5, 5)))).all()
