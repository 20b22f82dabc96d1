"""What a pair is asked first, against the plain way: the attitude of the pair, each spot's direction, every star."""

import numpy as np
import pytest

from relnav.geometry.star_places import LIGHT_KM_S, aberration
from relnav.sensors.dual_field.identify import make_frame
from relnav.sensors.dual_field.matching import loose_chord2
from relnav.sensors.dual_field.screening import (
    QUESTIONS,
    attitude_of_triads,
    extent,
    prepare_questions,
    promising,
    spot_triad,
    star_triad,
)
from relnav.sensors.dual_field.sky import NEAR, none_near
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator, random_velocity


def test_no_star_is_missed_by_the_look_into_the_table(sensor):
    """Points up to `NEAR` from a star are never refused; of points anywhere 97 in 100 are, and those rightly."""
    sky, rng = sensor.sky().arrays, np.random.default_rng(1)
    stars = sky.stars[:, :3]
    off = rng.normal(size=stars.shape)
    near = stars + 0.999 * NEAR * rng.random((len(stars), 1)) * off / np.linalg.norm(off, axis=1, keepdims=True)
    assert not any(none_near(sky.near, *v, NEAR**2) for v in near)
    anywhere = rng.normal(size=(3000, 3))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    refused = np.array([none_near(sky.near, *v, NEAR**2) for v in anywhere])
    assert refused.mean() > 0.97
    assert np.linalg.norm(anywhere[refused][:, None] - stars[None, ::7], axis=2).min() > NEAR
    assert not any(none_near(sky.near, *v, 1.001 * NEAR**2) for v in anywhere[:50])


def plainly(frame, sky, spots, i, j, field, A):
    """Which of the spots fall on a star in the pair's field, and in either: spot -> two answers."""
    W, n = frame.W, len(frame.sigma2)
    m = W[field * n + i] + W[field * n + j]
    places, brightness = aberration(sky.stars[:, :3], frame.beta), sky.stars[:, 3]
    answers = {}
    for k in spots:
        found = []
        for f in (field, 1 - field)[: frame.fields]:
            t2 = loose_chord2(W, f * n + k, frame.sigma2[k], *m)
            close = np.sum((places - A.T @ W[f * n + k]) ** 2, axis=1) < t2
            found.append(bool(np.any(close & (np.abs(brightness - frame.magnitude[k]) <= frame.gate))))
        answers[k] = found[0], any(found)
    return answers


@pytest.mark.parametrize("faintest", [4.4, 5.75])
def test_promising_is_what_every_star_says(sensor, as_rays, faintest):
    """Pairs of one field, in both orders and both fields, where all spots are asked and where few are."""
    sky = sensor.sky()
    simulator = StarFieldSimulator(sensor, SkyConditions(faintest, false_spots=2))
    rng = np.random.default_rng(3)
    spots, stars, A = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    questions, work = np.empty((QUESTIONS, 5)), np.empty((4, 3))
    row = {int(h): k for k, h in enumerate(sky.hip)}
    said = []
    for _ in range(200):
        shown = simulator.frame(rng, velocity_km_s=random_velocity(rng))
        true = np.flatnonzero(shown.field == rng.integers(2))
        if len(shown.hip) < 4 or len(true) < 2:
            continue
        u, sigma = as_rays(shown, sensor)
        beta = shown.velocity_km_s
        frame = make_frame(u, sigma, shown.magnitude, 0.6, sensor.fold.matrix, beta)
        assert np.allclose(frame.beta, beta / LIGHT_KM_S)
        n = len(u)
        i, j = sorted(rng.choice(true, 2, replace=False))
        asked, ways, least = extent(n, 2, 2)
        everyone = [k % n for k in range(j + 1, j + n) if k % n != i][:asked]
        assert (ways == 2) == (n <= 6)
        assert star_triad(sky.arrays.stars, frame.beta, row[shown.hip[i]], row[shown.hip[j]], stars, work)
        for field in (0, 1):
            assert spot_triad(frame.W, field * n + i, field * n + j, spots, work)
            prepare_questions(frame, i, j, field, spots, asked, ways, questions)
            for sign in (1.0, -1.0):
                attitude_of_triads(spots, stars, sign, A)
                assert np.allclose(A @ A.T, np.eye(3), atol=1e-12)
                found = plainly(frame, sky.arrays, everyone, i, j, field, A)
                expected = sum(either if ways == 2 else own for own, either in found.values()) >= least
                got = promising(frame, sky.arrays, questions, asked, ways, least, stars, sign)
                assert got == expected
                said.append(got)
    assert 40 < sum(said) < len(said) - 40
