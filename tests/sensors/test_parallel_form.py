"""The paper's eqs (4)-(13): exact for its own projection, biased for a real lens by the amount we state.

The paper is Cai, Zhao, Sun, Qiao, Dai (1996),
"Determination of target relative position and range by PSD optical sensor system".
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relnav.sensors.measurement import DEGENERATE, Status
from relnav.sensors.three_beacon import measure
from relnav.sensors.three_beacon.parallel import solve_parallel


@settings(derandomize=True, max_examples=200, deadline=None)
@given(
    range_m=st.floats(1.0, 100.0),
    azimuth=st.floats(-1.2, 1.2),
    elevation=st.floats(-0.75, 0.75),
    roll=st.floats(-math.pi, math.pi),
)
def test_exact_on_parallel_projection(truth, wide_sensor, range_m, azimuth, elevation, roll) -> None:
    p = truth.position(range_m, azimuth, elevation)
    fix = measure(truth.parallel(p, roll), wide_sensor, projection="parallel")
    assert fix.status is Status.OK
    # The double root of (9) at x = 0 amplifies rounding by 1/x.
    tolerance = 2e-14 / (p[0] / range_m) ** 2
    assert fix.range_m == pytest.approx(range_m, rel=tolerance)
    assert fix.azimuth_rad == pytest.approx(azimuth, abs=tolerance)
    assert fix.elevation_rad == pytest.approx(elevation, abs=tolerance)


@pytest.mark.parametrize("azimuth_deg", [7.0, 0.0, -7.0])
@pytest.mark.parametrize("elevation_deg", [4.0, 0.0, -4.0])
def test_axis_and_quadrants(truth, sensor, azimuth_deg: float, elevation_deg: float) -> None:
    """As printed, azimuth and elevation zero are 0/0 and the signs are lost."""
    p = truth.position(6.5, math.radians(azimuth_deg), math.radians(elevation_deg))
    fix = measure(truth.parallel(p), sensor, projection="parallel")
    assert fix.status is Status.OK
    np.testing.assert_allclose(np.degrees(fix.value[1:]), [azimuth_deg, elevation_deg], atol=1e-12)


@pytest.mark.parametrize(
    ("range_m", "true_deg", "biased_deg", "half_digit"),
    [
        (6.5, (2.0, 1.0), (2.227, 1.087), 0.0006),
        (6.5, (5.0, -3.0), (5.564, -3.254), 0.0006),
        (2.0, (5.0, -3.0), (7.17, -4.01), 0.006),
    ],
)
def test_bias_on_a_real_lens(truth, wide_sensor, range_m, true_deg, biased_deg, half_digit) -> None:
    """About b/r of the angle; the camera looks at O."""
    p = truth.position(range_m, *np.radians(true_deg))
    spots = truth.central(p, truth.look_at(p))
    printed = measure(spots, wide_sensor, projection="parallel")
    np.testing.assert_allclose(np.degrees(printed.value[1:]), biased_deg, rtol=0.0, atol=half_digit)
    exact = measure(spots, wide_sensor, projection="perspective")
    np.testing.assert_allclose(np.degrees(exact.value[1:]), true_deg, rtol=0.0, atol=1e-11)


def test_both_forms_agree_far_away(truth, wide_sensor) -> None:
    """The bias is about b/r of the angle: at 5 km it is 1e-4 of it."""
    p = truth.position(5000.0, 0.1, -0.05)
    spots = truth.central(p, truth.look_at(p))
    printed = measure(spots, wide_sensor, projection="parallel").value
    np.testing.assert_allclose(printed[1:], [0.1, -0.05], rtol=4e-4)
    assert abs(printed[1] - 0.1) > 1e-6


def test_the_sensor_s_own_projection_is_the_default(truth, sensor) -> None:
    import dataclasses

    p = truth.position(6.5, 0.05, 0.02)
    spots = truth.central(p, truth.look_at(p))
    paper = dataclasses.replace(sensor, projection="parallel")
    np.testing.assert_array_equal(measure(spots, paper).value, measure(spots, sensor, projection="parallel").value)
    np.testing.assert_array_equal(measure(spots, sensor).value, measure(spots, paper, projection="perspective").value)
    assert measure(spots, paper).azimuth_rad != measure(spots, sensor).azimuth_rad


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3, 1e6])
def test_spots_that_coincide_are_told_in_any_unit(unit):
    """To 1e-12 of the focal length."""
    f, p = 0.05 * unit, np.empty(3)
    for apart, degenerate in ((1e-13, True), (1e-11, False)):
        spots = f * np.array([[0.0, 0.0], [apart, 0.0], [0.5 * apart, 0.0]])
        assert (solve_parallel(spots, f, 0.3, 0.5, p) == DEGENERATE) is degenerate
