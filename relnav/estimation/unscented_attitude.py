"""A published filter's prediction: sigma points of attitude and inertial rate, gathered to mean and covariance.

The paper is Liu, Xu, Xu (2013),
"Vision-based relative navigation for autonomous rendezvous and docking of spacecraft".
"Reduced order" is read as: the target's six states alone, the chaser's attitude being known; noise additive, so that 13
sigma points do; and a measured attitude is linear in the state, so that points are needed in the prediction alone and
the update is that of a Kalman filter, exactly (`estimation.attitude`).

The paper's states are Euler angles, which have no plain mean, no covariance of rotations, and a pole at a pitch of
90 deg. Here the errors are rotation vectors about the present attitude, as everywhere. In the paper's case both are one
filter: `tests/navigation/test_published_unscented.py` holds this one to a UKF of 3-2-1 angles on filterpy.

The points are those of the symmetric set with no weight on the mean, in mean and covariance (alpha 1, beta 0, kappa 0),
none of them negative: x +- sqrt(6 D_j) L_j of P = L D L^T, 1/12 each. Their differences are columns of the predicted
covariance, which is positive definite by construction.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.estimation.attitude import TURNING, noise_factors, turn_rows
from relnav.estimation.factored import orthogonalise
from relnav.geometry.rotation_vector import rotation_vector_into, turn_by_rotation_vector

POINTS = 2 * TURNING
"""About the mean, which is one more."""

SIGMA_POINTS = np.dtype(
    [
        ("dcm", np.float64, (POINTS, 3, 3)),
        ("rate", np.float64, (POINTS, 3)),
        ("columns", np.float64, (TURNING, POINTS)),
        ("mean", np.float64, TURNING),
    ]
)


@kernel
def spread_points(track: Record, ld: Matrix, points: Record, work: Matrix) -> None:
    """Write the sigma points of a track: attitudes (12, 3, 3) and rates (12, 3); work (4, 3) scratch.

    ld (6, 6): the factors that they are drawn from.
    """
    rate, attitudes, rates, dcm = track["rate"], points["dcm"], points["rate"], track["dcm"][:]
    turned, turn = work[0:3], work[3]
    for k in range(POINTS):
        j = k // 2
        size = math.sqrt(6.0 * ld[j, j])
        if k % 2 == 1:
            size = -size
        for i in range(3):
            turn[i] = size * ld[i, j] if i > j else (size if i == j else 0.0)
            n = 3 + i
            rates[k, i] = rate[i] + (size * ld[n, j] if n > j else (size if n == j else 0.0))
        turn_by_rotation_vector(dcm, turn, turned)
        for i in range(3):
            for n in range(3):
                attitudes[k, i, n] = turned[i, n]


@straight_line(columns=(TURNING, POINTS), noise=(TURNING, TURNING), mean=(TURNING,), ld=(TURNING, TURNING))
def gather_columns(columns: Matrix, noise: Matrix, mean: Vector, ld: Matrix) -> None:
    """Write the mean (6,) of the points' errors, and the factors of their covariance about it with noise Q (6, 6)."""
    w, weights, center = np.zeros((TURNING, POINTS + TURNING)), np.zeros(POINTS + TURNING), np.zeros(TURNING)
    noise_factors(noise, w[:, POINTS:], weights[POINTS:])
    for i in range(TURNING):
        for k in range(POINTS):
            center[i] += columns[i, k] / POINTS
    for k in range(POINTS):
        weights[k] = 1.0 / POINTS
        for i in range(TURNING):
            w[i, k] = columns[i, k] - center[i]
    turn_rows(center, w[:, :POINTS])
    orthogonalise(w, weights, ld)
    for i in range(TURNING):
        mean[i] = center[i]


@kernel
def gather_points(track: Record, points: Record, noise: Matrix, work: Matrix) -> None:
    """Give a track the mean and the covariance of its points after a step, and noise Q (6, 6); work (4, 3) scratch.

    The track is at the mean's own propagated attitude and rate, about which the points are told.
    """
    dcm, rate, mean, columns, rates = track["dcm"][:], track["rate"], points["mean"], points["columns"], points["rate"]
    turned, turn = work[0:3], work[3]
    for k in range(POINTS):
        rotation_vector_into(points["dcm"][k], dcm, mean[:3])
        for i in range(3):
            columns[i, k], columns[3 + i, k] = mean[i], rates[k, i] - rate[i]
    gather_columns(columns, noise, mean, track["ld"])
    for i in range(3):
        turn[i] = mean[i]
        rate[i] += mean[3 + i]
    turn_by_rotation_vector(dcm, turn, turned)
    for i in range(3):
        for j in range(3):
            dcm[i, j] = turned[i, j]
