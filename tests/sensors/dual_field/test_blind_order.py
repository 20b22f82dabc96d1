"""In which order pairs of spots are tried, and that none is tried twice."""

import math

import numpy as np

from relnav.sensors.dual_field.blind_order import (
    CLOSEST,
    FAR,
    FAR_SPOTS,
    FEW_FAR_SPOTS,
    NEAR,
    PAIR_SPOTS,
    WIDE,
    Way,
    edge,
    half_orders,
    new_pairs,
    pair_order,
)
from relnav.sensors.dual_field.screening import FEW_SPOTS


def field(spots, radius):
    points = np.random.default_rng(4).uniform(-1.0, 1.0, (spots, 2))
    return points * radius / edge(points)


def test_near_pairs_come_first():
    points = field(20, 0.1)
    for farthest in (NEAR, FAR):
        apart = [math.dist(points[i], points[j]) / edge(points) for i, j in pair_order(points, farthest)]
        assert apart == sorted(apart)
        assert apart[0] > CLOSEST
        assert apart[-1] < farthest
        assert apart[-1] > 0.9 * farthest


def test_far_pairs_are_of_fewer_spots():
    for radius, most in ((0.1, FEW_FAR_SPOTS), (1.1 * WIDE, FAR_SPOTS)):
        points = field(20, radius)
        near, far = pair_order(points, NEAR), pair_order(points, FAR)
        assert set(near) < set(far)
        assert max(j for _, j in near) == PAIR_SPOTS - 1
        assert max(j for _, j in set(far) - set(near)) == most - 1


def names(points, ways):
    """Pairs of spots by their places in the frame, of each way."""
    found = new_pairs(points, ways)
    return [[frozenset(way.order[[i, j]].tolist()) for i, j in pairs] for way, pairs in zip(ways, found, strict=True)]


def test_nothing_is_tried_twice():
    points = field(FEW_SPOTS, 0.1)
    ways = [Way(order, 0.01, 12.0, FAR) for order in (np.arange(FEW_SPOTS), *half_orders(points))]
    found = [pair for way in names(points, ways) for pair in way]
    assert len(found) == len(set(found))
    assert set(found) > set(names(points, ways[:1])[0])


def test_another_tolerance_or_another_sky_is_another_try():
    points, given = field(FEW_SPOTS, 0.1), np.arange(FEW_SPOTS)
    first, *others = names(points, [Way(given, shear, sky, FAR) for shear, sky in ((1, 12), (2, 12), (1, 25))])
    assert others == [first, first]


def test_in_a_wide_field_a_pair_has_another_chance():
    """Where it is checked against other spots than before: of 28 the 24 brightest are, in another order others."""
    for radius, spots, again in ((0.9 * WIDE, 28, False), (1.1 * WIDE, 28, True), (1.1 * WIDE, 20, False)):
        points = field(spots, radius)
        ways = [Way(order, 0.01, 12.0, FAR) for order in (np.arange(spots), half_orders(points)[0])]
        first, second = names(points, ways)
        assert bool(set(first) & set(second)) == again


def test_against_other_spots_a_pair_is_tried_again():
    """Half of the field has most of a hundred spots that the brightest of all are not among."""
    points = field(100, 0.1)
    ways = [Way(order, 0.01, 12.0, FAR) for order in (np.arange(100), half_orders(points)[0])]
    first, second = names(points, ways)
    assert set(first) & set(second)
