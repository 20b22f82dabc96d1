"""What a known start sets beside the estimate: search, filters beside the first, copies, logs; and what it refuses."""

import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.accuracy.rendezvous import checkpoint
from relnav.errors import LogError, UsageError
from relnav.estimation.consistency import chi_square_interval, nees
from relnav.files.vehicle_log import filter_vehicle_log, write_vehicle_log
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import TARGET_ATTITUDE, layout_of
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother

FLIGHT = Rendezvous(start_m=10.0, final_m=8.8, as_believed=True)
EVERY = ("values", "covariance", "dcm_lvlh_from_target", "dcm_inertial_from_chaser")
TURN = Rotation.from_rotvec([0.2, -0.9, 0.4]).as_matrix()


def prior(vehicle, size, **sigmas):
    """The file's covariance of the first errors, with 1-sigma of some blocks exchanged."""
    layout = layout_of(vehicle)
    covariance = layout.prior[:size, :size].copy()
    for name, sigma in sigmas.items():
        covariance[layout.by_name[name], layout.by_name[name]] = sigma**2 * np.eye(3)
    return covariance


def at_ten(vehicle, **hand_over):
    begin = {"port_distance_m": (10.0, 0.0, 0.0), "position_sigma_m": 0.1} | hand_over
    return dataclasses.replace(vehicle, hand_over=dataclasses.replace(vehicle.hand_over, **begin))


def seeing(vehicle, *names):
    """The vehicle with these sensors alone."""
    parts = {part: {name: getattr(vehicle, part)[name] for name in names} for part in ("sensor", "models")}
    return dataclasses.replace(vehicle, **parts)


def fed(nav, run, until_s=math.inf, from_s=-math.inf):
    ours = {"gyro", "thrust", *nav.vehicle.sensor}
    for seen in sorted(run.observations, key=lambda observation: observation.t_s):
        if seen.sensor in ours and from_s <= seen.t_s < until_s:
            nav.observe(seen.sensor, seen.t_s, seen.value)
    return nav


def turned_target(vehicle, rng):
    """Rolled about the port's axis by anything, tilted by up to 17 deg, and tumbling at a degree a second or so."""
    roll, tilt = rng.uniform(-math.pi, math.pi), rng.uniform(-0.3, 0.3, 2)
    held = Rotation.from_quat(vehicle.target.q_target_from_lvlh)
    q = Rotation.from_rotvec([roll, 0.0, 0.0]) * held * Rotation.from_rotvec([0.0, *tilt])
    flown = at_ten(vehicle, target_rate_sigma_rad_s=math.radians(1.0))
    return dataclasses.replace(
        flown, target=dataclasses.replace(flown.target, q_target_from_lvlh=tuple(q.as_quat().tolist()))
    )


def test_a_tumbling_target_of_unknown_attitude_is_found_by_its_rate(slow):
    """Stated to 0.05 deg/s in its own axes. With a held one, as the file has it, the search comes to no end."""
    told = at_ten(seeing(slow, "camera", "star"), target_attitude_sigma_rad=math.pi)
    sigma, layout, chi2 = math.radians(0.05), layout_of(told), []
    for seed in range(6):
        rng = np.random.default_rng([9, seed])
        run, now = simulate_rendezvous(turned_target(slow, rng), FLIGHT, seed=3000 + seed), np.zeros(1)
        place = {"position_m": run.truth.motion(now)[0, :3] + 0.1 * rng.normal(size=3)}
        rate = {"target_rate_rad_s": run.truth.target_rate(now)[0] + sigma * rng.normal(size=3)}
        rate["covariance"] = prior(told, 12, target_rate=sigma)
        found = fed(VehicleNavigator(told, **place, **rate, monitor=False), run, 9.0).state()
        held = fed(VehicleNavigator(told, **place, monitor=False), run, 9.0).state()
        assert (found.ambiguous, held.ambiguous) == (False, True)
        smoother = fed(VehicleSmoother(told, **place, **rate, monitor=False), run, 9.0)
        for estimate in (found, *smoother.estimates([1.0])):
            point = checkpoint(run, estimate)
            error, covariance = point.error[layout.by_name["target_attitude"]], point.covariance
            chi2.append(error @ np.linalg.solve(covariance[TARGET_ATTITUDE, TARGET_ATTITUDE], error))
    lower, upper = chi_square_interval(3 * len(chi2) // 2, 0.9999)  # filtered and smoothed are of one flight
    assert lower < np.mean(chi2) / 3.0 < upper


def test_the_covariance_says_whether_the_target_is_looked_for(slow):
    """Not what the file says: known where it does not know, and the other way round."""
    unknown = at_ten(slow, target_attitude_sigma_rad=math.pi)
    assert VehicleNavigator(unknown).state().explanations == 0
    assert VehicleNavigator(unknown, covariance=prior(unknown, 6)).state().explanations == 0
    known = prior(unknown, 12, target_attitude=0.05)
    assert VehicleNavigator(unknown, covariance=known, separation=True).state().explanations == 1
    axis = np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0)
    lean = prior(slow, 12)
    lean[TARGET_ATTITUDE, TARGET_ATTITUDE] += 0.3**2 * np.outer(axis, axis)  # 0.17 rad about each axis
    assert VehicleNavigator(slow, covariance=lean).state().explanations == 0
    with pytest.raises(ValueError, match="separation: the target's attitude has to be known at hand-over"):
        VehicleNavigator(slow, covariance=lean, separation=True)


def test_an_explanation_is_judged_by_what_was_stated(slow):
    """About the stated attitude, along each axis by its own sigma; about the held one if nothing was."""
    known = prior(slow, 12)
    known[TARGET_ATTITUDE, TARGET_ATTITUDE] = np.diag([0.4, 0.2, 0.1]) ** 2
    start = VehicleNavigator(slow, dcm_lvlh_from_target=TURN, covariance=known)._filters._begin
    off = TURN @ Rotation.from_rotvec([0.4, 0.0, 0.0]).as_matrix(), TURN @ Rotation.from_rotvec([0, 0, 0.2]).as_matrix()
    told = TURN, known[TARGET_ATTITUDE, TARGET_ATTITUDE]
    assert [start.contradiction(dcm, *told) for dcm in off] == pytest.approx([1.0, 4.0])
    held = VehicleNavigator(slow)._filters._begin
    turned = held.dcm_lvlh_from_target @ Rotation.from_rotvec([0.02, 0.0, 0.0]).as_matrix()
    once = (0.02 / slow.hand_over.target_attitude_sigma_rad) ** 2
    assert held.contradiction(turned, *told) == pytest.approx(once)


@pytest.fixture(scope="module")
def known():
    """Arguments by a vehicle: all of them, correlated."""

    def arguments(vehicle):
        rng, P = np.random.default_rng(3), prior(vehicle, 15)
        scale, mixed = np.sqrt(np.diagonal(P)), np.cov(rng.normal(size=(15, 40)))
        unit = np.sqrt(np.diagonal(mixed))
        now, held = np.zeros(1), simulate_rendezvous(vehicle, FLIGHT, seed=1).truth
        return {
            "position_m": held.motion(now)[0, :3],
            "velocity_m_s": held.motion(now)[0, 3:],
            "dcm_lvlh_from_target": held.dcm_frame_from_target(now)[0],
            "target_rate_rad_s": held.target_rate(now)[0],
            "dcm_inertial_from_chaser": held.dcm_chaser_from_inertial(now)[0].T,
            "covariance": mixed * np.outer(scale / unit, scale / unit),
        }

    return arguments


def test_every_filter_starts_from_it(slow, known):
    """The first, its monitor, those without each sensor; what they hold is not the caller's array."""
    vehicle, given = at_ten(slow), known(at_ten(slow))
    kept = {name: value.copy() for name, value in given.items()}
    nav = VehicleNavigator(vehicle, **given, separation=True)
    for value in given.values():
        value[:] = 0.0
    at = nav._filters.start.estimates
    assert len(at.values) == 2 + 2 + len(vehicle.sensor)
    rest = layout_of(vehicle).prior[15:18, 15:18]
    for f in range(len(at.values)):
        state = at.of(f)
        np.testing.assert_allclose(state.covariance[:15, :15], kept["covariance"], rtol=1e-14)
        np.testing.assert_array_equal(state.covariance[15:18, :18], np.hstack([np.zeros((3, 15)), rest]))
        np.testing.assert_array_equal(state.values[:3], kept["position_m"])
        np.testing.assert_array_equal(state.dcm_lvlh_from_target, kept["dcm_lvlh_from_target"])
        np.testing.assert_array_equal(state.dcm_inertial_from_chaser, kept["dcm_inertial_from_chaser"])
    sigma = {block.name: block.sigma for block in nav.layout.blocks}
    variances = np.diagonal(kept["covariance"])
    assert sigma["velocity"] == pytest.approx(np.sqrt(variances[3:6].mean()))
    assert sigma["gyro_bias"] == pytest.approx(vehicle.gyro.bias_sigma_rad_s)


def test_those_without_a_sensor_are_honest(slow, known):
    """NEES over the port's position and attitude in each of them, after some ten images, truth drawn from it."""
    vehicle, runs, found = at_ten(slow), 16, {}
    given = known(vehicle)
    covariance, by = given.pop("covariance"), {}
    root = np.linalg.cholesky(covariance)
    for k in range(runs):
        run, now = simulate_rendezvous(vehicle, FLIGHT, seed=3100 + k), np.zeros(1)
        error = root @ np.random.default_rng(k).normal(size=15)
        by["position_m"], by["velocity_m_s"] = np.split(run.truth.motion(now)[0] - error[:6], 2)
        turns = [Rotation.from_rotvec(-error[i : i + 3]).as_matrix() for i in (6, 12)]
        by["dcm_lvlh_from_target"] = run.truth.dcm_frame_from_target(now)[0] @ turns[0]
        by["target_rate_rad_s"] = run.truth.target_rate(now)[0] - error[9:12]
        by["dcm_inertial_from_chaser"] = run.truth.dcm_chaser_from_inertial(now)[0].T @ turns[1]
        nav = fed(VehicleNavigator(vehicle, **by, covariance=covariance, separation=True), run, 5.0)
        estimate = nav.state(5.0)
        for name, port in estimate.without.items():
            point = checkpoint(run, dataclasses.replace(estimate, port=port))
            place = np.r_[0:3, 6:9]
            found.setdefault(name, []).append((point.port_error[place], point.port_covariance[np.ix_(place, place)]))
    lower, upper = chi_square_interval(6 * runs, 0.9999)
    assert set(found) == {"gyro", "thrust", *vehicle.sensor}
    for name, values in found.items():
        ratio = np.mean(nees(*map(np.stack, zip(*values, strict=True)))) / 6.0
        assert lower < ratio < upper, name


def test_a_chaser_is_held_where_it_was_stated(slow):
    """Before a sample of the gyro, and in the filter that has none, it turns with the orbit in its own axes."""
    nav = VehicleNavigator(slow, dcm_inertial_from_chaser=TURN, separation=True)
    frame, filters = nav._filters.frame, nav._filters
    expected = frame.held_rate(frame.dcm_lvlh_from_inertial(0.0) @ TURN, 0.0)
    np.testing.assert_allclose(nav.state().chaser_rate_rad_s, expected, rtol=1e-12)
    at = filters.motion.settled(filters.start.estimates, filters.samples, 20.0)
    there = frame.dcm_lvlh_from_inertial(20.0) @ at.dcm_inertial_from_chaser[filters._without["gyro"]]
    begun = frame.dcm_lvlh_from_inertial(0.0) @ TURN
    assert np.linalg.norm(rotation_vector_between(there, begun)) < 1e-9


@pytest.mark.parametrize("way", [copy.copy, copy.deepcopy, lambda nav: pickle.loads(pickle.dumps(nav))])
def test_a_copy_goes_on_bit_for_bit(slow, known, way):
    vehicle = at_ten(slow)
    run = simulate_rendezvous(vehicle, FLIGHT, seed=7)
    nav = fed(VehicleNavigator(vehicle, **known(vehicle)), run, 1.0)
    other = way(nav)
    one, two = (fed(each, run, 3.0, 1.0).state() for each in (nav, other))
    assert one.t_s > 2.0
    for name in EVERY:
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


def test_one_navigator_takes_over_from_another(slow, known):
    """The port's place and attitude, and how well they are known, are those that the other had."""
    vehicle = at_ten(slow)
    run = simulate_rendezvous(vehicle, FLIGHT, seed=7)
    before = fed(VehicleNavigator(vehicle, **known(vehicle)), run, 3.0).state()
    after = VehicleNavigator(
        vehicle,
        t_s=before.t_s,
        position_m=before.motion[:3],
        velocity_m_s=before.motion[3:],
        covariance=before.covariance[:15, :15],
        dcm_lvlh_from_target=before.dcm_lvlh_from_target,
        target_rate_rad_s=before.target_rate_rad_s,
        dcm_inertial_from_chaser=before.dcm_inertial_from_chaser,
    ).state()
    assert after.t_s == before.t_s
    np.testing.assert_allclose(after.port.position_m, before.port.position_m, rtol=1e-12, atol=1e-12)
    place = np.ix_(np.r_[0:3, 6:9], np.r_[0:3, 6:9])
    np.testing.assert_allclose(after.port.covariance[place], before.port.covariance[place], rtol=1e-9, atol=1e-20)


def test_a_start_that_is_wrong_is_recovered(slow, known):
    """Position off by 5 m with 0.1 m stated, and the target turned by 40 deg: what was stated is forgotten."""
    vehicle = at_ten(slow)
    run = simulate_rendezvous(vehicle, dataclasses.replace(FLIGHT, final_m=7.5), seed=8)
    given = known(vehicle)
    given["position_m"] = given["position_m"] + [4.0, 2.0, -2.0]
    given["dcm_lvlh_from_target"] = given["dcm_lvlh_from_target"] @ Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()
    now = fed(VehicleNavigator(vehicle, **given), run).state()
    assert (now.restarts > 0, now.ambiguous) == (True, False)
    point = checkpoint(run, now)
    assert point.port_error @ np.linalg.solve(point.port_covariance, point.port_error) < 40.0  # once in 14,000


@pytest.mark.parametrize("smooth", [False, True])
def test_a_log_is_filtered_from_it(slow, known, tmp_path, smooth):
    """The same bits as by the navigator; of rows before the start the last command alone is used."""
    vehicle = at_ten(slow)
    run = simulate_rendezvous(vehicle, FLIGHT, seed=7)
    write_vehicle_log(run, tmp_path / "log.csv", {})
    start = known(vehicle) | {"t_s": 1.003}
    found = filter_vehicle_log(tmp_path / "log.csv", vehicle, smooth=smooth, start=start)
    assert found[0].t_s == 2.003
    nav = (VehicleSmoother if smooth else VehicleNavigator)(vehicle, **start)
    command = max((one for one in run.others if one.sensor == "thrust" and one.t_s < 1.003), key=lambda one: one.t_s)
    nav.observe("thrust", 1.003, command.value)
    fed(nav, run, math.inf if smooth else 2.003, 1.003)
    expected = nav.estimates([one.t_s for one in found])[0] if smooth else nav.state(2.003)
    for name in EVERY:
        assert getattr(found[0], name).tobytes() == getattr(expected, name).tobytes()
    with pytest.raises(
        UsageError, match=r"start: there is no 'place'; what may be known at the start is t_s, position"
    ):
        filter_vehicle_log(tmp_path / "log.csv", vehicle, smooth=smooth, start={"place": [1.0, 2.0, 3.0]})
    with pytest.raises(LogError, match=r"position_m: three finite numbers"):
        filter_vehicle_log(tmp_path / "log.csv", vehicle, smooth=smooth, start={"position_m": [1.0, 2.0]})


def uneven(size):
    covariance = 1e-4 * np.eye(size)
    covariance[0, 1] = 1e-5
    return covariance


REFUSED = {
    "shape": ({"covariance": np.eye(9)}, r"covariance has shape \(6, 6\) of position .* too; got \(9, 9\)"),
    "three": ({"covariance": np.ones(6)}, r"covariance has shape \(6, 6\) of position .* too; got \(6,\)"),
    "nan": ({"covariance": np.full((6, 6), np.nan)}, "covariance must be finite"),
    "huge": ({"covariance": 1e31 * np.eye(6)}, r"covariance must be up to 1e\+30 in size"),
    "zero": ({"covariance": np.zeros((6, 6))}, "covariance has variances above zero; its diagonal is"),
    "uneven": ({"covariance": uneven(6)}, "a covariance is a symmetric matrix"),
    "negative": ({"covariance": 1e-4 * (2.0 - np.eye(6))}, "the covariance is not positive semidefinite"),
    "chaser": ({"covariance": np.diag([1e-4] * 12 + [0.05] * 3)}, r"chaser's attitude is up to 0.2 rad .*; got 0.2236"),
    "target": ({"covariance": np.diag([1e-4] * 6 + [10.0] * 3 + [1e-4] * 3)}, "target's attitude is up to pi in every"),
    "spin": (
        {"covariance": np.diag([1e-4] * 9 + [101.0] * 3)},
        r"target's rate is up to 10 rad/s in every .*; got 10.05",
    ),
    "turn": ({"dcm_lvlh_from_target": 2.0 * np.eye(3)}, r"dcm_lvlh_from_target is a rotation matrix \(3, 3\); got"),
    "quaternion": (
        {"dcm_inertial_from_chaser": [0.0, 0.0, 0.0, 1.0]},
        r"dcm_inertial_from_chaser is a rotation matrix",
    ),
    "rate": ({"target_rate_rad_s": [0.0, 0.0, 20.0]}, "target_rate_rad_s: three finite numbers up to 10 in size are"),
    "velocity": ({"velocity_m_s": [0.0, np.inf, 0.0]}, "velocity_m_s: three finite numbers"),
}


@pytest.mark.parametrize("what", REFUSED)
@pytest.mark.parametrize("kind", [VehicleNavigator, VehicleSmoother])
def test_what_is_no_start_is_refused(slow, what, kind):
    arguments, said = REFUSED[what]
    with pytest.raises(ValueError, match=said):
        kind(slow, **arguments)


def test_an_attitude_that_nobody_can_find_is_refused(slow):
    blind = seeing(slow, "star")
    with pytest.raises(ValueError, match=r"covariance: above 11.5 deg, 1-sigma, .* no sensor sees any"):
        VehicleNavigator(blind, covariance=prior(slow, 12, target_attitude=1.0))
