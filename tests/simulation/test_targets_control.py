"""A target of a rendezvous that controls its attitude, and one that nobody controls; the note where a filter is misled.

The free one's truth is scipy's: Euler's equations with gravity's gradient, its attitude an inertial quaternion.
"""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation, Slerp

import relnav
from relnav.accuracy.campaign_plan import Plan, fly_batch
from relnav.accuracy.rendezvous import true_ports
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.dispersed_vehicle import control_note
from relnav.simulation.facing import Facing
from relnav.simulation.rendezvous import SWAY_RAD, Rendezvous, Truth, stated_states
from relnav.simulation.vehicle_dispersions import VehicleScenario, VehicleSpread
from relnav.simulation.vehicle_numbers import OfRun

RUNS, STATES = 8, 12
APPROACH = Rendezvous(start_m=8.0, final_m=6.0, slow_m_s=0.1)


@pytest.fixture(scope="module")
def vehicle():
    """Two sensors and a slow gyro; the target's rate is handed over to 0.3 deg/s."""
    whole = relnav.load_model("rendezvous_demo")
    sensor = {name: dataclasses.replace(whole.sensor[name], rate_hz=2.0) for name in ("camera", "star")}
    gyro = dataclasses.replace(whole.gyro, rate_hz=20.0)
    hand_over = dataclasses.replace(whole.hand_over, target_rate_sigma_rad_s=np.radians(0.3))
    return dataclasses.replace(whole, gyro=gyro, sensor=sensor, hand_over=hand_over)


def with_density(vehicle, density):
    return dataclasses.replace(vehicle, target=dataclasses.replace(vehicle.target, rate_noise_density_rad2_s3=density))


def scenario(target, **spread):
    return VehicleScenario(dataclasses.replace(APPROACH, target=target), VehicleSpread(**spread))


def free_body(truth, t):
    """Attitudes against inertial axes and rates at times t of a body that begins as the truth does."""
    inertia, orbit = np.array(truth.vehicle.target.inertia_kg_m2), truth.vehicle.orbit
    first = truth.dcm_frame_from_inertial(0.0)[0].T @ truth.dcm_frame_from_target(0.0)[0]

    def derivative(now, x):
        v, s, w = x[:3], x[3], x[4:]
        place = stated_states(orbit, np.array([now]))[0][0]
        nadir = Rotation.from_quat(x[:4]).inv().apply(-place / np.linalg.norm(place))
        torque = 3.0 * orbit.mean_motion_rad_s**2 * np.cross(nadir, inertia @ nadir) - np.cross(w, inertia @ w)
        return np.concatenate([0.5 * (s * w + np.cross(v, w)), [-0.5 * v @ w], np.linalg.solve(inertia, torque)])

    begin = np.append(Rotation.from_matrix(first).as_quat(), truth.target_rate(0.0)[0])
    x = solve_ivp(derivative, (0.0, t[-1]), begin, "DOP853", t_eval=t, rtol=1e-10, atol=1e-12).y.T
    return Rotation.from_quat(x[:, :4]), x[:, 4:]


def test_nothing_but_gravity_turns_a_free_target(vehicle):
    """For 145 s. The true orbit is 1e-3 off the stated one, by which gravity's gradient is 3e-3 of 4e-6 rad/s^2 off."""
    flight = dataclasses.replace(APPROACH, start_m=20.0, target="free")
    truth = Truth(with_density(vehicle, 1e-20), flight, OfRun(1, 2, list(vehicle.sensor)))
    t = np.linspace(0.0, truth.end_s, 20)
    attitude, rate = free_body(truth, t)
    told = np.swapaxes(truth.dcm_frame_from_inertial(t), 1, 2) @ truth.dcm_frame_from_target(t)
    assert np.abs((attitude.inv() * Rotation.from_matrix(told)).as_rotvec()).max() < 2e-4
    assert np.abs(truth.target_rate(t) - rate).max() < 2e-6
    assert np.linalg.norm(rate[0]) > np.radians(0.1)


def test_the_stated_torques_push_it(vehicle):
    """Changes of the rate over a second, in a body that turns slowly: chi-square of the stated density."""
    held = dataclasses.replace(vehicle, hand_over=relnav.load_model("rendezvous_demo").hand_over)
    truth = Truth(held, dataclasses.replace(APPROACH, start_m=20.0, target="free"), OfRun(3, 4, list(vehicle.sensor)))
    rates = truth.target_rate(np.arange(0.0, truth.end_s, 1.0))
    low, high = chi_square_interval(rates[1:].size, 0.999)
    assert low < np.mean(np.diff(rates, axis=0) ** 2) / vehicle.target.rate_noise_density_rad2_s3 < high


def test_the_chaser_turns_with_it(vehicle):
    """From the held attitude to the one that faces the port, within the sway; its thrusters carry it round.

    It lags by what guidance of 0.06 rad/s does not foresee, the target's angular acceleration of some 0.4 w^2: 0.01 of
    the distance at half a degree a second.
    """
    names, flight = list(vehicle.sensor), dataclasses.replace(APPROACH, start_m=24.0, target="free")
    truth = Truth(vehicle, flight, OfRun(1, 2, names))
    held, target = vehicle.chaser.dcm_chaser_from_lvlh, vehicle.target.dcm_target_from_lvlh.T
    first = Rotation.from_matrix(truth.dcm_chaser_from_frame(0.0)[0] @ held.T).magnitude()
    assert first < 4.0 * vehicle.hand_over.chaser_attitude_sigma_rad
    t = np.linspace(160.0, truth.end_s - 0.5, 20)
    assert Rotation.from_matrix(truth.dcm_frame_from_target(t[:1])[0] @ target.T).magnitude() > np.radians(20.0)
    facing = truth.dcm_chaser_from_frame(t) @ truth.dcm_frame_from_target(t)
    off = Rotation.from_matrix(facing @ (held @ target).T).magnitude()
    assert off.max() < 2.0 * np.sqrt(3.0) * SWAY_RAD + np.radians(0.1)
    port = true_ports(truth, t)[0][:, :3]
    assert (np.abs(port[:, 1:]).max(axis=1) < 0.05 * port[:, 0]).all()
    end = truth.dcm_chaser_from_inertial([truth.end_s, truth.end_s + 0.05])
    rate = Rotation.from_matrix(end[1] @ end[0].T).magnitude() / 0.05
    assert rate == pytest.approx(np.linalg.norm(truth.target_rate(truth.end_s)[0]), rel=0.05)


def test_what_is_off_at_the_start_fades():
    """To 1 / e in 40 s, beside a target that turns about one axis, and on at the last rate after the flight's end."""
    spin = np.array([0.0, 0.0, 0.02])
    turns = Slerp([0.0, 60.0], Rotation.from_rotvec([0.0 * spin, 60.0 * spin]))
    met, off = np.diag([1.0, -1.0, -1.0]), Rotation.from_rotvec([0.06, -0.03, 0.02])
    chaser = Facing(turns, spin, met, off.as_matrix() @ met).dcm_chaser_from_inertial(np.array([0.0, 40.0, 80.0]))
    for attitude, seconds, left in zip(chaser, (0.0, 40.0, 80.0), (1.0, np.exp(-1.0), np.exp(-2.0)), strict=True):
        meant = met @ Rotation.from_rotvec(seconds * spin).as_matrix().T
        assert Rotation.from_matrix(attitude @ meant.T).as_rotvec() == pytest.approx(left * off.as_rotvec(), abs=1e-12)


def test_control_takes_out_the_rate(vehicle):
    truth = Truth(vehicle, dataclasses.replace(APPROACH, start_m=60.0), OfRun(1, 2, list(vehicle.sensor)))
    held = vehicle.orbit.mean_motion_rad_s
    off = np.linalg.norm(truth.target_rate([0.0, truth.end_s]) - [0.0, -held, 0.0], axis=1)
    assert off[0] > np.radians(0.1)
    assert off[1] < 0.02 * off[0]


def nees(vehicle, flown):
    """Mean NEES of the port's twelve states at the end, by their number."""
    plan = Plan(vehicle, flown, "fused", 5, RUNS)
    batch = fly_batch(plan, range(RUNS))
    assert set(batch.reasons) == {""}
    mean = batch.figures[:, plan.columns.index("final_nees")].mean() / STATES
    print(round(mean, 2))
    return mean


def test_nees_of_a_free_target_and_of_a_controlled_one(vehicle):
    """Of the free one, of the controlled one, and of this with the density of the note."""
    low, high = chi_square_interval(RUNS * STATES, 0.999)
    assert low < nees(vehicle, scenario("free")) < high
    assert nees(vehicle, scenario("controlled")) > 5.0
    density = float(control_note(vehicle, scenario("controlled")).rpartition(" ")[2])
    assert nees(with_density(vehicle, density), scenario("controlled")) < high


def test_the_note(vehicle):
    note = control_note(vehicle, scenario("controlled"))
    assert note == (
        "the target's control changes its rate by 0.3 deg/s (1-sigma) within 100 s, and by "
        "target.rate_noise_density_rad2_s3 the filter expects 0.0057 deg/s: its covariance is too small. For a target "
        'that nobody controls set approach.target to "free"; for one that is controlled, that density to 3e-07'
    )
    assert Plan(vehicle, scenario("controlled"), "fused", 0, 1).note == note
    assert control_note(vehicle, scenario("free")) == ""
    begin = dataclasses.replace(vehicle.hand_over, target_rate_rad_s=(0.0, 0.0, 0.02))
    assert control_note(dataclasses.replace(vehicle, hand_over=begin), scenario("controlled")) == ""
    believed = VehicleScenario(dataclasses.replace(APPROACH, as_believed=True))
    assert control_note(vehicle, believed) == ""
    assert control_note(vehicle, scenario("controlled", target_rate_sigma_rad_s=np.radians(0.01))) == ""
    turned = scenario("controlled", target_rate_sigma_rad_s=0.0, target_attitude_sigma_rad=np.radians(10.0))
    assert "by 0.039 deg/s" in control_note(vehicle, turned)  # 0.394 x 0.01 rad/s x 10 deg
    assert control_note(relnav.load_model("rendezvous_demo"), scenario("controlled")) == ""
    assert Plan(relnav.load_model("three_beacon_psd"), relnav.load_scenario(), "fix", 0, 1).note == ""


def test_another_target():
    with pytest.raises(ValueError, match='target is "controlled" or "free"; got \'held\''):
        Rendezvous(target="held")
