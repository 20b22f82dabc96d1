"""A turn of the chaser takes along what is known in its axes, and nothing else."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.accuracy.rendezvous import checkpoint, honesty
from relnav.estimation.consistency import chi_square_interval
from relnav.geometry.linear_algebra import cross_matrix
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import CHASER_ATTITUDE, GYRO_BIAS, POSITION, VELOCITY, layout_of
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.reset import reset_scratch
from relnav.vehicle.retraction import bends, path_feels
from relnav.vehicle.smoothing import VehicleSmoother

RUNS = 16
TIMES_S = 2.0, 6.0
"""After two images and two attitudes, and after some ten of each."""
TURN = np.array([0.05, -0.03, 0.04])
"""Of the chaser's attitude, lvlh rad: 4 deg."""


@pytest.fixture(scope="module")
def image_first(slow):
    """Handed over at 30 m to 5 and 2 deg, 0.5 m and 10 mm/s; an image before the star sensor's first attitude."""
    begin = dataclasses.replace(
        slow.hand_over,
        port_distance_m=(30.0, 0.0, 0.0),
        position_sigma_m=0.5,
        velocity_sigma_m_s=0.01,
        chaser_attitude_sigma_rad=np.radians(5.0),
        target_attitude_sigma_rad=np.radians(2.0),
    )
    sensors = {
        "camera": dataclasses.replace(slow.sensor["camera"], first_s=0.01),
        "star": dataclasses.replace(slow.sensor["star"], first_s=0.3),
    }
    return dataclasses.replace(slow, hand_over=begin, sensor=sensors)


@pytest.fixture(scope="module")
def flights(image_first):
    flight = Rendezvous(start_m=30.0, final_m=29.3, as_believed=True)
    return [simulate_rendezvous(image_first, flight, seed=400 + k) for k in range(RUNS)]


def corrected(at, position, velocity, turn):
    """The estimate with these corrections, lvlh, of position, velocity and the chaser's attitude."""
    correction = np.zeros(at.values.shape)
    correction[0, POSITION], correction[0, VELOCITY] = position, velocity
    correction[0, CHASER_ATTITUDE] = (at.frame @ at.dcm_inertial_from_chaser[0]).T @ turn
    return correction, at.corrected(correction)


def test_a_path_known_in_the_chasers_axes_turns_as_a_rigid_body(odd_state):
    """By scipy's rotation; what is left over is added in the chaser's axes, also of the velocity."""
    r, u, left = odd_state.values[0, POSITION], odd_state.values[0, VELOCITY], 0.02 * np.cross(TURN, [3.0, 1.0, -2.0])
    rest = left - left @ np.cross(TURN, r) * np.cross(TURN, r) / np.sum(np.cross(TURN, r) ** 2)
    _, new = corrected(odd_state, np.cross(TURN, r) + rest, np.cross(TURN, u) + 1e-3, TURN)
    turn = Rotation.from_rotvec(TURN).as_matrix()
    np.testing.assert_allclose(new.values[0, POSITION], turn @ (r + rest), atol=1e-12)
    np.testing.assert_allclose(new.values[0, VELOCITY], turn @ (u + 1e-3), atol=1e-12)


def in_chasers_axes(at):
    """Covariance (6, 6) of position and velocity relative to the chaser, in its axes, by numpy's matrices."""
    axes, H = at.frame @ at.dcm_inertial_from_chaser[0], np.zeros((6, at.values.shape[1]))
    for place in (POSITION, VELOCITY):
        H[place, place] = axes.T
        H[place, CHASER_ATTITUDE] = axes.T @ cross_matrix(at.values[0, place]) @ axes
    return H @ at.of(0).covariance @ H.T


def test_what_is_known_of_such_a_path_turns_with_it(odd_state):
    """A line of sight that is known better across than along, in the chaser's axes before and after."""
    r, u = odd_state.values[0, POSITION], odd_state.values[0, VELOCITY]
    along = np.outer(r, r) / (r @ r)
    odd_state.covariance[0, POSITION, POSITION] += 0.3**2 * along
    _, new = corrected(odd_state, np.cross(TURN, r), np.cross(TURN, u), TURN)
    before = in_chasers_axes(odd_state)
    np.testing.assert_allclose(in_chasers_axes(new), before, atol=1e-12 * np.abs(before).max())


def test_a_turn_that_is_not_felt_is_left_out(odd_state):
    """By the errors that turn or by the values that bend, of either: a thousandth of a sigma."""
    n = odd_state.values.shape[1]
    here = odd_state.dcm_inertial_from_chaser[0], odd_state.frame, reset_scratch(n)[0]
    P, values = np.eye(n), np.zeros(n)
    assert not bends(P, values, 0.0, *here)
    for place in (POSITION, VELOCITY):
        own = P.copy()
        own[place.start, place.start] = 16.0  # 4 against 1: a turn by 0.25e-3
        assert bends(own, values, (0.26e-3) ** 2, *here)
        assert not bends(own, values, (0.1e-3) ** 2, *here)
        far = values.copy()
        far[place.stop - 1] = 200.0  # half of the square of 1e-4 of it: a thousandth of 1e-3
        assert bends(1e-6 * P, far, (1.01e-4) ** 2, *here)
        assert not bends(1e-6 * P, far, (0.98e-4) ** 2, *here)


@pytest.mark.parametrize("place", [POSITION, VELOCITY])
def test_it_is_felt_by_what_is_known_relative_to_the_chaser(odd_state, place):
    """Errors of a common turn and rate, and across the line of sight a thirtieth of them relative to the chaser."""
    at, n = odd_state.values[0], odd_state.values.shape[1]
    sight = np.outer(at[POSITION], at[POSITION]) / (at[POSITION] @ at[POSITION])
    axes = odd_state.frame @ odd_state.dcm_inertial_from_chaser[0]
    together = np.zeros((n, 6))
    together[CHASER_ATTITUDE, :3], together[GYRO_BIAS, 3:] = 0.01 * np.eye(3), 0.01 * np.eye(3)
    together[place, :3] = -0.01 * cross_matrix(at[place]) @ axes
    if place is VELOCITY:
        together[place, 3:] = 0.01 * cross_matrix(at[POSITION]) @ axes
    relative = np.zeros((n, n))
    known = np.sqrt((together @ together.T)[place, place].trace()) / 30.0
    relative[place, place] = known**2 * (np.eye(3) + 30.0**2 * sight)
    P = together @ together.T + relative
    here = odd_state.dcm_inertial_from_chaser[0], odd_state.frame, reset_scratch(n)[0]
    assert path_feels(P, at, place.start, (1.01e-3 * known) ** 2, *here)
    assert not path_feels(P, at, place.start, (0.5e-3 * known) ** 2, *here)
    P[place, CHASER_ATTITUDE] = P[CHASER_ATTITUDE, place] = 0.0  # not correlated
    P[place, GYRO_BIAS] = P[GYRO_BIAS, place] = 0.0
    assert not path_feels(P, at, place.start, (1.01e-3 * known) ** 2, *here)


def test_a_path_that_does_not_share_the_turn_is_corrected_by_addition(odd_state):
    """Not at all, and against the turn."""
    r = odd_state.values[0, POSITION]
    for moved in (np.zeros(3), -0.1 * np.cross(TURN, r), 0.1 * r):
        _, new = corrected(odd_state, moved, [0.01, 0.02, 0.03], TURN)
        np.testing.assert_allclose(new.values[0, POSITION], r + moved, rtol=1e-14)
        np.testing.assert_allclose(new.values[0, VELOCITY] - odd_state.values[0, VELOCITY], [0.01, 0.02, 0.03])


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_correction_between_two_estimates(odd_state, share):
    """Is the one that was made, and a covariance there and back is what it was."""
    r, u = odd_state.values[0, POSITION], odd_state.values[0, VELOCITY]
    moved = share * np.cross(TURN, r) + 1e-3 * r, share * np.cross(TURN, u) + 1e-3
    correction, new = corrected(odd_state, *moved, TURN)
    before = odd_state.of(0)
    ends = before.values, before.dcm_lvlh_from_target, before.dcm_inertial_from_chaser
    np.testing.assert_allclose(new.correction_from(*ends), correction[0], atol=1e-7)
    back = new.referred(*ends).of(0).covariance
    sigma = np.sqrt(np.diagonal(before.covariance))
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(back / scale, before.covariance / scale, atol=1e-6)


def test_a_star_sensor_after_an_image_leaves_the_target_where_the_image_showed_it(image_first, flights):
    """The middle of the lights in the chaser's axes, across the sight: moved by less than a spot's noise, 2 mm."""
    middle, turned = image_first.points_m("camera").mean(axis=0), []
    for run in flights:
        nav, seen_at = VehicleNavigator(image_first, monitor=False), []
        for seen in sorted(run.observations, key=lambda observation: observation.t_s):
            if seen.t_s > 0.3:
                break
            if seen.sensor == "star":
                seen_at.append(nav.state(0.3))
            nav.observe(seen.sensor, seen.t_s, seen.value)
        seen_at.append(nav.state(0.3))
        frame, places = nav._timeline.newest.estimates.frame, []
        for one in seen_at:
            place = one.dcm_lvlh_from_target @ middle - one.motion[:3]
            places.append((frame @ one.dcm_inertial_from_chaser).T @ place)
        before, after = (Rotation.from_matrix(one.dcm_inertial_from_chaser) for one in seen_at)
        turned.append((before.inv() * after).magnitude())
        across = np.linalg.norm(np.cross(places[0], places[1])) / np.linalg.norm(places[0])
        assert across < 2e-3
    assert max(turned) > np.radians(2.0)


@pytest.mark.parametrize("smoothed", [False, True])
def test_handed_over_to_degrees_and_an_image_first(image_first, flights, smoothed):
    """NEES/n of all that moves; and no healthy sensor is refused or alarmed."""
    points, places = {t: [] for t in TIMES_S}, layout_of(image_first).by_name
    for run in flights:
        ordered = sorted(run.observations, key=lambda observation: observation.t_s)
        if smoothed:
            smoother = VehicleSmoother(image_first)
            for seen in ordered:
                smoother.observe(seen.sensor, seen.t_s, seen.value)
            estimates = smoother.estimates(TIMES_S)
        else:
            nav, estimates = VehicleNavigator(image_first), []
            for seen in ordered:
                while len(estimates) < len(TIMES_S) and seen.t_s > TIMES_S[len(estimates)]:
                    estimates.append(nav.state(TIMES_S[len(estimates)]))
                nav.observe(seen.sensor, seen.t_s, seen.value)
        for estimate in estimates:
            points[estimate.t_s].append(checkpoint(run, estimate))
        assert not estimates[-1].first_alarm_s
    for found in points.values():
        for name in ("velocity", "position velocity target_attitude target_rate chaser_attitude", "port"):
            ratio, dof = honesty(found, places, name)
            lower, upper = chi_square_interval(dof, 0.9999)
            assert lower < ratio < upper, name


def test_a_camera_and_a_gyro_alone_for_a_while(vehicle):
    """From 65 m, 40 s: lights placed to 3.6 mm, focal length to 0.2 %, a bias of 14 deg/h, spots of 0.028 px; NEES/n.

    What is known relative to the chaser is a hundredth of what is known of the position itself.
    """
    begin = dataclasses.replace(
        vehicle.hand_over,
        port_distance_m=(65.0, 0.0, 0.0),
        position_sigma_m=0.18,
        velocity_sigma_m_s=0.016,
        chaser_attitude_sigma_rad=1e-3,
        target_attitude_sigma_rad=0.03,
        target_rate_sigma_rad_s=1e-4,
    )
    camera = dataclasses.replace(
        vehicle.sensor["camera"], rate_hz=5.0, points_sigma_m=3.6e-3, points_role="considered", focal_sigma=2e-3,
        focal_role="considered", mount_sigma_rad=2.9e-4, mount_role="estimated", lever_role="estimated",
    )  # fmt: skip
    model = vehicle.models["camera"]
    sharp = dataclasses.replace(model, camera=dataclasses.replace(model.camera, spot_noise_px=0.028))
    gyro = dataclasses.replace(vehicle.gyro, rate_hz=20.0, bias_sigma_rad_s=7e-5)
    flown = dataclasses.replace(
        vehicle, hand_over=begin, sensor={"camera": camera}, models={"camera": sharp}, gyro=gyro
    )
    points = []
    for k in range(36):
        run = simulate_rendezvous(flown, Rendezvous(start_m=65.0, final_m=61.0, as_believed=True), seed=700 + k)
        nav = VehicleNavigator(flown, monitor=False)
        for seen in sorted(run.observations, key=lambda observation: observation.t_s):
            nav.observe(seen.sensor, seen.t_s, seen.value)
        points.append(checkpoint(run, nav.state()))
    for name in ("position", "velocity", "chaser_attitude", "gyro_bias", "port"):
        ratio, dof = honesty(points, layout_of(flown).by_name, name)
        lower, upper = chi_square_interval(dof, 0.9999)
        assert lower < ratio < upper, name
