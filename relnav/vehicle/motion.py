"""From one event to the next: gyro samples wait for the next observation that needs them, then all follows at once.

A lost gyro: the last rate is held and walks, as the bias' walk; when samples return, the bias is what it was before,
with what it walked since, and without its correlations.
"""

import math

import numpy as np

from relnav.arrays import Vector
from relnav.dynamics.rigid_body import RigidBody
from relnav.spacecraft import Vehicle
from relnav.vehicle.layout import GYRO_BIAS, TARGET_RATE
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.settling import CONSTANTS, SCRATCH, settle_into
from relnav.vehicle.state import Estimates, Sample

LONGEST_STEP_S = 1.0
"""Of the covariance: the orbit turns by a milliradian in it, and what turns a thrust is small."""


class VehicleMotion:
    """How a vehicle's estimates move. Holds constants and scratch only: the same arguments, the same bits."""

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

    def chaser_rate(self, at: Estimates) -> Vector:
        """Inertial rate (3,) rad/s of the chaser as the first filter has it, its axes."""
        rate: Vector = np.array(at.samples[-1][1:]) - at.values[0, GYRO_BIAS]
        return rate

    def is_lost(self, at: Estimates) -> bool:
        """Whether the gyro is lost."""
        return at.bias_known is not None

    def sampled(self, at: Estimates, sample: Sample) -> Estimates:
        """The estimates with a gyro sample that holds from its time on, not before that of the last event."""
        t_s = sample[0]
        if at.bias_known is not None or t_s > self._ends(at) or t_s - at.t_s > LONGEST_STEP_S:
            at = self.settled(at, t_s)
            if at.bias_known is not None:
                at = self._find_gyro(at)
        return at.with_sample(sample)

    def commanded(self, at: Estimates, t_s: float, command_m_s2: Vector) -> Estimates:
        """The estimates with a command to the thrusters that holds from t_s on."""
        return self.settled(at, t_s)._replace(command_m_s2=command_m_s2)

    def settled(self, at: Estimates, t_s: float) -> Estimates:
        """The estimates at t_s, not before that of the last event; the same ones if they are of that time."""
        if at.bias_known is None and t_s > self._ends(at):
            at = self._carried(at, self._ends(at))
            bias, variance = at.values[:, GYRO_BIAS], np.diagonal(at.covariance, axis1=1, axis2=2)[:, GYRO_BIAS]
            at = at._replace(bias_known=np.concatenate([bias, variance], axis=1))
        return self._carried(at, t_s)

    def _ends(self, at: Estimates) -> float:
        """Until when the last sample holds."""
        return max(at.samples[-1][0] + self._holds_s, at.t_s)

    def _carried(self, at: Estimates, t_s: float) -> Estimates:
        while t_s - at.t_s > LONGEST_STEP_S:
            at = self._step(at, at.t_s + LONGEST_STEP_S)
        return self._step(at, t_s) if t_s > at.t_s else at

    def _find_gyro(self, at: Estimates) -> Estimates:
        new, known = at.copied(), at.bias_known
        assert known is not None
        away = at.t_s - at.samples[-1][0] if at.samples[-1][0] > -math.inf else 0.0
        for values, covariance, (*bias, x, y, z) in zip(new.values, new.covariance, known, strict=True):
            values[GYRO_BIAS] = bias
            covariance[GYRO_BIAS, :] = covariance[:, GYRO_BIAS] = 0.0
            covariance[GYRO_BIAS, GYRO_BIAS] = np.diag(np.array([x, y, z]) + self._bias_walk * away)
        return new._replace(bias_known=None)

    def _step(self, at: Estimates, t_s: float) -> Estimates:
        """All from at.t_s to t_s in one piece."""
        _, values, target, chaser, covariance, samples, bias_known, command = at
        values, target, chaser, after = values.copy(), target.copy(), chaser.copy(), np.empty_like(covariance)
        known = settle_into(
            self._constants,
            self._scratch,
            at.t_s,
            t_s,
            np.array(samples),
            command,
            self._bias_walk if bias_known is None else self._lost_walk,
            values,
            target,
            chaser,
            covariance,
            after,
        )
        if not known:
            rate = np.linalg.norm(at.values[:, TARGET_RATE], axis=1).max()
            raise ValueError(f"the target's rate, {rate:.3g} rad/s, is no longer known: start anew")
        holds = len(samples) - 1
        while samples[holds][0] > t_s:
            holds -= 1
        return Estimates(t_s, values, target, chaser, after, samples[holds:], bias_known, command)
