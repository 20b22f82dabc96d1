"""Volumes of ellipsoids of errors, and what an update told, against numpy."""

import numpy as np
import pytest

from relnav.estimation.information import information_gained, squared_volume


def test_volumes_and_what_they_shrink_by():
    A = np.random.default_rng(5).normal(size=(7, 10))
    P = A @ A.T
    for at in (0, 2, 4):
        block = P[at : at + 3, at : at + 3]
        assert squared_volume(P, at) == pytest.approx(np.linalg.det(block), rel=1e-12)
    assert information_gained(8.0, 2.0) == pytest.approx(np.log(2.0), rel=1e-15)
    assert information_gained(1.0, 1.0) == 0.0
