"""Which pairs of spots come first where brightness is not known: near ones, as few stars stand so close."""

import math

import numpy as np
import pytest

from relnav.sensors.dual_field.identify import make_frame
from relnav.sensors.dual_field.matching import loose_chord2
from relnav.sensors.dual_field.optics import rays
from relnav.sensors.dual_field.search import nearest_asked, next_farther
from relnav.sensors.dual_field.sky import NEAR

SPOTS, FIRST = 14, 8


def field(sigma_rad):
    points = np.random.default_rng(6).uniform(-0.12, 0.12, (SPOTS, 2))
    return make_frame(rays(points), np.full(SPOTS, sigma_rad), None, math.inf, None, None)


def test_pairs_of_the_first_spots_come_once_and_the_nearest_first():
    W = field(1e-5).W
    found, cosine = [], math.cos(0.05)
    while cosine > -1.5:
        i, j, cosine = next_farther(W, FIRST, cosine)
        found.append((i, j, cosine))
    cosines = {(i, j): float(W[i] @ W[j]) for j in range(FIRST) for i in range(j)}
    expected = sorted((pair for pair in cosines if cosines[pair] < math.cos(0.05)), key=cosines.__getitem__)[::-1]
    assert [(i, j) for i, j, _ in found[:-1]] == expected
    assert found[-1] == (0, 0, -2.0)
    assert 10 < len(expected) < len(cosines)


@pytest.mark.parametrize("sigma_rad", [1e-5, 7e-5])
def test_the_nearest_pair_predicts_every_spot_by_a_look(sigma_rad):
    """A pair about the middle of all spots, as wide as is said, has the tolerance of the table at the farthest spot."""
    frame = field(sigma_rad)
    half = 0.5 * math.acos(nearest_asked(frame))
    middle = frame.W.sum(axis=0) / np.linalg.norm(frame.W.sum(axis=0))
    total = 2.0 * math.cos(half) * middle
    loosest = max(loose_chord2(frame.W, k, sigma_rad**2, *total) for k in range(SPOTS))
    assert loosest == pytest.approx(NEAR**2, rel=0.02)


def test_noise_beyond_the_table_leaves_no_pair_to_be_first():
    assert nearest_asked(field(0.5 * NEAR)) == -2.0
