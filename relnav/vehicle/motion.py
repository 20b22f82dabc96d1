"""From one event to the next: the chaser's attitude follows the gyro, all else and the covariance follow when asked.

A lost gyro: the last rate is held and walks, as the bias' walk; when samples return, the bias is what it was before,
with what it walked since, and without its correlations.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.dynamics.rigid_body import RigidBody
from relnav.geometry.rotation_vector import turn_by_rotation_vector
from relnav.spacecraft import Vehicle
from relnav.vehicle.layout import GYRO_BIAS, TARGET_RATE
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.settling import CONSTANTS, SCRATCH, settle_into
from relnav.vehicle.state import VehicleState

LONGEST_STEP_S = 1.0
"""Of the covariance: the orbit turns by a milliradian in it, and what turns a thrust is small."""


class VehicleMotion:
    """How a vehicle's state moves. Holds constants and scratch only: the same arguments, the same bits."""

    def __init__(self, vehicle: Vehicle, frame: OrbitFrame) -> None:
        gyro, motion = vehicle.gyro, vehicle.motion
        self.frame = frame
        self._bias_walk, self._lost_walk = gyro.bias_walk_rad_s_sqrt_s**2, gyro.lost_rate_walk_rad_s_sqrt_s**2
        self._holds_s = gyro.lost_after_periods / gyro.rate_hz
        self._constants, self._scratch = np.zeros((), CONSTANTS)[()], np.zeros((), SCRATCH)[()]
        for name, value in {
            "orbit": frame.vector,
            "axes": frame.axes,
            "body": RigidBody(np.array(vehicle.target.inertia_kg_m2), vehicle.orbit.mean_motion_rad_s).matrix,
            "torque_density": vehicle.target.rate_noise_density_rad2_s3,
            "density": motion.acceleration_noise_density_m2_s3 * np.eye(3),
            "slow_sigma": motion.slow_acceleration_sigma_m_s2,
            "slow_time": motion.slow_acceleration_time_s,
            "angle_walk": gyro.random_walk_rad_sqrt_s**2,
        }.items():
            self._constants[name] = value
        self._held_rate = -vehicle.orbit.mean_motion_rad_s * vehicle.chaser.dcm_chaser_from_lvlh[:, 1]

    def chaser_rate(self, state: VehicleState) -> Vector:
        """Inertial rate (3,) rad/s of the chaser, its axes; that of the held attitude before the first sample."""
        if state.sample_s == -math.inf:
            return self._held_rate - state.values[GYRO_BIAS]
        rate: Vector = state.sample_rad_s - state.values[GYRO_BIAS]
        return rate

    def is_lost(self, state: VehicleState) -> bool:
        """Whether the gyro is lost."""
        return math.isfinite(state.bias_known[0])

    def advance(self, state: VehicleState, t_s: float) -> VehicleState:
        """The estimate at t_s, not before its own time: attitude there, all else where it was last settled."""
        ends = max(state.sample_s + self._holds_s, state.t_s)
        if not self.is_lost(state) and t_s > ends:
            state = self._lose_gyro(self.settled(self._turn(state, ends)))
        while self.is_lost(state) and t_s - state.settled_s > LONGEST_STEP_S:
            state = self.settled(self._turn(state, state.settled_s + LONGEST_STEP_S))
        return self._turn(state, t_s)

    def with_sample(self, state: VehicleState, sample_rad_s: Vector) -> VehicleState:
        """The estimate with a gyro sample that holds from its time on."""
        if self.is_lost(state):
            state = self._find_gyro(self.settled(state))
        return state._replace(sample_rad_s=sample_rad_s, sample_s=state.t_s)

    def with_command(self, state: VehicleState, command_m_s2: Vector) -> VehicleState:
        """The estimate with a command to the thrusters that holds from its time on."""
        return self.settled(state)._replace(command_m_s2=command_m_s2)

    def settled(self, state: VehicleState) -> VehicleState:
        """All of the estimate at the time of the chaser's attitude."""
        while state.t_s - state.settled_s > LONGEST_STEP_S:  # without gyro samples to turn by, or only with them
            state = self._settle_part(state, state.settled_s + LONGEST_STEP_S, state.dcm_at_settled)
        if state.t_s > state.settled_s:
            state = self._settle_part(state, state.t_s, state.dcm_inertial_from_chaser)
        return state

    def _turn(self, state: VehicleState, t_s: float) -> VehicleState:
        dt = t_s - state.t_s
        if dt <= 0.0:
            return state
        dcm = np.empty((3, 3))
        turn_by_rotation_vector(state.dcm_inertial_from_chaser, self.chaser_rate(state) * dt, dcm)
        return state._replace(t_s=t_s, dcm_inertial_from_chaser=dcm)

    def _lose_gyro(self, state: VehicleState) -> VehicleState:
        variance = np.diagonal(state.covariance)[GYRO_BIAS]
        return state._replace(bias_known=np.concatenate([state.values[GYRO_BIAS], variance]))

    def _find_gyro(self, state: VehicleState) -> VehicleState:
        values, covariance = state.values.copy(), state.covariance.copy()
        values[GYRO_BIAS] = state.bias_known[:3]
        covariance[GYRO_BIAS, :] = covariance[:, GYRO_BIAS] = 0.0
        away = state.t_s - state.sample_s if np.isfinite(state.sample_s) else 0.0
        covariance[GYRO_BIAS, GYRO_BIAS] = np.diag(state.bias_known[3:] + self._bias_walk * away)
        return state._replace(values=values, covariance=covariance, bias_known=np.full(6, np.nan))

    def _settle_part(self, state: VehicleState, t_s: float, dcm_inertial_from_chaser: Matrix) -> VehicleState:
        """Motion, target and covariance from settled_s to t_s, the chaser turning to the given attitude."""
        values, dcm = state.values.copy(), state.dcm_lvlh_from_target.copy()
        after = np.empty_like(state.covariance)
        known = settle_into(
            self._constants,
            self._scratch,
            state.settled_s,
            t_s - state.settled_s,
            dcm_inertial_from_chaser,
            state.dcm_at_settled,
            state.command_m_s2,
            self._lost_walk if self.is_lost(state) else self._bias_walk,
            values,
            dcm,
            state.covariance,
            after,
        )
        if not known:
            rate = np.linalg.norm(state.values[TARGET_RATE])
            raise ValueError(f"the target's rate, {rate:.3g} rad/s, is no longer known: start anew")
        return state._replace(
            settled_s=t_s,
            values=values,
            dcm_lvlh_from_target=dcm,
            dcm_at_settled=dcm_inertial_from_chaser,
            covariance=after,
        )
