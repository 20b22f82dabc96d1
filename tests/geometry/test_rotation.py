"""Quaternions against scipy's Rotation, and the triad against rotations that are known."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from relnav.geometry.rotation import dcm_from_quaternion, dcm_from_quaternion_into, is_rotation, triad

COMPONENT = st.floats(-1.0, 1.0)


@settings(derandomize=True, max_examples=100, deadline=None)
@given(st.lists(COMPONENT, min_size=4, max_size=4), st.floats(0.9991, 1.0009))
def test_against_scipy(values: list[float], norm: float) -> None:
    """Scalar last, Hamilton; a norm within 1e-3 of 1 is made 1."""
    q = np.array(values)
    assume(np.linalg.norm(q) > 0.1)
    q *= norm / np.linalg.norm(q)
    np.testing.assert_allclose(dcm_from_quaternion(q), Rotation.from_quat(q).as_matrix(), rtol=0.0, atol=1e-15 * 4)


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    """By hand: v_b = dcm v_a."""
    dcm = dcm_from_quaternion(np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]))
    np.testing.assert_allclose(dcm @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize(
    "quaternion",
    [
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.998],
        [0.0, 0.0, 0.0, 1.002],
        [1.0, 1.0, 0.0, 0.0],
        [np.nan, 0.0, 0.0, 1.0],
        [0.0, 0.0, 0.0, np.inf],
        [0.0, 0.0, 0.0, 1e100],
    ],
)
def test_a_norm_that_is_not_one(quaternion: list[float]) -> None:
    with pytest.raises(ValueError, match="has norm 1 within 1e-3; got"):
        dcm_from_quaternion(np.array(quaternion))
    assert not dcm_from_quaternion_into(np.array(quaternion), np.empty((3, 3)))


@pytest.mark.parametrize("shape", [(3,), (5,), (1, 4), (2, 4)])
def test_wrong_shape(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="four components"):
        dcm_from_quaternion(np.zeros(shape))


@settings(derandomize=True, max_examples=100, deadline=None)
@given(st.lists(st.floats(-1e3, 1e3), min_size=6, max_size=6), st.integers(0, 1000))
def test_two_triads_of_one_pair_give_the_rotation_between_the_frames(values: list[float], seed: int) -> None:
    one, two = np.array(values[:3]), np.array(values[3:])
    assume(np.linalg.norm(np.cross(one, two)) > 1e-2 * np.linalg.norm(one) * np.linalg.norm(two) > 1e-6)
    expected = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    in_a, in_b = np.empty((3, 3)), np.empty((3, 3))
    assert triad(one, two, in_a)
    assert triad(expected @ one, expected @ two, in_b)
    np.testing.assert_allclose(in_b.T @ in_a, expected, rtol=0.0, atol=1e-12)


def test_the_first_vector_is_kept_exactly_and_the_second_in_its_half_plane() -> None:
    out = np.empty((3, 3))
    assert triad(np.array([0.0, 0.0, 2.0]), np.array([0.0, 3.0, 7.0]), out)
    np.testing.assert_allclose(out, [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], atol=1e-16)
    assert np.linalg.det(out) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("one", "two"),
    [
        ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
        ([1.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
        ([1.0, 0.0, 0.0], [-2.0, 0.0, 0.0]),
        ([np.nan, 0.0, 0.0], [0.0, 1.0, 0.0]),
        ([1.0, 0.0, 0.0], [0.0, np.nan, 0.0]),
    ],
)
def test_no_triad_of_parallel_vectors(one: list[float], two: list[float]) -> None:
    assert not triad(np.array(one), np.array(two), np.empty((3, 3)))


@pytest.mark.parametrize("factor", [0.5, -3.0, 1e6])
def test_no_triad_of_vectors_parallel_to_rounding(factor: float) -> None:
    one = np.array([0.3, -0.7, 1.1])
    assert not triad(one, factor * one, np.empty((3, 3)))


def test_quaternion_from_dcm_is_scipys():
    from scipy.spatial.transform import Rotation

    from relnav.geometry.rotation import quaternion_from_dcm

    for rotation in [*Rotation.random(50, rng=1), Rotation.from_rotvec([np.pi, 0, 0]), Rotation.identity()]:
        expected = rotation.as_quat(canonical=True)
        got = quaternion_from_dcm(rotation.as_matrix())
        assert min(np.abs(got - expected).max(), np.abs(got + expected).max()) < 1e-12
        assert got[3] >= 0.0


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1.0, -1.0]), 2.0 * np.eye(3), np.eye(2)])
def test_quaternion_of_no_rotation(matrix):
    from relnav.geometry.rotation import quaternion_from_dcm

    with pytest.raises(ValueError, match="a rotation matrix"):
        quaternion_from_dcm(matrix)


def test_rotations_are_rotations_to_a_millionth():
    for rotation in Rotation.random(20, rng=2):
        dcm = rotation.as_matrix()
        assert is_rotation(dcm)
        assert is_rotation((1.0 + 0.4e-6) * dcm)  # dcm dcm^T is off by twice that
        assert not is_rotation((1.0 + 0.6e-6) * dcm)
        assert not is_rotation(-dcm)


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([1.0, 1.0, -1.0]),
        2.0 * np.eye(3),
        np.eye(2),
        np.eye(4),
        np.zeros((0, 3)),
        np.zeros((3, 3)),
        np.array([[1.0, 2e-6, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.full((3, 3), np.nan),
        np.diag([1.0, 1.0, np.inf]),
        np.diag([1.0, 1.0, 1e200]),
    ],
)
def test_what_is_no_rotation(matrix):
    assert not is_rotation(matrix)
