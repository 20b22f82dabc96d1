"""From one event to the next: the chaser's attitude follows the gyro, all else and the covariance follow when asked.

Errors (Markley and Crassidis 2014, ch. 6, for the gyro; convention of `relnav.geometry.rotation_vector`):

    alpha' = -w x alpha - db - n_w,     d(a) = C_LB (f dk - [f x] (dd + alpha)) + ds

with a = (1 + k) C_LB (f + d x f) + s the acceleration in `lvlh_ccsds`, f the command, k and d the thrusters' errors, s
the slow acceleration. Relative motion and the target's turn bring their own transitions.

A lost gyro: the last rate is held and walks, as the bias' walk; when samples return, the bias is what it was before,
with what it walked since, and without its correlations.
"""

from dataclasses import replace

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.dynamics import gauss_markov, relative_motion, rigid_body
from relnav.dynamics.rigid_body import MEAN_MOTION, RigidBody
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation_vector import turned
from relnav.spacecraft import Vehicle
from relnav.vehicle.layout import (
    CHASER_ATTITUDE,
    DRIVING,
    GYRO_BIAS,
    MOVING,
    POSITION,
    SLOW_ACCELERATION,
    TARGET_RATE,
    THRUST_DIRECTION,
    THRUST_SCALE,
    VELOCITY,
)
from relnav.vehicle.state import OrbitFrame, VehicleState

LONGEST_STEP_S = 1.0
"""Of the covariance: the orbit turns by a milliradian in it, and what turns a thrust is small."""


class VehicleMotion:
    """How a vehicle's state moves. Holds constants and scratch only: the same arguments, the same bits."""

    def __init__(self, vehicle: Vehicle, frame: OrbitFrame) -> None:
        gyro, motion = vehicle.gyro, vehicle.motion
        self.frame = frame
        self._angle_walk, self._bias_walk = gyro.random_walk_rad_sqrt_s**2, gyro.bias_walk_rad_s_sqrt_s**2
        self._lost_walk = gyro.lost_rate_walk_rad_s_sqrt_s**2
        self._holds_s = gyro.lost_after_periods / gyro.rate_hz
        self._body = RigidBody(np.array(vehicle.target.inertia_kg_m2), vehicle.orbit.mean_motion_rad_s).matrix
        self._torque_density = vehicle.target.rate_noise_density_rad2_s3
        self._density = motion.acceleration_noise_density_m2_s3 * np.eye(3)
        self._slow_sigma = np.full(3, motion.slow_acceleration_sigma_m_s2)
        self._slow_time = np.full(3, motion.slow_acceleration_time_s)
        self._held_rate = -vehicle.orbit.mean_motion_rad_s * vehicle.chaser.dcm_chaser_from_lvlh[:, 1]

    def chaser_rate(self, state: VehicleState) -> Vector:
        """Inertial rate (3,) rad/s of the chaser, its axes; that of the held attitude before the first sample."""
        if state.sample_s == -np.inf:
            return self._held_rate - state.values[GYRO_BIAS]
        rate: Vector = state.sample_rad_s - state.values[GYRO_BIAS]
        return rate

    def is_lost(self, state: VehicleState) -> bool:
        """Whether the gyro is lost."""
        return bool(np.isfinite(state.bias_known[0]))

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
        return replace(state, sample_rad_s=sample_rad_s, sample_s=state.t_s)

    def with_command(self, state: VehicleState, command_m_s2: Vector) -> VehicleState:
        """The estimate with a command to the thrusters that holds from its time on."""
        return replace(self.settled(state), command_m_s2=command_m_s2)

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
        return replace(
            state,
            t_s=t_s,
            dcm_inertial_from_chaser=turned(state.dcm_inertial_from_chaser, self.chaser_rate(state) * dt),
        )

    def _lose_gyro(self, state: VehicleState) -> VehicleState:
        variance = np.diagonal(state.covariance)[GYRO_BIAS]
        return replace(state, bias_known=np.concatenate([state.values[GYRO_BIAS], variance]))

    def _find_gyro(self, state: VehicleState) -> VehicleState:
        values, covariance = state.values.copy(), state.covariance.copy()
        values[GYRO_BIAS] = state.bias_known[:3]
        covariance[GYRO_BIAS, :] = covariance[:, GYRO_BIAS] = 0.0
        away = state.t_s - state.sample_s if np.isfinite(state.sample_s) else 0.0
        covariance[GYRO_BIAS, GYRO_BIAS] = np.diag(state.bias_known[3:] + self._bias_walk * away)
        return replace(state, values=values, covariance=covariance, bias_known=np.full(6, np.nan))

    def _settle_part(self, state: VehicleState, t_s: float, dcm_inertial_from_chaser: Matrix) -> VehicleState:
        """Motion, target and covariance from settled_s to t_s, the chaser turning to the given attitude."""
        t, dt = state.settled_s, t_s - state.settled_s
        f, values = state.command_m_s2, state.values.copy()
        to_lvlh = self.frame.dcm_lvlh_from_inertial(t_s) @ dcm_inertial_from_chaser
        pushed = f + cross_matrix(values[THRUST_DIRECTION]) @ f
        acceleration = (1.0 + values[THRUST_SCALE]) * (to_lvlh @ pushed) + values[SLOW_ACCELERATION]
        phi, q, effect, work = np.empty((6, 6)), np.empty((6, 6)), np.empty(6), np.empty((6, 6))
        relative_motion.propagate_into(self.frame.vector, t, dt, acceleration, self._density, phi, q, effect, work)
        dcm, rate = state.dcm_lvlh_from_target.copy(), values[TARGET_RATE].copy()
        turn, spread = np.empty((6, 6)), np.empty((6, 6))
        self._body[MEAN_MOTION, 0] = relative_motion.frame_rate(self.frame.vector, t + 0.5 * dt)
        if not rigid_body.propagate_into(
            self._body, dt, dcm, rate, self._torque_density, turn, spread, np.empty((50, 6))
        ):
            raise ValueError(f"the target's rate, {np.linalg.norm(rate):.3g} rad/s, is no longer known: start anew")
        fade, drift = np.empty((3, 3)), np.empty((3, 3))
        gauss_markov.propagate_into(self._slow_sigma, self._slow_time, dt, fade, drift)
        F, Q = np.eye(MOVING, DRIVING), np.zeros((MOVING, MOVING))
        F[:6, :6], F[6:12, 6:12] = phi, turn
        F[SLOW_ACCELERATION, SLOW_ACCELERATION] = fade
        by_acceleration = np.zeros((6, 3))
        by_acceleration[:3], by_acceleration[3:] = 0.5 * dt * dt * np.eye(3), dt * np.eye(3)
        F[:6, SLOW_ACCELERATION] = by_acceleration
        if f.any():
            across = -to_lvlh @ cross_matrix(f)
            F[:6, THRUST_SCALE] = by_acceleration @ (to_lvlh @ f)[:, None]
            F[:6, THRUST_DIRECTION] = F[:6, CHASER_ATTITUDE] = by_acceleration @ across
        F[CHASER_ATTITUDE, CHASER_ATTITUDE] = dcm_inertial_from_chaser.T @ state.dcm_at_settled
        F[CHASER_ATTITUDE, GYRO_BIAS] = -dt * np.eye(3)
        walk = self._lost_walk if self.is_lost(state) else self._bias_walk
        Q[:6, :6], Q[6:12, 6:12], Q[SLOW_ACCELERATION, SLOW_ACCELERATION] = q, spread, drift
        Q[CHASER_ATTITUDE, CHASER_ATTITUDE] = (self._angle_walk * dt + walk * dt**3 / 3.0) * np.eye(3)
        Q[CHASER_ATTITUDE, GYRO_BIAS] = Q[GYRO_BIAS, CHASER_ATTITUDE] = -0.5 * walk * dt * dt * np.eye(3)
        Q[GYRO_BIAS, GYRO_BIAS] = walk * dt * np.eye(3)
        motion = phi @ values[:6] + effect
        values[POSITION], values[VELOCITY], values[TARGET_RATE] = motion[:3], motion[3:], rate
        values[SLOW_ACCELERATION] = fade @ values[SLOW_ACCELERATION]
        return replace(
            state,
            settled_s=t_s,
            values=values,
            dcm_lvlh_from_target=dcm,
            dcm_at_settled=dcm_inertial_from_chaser,
            covariance=carried(state.covariance, F, Q),
        )


def carried(covariance: Matrix, transition: Matrix, noise: Matrix) -> Matrix:
    """P after a step: the first m errors move by transition (m, k) of the first k and take noise (m, m)."""
    moving, driving = transition.shape
    P = covariance.copy()
    P[:moving] = transition @ covariance[:driving]
    P[:, :moving] = P[:, :driving] @ transition.T
    P[:moving, :moving] += noise
    out: Matrix = 0.5 * (P + P.T)
    return out
