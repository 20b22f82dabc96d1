"""A published filter: reduced-order unscented Kalman filter of attitude angles and inertial rate, on filterpy.

The paper is Liu, Xu, Xu (2013),
"Vision-based relative navigation for autonomous rendezvous and docking of spacecraft".
State (phi, theta, psi, w): 3-2-1 Euler angles of the body, and its inertial rate in body axes. "Reduced order" is read
as: the target's six states alone, the chaser's attitude being known; noise additive, so that 13 sigma points do.

What filterpy 2.0.0 leaves to its user is done here. Angles have no plain mean: they are averaged about the first sigma
point. A covariance of rotations is no covariance of Euler angles: R and Q pass through T^-1. At a pitch of 90 deg there
are no Euler angles: beyond 45 deg they are told from the present attitude instead. `update` uses the sigma points of
the last `predict`, whatever was updated since (and does nothing before the first): they are drawn anew. Its P loses
symmetry: it is restored. The weights are those of the symmetric set with no weight on the mean, in mean and covariance
(alpha 1, beta 0, kappa 0), none of them negative.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Vector

_FAR_PITCH_RAD = math.radians(45.0)

Motion = Callable[[Matrix, Vector, float], tuple[Matrix, Vector]]


def dcm_from_euler(angles: Vector) -> Matrix:
    """v_reference = dcm @ v_body of 3-2-1 angles (phi, theta, psi), (3, 3)."""
    (sp, st, ss), (cp, ct, cs) = np.sin(angles), np.cos(angles)
    return np.array(
        [
            [ct * cs, sp * st * cs - cp * ss, cp * st * cs + sp * ss],
            [ct * ss, sp * st * ss + cp * cs, cp * st * ss - sp * cs],
            [-st, sp * ct, cp * ct],
        ]
    )


def euler_from_dcm(dcm: Matrix) -> Vector:
    """3-2-1 angles (phi, theta, psi) of a rotation, the inverse of `dcm_from_euler`."""
    theta = math.atan2(-dcm[2, 0], math.hypot(dcm[2, 1], dcm[2, 2]))
    return np.array([math.atan2(dcm[2, 1], dcm[2, 2]), theta, math.atan2(dcm[1, 0], dcm[0, 0])])


def body_turn_of_angles(angles: Vector) -> Matrix:
    """T (3, 3): small changes of the angles are the body's turn T d(angles)."""
    sp, cp, st, ct = math.sin(angles[0]), math.cos(angles[0]), math.sin(angles[1]), math.cos(angles[1])
    return np.array([[1.0, 0.0, -st], [0.0, cp, sp * ct], [0.0, -sp, cp * ct]])


def _wrap(angles: Vector) -> Vector:
    wrapped: Vector = np.remainder(angles + math.pi, 2.0 * math.pi) - math.pi
    return wrapped


def _difference(a: Vector, b: Vector) -> Vector:
    """Difference a - b, the three angles to the nearer side."""
    out = np.asarray(a - b)
    out[:3] = _wrap(out[:3])
    return out


def _mean(sigmas: Matrix, weights: Vector) -> Vector:
    off = sigmas - sigmas[0]
    off[:, :3] = _wrap(off[:, :3])
    out: Vector = sigmas[0] + weights @ off
    return out


def _root(covariance: Matrix) -> Matrix:
    """M with M^T M = P, for every positive semidefinite P."""
    values, axes = np.linalg.eigh(covariance)
    root: Matrix = np.sqrt(np.maximum(values, 0.0))[:, None] * axes.T
    return root


class UnscentedAttitude:
    """Attitude and rate by filterpy's UKF on Euler angles; covariances in and out are of rotation vectors."""

    def __init__(self, dcm: Matrix, rate: Vector, covariance: Matrix, motion: Motion) -> None:
        """Start from an attitude (3, 3), a rate (3,) and their covariance (6, 6).

        motion(dcm, rate, dt) -> (dcm, rate) is the body's dynamics.
        """
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

        self._motion, self._reference = motion, np.eye(3)
        points = MerweScaledSigmaPoints(6, alpha=1.0, beta=0.0, kappa=0.0, sqrt_method=_root, subtract=np.subtract)
        self._filter: Any = UnscentedKalmanFilter(
            dim_x=6,
            dim_z=3,
            dt=1.0,
            hx=lambda x: x[:3],
            fx=self._moved,
            points=points,
            x_mean_fn=_mean,
            z_mean_fn=_mean,
            residual_x=_difference,
            residual_z=_difference,
        )
        self._set(dcm, rate, covariance)

    @property
    def dcm(self) -> Matrix:
        """Present attitude, (3, 3)."""
        out: Matrix = self._reference @ dcm_from_euler(self._filter.x[:3])
        return out

    @property
    def rate(self) -> Vector:
        """Present rate, (3,)."""
        return np.array(self._filter.x[3:])

    @property
    def covariance(self) -> Matrix:
        """Of (turn in body axes, rate), (6, 6)."""
        map_ = _map(self._filter.x)
        out: Matrix = map_ @ self._filter.P @ map_.T
        return out

    def time_update(self, dt_s: float, noise: Matrix) -> None:
        """Predict; noise (6, 6) of (turn, rate) is added."""
        if abs(self._filter.x[1]) > _FAR_PITCH_RAD:
            self._set(self.dcm, self.rate, self.covariance, move_reference=True)
        back = np.linalg.inv(_map(self._moved(self._filter.x, dt_s)))
        self._filter.Q = back @ noise @ back.T
        self._filter.predict(dt=dt_s)
        self._tidy()

    def measurement_update(self, measured: Matrix, noise: Matrix) -> None:
        """Update with a measured attitude (3, 3), noise (3, 3) of its rotation vector in body axes."""
        if abs(self._filter.x[1]) > _FAR_PITCH_RAD:
            self._set(self.dcm, self.rate, self.covariance, move_reference=True)
        self._filter.sigmas_f = self._filter.points_fn.sigma_points(self._filter.x, self._filter.P)
        back = np.linalg.inv(body_turn_of_angles(self._filter.x))
        self._filter.update(euler_from_dcm(self._reference.T @ measured), R=back @ noise @ back.T)
        self._tidy()

    def _set(self, dcm: Matrix, rate: Vector, covariance: Matrix, *, move_reference: bool = False) -> None:
        angles = euler_from_dcm(self._reference.T @ dcm)
        if move_reference or abs(angles[1]) > _FAR_PITCH_RAD:
            self._reference, angles = np.array(dcm), np.zeros(3)
        self._filter.x = np.concatenate([angles, rate])
        back = np.linalg.inv(_map(self._filter.x))
        self._filter.P = back @ covariance @ back.T
        self._tidy()

    def _moved(self, x: Vector, dt: float) -> Vector:
        dcm, rate = self._motion(self._reference @ dcm_from_euler(x[:3]), x[3:], dt)
        return np.concatenate([euler_from_dcm(self._reference.T @ dcm), rate])

    def _tidy(self) -> None:
        self._filter.x[:3] = _wrap(self._filter.x[:3])
        self._filter.P = 0.5 * (self._filter.P + self._filter.P.T)


def _map(x: Vector) -> Matrix:
    """(turn, rate) by (angles, rate), (6, 6)."""
    out = np.eye(6)
    out[:3, :3] = body_turn_of_angles(x)
    return out
