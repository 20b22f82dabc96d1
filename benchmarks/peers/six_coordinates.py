"""The `spots` filter as a user writes it on filterpy: its ExtendedKalmanFilter fed the six detector coordinates."""

import numpy as np


class SixCoordinates:
    """No closed form, and one R: the measurement is where three known points appear."""

    def __init__(self, model, x, covariance, phi, q):
        """Start from a state and covariance."""
        from filterpy.kalman import ExtendedKalmanFilter

        self.f, self.camera = model.sensor.focal_length_m, model.dcm_cam_from_lvlh
        self.beacons, self.lever = model.beacons_lvlh_m, model.camera_lever_cam_m
        self.filter = ExtendedKalmanFilter(dim_x=6, dim_z=6)
        self.filter.x, self.filter.P = x.copy(), covariance.copy()
        self.filter.F, self.filter.Q, self.filter.R = phi, q, model.spot_sigma_m**2 * np.eye(6)

    def measurement(self, x):
        """Where the spots should be, and the derivative."""
        c = (self.beacons - x[:3]) @ self.camera.T - self.lever
        s = c[:, :2] / c[:, 2:]
        rows = np.zeros((6, 6))
        by_place = (self.f / c[:, 2])[:, None, None] * (s[:, :, None] * self.camera[2] - self.camera[:2])
        rows[:, :3] = by_place.reshape(6, 3)
        return (self.f * s).ravel(), rows

    def step(self, spots, push=0.0):
        """One epoch: predict, update; push: what the control adds to the state."""
        ekf = self.filter
        ekf.predict()
        ekf.x = ekf.x + push
        predicted, rows = self.measurement(ekf.x)
        ekf.update(spots.ravel(), HJacobian=lambda _: rows, Hx=lambda _: predicted)
        return ekf.x
