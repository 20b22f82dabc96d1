"""The prepared sky: the nearest star against brute force, counts, and blends kept out of the pairs."""

import numpy as np
import pytest

from relnav.sensors.dual_field.catalogue import StarCatalogue
from relnav.sensors.dual_field.sky import build_sky, nearest_star, prepare_sky, sort_stars


@pytest.fixture(scope="module")
def sky(sensor):
    return sensor.sky()


def brute_force(sky, v, chord, magnitude, gate):
    stars = sky.arrays.stars
    distance = np.linalg.norm(stars[:, :3] - v, axis=1)
    distance[np.abs(stars[:, 3] - magnitude) > gate] = np.inf
    best = int(np.argmin(distance))
    return best if distance[best] < chord else -1


@pytest.mark.parametrize("chord", [1e-5, 1e-3, 3e-2])
def test_nearest_star(sky, chord):
    """Near stars, near edges of cells, anywhere: the poles and axes included."""
    rng = np.random.default_rng(1)
    stars = sky.arrays.stars[:, :3]
    near = stars[rng.integers(0, len(stars), 150)] + rng.normal(size=(150, 3)) * chord
    anywhere = np.concatenate([rng.normal(size=(150, 3)), np.eye(3), -np.eye(3), [[1, 1, 0], [0, 1, -1]]])
    found = 0
    for v in np.concatenate([near, anywhere]):
        v = v / np.linalg.norm(v)
        for gate in (np.inf, 0.5):
            expected = brute_force(sky, v, chord, 5.0, gate)
            got = nearest_star(sky.arrays.stars, sky.arrays.cells, *v, chord**2, 5.0, gate)
            assert got == expected
            found += got >= 0
    assert found > 80


def test_it_holds_the_stars_down_to_its_limit(sensor, sky):
    assert len(sky) == np.sum(sensor.catalogue.hp_mag <= 6.2)
    assert set(sky.hip) == set(sensor.catalogue.hip[sensor.catalogue.hp_mag <= 6.2])
    assert np.all(np.diff(sky.arrays.brighter) >= 0.0)
    assert sky.arrays.brighter[-1] == len(sky)
    assert sky.arrays.cells[-1] == len(sky)


def test_it_is_made_once_for_an_epoch(sensor):
    assert sensor.sky(2026.0) is sensor.sky()
    assert sensor.sky(2030.0) is not sensor.sky()


def test_close_stars_make_no_pairs():
    """A double of equal stars has no centre of its own; a companion two magnitudes fainter does not matter."""
    close = 20.0 / 206265.0
    ra = np.array([0.0, close, 0.1, 0.1 + close, 0.2])
    v = np.column_stack([np.cos(ra), np.sin(ra), np.zeros(5)])
    stars = sort_stars(v, np.array([3.0, 3.5, 3.0, 5.5, 3.0]), np.arange(1, 6, dtype=np.int32))
    sky = build_sky(stars, pair_count=5, low_rad=0.05, high_rad=0.5)
    paired = {int(sky.hip[star]) for star in sky.pairs.stars.ravel()}
    assert paired == {3, 5}


def test_apparent_places_are_taken_when_asked_for(sensor):
    catalogue: StarCatalogue = sensor.catalogue
    rest = prepare_sky(catalogue, 2026.0, 3.0, 3.0, 0.01, 0.2)
    moving = prepare_sky(catalogue, 2026.0, 3.0, 3.0, 0.01, 0.2, (30.0, 0.0, 0.0))
    shift = np.linalg.norm(
        moving.arrays.stars[np.argsort(moving.hip), :3] - rest.arrays.stars[np.argsort(rest.hip), :3], axis=1
    )
    assert 0.9 * 1e-4 < shift.max() < 1.01e-4
