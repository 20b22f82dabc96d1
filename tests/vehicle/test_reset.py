"""Turns that no image of lights tells are not learnt from images of lights."""

import dataclasses

import numpy as np
import pytest

from relnav.accuracy.rendezvous import checkpoint, honesty
from relnav.estimation.consistency import chi_square_interval
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation_vector import turned
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import (
    CHASER_ATTITUDE,
    DRIVING,
    POSITION,
    TARGET_ATTITUDE,
    TARGET_RATE,
    VELOCITY,
    layout_of,
)
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.reset import TURNS, change_into, is_felt, refer_into, refer_rows_into, reset_scratch
from relnav.vehicle.smoothing import VehicleSmoother

RUNS = 12
FLIGHT = Rendezvous(start_m=5.5, final_m=4.0, fast_m_s=0.1, as_believed=True)


@pytest.fixture(scope="module")
def lights_alone(slow):
    """A camera and a gyro; both attitudes handed over to 2 deg."""
    begin = dataclasses.replace(
        slow.hand_over, chaser_attitude_sigma_rad=np.radians(2.0), target_attitude_sigma_rad=np.radians(2.0)
    )
    return dataclasses.replace(slow, hand_over=begin, sensor={"camera": slow.sensor["camera"]})


@pytest.fixture(scope="module")
def flights(lights_alone):
    return [simulate_rendezvous(lights_alone, FLIGHT, seed=60 + k) for k in range(RUNS)]


def common_turn(at, n):
    """What a turn about each axis of `lvlh_ccsds`, of all there is, does to the errors, (n, 3)."""
    out, state = np.zeros((n, 3)), at.of(0)
    for place in (POSITION, VELOCITY):
        out[place] = -cross_matrix(state.values[place])
    out[TARGET_ATTITUDE] = state.dcm_lvlh_from_target.T
    out[CHASER_ATTITUDE] = (at.frame @ state.dcm_inertial_from_chaser).T
    return out


def turn_of_lights(at, nominal, n):
    """What a turn of the lights in the target, and of the target back, does to the errors, (n, 3); nominal (l, 3) m."""
    out, values = np.zeros((n, 3)), at.values[0]
    out[TARGET_ATTITUDE], out[TARGET_RATE] = -np.eye(3), -cross_matrix(values[TARGET_RATE])
    for first, place in zip(at.lights, nominal, strict=True):
        out[first : first + 3] = -cross_matrix(place + values[first : first + 3])
    return out


def far(at, rng):
    """Another estimate: metres and a radian away."""
    step = 0.3 * rng.normal(size=at.values.shape)
    blocks = np.ones(step.shape[1], dtype=bool)
    blocks[DRIVING:] = False
    blocks[at.lights[:, None] + np.arange(3)] = True
    return at.corrected(np.where(blocks, step, 0.0))


def random_turn(rng):
    """Any rotation (3, 3)."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.linalg.det(q)


def changed(at, new, turn):
    """G (n, n) of errors about `new` by those about `at`, where the path turns by (3, 3)."""
    n, scratch = at.values.shape[1], reset_scratch(at.values.shape[1])[0]
    ends = at.of(0), new.of(0)
    moved, G = new.values[0] - at.values[0], np.eye(n)
    scratch["turn"] = turn
    for place in (POSITION, VELOCITY):
        G[place, place] = turn
        scratch["path"][place] = turn @ at.values[0, place]
        moved[place] = new.values[0, place] - scratch["path"][place]
    change_into(
        moved,
        True,
        *(matrix for end in ends for matrix in (end.dcm_lvlh_from_target, end.dcm_inertial_from_chaser)),
        at.frame,
        at.lights,
        scratch,
    )
    G[:, TARGET_ATTITUDE] += scratch["change"][:, :3]
    G[:, CHASER_ATTITUDE] += scratch["change"][:, 3:TURNS]
    return G, scratch


def nominal_of(vehicle):
    names = [name for name in vehicle.sensor if vehicle.sensor[name].position_m]
    return np.concatenate([vehicle.points_m(name) for name in names])


def test_images_do_not_tell_them(vehicle, odd_state, navigator):
    """The rows of a camera's lights, at a state with everything off, times both turns: zero."""
    nominal, n = nominal_of(vehicle), odd_state.values.shape[1]
    for name in ("camera", "psd"):
        sensor = navigator._filters.sensors[name]
        spots = np.zeros(2 * len(vehicle.points_m(name)))
        H = sensor.rows(odd_state, spots, np.eye(len(spots))).jacobian[0]
        size = np.abs(H).max()
        assert np.abs(H @ common_turn(odd_state, n)).max() < 1e-9 * size
        told = H @ turn_of_lights(odd_state, nominal, n)
        assert np.abs(told).max() < 1e-9 * size


def test_what_they_do_to_the_errors_is_kept(vehicle, odd_state):
    """Referred to an estimate far away they are the same turns, exactly; and back again everything is as it was."""
    rng, n, nominal = np.random.default_rng(2), odd_state.values.shape[1], nominal_of(vehicle)
    new, turn = far(odd_state, rng), random_turn(rng)
    G, _ = changed(odd_state, new, turn)
    np.testing.assert_allclose(G @ common_turn(odd_state, n), common_turn(new, n), atol=1e-12)
    np.testing.assert_allclose(G @ turn_of_lights(odd_state, nominal, n), turn_of_lights(new, nominal, n), atol=1e-12)
    back, _ = changed(new, odd_state, turn.T)
    np.testing.assert_allclose(back @ G, np.eye(n), atol=1e-12)


def test_a_covariance_and_rows_referred(odd_state):
    """G P G^T and H G by numpy's matrices; of P the first rows whole, of the others what stands right."""
    rng, n = np.random.default_rng(3), odd_state.values.shape[1]
    new = far(odd_state, rng)
    G, scratch = changed(odd_state, new, random_turn(rng))
    A = rng.normal(size=(n, n + 3))
    P = A @ A.T
    expected, seen = G @ P @ G.T, P.copy()
    seen[np.tril_indices(n, -1)] = np.where(np.tril_indices(n, -1)[0] < DRIVING, P[np.tril_indices(n, -1)], np.nan)
    refer_into(seen, True, scratch)
    upper = np.triu_indices(n)
    np.testing.assert_allclose(seen[upper], expected[upper], atol=1e-10 * np.abs(expected).max())
    np.testing.assert_allclose(seen[:DRIVING], expected[:DRIVING], atol=1e-10 * np.abs(expected).max())


def test_rows_referred(odd_state):
    """H G by numpy's matrices, where the path takes half of the chaser's turn."""
    rng, n = np.random.default_rng(4), odd_state.values.shape[1]
    correction = np.zeros((1, n))
    turn = np.array([0.3, -0.2, 0.4])
    correction[0, CHASER_ATTITUDE] = (odd_state.frame @ odd_state.dcm_inertial_from_chaser[0]).T @ turn
    correction[0, POSITION] = 0.5 * np.cross(turn, odd_state.values[0, POSITION])
    correction[0, VELOCITY], correction[0, TARGET_RATE] = rng.normal(size=(2, 3)) * 0.1
    new = odd_state.corrected(correction)
    G, _ = changed(odd_state, new, turned(np.eye(3), 0.5 * turn))
    H = rng.normal(size=(1, 5, n))
    told = H.copy()
    refer_rows_into(
        told,
        correction,
        odd_state.values,
        odd_state.dcm_lvlh_from_target,
        odd_state.dcm_inertial_from_chaser,
        new.dcm_lvlh_from_target,
        new.dcm_inertial_from_chaser,
        odd_state.frame,
        odd_state.lights,
        odd_state.pivot,
        reset_scratch(n),
    )
    np.testing.assert_allclose(told[0], H[0] @ G, atol=1e-12 * np.abs(told).max())


def test_a_reset_that_is_not_felt_is_left_out(odd_state):
    """At a thousandth of a sigma, block by block, it is felt; at a tenth of that it is not."""
    P, values = odd_state.covariance[0], odd_state.values[0]
    here = values, odd_state.dcm_inertial_from_chaser[0], odd_state.frame, odd_state.lights, reset_scratch(len(P))[0]
    variance = np.diagonal(P)
    chaser, target = variance[CHASER_ATTITUDE].max(), variance[TARGET_ATTITUDE].max()
    by_chaser = (CHASER_ATTITUDE, TARGET_ATTITUDE, POSITION, VELOCITY)
    by_both = (TARGET_RATE, *(slice(at, at + 3) for at in odd_state.lights))
    for largest, places in ((chaser, by_chaser), (chaser + target, by_both)):
        for place in places:
            moved = np.zeros(len(P))
            moved[place.start + 1] = 1.01e-3 * np.sqrt(variance[place].min() / largest)
            assert is_felt(P, moved, *here)
            assert not is_felt(P, 0.1 * moved, *here)


def test_a_common_turn_stays_as_unknown_as_it_was(lights_alone, flights):
    """About the line of sight 2 deg / sqrt 2, what both hand-overs say, after 35 images; NEES/n of all that moves."""
    points = []
    for run in flights:
        nav = VehicleNavigator(lights_alone)
        for seen in sorted(run.observations, key=lambda observation: observation.t_s):
            nav.observe(seen.sensor, seen.t_s, seen.value)
        estimate, state = nav.state(), nav._timeline.newest.estimates
        sight = estimate.motion[:3] / np.linalg.norm(estimate.motion[:3])
        axis = (state.frame @ estimate.dcm_inertial_from_chaser).T @ sight
        sigma = np.sqrt(axis @ estimate.covariance[CHASER_ATTITUDE, CHASER_ATTITUDE] @ axis)
        assert np.degrees(sigma) > 0.99 * 2.0 / np.sqrt(2.0)
        points.append(checkpoint(run, estimate))
    places = layout_of(lights_alone).by_name
    for name in ("chaser_attitude", "position velocity target_attitude target_rate chaser_attitude"):
        ratio, dof = honesty(points, places, name)
        lower, upper = chi_square_interval(dof, 0.9999)
        assert lower < ratio < upper, name


def test_the_places_of_lights_are_not_taken_for_an_attitude(slow):
    """A star sensor too; lights placed to 3 mm of 0.3 m, and the target's attitude handed over to 2 deg."""
    begin = dataclasses.replace(slow.hand_over, target_attitude_sigma_rad=np.radians(2.0))
    sensors = {
        "camera": dataclasses.replace(slow.sensor["camera"], points_sigma_m=3e-3),
        "star": slow.sensor["star"],
    }
    vehicle, points = dataclasses.replace(slow, hand_over=begin, sensor=sensors), []
    for k in range(16):
        run = simulate_rendezvous(vehicle, dataclasses.replace(FLIGHT, final_m=3.5), seed=90 + k)
        nav = VehicleNavigator(vehicle)
        for seen in sorted(run.observations, key=lambda observation: observation.t_s):
            nav.observe(seen.sensor, seen.t_s, seen.value)
        points.append(checkpoint(run, nav.state()))
    places = layout_of(vehicle).by_name
    for name in ("port", "target_attitude", "camera.points"):
        ratio, dof = honesty(points, places, name)
        lower, upper = chi_square_interval(dof, 0.9999)
        assert lower < ratio < upper, name


def test_smoothed_too(lights_alone, flights):
    """At the start, from all images, and in the middle: NEES/n of all that moves, six flights."""
    places = layout_of(lights_alone).by_name
    points = {0: [], 1: []}
    for run in flights[:6]:
        smoother = VehicleSmoother(lights_alone)
        for seen in run.observations:
            smoother.observe(seen.sensor, seen.t_s, seen.value)
        for k, estimate in enumerate(smoother.estimates([0.5, 7.0])):
            points[k].append(checkpoint(run, estimate))
    for found in points.values():
        ratio, dof = honesty(found, places, "position velocity target_attitude target_rate chaser_attitude")
        lower, upper = chi_square_interval(dof, 0.9999)
        assert lower < ratio < upper
