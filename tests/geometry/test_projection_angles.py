"""Projection angles and gimbal angles: definitions, inverses, and how far they are apart."""

import numpy as np
import pytest

from relnav.geometry.projection_angles import (
    direction_from_angles,
    direction_from_gimbal,
    direction_from_tangents,
    direction_jacobian,
    gimbal_from_direction,
    tangents_from_direction,
)

GRID = np.radians(
    np.stack(np.meshgrid([-60.0, -20.0, 0.0, 5.0, 59.0], [-50.0, 0.0, 3.0, 60.0]), axis=-1).reshape(-1, 2)
)


def turn(axis, angle):
    """Plain rotation matrix about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out


def test_projection_angles_are_those_of_the_shadows():
    for alpha, beta in GRID:
        s = direction_from_angles(alpha, beta)
        assert np.arctan2(s[0], s[2]) == pytest.approx(alpha, abs=1e-15)
        assert np.arctan2(s[1], s[2]) == pytest.approx(beta, abs=1e-15)
        assert np.linalg.norm(s) == pytest.approx(1.0, abs=1e-15)


def test_gimbal_angles_are_two_rotations_of_the_boresight():
    """Outer axis x: the sun seen from the table is R_x(-outer) R_y(inner) z."""
    for outer, inner in GRID:
        np.testing.assert_allclose(
            direction_from_gimbal(outer, inner), turn(0, -outer) @ turn(1, inner) @ [0, 0, 1], atol=1e-15
        )
        np.testing.assert_allclose(
            direction_from_gimbal(outer, inner, "y"), turn(1, outer) @ turn(0, -inner) @ [0, 0, 1], atol=1e-15
        )


@pytest.mark.parametrize("axis", ["x", "y"])
def test_there_and_back(axis):
    s = direction_from_gimbal(*GRID.T, axis)
    np.testing.assert_allclose(np.array(gimbal_from_direction(s, axis)).T, GRID, atol=1e-14)
    np.testing.assert_allclose(direction_from_tangents(tangents_from_direction(s)), s, atol=1e-15)


@pytest.mark.parametrize(("degrees", "apart_deg"), [(5.0, 68.0 / 3600.0), (30.0, 3.69), (60.0, 13.9)])
def test_how_far_the_two_are_apart(degrees, apart_deg):
    angle = np.radians(degrees)
    alpha = np.arctan(tangents_from_direction(direction_from_gimbal(angle, angle))[0])
    assert np.degrees(alpha) - degrees == pytest.approx(apart_deg, rel=0.01)
    assert np.tan(alpha) == pytest.approx(np.tan(angle) / np.cos(angle), rel=1e-14)


def test_jacobian(truth):
    for t in np.tan(GRID):
        np.testing.assert_allclose(
            direction_jacobian(t), truth.derivative(direction_from_tangents, t, 1e-3), rtol=1e-8, atol=1e-10
        )


def test_behind_is_nan():
    assert np.isnan(tangents_from_direction([[0.6, 0.0, -0.8], [1.0, 0.0, 0.0]])).all()


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: tangents_from_direction([1.0, 2.0]), r"3 components .* got shape \(2,\)"),
        (lambda: direction_from_tangents([1.0, 2.0, 3.0]), r"2 components .* got shape \(3,\)"),
        (lambda: direction_from_angles(45.0, 0.0), "degrees where radians are expected"),
        (lambda: direction_from_gimbal(0.1, 0.1, "z"), "outer_axis must be"),
        (lambda: gimbal_from_direction([0.0, 0.0, 1.0], "z"), "outer_axis must be"),
    ],
)
def test_wrong_use(call, text):
    with pytest.raises(ValueError, match=text):
        call()
