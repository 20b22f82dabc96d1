"""Tracking with a prior: two stars are enough, the prior does not pull, and chance is not believed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.estimation.consistency import chi_square_interval
from relnav.sensors.dual_field.solution import StarStatus
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator, random_attitude, random_velocity

PRIOR_RAD = 5e-5


def near(dcm, rng, sigma=PRIOR_RAD):
    return Rotation.from_rotvec(rng.normal(size=3) * sigma).as_matrix() @ dcm


def test_from_two_stars_on(sensor, error_rad):
    simulator = StarFieldSimulator(sensor, SkyConditions(faintest_mag=4.0, false_spots=2))
    rng, nees, solved = np.random.default_rng(1), [], {}
    for _ in range(300):
        frame = simulator.frame(rng, velocity_km_s=random_velocity(rng))
        solution = relnav.dual_field.track(
            frame.spots_px,
            sensor,
            near(frame.dcm_cam_from_icrs, rng),
            PRIOR_RAD,
            magnitude=frame.magnitude,
            velocity_km_s=frame.velocity_km_s,
        )
        true = int(np.sum(frame.hip > 0))
        solved.setdefault(min(true, 3), []).append(solution.ok)
        if solution.ok:
            assert np.all((solution.hip == frame.hip) | (solution.hip == 0))
            e = error_rad(solution, frame)
            nees.append(e @ np.linalg.solve(solution.covariance, e))
    assert np.mean(solved[2]) > 0.9
    assert np.mean(solved[3]) > 0.99
    assert not any(solved.get(0, []) + solved.get(1, []))
    assert np.mean(nees) == pytest.approx(3.0, abs=5.0 * np.sqrt(6.0 / len(nees)))


def test_a_wrong_prior_is_not_believed(sensor):
    simulator, rng = StarFieldSimulator(sensor, SkyConditions()), np.random.default_rng(2)
    for _ in range(100):
        frame = simulator.frame(rng)
        solution = relnav.dual_field.track(
            frame.spots_px, sensor, random_attitude(rng), 3e-4, magnitude=frame.magnitude, velocity_km_s=np.zeros(3)
        )
        assert solution.status is StarStatus.NO_MATCH


@pytest.mark.parametrize(
    ("prior", "sigma", "message"),
    [
        (np.diag([1.0, 1.0, -1.0]), 1e-5, "a rotation matrix"),
        (np.eye(3), 0.0, "sigma_prior_rad is above 0"),
        (np.eye(3), 1e-2, "sigma_prior_rad is above 0 and up to"),
    ],
)
def test_wrong_use(sensor, prior, sigma, message):
    with pytest.raises(ValueError, match=message):
        relnav.dual_field.track(np.zeros((5, 2)), sensor, prior, sigma, velocity_km_s=np.zeros(3))


def test_one_spot_is_too_few(sensor):
    solution = relnav.dual_field.track([[0.0, 0.0]], sensor, np.eye(3), 1e-5, velocity_km_s=np.zeros(3))
    assert solution.status is StarStatus.TOO_FEW


WIDEST_RAD = 6e-4
"""The widest prior that `track` takes, and the one of `relnav stars attitude --track`."""


def tracked(sensor, frame, shown, rng, sigma=WIDEST_RAD):
    return relnav.dual_field.track(
        frame.spots_px[shown],
        sensor,
        near(frame.dcm_cam_from_icrs, rng, sigma),
        sigma,
        magnitude=frame.magnitude[shown],
        velocity_km_s=frame.velocity_km_s,
    )


def nees_of(solution, frame, error_rad):
    e = error_rad(solution, frame)
    return float(e @ np.linalg.solve(solution.covariance, e))


@pytest.mark.parametrize("dark", [0, 1])
def test_a_false_spot_is_no_second_field(mounted_sensor, error_rad, dark):
    """One field shows no star; thirty false spots are in view, and chance puts one beside a star in every tenth."""
    simulator, rng = StarFieldSimulator(mounted_sensor, SkyConditions(false_spots=30)), np.random.default_rng(3)
    nees, frames = [], 300
    for _ in range(frames):
        simulator.mount(rng)
        frame = simulator.frame(rng, velocity_km_s=random_velocity(rng))
        solution = tracked(mounted_sensor, frame, frame.field != dark, rng)
        assert solution.status is not StarStatus.OK
        assert solution.matches_per_field[dark] == 0
        if solution.ok:
            nees.append(nees_of(solution, frame, error_rad))
    assert len(nees) > 0.85 * frames
    low, high = chi_square_interval(3 * len(nees), 0.999)
    assert low < np.mean(nees) / 3.0 < high


@pytest.mark.parametrize("stars", [3, 2])
def test_both_fields_are_seen_where_both_show_stars(mounted_sensor, error_rad, stars):
    """The brightest few stars of each field beside three false spots, with the widest prior: tracked with both."""
    simulator, rng = StarFieldSimulator(mounted_sensor, SkyConditions()), np.random.default_rng(4)
    nees, frames = [], 300
    for _ in range(frames):
        simulator.mount(rng)
        frame = simulator.frame(rng, velocity_km_s=random_velocity(rng))
        shown = frame.field < 0
        for field in (0, 1):
            shown[np.flatnonzero(frame.field == field)[:stars]] = True
        solution = tracked(mounted_sensor, frame, shown, rng)
        if solution.status is StarStatus.OK:
            nees.append(nees_of(solution, frame, error_rad))
    assert len(nees) > 0.95 * frames
    low, high = chi_square_interval(3 * len(nees), 0.999)
    assert low < np.mean(nees) / 3.0 < high


@pytest.mark.parametrize(("off_sigmas", "status"), [(0.0, StarStatus.OK), (8.0, StarStatus.SINGLE_FIELD)])
def test_one_star_tells_a_fold_that_is_off(mounted_sensor, error_rad, off_sigmas, status):
    """A known prior and no false spot: one star of field 1 is believed unless it lies off what the fold allows."""
    fold = mounted_sensor.fold
    turn = off_sigmas * 2.0 * fold.error_rad
    moved = Rotation.from_rotvec([0.0, turn, 0.0]).as_matrix() @ fold.matrix
    simulator = StarFieldSimulator(mounted_sensor, SkyConditions(false_spots=0), moved)
    rng, seen, frames = np.random.default_rng(5), [], 100
    for _ in range(frames):
        frame = simulator.frame(rng, velocity_km_s=random_velocity(rng))
        shown = frame.field == 0
        shown[np.flatnonzero(frame.field == 1)[:1]] = True
        solution = tracked(mounted_sensor, frame, shown, rng, 5e-6)
        seen.append(solution.status is status)
        assert nees_of(solution, frame, error_rad) < 31.81, "beyond 5 sigma"
    assert np.mean(seen) > 0.9


def test_false_spots_alone_are_no_attitude(sensor):
    """Thirty false spots near a prior of any direction: at a stated chance of 1e-7 none of 20,000 frames is one.

    The fit moves the attitude onto two of them, so that these lie on their stars anyway.
    """
    rng, (width, height) = np.random.default_rng(9), sensor.camera.detector_size_px
    for _ in range(20_000):
        spots = rng.uniform([-width / 2.0, -height / 2.0], [width / 2.0, height / 2.0], (30, 2))
        solution = relnav.dual_field.track(
            spots,
            sensor,
            random_attitude(rng),
            WIDEST_RAD,
            magnitude=rng.uniform(2.0, 6.5, 30),
            velocity_km_s=np.zeros(3),
        )
        assert solution.status is StarStatus.NO_MATCH


def test_a_fold_that_is_less_known_makes_chance_likelier(mounted_sensor, sensor):
    """One star in each field: the other field's may lie anywhere within the prior's reach and the fold's."""
    simulator, rng, frames = StarFieldSimulator(sensor, SkyConditions(false_spots=0)), np.random.default_rng(6), 0
    for _ in range(20):
        frame = simulator.frame(rng, velocity_km_s=random_velocity(rng))
        shown = np.zeros(len(frame.hip), dtype=bool)
        for field in (0, 1):
            shown[np.flatnonzero(frame.field == field)[:1]] = True
        states = [tracked(own, frame, shown, np.random.default_rng(7), 2e-5) for own in (sensor, mounted_sensor)]
        if all(state.matches == 2 for state in states):
            frames += 1
            assert states[1].log10_false_alarm > states[0].log10_false_alarm + 0.3
    assert frames > 10
