"""Every Jacobian of the three-beacon fix against central differences and against the inverse projection Jacobian."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relnav.sensors.three_beacon import measure
from relnav.sensors.three_beacon.fix import PARALLEL, PERSPECTIVE, WORK_ROWS, fix_jacobian
from relnav.sensors.three_beacon.perspective import position_jacobian

POSE = {
    "range_m": st.floats(2.8, 12.0),
    "azimuth": st.floats(-0.6, 0.6),
    "elevation": st.floats(-0.6, 0.6),
    "roll": st.floats(-math.pi, math.pi),
}
PLACES = [(6.5, 0.0, 0.0), (6.5, 10.0, 15.0), (3.75, -8.0, 5.0), (2.6, 20.0, -20.0), (0.8, 3.0, -4.0), (0.63, 0.0, 0.0)]


def rays(spots: np.ndarray, f: float) -> np.ndarray:
    v = np.column_stack([spots, np.full(3, f)])
    return np.ascontiguousarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def rae_jacobian(p: np.ndarray, spots: np.ndarray, truth, projection: int) -> np.ndarray:
    out = np.full((3, 6), np.nan)
    assert fix_jacobian(p, spots, truth.f, truth.a, truth.b, projection, out, np.zeros((WORK_ROWS, 6)))
    return out


def spots_of_pose(truth, p: np.ndarray, dcm: np.ndarray, small_turn: np.ndarray) -> np.ndarray:
    """Spots with the camera turned by a small rotation vector (Rodrigues), raveled."""
    angle = float(np.linalg.norm(small_turn))
    k = np.zeros((3, 3))
    if angle > 0.0:
        x, y, z = small_turn / angle
        k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return truth.central(p, (np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * k @ k) @ dcm).ravel()


def inverse_projection(truth, p: np.ndarray, dcm: np.ndarray) -> np.ndarray:
    """dp/dspots: upper half of the inverse of d(six spots)/d(position, attitude), by central differences."""
    pose = np.concatenate([p, np.zeros(3)])
    full = truth.derivative(lambda v: spots_of_pose(truth, v[:3], dcm, v[3:]), pose, 1e-3)
    return np.linalg.inv(full)[:3]


@pytest.mark.parametrize(("range_m", "azimuth_deg", "elevation_deg"), PLACES)
@pytest.mark.parametrize("roll", [0.0, 2.0])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.15, -0.1)])
def test_position_jacobian_is_the_inverse_of_the_projection(
    truth, range_m: float, azimuth_deg: float, elevation_deg: float, roll: float, tilt: tuple[float, float]
) -> None:
    p = truth.position(range_m, math.radians(azimuth_deg), math.radians(elevation_deg))
    dcm = truth.look_at(p, roll, tilt)
    expected = inverse_projection(truth, p, dcm)
    got = np.full((3, 6), np.nan)
    u = rays(truth.central(p, dcm), truth.f)
    assert position_jacobian(p, u, truth.f, truth.a, truth.b, got)
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=2e-7 * np.abs(expected).max())


@settings(derandomize=True, max_examples=60, deadline=None)
@given(**POSE)
def test_perspective_fix_jacobian(truth, wide_sensor, range_m, azimuth, elevation, roll) -> None:
    """Central differences of the solver itself; its exactness is the subject of another file."""
    p = truth.position(range_m, azimuth, elevation)
    if p[0] < 0.72 * range_m:  # nearly 45 deg: the steps must stay inside the domain
        return
    spots = truth.central(p, truth.look_at(p, roll))
    expected = truth.derivative(lambda s: measure(s, wide_sensor).value, spots, 2e-7)
    got = rae_jacobian(p, spots, truth, PERSPECTIVE)
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=2e-6 * np.abs(expected).max())


@settings(derandomize=True, max_examples=60, deadline=None)
@given(**POSE)
def test_parallel_fix_jacobian(truth, wide_sensor, range_m, azimuth, elevation, roll) -> None:
    """On a real lens's spots: the paper's formula has its own Jacobian there, whatever its bias."""
    p = truth.position(range_m, azimuth, elevation)
    spots = truth.central(p, truth.look_at(p, roll))
    fix = measure(spots, wide_sensor, projection="parallel")
    if not fix.ok or math.cos(fix.azimuth_rad) * math.cos(fix.elevation_rad) < 0.4:
        return
    expected = truth.derivative(lambda s: measure(s, wide_sensor, projection="parallel").value, spots, 2e-7)
    got = rae_jacobian(truth.position(*fix.value), spots, truth, PARALLEL)
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize("projection", ["perspective", "parallel"])
@pytest.mark.parametrize("range_m", [3.75, 6.5, 10.0])
def test_on_the_axis(truth, sensor, projection: str, range_m: float) -> None:
    """Where the printed square roots have singular derivatives."""
    p = np.array([range_m, 0.0, 0.0])
    make = truth.central if projection == "perspective" else lambda p, _dcm: truth.parallel(p)
    spots = make(p, truth.look_at(p)) * (1.0 - 1e-9)  # A and B stand on the rim at 3.75 m
    inner = spots * 0.99 if range_m == 3.75 else spots
    expected = truth.derivative(lambda s: measure(s, sensor, projection=projection).value, inner, 1e-6)
    at = truth.position(*measure(inner, sensor, projection=projection).value)
    got = rae_jacobian(at, inner, truth, PERSPECTIVE if projection == "perspective" else PARALLEL)
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())


def test_singular_geometry_says_no(truth) -> None:
    work = np.zeros((WORK_ROWS, 6))
    p = np.array([0.0, 0.0, -6.5])  # the pole, where azimuth is undefined
    spots = truth.central(np.array([0.1, 0.0, -6.5]), truth.look_at(np.array([0.1, 0.0, -6.5])))
    assert not fix_jacobian(p, spots, truth.f, truth.a, truth.b, PERSPECTIVE, np.zeros((3, 6)), work)
    coinciding = np.zeros((3, 2))
    assert not fix_jacobian(p, coinciding, truth.f, truth.a, truth.b, PARALLEL, np.zeros((3, 6)), work)
    behind = np.array([-6.5, 0.0, 0.0])  # on the far side of the same axis the geometry is as regular as in front
    assert fix_jacobian(behind, spots, truth.f, truth.a, truth.b, PERSPECTIVE, np.zeros((3, 6)), work)


def test_the_covariance_is_the_jacobian_s(truth, sensor) -> None:
    """sigma^2 J J^T with J from central differences of the projection, not of the product."""
    p = truth.position(6.5, math.radians(10.0), math.radians(-7.0))
    dcm = truth.look_at(p, 0.4)
    j = truth.derivative(truth.angles, p, 1e-3) @ inverse_projection(truth, p, dcm)
    expected = sensor.spot_noise_m**2 * j @ j.T
    got = measure(truth.central(p, dcm), sensor).covariance
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(got / scale, expected / scale, rtol=0.0, atol=1e-6)
    np.testing.assert_array_equal(got, got.T)


def test_the_jacobians_are_the_derived_ones(truth, derivatives) -> None:
    """Of both closed forms, on the axis and off it: to rounding, where differences end at 1e-7."""
    derived, none = derivatives.derivative, np.zeros(15)
    of_image = derived(derivatives.invariants_of_spots, "g", "spots", spots=(3, 2), g=(3,))
    shapes = {"p": (3,), "arm": (3,), "places": (3, 3), "errors": (15,), "g": (3,)}
    of_place = derived(derivatives.rays_of_beacons, "g", "p", **shapes)
    of_angles = derived(derivatives.angles_of_place, "rae", "p", p=(3,), rae=(3,))
    of_parallel = derived(derivatives.parallel_form, "rae", "spots", spots=(3, 2), rae=(3,))
    for range_m, azimuth, elevation in PLACES:
        p = truth.position(range_m, math.radians(azimuth), math.radians(elevation))
        spots = truth.central(p, truth.look_at(p, 0.3))
        by_spots = np.linalg.solve(of_place(p, none[:3], truth.beacons, none), of_image(spots, truth.f))
        for expected, got in (
            (of_angles(p) @ by_spots, rae_jacobian(p, spots, truth, PERSPECTIVE)),
            (of_parallel(spots, truth.f, truth.a, truth.b), rae_jacobian(p, spots, truth, PARALLEL)),
        ):
            np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())
