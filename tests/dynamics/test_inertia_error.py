"""What an error of the inertia does, against differences of Euler's equations written here once more."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.dynamics.inertia_error import INERTIA_ENTRIES, inertia_effect_into, second_order_square
from relnav.dynamics.rigid_body import TORQUE, RigidBody

N = 1.1e-2
INERTIA = np.array([[3000.0, 120.0, -80.0], [120.0, 4200.0, 60.0], [-80.0, 60.0, 4700.0]])
RATE, TAU = np.array([0.02, -0.01, 0.03]), np.array([0.3, -0.2, 0.1])


def acceleration(dcm, inertia, tau):
    nadir = dcm.T @ [0.0, 0.0, 1.0]
    torque = 3.0 * N**2 * np.cross(nadir, inertia @ nadir) - np.cross(RATE, inertia @ RATE) + tau
    return np.linalg.solve(inertia, torque)


def effect(dcm, sigma, tau):
    body, out = RigidBody(INERTIA, N), np.empty((3, 6))
    body.matrix[TORQUE] = tau
    inertia_effect_into(body.matrix, sigma, dcm, RATE, out)
    return out


def test_by_differences():
    rng = np.random.default_rng(1)
    dcm, sigma = Rotation.random(rng=rng).as_matrix(), rng.uniform(10.0, 200.0, (3, 3))
    sigma = 0.5 * (sigma + sigma.T)
    found = effect(dcm, sigma, TAU)
    for k, (a, b) in enumerate(INERTIA_ENTRIES):
        step = np.zeros((3, 3))
        step[a, b] = step[b, a] = 1e-4 * sigma[a, b]
        expected = (acceleration(dcm, INERTIA + step, TAU) - acceleration(dcm, INERTIA - step, TAU)) / 2e-4
        np.testing.assert_allclose(found[:, k], expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_the_size_alone_does_nothing_without_a_torque():
    dcm = Rotation.random(rng=np.random.default_rng(2)).as_matrix()
    found = effect(dcm, INERTIA, np.zeros(3))  # one sigma of every entry is the entry
    assert np.abs(found).max() > 1e-5
    np.testing.assert_allclose(found.sum(axis=1), 0.0, atol=1e-12)


def test_the_second_order_by_random_inertias():
    """What an inertia drawn from its sigmas does beyond the first order: 20,000 draws, 4.5 % is three sigma."""
    rng = np.random.default_rng(3)
    dcm, sigma = Rotation.random(rng=rng).as_matrix(), rng.uniform(2.0, 20.0, (3, 3))
    sigma, body = 0.5 * (sigma + sigma.T), RigidBody(INERTIA, N)
    body.matrix[TORQUE] = TAU
    first, squares = effect(dcm, sigma, TAU), []
    for x in rng.normal(size=(20000, 6)):
        off = np.zeros((3, 3))
        for (a, b), each in zip(INERTIA_ENTRIES, x, strict=True):
            off[a, b] = off[b, a] = each * sigma[a, b]
        rest = acceleration(dcm, INERTIA + off, TAU) - acceleration(dcm, INERTIA, TAU) - first @ x
        squares.append(rest @ rest / 3.0)
    assert second_order_square(body.matrix, sigma, first) == pytest.approx(np.mean(squares), rel=0.045)


def test_the_second_order_grows_with_the_fourth_power_of_sigma():
    dcm, body = Rotation.random(rng=np.random.default_rng(4)).as_matrix(), RigidBody(INERTIA, N)
    sigma = 0.01 * np.abs(INERTIA)
    once, twice = (second_order_square(body.matrix, s, effect(dcm, s, np.zeros(3))) for s in (sigma, 2.0 * sigma))
    assert twice == pytest.approx(16.0 * once, rel=1e-9)
