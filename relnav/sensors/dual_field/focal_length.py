"""A focal length that is known to a tolerance: stars are found within it, and it is fitted with the attitude.

A focal length that is off by a part d moves each spot by d times its distance r from the principal point, all alike.
The search takes this as noise of each spot, sigma^2 r r^T beside its own. The matches tell d, and the frame is solved
again with the focal length that they show and the spots' own noise. What is left of d is in the attitude's covariance.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.geometry.star_places import aberration
from relnav.sensors.dual_field.frame_solver import (
    BETA,
    CX,
    FIELDS,
    FOCAL,
    FOLD,
    FOLD_COVARIANCE,
    HALF_HEIGHT,
    HALF_WIDTH,
    K1,
    SETTINGS,
    SPOT_SIGMA,
    usable_spots_into,
)
from relnav.sensors.dual_field.optics import plane_points, rays
from relnav.sensors.dual_field.search import FOUND, LOG_PFA
from relnav.sensors.dual_field.sky import Sky
from relnav.sensors.dual_field.tracking import FOUND_ALONE

OFF_FOCAL = -9
"""Besides the verdicts of the solvers: the focal length is farther off than its stated error."""

FARTHEST = 3.0
"""Sigmas, of the stated error and the stars' together, that the focal length may be off: as for the fold."""

SUSPECTED = 0.003
"""1-sigma of the focal length with which a refused frame is tried again, for the reason alone: lenses that were
measured once, and then focused or cooled, are off by as much."""

REACHES = (2.0, 0.5, 0.0)
"""Sigmas of the focal length that a search allows for, one after the other: with two a lens that is three off still
fits, half of one leaves less to chance where many stars are seen, and none is what an exact lens would get."""

PASSES = 2
"""Fits of the focal length: the second from the stars that the spots' own noise allows."""

STEP = 1e-6


class Outcome(NamedTuple):
    """What a compiled solver wrote."""

    verdict: int
    block: Vector
    star: NDArray[np.int32]
    found: Codes

    @property
    def ok(self) -> bool:
        """Whether there is an attitude."""
        return self.verdict in (FOUND, FOUND_ALONE)


class Fitted(NamedTuple):
    """The focal length that a frame's stars show.

    Attributes
    ----------
    error, variance : float
        By what part it differs from that of the call, and of what variance the difference then is.
    leverage : (3,)
        By how much the attitude turns with it.
    """

    error: float
    variance: float
    leverage: Vector


Solver = Callable[[Stack, Vector], Outcome]
"""Solves one frame with covariances (n, 2, 2), or (0, 2, 2), and the parameters of `frame_solver`."""


def solve_with_tolerance(
    solve: Solver, spots: Matrix, magnitude: Vector, own: Stack, parameters: Vector, sky: Sky, sigma: float
) -> tuple[Outcome, float, float]:
    """A frame whose focal length is known to a relative 1-sigma.

    Returns the outcome, the focal length in px, and how many of its own sigmas the stars put it off that of the model.
    """
    p, start = parameters.copy(), float(parameters[FOCAL])
    C = own if len(own) else np.tile(p[SPOT_SIGMA] ** 2 * np.eye(2), (len(spots), 1, 1))
    r = spots - p[CX : CX + 2]
    # chance may choose among so many focal lengths that the farthest spot tells apart
    p[SETTINGS + LOG_PFA] -= math.log1p(6.0 * sigma * math.hypot(p[HALF_WIDTH], p[HALF_HEIGHT]) / p[SPOT_SIGMA])
    for reach in REACHES:
        covariances = C + (reach * sigma) ** 2 * r[:, :, None] * r[:, None, :] if reach > 0.0 else own
        outcome = solve(covariances, p)
        if outcome.ok:
            break
    total, fit = 0.0, Fitted(0.0, sigma**2, np.zeros(3))
    for _ in range(PASSES):
        if not outcome.ok:
            return outcome, float(p[FOCAL]), 0.0
        fit = fitted(spots, magnitude, C, p, sky, outcome, sigma, total)
        total += fit.error
        p[FOCAL] = start * (1.0 + total)
        outcome = solve(own, p)
    sigmas = abs(total) / math.sqrt(fit.variance)
    if outcome.ok:
        outcome.block[9:18] += fit.variance * np.outer(fit.leverage, fit.leverage).ravel()
        if total**2 > FARTHEST**2 * (sigma**2 + fit.variance):
            outcome = outcome._replace(verdict=OFF_FOCAL)
    return outcome, float(p[FOCAL]), sigmas


def fitted(
    spots: Matrix, magnitude: Vector, C: Stack, p: Vector, sky: Sky, outcome: Outcome, sigma: float, so_far: float
) -> Fitted:
    """The focal length by least squares, with attitude and fold as unknowns; so_far: how far it is from the model's."""
    order = np.empty(len(spots), dtype=np.int64)
    n = usable_spots_into(spots, magnitude, float(p[HALF_WIDTH]), float(p[HALF_HEIGHT]), order)
    match = outcome.found[len(spots) : 3 * len(spots)].reshape(-1, 2)[:n]
    seen = match[:, 0] >= 0
    which, star, second = order[:n][seen], match[seen, 0], match[seen, 1] == 1
    fold = p[FOLD : FOLD + 9].reshape(3, 3)

    def seen_along(xy: Matrix, focal: float) -> Matrix:
        u = rays(plane_points(xy, focal, p[CX : CX + 2], p[K1 : K1 + 2]))
        return np.where(second[:, None], u @ fold.T, u)

    xy, focal = spots[which], float(p[FOCAL])
    w = seen_along(xy, focal)
    by_focal = (seen_along(xy, focal * (1.0 + STEP)) - w) / STEP
    by_spot = np.stack(
        [(seen_along(xy + step, focal) - w) / (STEP * focal) for step in STEP * focal * np.eye(2)], axis=-1
    )
    to_spot = np.linalg.pinv(by_spot)
    q = aberration(np.asarray(sky.arrays.stars[star, :3]), p[BETA : BETA + 3]) @ outcome.block[:9].reshape(3, 3).T
    values, axes = np.linalg.eigh(p[FOLD_COVARIANCE : FOLD_COVARIANCE + 9].reshape(3, 3))
    slip = axes * np.sqrt(np.maximum(values, 0.0)) if p[FIELDS] == 2 else np.zeros((3, 3))
    turned = -_cross(w) @ slip * second[:, None, None]
    design = to_spot @ np.concatenate([_cross(q), turned, by_focal[:, :, None]], axis=-1)  # 3 + 3 + 1 unknowns
    white = np.linalg.inv(np.linalg.cholesky(C[which]))
    rows, left = (white @ design).reshape(-1, 7), (white @ to_spot @ (w - q)[:, :, None]).ravel()
    prior = np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0 / sigma**2])
    gradient = -rows.T @ left
    gradient[6] -= so_far / sigma**2
    V = np.linalg.inv(rows.T @ rows + prior)
    return Fitted(float(V[6] @ gradient), float(V[6, 6]), V[:3, 6] / V[6, 6])


def _cross(vectors: Matrix) -> Stack:
    """Matrices (n, 3, 3) of v x."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
