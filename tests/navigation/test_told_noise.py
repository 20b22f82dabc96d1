"""Noise told image by image: monitors weigh each image by its own, and find what is wrong all the same.

Truth is flown by a matrix exponential and seen by a camera that is written out in `conftest.py`; noise is drawn here.
"""

import numpy as np
import pytest

import relnav

SHIFTED = int(relnav.Alarm.SHIFTED)
T_S = 0.1 * np.arange(1500)
USUAL_M = 10e-6


def alternating(_rng):
    return np.where(np.arange(len(T_S)) % 2, USUAL_M, 3.0 * USUAL_M)[:, None]


def scattered(rng):
    """Each spot's own, log-normal."""
    return USUAL_M * np.exp(rng.normal(0.0, 0.7, (len(T_S), 3)))


def glaring(_rng):
    """Six times as much for 5 s of every minute."""
    return np.where(T_S % 60.0 < 5.0, 6.0 * USUAL_M, USUAL_M)[:, None]


def clearing(_rng):
    """Four times as much in the first minute."""
    return np.where(T_S < 60.0, 4.0 * USUAL_M, USUAL_M)[:, None]


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


@pytest.fixture(scope="module")
def flown(model, drift, look):
    """Spots without noise, 7 m away, moved by what the filter's process noise stands for."""
    density = model.process_noise.acceleration_noise_density_m2_s3
    pushes = np.random.default_rng(1).normal(0.0, np.sqrt(0.1 * density), (len(T_S), 3))
    truth = drift(model, T_S, [7.0, 0.05, -0.04, 0.0, 0.0, 0.0], impulse=pushes)
    return look(model, truth, noise_m=0.0)


def told(spots, of_image, seed):
    """Spots with noise, and its sigma, (n, 3, 2) each."""
    rng = np.random.default_rng(seed)
    sigma = np.broadcast_to(of_image(rng)[..., None], spots.shape)
    return spots + sigma * rng.normal(size=spots.shape), sigma


@pytest.mark.parametrize("method", ["fix", "spots"])
@pytest.mark.parametrize("of_image", [alternating, scattered, glaring, clearing])
def test_noise_that_is_told_is_no_alarm(model, flown, method, of_image):
    """One healthy flight in 200 may alarm: of six, any with a probability of 3 %."""
    for seed in range(6):
        spots, sigma = told(flown, of_image, seed)
        solution = relnav.filter_epochs(model, T_S, spots, method=method, spot_sigma_m=sigma)
        assert solution.restarts == 0
        assert not solution.alarm.any()


@pytest.mark.parametrize("method", ["fix", "spots"])
@pytest.mark.parametrize("of_image", [alternating, scattered, glaring])
def test_a_spot_that_shifts_among_them_is_told(model, flown, method, of_image):
    """Of beacon A, by 60 um from 70 s on: six sigmas of the better images."""
    spots, sigma = told(flown, of_image, 7)
    spots[T_S >= 70.0, 0, 0] += 6.0 * USUAL_M
    solution = relnav.filter_epochs(model, T_S, spots, method=method, spot_sigma_m=sigma)
    shifted = T_S[solution.alarm & SHIFTED > 0]
    assert 70.0 <= shifted[0] < 85.0
