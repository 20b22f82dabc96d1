"""The same estimation on filterpy's ExtendedKalmanFilter: an engine of other hands to check ours against.

filterpy keeps P itself and updates it in Joseph's form with an inverted S: right on well-conditioned problems. Its
traps are kept out: predict() comes before update() (`predict_update` linearises at the unpredicted state), NIS is
formed here (`mahalanobis` is stale after an update without a measurement), and it is imported only when used (2 s).
"""

from typing import Any

import numpy as np

from relnav.arrays import Matrix, Vector


class ReferenceTrack:
    """State and covariance of one track, on filterpy."""

    considered: Matrix
    """What lasting errors do to the state, a row an error (m, 6): the caller's to carry."""

    def __init__(self, state: Vector, covariance: Matrix) -> None:
        """Start from a state (6,) and its covariance (6, 6)."""
        from filterpy.kalman import ExtendedKalmanFilter

        self._filter: Any = ExtendedKalmanFilter(dim_x=6, dim_z=1, dim_u=6)
        self._filter.x = np.array(state)
        self._filter.P = np.array(covariance)
        self._filter.B = np.eye(6)

    @property
    def state(self) -> Vector:
        """Present state, (6,)."""
        out: Vector = self._filter.x
        return out

    @property
    def covariance(self) -> Matrix:
        """Present covariance, (6, 6)."""
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
        """Update with rows h (m, 6), noise r (m, m) and residual (m,) from the present state; returns NIS."""
        zero = np.zeros(len(residual))
        self._filter.update(residual, HJacobian=lambda _: h, Hx=lambda _: zero, R=r)
        return float(residual @ np.linalg.solve(self._filter.S, residual))
