"""Range, azimuth and elevation, their Jacobians, and what happens at the poles.

Eq. (13) of Cai, Zhao, Sun, Qiao, Dai (1996),
"Determination of target relative position and range by PSD optical sensor system".
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relnav.geometry.spherical import (
    docking_difference,
    position_from_angles,
    position_from_angles_jacobian,
    range_azimuth_elevation,
    range_azimuth_elevation_jacobian,
)

RANGE = st.floats(0.3, 500.0)
AZIMUTH = st.floats(-3.1, 3.1)
ELEVATION = st.floats(-1.5, 1.5)


def rae(p: np.ndarray) -> np.ndarray:
    out = np.empty(3)
    range_azimuth_elevation(p, out)
    return out


@pytest.mark.parametrize(
    ("p", "expected_deg"),
    [
        ([2.0, 0.0, 0.0], (2.0, 0.0, 0.0)),
        ([1.0, 1.0, 0.0], (math.sqrt(2.0), 45.0, 0.0)),
        ([1.0, -1.0, 0.0], (math.sqrt(2.0), -45.0, 0.0)),
        ([1.0, 0.0, -1.0], (math.sqrt(2.0), 0.0, 45.0)),
        ([1.0, 0.0, 1.0], (math.sqrt(2.0), 0.0, -45.0)),
        ([-3.0, 0.0, 0.0], (3.0, 180.0, 0.0)),
        ([0.0, 0.0, -2.0], (2.0, 0.0, 90.0)),
    ],
)
def test_signs(p: list[float], expected_deg: tuple[float, float, float]) -> None:
    """Azimuth toward +y, elevation toward -z: not a textbook's."""
    got = rae(np.array(p))
    np.testing.assert_allclose([got[0], *np.degrees(got[1:])], expected_deg, atol=1e-13)


@settings(derandomize=True, max_examples=100, deadline=None)
@given(RANGE, AZIMUTH, ELEVATION)
def test_there_and_back(truth, r: float, azimuth: float, elevation: float) -> None:
    p = np.empty(3)
    position_from_angles(np.array([r, azimuth, elevation]), p)
    np.testing.assert_allclose(p, truth.position(r, azimuth, elevation), rtol=0.0, atol=1e-15 * r)
    np.testing.assert_allclose(rae(p), [r, azimuth, elevation], rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(rae(p), truth.angles(p), rtol=1e-12, atol=1e-14)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(RANGE, AZIMUTH, ELEVATION)
def test_both_jacobians(truth, r: float, azimuth: float, elevation: float) -> None:
    p = truth.position(r, azimuth, elevation)
    level = math.hypot(p[0], p[1])
    forward, backward = np.empty((3, 3)), np.empty((3, 3))
    assert range_azimuth_elevation_jacobian(p, forward)
    assert position_from_angles_jacobian(p, backward)
    # arctangents of the truth are taken about the point itself, so that no cut is near
    expected = truth.derivative(
        lambda q: np.array(
            [
                np.linalg.norm(q),
                np.angle(complex(q[0], q[1]) / complex(p[0], p[1])),
                -math.asin(q[2] / np.linalg.norm(q)),
            ]
        ),
        p,
        1e-3 * level,
    )
    np.testing.assert_allclose(forward, expected, rtol=0.0, atol=1e-8 / min(level, 1.0))
    expected = truth.derivative(lambda v: truth.position(*v), np.array([r, azimuth, elevation]), 1e-3)
    np.testing.assert_allclose(backward, expected, rtol=0.0, atol=1e-9 * max(r, 1.0))


def test_jacobians_at_the_poles_say_no() -> None:
    for p in ([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], [1e-14, 0.0, 1.0], [math.nan, 1.0, 1.0]):
        out = np.full((3, 3), 7.0)
        assert not range_azimuth_elevation_jacobian(np.array(p), out)
        assert not position_from_angles_jacobian(np.array(p), np.empty((3, 3)))


@settings(derandomize=True, max_examples=100, deadline=None)
@given(RANGE, AZIMUTH, ELEVATION, st.floats(-0.5, 0.5), st.floats(-0.3, 0.3))
def test_difference_of_two_places(truth, r: float, azimuth: float, elevation: float, turn: float, tilt: float) -> None:
    """The angles' own differences, the short way round; the same place gives zeros to the last bit."""
    other = (1.1 * r, azimuth + turn, max(-1.5, min(1.5, elevation + tilt)))
    p, q, out = truth.position(*other), truth.position(r, azimuth, elevation), np.empty(3)
    docking_difference(p, q, out)
    assert out[0] == pytest.approx(0.1 * r, rel=1e-12)
    assert out[1] == pytest.approx(turn, abs=1e-13)
    assert out[2] == pytest.approx(other[2] - elevation, abs=1e-13)
    docking_difference(p, p, out)
    np.testing.assert_array_equal(out, 0.0)
