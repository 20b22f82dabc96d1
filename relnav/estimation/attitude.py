"""Attitude and rate from measured attitudes: the filter's update, with errors that last, and where it settles.

The error state is (theta, dw) with C = C_hat exp([theta x]), theta in body axes (Lefferts, Markley, Shuster 1982;
Markley and Crassidis 2014, ch. 6). A measured attitude Z gives the innovation y = log(C_hat^T Z), with H = [I 0].

A measured attitude is Z = C exp([v x]), so that exp([theta x]) = exp([y x]) exp([-v x]) and to second order
y = theta + v + y x v / 2: the noise of the innovation is v turned by half of it. This matters where one axis is
measured far better than the others, as by an image of markers in a plane.

Errors that last a whole run are considered and not estimated (Schmidt 1966): the covariance is P = L D L^T + S S^T, S
(6, LASTING) what one sigma of each of them does to the estimate. The measurement moves with them too, by B (3, LASTING)
of one sigma each, so that with A = S_theta + B and noise R

    K = (P_noise H^T + S A^T) (H P_noise H^T + A A^T + R)^-1,      S <- S - K A
    P_noise <- (I - K H) P_noise (I - K H)^T + K R K^T            for any gain, as columns: W diag W^T >= 0
"""

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.codegen.together import select
from relnav.estimation.factored import compose_into, decorrelate, orthogonalise, spread, time_update_into
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation_vector import rotation_vector_into, turn_by_rotation_vector

TURNING = 6
"""Errors of attitude and rate."""
LASTING = 9
"""Errors that last: six entries of an inertia, three of the attitude of who measures."""
CHASER = slice(LASTING - 3, LASTING)
"""Columns of S that are of the latter."""

_F = np.float64

ATTITUDE_TRACK = np.dtype(
    [("dcm", _F, (3, 3)), ("rate", _F, 3), ("ld", _F, (TURNING, TURNING)), ("lasting", _F, (TURNING, LASTING))]
)
"""An estimate: attitude C, rate w rad/s, the factors of P_noise, and S."""

COMPARED = np.dtype(
    [
        ("track", ATTITUDE_TRACK),
        ("innovation", _F, 3),
        ("innovation_covariance", _F, (3, 3)),
        ("correction", _F, TURNING),
        ("nis", _F),
    ]
)
"""A track beside a measured attitude: how far apart, and the track with the measurement taken in."""


def reset(covariance: Matrix, theta: Vector, at: int = 0) -> Matrix:
    """Covariance about the attitude after it took theta (3,) in: G P G^T, G = I - [theta x] / 2 from row `at` on."""
    G = np.eye(len(covariance))
    G[at : at + 3, at : at + 3] -= 0.5 * cross_matrix(theta)
    out: Matrix = G @ covariance @ G.T
    return out


def joseph(covariance: Matrix, gain: Matrix, h: Matrix, noise: Matrix) -> Matrix:
    """Covariance after an update with any gain: (I - K H) P (I - K H)^T + K R K^T, symmetric to the last bit."""
    rest = np.eye(len(covariance)) - gain @ h
    out = rest @ covariance @ rest.T + gain @ noise @ gain.T
    symmetric: Matrix = 0.5 * (out + out.T)
    return symmetric


def turn_rows(theta: Vector, columns: Matrix) -> None:
    """Replace columns (6, n) of errors by those about the attitude that took theta in: G = I - [theta x] / 2.

    A part of `straight_line` functions.
    """
    a, b, c = 0.5 * theta[0], 0.5 * theta[1], 0.5 * theta[2]
    for k in range(columns.shape[1]):
        x, y, z = columns[0, k], columns[1, k], columns[2, k]
        columns[0, k] = x + c * y - b * z
        columns[1, k] = y + a * z - c * x
        columns[2, k] = z + b * x - a * y


def noise_factors(noise: Matrix, factor: Matrix, variances: Vector) -> None:
    """Write L and D of noise (n, n), D >= 0 whatever the rounding. A part of `straight_line` functions."""
    decorrelate(noise, factor, variances)
    for k in range(variances.shape[0]):
        variances[k] = select(variances[k] > 0.0, variances[k], 0.0)


@straight_line(ld=(TURNING, TURNING), phi=(TURNING, TURNING), noise=(TURNING, TURNING))
def carry_errors(ld: Matrix, phi: Matrix, noise: Matrix) -> None:
    """Replace the factors of P_noise by those of Phi P_noise Phi^T + Q, in place; noise Q (6, 6)."""
    q_ld, variances = np.zeros((TURNING, TURNING)), np.zeros(TURNING)
    noise_factors(noise, q_ld, variances)
    for k in range(TURNING):
        q_ld[k, k] = variances[k]
    time_update_into(ld, phi, q_ld)


@straight_line(lasting=(TURNING, LASTING), phi=(TURNING, TURNING), before=(3, TURNING), after=(3, TURNING))
def carry_lasting(lasting: Matrix, phi: Matrix, before: Matrix, after: Matrix, dt: float) -> None:
    """Replace S by Phi S, and add what the first six errors do meanwhile, in place.

    before, after (3, 6): the angular acceleration rad/s^2 that one sigma of each makes, at both ends of dt s.
    """
    carried = np.zeros((TURNING, LASTING))
    for i in range(TURNING):
        for k in range(LASTING):
            for j in range(TURNING):
                carried[i, k] += phi[i, j] * lasting[j, k]
    for i in range(3):
        for k in range(TURNING):
            push = 0.5 * dt * (before[i, k] + after[i, k])
            carried[i, k] += 0.5 * dt * push
            carried[3 + i, k] += push
    for i in range(TURNING):
        for k in range(LASTING):
            lasting[i, k] = carried[i, k]


@straight_line(
    ld=(TURNING, TURNING),
    lasting=(TURNING, LASTING),
    by_lasting=(3, LASTING),
    noise=(3, 3),
    y=(3,),
    spread_y=(3, 3),
    correction=(TURNING,),
    ld_after=(TURNING, TURNING),
    lasting_after=(TURNING, LASTING),
)
def correct_errors(
    ld: Matrix,
    lasting: Matrix,
    by_lasting: Matrix,
    noise: Matrix,
    y: Vector,
    spread_y: Matrix,
    correction: Vector,
    ld_after: Matrix,
    lasting_after: Matrix,
) -> float:
    """Write the covariance of an innovation y (3,), the correction (6,), and what is known after it; returns NIS.

    noise R (3, 3), positive definite; by_lasting B (3, LASTING). The formulas stand above.
    """
    p, seen, s = np.zeros((TURNING, TURNING)), np.zeros((3, LASTING)), np.zeros((3, 3))
    compose_into(ld, p)
    for i in range(3):
        for k in range(LASTING):
            seen[i, k] = lasting[i, k] + by_lasting[i, k]
        for j in range(i + 1):
            s[i, j] = p[i, j] + noise[i, j]
            for k in range(LASTING):
                s[i, j] += seen[i, k] * seen[j, k]
            s[j, i] = s[i, j]
    factor, variances, root, root_variances = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    decorrelate(s, factor, variances)
    decorrelate(noise, root, root_variances)
    gain, rest, moved = np.zeros((TURNING, 3)), np.zeros((TURNING, TURNING)), np.zeros(TURNING)
    for i in range(TURNING):
        for j in range(3):
            gain[i, j] = p[i, j]
            for k in range(LASTING):
                gain[i, j] += lasting[i, k] * seen[j, k]
            for k in range(j):
                gain[i, j] -= factor[j, k] * gain[i, k]
        for j in range(3):
            gain[i, j] /= variances[j]
        for j in (1, 0):
            for k in range(j + 1, 3):
                gain[i, j] -= factor[k, j] * gain[i, k]
        for j in range(TURNING):
            rest[i, j] = (1.0 if i == j else 0.0) - (gain[i, j] if j < 3 else 0.0)
        moved[i] = gain[i, 0] * y[0] + gain[i, 1] * y[1] + gain[i, 2] * y[2]
    w, weights, after = np.zeros((TURNING, TURNING + 3)), np.zeros(TURNING + 3), np.zeros((TURNING, LASTING))
    spread(rest, ld, w[:, :TURNING], weights[:TURNING])
    for i in range(TURNING):
        for j in range(3):
            weights[TURNING + j] = root_variances[j]
            for k in range(j, 3):
                w[i, TURNING + j] += gain[i, k] * root[k, j]
        for k in range(LASTING):
            after[i, k] = lasting[i, k]
            for j in range(3):
                after[i, k] -= gain[i, j] * seen[j, k]
    turn_rows(moved, w)
    turn_rows(moved, after)
    nis, white = 0.0, np.zeros(3)
    for i in range(3):
        white[i] = y[i]
        for k in range(i):
            white[i] -= factor[i, k] * white[k]
        nis += white[i] * white[i] / variances[i]
    orthogonalise(w, weights, ld_after)
    for i in range(TURNING):
        correction[i] = moved[i]
        for k in range(LASTING):
            lasting_after[i, k] = after[i, k]
        for j in range(3):
            if i < 3:
                spread_y[i, j] = s[i, j]
    return nis


@kernel
def _turn_noise(noise: Matrix, y: Vector, out: Matrix, turned: Matrix) -> None:
    """Write T R T^T, T = 1 + [y x] / 2, R and T (3, 3); turned (3, 3) scratch."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for c in range(3):
            turned[i, c] = noise[i, c] + 0.5 * (y[j] * noise[k, c] - y[k] * noise[j, c])
    for c in range(3):
        j, k = (c + 1) % 3, (c + 2) % 3
        for i in range(3):
            out[i, c] = turned[i, c] + 0.5 * (y[j] * turned[i, k] - y[k] * turned[i, j])


@kernel
def compare_attitude(
    track: Record, measured: Matrix, noise: Matrix, by_lasting: Matrix, out: Record, work: Matrix
) -> None:
    """Compare a track with a measured attitude (3, 3), and correct a copy of it; into out, of type COMPARED.

    noise R (3, 3), positive definite, of v; by_lasting B (3, LASTING); work (10, 3) scratch.
    """
    y, correction, after, dcm = out["innovation"], out["correction"], out["track"], track["dcm"][:]
    rotation_vector_into(measured, dcm, y[:])
    seen = work[4:7]
    _turn_noise(noise, y, seen, work[7:10])
    out["nis"] = correct_errors(
        track["ld"],
        track["lasting"],
        by_lasting,
        seen,
        y,
        out["innovation_covariance"],
        correction,
        after["ld"],
        after["lasting"],
    )
    turned, turn, rate = work[0:3], work[3], track["rate"]
    for i in range(3):
        turn[i] = correction[i]
        after["rate"][i] = rate[i] + correction[3 + i]
    turn_by_rotation_vector(dcm, turn, turned)
    for i in range(3):
        for j in range(3):
            after["dcm"][i, j] = turned[i, j]


def settled_sigmas(sigma_rad: float, dt_s: float, density_rad2_s3: float) -> tuple[float, float]:
    """1-sigma of attitude (rad) and rate (rad/s), each axis, at which such a filter settles.

    Steady state of the double integrator (attitude, rate) with white angular acceleration of density q and
    measurements of continuous density v = sigma^2 dt: P_theta = sqrt(2) v^(3/4) q^(1/4),
    P_w = sqrt(2) v^(1/4) q^(3/4). Holds where the settling time (v / q)^(1/4) is long against dt.
    """
    v, q = sigma_rad**2 * dt_s, density_rad2_s3
    return float(np.sqrt(2.0**0.5 * v**0.75 * q**0.25)), float(np.sqrt(2.0**0.5 * v**0.25 * q**0.75))
