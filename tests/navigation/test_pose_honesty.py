"""The marker filter is never silently wrong: bad starts, bursts of glints, exchanged markers, flat patterns.

A state counts as relied on where the status is neither WAITING nor REJECTED, no alarm is given and other poses are less
credible by ten thousand to one.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.geometry.rotation_vector import attitude_error
from relnav.navigation.observation.marker_poses import roots
from relnav.navigation.pose_log import filter_marker_epochs
from relnav.navigation.pose_state import PoseState
from relnav.navigation.relative_pose import PoseNavigator
from relnav.navigation.status import Alarm
from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

WAITING, REJECTED = int(relnav.EpochStatus.WAITING), int(relnav.EpochStatus.REJECTED)
FLIGHT = Approach(60.0, 2.0, start_m=(10.0, 0.25, -0.15), final_range_m=5.0, speed_m_s=0.1, assumed_noise=True)
FLAT = Approach(50.0, 4.0, start_m=(10.0, 0.25, -0.15), final_range_m=5.0, speed_m_s=0.1, assumed_noise=True)
HEALTHY = Approach(300.0, 4.0, start_m=(10.0, 0.25, -0.15), final_range_m=4.0, speed_m_s=0.03, assumed_noise=True)
FLAT_LONG = Approach(200.0, 4.0, start_m=(8.0, 0.25, -0.15), final_range_m=2.0, speed_m_s=0.04, assumed_noise=True)
FLAT_NEAR = Approach(80.0, 4.0, start_m=(6.0, 0.15, -0.1), final_range_m=1.2, speed_m_s=0.08, assumed_noise=True)
LATE = Approach(70.0, 2.0, start_m=(25.0, 0.3, -0.2), final_range_m=5.0, speed_m_s=0.1, assumed_noise=True)
LAST_PX, NEAR_PX = 1023.0, 120.0


def near(rng, spots):
    """Spots anywhere within 120 px of these."""
    reach, angle = NEAR_PX * np.sqrt(rng.random(spots.shape[:-1])), 2.0 * np.pi * rng.random(spots.shape[:-1])
    return spots + reach[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def burst(rng, longest):
    """First and last image of a fault, images after the first ten seconds."""
    begin = int(rng.integers(20, 50))
    return begin, begin + int(rng.integers(1, longest + 1))


def one_glint_first(rng, spots):
    """One marker of the first image displaced by 60 px."""
    angle = 2.0 * np.pi * rng.random()
    spots[0, rng.integers(3)] += 60.0 * np.array([np.cos(angle), np.sin(angle)])
    return 0, 1


def scattered_start(rng, spots):
    """Up to 15 first images of which a part of the spots, or all, are anywhere."""
    end = int(rng.integers(1, 16))
    hit = rng.random((end, 3)) < rng.choice([0.3, 0.6, 1.0])
    spots[:end][hit] = LAST_PX * rng.random((hit.sum(), 2))
    return 0, end


def near_start(rng, spots):
    """Up to 15 first images of glints near the markers."""
    end = int(rng.integers(1, 16))
    spots[:end] = near(rng, spots[:end])
    return 0, end


def scattered(rng, spots):
    """Up to 30 images of spots anywhere."""
    begin, end = burst(rng, 30)
    spots[begin:end] = LAST_PX * rng.random((end - begin, 3, 2))
    return begin, end


def all_near(rng, spots):
    """Up to 30 images of glints near the markers."""
    begin, end = burst(rng, 30)
    spots[begin:end] = near(rng, spots[begin:end])
    return begin, end


def near_after_a_gap(rng, spots):
    """Nothing for ten seconds, then 15 s of glints near the markers."""
    begin = int(rng.integers(20, 50))
    spots[begin : begin + 20] = np.nan
    spots[begin + 20 : begin + 50] = near(rng, spots[begin + 20 : begin + 50])
    return begin, begin + 50


def some_near(count):
    """Glints near `count` of the markers for up to 20 s, the others being seen well."""

    def spoil(rng, spots):
        begin, end = burst(rng, 40)
        which = rng.permutation(3)[:count]
        spots[begin:end, which] = near(rng, spots[begin:end, which])
        return begin, end

    return spoil


def one_near_alone(rng, spots):
    """Glints near one marker for up to 20 s, the others not being seen."""
    begin, end = burst(rng, 40)
    which = rng.permutation(3)
    spots[begin:end, which[0]] = near(rng, spots[begin:end, which[0]])
    spots[begin:end, which[1:]] = np.nan
    return begin, end


def exchanged(rng, spots):
    """Two markers exchanged for up to 20 s."""
    begin, end = burst(rng, 40)
    pair = rng.permutation(3)[:2]
    spots[begin:end, pair] = spots[begin:end, pair[::-1]]
    return begin, end


def gone_round(rng, spots):
    """Three markers each in the place of the next for up to 20 s."""
    begin, end = burst(rng, 40)
    spots[begin:end] = np.roll(spots[begin:end], int(rng.integers(1, 3)), axis=1)
    return begin, end


def exchanged_first(rng, spots):
    """Two markers exchanged from the first image on, for up to 20 s."""
    end, pair = int(rng.integers(1, 41)), rng.permutation(3)[:2]
    spots[:end, pair] = spots[:end, pair[::-1]]
    return 0, end


def reflection(rng, spots):
    """A reflection near a marker that hides it and does not move, for up to 20 s."""
    begin, end = burst(rng, 40)
    which = rng.integers(3)
    spots[begin:end, which] = near(rng, spots[begin, which])
    return begin, end


KINDS = {
    "one glint in the first image": one_glint_first,
    "first images scattered": scattered_start,
    "first images near": near_start,
    "burst scattered": scattered,
    "burst near": all_near,
    "burst near after a gap": near_after_a_gap,
    "one of three near": some_near(1),
    "two of three near": some_near(2),
    "one near, alone": one_near_alone,
    "two exchanged": exchanged,
    "three gone round": gone_round,
    "two exchanged from the first image": exchanged_first,
    "a reflection": reflection,
}


def states(solution, flight):
    """Epochs with a state, each with its error (12,) and covariance (12, 12)."""
    covariance = solution.covariance
    for k in np.flatnonzero(np.isfinite(solution.state[:, 0])):
        truth = PoseState(flight.motion[k], flight.dcm_lvlh_from_target[k], flight.rate_rad_s[k], None)
        state = PoseState(solution.state[k], solution.dcm_lvlh_from_target[k], solution.rate_rad_s[k], None)
        yield k, state.error_of(truth), covariance[k]


def relied_on(solution):
    flagged = np.isin(solution.status, (WAITING, REJECTED)) | (solution.alarm > 0)
    return ~flagged & (solution.ambiguity >= AMBIGUITY_LIMIT)


def longest(flags):
    """Of the runs of True."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return int(np.max(ends[1::2] - ends[::2], initial=0))


def through_fault(mission, flight, spoil, seed):
    """A flight with a fault.

    Returns how many epochs in a row a state beyond 5 sigma is relied on, and how many images after the fault pass until
    one within 5 sigma is.
    """
    spots = flight.spots_px.copy()
    begin, end = spoil(np.random.default_rng(seed), spots)
    solution = filter_marker_epochs(mission, flight.t_s, spots, acceleration_m_s2=flight.acceleration_m_s2)
    good = np.zeros(len(spots), dtype=bool)
    for k, error, covariance in states(solution, flight):
        good[k] = np.abs(error / np.sqrt(np.diag(covariance))).max() <= 5.0
    relied = relied_on(solution)
    back = np.flatnonzero(relied[end:] & good[end:])
    return longest(relied & ~good), int(back[0]) + 1 if len(back) else len(spots), solution.alarm[begin:end]


def healthy_flight(mission, approach, seed):
    """A flight without a fault.

    Returns how many epochs in a row a state beyond 5 sigma is relied on, the share of epochs with a state relied on,
    and for how long, s, none is.
    """
    flight = simulate_flight(mission, approach, seed=seed)
    solution = filter_marker_epochs(mission, flight.t_s, flight.spots_px, acceleration_m_s2=flight.acceleration_m_s2)
    far, relied = np.zeros(len(solution), dtype=bool), relied_on(solution)
    for k, error, covariance in states(solution, flight):
        far[k] = np.abs(error / np.sqrt(np.diag(covariance))).max() > 5.0
    return longest(far & relied), relied.mean(), longest(~relied) / approach.rate_hz


def flat_flight(mission, approach, seed, unseen=0, built=None):
    """A flight before a flat pattern; unseen: first images without spots; built: what it is in truth.

    Returns how many epochs in a row a wrong attitude (6 sigma and 1 deg) is relied on, of how many epochs that are, and
    which are relied on.
    """
    flight = simulate_flight(mission if built is None else built, approach, seed=seed)
    flight.spots_px[:unseen] = np.nan
    solution = filter_marker_epochs(mission, flight.t_s, flight.spots_px, acceleration_m_s2=flight.acceleration_m_s2)
    wrong = np.zeros(len(solution), dtype=bool)
    for k, error, covariance in states(solution, flight):
        turn = error[6:9]
        far = turn @ np.linalg.solve(covariance[6:9, 6:9], turn) > 36.0
        wrong[k] = far and np.linalg.norm(turn) > math.radians(1.0)
    relied = relied_on(solution)
    return longest(wrong & relied), int(np.count_nonzero(wrong & relied)), relied


@pytest.fixture(scope="module")
def mission():
    return relnav.load_model("three_marker_vision")


@pytest.fixture(scope="module")
def flights(mission):
    return [simulate_flight(mission, FLIGHT, seed=seed) for seed in range(50000, 50008)]


def test_a_healthy_flight_is_relied_on(mission):
    """A tenth of `benchmarks/marker_faults.py healthy`.

    All roots of three spots fit every image, and most move as bodies can. As likely as a track that has excluded them
    they made a third of the epochs ambiguous.
    """
    wrong, share, unsure_s = np.transpose([healthy_flight(mission, HEALTHY, seed) for seed in range(50000, 50020)])
    assert wrong.max() <= 3
    assert share.mean() >= 0.95
    assert share.min() >= 0.85
    assert unsure_s.max() <= 20.0


def test_a_late_start_does_not_take_the_view_for_what_it_was():
    """A flat pattern is seen first after 50 s, when the target has turned by some seven times the stated view.

    Joined with the view as it was stated, a start is two degrees wide and may be many off: two of these flights relied
    on it for more than ten epochs.
    """
    flat = relnav.load_model("three_marker_vision_flat")
    flat = replace(flat, view=replace(flat.view, attitude_sigma_rad=math.radians(1.0)))
    assert max(flat_flight(flat, LATE, seed, unseen=100)[0] for seed in range(30)) <= 3


def wrong_roots(mission, spots, dcm_chaser_from_lvlh, dcm_lvlh_from_target):
    """Poses of an image by how far they are off the true attitude, rad, the farthest last."""
    any_view = replace(mission, view=replace(mission.view, attitude_sigma_rad=math.pi))
    found, _, _ = roots(spots, None, dcm_chaser_from_lvlh, any_view, None, [], any_view.view, 0.0)
    off = [np.linalg.norm(attitude_error(one.state.dcm_lvlh_from_target, dcm_lvlh_from_target)) for one in found]
    return sorted(zip(off, (one.state for one in found), strict=True), key=lambda one: one[0])


def test_a_start_on_a_wrong_root_is_doubted(mission):
    """Handed the farthest pose of an image as a start: ten seconds later the expected view speaks for another.

    In five flights of six or more: of 12, nine with a probability of 87 % at least.
    """
    relied_on = []
    for seed in range(50000, 50012):
        flight, nav, begin = simulate_flight(mission, HEALTHY, seed=seed), PoseNavigator(mission), 400
        off, state = wrong_roots(
            mission, flight.spots_px[begin], flight.dcm_chaser_from_lvlh[begin], flight.dcm_lvlh_from_target[begin]
        )[-1]
        assert off > 0.5
        nav.start(flight.t_s[begin], state.motion, state.dcm_lvlh_from_target, state.rate_rad_s, state.covariance)
        wrong = []
        for k in range(begin + 1, begin + 400):
            record = nav.step(flight.t_s[k], flight.spots_px[k], acceleration_m_s2=flight.acceleration_m_s2[k])
            turn = attitude_error(record.dcm_lvlh_from_target, flight.dcm_lvlh_from_target[k])
            flagged = record.status in (WAITING, REJECTED) or record.alarm or record.ambiguity < AMBIGUITY_LIMIT
            wrong.append(not flagged and np.linalg.norm(turn) > math.radians(1.0))
            np.testing.assert_array_equal(nav.hypotheses[0].state.dcm_lvlh_from_target, record.dcm_lvlh_from_target)
        relied_on.append(np.count_nonzero(wrong))
    assert np.count_nonzero(np.array(relied_on) <= 10 * 4) >= 9


@pytest.mark.parametrize("kind", KINDS)
def test_starts_and_bursts(mission, flights, kind):
    """A tenth of `benchmarks/marker_faults.py faults`."""
    for run, flight in enumerate(flights):
        wrong, wait, _ = through_fault(mission, flight, KINDS[kind], run)
        assert wrong <= 3
        assert wait <= 10


def test_exchanged_markers_are_named(mission, flights):
    """Two that change places, or three that go round: the track goes on as a prediction, and says why."""
    for run, flight in enumerate(flights):
        for kind in (exchanged, gone_round):
            _, _, alarms = through_fault(mission, flight, kind, run)
            assert (alarms == Alarm.EXCHANGED).all()


def test_a_start_on_exchanged_markers_is_out_of_view(mission, flights):
    for run, flight in enumerate(flights):
        _, _, alarms = through_fault(mission, flight, exchanged_first, run)
        assert (alarms == Alarm.OUT_OF_VIEW).all()


def test_exchanged_markers_in_the_record(mission, flights):
    flight, nav = flights[0], PoseNavigator(mission)
    for k in range(10):
        nav.step(flight.t_s[k], flight.spots_px[k], acceleration_m_s2=flight.acceleration_m_s2[k])
    record = nav.step(flight.t_s[10], flight.spots_px[10, [1, 0, 2]], acceleration_m_s2=flight.acceleration_m_s2[10])
    assert record.alarm is Alarm.EXCHANGED
    assert record.status is relnav.EpochStatus.REJECTED
    assert not record.accepted.any()
    record = nav.step(flight.t_s[11], flight.spots_px[11], acceleration_m_s2=flight.acceleration_m_s2[11])
    assert record.alarm is Alarm.NONE
    assert record.status is relnav.EpochStatus.UPDATED


def test_a_lone_spot_that_passes_is_not_believed(mission, flights):
    """Two of three are rejected: the third may be a glint as well."""
    flight, nav = flights[0], PoseNavigator(mission)
    for k in range(10):
        nav.step(flight.t_s[k], flight.spots_px[k], acceleration_m_s2=flight.acceleration_m_s2[k])
    spots = flight.spots_px[10].copy()
    spots[:2] += [[60.0, -30.0], [-20.0, 50.0]]
    record = nav.step(flight.t_s[10], spots, acceleration_m_s2=flight.acceleration_m_s2[10])
    assert record.status is relnav.EpochStatus.REJECTED
    assert not record.accepted.any()


def test_flat_patterns():
    """A part of `benchmarks/marker_faults.py flat`; the first six relied on a wrong pose for seconds before."""
    flat = relnav.load_model("three_marker_vision_flat")
    seeds = (50002, 50030, 50038, 50042, 50134, 50350, *range(50005, 50015))
    assert max(flat_flight(flat, FLAT, seed)[0] for seed in seeds) <= 3


def test_flat_patterns_for_long():
    """A part of `benchmarks/marker_faults.py long --seed 900000`; of the first three a wrong pose was relied on before.

    Of these 1,000 flights one still is wrong, seed 900800.
    """
    flat = relnav.load_model("three_marker_vision_flat")
    runs = [flat_flight(flat, FLAT_LONG, seed) for seed in (900059, 900069, 900893, *range(900100, 900108))]
    assert max(wrong for wrong, _, _ in runs) <= 3
    assert np.mean([relied.mean() for _, _, relied in runs]) > 0.1


def test_a_pose_that_was_beaten_is_not_tried_for_ever():
    """Of an approach from 8 m to 2 m two fifths are relied on: 0.40 of these, 0.29 where it was tried at even odds."""
    flat = relnav.load_model("three_marker_vision_flat")
    assert np.mean([flat_flight(flat, FLAT_LONG, seed)[2].mean() for seed in range(50000, 50020)]) > 0.36


def test_poses_that_lie_together_are_told_apart():
    """Two roots a few degrees apart, one taken to be on the other: these were relied on while off by 1.5 to 6 deg."""
    flat = relnav.load_model("three_marker_vision_flat")
    assert max(flat_flight(flat, FLAT_NEAR, seed)[0] for seed in (50176, 900355, 900738, 900917)) <= 3


def test_a_flat_pattern_is_relied_on_from_near():
    """From 10 m to 5 m it is nearly always ambiguous; from 3.6 m on it is not, or the filter would be of no use."""
    flat = relnav.load_model("three_marker_vision_flat")
    runs = [flat_flight(flat, FLAT_NEAR, seed) for seed in range(70000, 70012)]
    assert max(wrong for wrong, _, _ in runs) <= 3
    assert sum(relied.sum() for _, _, relied in runs) > 0.2 * 200 * len(runs)  # of the last 50 s
