"""Bad data get a status, never an exception and never a number; wrong use raises and says what to do."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relnav.sensors.measurement import Status
from relnav.sensors.three_beacon import measure

PROJECTIONS = ["perspective", "parallel"]
GOOD = np.array([[-2.0e-3, 0.1e-3], [2.0e-3, -0.1e-3], [0.2e-3, 0.3e-3]])


def assert_no_value(fix, *statuses: Status) -> None:
    assert fix.status in statuses
    assert not fix.ok
    assert np.isnan(fix.value).all()
    assert fix.covariance.shape == (3, 3)
    assert np.isnan(fix.covariance).all()


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_good_spots(sensor, projection: str) -> None:
    fix = measure(GOOD, sensor, projection=projection)
    assert fix.ok
    assert fix.status is Status.OK
    assert np.isfinite(fix.value).all()
    assert np.isfinite(fix.covariance).all()


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("row", [0, 1, 2])
@pytest.mark.parametrize("column", [slice(None), 0, 1])
def test_a_missing_spot_is_not_seen(sensor, projection: str, row: int, column) -> None:
    spots = GOOD.copy()
    spots[row, column] = np.nan
    assert_no_value(measure(spots, sensor, projection=projection), Status.NOT_SEEN)


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("value", [4.0001e-3, -4.0001e-3, 1.0, math.inf, -math.inf, 1e308, -1e308])
@pytest.mark.parametrize(("row", "column"), [(0, 0), (1, 1), (2, 0)])
def test_off_the_detector(sensor, projection: str, value: float, row: int, column: int) -> None:
    spots = GOOD.copy()
    spots[row, column] = value
    assert_no_value(measure(spots, sensor, projection=projection), Status.OFF_DETECTOR)


def test_width_and_height_are_told_apart(sensor) -> None:
    import dataclasses

    flat = dataclasses.replace(sensor, detector_size_m=(8e-3, 0.4e-3))
    assert_no_value(measure(GOOD, flat), Status.OFF_DETECTOR)
    assert measure(GOOD, dataclasses.replace(sensor, detector_size_m=(8e-3, 0.7e-3))).ok
    assert_no_value(measure(GOOD, dataclasses.replace(sensor, detector_size_m=(0.7e-3, 8e-3))), Status.OFF_DETECTOR)


def test_missing_comes_before_off_the_detector(sensor) -> None:
    spots = GOOD.copy()
    spots[0, 0], spots[2, 1] = 1.0, np.nan
    assert_no_value(measure(spots, sensor), Status.NOT_SEEN)


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("place", [(0.0, 0.0), (1e-3, -2e-3)])
def test_coinciding_spots(sensor, projection: str, place: tuple[float, float]) -> None:
    spots = GOOD.copy()
    spots[0] = spots[1] = place
    assert_no_value(measure(spots, sensor, projection=projection), Status.DEGENERATE)
    spots[2] = place
    assert_no_value(measure(spots, sensor, projection=projection), Status.DEGENERATE)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_a_triangle_that_no_pose_in_front_makes(sensor, projection: str) -> None:
    """C three times the base away, at a right angle: seen from nowhere near the docking axis."""
    spots = np.array([[-0.5e-3, 0.0], [0.5e-3, 0.0], [0.0, 3.0e-3]])
    fix = measure(spots, sensor, projection=projection)
    assert_no_value(fix, Status.OUTSIDE_DOMAIN, Status.NO_CONVERGENCE)


def test_parallel_form_from_straight_above_has_no_pose_in_front(truth, wide_sensor) -> None:
    p = truth.position(6.5, 0.0, math.radians(89.99))
    fix = measure(truth.parallel(p), wide_sensor, projection="parallel")
    assert_no_value(fix, Status.OUTSIDE_DOMAIN)


def test_each_outcome_of_the_perspective_form_occurs(truth, wide_sensor) -> None:
    near = truth.position(0.55, math.radians(8.0), 0.0)
    assert_no_value(measure(truth.central(near, truth.look_at(near)), wide_sensor), Status.OUTSIDE_DOMAIN)
    spots = np.array([[-0.5e-3, 0.0], [0.5e-3, 0.0], [0.0, 3.0e-3]])
    assert_no_value(measure(spots, wide_sensor), Status.NO_CONVERGENCE)


ANY = st.floats(allow_nan=True, allow_infinity=True)
ON_DETECTOR = st.floats(-4e-3, 4e-3)


@settings(derandomize=True, max_examples=400, deadline=None)
@given(
    st.lists(st.one_of(ON_DETECTOR, ON_DETECTOR, ON_DETECTOR, ANY), min_size=6, max_size=6),
    st.sampled_from(PROJECTIONS),
    st.booleans(),
)
def test_nothing_raises_and_every_ok_is_finite(sensor, wide_sensor, values, projection: str, wide: bool) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fix = measure(np.reshape(values, (3, 2)), wide_sensor if wide else sensor, projection=projection)
    if fix.ok:
        assert np.isfinite(fix.value).all()
        assert fix.range_m > 0.0
        assert np.isfinite(fix.covariance).all()
        np.testing.assert_allclose(fix.covariance, fix.covariance.T, rtol=1e-12)
        assert (np.diag(fix.covariance) > 0.0).all()
    else:
        assert_no_value(fix, fix.status)


@pytest.mark.parametrize("shape", [(3,), (2, 2), (3, 3), (2, 3), (6,), (1, 3, 2), (0,)])
def test_wrong_shape(sensor, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"spots_m has shape \(3, 2\), rows A, B, C, columns x, y in metres; got \("):
        measure(np.zeros(shape), sensor)


def test_unknown_projection(sensor) -> None:
    with pytest.raises(ValueError, match=r'projection must be "perspective" or "parallel"; got \'orthographic\''):
        measure(GOOD, sensor, projection="orthographic")


def test_lists_do_and_the_input_is_left_alone(sensor) -> None:
    spots = GOOD.copy()
    fix = measure(spots.tolist(), sensor)
    np.testing.assert_array_equal(fix.value, measure(spots, sensor).value)
    np.testing.assert_array_equal(spots, GOOD)
    np.testing.assert_array_equal(measure(np.asfortranarray(spots), sensor).value, fix.value)


def test_a_measurement_cannot_be_changed(sensor) -> None:
    import dataclasses

    fix = measure(GOOD, sensor)
    with pytest.raises(dataclasses.FrozenInstanceError):
        fix.range_m = 1.0
    with pytest.raises(ValueError, match="read-only"):
        fix.covariance[0, 0] = 1.0


def test_a_model_serves_as_well_as_its_sensor(make_model, sensor) -> None:
    np.testing.assert_array_equal(measure(GOOD, make_model()).value, measure(GOOD, sensor).value)
