"""The share of spots that are refused: its mean and variance against numpy, its limit against binomial tails."""

import numpy as np
import pytest
from scipy.stats import binom, norm

from relnav.estimation.monitors import WATCH
from relnav.estimation.refusals import (
    BAD_IMAGES,
    BAD_SPOTS,
    FEWEST,
    LATELY_S,
    LEAST,
    LIMIT2,
    count_refusals,
    forget_refusals,
)


@pytest.fixture
def watch():
    return np.zeros(1, WATCH)[0]


def weights_of(images, since):
    """Of each of so many images in the mean, the last one's last."""
    newest = [max(1.0 / n, min(since / (since + LATELY_S), 1.0 / FEWEST)) for n in range(1, images + 1)]
    return np.array([w * np.prod(1.0 - np.array(newest[k + 1 :])) for k, w in enumerate(newest)])


@pytest.mark.parametrize("since", [0.1, 1.0, 30.0])
@pytest.mark.parametrize("images", [1, 39, 40, 300])
def test_the_mean_and_its_variance_are_weighted_sums(watch, images, since):
    rng = np.random.default_rng(4)
    spots = rng.integers(1, 9, images).astype(float)
    share = rng.binomial(spots.astype(int), 0.3) / spots
    for one, many in zip(share, spots, strict=True):
        count_refusals(watch, since, one, many, BAD_SPOTS, True)
    weights = weights_of(images, since)
    assert watch["over"] == pytest.approx(weights @ (share - BAD_SPOTS), rel=1e-9)
    assert watch["over_noise"] == pytest.approx(weights**2 @ (BAD_SPOTS * (1 - BAD_SPOTS) / spots), rel=1e-9)
    assert watch["judged"] == images


@pytest.mark.parametrize(
    ("usual", "since", "counts"), [(0.5, 0.5, 1.0), (0.5, 0.4, 1.0), (0.5, 2.0, 0.25), (0.0, 2.0, 1.0)]
)
def test_after_a_gap_the_images_between_count_as_good(watch, usual, since, counts):
    watch["interval"] = usual
    count_refusals(watch, since, 0.8, 1.0, BAD_SPOTS, True)
    assert watch["over"] == pytest.approx(0.8 * counts - BAD_SPOTS, rel=1e-12)


def test_an_image_at_the_time_of_the_last_counts_for_nothing_but_the_first(watch):
    count_refusals(watch, 0.0, 0.8, 1.0, BAD_SPOTS, True)
    assert watch["over"] == pytest.approx(0.8 - BAD_SPOTS, rel=1e-12)


def test_images_without_a_spot_change_nothing(watch):
    for share in (1.0, 0.0, 1.0):
        count_refusals(watch, 0.1, share, 3.0, BAD_SPOTS, True)
    before = watch.copy()
    count_refusals(watch, 0.1, 1.0, 3.0, BAD_SPOTS, False)
    assert watch == before
    forget_refusals(watch)
    assert watch == np.zeros(1, WATCH)[0]


@pytest.mark.parametrize(("share", "first"), [(1.0, LEAST), (0.45, 12), (0.15, None), (0.0, None)])
def test_the_alarm_is_raised_beyond_five_sigma(watch, share, first):
    """Of n equal images off by d: n d^2 above 25 b (1 - b) / 3, so 11.8 at 0.3; ten at least; it is held for 3 s."""
    images = LIMIT2 * BAD_SPOTS * (1 - BAD_SPOTS) / 3.0 / 0.3**2
    assert images == pytest.approx(11.8, abs=0.01)
    raised = None
    for n in range(1, 40):
        count_refusals(watch, 0.1, share, 3.0, BAD_SPOTS, True)
        if raised is None and watch["refusing"] > 0.0:
            raised = n
    assert raised == first
    assert watch["refusing"] == (0.0 if first is None else 3.0)


@pytest.mark.parametrize(("bad", "spots", "share"), [(BAD_SPOTS, 3, 0.1), (BAD_IMAGES, 1, 1.0 - 0.9**3)])
@pytest.mark.parametrize("since", [0.1, 1.0])
def test_one_bad_spot_in_ten_is_far_from_the_limit(watch, bad, spots, share, since):
    """100,000 images, whose share must be as seldom above the limit as the binomial of as many images is; none is.

    The mean of n images with equal weights has the variance of the settled one where n is 1 over the sum of squares.
    """
    rng = np.random.default_rng(9)
    refused = rng.binomial(spots, share, 100_000) / spots
    over = 0
    for one in refused:
        count_refusals(watch, since, one, float(spots), bad, True)
        over += watch["refusing"] > 0.0
        watch["refusing"] = 0.0
    assert over == 0
    images = round(1.0 / (weights_of(2000, since) ** 2).sum())
    limit = bad + 5.0 * np.sqrt(bad * (1 - bad) / spots / images)
    assert binom.sf(np.floor(limit * spots * images), spots * images, share) < norm.sf(5.0)
