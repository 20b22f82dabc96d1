"""Thrusters that turn with the chaser during a step, against motion that is integrated without the filter.

Truth: Clohessy and Wiltshire's equations by an integrator, with the attitude of scipy and Kepler's frame.
"""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.rendezvous import stated_frames
from relnav.vehicle.layout import CHASER_ATTITUDE, POSITION, THRUST_DIRECTION, THRUST_SCALE, VELOCITY
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.rows import Rows

COMMAND = np.array([0.004, -0.009, 0.006])
STEP_S, PERIOD_S = 1.0, 0.25
FAST = np.radians([4.0, -2.0, 3.0])
NOISE_M = 1e-3
PLACE = np.array([20.0, 3.0, -1.0, -0.1, 0.02, 0.03])


def moved(vehicle, attitude, pushed, begin, t_s):
    """Motion (6,) after t_s from begin; attitude: the chaser's in inertial axes by time, pushed (3,) m/s^2 its axes."""
    n = vehicle.orbit.mean_motion_rad_s

    def rates(t, y):
        a = stated_frames(vehicle.orbit, np.array([t]))[0] @ attitude(t) @ pushed
        _, across, z, vx, vy, vz = y
        return [vx, vy, vz, a[0] + 2 * n * vz, a[1] - n * n * across, a[2] + 3 * n * n * z - 2 * n * vx]

    edges = np.append(np.arange(0.0, t_s, PERIOD_S), t_s)
    for first, last in itertools.pairwise(edges):  # no step across a jump of the rate
        begin = solve_ivp(rates, (first, last), begin, rtol=1e-12, atol=1e-14, max_step=0.05).y[:, -1]
    return begin


def turning(first, rates):
    """Attitude by time from rates that are held for PERIOD_S each."""

    def attitude(t):
        dcm = first
        for k, rate in enumerate(rates):
            left = t - k * PERIOD_S
            if left > 0.0:
                dcm = (
                    dcm
                    @ Rotation.from_rotvec(rate * (left if k + 1 == len(rates) else min(left, PERIOD_S))).as_matrix()
                )
        return dcm

    return attitude


def stepped(vehicle, rates, t_s=STEP_S):
    """Steps of a filter that knows all but for lasting errors: before it, after it, and what a smoother gets."""
    nav = VehicleNavigator(vehicle, position_m=PLACE[:3], velocity_m_s=PLACE[3:], monitor=False)
    for k, rate in enumerate(rates):
        nav.observe("gyro", k * PERIOD_S, rate)
    filters, steps = nav._filters, []
    filters.motion.on_step = steps.append
    begin = filters.start.estimates._replace(command_m_s2=COMMAND)
    end = filters.motion.settled(begin, filters.samples, t_s)
    return begin, end, steps


@pytest.fixture
def patient(vehicle):
    """Its gyro is not lost within a step."""
    return dataclasses.replace(vehicle, gyro=dataclasses.replace(vehicle.gyro, rate_hz=1.0))


RATES = {
    "held": np.zeros((1, 3)),
    "one rate": FAST[None],
    "other rates": np.array([FAST, -2.0 * FAST, 3.0 * FAST[[1, 2, 0]], FAST]),
    "very fast": 20.0 * FAST[None],
}


@pytest.mark.parametrize("name", RATES)
def test_where_a_push_leads(patient, name):
    """To a tenth of how far the orbit turns in a step, times how far the chaser does."""
    begin, end, _ = stepped(patient, RATES[name])
    attitude = turning(begin.dcm_inertial_from_chaser[0], RATES[name])
    off = np.abs(end.values[0, :6] - moved(patient, attitude, COMMAND, PLACE, STEP_S))
    turns = patient.orbit.mean_motion_rad_s * STEP_S * np.linalg.norm(RATES[name], axis=1).max() * STEP_S
    assert off.max() < (1e-6 + 0.1 * turns) * np.linalg.norm(COMMAND)


def test_where_it_leads_while_the_gyro_is_lost(vehicle):
    """Over more than one step, with the last rate held."""
    begin, end, steps = stepped(vehicle, RATES["one rate"], 2.5)
    assert end.lost is not None
    assert len(steps) == 4  # until it is lost, and three
    attitude = turning(begin.dcm_inertial_from_chaser[0], RATES["one rate"])
    off = np.abs(end.values[0, :6] - moved(vehicle, attitude, COMMAND, PLACE, 2.5))
    assert off.max() < 1e-4 * np.linalg.norm(COMMAND)


@pytest.mark.parametrize("name", RATES)
def test_what_errors_do(patient, name):
    """Columns of the transition against differences: to two thousandths, twice as much as the orbit turns."""
    begin, _, steps = stepped(patient, RATES[name])
    first, h = begin.dcm_inertial_from_chaser[0], 1e-3
    for part, change in (
        (THRUST_SCALE, lambda e: (first, (1.0 + e[0]) * COMMAND)),
        (THRUST_DIRECTION, lambda e: (first, COMMAND + np.cross(e, COMMAND))),
        (CHASER_ATTITUDE, lambda e: (first @ Rotation.from_rotvec(e).as_matrix(), COMMAND)),
    ):
        for column, error in enumerate(h * np.eye(part.stop - part.start)):
            ends = []
            for signed in (error, -error):
                dcm, pushed = change(signed)
                ends.append(moved(patient, turning(dcm, RATES[name]), pushed, PLACE, STEP_S))
            by = (ends[0] - ends[1]) / (2.0 * h)
            assert np.abs(steps[0].F[:6, part.start + column] - by).max() < 2e-3 * np.linalg.norm(COMMAND)


class Place:
    """Where the chaser is, lvlh axes, to a millimetre."""

    lasting = ()
    most_rows = 3

    def placed(self, _name, layout):
        self._size = layout.size

    def taken(self, value, _covariance):
        return np.array(value), NOISE_M**2 * np.eye(3)

    def rows(self, state, value, noise):
        H = np.zeros((3, self._size))
        H[:, POSITION] = np.eye(3)
        return Rows(value - state.values[POSITION], H, noise, 3)


@dataclasses.dataclass
class Truth:
    """Many chasers that spin alike, each with errors of its own, flown for a while; `times` (k,), `place` (k, runs, 3).

    Commands (k, runs, 3) begin at `times`; `dcm` (k, runs, 3, 3) is v_inertial from chaser axes.
    """

    vehicle: object
    rate: np.ndarray
    runs: int
    end_s: float

    def __post_init__(self):
        rng, vehicle, runs, h = np.random.default_rng(41), self.vehicle, self.runs, 0.05
        start, thrust, n, own = vehicle.hand_over, vehicle.thrust, vehicle.orbit.mean_motion_rad_s, vehicle.motion
        self.scale = thrust.scale_sigma * rng.normal(size=runs)
        self.direction = thrust.direction_sigma_rad * rng.normal(size=(runs, 3))
        tilt = Rotation.from_rotvec(start.chaser_attitude_sigma_rad * rng.normal(size=(runs, 3))).as_matrix()
        held = (vehicle.chaser.dcm_chaser_from_lvlh @ stated_frames(vehicle.orbit, np.zeros(1))[0]).T
        slow = own.slow_acceleration_sigma_m_s2 * rng.normal(size=(runs, 3))
        x = vehicle.start_position_m + start.position_sigma_m * rng.normal(size=(runs, 3))
        v = np.array(start.velocity_m_s) + start.velocity_sigma_m_s * rng.normal(size=(runs, 3))
        self.times = np.arange(0.0, self.end_s)
        self.commands = 0.006 * rng.normal(size=(len(self.times), runs, 3))
        self.place, self.velocity, self.dcm = [], [], []
        for t_s, command in zip(self.times, self.commands, strict=True):
            given = (1.0 + self.scale)[:, None] * np.einsum(
                "rij,rj->ri", Rotation.from_rotvec(self.direction).as_matrix(), command
            )
            self.place.append(x)
            self.velocity.append(v)
            self.dcm.append(held @ tilt @ Rotation.from_rotvec(self.rate * t_s).as_matrix())
            for k in range(round(1.0 / h)):
                white = np.sqrt(own.acceleration_noise_density_m2_s3 / h) * rng.normal(size=(runs, 3))

                def rates(y, t, given=given, white=white):
                    dcm = stated_frames(vehicle.orbit, np.array([t]))[0] @ held @ tilt
                    dcm = dcm @ Rotation.from_rotvec(self.rate * t).as_matrix()
                    a = np.einsum("rij,rj->ri", dcm, given) + slow + white
                    a[:, 0] += 2 * n * y[1][:, 2]
                    a[:, 1] -= n * n * y[0][:, 1]
                    a[:, 2] += 3 * n * n * y[0][:, 2] - 2 * n * y[1][:, 0]
                    return np.stack([y[1], a])

                y, t = np.stack([x, v]), t_s + k * h
                k1 = rates(y, t)
                k2 = rates(y + 0.5 * h * k1, t + 0.5 * h)
                k3 = rates(y + 0.5 * h * k2, t + 0.5 * h)
                x, v = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rates(y + h * k3, t + h))


def test_a_spin_is_honest(vehicle):
    """NEES/n of velocity, thruster scale and direction, where a step turns the chaser by 5 deg."""
    gyro, star, rng = vehicle.gyro, vehicle.sensor["star"], np.random.default_rng(42)
    gyro = dataclasses.replace(gyro, rate_hz=4.0)
    vehicle, period_s = dataclasses.replace(vehicle, gyro=gyro), 0.25
    truth = Truth(vehicle, np.radians([3.0, -3.0, 2.7]), 16, 40.0)
    own, ratios = [*range(VELOCITY.start, VELOCITY.stop), *range(THRUST_SCALE.start, THRUST_DIRECTION.stop)], []
    for run in range(truth.runs):
        nav = VehicleNavigator(vehicle, monitor=False, sensors={"place": Place()})
        bias = gyro.bias_sigma_rad_s * rng.normal(size=3)
        mount = Rotation.from_rotvec(-star.mount_sigma_rad * rng.normal(size=3)) * Rotation.from_quat(
            star.q_sensor_from_chaser
        )
        for k, t_s in enumerate(truth.times):
            for part in range(4):
                noise = gyro.random_walk_rad_sqrt_s / np.sqrt(period_s) * rng.normal(size=3)
                nav.observe("gyro", t_s + part * period_s, truth.rate + bias + noise)
            seen = mount * Rotation.from_matrix(truth.dcm[k][run]).inv()
            seen = Rotation.from_rotvec(star.noise_rad * rng.normal(size=3)) * seen
            nav.observe("star", t_s, seen.as_quat())
            nav.observe("place", t_s, truth.place[k][run] + NOISE_M * rng.normal(size=3))
            nav.observe("thrust", t_s, truth.commands[k, run])
        now = nav.state(truth.times[-1])
        error = np.concatenate([truth.velocity[-1][run], [truth.scale[run]], truth.direction[run]]) - now.values[own]
        ratios.append(error @ np.linalg.solve(now.covariance[np.ix_(own, own)], error) / len(own))
    lower, upper = chi_square_interval(len(own) * truth.runs, 0.9999)
    assert lower < np.mean(ratios) < upper
