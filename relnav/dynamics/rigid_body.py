"""Rotation of a rigid body in a circular orbit, its attitude told from `lvlh_ccsds` and its rate from inertial space.

    J w' = -w x J w + 3 n^2 o x J o + tau,   o = C^T z,   C' = C [(w - C^T w_L) x],   w_L = -n y

(Hughes, Spacecraft Attitude Dynamics, ch. 9, for the gravity gradient.) C is `dcm_lvlh_from_target`; w (inertial rate)
and J in body axes, o the nadir in body axes. No inertial frame is needed: the orbit's turning is in C'.

An error of the attitude is a small rotation vector in body axes, C = C_hat exp([theta x]).
"""

import math

import numpy as np

from relnav._kernel import kernel
from relnav.arrays import Matrix, Vector
from relnav.geometry.rotation_vector import turn_by_rotation_vector

LARGEST_TURN_RAD = 0.05
"""Turn of one Runge-Kutta step: errors of some 1e-9 rad a minute at a degree a second."""


@kernel
def _derivative(
    start: Matrix, turn: Vector, rate: Vector, inertia: Matrix, inverse: Matrix, n: float, tau: Vector, work: Matrix
) -> None:
    """Write (turn', rate') into work rows 3, 4, where C = start exp([turn x]) goes to rows 0-2."""
    turn_by_rotation_vector(start, turn, work)  # writes the first three rows
    r0, r1, r2 = rate[0] + n * work[1, 0], rate[1] + n * work[1, 1], rate[2] + n * work[1, 2]  # w - C^T w_L
    c0, c1, c2 = turn[1] * r2 - turn[2] * r1, turn[2] * r0 - turn[0] * r2, turn[0] * r1 - turn[1] * r0
    work[3, 0] = r0 + 0.5 * c0 + (turn[1] * c2 - turn[2] * c1) / 12.0  # inverse of the exponential's derivative
    work[3, 1] = r1 + 0.5 * c1 + (turn[2] * c0 - turn[0] * c2) / 12.0
    work[3, 2] = r2 + 0.5 * c2 + (turn[0] * c1 - turn[1] * c0) / 12.0
    for i in range(3):
        work[5, i] = inertia[i, 0] * rate[0] + inertia[i, 1] * rate[1] + inertia[i, 2] * rate[2]
        work[6, i] = inertia[i, 0] * work[2, 0] + inertia[i, 1] * work[2, 1] + inertia[i, 2] * work[2, 2]
    gradient = 3.0 * n * n
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        torque = tau[i] - (rate[j] * work[5, k] - rate[k] * work[5, j])
        work[7, i] = torque + gradient * (work[2, j] * work[6, k] - work[2, k] * work[6, j])
    for i in range(3):
        work[4, i] = inverse[i, 0] * work[7, 0] + inverse[i, 1] * work[7, 1] + inverse[i, 2] * work[7, 2]


@kernel
def turn_body(
    dcm: Matrix, rate: Vector, inertia: Matrix, inverse: Matrix, n: float, tau: Vector, dt: float, work: Matrix
) -> None:
    """Advance dcm (3, 3) and rate (3,), in place, by one Runge-Kutta step dt of Munthe-Kaas; work (14, 3) scratch.

    The attitude moves by one rotation vector, so that it stays a rotation.
    """
    turn, trial, total_turn, total_rate, derivative = work[8], work[9], work[10], work[11], work[0:8]
    for i in range(3):
        turn[i], trial[i], total_turn[i], total_rate[i] = 0.0, rate[i], 0.0, 0.0
    for stage in range(4):
        _derivative(dcm, turn, trial, inertia, inverse, n, tau, derivative)
        weight = dt / 6.0 if stage in (0, 3) else dt / 3.0
        ahead = 0.5 * dt if stage < 2 else dt
        for i in range(3):
            total_turn[i] += weight * derivative[3, i]
            total_rate[i] += weight * derivative[4, i]
            turn[i] = ahead * derivative[3, i]
            trial[i] = rate[i] + ahead * derivative[4, i]
    turn_by_rotation_vector(dcm, total_turn, derivative)
    for i in range(3):
        rate[i] += total_rate[i]
        for j in range(3):
            dcm[i, j] = derivative[i, j]


class RigidBody:
    """A rigid body in a circular orbit."""

    def __init__(self, inertia_kg_m2: Matrix, mean_motion_rad_s: float) -> None:
        """Take the inertia (3, 3) in body axes and the orbit's mean motion, >= 0 (0: free space).

        Raises
        ------
        ValueError
            For an inertia that no body has: not symmetric, not positive, or one principal moment above the sum of the
            other two.
        """
        inertia = np.array(inertia_kg_m2, dtype=np.float64)
        if inertia.shape != (3, 3) or not np.isfinite(inertia).all() or not np.allclose(inertia, inertia.T, rtol=1e-9):
            raise ValueError(f"inertia_kg_m2 is a symmetric matrix (3, 3) in kg m^2; got {inertia.tolist()}")
        moments = np.linalg.eigvalsh(inertia)
        if not moments[0] > 0.0 or moments[2] > (1.0 + 1e-9) * (moments[0] + moments[1]):
            raise ValueError(
                f"inertia_kg_m2: principal moments are positive and none exceeds the sum of the others; "
                f"got {moments.tolist()}"
            )
        if not (math.isfinite(mean_motion_rad_s) and mean_motion_rad_s >= 0.0):
            raise ValueError(f"mean_motion_rad_s must be >= 0 and finite; got {mean_motion_rad_s!r}")
        self.inertia, self.inverse = inertia, np.asarray(np.linalg.inv(inertia), dtype=np.float64)
        self.mean_motion_rad_s = float(mean_motion_rad_s)
        self._work = np.zeros((14, 3))

    def steps(self, rate_rad_s: Vector, dt_s: float) -> int:
        """How many Runge-Kutta steps dt_s takes at this rate."""
        fastest = max(float(np.linalg.norm(rate_rad_s)), self.mean_motion_rad_s)
        return max(1, math.ceil(fastest * abs(dt_s) / LARGEST_TURN_RAD))

    def propagate(
        self, dcm_lvlh_from_target: Matrix, rate_rad_s: Vector, dt_s: float, torque_n_m: Vector | None = None
    ) -> tuple[Matrix, Vector]:
        """Attitude (3, 3) and inertial rate (3,) rad/s after dt_s under a constant torque (3,) N m, body axes."""
        dcm = np.array(dcm_lvlh_from_target, dtype=np.float64)
        rate = np.array(rate_rad_s, dtype=np.float64)
        tau = np.zeros(3) if torque_n_m is None else np.asarray(torque_n_m, dtype=np.float64)
        count = self.steps(rate, dt_s)
        for _ in range(count):
            turn_body(dcm, rate, self.inertia, self.inverse, self.mean_motion_rad_s, tau, dt_s / count, self._work)
        return dcm, rate

    def error_rates(self, dcm_lvlh_from_target: Matrix, rate_rad_s: Vector) -> Matrix:
        """F (6, 6) of (theta, dw)' = F (theta, dw): theta' = -w x theta + dw; the orbit's turning drops out."""
        J, w = self.inertia, rate_rad_s
        o = dcm_lvlh_from_target[2]
        F = np.zeros((6, 6))
        F[:3, :3] = -cross(w)
        F[:3, 3:] = np.eye(3)
        F[3:, :3] = 3.0 * self.mean_motion_rad_s**2 * self.inverse @ (cross(o) @ J - cross(J @ o)) @ cross(o)
        F[3:, 3:] = self.inverse @ (cross(J @ w) - cross(w) @ J)
        return F

    def propagate_with_errors(
        self,
        dcm_lvlh_from_target: Matrix,
        rate_rad_s: Vector,
        dt_s: float,
        density_rad2_s3: float,
        torque_n_m: Vector | None = None,
    ) -> tuple[Matrix, Vector, Matrix, Matrix]:
        """Attitude and rate after dt_s, the transition (6, 6) of their errors, and the process noise (6, 6).

        Transition to 1e-4 of dt, noise to 1 % of its sigmas: what a covariance needs.

        density_rad2_s3: of white angular acceleration, each axis.
        """
        dcm, rate = np.asarray(dcm_lvlh_from_target), np.asarray(rate_rad_s)
        count = self.steps(rate, dt_s)
        h = dt_s / count
        phi, noise, added = np.eye(6), np.zeros((6, 6)), angular_noise(h, density_rad2_s3)
        for _ in range(count):
            before = self.error_rates(dcm, rate)
            dcm, rate = self.propagate(dcm, rate, h, torque_n_m)
            Fh = 0.5 * h * (before + self.error_rates(dcm, rate))
            step = np.eye(6) + Fh @ (np.eye(6) + Fh @ (np.eye(6) + Fh / 3.0) / 2.0)
            phi = step @ phi
            noise = step @ noise @ step.T + added
        return dcm, rate, phi, noise


def cross(v: Vector) -> Matrix:
    """[v x] (3, 3): [v x] w = v x w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def angular_noise(dt_s: float, density_rad2_s3: float) -> Matrix:
    """Covariance (6, 6) of attitude and rate that white angular acceleration adds over a short dt_s."""
    block = np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]])
    noise: Matrix = density_rad2_s3 * np.kron(block, np.eye(3))
    return noise


def lvlh_rate(dcm_lvlh_from_target: Matrix, mean_motion_rad_s: float) -> Vector:
    """Inertial rate (3,) rad/s, body axes, of a body that is held in `lvlh_ccsds`: C^T w_L."""
    rate: Vector = -mean_motion_rad_s * dcm_lvlh_from_target[1]
    return rate
