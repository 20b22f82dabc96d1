"""A target that is turned far from where it was handed over: a light is refused, the others fit a mirrored attitude.

Attitudes are handed over to 11 deg, 1-sigma, the most with which the target is not looked for from the start.
"""

import dataclasses
import math
import random

import numpy as np
import pytest

from relnav.accuracy.rendezvous import checkpoint
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother
from relnav.vehicle.trial import Trial
from relnav.vehicle.update import Outcome

WRONG = 30.7
"""Chi-square of three that a right attitude exceeds once in a million."""
RUNS = 120
FOLDED = 73, 88
"""Flights from 30 m of which the first twenty images leave one light, and agree about the other two."""
APART = 1e-4
"""In 1-sigma: the target turns in other steps."""
TIMES_S = 0.5, 3.0, 11.0


@pytest.fixture(scope="module")
def turned(slow):
    """Camera, star sensor and gyro from 30 m."""
    begin = dataclasses.replace(
        slow.hand_over,
        port_distance_m=(30.0, 0.0, 0.0),
        position_sigma_m=0.5,
        target_attitude_sigma_rad=math.radians(11.0),
    )
    parts = {part: {name: getattr(slow, part)[name] for name in ("camera", "star")} for part in ("sensor", "models")}
    return dataclasses.replace(slow, hand_over=begin, **parts)


def observations(vehicle, seed):
    run = simulate_rendezvous(vehicle, Rendezvous(start_m=30.0, final_m=28.5, as_believed=True), seed=seed)
    return run, sorted((seen for seen in run.observations if seen.t_s < 12.0), key=lambda seen: seen.t_s)


def fed(nav, ordered):
    for seen in ordered:
        nav.observe(seen.sensor, seen.t_s, seen.value)
    return nav


def off_sigma2(run, estimate):
    """Chi-square of the target's attitude."""
    point, place = checkpoint(run, estimate), estimate.layout.by_name["target_attitude"]
    return point.error[place] @ np.linalg.solve(point.covariance[place, place], point.error[place])


def test_none_is_silently_wrong(turned):
    """Without a search the two of FOLDED or more end beside the mirrored attitude, sure of it; few are searched."""
    searched, open_later, wrong = [], [], []
    for seed in range(RUNS):
        run, ordered = observations(turned, seed)
        nav = VehicleNavigator(turned, monitor=False)
        if fed(nav, [seen for seen in ordered if seen.t_s < 4.0]).state().ambiguous:
            searched.append(seed)
        if fed(nav, [seen for seen in ordered if 4.0 <= seen.t_s < 7.0]).state().ambiguous:
            open_later.append(seed)
        now = fed(nav, [seen for seen in ordered if seen.t_s >= 7.0]).state()
        if not now.ambiguous and off_sigma2(run, now) > WRONG:
            wrong.append(seed)
    assert (open_later, wrong) == ([], [])
    assert set(FOLDED) <= set(searched)
    assert len(searched) < RUNS // 6


@pytest.mark.parametrize("seed", FOLDED)
def test_it_is_found(turned, seed):
    """In any order, with filters beside the first, and smoothed from the start on."""
    run, ordered = observations(turned, seed)
    now = fed(VehicleNavigator(turned, separation=True), ordered).state()
    assert (now.ambiguous, now.restarts) == (False, 0)
    assert off_sigma2(run, now) < WRONG
    draw = random.Random(1)
    late = sorted(ordered, key=lambda seen: seen.t_s + draw.uniform(0.0, 1.0))
    assert fed(VehicleNavigator(turned), late).state().values.tobytes() == now.values.tobytes()
    for estimate in fed(VehicleSmoother(turned), ordered).estimates(TIMES_S):
        assert off_sigma2(run, estimate) < WRONG
        assert estimate.port.sigma[6:9].max() < math.radians(0.2)


def test_a_flight_that_ends_before_it_is_found_is_not_smoothed(turned):
    smoother = fed(VehicleSmoother(turned), [seen for seen in observations(turned, FOLDED[0])[1] if seen.t_s < 3.0])
    with pytest.raises(ValueError, match=r"attitudes of the target that explain what was seen: [1-4]; a flight has to"):
        smoother.estimates([1.0])


def test_an_image_with_a_reflection_opens_no_search(turned):
    """It is not on trial; the next two agree. The estimate is that without it, filtered and smoothed."""
    _, ordered = observations(turned, 3)
    image = next(seen for seen in ordered if seen.sensor == "camera")
    spots = np.array(image.value)
    spots[1] += 200.0  # px
    bent = [dataclasses.replace(seen, value=spots) if seen is image else seen for seen in ordered]
    clean = [seen for seen in ordered if seen is not image]
    nav, said = VehicleNavigator(turned), []
    for seen in bent:
        nav.observe(seen.sensor, seen.t_s, seen.value)
        if seen.sensor == "camera":
            said.append((nav.state().ambiguous, nav.state().explanations))
    assert said[1:4] == [(True, 1), (False, 1), (False, 1)]
    one, other = nav.state(), fed(VehicleNavigator(turned), clean).state()
    assert (np.abs(one.values - other.values) / np.sqrt(other.covariance.diagonal())).max() < APART
    pairs = (fed(VehicleSmoother(turned), seen).estimates(TIMES_S) for seen in (bent, clean))
    for mine, wanted in zip(*pairs, strict=True):
        assert (np.abs(mine.values - wanted.values) / np.sqrt(wanted.covariance.diagonal())).max() < APART


@pytest.mark.parametrize("seed", range(4))
def test_a_light_that_is_always_wrong_beside_a_sensor_that_is_right(slow, seed):
    """The camera's, by 20 px; attitudes handed over to 5 deg: the detector's images agree, and the camera is named."""
    begin = dataclasses.replace(
        slow.hand_over, port_distance_m=(10.0, 0.0, 0.0), target_attitude_sigma_rad=math.radians(5.0)
    )
    vehicle = dataclasses.replace(slow, hand_over=begin)
    run = simulate_rendezvous(vehicle, Rendezvous(start_m=10.0, final_m=8.8, as_believed=True), seed=seed)
    nav = VehicleNavigator(vehicle)
    for seen in sorted(run.observations, key=lambda seen: seen.t_s):
        value = np.array(seen.value) if seen.sensor == "camera" else seen.value
        if seen.sensor == "camera":
            value[1] += 20.0
        nav.observe(seen.sensor, seen.t_s, value)
    now = nav.state()
    assert (now.ambiguous, now.alarms[:1]) == (False, ("camera",))
    assert off_sigma2(run, now) < WRONG


def taken(used, groups=3):
    return "after", [Outcome(nis=9.0, dof=6, groups=groups, used=used, wide=True)]


def here():
    return "without"


def test_an_image_of_which_a_light_is_refused_is_not_on_trial():
    """Where the target may be turned far; none of it is believed then, and the one on trial stays."""
    trial, left = Trial("blind").seen("first", taken(2), "blind", None, here)
    assert (trial, left) == (Trial("blind", None, 1, 1), ("without", [taken(0)[1][0]]))
    assert trial.seen("next", taken(3), "blind", None, here) == (Trial("blind", "next", 2), taken(3))
    assert Trial("blind").seen("first", taken(0), "blind", None, here).trial.refused == 1
    assert Trial("blind").seen("first", taken(2), "blind", None) == (Trial("blind", "first", 1), taken(2))
    tried = Trial("blind", "first", 1)
    stays = tried.seen("next", taken(2), "later", lambda _: taken(2), here)
    assert stays == (Trial("later", "first", 2, 1), ("without", [taken(0)[1][0]]))
    assert tried.seen("next", taken(2), "blind", lambda _: taken(3), here).trial == Trial("blind", "next", 2)
    assert tried.seen("next", taken(3), "blind", None, here) == (None, taken(3))
