"""The unscented filter against the published one as its paper tells it: Euler angles, on filterpy.

What filterpy 2.0.0 leaves to its user is done here. Angles have no plain mean: they are averaged about the first sigma
point. A covariance of rotations is no covariance of Euler angles: R and Q pass through T^-1. `update` uses the sigma
points of the last `predict`, whatever was updated since (and does nothing before the first): they are drawn anew. Its P
loses symmetry: it is restored. The weights are those of the symmetric set with no weight on the mean.
"""

import math

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from scipy.spatial.transform import Rotation

from relnav.dynamics.rigid_body import RigidBody
from relnav.mission import Orbit
from relnav.navigation.attitude.target_attitude import TargetAttitude
from relnav.simulation.target_rotation import rotate_target

N = 1.1313666536110223e-3
INERTIA = np.diag([3000.0, 4200.0, 4700.0])
DENSITY, SIGMA = (2e-6) ** 2, math.radians(0.5)


def dcm_of(angles):
    """3-2-1 Euler angles (phi, theta, psi)."""
    return Rotation.from_euler("ZYX", angles[::-1]).as_matrix()


def angles_of(dcm):
    return Rotation.from_matrix(dcm).as_euler("ZYX")[::-1]


def turn_of_angles(angles):
    """T (6, 6): small changes of (angles, rate) are the body's (turn, rate change) T d(angles, rate)."""
    sp, cp, st, ct = math.sin(angles[0]), math.cos(angles[0]), math.sin(angles[1]), math.cos(angles[1])
    out = np.eye(6)
    out[:3, :3] = [[1.0, 0.0, -st], [0.0, cp, sp * ct], [0.0, -sp, cp * ct]]
    return out


def nearer(a, b):
    """Difference a - b, the three angles to the nearer side."""
    out = np.asarray(a - b)
    out[:3] = np.remainder(out[:3] + math.pi, 2.0 * math.pi) - math.pi
    return out


def mean_of(sigmas, weights):
    return sigmas[0] + weights @ np.array([nearer(one, sigmas[0]) for one in sigmas])


def root_of(covariance):
    """The upper triangle M with M^T M = P: its rows are the directions L_j that our filter takes."""
    return np.linalg.cholesky(covariance).T


class Published:
    """The paper's filter: reduced order, additive noise, 13 sigma points."""

    def __init__(self, dcm, rate, covariance):
        self.body = RigidBody(INERTIA, N)
        self.filter = UnscentedKalmanFilter(
            dim_x=6,
            dim_z=3,
            dt=1.0,
            hx=lambda x: x[:3],
            fx=self.moved,
            points=MerweScaledSigmaPoints(6, alpha=1.0, beta=0.0, kappa=0.0, sqrt_method=root_of, subtract=np.subtract),
            x_mean_fn=mean_of,
            z_mean_fn=mean_of,
            residual_x=nearer,
            residual_z=nearer,
        )
        self.filter.x = np.concatenate([angles_of(dcm), rate])
        back = np.linalg.inv(turn_of_angles(self.filter.x))
        self.filter.P = back @ covariance @ back.T

    def moved(self, x, dt):
        dcm, rate = self.body.propagate(dcm_of(x[:3]), x[3:], dt)
        return np.concatenate([angles_of(dcm), rate])

    def predict(self, dt):
        f = self.filter
        noise = self.body.propagate_with_errors(dcm_of(f.x[:3]), f.x[3:], dt, DENSITY)[3]
        back = np.linalg.inv(turn_of_angles(self.moved(f.x, dt)))
        f.Q = back @ noise @ back.T
        f.predict(dt=dt)
        f.P = 0.5 * (f.P + f.P.T)

    def update(self, measured, noise):
        f = self.filter
        f.sigmas_f = f.points_fn.sigma_points(f.x, f.P)
        back = np.linalg.inv(turn_of_angles(f.x)[:3, :3])
        f.update(angles_of(measured), R=back @ noise @ back.T)
        f.P = 0.5 * (f.P + f.P.T)

    @property
    def covariance(self):
        turn = turn_of_angles(self.filter.x)
        return turn @ self.filter.P @ turn.T


def test_the_same_filter_in_the_papers_case(outside):
    """Attitudes of some ten degrees, a minute at 10 Hz: states within 3 % of their sigmas, sigmas within 1e-3."""
    rng, t = np.random.default_rng(3), np.arange(0.0, 60.0, 0.1)
    start = Rotation.from_rotvec([0.1, -0.15, 0.2])
    dcm, _ = rotate_target(t, [start.as_quat()], np.radians([[0.2, 0.1, -0.3]]), INERTIA, Orbit(N), DENSITY, rng)
    seen = dcm[:, 0] @ Rotation.from_rotvec(SIGMA * rng.normal(size=(len(t), 3))).as_matrix()
    noise = SIGMA**2 * np.eye(3)
    ours = TargetAttitude(
        INERTIA,
        N,
        rate_noise_density_rad2_s3=DENSITY,
        initial_rate_sigma_rad_s=math.radians(0.5),
        method="unscented",
    )
    theirs, farthest, compared = None, 0.0, 0
    for now, measured in zip(t, seen, strict=True):
        record = ours.step(now, measured, noise)
        if theirs is not None:
            theirs.predict(0.1)
            if record.accepted:
                theirs.update(measured, noise)
            x, sigma = theirs.filter.x, np.sqrt(np.diag(record.covariance))
            turn = Rotation.from_matrix(record.dcm_lvlh_from_target.T @ dcm_of(x[:3])).as_rotvec()
            off = np.concatenate([turn, x[3:] - record.rate_rad_s]) / sigma
            farthest, compared = max(farthest, np.abs(off).max()), compared + 1
            np.testing.assert_allclose(np.sqrt(np.diag(theirs.covariance)), sigma, rtol=1e-3)
        elif record.accepted:
            theirs = Published(record.dcm_lvlh_from_target, record.rate_rad_s, record.covariance)
    assert compared > 590
    outside("filterpy UnscentedKalmanFilter on Euler angles", "target attitude and rate, 1-sigma", farthest, 0.03)


def test_euler_angles_of_the_published_filter():
    """T by differences."""
    angles, steps = np.array([0.3, -0.2, 0.5]), 1e-6 * np.eye(3)
    for i, step in enumerate(steps):
        turn = Rotation.from_matrix(dcm_of(angles - step).T @ dcm_of(angles + step)).as_rotvec() / 2e-6
        np.testing.assert_allclose(turn, turn_of_angles(angles)[:3, i], atol=1e-8)


@pytest.mark.parametrize("pitch_deg", [70.0, 89.9])
def test_ours_has_no_pole(pitch_deg):
    """At a pitch near 90 deg T is singular; rotation vectors about the present attitude do not know the pole."""
    dcm = Rotation.from_euler("ZYX", [0.0, pitch_deg, 0.0], degrees=True).as_matrix()
    ours = TargetAttitude(
        INERTIA, 0.0, rate_noise_density_rad2_s3=0.0, initial_rate_sigma_rad_s=1e-5, method="unscented"
    )
    for k in range(20):
        record = ours.step(0.1 * k, dcm, SIGMA**2 * np.eye(3))
    np.testing.assert_allclose(record.dcm_lvlh_from_target, dcm, atol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(record.covariance)[:3]), SIGMA / math.sqrt(20.0), rtol=0.02)
