"""The filter of `by_hand` on fast-kalman's ExtendedKalmanFilter, which is imported as `kalman`."""

import numpy as np


class OnFastKalman:
    """It has no gate, and no residual of angles: one asks its NIS afterwards and takes back what is not credible."""

    def __init__(self, start):
        """Start the filter."""
        from kalman import ExtendedKalmanFilter

        self.start = start
        self.filter = ExtendedKalmanFilter(6, 3, x=start.x, P=start.covariance.ravel(), Q=start.q.ravel())

    def step(self, spots, acceleration):
        """Range, state, covariance after one image."""
        start, ekf = self.start, self.filter
        moved = start.phi @ ekf.x + start.effect @ acceleration
        ekf.predict(lambda _: moved, lambda _: start.phi.ravel())
        x, covariance = ekf.x, ekf.P
        y, h, r = start.seen(moved, spots)
        ekf.R = r.ravel()
        if ekf.correct(y, lambda _: np.zeros(3), lambda _: h.ravel())["nis"] <= start.gate:
            x, covariance = ekf.x, ekf.P
        else:
            ekf.x, ekf.P = x, covariance
        return np.linalg.norm(x[:3]), np.asarray(x), np.reshape(covariance, (6, 6))
