"""Some of the cases of benchmarks/fuzzing_calls.py, the same ones every time; what must hold of each stands there."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

import relnav

CASES = {"PoseNavigator.step": 4, "dual_field.measure": 4, "VehicleNavigator.observe": 8, "find_stars": 25}
CASES |= {"measure_accuracy": 6, "campaign": 10, "write": 25, "filter_log": 15}
EACH = 30
SPOTS = [[-1.5e-3, 0.0], [1.5e-3, 0.0], [0.0, 0.0]]


@pytest.fixture(scope="module")
def fuzzing():
    """The script, which imports another one beside it."""
    place = str(Path(__file__).parents[2] / "benchmarks")
    sys.path.insert(0, place)
    try:
        yield importlib.import_module("fuzzing_calls")
    finally:
        sys.path.remove(place)


NAMES = (
    *("Navigator.step", "PoseNavigator.step", "TargetAttitude.step", "filter_epochs", "three_beacon.measure"),
    *("three_marker.measure", "dual_field.measure", "find_stars", "sun sensors' measure", "load_model", "simulate"),
    *("VehicleNavigator.observe", "filter_log", "write", "loaders", "measure_accuracy", "campaign", "Solution"),
)


def test_no_call_is_left_out(fuzzing):
    assert set(fuzzing.CALLS) == set(NAMES)


def test_every_public_name_is_called_or_said_why_not(fuzzing):
    more = importlib.import_module("fuzzing_more_calls")
    assert not set(more.COVERED) & set(more.NOT_CALLED)
    assert set(more.COVERED) | set(more.NOT_CALLED) == set(relnav.__all__)
    assert set(more.COVERED.values()) == set(fuzzing.CALLS)


@pytest.mark.parametrize("name", NAMES)
def test_nothing_breaks_it(fuzzing, tmp_path, name):
    found = fuzzing.fuzz(name, tmp_path, CASES.get(name, EACH), derandomize=True)
    assert {"refused", "given"} & set(found["outcomes"])


def test_a_broken_promise_would_be_found(fuzzing):
    """The check itself can fail."""

    def careless(array):
        array[0] = 1.0

    with pytest.raises(AssertionError, match="arguments stay"):
        fuzzing.asked(careless, np.zeros(3))
    with pytest.raises(AssertionError, match="positive definite"):
        fuzzing.check_covariance([[1.0, 2.0], [2.0, 1.0]])

    class Forgetful:
        seen = 0

        def __getstate__(self):
            return {"seen": self.seen}

        def step(self):
            self.seen += 1
            raise ValueError("no")

    filter_ = Forgetful()
    with pytest.raises(AssertionError, match="as it was"):
        fuzzing.in_turn(filter_, lambda _: None, filter_.step)


@pytest.mark.parametrize("state", [[1e155, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, -1e308]])
def test_a_start_beyond_all_orbits(state):
    """Its range would be infinite beside a finite state."""
    navigator = relnav.Navigator(relnav.load_model("three_beacon_psd"))
    with pytest.raises(ValueError, match=r"state must be up to 1e\+30 in size"):
        navigator.start(0.0, state, np.eye(6))


@pytest.mark.parametrize("name", ["acceleration_m_s2", "delta_v_m_s"])
def test_a_control_beyond_all_thrusters(name):
    navigator = relnav.Navigator(relnav.load_model("three_beacon_psd"))
    navigator.step(0.0, SPOTS)
    with pytest.raises(ValueError, match=rf"{name} must be up to 1e\+30 in size"):
        navigator.step(0.1, SPOTS, **{name: [0.0, 1e31, 0.0]})


def test_seeds_are_whole_numbers():
    """Seed 3.5 was taken for 3."""
    with pytest.raises(ValueError, match=r"seed is 0 or more and below .*, a whole number"):
        relnav.simulate(relnav.load_model("three_beacon_psd"), seed=3.5)


SUN = relnav.aps_sun.SunDirection(np.array([0.0, 0.0, 1.0]), np.diag([1e-8, 1e-8, 0.0]), relnav.Status.OK)
ATTITUDE = {"rate_noise_density_rad2_s3": 1e-10, "initial_rate_sigma_rad_s": 1e-3}
INERTIA = np.diag([300.0, 400.0, 500.0])
FOUND = {
    "an attitude of two rows": (relnav.aps_sun.attitude_observation, (SUN, [0.0, 0.0, 1.0], np.eye(3)[:2]), {}),
    "an attitude that stretches": (relnav.aps_sun.attitude_observation, (SUN, [0.0, 0.0, 1.0], 2.0 * np.eye(3)), {}),
    "a sun at 1e300": (relnav.aps_sun.attitude_observation, (SUN, [0.0, 0.0, 1e300], np.eye(3)), {}),
    "a sigma of 1e300": (
        relnav.aps_sun.attitude_observation,
        (SUN, [0.0, 0.0, 1.0], np.eye(3)),
        {"sun_sigma_rad": 1e300},
    ),
    "no initial rate": (relnav.TargetAttitude, (INERTIA, 1e-3), ATTITUDE | {"initial_rate_sigma_rad_s": None}),
    "an inertia in words": (relnav.TargetAttitude, ({}, 1e-3), ATTITUDE),
    "a year that is none": (
        relnav.dual_field.measure,
        (np.zeros((4, 2)), relnav.load_model("dual_field_star")),
        {"velocity_km_s": np.zeros(3), "epoch_jyear": np.nan},
    ),
    "a complex chaser": (
        lambda: relnav.TargetAttitude(INERTIA, 1e-3, **ATTITUDE).step(0.0).relative(np.eye(3) + 0.0j),
        (),
        {},
    ),
    "a sigma of 10**400": (
        lambda: (
            relnav.TargetAttitude(INERTIA, 1e-3, **ATTITUDE)
            .step(0.0)
            .relative(np.eye(3), chaser_rate_sigma_rad_s=10**400)
        ),
        (),
        {},
    ),
    "a text for a count": (relnav.TargetAttitude, (INERTIA, 1e-3), ATTITUDE | {"restart_after": "8"}),
    "a threshold in words": (relnav.find_stars, (np.zeros((9, 9)),), {"threshold_sigma": "five"}),
    "a gain of 1e-300": (relnav.find_stars, (np.zeros((9, 9)),), {"electrons_per_count": 1e-300}),
    "quaternions of 1e155": (
        relnav.filter_epochs,
        (relnav.load_model("three_beacon_psd"), [0.0], [SPOTS]),
        {"q_cam_from_lvlh": [[1e155, 0.0, 0.0, 0.0]]},
    ),
}


@pytest.mark.parametrize("name", FOUND)
def test_what_was_found(name):
    """TypeError, OverflowError and warnings before."""
    call, arguments, named = FOUND[name]
    with pytest.raises(ValueError, match=r".{20}"):
        call(*arguments, **named)


def test_a_covariance_of_1e308():
    filter_ = relnav.TargetAttitude(INERTIA, 1e-3, **ATTITUDE)
    with pytest.raises(ValueError, match="covariance_rad2 is in rad"):
        filter_.step(0.0, np.eye(3), 1e308 * np.eye(3))
    assert np.isnan(filter_.last_t_s)


def test_two_images_at_one_time_leave_the_velocity_unknown():
    """As plain Python the covariance was turned by what the last time update had left: velocity known exactly."""
    navigator = relnav.PoseNavigator(relnav.load_model("three_marker_vision"))
    spots = [[469.3, 553.7], [553.7, 553.7], [511.5, 511.5]]
    navigator.step(0.1, spots)
    record = navigator.step(0.1, spots)
    assert record.status is relnav.EpochStatus.STARTED
    sigma = np.sqrt(np.diagonal(record.covariance))
    np.testing.assert_allclose(sigma[3:6], navigator.mission.filter.initial_velocity_sigma_m_s, rtol=1e-3)
    assert (sigma[9:] > 1e-5).all()


def test_an_infinite_spot_has_no_positions():
    spots = np.array(SPOTS)
    spots[0, 0] = np.inf
    assert relnav.three_beacon.positions(spots, relnav.load_model("three_beacon_psd")).shape == (0, 3)


@pytest.mark.parametrize("start", [np.nan, np.inf, -np.inf, 1e300, 1.8e18])
def test_a_vehicle_that_starts_at_no_time(start):
    """Its first answer took for ever: a second more was the same time."""
    with pytest.raises(ValueError, match="t_s of the start is a time in seconds"):
        relnav.VehicleNavigator(relnav.load_model("rendezvous_demo"), t_s=start)


@pytest.mark.parametrize(("source", "value"), [("gyro", 1e155), ("gyro", np.inf), ("thrust", 1e200)])
def test_a_vehicle_is_not_told_what_no_sensor_says(source, value):
    """The port's covariance overflowed with a warning."""
    navigator = relnav.VehicleNavigator(relnav.load_model("rendezvous_demo"), monitor=False)
    with pytest.raises(ValueError, match=rf"{source}: three finite numbers up to 10000? in size"):
        navigator.observe(source, 0.1, [value, 0.0, 0.0])


def test_a_vehicle_far_from_time_zero_answers():
    navigator = relnav.VehicleNavigator(relnav.load_model("rendezvous_demo"), t_s=1e11, monitor=False)
    assert np.isfinite(navigator.state(1e11 + 3.0).covariance).all()


@pytest.mark.parametrize("wrong", [np.eye(3)[:2], np.diag([np.inf, 1.0, 1.0]), np.full((3, 3), np.nan)])
def test_a_sun_whose_covariance_is_none_leaves_a_vehicle_as_it_was(wrong):
    """Of another shape it was refused after it had been taken in, and an infinite one was a warning."""
    navigator = relnav.VehicleNavigator(relnav.load_model("rendezvous_demo"), monitor=False)
    before = navigator.state()
    with pytest.raises(ValueError, match=r"sun_aps: a (direction|covariance)"):
        navigator.observe("sun_aps", 0.5, SUN, wrong)
    after = navigator.state()
    assert (after.t_s, navigator.newest_s) == (before.t_s, 0.0)
    assert np.array_equal(after.covariance, before.covariance)
