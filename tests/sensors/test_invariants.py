"""The attitude-free numbers of three rays: invariant, with the gradients they claim; and the 3 x 3 solver."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from relnav.sensors.three_beacon.invariants import (
    invariant_gradients,
    invariants,
    position_gradient,
    rays_from_position,
    spot_gradient,
)

POSE = {"range_m": st.floats(0.8, 20.0), "azimuth": st.floats(-1.0, 1.0), "elevation": st.floats(-1.0, 1.0)}


def numbers(u: np.ndarray) -> np.ndarray:
    """g1, g2, g3 by their definition, with numpy's own products."""
    d = u[0] - u[1]
    return np.array([d @ d, u[2] @ d, np.linalg.det(u)])


def rays_to_beacons(truth, p: np.ndarray) -> np.ndarray:
    v = truth.beacons - p
    return v / np.linalg.norm(v, axis=1, keepdims=True)


@settings(derandomize=True, max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), **POSE)
def test_a_turn_of_the_camera_changes_nothing(truth, seed, range_m, azimuth, elevation) -> None:
    u = rays_to_beacons(truth, truth.position(range_m, azimuth, elevation))
    turned = np.ascontiguousarray(u @ Rotation.random(rng=np.random.default_rng(seed)).as_matrix().T)
    got, after = np.empty(3), np.empty(3)
    invariants(u, got)
    invariants(turned, after)
    np.testing.assert_allclose(got, numbers(u), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(after, got, rtol=0.0, atol=3e-15)


@settings(derandomize=True, max_examples=30, deadline=None)
@given(**POSE)
def test_rays_from_position(truth, range_m, azimuth, elevation) -> None:
    p = truth.position(range_m, azimuth, elevation)
    u, distance = np.zeros((3, 3)), np.zeros(3)
    rays_from_position(p, truth.a, truth.b, u, distance)
    np.testing.assert_allclose(u, rays_to_beacons(truth, p), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(distance, np.linalg.norm(truth.beacons - p, axis=1), rtol=1e-15)


@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize("beacon", [0, 1, 2])
def test_invariant_gradient(truth, number: int, beacon: int) -> None:
    """The numbers as functions of nine free components."""
    u = np.random.default_rng(2).normal(size=(3, 3))

    def changed(row: np.ndarray) -> np.ndarray:
        v = u.copy()
        v[beacon] = row
        return numbers(v)[number : number + 1]

    got = np.empty((9, 3))
    invariant_gradients(u, got)
    np.testing.assert_allclose(
        got[3 * number + beacon], truth.derivative(changed, u[beacon], 1e-2)[0], rtol=0.0, atol=1e-10
    )


@settings(derandomize=True, max_examples=50, deadline=None)
@given(**POSE)
def test_position_gradient(truth, range_m, azimuth, elevation) -> None:
    p = truth.position(range_m, azimuth, elevation)
    nearest = float(np.linalg.norm(truth.beacons - p, axis=1).min())
    u = rays_to_beacons(truth, p)
    got = np.zeros((3, 3))
    position_gradient(u, np.linalg.norm(truth.beacons - p, axis=1), got)
    expected = truth.derivative(lambda q: numbers(rays_to_beacons(truth, q)), p, 1e-2 * nearest)
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


@settings(derandomize=True, max_examples=50, deadline=None)
@given(roll=st.floats(-math.pi, math.pi), **POSE)
def test_spot_gradient(truth, roll, range_m, azimuth, elevation) -> None:
    p = truth.position(range_m + 1.0, azimuth, elevation)
    spots = truth.central(p, truth.look_at(p, roll, (0.1, -0.05)))

    def of_spots(s: np.ndarray) -> np.ndarray:
        v = np.column_stack([s.reshape(3, 2), np.full(3, truth.f)])
        return numbers(v / np.linalg.norm(v, axis=1, keepdims=True))

    v = np.column_stack([spots, np.full(3, truth.f)])
    got = np.zeros((3, 6))
    spot_gradient(v / np.linalg.norm(v, axis=1, keepdims=True), truth.f, got)
    expected = truth.derivative(of_spots, spots, 1e-4)
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())


def test_on_the_axis_each_number_has_an_axis_of_its_own(truth) -> None:
    """What makes the fix regular where the printed formulas are 0/0: range, azimuth, elevation in turn."""
    u = rays_to_beacons(truth, np.array([6.5, 0.0, 0.0]))
    got = np.zeros((3, 3))
    position_gradient(u, np.linalg.norm(truth.beacons - [6.5, 0.0, 0.0], axis=1), got)
    off = got - np.diag(np.diag(got))
    np.testing.assert_allclose(off, 0.0, atol=1e-17)
    assert (np.abs(np.diag(got)) > 1e-4).all()
