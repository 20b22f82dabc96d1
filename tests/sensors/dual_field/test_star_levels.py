"""Where stars are near, at a look: against the distances of all of them."""

import numpy as np
import pytest

from relnav.sensors.dual_field.sky import cell_of, prepare_stars
from relnav.sensors.dual_field.star_levels import PADDED, levels_for, nearest_chord2, noted

REACHES = (2e-4, 1e-3, 4e-3)
DEEPEST = 7.0


@pytest.fixture(scope="module")
def stars(sensor):
    return prepare_stars(sensor.catalogue, 2020.0, DEEPEST)


def about(stars, reach, count, rng):
    """Directions (count, 3) within `reach` of some star."""
    v = stars.arrays[rng.integers(0, len(stars.arrays), count), :3]
    off = rng.normal(size=v.shape)
    off -= np.sum(off * v, axis=1, keepdims=True) * v
    off *= reach * np.sqrt(rng.random((count, 1))) / np.linalg.norm(off, axis=1, keepdims=True)
    return (v + off) / np.linalg.norm(v + off, axis=1, keepdims=True)


def test_no_star_within_a_tolerance_is_missed(stars):
    """Of directions that are a little longer or shorter than they should be as well; chance lets few others pass."""
    levels, rng = levels_for(stars, REACHES), np.random.default_rng(2)
    anywhere = rng.normal(size=(4000, 3))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    for level, reach in enumerate(REACHES):
        assert levels.reach[level] == reach
        near = about(stars, reach, 3000, rng) * (1.0 + rng.uniform(-0.2, 0.2, (3000, 1)) * reach)
        half, words = levels.half[level], levels.words[level]
        assert all(noted(words, cell_of(half, *v)) for v in near)
        by_chance = np.mean([noted(words, cell_of(half, *v)) for v in anywhere])
        assert by_chance < 0.01 + 25.0 * reach**2 * len(stars.arrays) / (4.0 * np.pi)
    assert all(noted(levels.words[-1], cell_of(0.0, *v)) for v in anywhere[:100])


def test_listed_stars_are_the_nearest(stars):
    levels, rng = levels_for(stars, REACHES), np.random.default_rng(3)
    depth = float(np.median(stars.magnitudes))
    shown = stars.arrays[stars.arrays[:, 3] <= depth, :3]
    for v in np.concatenate([about(stars, REACHES[-1], 400, rng), np.eye(3)]):
        nearest = float(np.min(np.sum((shown - v) ** 2, axis=1)))
        got = nearest_chord2(levels, stars.arrays, depth, *v)
        assert got == nearest if nearest <= REACHES[-1] ** 2 else got >= nearest


def test_they_are_made_once(stars):
    assert levels_for(stars, REACHES) is levels_for(stars, REACHES)
    assert np.all(levels_for(stars, REACHES).half == pytest.approx([0.5 / (PADDED * reach) for reach in REACHES]))
