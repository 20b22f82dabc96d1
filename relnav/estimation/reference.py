"""The same estimation on filterpy's ExtendedKalmanFilter: an independent engine to check ours against.

filterpy keeps P itself and updates it in Joseph's form with an inverted S: right on well-conditioned problems. Its
traps are kept out: predict() comes before update() (`predict_update` linearises at the unpredicted state), NIS is
formed here (`mahalanobis` is stale after an update without a measurement), and it is imported only when used (2 s).
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Vector


class ReferenceTrack:
    """State and covariance of one track of any size n, on filterpy."""

    considered: Matrix
    """What lasting errors do to the state, a row an error (m, n): the caller's to carry."""

    def __init__(self, state: Vector, covariance: Matrix) -> None:
        """Start from a state (n,) and its covariance (n, n)."""
        from filterpy.kalman import ExtendedKalmanFilter

        n = len(state)
        self._filter: Any = ExtendedKalmanFilter(dim_x=n, dim_z=1, dim_u=n)
        self._filter.x = np.array(state)
        self._filter.P = np.array(covariance)
        self._filter.B = np.eye(n)

    @property
    def state(self) -> Vector:
        """Present state, (n,)."""
        out: Vector = self._filter.x
        return out

    @property
    def covariance(self) -> Matrix:
        """Present covariance, (n, n)."""
        out: Matrix = self._filter.P
        return out

    def set(self, state: Vector, covariance: Matrix) -> None:
        """Go back to a state and covariance."""
        self._filter.x, self._filter.P = np.array(state), np.array(covariance)

    def time_update(self, phi: Matrix, effect: Vector, q: Matrix) -> None:
        """Predict over one step."""
        self._filter.F, self._filter.Q = phi, q
        self._filter.predict(u=effect)

    def measurement_update(self, h: Matrix, r: Matrix, residual: Vector) -> float:
        """Update with rows h (m, n), noise r (m, m) and residual (m,) from the present state; returns NIS."""
        zero = np.zeros(len(residual))
        self._filter.update(residual, HJacobian=lambda _: h, Hx=lambda _: zero, R=r)
        return float(residual @ np.linalg.solve(self._filter.S, residual))


def believed(seen: list[int], nis: Callable[[list[int]], float], limit: Callable[[list[int]], float]) -> list[int]:
    """Groups that are credible alone and together; nis and limit: of some of them.

    Of a set that contradicts itself the one without which the rest agree best is left out, and so on; two are believed
    only if no other two agree, as two glints may.
    """

    def credible(groups: list[int]) -> bool:
        return len(groups) > 0 and nis(groups) <= limit(groups)

    good = [i for i in seen if credible([i])]
    if len(good) < 2 or credible(good):
        return good
    while len(good) > 2:
        fewer = [[j for j in good if j != i] for i in good]
        agreeing = [groups for groups in fewer if credible(groups)]
        good = min(fewer, key=nis)
        if len(agreeing) == 1 or (len(agreeing) > 1 and len(good) > 2):
            return good
    return []
