"""Spots of a real lens give back the position that made them, over the whole stated domain and for any camera attitude.

The truth is the central projection of tests/conftest.py. The tolerance is rounding: 1e-16 of a unit ray, divided by
the a b / r^2 that a small triple product of rays is; 1e-12 rad at r/b = 20, the edge of the working range.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relnav.sensors.measurement import Measurement, Status
from relnav.sensors.three_beacon import measure

# Off-axis angle, deg, and the least r/b at which the pose in front is the only one.
DOMAIN = [(10.0, 1.2), (20.0, 1.54), (30.0, 2.0), (45.0, 3.0), (60.0, 5.0)]
INSIDE, OUTSIDE = 1.0 - 1e-9, 1.0 + 1e-6


def direction(off_axis_rad: float, around_rad: float) -> np.ndarray:
    """Unit vector off the docking axis by one angle, turned about it by the other."""
    side = math.sin(off_axis_rad)
    return np.array([math.cos(off_axis_rad), side * math.cos(around_rad), side * math.sin(around_rad)])


def assert_recovered(truth, fix: Measurement, p: np.ndarray) -> None:
    assert fix.status is Status.OK
    r, azimuth, elevation = truth.angles(p)
    tolerance = 2.5e-15 * (r / truth.b) ** 2
    assert fix.range_m == pytest.approx(r, rel=tolerance)
    assert fix.azimuth_rad == pytest.approx(azimuth, abs=tolerance)
    assert fix.elevation_rad == pytest.approx(elevation, abs=tolerance)


@settings(derandomize=True, max_examples=400, deadline=None)
@given(
    step=st.sampled_from(DOMAIN),
    share=st.floats(0.0, 1.0),
    around=st.floats(-math.pi, math.pi),
    beyond=st.floats(0.0, 2.5),
    roll=st.floats(-math.pi, math.pi),
    tilt=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
)
def test_any_pose_in_the_domain(truth, wide_sensor, step, share, around, beyond, roll, tilt) -> None:
    limit_deg, least = step
    p = least * OUTSIDE * 10.0**beyond * truth.b * direction(math.radians(limit_deg * share * INSIDE), around)
    if math.hypot(*tilt) > 0.1 and np.linalg.norm(p) < 2.0 * truth.b:
        tilt = (0.0, 0.0)  # a beacon would stand beside the lens
    spots = truth.central(p, truth.look_at(p, roll, tilt))
    assert_recovered(truth, measure(spots, wide_sensor), p)


@pytest.mark.parametrize("step", DOMAIN)
def test_the_rim_of_the_domain(truth, wide_sensor, step: tuple[float, float]) -> None:
    """The hardest poses: the largest angle at the least range, all round."""
    limit_deg, least = step
    for around in np.linspace(-math.pi, math.pi, 73):
        p = least * OUTSIDE * truth.b * direction(math.radians(limit_deg * INSIDE), around)
        spots = truth.central(p, truth.look_at(p, roll_rad=around))
        assert_recovered(truth, measure(spots, wide_sensor), p)


@pytest.mark.parametrize("range_m", [0.63, 0.8, 1.0, 3.75, 6.5, 10.0, 100.0])
@pytest.mark.parametrize("roll", [0.0, 1.0, math.pi])
def test_on_the_docking_axis(truth, wide_sensor, range_m: float, roll: float) -> None:
    """The printed formulas are 0/0 here: the triangle is seen edge on."""
    p = np.array([range_m, 0.0, 0.0])
    fix = measure(truth.central(p, truth.look_at(p, roll)), wide_sensor)
    assert_recovered(truth, fix, p)
    assert np.linalg.norm(fix.covariance) > 0.0


@pytest.mark.parametrize("azimuth_deg", [5.0, -5.0, 1e-7, -1e-7])
@pytest.mark.parametrize("elevation_deg", [3.0, -3.0, 1e-7, -1e-7])
def test_signs_of_all_quadrants(truth, sensor, azimuth_deg: float, elevation_deg: float) -> None:
    """The printed square roots lose them."""
    p = truth.position(6.5, math.radians(azimuth_deg), math.radians(elevation_deg))
    fix = measure(truth.central(p, truth.look_at(p)), sensor)
    assert_recovered(truth, fix, p)
    assert math.copysign(1.0, fix.azimuth_rad) == math.copysign(1.0, azimuth_deg)
    assert math.copysign(1.0, fix.elevation_rad) == math.copysign(1.0, elevation_deg)


@pytest.mark.parametrize("shape", [0.4, 1.0, 1.7320508, 4.0])
def test_other_triangles(truth, wide_sensor, shape: float) -> None:
    """The ratio b / a is the mission's choice; the equilateral one is only the paper's."""
    import dataclasses

    b = shape * truth.a
    built = dataclasses.replace(wide_sensor, beacon_c_distance_m=b)
    beacons = np.array([[0.0, truth.a, 0.0], [0.0, -truth.a, 0.0], [b, 0.0, 0.0]])
    for range_m in (5.0 * max(b, truth.a), 30.0 * max(b, truth.a)):
        p = truth.position(range_m, 0.2, -0.1)
        fix = measure(truth.central(p, truth.look_at(p, 0.5), beacons=beacons), built)
        assert fix.status is Status.OK
        np.testing.assert_allclose(fix.value, truth.angles(p), rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("step", DOMAIN)
def test_outside_the_domain_a_status_and_no_numbers(truth, wide_sensor, step: tuple[float, float]) -> None:
    """A little too near for the angle: another pose may explain the spots, so none is given."""
    limit_deg, least = step
    for around in np.linspace(-math.pi, math.pi, 37):
        p = least * 0.98 * truth.b * direction(math.radians(limit_deg - 0.1), around)
        fix = measure(truth.central(p, truth.look_at(p)), wide_sensor)
        assert fix.status in (Status.OUTSIDE_DOMAIN, Status.NO_CONVERGENCE)
        assert np.isnan(fix.value).all()
        assert np.isnan(fix.covariance).all()


def test_never_a_wrong_answer_that_is_called_good(truth, wide_sensor) -> None:
    """Poses all over the half space in front: what comes out as OK reproduces the spots.

    It is then either the pose that was put in or, outside the domain, a twin of it that lies inside.
    """
    rng = np.random.default_rng(11)
    outcomes = {Status.OK: 0, Status.OUTSIDE_DOMAIN: 0, Status.NO_CONVERGENCE: 0}
    for _ in range(3000):
        p = rng.uniform(0.7, 8.0) * truth.b * direction(rng.uniform(0.0, 1.4), rng.uniform(-math.pi, math.pi))
        dcm = truth.look_at(p, rng.uniform(-math.pi, math.pi))
        if ((truth.beacons - p) @ dcm[2] < 0.02).any():
            continue
        spots = truth.central(p, dcm)
        fix = measure(spots, wide_sensor)
        outcomes[fix.status] += 1
        if fix.ok:
            found = truth.position(*fix.value)
            image = truth.central(found, truth.look_at(found))
            rays = [np.column_stack([s, np.full(3, truth.f)]) for s in (spots, image)]
            rays = [r / np.linalg.norm(r, axis=1, keepdims=True) for r in rays]
            np.testing.assert_allclose(rays[0] @ rays[0].T, rays[1] @ rays[1].T, rtol=0.0, atol=1e-12)
    assert min(outcomes.values()) > 50, outcomes
