"""A spot that the marker filter refuses image after image, others being used: a bad spot, or a wrong pose."""

import dataclasses
import math

import numpy as np
import pytest

import relnav
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.navigation.pose_log import filter_marker_epochs
from relnav.navigation.relative_pose import PoseNavigator
from relnav.navigation.status import Alarm, EpochStatus
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

NEAR = Approach(6.0, 4.0, start_m=(3.0, 0.25, -0.15), final_range_m=1.5, speed_m_s=0.02, assumed_noise=True)
LONG = Approach(40.0, 4.0, start_m=(8.0, 0.25, -0.15), final_range_m=4.0, speed_m_s=0.05, assumed_noise=True)
BAD = slice(80, 110)
"""Images of LONG in which one spot lies 30 px off."""
ENGINES = pytest.mark.parametrize("engine", ["compiled", "filterpy"])


@pytest.fixture(scope="module")
def mission():
    return relnav.load_model("three_marker_vision")


def started(mission, seed, engine="compiled"):
    """Records of a flight with a start from a state known to 0.1 m and 10 deg, honestly drawn; and its truth."""
    flight, rng = simulate_flight(mission, NEAR, seed=seed), np.random.default_rng(seed)
    sigma = np.repeat([0.1, 0.005, math.radians(10.0), math.radians(0.2)], 3)
    error, nav = sigma * rng.normal(size=12), PoseNavigator(mission, engine=engine)
    dcm = turned(flight.dcm_lvlh_from_target[0], -error[6:9])
    nav.start(0.0, flight.motion[0] - error[:6], dcm, flight.rate_rad_s[0] - error[9:], np.diag(sigma**2))
    return flight, [
        nav.step(
            float(t),
            flight.spots_px[k],
            acceleration_m_s2=flight.acceleration_m_s2[k],
            dcm_chaser_from_lvlh=flight.dcm_chaser_from_lvlh[k],
        )
        for k, t in enumerate(flight.t_s)
    ]


@ENGINES
def test_a_wrong_pose_after_a_wide_start_is_left(mission, engine):
    """The first image bends by more than the update can follow, and of the next ones the same spot is refused.

    Another pose of the image that explains all three takes over; without it the flight ends with two spots used.
    """
    flight, records = started(mission, 3, engine)
    partial = [record.status == EpochStatus.PARTIAL for record in records]
    assert any(partial[:4])
    assert not any(partial[8:])
    last = records[-1]
    turn = rotation_vector_between(flight.dcm_lvlh_from_target[-1], last.dcm_lvlh_from_target)
    assert turn @ np.linalg.solve(last.covariance[6:9, 6:9], turn) < 21.1  # chi-square of three, one in ten thousand


def spoilt(mission):
    """A flight of which a spot is bad for a while."""
    flight = simulate_flight(mission, LONG, seed=4)
    spots = flight.spots_px.copy()
    spots[BAD, 1, 0] += 30.0
    return flight, spots


def flown(mission, engine, flight, spots):
    return filter_marker_epochs(mission, flight.t_s, spots, acceleration_m_s2=flight.acceleration_m_s2, engine=engine)


@ENGINES
def test_one_of_three_spots_that_stays_off_is_said_and_starts_nothing(mission, engine):
    """From the third image on, until it is used again: three spots have a pose, a wrong one, whatever they are."""
    said = flown(mission, engine, *spoilt(mission))
    contradicted = said.alarm & Alarm.CONTRADICTED > 0
    np.testing.assert_array_equal(np.flatnonzero(contradicted), np.arange(BAD.start + 2, BAD.stop))
    assert (said.status[BAD] == EpochStatus.PARTIAL).all()
    assert (said.hypotheses[BAD] == said.hypotheses[BAD.start - 1]).all()


@ENGINES
def test_one_of_five_spots_that_stays_off_changes_nothing(mission, engine):
    """Four others agree on the pose, and no pose explains all five: no alarm, no other hypothesis."""
    places = (*mission.markers.positions_m, (0.1, -0.4, -0.3), (0.2, 0.4, -0.2))
    five = dataclasses.replace(mission, markers=dataclasses.replace(mission.markers, positions_m=places))
    said = flown(five, engine, *spoilt(five))
    assert (said.status[BAD] == EpochStatus.PARTIAL).all()
    assert (said.alarm & Alarm.CONTRADICTED == 0).all()
    assert (said.hypotheses[BAD] == 1).all()
    assert (said.ambiguity[BAD] == np.inf).all()
