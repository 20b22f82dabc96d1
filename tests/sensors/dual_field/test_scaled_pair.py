"""A pair of spots tried at any scale, against the plain way: each attitude, each spot's direction, every star."""

import math

import numpy as np
import pytest

from relnav.sensors.dual_field.optics import rays
from relnav.sensors.dual_field.pair_block import (
    BEST_PAIR,
    CHANCE,
    SCALE,
    SIGN,
    TRIED,
    new_work,
)
from relnav.sensors.dual_field.scaled_pair import BESIDE, least_matches, try_pairs
from relnav.sensors.dual_field.search import CLUSTERING
from relnav.sensors.dual_field.sky import build_sky, cell_of, prepare_stars, sort_stars
from relnav.sensors.dual_field.spot_template import (
    ACROSS,
    ALONG,
    APART,
    LOG_TIGHT,
    LOOSE2,
    SPOT_NUMBERS,
    TIGHT2,
    Spots,
    frame_of_directions,
    frame_of_pair,
    nearest_first,
    scale_of_pair,
    write_chances,
    write_template,
)
from relnav.sensors.dual_field.star_levels import levels_for, noted
from relnav.simulation.star_field import random_attitude

DEPTH, PAIRS, RADIUS, SHEARS, RANGE = 5.5, 400, 0.2, (0.01, 0.002), 0.05
LEVELS = (1e-3, 2e-3, 4e-3)


@pytest.fixture(scope="module")
def stars(sensor):
    return prepare_stars(sensor.catalogue, 2020.0, DEPTH)


@pytest.fixture(scope="module")
def sky(stars):
    return build_sky(stars, pair_count=PAIRS, low_rad=0.03, high_rad=0.4)


def spots_of(points, sky, magnitude=None, contrast=math.inf):
    """What a search knows of points (m, 2)."""
    shown = np.zeros(len(points)) if magnitude is None else magnitude
    stars = CLUSTERING * len(sky)
    limits = (1e-4**2, np.array(SHEARS), RANGE, 5e-3, stars, DEPTH, -math.inf, DEPTH, contrast)
    return Spots(np.ascontiguousarray(points), shown, *limits)


def field(sky, rng, count, noise=1e-4, scale=1.0):
    """The brightest stars of some field on the plane z = 1, brightest first, drawn `scale` times as large; attitude."""
    inside, brightest_first = np.empty(0), np.argsort(sky.arrays.stars[:, 3])
    while len(inside) < count:
        A = random_attitude(rng)
        turned = sky.arrays.stars[:, :3] @ A.T
        inside = brightest_first[turned[brightest_first, 2] > math.cos(RADIUS)][:count]
    points = turned[inside, :2] / turned[inside, 2:] + noise * rng.normal(size=(len(inside), 2))
    return points * scale, inside, A


def test_scale_of_a_pair():
    points = np.array([[0.1, 0.02], [-0.2, 0.3]])
    u = rays(points * 1.04)
    assert abs(scale_of_pair(points, 0, 1, float(np.arccos(u[0] @ u[1]))) - 1.04) < 1e-5


def test_a_template_puts_spots_where_their_stars_are(sky, stars):
    """In the frame of the right two stars, whichever way round; of another scale by less than a tight tolerance."""
    points, inside, _ = field(sky, np.random.default_rng(1), 20, noise=0.0)
    spots, levels = spots_of(points, sky), levels_for(stars, LEVELS)
    own, axes = np.empty((6, 3)), np.empty((3, 3))
    order, template = np.empty(20, dtype=np.int64), np.empty((20, SPOT_NUMBERS))
    for scale, allowed in ((1.0, 1e-12), (1.005, SHEARS[1])):
        for i, j in ((0, 1), (7, 3)):
            nearest_first(points, i, j, 0.0, order)
            frame_of_pair(spots, i, j, scale, own)
            write_template(spots, levels, scale, own, order, 0, 18, template)
            v, w = (sky.arrays.stars[inside[k], :3] for k in (i, j))
            frame_of_directions(*v, *w, axes)
            middle = (v + w) / np.linalg.norm(v + w)
            for row in range(18):
                star = sky.arrays.stars[inside[order[row]], :3]
                place = template[row, [ALONG, ACROSS, APART]] @ axes
                assert np.linalg.norm(place - star) <= allowed * max(np.linalg.norm(star - middle), 1e-3)


def test_spots_near_the_pair_come_first():
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (12, 2))
    order = np.empty(12, dtype=np.int64)
    nearest_first(points, 4, 9, 0.0, order)
    apart = np.linalg.norm(points[order[:10]] - 0.5 * (points[4] + points[9]), axis=1)
    assert sorted({*order[:10].tolist(), 4, 9}) == list(range(12))
    assert np.all(np.diff(apart) >= 0.0)


def test_spots_beside_one_of_the_pair_come_last():
    """Under every attitude they fall on that one's star, and tell nothing."""
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (12, 2))
    points[0], points[11] = points[9] + (0.01, 0.0), points[4] - (0.0, 0.02)
    order = np.empty(12, dtype=np.int64)
    nearest_first(points, 4, 9, 0.03, order)
    middle = 0.5 * (points[4] + points[9])
    apart = np.linalg.norm(points[order[:8]] - middle, axis=1)
    assert {*order[8:10].tolist()} == {0, 11}
    assert np.all(np.diff(apart) >= 0.0)


def test_farther_than_that_no_bit_is_its_stars():
    """Of a sky of one star; closer to it most directions have theirs."""
    rng = np.random.default_rng(6)
    star = rng.normal(size=3)
    star /= np.linalg.norm(star)
    levels = levels_for(sort_stars(star[None], np.zeros(1), np.zeros(1, dtype=np.int32)), LEVELS)
    share = []
    for low, high in ((0.0, 1.0), (BESIDE, 2.0 * BESIDE)):
        off = np.cross(rng.normal(size=(2000, 3)), star)
        off *= LEVELS[0] * rng.uniform(low, high, (2000, 1)) / np.linalg.norm(off, axis=1, keepdims=True)
        share.append(np.mean([noted(levels.words[0], cell_of(levels.half[0], *v)) for v in star + off]))
    assert share[0] == 1.0
    assert share[1] < 0.01


@pytest.mark.parametrize("count", [9, 24])
def test_the_right_pair_of_stars_is_found(sky, stars, count):
    """Where all spots are asked and where few are, either way round, with the scale wrong by 3 %."""
    rng, levels, found = np.random.default_rng(3), levels_for(stars, LEVELS), 0
    for _ in range(12):
        scale = 1.0 + rng.uniform(-0.03, 0.03)
        points, inside, A = field(sky, rng, count, scale=scale)
        spots, work = spots_of(points, sky), new_work(len(points))
        work.best[TRIED] = 0.0
        table = np.array([[0, 1], [3, 1], [2, 0]])
        got, star = np.empty((3, 3)), np.empty(len(points), dtype=np.int64)
        number = try_pairs(spots, sky.arrays, levels, work, table, 0, math.log(1e-3), got, star)
        if number == len(table):
            continue
        i, j = table[number]
        pair = sky.pairs.stars[int(work.best[BEST_PAIR])]
        if {*pair.tolist()} == {inside[i], inside[j]}:
            found += 1
            assert (pair[0] == inside[i]) == (work.best[SIGN] > 0.0)
            assert work.best[SCALE] == pytest.approx(1.0 / scale, abs=5e-3)
            assert np.allclose(got @ got.T, np.eye(3), atol=1e-12)
            assert np.linalg.norm(got - A) < 0.02
            assert np.mean(star == inside) > 0.7
            assert work.best[CHANCE] < math.log(1e-3)
    assert found >= 9


def test_brightness_halves_what_is_tried(sky, stars):
    """Of a pair of spots of unlike brightness stars count one way round alone, and those of another step not at all."""
    rng, levels = np.random.default_rng(4), levels_for(stars, LEVELS)
    points, inside, _ = field(sky, rng, 20)
    tried = []
    for contrast in (math.inf, 0.5):
        magnitude = sky.arrays.stars[inside, 3] if contrast < math.inf else np.zeros(20)
        work, spots = new_work(20), spots_of(points, sky, magnitude, contrast)
        best = np.empty((3, 3)), np.empty(20, dtype=np.int64)
        assert try_pairs(spots, sky.arrays, levels, work, np.array([[0, 9]]), 0, -1e9, *best) == 1
        tried.append(work.best[TRIED])
    u = rays(points)
    angle = math.acos(u[0] @ u[9])
    cosines = sky.arrays.cosines
    within = (cosines >= math.cos(angle * (1.0 + RANGE))) & (cosines <= math.cos(angle * (1.0 - RANGE)))
    step = np.diff(sky.arrays.stars[sky.pairs.stars[within], 3], axis=1)[:, 0]
    fainter = sky.arrays.stars[inside[9], 3] - sky.arrays.stars[inside[0], 3]
    assert tried[0] == 2 * np.sum(within)
    assert tried[1] == np.sum(abs(step - fainter) <= 0.5) + np.sum(abs(step + fainter) <= 0.5)


def test_fewer_matches_than_needed_cannot_be_enough(sky, stars):
    """One match less, each as close as the tighter tolerance, is likelier by chance than what is asked for."""
    points, _, _ = field(sky, np.random.default_rng(5), 24)
    spots, levels, work = spots_of(points, sky), levels_for(stars, LEVELS), new_work(24)
    nearest_first(points, 0, 1, 0.0, work.order)
    frame_of_pair(spots, 0, 1, 1.0, work.own)
    write_template(spots, levels, 1.0, work.own, work.order, 0, 22, work.template)
    write_chances(spots, 22, work.template)
    assert np.all(work.template[:22, TIGHT2] < work.template[:22, LOOSE2])
    work.best[TRIED], work.best[CHANCE] = 1e5, math.log(1e-3)
    needed = least_matches(work.template, 22, work.best)
    surest = work.template[:22, LOG_TIGHT].min()
    chance = [math.log(1e5 * math.comb(22, count)) + count * surest for count in (needed - 1, needed)]
    assert 3 < needed < 10
    assert chance[1] < math.log(1e-3) <= chance[0]
