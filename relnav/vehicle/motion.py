"""From one event to the next: gyro samples wait until an observation needs them, then all follows at once.

A gyro without samples: its last rate is held. That is off by d, the noise s of the sample that is held, and what the
chaser's turn has changed since, a random walk of density q. At u after the begin of that sample, of which the first
period T is in the gyro's own noise already,

    var d = s^2 + q u,   var (integral of d) = s^2 (u^2 - T^2) + q (u^3 - T^3) / 3

For HELD_S this is white noise of the attitude, of as much in every step as the variance grows: what the filter knows of
the bias, and with which errors it is correlated, stays true, and goes on when samples return. An attitude that is
measured meanwhile has less to gain from then on than the variance says: with d the same all the time and a share K of
its effect at u_1 corrected, (u - K u_1)^2 is left of what counts as u^2 - K u_1^2, which is more for any K up to 1.

After that d is to be learnt: it is added to the bias, and walks. How it is correlated with the attitude is not known
then. Twice both variances are more than any correlation makes of them. When samples return, the bias is what it was
before, with what it walked since, and without its correlations: several such gaps count what was known of it twice.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.dynamics.rigid_body import RigidBody
from relnav.spacecraft import Vehicle
from relnav.vehicle.gyro import GyroSamples, found_at, lost_at
from relnav.vehicle.gyro_errors import true_rate
from relnav.vehicle.layout import CHASER_ATTITUDE, DRIVING, GYRO_BIAS, GYRO_ERRORS, MOVING, TARGET_RATE
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.settling import CONSTANTS, SCRATCH, settle_into
from relnav.vehicle.state import Estimates, Lost

HELD_S = 10.0
"""Of silence: drop-outs of telemetry. d is then some 0.04 deg/s, of a chaser whose attitude is controlled."""
LONGEST_STEP_S = 1.0
"""Of the covariance: the orbit turns by a milliradian in it. Thrust turns with the chaser (`settling`)."""


class Step(NamedTuple):
    """A step of one filter, as a smoother needs it.

    Attributes
    ----------
    before : Estimates
        At its beginning.
    F, Q : (MOVING, k), (MOVING, MOVING)
        By what the errors that move depend on the first ones before, DRIVING or those of the gyro too, and their noise.
    values, attitudes : (n,), ((3, 3), (3, 3))
        At its end; dcm_lvlh_from_target, dcm_inertial_from_chaser.
    """

    before: Estimates
    F: Matrix
    Q: Matrix
    values: Vector
    attitudes: tuple[Matrix, Matrix]


class VehicleMotion:
    """How a vehicle's estimates move. Holds constants and scratch only: the same arguments, the same bits.

    Attributes
    ----------
    frame : OrbitFrame
    on_step : callable or None
        Called with every `Step` of a single filter.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        frame: OrbitFrame,
        held: Matrix,
        filters: int,
        without: int = -1,
        untold: int = -1,
        watched: int = -1,
        drives: Codes | None = None,
    ) -> None:
        """Constants; without: the filter that has no gyro, for which the chaser is held in its orbit.

        held (3, 3): its dcm_lvlh_from_chaser then; untold: the filter that is told no commands to the thrusters;
        watched: the filter of which drifts are looked for, of the errors drives (k,).
        """
        gyro, motion, thrust = vehicle.gyro, vehicle.motion, vehicle.thrust
        self.frame = frame
        self.on_step: Callable[[Step], None] | None = None
        self._bias_walk, self._lost_walk = gyro.bias_walk_rad_s_sqrt_s**2, gyro.lost_rate_walk_rad_s_sqrt_s**2
        self._walks, self._lost_walks = np.full(filters, self._bias_walk), np.full(filters, self._lost_walk)
        self._chaser, self._held = held, np.full((1, 4), -math.inf)
        self._without, self._untold = without, untold
        if without >= 0:
            self._walks[without] = self._lost_walk
        self._watched, self._drives = watched, np.zeros(0, dtype=np.int64) if drives is None else drives
        self._moved = np.empty((MOVING, len(self._drives)))
        self._sampled = 1.0 / gyro.rate_hz, gyro.random_walk_rad_sqrt_s * gyro.rate_hz**0.5
        self._is_off, self._gained = gyro.is_off, np.empty((0, 0))
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
            "push_sigma": thrust.largest_m_s2,
            "push_time": thrust.lasts_s,
            "angle_walk": gyro.random_walk_rad_sqrt_s**2,
            "period": 1.0 / gyro.rate_hz,
        }.items():
            self._constants[name] = value

    def chaser_rate(self, at: Estimates, samples: GyroSamples, filter_: int = 0) -> Vector:
        """Inertial rate (3,) rad/s of the chaser as one of the filters has it, its axes."""
        held = filter_ == self._without
        told = self.frame.held_rate(self._chaser, at.t_s) if held else samples.rate_at(at.t_s)
        rate: Vector = told - at.values[filter_, GYRO_BIAS]
        return true_rate(at.values[filter_, GYRO_ERRORS], rate) if self._is_off and not held else rate

    def rate_variance(self, at: Estimates, samples: GyroSamples, filter_: int = 0) -> Vector:
        """Of what that rate is off by beyond the errors of the state, (3,) rad^2/s^2.

        A sample's noise, and how the chaser's turn may change within its period, or since while it is held. Zero where
        that is learnt, in the error of the bias.
        """
        if filter_ == self._without:
            return np.zeros(3)
        period, sigma = self._sampled
        if at.lost is None:
            trend = np.maximum(np.abs(samples.trend_at(at.t_s)), samples.unsteady_at(at.t_s, period, sigma))
            variance: Vector = sigma * sigma + trend * trend
            return variance
        return np.full(3, 0.0 if at.lost.is_learnt else self._held_error(at.lost, at.t_s)[0])

    def settled(self, at: Estimates, samples: GyroSamples, t_s: float) -> Estimates:
        """The estimates at t_s, not before their own time; the same ones if they are of that time."""
        at = self.forwarded(at, samples, t_s)
        return self._step(at, samples, t_s) if t_s > at.t_s else at

    def forwarded(self, at: Estimates, samples: GyroSamples, t_s: float) -> Estimates:
        """The estimates at the last stop on their way to t_s: where the gyro is lost or found, or a step is too long.

        Stops do not depend on t_s: what is later settled from there has the same bits.
        """
        while True:
            array, count, lost = samples.array, samples.count, at.lost
            if lost is None:
                stop = lost_at(array, count, self._holds_s, at.t_s, t_s)
            else:
                stop = found_at(array, count, lost.since_s)
                if not lost.is_learnt:
                    stop = min(stop, max(at.t_s, lost.held_s + HELD_S))
            if min(stop, t_s) - at.t_s > LONGEST_STEP_S:
                at = self._step(at, samples, at.t_s + LONGEST_STEP_S)
                continue
            if stop > t_s:
                return at
            if stop > at.t_s:
                at = self._step(at, samples, stop)
            if lost is None:
                at = at._replace(lost=Lost(at.t_s, samples.held_at(at.t_s)))
            elif lost.is_learnt:
                at = self._find_gyro(at, lost, samples)
            elif found_at(array, count, lost.since_s) > stop:
                at = self._learn_rate(at, lost)
            else:
                at = at._replace(lost=None)

    def _held_error(self, lost: Lost, t_s: float) -> tuple[float, float]:
        """Variances of the rate that is held, and of what it adds to the attitude: of a sample, at t_s."""
        period, sigma = self._sampled
        u = t_s - lost.held_s
        if u == math.inf:  # no sample at all: the rate of the orbit, as handed over
            return 0.0, 0.0
        u = max(u, period)
        rate, turn = sigma * sigma + self._lost_walk * u, sigma * sigma * (u * u - period * period)
        return rate, turn + self._lost_walk * (u**3 - period**3) / 3.0

    def _learn_rate(self, at: Estimates, lost: Lost) -> Estimates:
        """The same with the error of the held rate in that of the bias, which is kept."""
        new, (rate, turn) = at.copied(), self._held_error(lost, at.t_s)
        bias, variance = at.values[:, GYRO_BIAS].copy(), np.diagonal(at.covariance, axis1=1, axis2=2)
        F, Q = np.eye(MOVING, DRIVING), np.zeros((MOVING, MOVING))
        Q[GYRO_BIAS, GYRO_BIAS], Q[CHASER_ATTITUDE, CHASER_ATTITUDE] = 2.0 * rate * np.eye(3), turn * np.eye(3)
        for f in range(len(bias)):
            if f != self._without:
                new.covariance[f, :MOVING, :MOVING] += Q
        self._tell(at, F, Q, new)
        return new._replace(lost=lost._replace(bias=bias, variance=variance[:, GYRO_BIAS].copy()))

    def _find_gyro(self, at: Estimates, lost: Lost, samples: GyroSamples) -> Estimates:
        new, silent_s = at.copied(), samples.silent_before(at.t_s)
        assert lost.bias is not None
        assert lost.variance is not None
        for f, (bias, variance) in enumerate(zip(lost.bias, lost.variance, strict=True)):
            if f == self._without:
                continue
            new.values[f, GYRO_BIAS], covariance = bias, new.covariance[f]
            covariance[GYRO_BIAS, :] = covariance[:, GYRO_BIAS] = 0.0
            covariance[GYRO_BIAS, GYRO_BIAS] = np.diag(variance + self._bias_walk * silent_s)
        new.drift[GYRO_BIAS] = 0.0
        F, Q = np.eye(MOVING, DRIVING), np.zeros((MOVING, MOVING))
        F[GYRO_BIAS] = 0.0
        Q[GYRO_BIAS, GYRO_BIAS] = new.covariance[0, GYRO_BIAS, GYRO_BIAS]
        self._tell(at, F, Q, new)
        return new._replace(lost=None)

    def _tell(self, before: Estimates, F: Matrix, Q: Matrix, after: Estimates) -> None:
        if self.on_step is not None:
            ends = after.dcm_lvlh_from_target[0].copy(), after.dcm_inertial_from_chaser[0].copy()
            self.on_step(Step(before, F.copy(), Q.copy(), after.values[0].copy(), ends))

    def _step(self, at: Estimates, samples: GyroSamples, t_s: float) -> Estimates:
        """All from at.t_s to t_s in one piece."""
        begin_s, values, target, chaser, covariance, _, lights, pivot, command, lost, drift = at
        drift = drift.copy() if self._watched >= 0 else drift
        if self._without >= 0:
            self._held[0, 1:] = self.frame.held_rate(self._chaser, 0.5 * (begin_s + t_s))
        if self._is_off and len(self._gained) == 0:
            self._gained = np.empty((3, values.shape[1]))
        values, target, chaser, after = values.copy(), target.copy(), chaser.copy(), np.empty_like(covariance)
        walks, turned = self._walks, 0.0
        if lost is not None and lost.is_learnt:
            walks = self._lost_walks
        elif lost is not None:
            turned = self._held_error(lost, t_s)[1] - (
                0.0 if begin_s == lost.since_s else self._held_error(lost, begin_s)[1]
            )
        known = settle_into(
            self._constants,
            self._scratch,
            begin_s,
            t_s,
            samples.array,
            samples.count,
            command,
            walks,
            turned,
            self._held,
            self._without,
            self._untold,
            values,
            target,
            chaser,
            covariance,
            after,
            self._watched,
            self._drives,
            drift,
            self._moved,
            self._gained,
        )
        if not known:
            rate = np.linalg.norm(at.values[:, TARGET_RATE], axis=1).max()
            raise ValueError(f"the target's rate, {rate:.3g} rad/s, is no longer known: start anew")
        frame = self._scratch["frame"].copy()
        new = Estimates(t_s, values, target, chaser, after, frame, lights, pivot, command, lost, drift)
        if self.on_step is not None:
            F: Matrix = self._scratch["F"]
            if self._is_off:
                F = np.hstack([F, np.zeros((MOVING, GYRO_ERRORS.stop - DRIVING))])
                F[CHASER_ATTITUDE, GYRO_ERRORS] = -self._scratch["driven"]
            self._tell(at, F, self._scratch["Q"], new)
        return new
