"""A start that does not know how the target is turned: found from three lights, in any order, glints or not."""

import dataclasses
import math
import random

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from relnav.accuracy.vehicle_start import rolled, search, turned_vehicle
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.vehicle.acquisition import AGREED
from relnav.vehicle.layout import TARGET_ATTITUDE
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother

WRONG = float(chi2.isf(1e-6, 3))
"""Chi-square of an attitude's error that one right attitude in a million exceeds."""


@pytest.fixture(scope="module")
def flights(slow):
    """From 10 m, rolled and tilted, with what the vehicle's file says of each: camera and stars alone, any attitude."""
    found = []
    for k in range(6):
        rng = np.random.default_rng([7, k])
        roll, tilt = rng.uniform(-math.pi, math.pi), rng.uniform(-0.5, 0.5, 2)
        run = rolled(slow, 10.0, roll, tilt, seed=k)
        back = Rotation.from_rotvec([-roll, 0.0, 0.0])
        found.append((run, turned_vehicle(run.truth.vehicle, back, ("camera", "star"), math.pi)))
    return found


def observations(flight, until_s):
    run, told = flight
    ours = {*told.sensor, "gyro", "thrust"}
    return sorted((o for o in run.observations if o.sensor in ours and o.t_s < until_s), key=lambda o: o.t_s)


def navigator(flight):
    run, told = flight
    return VehicleNavigator(told, position_m=run.truth.vehicle.start_position_m, monitor=False)


def fed(flight, seen):
    nav = navigator(flight)
    for one in seen:
        nav.observe(one.sensor, one.t_s, one.value)
    return nav


def off_sigma2(flight, estimate):
    """Chi-square of the attitude's error."""
    true = flight[0].truth.dcm_frame_from_target(np.array([estimate.t_s]))[0]
    error = rotation_vector_between(true, estimate.dcm_lvlh_from_target)
    return error @ np.linalg.solve(estimate.covariance[TARGET_ATTITUDE, TARGET_ATTITUDE], error)


def test_the_right_one_is_left(flights):
    """Three lights have two explanations here; none is told as the only one before ten images agreed with it."""
    starts = [search(*flight) for flight in flights]
    assert max(start.most for start in starts) == 2
    assert all(start.found_s > 0.5 * (AGREED - 1) for start in starts)  # two images a second
    assert max(start.nees for start in starts) < WRONG
    assert max(start.error_rad for start in starts) < math.radians(0.5)


def test_it_says_that_it_does_not_know(flights):
    seen = observations(flights[0], 15.0)
    first_image = next(k for k, one in enumerate(seen) if one.sensor == "camera")
    nav = fed(flights[0], seen[:first_image])
    before = nav.state()
    assert (before.explanations, before.ambiguous) == (0, True)
    assert before.port.sigma[6:9].max() > math.radians(170.0)
    for one in seen[first_image:]:
        nav.observe(one.sensor, one.t_s, one.value)
        if one.sensor == "camera" and one.t_s < 4.0:
            assert nav.state().ambiguous
    after = nav.state()
    assert (after.explanations, after.ambiguous) == (1, False)
    assert after.port.sigma[6:9].max() < math.radians(0.2)
    assert off_sigma2(flights[0], after) < WRONG


def test_any_order_gives_the_same_bits(flights):
    """While explanations are open, and across the image with which the search is over."""
    seen = observations(flights[1], 8.0)
    in_order = fed(flights[1], seen).state()
    for seed in range(3):
        draw = random.Random(seed)
        late = sorted(seen, key=lambda one, draw=draw: one.t_s + draw.uniform(0.0, 1.0))
        found = fed(flights[1], late).state()
        assert found.values.tobytes() == in_order.values.tobytes()
        assert found.covariance.tobytes() == in_order.covariance.tobytes()
        assert found.explanations == in_order.explanations


def test_a_glint_in_the_first_image(flights):
    """A spot 100 px off opens explanations that are wrong: they are left, or turn right with the next images."""
    seen = observations(flights[1], 15.0)
    first = next(k for k, one in enumerate(seen) if one.sensor == "camera")
    glint = np.array(seen[first].value)
    glint[1] += 100.0
    seen[first] = dataclasses.replace(seen[first], value=glint)
    nav, wrong = navigator(flights[1]), 0
    for one in seen:
        nav.observe(one.sensor, one.t_s, one.value)
        now = nav.state()
        true = flights[1][0].truth.dcm_frame_from_target(np.array([now.t_s]))[0]
        off = np.linalg.norm(rotation_vector_between(true, now.dcm_lvlh_from_target))
        wrong += now.explanations > 0 and off > math.radians(5.0)
        assert now.ambiguous or off_sigma2(flights[1], now) < WRONG
    assert wrong > 0
    assert not nav.state().ambiguous


def test_smoothed_from_the_start(flights):
    """The attitude that was found later is that of the start, turned back."""
    flight = flights[3]
    run, told = flight
    smoother = VehicleSmoother(told, position_m=run.truth.vehicle.start_position_m, monitor=False)
    seen = observations(flight, 8.0)
    for one in seen:
        smoother.observe(one.sensor, one.t_s, one.value)
    early, late = smoother.estimates([0.5, 7.9])
    assert off_sigma2(flight, early) < WRONG
    assert early.port.sigma[6:9].max() < math.radians(0.5)
    assert not early.ambiguous
    assert off_sigma2(flight, late) < WRONG


def test_what_stays_ambiguous_is_not_smoothed(flights):
    run, told = flights[3]
    smoother = VehicleSmoother(told, position_m=run.truth.vehicle.start_position_m, monitor=False)
    for one in observations(flights[3], 1.5):
        smoother.observe(one.sensor, one.t_s, one.value)
    with pytest.raises(
        ValueError, match=r"attitudes of the target that explain what was seen: \d; a flight has to show one"
    ):
        smoother.estimates([1.0])


def test_two_lights_say_nothing(flights):
    seen = observations(flights[4], 3.0)
    for k, one in enumerate(seen):
        if one.sensor == "camera":
            spots = np.array(one.value)
            spots[2] = np.nan
            seen[k] = dataclasses.replace(one, value=spots)
    nav = navigator(flights[4])
    verdicts = {one.sensor: nav.observe(one.sensor, one.t_s, one.value).name for one in seen}
    assert (verdicts["camera"], verdicts["star"]) == ("REJECTED", "ACCEPTED")
    now = nav.state()
    assert now.explanations == 0
    assert math.isnan(now.sensors["camera"].last_used_s)


def test_no_separation_where_it_would_rest_on_the_sensor(flights):
    with pytest.raises(ValueError, match="separation: the target's attitude has to be known at hand-over"):
        VehicleNavigator(flights[0][1], separation=True)


def test_no_light_no_attitude(vehicle):
    with pytest.raises(ValueError, match="found from its lights; no sensor sees any"):
        turned_vehicle(vehicle, Rotation.identity(), ("star",), math.pi)
