"""Frames of one camera share a sky, and what a frame gives does not depend on those before it."""

import numpy as np
import pytest

import relnav
from relnav.accuracy.dual_field_blind import EPOCH_JYEAR
from relnav.sensors.dual_field.blind import SKY_STEP, Blind, rounded_up, sky_for, solve_blind
from relnav.sensors.dual_field.optics import project
from relnav.sensors.dual_field.sky import prepare_sky
from relnav.simulation.star_field import random_attitude

FOCAL_PX, HALF_PX = 2000.0, 512.0


@pytest.fixture(scope="module")
def catalogue():
    return relnav.load_model("ground_camera").catalogue


def frame(catalogue, seed):
    """The forty brightest stars of a field 29 deg wide."""
    rng = np.random.default_rng(seed)
    spots = project(catalogue.directions(EPOCH_JYEAR) @ random_attitude(rng).T, FOCAL_PX)
    inside = np.flatnonzero(np.all(np.abs(spots) < HALF_PX, axis=1))[:40]
    return Blind(spots[inside] + rng.normal(size=(len(inside), 2)) * 0.1, catalogue.hp_mag[inside], FOCAL_PX)


def test_a_size_is_rounded_up_by_less_than_a_step():
    for value in np.geomspace(1e-3, 1e6, 50):
        assert 1.0 - 1e-12 <= rounded_up(value) / value < SKY_STEP


def test_fields_a_little_different_share_a_sky(catalogue):
    square = np.array([[-1.0, -1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, 1.0]])
    skies = {id(sky_for(catalogue, EPOCH_JYEAR, size * square, None)) for size in np.linspace(0.2, 0.22, 20)}
    assert len(skies) <= 4  # size, depth of stars and depth of pairs each take one step at most


def test_a_log_makes_few_skies_and_its_order_changes_nothing(catalogue):
    frames = [frame(catalogue, seed) for seed in range(6)]
    prepare_sky.cache_clear()
    forth = [solve_blind(blind, catalogue, EPOCH_JYEAR) for blind in frames]
    assert prepare_sky.cache_info().misses <= 4
    prepare_sky.cache_clear()
    back = [solve_blind(blind, catalogue, EPOCH_JYEAR) for blind in frames[::-1]][::-1]
    for one, other in zip(forth, back, strict=True):
        assert one.ok
        assert np.array_equal(one.dcm_cam_from_icrs, other.dcm_cam_from_icrs)
        assert (one.tried, one.log10_false_alarm) == (other.tried, other.log10_false_alarm)
