"""The truth of a rendezvous: two orbits, two bodies that turn, thrusters that are off for a whole run.

Nothing here is the filter's: both orbits are integrated in inertial space (two-body, J2, drag), the target is a rigid
body under its own control or free, and the chaser's attitude is a smooth function of time. Only the frame in which
relative motion is told, `lvlh_ccsds` of the orbit that the vehicle file states, is the same; the true orbit is another.

With `as_believed` truth is as the filter believes it to be: the stated orbit, and white and slow accelerations and
torques of the stated sizes. Torques on a target that does not control its attitude are always those.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from relnav.arrays import Matrix, Stack, Vector
from relnav.dynamics.two_body import MU_EARTH_M3_S2
from relnav.simulation.facing import SETTLING_S, Facing
from relnav.simulation.orbits import J2_EARTH
from relnav.simulation.rendezvous_motion import (
    BANDWIDTH_RAD_S,
    GUIDANCE_STEPS,
    STEP_S,
    Course,
    Turning,
    integrate,
)
from relnav.simulation.target_rotation import true_anomaly_rad
from relnav.simulation.vehicle_numbers import VehicleNumbers
from relnav.spacecraft import InertialOrbit, Vehicle

SWAY_RAD, SWAY_PERIODS_S = math.radians(0.08), (60.0, 170.0)
"""Of the chaser's attitude about the meant one, each axis and period; what is off at the start fades in SETTLING_S."""
CONTROLLED: Final = "controlled"
FREE: Final = "free"
"""Targets."""


@dataclass(frozen=True)
class Rendezvous:
    """An approach along the axis of the target's port, whatever way it points.

    Attributes
    ----------
    start_m, final_m : float
        Port from port.
    fast_m_s, slow_m_s, slow_from_m : float
        Closing rate, and that from where the approach is slow.
    eccentricity : float
        By which the true orbit departs from the stated one, anomaly drawn.
    air_density_kg_m3, drag_m2_kg, drag_difference_m2_kg : float
        Cd A / m of the target, and by how much the chaser's is more.
    target : {"controlled", "free"}
        Whether the target's own control turns it to the attitude that the vehicle file states and holds it there, or
        nothing but gravity's gradient and white torques of the stated size turn it. One whose rate the file states is
        free. The chaser turns with a free target, from the held attitude on, so that its sensors stay on the port.
    as_believed : bool
        Truth as the filter believes it to be: white and slow accelerations, and a target that is never controlled; the
        chaser turns with it only if it is free.
    """

    start_m: float = 30.0
    final_m: float = 1.0
    fast_m_s: float = 0.1
    slow_m_s: float = 0.03
    slow_from_m: float = 5.0
    eccentricity: float = 1e-3
    air_density_kg_m3: float = 1e-12
    drag_m2_kg: float = 0.01
    drag_difference_m2_kg: float = 0.01
    target: Literal["controlled", "free"] = CONTROLLED
    as_believed: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.final_m < self.start_m:
            raise ValueError(f"0 < final_m < start_m is expected; got {self.final_m!r}, {self.start_m!r}")
        if not (self.fast_m_s > 0.0 and self.slow_m_s > 0.0):
            raise ValueError(f"closing rates are positive; got {self.fast_m_s!r}, {self.slow_m_s!r}")
        if self.target not in (CONTROLLED, FREE):
            raise ValueError(f'target is "controlled" or "free"; got {self.target!r}')

    def profile(self) -> Matrix:
        """Port distance and its rate, (m, 2), every STEP_S from start to end; the rate changes over metres."""
        rows, reach = [], self.start_m
        while reach > self.final_m:
            brake = (reach - self.slow_from_m) * BANDWIDTH_RAD_S + self.slow_m_s
            speed = min(max(brake, self.slow_m_s), self.fast_m_s)
            rows.append([reach, -speed])
            reach -= speed * STEP_S
        return np.array([*rows, [reach, -self.slow_m_s]])


def is_free(vehicle: Vehicle, flight: Rendezvous) -> bool:
    """Whether the target is one that does not control its attitude."""
    return flight.target == FREE or vehicle.hand_over.target_rate_rad_s is not None


class Truth:
    """What truly happened, at any time of the run.

    Attributes
    ----------
    vehicle : Vehicle
        As its file states it.
    end_s : float
    lasting : dict
        Errors that last, by the names of the filter's blocks without those of sensors: "thrust.scale",
        "thrust.direction".
    commands : list of (t_s, (3,))
        Commanded accelerations, chaser axes, each until the next.
    slow_acceleration : (m, 3)
        At each step; zero unless as believed.
    """

    def __init__(self, vehicle: Vehicle, flight: Rendezvous, numbers: VehicleNumbers) -> None:
        self.vehicle, self._flight, self._numbers = vehicle, flight, numbers
        start, thrust = vehicle.hand_over, vehicle.thrust
        self.lasting = {
            "thrust.scale": numbers.once("thrust_scale", 1) * thrust.scale_sigma,
            "thrust.direction": numbers.once("thrust_turn", 3) * thrust.direction_sigma_rad,
        }
        self._first_turn = numbers.once("chaser_attitude", 3) * start.chaser_attitude_sigma_rad
        self._phases = numbers.angles("sway", (len(SWAY_PERIODS_S), 3))
        self.commands: list[tuple[float, Vector]] = []
        self._facing: Facing | None = None
        self._fly(flight.profile())

    def dcm_frame_from_inertial(self, t_s: Vector) -> Stack:
        """`lvlh_ccsds` of the stated orbit, (k, 3, 3)."""
        return stated_frames(self.vehicle.orbit, np.atleast_1d(t_s))

    def dcm_chaser_from_frame(self, t_s: Vector) -> Stack:
        """The chaser's attitude against that frame, at times (k,); (k, 3, 3)."""
        t = np.atleast_1d(t_s)[:, None]
        turn = self._first_turn * np.exp(-t / SETTLING_S)
        for period, phase in zip(SWAY_PERIODS_S, self._phases, strict=True):
            grown = SWAY_RAD * np.exp(-SETTLING_S / np.maximum(t, 1e-9))
            turn = turn + grown * np.sin(2.0 * math.pi * t / period + phase)
        turned: Stack = Rotation.from_rotvec(-turn).as_matrix()
        return turned @ self._meant(np.atleast_1d(t_s))

    def dcm_chaser_from_inertial(self, t_s: Vector) -> Stack:
        """Its inertial attitude, at times (k,); (k, 3, 3)."""
        return self.dcm_chaser_from_frame(t_s) @ self.dcm_frame_from_inertial(t_s)

    def motion(self, t_s: Vector) -> Matrix:
        """Centre of mass from centre of mass and its rate in that frame, (k, 6)."""
        t = np.atleast_1d(t_s)
        return np.concatenate([self._position(t), self._position(t, 1)], axis=1)

    def dcm_frame_from_target(self, t_s: Vector) -> Stack:
        """The target's attitude against that frame, at times (k,); (k, 3, 3)."""
        t = np.atleast_1d(t_s)
        target: Stack = self._target(t).as_matrix()
        return self.dcm_frame_from_inertial(t) @ target

    def target_rate(self, t_s: Vector) -> Matrix:
        """Inertial rate of the target, its axes, (k, 3) rad/s."""
        t = np.atleast_1d(t_s)
        return np.stack([np.interp(t, self._times, self._rates[:, i]) for i in range(3)], axis=1)

    def slow_acceleration_at(self, t_s: float) -> Vector:
        """The slow acceleration, (3,) m/s^2; zero unless as believed."""
        return np.array([np.interp(t_s, self._times, self.slow_acceleration[:, i]) for i in range(3)])

    def times_of(self, ranges_m: Sequence[float]) -> Vector:
        """When the planned port distance passes each of these, (k,) s; a step within the ends for what is beyond."""
        times = [np.interp(-reach, -self._profile[:, 0], self._times) for reach in ranges_m]
        return np.clip(np.array(times, dtype=np.float64), STEP_S, self.end_s - STEP_S)

    def _meant(self, t: Vector) -> Stack:
        """The attitude that the chaser is meant to have against that frame, (k, 3, 3), or (3, 3) where it is held."""
        if self._facing is None:
            return self.vehicle.chaser.dcm_chaser_from_lvlh
        return self._facing.dcm_chaser_from_inertial(t) @ self.dcm_frame_from_inertial(t).transpose(0, 2, 1)

    def _fly(self, profile: Matrix) -> None:
        self._profile = profile
        vehicle, numbers = self.vehicle, self._numbers
        count = len(profile)
        self._times: Vector = np.arange(count, dtype=np.float64) * STEP_S
        self.end_s = float(self._times[-1])
        frames = self.dcm_frame_from_inertial(self._times)
        y = self._start(frames[0])
        self.slow_acceleration = self._slow(count)
        begin, target = vehicle.hand_over, vehicle.target
        turn = numbers.once("target_attitude", 3) * begin.target_attitude_sigma_rad
        held = self._held_rates()
        rate = held[0] if begin.target_rate_rad_s is None else np.array(begin.target_rate_rad_s)
        rate = rate + numbers.once("target_rate", 3) * begin.target_rate_sigma_rad_s
        first = Rotation.from_matrix(frames[0].T @ target.dcm_target_from_lvlh.T) * Rotation.from_rotvec(turn)
        pushed, pushes = self._noise(count)
        course = Course(
            frames,
            self._frame_rates(),
            self.dcm_chaser_from_frame(self._times),
            profile,
            self.slow_acceleration + pushed,
        )
        turning = Turning(
            first.as_matrix(),
            rate,
            np.array(target.inertia_kg_m2),
            target.dcm_target_from_lvlh,
            held,
            pushes,
        )
        errors = self.lasting["thrust.scale"], self.lasting["thrust.direction"]
        thrust = np.concatenate([*errors, [vehicle.thrust.largest_m_s2]])
        ports = np.array([target.port_position_m, vehicle.chaser.port_position_m])
        environment = self._environment()
        if is_free(vehicle, self._flight):  # its rotation does not depend on what the chaser does
            flown = integrate(y.copy(), course, turning, environment, thrust, ports)
            held = vehicle.chaser.dcm_chaser_from_lvlh
            self._facing = Facing(
                Slerp(self._times, Rotation.from_matrix(flown.attitudes)),
                flown.rates[-1],
                held @ target.dcm_target_from_lvlh.T,
                held @ frames[0],
            )
            course = replace(course, chaser=self.dcm_chaser_from_frame(self._times), turns_too=True)
        flown = integrate(y, course, turning, environment, thrust, ports)
        self._rates = flown.rates
        self.commands = list(zip(self._times[::GUIDANCE_STEPS].tolist(), flown.commands, strict=True))
        self._position = CubicHermiteSpline(self._times, flown.track[:, :3], flown.track[:, 3:])
        self._target = Slerp(self._times, Rotation.from_matrix(flown.attitudes))

    def _start(self, frame: Matrix) -> Matrix:
        """Inertial state of both, (4, 3): target r, v, chaser r, v; frame: `lvlh_ccsds` then."""
        vehicle, flight, numbers = self.vehicle, self._flight, self._numbers
        r, v, w0 = stated_state(vehicle.orbit, 0.0)
        y = np.zeros((4, 3))
        y[0], y[1] = r, v
        if not flight.as_believed:
            phase = float(numbers.angles("orbit", (1,))[0])
            size = flight.eccentricity * np.linalg.norm(v)
            y[1] += size * (np.sin(phase) * r / np.linalg.norm(r) + 0.5 * np.cos(phase) * v / np.linalg.norm(v))
        begin = vehicle.hand_over
        place = vehicle.start_position_m + numbers.once("start", 3) * begin.position_sigma_m
        speed = np.array(begin.velocity_m_s) + numbers.once("velocity", 3) * begin.velocity_sigma_m_s
        y[2] = y[0] + frame.T @ place
        y[3] = y[1] + frame.T @ (speed + np.cross(w0, place))
        return y

    def _environment(self) -> Vector:
        """As `orbits` has it."""
        flight = self._flight
        air = 0.0 if flight.as_believed else flight.air_density_kg_m3
        ballistic = flight.drag_m2_kg, flight.drag_m2_kg + flight.drag_difference_m2_kg
        return np.array([MU_EARTH_M3_S2, 0.0 if flight.as_believed else J2_EARTH, air, *ballistic])

    def _noise(self, count: int) -> tuple[Matrix, Matrix]:
        """What pushes the chaser, (m, 3) m/s^2, and turns the target, (m, 3) rad/s^2, step by step.

        Of a target that controls itself the latter is (0, 3).
        """
        vehicle, believed = self.vehicle, self._flight.as_believed
        free = believed or is_free(vehicle, self._flight)
        drawn = self._numbers.noise("motion").normal(size=(count, 2 if free else 1, 3))
        white = math.sqrt(vehicle.motion.acceleration_noise_density_m2_s3 / STEP_S) * believed
        density = vehicle.target.rate_noise_density_rad2_s3
        pushes = math.sqrt(density / STEP_S) * drawn[:, 1] if free else np.empty((0, 3))
        return white * drawn[:, 0], pushes

    def _frame_rates(self) -> Vector:
        """Rate of `lvlh_ccsds` about its own y axis at each step, (m,) rad/s."""
        return stated_states(self.vehicle.orbit, self._times)[2]

    def _held_rates(self) -> Matrix:
        """Inertial rate of a target that is held in that frame at each step, its axes, (m, 3) rad/s."""
        orbit, turns = self.vehicle.orbit, self._frame_rates()
        if orbit.eccentricity == 0.0:
            turns[:] = -orbit.mean_motion_rad_s  # to the last digit
        held: Matrix = turns[:, None] * self.vehicle.target.dcm_target_from_lvlh[:, 1]
        return held

    def _slow(self, count: int) -> Matrix:
        """The slow acceleration as the filter believes in it, (m, 3); zero otherwise."""
        motion, out = self.vehicle.motion, np.zeros((count, 3))
        if self._flight.as_believed:
            fade = math.exp(-STEP_S / motion.slow_acceleration_time_s)
            sigma, drawn = motion.slow_acceleration_sigma_m_s2, self._numbers.noise("slow").normal(size=(count, 3))
            out[0] = sigma * drawn[0]
            for k in range(1, count):
                out[k] = fade * out[k - 1] + sigma * math.sqrt(1.0 - fade**2) * drawn[k]
        return out


def _anomaly(orbit: InertialOrbit, t_s: Vector) -> Vector:
    """True anomaly on the stated orbit at times (k,), rad."""
    if orbit.eccentricity == 0.0:
        return orbit.true_anomaly_rad + orbit.mean_motion_rad_s * t_s
    return np.array([true_anomaly_rad(float(t), orbit) for t in t_s])


def stated_frames(orbit: InertialOrbit, t_s: Vector) -> Stack:
    """`lvlh_ccsds` of the stated orbit against inertial axes at times (k,): along, minus normal, down; (k, 3, 3)."""
    u = orbit.perigee_argument_rad + _anomaly(orbit, t_s)
    node, across, normal = Rotation.from_euler("ZX", [orbit.ascending_node_rad, orbit.inclination_rad]).as_matrix().T
    cos, sin = np.cos(u)[:, None], np.sin(u)[:, None]
    frames = np.empty((len(u), 3, 3))
    frames[:, 0], frames[:, 1], frames[:, 2] = cos * across - sin * node, -normal, -cos * node - sin * across
    return frames


def stated_states(orbit: InertialOrbit, t_s: Vector) -> tuple[Matrix, Matrix, Vector]:
    """On the stated orbit at times (k,): inertial positions and velocities (k, 3), and rates of `lvlh_ccsds` (k,).

    That frame turns about its own y axis.
    """
    n, e = orbit.mean_motion_rad_s, orbit.eccentricity
    theta, frames = _anomaly(orbit, t_s), stated_frames(orbit, t_s)
    along, down = frames[:, 0], frames[:, 2]
    p = (MU_EARTH_M3_S2 / n**2) ** (1.0 / 3.0) * (1.0 - e * e)
    speed, distance = math.sqrt(MU_EARTH_M3_S2 / p), p / (1.0 + e * np.cos(theta))
    v = speed * ((1.0 + e * np.cos(theta))[:, None] * along - (e * np.sin(theta))[:, None] * down)
    return -distance[:, None] * down, v, -math.sqrt(MU_EARTH_M3_S2 * p) / distance**2


def stated_state(orbit: InertialOrbit, t_s: float) -> tuple[Vector, Vector, Vector]:
    """Inertial position and velocity on the stated orbit, and the rate of its `lvlh_ccsds` in that frame's axes."""
    r, v, rates = stated_states(orbit, np.array([t_s]))
    return r[0], v[0], np.array([0.0, rates[0], 0.0])
