"""A reflection in the first image of lights: it is left once the next one disagrees, and said to be unsure before."""

import dataclasses

import numpy as np
import pytest

from relnav.accuracy.rendezvous import true_port
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother
from relnav.vehicle.trial import MOST, Trial
from relnav.vehicle.update import Outcome

LIGHTS = ("camera", "psd")
OFF_RAD = 3e-3
"""So little that three lights fit a pose within what is known at the start."""


@pytest.fixture(scope="module")
def run(slow):
    return simulate_rendezvous(slow, Rendezvous(start_m=5.5, final_m=4.7, fast_m_s=0.1, slow_m_s=0.1), seed=72)


def in_time(observations):
    return sorted(observations, key=lambda seen: seen.t_s)


def first_image(observations):
    return next(seen for seen in in_time(observations) if seen.sensor in LIGHTS)


@pytest.fixture(params=[0, 1, 2])
def reflected(run, request):
    """The flight whose first image shows three lights, one of them off, and the flight without that image."""
    image = first_image(run.observations)
    spots = np.array(image.value)
    three = np.flatnonzero(np.isfinite(spots[:, 0]))[:3]
    spots[~np.isin(np.arange(len(spots)), three)] = np.nan
    spots[three[request.param], 0] += OFF_RAD * run.truth.vehicle.models["psd"].sensor.focal_length_m
    assert (image.sensor, np.isfinite(spots).sum()) == ("psd", 6)
    bent = [dataclasses.replace(seen, value=spots) if seen is image else seen for seen in in_time(run.observations)]
    return bent, [seen for seen in in_time(run.observations) if seen is not image]


def fed(nav, observations):
    for seen in observations:
        nav.observe(seen.sensor, seen.t_s, seen.value)
    return nav


def test_without_a_trial_it_would_be_believed(slow, reflected):
    nav, outcomes = VehicleNavigator(slow), []
    nav.on_outcome = lambda event, outcome: outcomes.append(outcome) if event.source in LIGHTS else None
    for seen in reflected[0]:
        nav.observe(seen.sensor, seen.t_s, seen.value)
        if outcomes:
            break
    assert (outcomes[0].groups, outcomes[0].used) == (3, 3)


def test_it_is_left(slow, run, reflected):
    one, other = (fed(VehicleNavigator(slow), seen).state() for seen in reflected)
    assert not one.ambiguous
    apart = np.abs(one.values - other.values) / np.sqrt(other.covariance.diagonal())
    assert apart.max() < 1e-6
    np.testing.assert_allclose(one.port.sigma, other.port.sigma, rtol=1e-9)
    off = np.abs(true_port(run, one.t_s)[0][:3] - one.port.position_m)
    assert (off < one.port.protection_level_m()).all()


def test_until_two_images_agree_it_is_ambiguous(slow, run, reflected):
    for observations, images in ((in_time(run.observations), 2), (reflected[0], 3)):
        nav, said = VehicleNavigator(slow), []
        for seen in observations[:200]:
            nav.observe(seen.sensor, seen.t_s, seen.value)
            if seen.sensor in LIGHTS:
                said.append(nav.state().ambiguous)
        assert said[: images - 1] == [True] * (images - 1)
        assert not any(said[images - 1 :])


def test_smoothed_it_was_never_there(slow, reflected):
    times = [1.0, 2.0, 4.0]
    one, other = (fed(VehicleSmoother(slow), seen).estimates(times) for seen in reflected)
    for mine, wanted in zip(one, other, strict=True):
        assert (np.abs(mine.values - wanted.values) / np.sqrt(wanted.covariance.diagonal())).max() < 1e-6


def test_where_much_is_known_there_is_no_trial(slow, run):
    """The gate then knows what to expect of the first image."""
    tracked = fed(VehicleNavigator(slow), in_time(run.observations)).state()
    assert not tracked.ambiguous
    outcome = Outcome(nis=6.0, dof=6, groups=3, used=3, wide=False)
    assert Trial(None).seen("image", (None, [outcome]), None, None) == (None, (None, [outcome]))


def test_it_does_not_last_for_ever():
    """Images of which none agrees with the one before."""

    def taken(used):
        return None, [Outcome(nis=9.0, dof=6, groups=3, used=used, wide=True)]

    trial, count = Trial("blind"), 0
    while trial is not None:
        (trial, left), count = trial.seen(count, taken(2), "blind", lambda _: taken(3)), count + 1
        if trial is not None:
            assert (trial.image, trial.images) == (count - 1, count)
    assert count == MOST + 1
    assert left == taken(2)
    assert Trial("blind").seen("image", taken(0), "later", None).trial == Trial("later")


def test_how_rarely_so_many_images_have_no_two_clean_ones_in_a_row():
    """What is said of MOST, by the last image of a row without such two being clean or not."""
    reflected, clean = 0.25, 0.75
    for _ in range(MOST - 1):
        reflected, clean = 0.25 * (reflected + clean), 0.75 * reflected
    assert 40_000 < 1.0 / (reflected + clean) < 45_000
