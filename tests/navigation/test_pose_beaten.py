"""Poses of markers that the leading hypothesis has beaten, and those that it may cover: by numbers by hand."""

import math
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.navigation.memory import fill
from relnav.navigation.observation.marker_poses import Root, add_uncovered
from relnav.navigation.pose_filter import CHANCE, DROP, JOINED_LATE, keep_beaten, order_bank
from relnav.navigation.pose_memory import new_pose_memory, pose_views
from relnav.navigation.pose_propagation import MEMORY_S
from relnav.navigation.pose_state import PoseState
from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

MOTION = np.array([5.0, 0.0, 0.0, 0.0, 0.0, 0.0])
SIGMA = 0.01
LATE = 60.0


def turn(degrees):
    """About y."""
    return Rotation.from_rotvec([0.0, math.radians(degrees), 0.0]).as_matrix()


def bank(*hypotheses):
    """A memory at 100 s, its bank confirmed at 50 s: hypotheses (turn in degrees, score, doubt, added), 1-sigma SIGMA.

    The camera's axes are those of the orbit, the chaser's errors nothing.
    """
    m = pose_views(new_pose_memory(relnav.load_model("three_marker_vision")))
    fill(m.clock, t=100.0, running=len(hypotheses), renewed=90.0, confirmed=50.0)
    fill(m.camera, cam_from_lvlh=np.eye(3))
    for k, (degrees, score, doubt, added) in enumerate(hypotheses):
        fill(m.bank[k], motion=MOTION, dcm=turn(degrees), score=score, doubt=doubt, added=added)
        fill(m.bank[k], ld=np.diag(np.full(12, SIGMA**2)))
    m.bank_sensitivities[:] = 0.0
    return m


def ordered(m):
    """Order the bank; how many were there and remain, and how many starters then count as beaten."""
    before = int(m.clock["running"])
    m.clock["running"] = order_bank(m, m.bank, m.bank_sensitivities, m.bank_evidence, before, AMBIGUITY_LIMIT)
    return before, int(m.clock["running"]), keep_beaten(m, float(m.clock["t"]), before)


def beaten(m):
    """Angles, degrees, of the poses that are kept."""
    kept = m.beaten[np.isfinite(m.beaten["t"])]["dcm"]
    return [math.degrees(Rotation.from_matrix(one).as_rotvec()[1]) for one in kept]


@pytest.mark.parametrize(
    ("odds", "doubt", "added", "confirmed", "falls", "kept"),
    [
        (AMBIGUITY_LIMIT + 0.1, CHANCE - 0.1, -math.inf, 50.0, True, True),
        (AMBIGUITY_LIMIT - 0.1, CHANCE - 0.1, -math.inf, 50.0, False, False),
        (AMBIGUITY_LIMIT + 0.1, CHANCE + 0.1, -math.inf, 50.0, True, False),  # what it lost is in doubt
        (AMBIGUITY_LIMIT + 0.1, CHANCE - 0.1, -math.inf, 91.0, True, False),  # it was new
        (DROP + 0.1, 40.0, LATE, 91.0, True, True),  # it was the second
        (DROP - 0.1, 0.0, LATE, 50.0, False, False),
    ],
)
def test_a_pose_is_beaten_once_it_has_had_its_chance(odds, doubt, added, confirmed, falls, kept):
    m = bank((10.0, 0.0, 0.0, -math.inf), (40.0, odds + doubt, doubt, added))
    fill(m.clock, confirmed=confirmed)
    first = 1 if kept and added == -math.inf else 0
    assert ordered(m) == (2, 1 if falls else 2, first)
    assert beaten(m) == (pytest.approx([30.0]) if kept else [])


def test_each_that_is_beaten_has_its_place():
    m = bank((10.0, 0.0, 0.0, -math.inf), (40.0, 50.0, 0.0, -math.inf), (-30.0, 60.0, 0.0, LATE))
    assert ordered(m) == (3, 1, 1)
    assert sorted(beaten(m)) == pytest.approx([-40.0, 30.0])


def test_of_one_beaten_fairly_no_second_is_looked_for():
    """Nor is the leading one in doubt then; before a flat pattern, once the mirrored pose has fallen."""
    mission, fell = relnav.load_model("three_marker_vision_flat"), 0
    approach = Approach(120.0, 4.0, start_m=(8.0, 0.25, -0.15), final_range_m=2.0, speed_m_s=0.04, assumed_noise=True)
    for seed in (50000, 50003, 50005):
        flight, nav = simulate_flight(mission, approach, seed=seed), relnav.PoseNavigator(mission)
        m = pose_views(nav.memory)
        for k, t_s in enumerate(flight.t_s):
            first = np.count_nonzero(m.bank["added"][: int(m.clock["running"])] == -math.inf)
            nav.step(t_s, flight.spots_px[k], acceleration_m_s2=flight.acceleration_m_s2[k])
            now = np.count_nonzero(m.bank["added"][: int(m.clock["running"])] == -math.inf)
            if np.count_nonzero(m.beaten["t"] == t_s) == first - now > 0:
                fell += 1
                assert m.clock["renewed"] < t_s
    assert fell > 0


def test_a_start_has_beaten_nothing():
    mission = relnav.load_model("three_marker_vision")
    flight, nav = relnav.simulate(mission, seed=1), relnav.PoseNavigator(mission)
    pose_views(nav.memory).beaten["t"] = 0.0
    for k in range(3):
        record = nav.step(flight.t_s[k], flight.spots_px[k], dcm_chaser_from_lvlh=flight.dcm_chaser_from_lvlh[k])
    assert record.status is relnav.EpochStatus.UPDATED
    assert beaten(pose_views(nav.memory)) == []


def test_of_another_leading_one_nothing_is_kept():
    m = bank((10.0, 0.0, 0.0, -math.inf), (40.0, 50.0, 0.0, -math.inf))
    ordered(m)
    assert beaten(m) == pytest.approx([30.0])
    fill(m.bank[1], motion=MOTION, dcm=turn(25.0), score=-5.0, ld=m.bank[0]["ld"])
    fill(m.clock, running=2)
    assert ordered(m) == (2, 2, 0)
    assert beaten(m) == []


@pytest.mark.parametrize(
    ("sigmas2", "added", "joined"),
    [
        (JOINED_LATE - 0.1, LATE, True),
        (JOINED_LATE + 0.1, LATE, False),
        (JOINED_LATE - 0.1, 95.0, False),  # not settled yet
        (JOINED_LATE - 0.1, -math.inf, False),
        (0.9, -math.inf, True),
    ],
)
def test_one_taken_up_later_joins_the_leading_one_by_its_own_covariance(sigmas2, added, joined):
    """Twice as wide as the leading one: what is 6.3 of its own is 25 of that one's."""
    wide = 1.0 if sigmas2 < 1.0 else 4.0
    m = bank((0.0, 0.0, 0.0, -math.inf), (math.degrees(SIGMA * math.sqrt(sigmas2 * wide)), 5.0, 0.0, added))
    m.bank[1]["ld"] *= wide
    assert ordered(m) == (2, 1 if joined else 2, 0)
    assert beaten(m) == []


def found_at(m, *degrees, predicted=False, sigma=SIGMA):
    """Take up roots at these turns; the expected attitude is 30 deg off, about the same axis."""
    covariance = sigma**2 * np.eye(12)
    states = [PoseState(MOTION, turn(angle), np.zeros(3), covariance) for angle in degrees]
    nothing = partial(np.zeros, m.bank_sensitivities[0].shape)
    before = int(m.clock["running"])
    add_uncovered(m, [Root(state, nothing, predicted) for state in states], turn(30.0))
    added = m.bank[before : int(m.clock["running"])]
    return [
        (round(math.degrees(Rotation.from_matrix(one["dcm"]).as_rotvec()[1])), float(one["prior"])) for one in added
    ]


def test_a_beaten_pose_is_left_out_while_it_is_remembered():
    """It goes along with the leading one; one as near to that as to it is another."""
    m = bank((0.0, 0.0, 0.0, -math.inf), (40.0, 50.0, 0.0, -math.inf))
    ordered(m)
    fill(m.bank[0], dcm=turn(-10.0))
    assert found_at(m, 30.0) == []
    assert found_at(m, 20.0) == []
    assert found_at(m, 15.0) == [(15, DROP)]
    fill(m.clock, running=1, t=100.0 + MEMORY_S + 0.1)
    assert found_at(m, 30.0) == [(30, DROP)]


def test_one_is_less_likely_beside_a_pose_that_has_beaten_others():
    """Though it is more expected; and not while that is contested."""
    for doubted, fell, prior in ((-math.inf, False, 0.0), (89.9, True, DROP), (90.1, True, 0.0)):
        m = bank((0.0, 0.0, 0.0, -math.inf), (-60.0, 50.0, 0.0, -math.inf))
        if fell:
            ordered(m)
        fill(m.clock, doubted=doubted)
        assert found_at(m, 20.0) == [(20, prior)]


def test_a_root_is_followed_by_a_hypothesis_that_lags_behind_it():
    """Nearer than a quarter of the way to the next root; the same root, seen and predicted, is no next one."""
    m = bank((0.0, 0.0, 0.0, -math.inf), (27.0, 1.0, 0.0, LATE))
    assert found_at(m, 0.0, 30.0, 30.4) == []
    assert found_at(m, 20.0, 30.0) == [(20, 0.0), (30, 0.0)]


def test_what_is_predicted_has_no_noise_of_its_own():
    """Four sigma off the leading pose, which a noisy root may cover as well."""
    m = bank((0.0, 0.0, 0.0, -math.inf))
    off = math.degrees(4.0 * SIGMA)
    assert found_at(m, off, sigma=2.0 * SIGMA) == []
    assert found_at(m, off, sigma=2.0 * SIGMA, predicted=True) == [(round(off), 0.0)]
