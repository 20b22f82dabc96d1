"""A block of star pairs against the plain way: the brightness of every pair, the distances of all stars."""

import math

import numpy as np
import pytest

from relnav.sensors.dual_field.pair_block import (
    BLOCK,
    LOOKED_UP,
    STRAIGHT,
    TRIED,
    TURNED,
    ask,
    collect,
    look_up,
    new_work,
    write_frames,
)
from relnav.sensors.dual_field.sky import build_sky, prepare_stars
from relnav.sensors.dual_field.spot_template import (
    ACROSS,
    ALONG,
    APART,
    LOOSE2,
    Spots,
    frame_of_pair,
    nearest_first,
    write_template,
)
from relnav.sensors.dual_field.star_levels import levels_for

DEEPEST, DEPTH, LEVELS = 6.0, 5.5, (1e-3, 2e-3, 4e-3)
KNOWN, FAINTEST, CONTRAST, FAINTER = 3.0, 5.0, 0.8, 0.5


@pytest.fixture(scope="module")
def stars(sensor):
    return prepare_stars(sensor.catalogue, 2020.0, DEEPEST)


@pytest.fixture(scope="module")
def sky(stars):
    return build_sky(stars, pair_count=600, low_rad=0.03, high_rad=0.3)


@pytest.fixture(scope="module")
def spots(stars):
    points = np.random.default_rng(3).uniform(-0.2, 0.2, (20, 2))
    magnitude = np.zeros(20)
    magnitude[1] = FAINTER
    rest = (len(stars.arrays), DEPTH, KNOWN, FAINTEST, CONTRAST)
    return Spots(points, magnitude, 1e-8, np.array([0.03, 0.002]), 0.05, 5e-3, *rest)


def test_pairs_whose_brightness_fits_are_collected(sky, spots):
    """All of them once, over as many blocks as they take, each in the orders that fit."""
    first, second = (sky.arrays.stars[sky.pairs.stars[:, k], 3] for k in range(2))
    faintest = np.maximum(first, second)
    within = (faintest > KNOWN) & (faintest <= FAINTEST)
    straight = within & (abs(second - first - FAINTER) <= CONTRAST)
    turned = within & (abs(second - first + FAINTER) <= CONTRAST)
    work, pair, last, got = new_work(20), 40, len(sky.pairs) - 7, []
    while pair < last:
        pair, count = collect(spots, sky.arrays, FAINTER, pair, last, work)
        assert count == BLOCK or pair == last
        got += zip(work.pair[:count].tolist(), work.allowed[:count].tolist(), strict=True)
    assert pair == last
    bits = straight * STRAIGHT + turned * (STRAIGHT << TURNED)
    assert got == [(k, bits[k]) for k in range(40, last) if bits[k]]
    assert work.best[TRIED] == np.sum(straight[40:last]) + np.sum(turned[40:last])


def test_bits_that_are_left_have_a_star_behind_them(stars, sky, spots):
    """A bit stays set where a star bright enough is within the wider tolerance of where a spot should see one."""
    work, levels = new_work(20), levels_for(stars, LEVELS)
    nearest_first(spots.points, 0, 1, 0.0, work.order)
    frame_of_pair(spots, 0, 1, 1.0, work.own)
    write_template(spots, levels, 1.0, work.own, work.order, 0, LOOKED_UP, work.template)
    shown = stars.arrays[stars.arrays[:, 3] <= DEPTH, :3]
    set_by_bits = left = 0
    for block in range(8):
        work.pair[:], work.found[:], work.some[:] = np.arange(BLOCK) + block * BLOCK, 0, np.arange(BLOCK)
        write_frames(sky.arrays, work, BLOCK)
        for row in range(LOOKED_UP):
            ask(work.template, row, levels, work.frames, BLOCK, work.places, work.found)
        set_by_bits += sum(int(bits).bit_count() for bits in work.found)
        look_up(LOOKED_UP, BLOCK, spots, sky.arrays, levels, work)
        for k in range(BLOCK):
            bits = 0
            for row in range(LOOKED_UP):
                for way, sign in enumerate((1.0, -1.0)):
                    place = work.template[row, [ALONG, ACROSS, APART]] * (1.0, sign, sign)
                    apart2 = np.sum((shown - place @ work.frames[:, k].reshape(3, 3)) ** 2, axis=1)
                    bits |= int(apart2.min() < work.template[row, LOOSE2]) << (row + TURNED * way)
            assert work.found[k] == bits
            left += bits.bit_count()
    assert math.sqrt(work.template[:LOOKED_UP, LOOSE2].max()) < LEVELS[-1]
    assert 0 < left < 0.5 * set_by_bits
