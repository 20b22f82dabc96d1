"""The pose smoother: smaller errors, an honest covariance, late images, gaps, pieces; and against a dense solution."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.accuracy.pose_filter import flown, smoothed_errors
from relnav.dynamics.rigid_body import RigidBody
from relnav.estimation.consistency import chi_square_interval, nees
from relnav.navigation.pose_log import filter_marker_epochs
from relnav.navigation.pose_state import PoseState, time_update
from relnav.navigation.status import EpochStatus
from relnav.simulation.marker_flight import MarkerFaults, simulate_flight, true_spots
from relnav.simulation.target_rotation import rotate_target, turning_rad_s
from relnav.simulation.trajectory import Approach

FAR = Approach(
    duration_s=60.0, rate_hz=2.0, start_m=(17.0, 0.25, -0.15), final_range_m=3.0, speed_m_s=0.1, assumed_noise=True
)
FAST = Approach(40.0, 10.0, start_m=(10.0, 0.25, -0.15), final_range_m=5.0, speed_m_s=0.05, assumed_noise=True)


@pytest.fixture(scope="module")
def mission():
    """The chaser's attitude without an error that lasts: `test_pose_considered.py` has that."""
    model = relnav.load_model("three_marker_vision")
    return dataclasses.replace(model, chaser=dataclasses.replace(model.chaser, attitude_sigma_rad=0.0))


@pytest.fixture(scope="module")
def flight(mission):
    return simulate_flight(mission, FAR, seed=5)


def run(mission, flight, spots=None, **options):
    chosen = flight.spots_px if spots is None else spots
    options.setdefault("acceleration_m_s2", flight.acceleration_m_s2)
    t_s = options.pop("t_s", flight.t_s)
    return [filter_marker_epochs(mission, t_s, chosen, smooth=smooth, **options) for smooth in (False, True)]


def test_honest_and_better(mission):
    """Twelve approaches with dropped spots: NEES / 12 after the first seconds, errors beside the filter's."""
    both = [flown(mission, FAR, MarkerFaults(dropout=0.1), 12, 40, *way) for way in ((), (smoothed_errors,))]
    filtered, smoothed = (errors.where(errors.t_s > 5.0) for errors in both)
    assert 0.8 <= smoothed.nees_ratio <= 1.2
    assert smoothed.position_rms_m < 0.7 * filtered.position_rms_m
    assert smoothed.attitude_rms_rad < 0.7 * filtered.attitude_rms_rad


def test_against_the_dense_solution(mission):
    """Covariances of all states of a short log at once, from the same steps and updates as one large least squares.

    The target's rate is known so well that slopes about the filter's own states are those of the smoothed ones.
    """
    slow = dataclasses.replace(mission.filter, initial_rate_sigma_rad_s=math.radians(0.01))
    mission = dataclasses.replace(mission, filter=slow)
    flight = simulate_flight(mission, FAR, seed=5)
    count = 12
    filtered, smoothed = run(
        mission,
        dataclasses.replace(flight, t_s=flight.t_s[:count]),
        flight.spots_px[:count],
        acceleration_m_s2=flight.acceleration_m_s2[:count],
    )
    body = RigidBody(np.array(mission.target.inertia_kg_m2), mission.orbit.mean_motion_rad_s)
    begin = int(np.flatnonzero(filtered.status == EpochStatus.STARTED)[0])
    count -= begin
    of = [filtered.state, filtered.dcm_lvlh_from_target, filtered.rate_rad_s, filtered.covariance]
    states = [PoseState(*(values[begin + k] for values in of)) for k in range(count)]
    information = np.zeros((12 * count, 12 * count))
    information[:12, :12] = np.linalg.inv(states[0].covariance)
    for k in range(1, count):
        step, push = flight.t_s[begin + k] - flight.t_s[begin + k - 1], flight.acceleration_m_s2[begin + k]
        predicted, phi, noise = time_update(states[k - 1], step, body, mission, push, np.zeros(3))
        row = np.hstack([-phi, np.eye(12)])
        both = slice(12 * (k - 1), 12 * (k + 1))
        information[both, both] += row.T @ np.linalg.solve(noise, row)
        own = slice(12 * k, 12 * (k + 1))  # what the image added: information after less information before
        information[own, own] += np.linalg.inv(states[k].covariance) - np.linalg.inv(predicted.covariance)
    scale = 1.0 / np.sqrt(np.diag(information))
    dense = np.linalg.inv(information * scale * scale[:, None]) * scale * scale[:, None]
    for k in range(count):
        own = slice(12 * k, 12 * (k + 1))
        expected = dense[own, own]
        size = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(
            smoothed.covariance[begin + k] / size / size[:, None], expected / size / size[:, None], atol=1e-4
        )
    np.testing.assert_array_equal(smoothed.covariance[-1], filtered.covariance[-1])


def test_a_gap_is_bridged_from_both_sides(mission, flight):
    """Twenty images without a spot: in the middle the smoothed sigma is a small part of the filter's, and fits."""
    spots = flight.spots_px.copy()
    spots[60:80] = np.nan
    filtered, smoothed = run(mission, flight, spots)
    sigma = [np.sqrt(np.diagonal(s.covariance, axis1=1, axis2=2)) for s in (filtered, smoothed)]
    assert (sigma[1][70] < 0.8 * sigma[0][70]).all()
    assert (sigma[1][79, :3] < 0.5 * sigma[0][79, :3]).all()
    assert (np.abs(smoothed.state[60:80, :3] - flight.motion[60:80, :3]) < 4.0 * sigma[1][60:80, :3]).all()


def test_late_images_are_smoothed_where_they_were_exposed(mission, flight):
    """Every image arrives with the row after its own; smoothed, that makes no difference (but before the start)."""
    prompt = run(mission, flight)[1]
    spots = np.concatenate([np.full((1, *flight.spots_px.shape[1:]), np.nan), flight.spots_px])
    step = flight.t_s[1] - flight.t_s[0]
    t = np.append(flight.t_s, flight.t_s[-1] + step)
    image_t = np.concatenate([[t[0]], flight.t_s])
    acceleration = np.vstack([flight.acceleration_m_s2, np.zeros(3)])
    late = run(mission, flight, spots, t_s=t, image_t_s=image_t, acceleration_m_s2=acceleration)[1]
    assert not late.too_late.any()
    known = np.isfinite(prompt.state[:, 0]) & (flight.t_s > 0.5)  # a row comes before an image of its time
    sigma = np.sqrt(np.diagonal(prompt.covariance, axis1=1, axis2=2))
    difference = np.abs(late.state[:-1] - prompt.state)[known] / sigma[known, :6]
    assert difference.max() < 1e-6
    np.testing.assert_allclose(late.covariance[:-1][known], prompt.covariance[known], rtol=1e-6, atol=1e-18)


def test_a_piece_ends_where_the_track_was_begun_anew(mission, flight):
    """After a gap that forgets everything: the first piece is that of a log that ends there, bit for bit."""
    cut, t = 60, flight.t_s.copy()
    t[cut:] += 1e7
    filtered, smoothed = run(mission, dataclasses.replace(flight, t_s=t))
    assert (filtered.status == EpochStatus.STARTED).sum() == 2
    first = dataclasses.replace(flight, t_s=t[:cut])
    alone = run(mission, first, flight.spots_px[:cut], acceleration_m_s2=flight.acceleration_m_s2[:cut])[1]
    np.testing.assert_array_equal(smoothed.state[:cut], alone.state)
    np.testing.assert_array_equal(smoothed.covariance[:cut], alone.covariance)


def test_where_several_poses_are_possible_the_filter_stands():
    flat = relnav.load_model("three_marker_vision_flat")
    log = simulate_flight(flat, FAR, seed=3)
    filtered, smoothed = run(flat, log)
    several = filtered.hypotheses > 1
    assert several.any()
    np.testing.assert_array_equal(smoothed.state[several], filtered.state[several])
    assert (smoothed.covariance[several] == filtered.covariance[several]).all()


def tumbling(mission, seed):
    """An approach before a target whose rate is drawn from the whole of what the model states."""
    flight, rng = simulate_flight(mission, FAST, seed=seed), np.random.default_rng(seed)
    start = Rotation.from_matrix(flight.dcm_lvlh_from_target[0])
    rate = start.inv().apply([0.0, -turning_rad_s(0.0, mission.orbit), 0.0])
    rate += mission.filter.initial_rate_sigma_rad_s * rng.normal(size=3)
    density, inertia = mission.target.rate_noise_density_rad2_s3, np.array(mission.target.inertia_kg_m2)
    dcm, rates = rotate_target(flight.t_s, start.as_quat()[None], rate[None], inertia, mission.orbit, density, rng)
    spots = true_spots(mission, flight.motion, dcm[:, 0], flight.true_dcm_chaser_from_lvlh)
    spots += mission.camera.spot_noise_px * rng.normal(size=spots.shape)
    return dataclasses.replace(flight, spots_px=spots, dcm_lvlh_from_target=dcm[:, 0], rate_rad_s=rates[:, 0])


def test_a_fast_tumbler_is_smoothed_back_to_its_start(mission):
    """5 deg/s and 2 px: after two images the rate is off by 9 deg/s, smoothed it is known to 0.1 deg/s.

    With slopes about the filter's own states alone the mean NEES / 12 of the first eight images falls from 4.6 to 1.5.
    """
    fast = dataclasses.replace(
        mission,
        camera=dataclasses.replace(mission.camera, spot_noise_px=2.0),
        filter=dataclasses.replace(mission.filter, initial_rate_sigma_rad_s=math.radians(5.0)),
        target=dataclasses.replace(
            mission.target, inertia_kg_m2=((1500.0, 0.0, 0.0), (0.0, 2400.0, 0.0), (0.0, 0.0, 3600.0))
        ),
    )
    flights = [smoothed_errors(fast, tumbling(fast, 100 + seed)) for seed in range(12)]
    ratios = np.mean([nees(one.error, one.covariance)[:8] / 12.0 for one in flights], axis=0)
    low, high = chi_square_interval(12 * 12, 0.9999)
    assert ((low <= ratios) & (ratios <= high)).all(), ratios
