"""Rendered blobs: where they are put, as bright as asked, as noisy as the imager, and never beyond full."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.simulation.marker_images import marker_image


@pytest.fixture(scope="module")
def imager():
    return relnav.load_model("three_marker_vision").imager


def test_mean_image(imager):
    """Average of many: flux and centre of mass of the blob, to what noise leaves."""
    rng = np.random.default_rng(1)
    total = sum(marker_image(np.array([[12.3, 8.6]]), np.array([2000.0]), imager, (25, 20), rng) for _ in range(300))
    blob = total / 300.0 - 20.0
    assert blob.shape == (20, 25)
    assert blob.sum() == pytest.approx(2000.0, abs=30.0)
    y, x = np.mgrid[:20, :25]
    assert (blob * x).sum() / blob.sum() == pytest.approx(12.3, abs=0.1)
    assert (blob * y).sum() / blob.sum() == pytest.approx(8.6, abs=0.1)


def test_noise(imager):
    """Background of 20 dn: read noise 2 dn, shot noise sqrt(20 / 2.5) dn, quantisation."""
    picture = marker_image(np.empty((0, 2)), np.empty(0), imager, (300, 300), np.random.default_rng(2))
    assert picture.var() == pytest.approx(2.0**2 + 20.0 / 2.5 + 1.0 / 12.0, rel=0.03)
    np.testing.assert_array_equal(picture, np.round(picture))


def test_full_pixels(imager):
    picture = marker_image(np.array([[10.0, 10.0]]), np.array([1e6]), imager, (21, 21), np.random.default_rng(3))
    assert picture.max() == imager.saturation_dn
    assert picture.min() >= 0.0


def test_what_is_not_seen_is_not_drawn(imager):
    quiet = dataclasses.replace(imager, read_noise_dn=1e-9, electrons_per_dn=1e12)
    spots = np.array([[np.nan, np.nan], [-50.0, 10.0]])
    picture = marker_image(spots, np.full(2, 5000.0), quiet, (21, 21), np.random.default_rng(4))
    np.testing.assert_array_equal(picture, 20.0)
