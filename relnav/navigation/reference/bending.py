"""`engine="filterpy"` for markers: what the turn of a hypothesis does in second order over a gap (`pose_bending`)."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.estimation.factored import factorize
from relnav.navigation.attitude.bending import LEAST_SHARE
from relnav.navigation.reference.marker_rows import PoseTrack

_TURN, _RATE = slice(6, 9), slice(9, 12)
Turning = Callable[[Matrix, Vector, Matrix | float], tuple[Matrix, Vector]]
"""Attitude and rate after a step, of a body whose inertia is off by so much."""


def with_pairs(track: PoseTrack, variance: Vector, off: int, dt_s: float, frame_rate: float) -> PoseTrack:
    """A hypothesis with pairs of points, if errors that a step brings leave the thinnest axis by bending.

    variance (12,): of all its errors; off: how many errors of the inertia are counted.
    """
    track = replace(track, age_s=track.age_s + dt_s)
    if track.pairs is not None:
        return track
    reach = math.sqrt(variance[_TURN].max()) + dt_s * math.sqrt(variance[_RATE].max())
    fastest = max(float(np.linalg.norm(track.rate)), frame_rate)
    factors = factorize(track.covariance)[6:, 6:]  # where position and velocity are known
    known = np.diag(factors) > 0.0
    axes = np.linalg.inv(np.tril(factors, -1) + np.eye(6)) * np.repeat([1.0, fastest], 3)
    information = float((axes[known] ** 2 / np.diag(factors)[known, None]).sum())
    leak = 0.5 * reach**2 * min(1.0, fastest * track.age_s)
    if not leak**2 * information > LEAST_SHARE**2:
        return track
    roots = factorize(track.covariance[6:, 6:])
    pairs = math.sqrt(6.0) * (np.tril(roots, -1) + np.eye(6)) * np.sqrt(np.diag(roots))
    return replace(track, pairs=pairs, even=np.zeros((6, 6 + off)))


def over_a_step(
    track: PoseTrack,
    dcm: Matrix,
    rate: Vector,
    phi: Matrix,
    turn: Turning,
    off: list[tuple[Vector, Matrix]],
) -> tuple[Matrix | None, Matrix | None]:
    """Pairs and their even parts after a step that led to dcm and rate, phi (6, 6) being its slopes.

    off: what one sigma of each error of the inertia has done before it, (6,), and the error: these are pairs as well.
    """
    from scipy.spatial.transform import Rotation

    if track.pairs is None or track.even is None:
        return None, None
    even = phi @ track.even
    every: list[tuple[Vector, Matrix | float]] = [(pair, 0.0) for pair in track.pairs.T]
    every += [(math.sqrt(6.0) * done, math.sqrt(6.0) * error) for done, error in off]
    for j, (pair, error) in enumerate(every):
        for sign in (1.0, -1.0):
            at = track.dcm @ Rotation.from_rotvec(sign * pair[:3]).as_matrix()
            there, fast = turn(at, track.rate + sign * pair[3:], sign * error)
            away = Rotation.from_matrix(dcm.T @ there).as_rotvec()
            even[:, j] += 0.5 * np.concatenate([away, fast - rate])
    return phi @ track.pairs, even


def taken_into(track: PoseTrack) -> PoseTrack:
    """A hypothesis with all that into its covariance, and no pairs any more."""
    if track.even is None:
        return replace(track, age_s=0.0)
    covariance = track.covariance.copy()
    covariance[6:, 6:] += track.even @ track.even.T / 6.0
    return replace(track, covariance=covariance, pairs=None, even=None, age_s=0.0)
