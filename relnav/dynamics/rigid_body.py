"""Rotation of a rigid body in orbit, its attitude told from `lvlh_ccsds` and its rate from inertial space.

    J w' = -w x J w + g o x J o + tau,   o = C^T z,   C' = C [(w - C^T w_L) x],   w_L = -n y,   g = 3 mu / r^3

(Hughes, Spacecraft Attitude Dynamics, ch. 9, for the gravity gradient.) C is `dcm_lvlh_from_target`; w (inertial rate)
and J in body axes, o the nadir in body axes. No inertial frame is needed: the orbit's turning is in C'. n, the rate of
the frame, is the mean motion of a circular orbit, and g = 3 n^2; about an eccentric one both are those of the time.

An error of the attitude is a small rotation vector in body axes, C = C_hat exp([theta x]).
"""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.geometry.rotation_vector import turn_by_rotation_vector

LARGEST_TURN_RAD = 0.05
"""Turn of one Runge-Kutta step: errors of some 1e-9 rad a minute at a degree a second."""
MOST_STEPS = 20_000
"""Of one propagation, 1000 rad: ten days held in low orbit, 16 hours at a degree a second. A rate known to a part in
a thousand has by then lost the attitude, and so have the orbit and the torques that are not modelled."""

INERTIA, INVERSE, ORBIT, TORQUE = 0, 3, 6, 7
"""Rows of a body (8, 3): its inertia and the inverse, three rows each; its orbit; the torque on it."""
BODY_ROWS = 8
FRAME_RATE, GRADIENT = 0, 1
"""Of the row of the orbit: rate at which `lvlh_ccsds` turns about -y, rad/s, and three times mu / r^3, 1/s^2."""

_RATES_PATTERN = ("0***00", "*0*0*0", "**000*", "******", "******", "******")
"""Of F: theta' = -w x theta + dw."""


@kernel
def _derivative(
    start: Matrix,
    turn: Vector,
    rate: Vector,
    inertia: Matrix,
    inverse: Matrix,
    orbit: Vector,
    tau: Vector,
    work: Matrix,
) -> None:
    """Write (turn', rate') into work rows 3, 4, where C = start exp([turn x]) goes to rows 0-2."""
    n, gradient = orbit[FRAME_RATE], orbit[GRADIENT]
    turn_by_rotation_vector(start, turn, work)  # writes the first three rows
    r0, r1, r2 = rate[0] + n * work[1, 0], rate[1] + n * work[1, 1], rate[2] + n * work[1, 2]  # w - C^T w_L
    c0, c1, c2 = turn[1] * r2 - turn[2] * r1, turn[2] * r0 - turn[0] * r2, turn[0] * r1 - turn[1] * r0
    work[3, 0] = r0 + 0.5 * c0 + (turn[1] * c2 - turn[2] * c1) / 12.0  # inverse of the exponential's derivative
    work[3, 1] = r1 + 0.5 * c1 + (turn[2] * c0 - turn[0] * c2) / 12.0
    work[3, 2] = r2 + 0.5 * c2 + (turn[0] * c1 - turn[1] * c0) / 12.0
    for i in range(3):
        work[5, i] = inertia[i, 0] * rate[0] + inertia[i, 1] * rate[1] + inertia[i, 2] * rate[2]
        work[6, i] = inertia[i, 0] * work[2, 0] + inertia[i, 1] * work[2, 1] + inertia[i, 2] * work[2, 2]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        torque = tau[i] - (rate[j] * work[5, k] - rate[k] * work[5, j])
        work[7, i] = torque + gradient * (work[2, j] * work[6, k] - work[2, k] * work[6, j])
    for i in range(3):
        work[4, i] = inverse[i, 0] * work[7, 0] + inverse[i, 1] * work[7, 1] + inverse[i, 2] * work[7, 2]


@kernel
def turn_body(
    dcm: Matrix, rate: Vector, inertia: Matrix, inverse: Matrix, orbit: Vector, tau: Vector, dt: float, work: Matrix
) -> None:
    """Advance dcm (3, 3) and rate (3,), in place, by one Runge-Kutta step dt of Munthe-Kaas; work (14, 3) scratch.

    The attitude moves by one rotation vector, so that it stays a rotation.
    """
    turn, trial, total_turn, total_rate, derivative = work[8], work[9], work[10], work[11], work[0:8]
    for i in range(3):
        turn[i], trial[i], total_turn[i], total_rate[i] = 0.0, rate[i], 0.0, 0.0
    for stage in range(4):
        _derivative(dcm, turn, trial, inertia, inverse, orbit, tau, derivative)
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


@kernel
def error_rates_into(
    dcm: Matrix, rate: Vector, inertia: Matrix, inverse: Matrix, gradient: float, F: Matrix, work: Matrix
) -> None:
    """Write F (6, 6) of (theta, dw)' = F (theta, dw) into F; work (6, 3) scratch.

    theta' = -w x theta + dw, the orbit's turning drops out; dw' = J^-1 (g ([o x] J - [Jo x]) [o x] theta
    + ([Jw x] - [w x] J) dw).
    """
    for i in range(6):
        for j in range(6):
            F[i, j] = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        F[i, j], F[i, k], F[i, 3 + i] = rate[k], -rate[j], 1.0
        work[0, i] = inertia[i, 0] * rate[0] + inertia[i, 1] * rate[1] + inertia[i, 2] * rate[2]
        work[1, i] = inertia[i, 0] * dcm[2, 0] + inertia[i, 1] * dcm[2, 1] + inertia[i, 2] * dcm[2, 2]
    for c in range(3):  # column by column: what a unit error does to the torque
        d, e = (c + 1) % 3, (c + 2) % 3
        work[2, c], work[2, d], work[2, e] = 0.0, dcm[2, e], -dcm[2, d]  # [o x] of it
        for i in range(3):
            work[3, i] = inertia[i, 0] * work[2, 0] + inertia[i, 1] * work[2, 1] + inertia[i, 2] * work[2, 2]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            turned = dcm[2, j] * work[3, k] - dcm[2, k] * work[3, j] - work[1, j] * work[2, k] + work[1, k] * work[2, j]
            work[4, i] = gradient * turned
            work[5, i] = -(rate[j] * inertia[k, c] - rate[k] * inertia[j, c])
        work[5, d] += work[0, e]  # [Jw x] of it
        work[5, e] -= work[0, d]
        for i in range(3):
            F[3 + i, c] = inverse[i, 0] * work[4, 0] + inverse[i, 1] * work[4, 1] + inverse[i, 2] * work[4, 2]
            F[3 + i, 3 + c] = inverse[i, 0] * work[5, 0] + inverse[i, 1] * work[5, 1] + inverse[i, 2] * work[5, 2]


@kernel
def _product(a: Matrix, b: Matrix, out: Matrix) -> None:
    """Write a b (6, 6) into out, which is neither."""
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += a[i, k] * b[k, j]
            out[i, j] = total


@straight_line(half=_RATES_PATTERN, step=(6, 6))
def exponential_into(half: Matrix, step: Matrix) -> None:
    """Write exp(half) to third order into step (6, 6); half as `error_rates_into` writes it, times a time."""
    square, cube = np.zeros((6, 6)), np.zeros((6, 6))
    for i in range(6):
        for j in range(6):
            for k in range(6):
                square[i, j] += half[i, k] * half[k, j]
    for i in range(6):
        for j in range(6):
            for k in range(6):
                cube[i, j] += half[i, k] * square[k, j]
    for i in range(6):
        for j in range(6):
            step[i, j] = (1.0 if i == j else 0.0) + (half[i, j] + (0.5 * square[i, j] + cube[i, j] / 6.0))


@kernel
def carry_transition(step: Matrix, phi: Matrix, noise: Matrix, work: Matrix) -> None:
    """Advance phi and noise (6, 6), in place, by a transition; work (12, 6) scratch."""
    one, other = work[0:6], work[6:12]
    _product(step, phi, one)
    _product(step, noise, other)
    for i in range(6):
        for j in range(6):
            phi[i, j] = one[i, j]
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += other[i, k] * step[j, k]
            noise[i, j] = total


@kernel
def turn_body_with_errors(
    dcm: Matrix,
    rate: Vector,
    inertia: Matrix,
    inverse: Matrix,
    orbit: Vector,
    tau: Vector,
    h: float,
    count: int,
    density: float,
    phi: Matrix,
    noise: Matrix,
    work: Matrix,
) -> None:
    """Advance dcm and rate, in place, by count steps h, and write the transition phi and the noise (6, 6) over them.

    density: of white angular acceleration; work (50, 6) scratch.
    """
    before, after, columns, turning = work[0:6], work[6:12], work[12:18, 0:3], work[18:32, 0:3]
    error_rates_into(dcm, rate, inertia, inverse, orbit[GRADIENT], before, columns)
    for i in range(6):
        for j in range(6):
            noise[i, j] = 0.0
    for taken in range(count):
        turn_body(dcm, rate, inertia, inverse, orbit, tau, h, turning)
        error_rates_into(dcm, rate, inertia, inverse, orbit[GRADIENT], after, columns)
        for i in range(6):
            for j in range(6):
                later = after[i, j]
                after[i, j] = 0.5 * h * (before[i, j] + later)
                before[i, j] = later
        if taken == 0:  # most steps are one
            exponential_into(after, phi)
        else:
            exponential_into(after, work[32:38])
            carry_transition(work[32:38], phi, noise, work[38:50])
        for i in range(3):
            noise[i, i] += density * h * h * h / 3.0
            noise[3 + i, 3 + i] += density * h
            noise[i, 3 + i] += 0.5 * density * h * h
            noise[3 + i, i] += 0.5 * density * h * h


@kernel
def step_count(rate: Vector, n: float, dt: float) -> int:
    """How many Runge-Kutta steps dt takes at this rate (3,); 0 if more than MOST_STEPS, or if a number is none."""
    fastest = max(math.sqrt(rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2]), n)
    count = fastest * abs(dt) / LARGEST_TURN_RAD
    if not count <= MOST_STEPS:
        return 0
    return max(1, math.ceil(count))


@kernel
def propagate_into(
    body: Matrix, dt: float, dcm: Matrix, rate: Vector, density: float, phi: Matrix, q: Matrix, work: Matrix
) -> bool:
    """Advance dcm_lvlh_from_target (3, 3) and the inertial rate (3,) rad/s, in place, by dt s.

    Writes the transition of their errors and the noise that white angular acceleration of a density (rad^2/s^3, each
    axis) adds, into phi and q (6, 6). body (BODY_ROWS, 3): its rows by name above, kg m^2, rad/s, N m; work (50, 6)
    scratch. False, and nothing written, for a step of more than MOST_STEPS: nothing is known of the attitude after it.
    """
    orbit = body[ORBIT]
    count = step_count(rate, orbit[FRAME_RATE], dt)
    if count == 0:
        return False
    inertia, inverse = body[INERTIA : INERTIA + 3], body[INVERSE : INVERSE + 3]
    turn_body_with_errors(dcm, rate, inertia, inverse, orbit, body[TORQUE], dt / count, count, density, phi, q, work)
    return True


class RigidBody:
    """A rigid body in a circular orbit.

    Attributes
    ----------
    inertia, inverse : (3, 3)
        In body axes, kg m^2, and its inverse.
    mean_motion_rad_s : float
        Of the orbit.
    matrix : (8, 3)
        All of it as `propagate_into` takes it.
    """

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
        self.matrix = np.zeros((BODY_ROWS, 3))
        self.matrix[INERTIA : INERTIA + 3], self.matrix[INVERSE : INVERSE + 3] = self.inertia, self.inverse
        self.matrix[ORBIT, FRAME_RATE] = self.mean_motion_rad_s
        self.matrix[ORBIT, GRADIENT] = 3.0 * self.mean_motion_rad_s * self.mean_motion_rad_s
        self._work, self._errors = np.zeros((14, 3)), np.zeros((50, 6))

    def steps(self, rate_rad_s: Vector, dt_s: float) -> int:
        """How many Runge-Kutta steps dt_s takes at this rate; 0 if more than MOST_STEPS."""
        return step_count(np.asarray(rate_rad_s, dtype=np.float64), self.mean_motion_rad_s, dt_s)

    def propagate(
        self, dcm_lvlh_from_target: Matrix, rate_rad_s: Vector, dt_s: float, torque_n_m: Vector | None = None
    ) -> tuple[Matrix, Vector]:
        """Attitude (3, 3) and inertial rate (3,) rad/s after dt_s under a constant torque (3,) N m, body axes.

        As they are, if dt_s takes more than MOST_STEPS: nothing is known of the attitude after it.
        """
        dcm = np.array(dcm_lvlh_from_target, dtype=np.float64)
        rate = np.array(rate_rad_s, dtype=np.float64)
        tau = np.zeros(3) if torque_n_m is None else np.asarray(torque_n_m, dtype=np.float64)
        count = self.steps(rate, dt_s)
        for _ in range(count):
            turn_body(dcm, rate, self.inertia, self.inverse, self.matrix[ORBIT], tau, dt_s / count, self._work)
        return dcm, rate

    def error_rates(self, dcm_lvlh_from_target: Matrix, rate_rad_s: Vector) -> Matrix:
        """F (6, 6) of (theta, dw)' = F (theta, dw), as in `error_rates_into`."""
        F, gradient = np.empty((6, 6)), float(self.matrix[ORBIT, GRADIENT])
        error_rates_into(dcm_lvlh_from_target, rate_rad_s, self.inertia, self.inverse, gradient, F, np.empty((6, 3)))
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

        Transition to 1e-4 of dt, noise to 1 % of its sigmas: what a covariance needs. If dt_s takes more than
        MOST_STEPS, attitude and rate are left as they are, the transition is 1, and the noise says that nothing is
        known: 1-sigma of half a turn and of twice the rate.

        density_rad2_s3: of white angular acceleration, each axis.
        """
        dcm = np.array(dcm_lvlh_from_target, dtype=np.float64)
        rate = np.array(rate_rad_s, dtype=np.float64)
        self.matrix[TORQUE] = 0.0 if torque_n_m is None else torque_n_m
        phi, noise = np.eye(6), np.zeros((6, 6))
        if not propagate_into(self.matrix, dt_s, dcm, rate, density_rad2_s3, phi, noise, self._errors):
            fastest = max(float(np.linalg.norm(rate)), self.mean_motion_rad_s)
            noise[:] = np.diag(np.repeat([math.pi**2, (2.0 * fastest) ** 2 + density_rad2_s3 * abs(dt_s)], 3))
        return dcm, rate, phi, noise


def lvlh_rate(dcm_lvlh_from_target: Matrix, mean_motion_rad_s: float) -> Vector:
    """Inertial rate (3,) rad/s, body axes, of a body that is held in `lvlh_ccsds`: C^T w_L."""
    rate: Vector = -mean_motion_rad_s * dcm_lvlh_from_target[1]
    return rate
