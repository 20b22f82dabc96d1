"""The `fix` filter as a careful user writes it in numpy: exact closed form, R at the predicted geometry, CW, update."""

import math

import numpy as np


class ByHand:
    """Constants of the three-beacon sensor and the pieces of the filter."""

    def __init__(self, model):
        """Take the numbers of a loaded model."""
        sensor = model.sensor
        self.f, self.s = sensor.focal_length_m, sensor.spot_noise_m
        self.a, self.b = sensor.beacon_half_spacing_m, sensor.beacon_c_distance_m
        self.beacons = sensor.beacons_dock_m
        self.dock, self.camera = model.dcm_dock_from_lvlh, model.dcm_cam_from_lvlh
        self.cam_from_dock = self.camera @ self.dock.T
        self.n = model.orbit.mean_motion_rad_s
        self.density = model.process_noise.acceleration_noise_density_m2_s3

    def closed_form(self, spots):
        """A published closed form, depth-corrected until it is exact for central projection.

        Cai, Zhao, Sun, Qiao, Dai (1996),
        "Determination of target relative position and range by PSD optical sensor system".
        """
        u = np.column_stack([spots, np.full(3, self.f)])
        u /= np.linalg.norm(u, axis=1)[:, None]
        w = u[0] + u[1]
        w /= np.linalg.norm(w)
        depth, old, k = np.ones(3), np.zeros(3), 2.0 * self.a / self.b
        for _ in range(40):
            v = u * (depth / (u @ w))[:, None]
            middle = 0.5 * (v[0] + v[1])
            d, c = v[0] - v[1], v[2] - middle
            d, c = d - w * (d @ w), c - w * (c @ w)
            square = d @ d
            t, up = k * (c @ d) / square, k * (w @ np.cross(d, c)) / square
            m = 1.0 + t * t + up * up
            q = up / m
            z = 2.0 * q / (1.0 + math.sqrt(1.0 - 4.0 * q * q))
            weight = (1.0 + z * z) / m
            x = math.sqrt(weight - z * z)
            r = 2.0 * self.a * math.sqrt(weight / square)
            p = r * np.array([x, -t * weight / x, z])
            if np.abs(p - old).max() < 1e-9 * r:  # the next pass would move it fifteen times less
                break
            old, w, depth = p, middle / np.linalg.norm(middle), 1.0 - (self.beacons @ p) / (r * r)
        return p

    @staticmethod
    def angles(p):
        """Range, azimuth, elevation."""
        horizontal = math.hypot(p[0], p[1])
        return np.array([math.hypot(horizontal, p[2]), math.atan2(p[1], p[0]), math.atan2(-p[2], horizontal)])

    @staticmethod
    def angles_jacobian(p):
        """Their derivative."""
        x, y, z = p
        h2 = x * x + y * y
        h, r2 = math.sqrt(h2), h2 + z * z
        r = math.sqrt(r2)
        return np.array([[x / r, y / r, z / r], [-y / h2, x / h2, 0.0], [x * z / (h * r2), y * z / (h * r2), -h / r2]])

    def noise(self, p):
        """R = s^2 J J^T, J the upper half of the inverse 6 x 6 projection Jacobian at p, turned into angles."""
        full = np.empty((6, 6))
        for i in range(3):
            c = self.cam_from_dock @ (self.beacons[i] - p)
            project = self.f / c[2] * np.array([[1.0, 0.0, -c[0] / c[2]], [0.0, 1.0, -c[1] / c[2]]])
            turn = np.array([[0.0, c[2], -c[1]], [-c[2], 0.0, c[0]], [c[1], -c[0], 0.0]])
            full[2 * i : 2 * i + 2] = np.hstack([-project @ self.cam_from_dock, project @ turn])
        j = self.angles_jacobian(p) @ np.linalg.inv(full)[:3]
        return self.s**2 * j @ j.T

    def transition(self, dt):
        """Clohessy-Wiltshire in lvlh_ccsds, and its process noise to first order in n dt."""
        n = self.n
        s, c = math.sin(n * dt), math.cos(n * dt)
        phi = np.array(
            [
                [1.0, 0.0, 6.0 * (n * dt - s), (4.0 * s - 3.0 * n * dt) / n, 0.0, 2.0 * (1.0 - c) / n],
                [0.0, c, 0.0, 0.0, s / n, 0.0],
                [0.0, 0.0, 4.0 - 3.0 * c, -2.0 * (1.0 - c) / n, 0.0, s / n],
                [0.0, 0.0, 6.0 * n * (1.0 - c), 4.0 * c - 3.0, 0.0, 2.0 * s],
                [0.0, -n * s, 0.0, 0.0, c, 0.0],
                [0.0, 0.0, 3.0 * n * s, -2.0 * s, 0.0, c],
            ]
        )
        eye = np.eye(3) * self.density
        q = np.block([[eye * dt**3 / 3.0, eye * dt**2 / 2.0], [eye * dt**2 / 2.0, eye * dt]])
        return phi, q

    def effect(self, dt):
        """What an acceleration held over dt does to the state, (6, 3): Simpson's rule over the transition."""
        first, middle, last = (self.transition(part * dt)[0][:, 3:] for part in (0.0, 0.5, 1.0))
        return dt / 6.0 * (first + 4.0 * middle + last)

    def measurement(self, x):
        """Prediction, its rows and its noise at the state x."""
        p = self.dock @ x[:3]
        h = np.zeros((3, 6))
        h[:, :3] = self.angles_jacobian(p) @ self.dock
        return self.angles(p), h, self.noise(p)

    @staticmethod
    def residual(z, predicted):
        """Difference with wrapped angles."""
        d = z - predicted
        d[1:] = (d[1:] + math.pi) % (2.0 * math.pi) - math.pi
        return d

    def step(self, x, covariance, phi, q, spots):
        """One epoch in plain numpy: predict, closed form, NIS, Joseph update."""
        x, covariance = phi @ x, phi @ covariance @ phi.T + q
        z = self.angles(self.closed_form(spots))
        predicted, h, r = self.measurement(x)
        y = self.residual(z, predicted)
        s = h @ covariance @ h.T + r
        k = np.linalg.solve(s, h @ covariance).T
        rest = np.eye(6) - k @ h
        return x + k @ y, rest @ covariance @ rest.T + k @ r @ k.T, float(y @ np.linalg.solve(s, y))


class OnFilterpy:
    """The same on filterpy's ExtendedKalmanFilter, as its documentation has it."""

    def __init__(self, hand, x, covariance, phi, q):
        """Start from a state and covariance."""
        from filterpy.kalman import ExtendedKalmanFilter

        self.hand = hand
        self.filter = ExtendedKalmanFilter(dim_x=6, dim_z=3)
        self.filter.x, self.filter.P = x.copy(), covariance.copy()
        self.filter.F, self.filter.Q = phi, q

    def step(self, spots, push=0.0):
        """One epoch: predict, closed form, update; push: what the control adds to the state."""
        hand, ekf = self.hand, self.filter
        ekf.predict()
        ekf.x = ekf.x + push
        z = hand.angles(hand.closed_form(spots))
        predicted, h, r = hand.measurement(ekf.x)
        ekf.update(z, HJacobian=lambda _: h, Hx=lambda _: predicted, R=r, residual=hand.residual)
        return ekf.x


class OnKalmanPy:
    """The same on kalman-py's ExtendedKalmanFilter."""

    def __init__(self, hand, x, covariance, phi, q):
        """Start from a state and covariance."""
        from kalman_py import ExtendedKalmanFilter

        self.hand = hand
        self.filter = ExtendedKalmanFilter(
            lambda state, _dt: phi @ state,
            lambda state: hand.angles(hand.dock @ state[:3]),
            q,
            np.eye(3),
            x,
            covariance,
            jac_f=lambda _state, _dt: phi,
            jac_h=lambda _state: self.rows,
            residual_z=hand.residual,
        )

    def step(self, spots):
        """One epoch: predict, closed form, update."""
        hand, ekf = self.hand, self.filter
        ekf.predict(0.1)
        z = hand.angles(hand.closed_form(spots))
        _, self.rows, ekf.R = hand.measurement(ekf.x)
        ekf.update(z)
        return ekf.x


def filterpy_smoother(phi, q, states, covariances):
    """Filterpy's backward pass over filtered states (n, 6) and covariances (n, 6, 6)."""
    from filterpy.kalman import KalmanFilter

    n = len(states)
    smoother = KalmanFilter(dim_x=6, dim_z=3)
    smoothed, spread, _, _ = smoother.rts_smoother(states, covariances, Fs=[phi] * n, Qs=[q] * n)
    return smoothed, spread
