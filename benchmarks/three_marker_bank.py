"""A flat pattern from 20 m: one filter on the most credible root loses the truth, one filter a root keeps it.

    python benchmarks/three_marker_bank.py --runs 50

Three markers in one plane have up to four poses that explain an image. `relnav.three_marker.measure` says so and hands
out all of them (`roots`). Here each starts an extended Kalman filter on the spots (relative position, velocity, target
attitude and rate; camera held still, constant velocities but for small noise). A filter is dropped when its latest
spots are a million times less likely than another's, and every ten seconds the roots of the image that no filter covers
start new ones. Compared with the filter that starts on the best root alone. The truth counts as lost if no filter has
it within 6 reported sigmas or 1 deg at the end. Exit code 1 if the bank loses it in more than one run of a hundred.
"""

import argparse
import copy
import math
import statistics
import sys

import numpy as np
from scipy.spatial.transform import Rotation

import relnav
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.sensors.three_marker import measure, project, spot_jacobians

DT_S = 1.0
STEPS = 150
RENEWED_S = 10
MEMORY = 0.98  # of the score, a second: what a filter was before it settled is forgotten
START_M, SPEED_M_S = 20.0, 0.1
WIDENED = 4.0  # of a root's covariance: seen head-on the misfit is no parabola, and the truth lies up to 3 sigma off
DROP = 2.0 * math.log(1e6)
RATE_SIGMA_RAD_S, SPEED_SIGMA_M_S = math.radians(0.05), 0.05
NOISE = np.diag([1e-8] * 3 + [math.radians(1e-4) ** 2] * 3)  # of velocity and rate, a second


class SpotFilter:
    """Twelve error states: position and velocity (camera axes), attitude and rate (target axes)."""

    def __init__(self, model, root):
        self.model, self.score = model, 0.0
        self.dcm, self.position = np.array(root.pose.dcm_cam_from_target), np.array(root.pose.position_m)
        self.velocity, self.rate = np.array([0.0, 0.0, -SPEED_M_S]), np.zeros(3)
        prior = np.zeros((6, 6))
        prior[3:, 3:] = np.eye(3) / model.view.attitude_sigma_rad**2
        self.covariance = np.zeros((12, 12))
        start = WIDENED * np.linalg.inv(np.linalg.inv(root.pose.covariance) + prior)
        here = [0, 1, 2, 6, 7, 8]
        self.covariance[np.ix_(here, here)] = start
        self.covariance[3:6, 3:6] = SPEED_SIGMA_M_S**2 * np.eye(3)
        self.covariance[9:, 9:] = RATE_SIGMA_RAD_S**2 * np.eye(3)

    def predict(self):
        """One interval on."""
        turn = Rotation.from_rotvec(self.rate * DT_S).as_matrix()
        F = np.eye(12)
        F[:3, 3:6] = DT_S * np.eye(3)
        F[6:9, 6:9], F[6:9, 9:] = turn.T, DT_S * np.eye(3)
        self.position = self.position + DT_S * self.velocity
        self.dcm = self.dcm @ turn
        self.covariance = F @ self.covariance @ F.T
        moving = [3, 4, 5, 9, 10, 11]
        self.covariance[np.ix_(moving, moving)] += DT_S * NOISE

    def update(self, spots):
        """Use the spots (n, 2), to second order in the attitude; the score grows by minus twice their log-likelihood.

        A plane that faces the camera shows a turn theta by its square: a filter of first order takes what it knows of
        the turn's size for knowledge of its sign.
        """
        points, camera = self.model.markers.points_m, self.model.camera
        seen = project(points @ self.dcm.T + self.position, camera).spots_px
        if not np.isfinite(seen).all():
            self.score = math.inf
            return
        J = spot_jacobians(points, np.vstack([self.dcm, self.position]), camera)
        H = np.zeros((spots.size, 12))
        H[:, :3], H[:, 6:9] = J.position.reshape(-1, 3), J.attitude.reshape(-1, 3)
        # p = C exp([theta x]) s has the second-order part C (theta theta^T - theta^T theta 1) s / 2
        q, s = J.marker.reshape(-1, 3), np.repeat(points, 2, axis=0)
        qs = q[:, :, None] * s[:, None, :]
        bend = 0.5 * (qs + qs.transpose(0, 2, 1)) - np.einsum("ij,ij->i", q, s)[:, None, None] * np.eye(3)
        spread = bend @ self.covariance[6:9, 6:9]
        curved = 0.5 * np.einsum("iab,jba->ij", spread, spread)
        R = camera.spot_noise_px**2 * np.eye(spots.size) + curved
        S = H @ self.covariance @ H.T + R
        gain = np.linalg.solve(S, H @ self.covariance).T
        innovation = (spots - seen).ravel() - 0.5 * np.trace(spread, axis1=1, axis2=2)
        self.score = MEMORY * self.score + float(innovation @ np.linalg.solve(S, innovation) + np.linalg.slogdet(S)[1])
        x = gain @ innovation
        keep = np.eye(12) - gain @ H
        self.covariance = keep @ self.covariance @ keep.T + gain @ R @ gain.T
        self.position, self.velocity = self.position + x[:3], self.velocity + x[3:6]
        self.dcm, self.rate = self.dcm @ Rotation.from_rotvec(x[6:9]).as_matrix(), self.rate + x[9:]

    def covers(self, other):
        """Whether another filter's attitude is this one's within 4 sigma of both."""
        turn = rotation_vector_between(other.dcm, self.dcm)
        spread = self.covariance[6:9, 6:9] + other.covariance[6:9, 6:9]
        return float(turn @ np.linalg.solve(spread, turn)) < 16.0

    def errors(self, truth):
        """Attitude error, rad, and the largest ratio of an attitude error to its sigma."""
        turn = rotation_vector_between(truth, self.dcm)
        return float(np.linalg.norm(turn)), float(math.sqrt(turn @ np.linalg.solve(self.covariance[6:9, 6:9], turn)))


def starts(model, spots):
    """A filter on each pose that explains the spots, the most credible first."""
    return [SpotFilter(model, root) for root in measure(spots, model).roots]


def fly(model, seed):
    """One approach: ends of the single filter and of the bank, hypotheses left over time."""
    rng = np.random.default_rng(seed)
    dcm = (
        model.view.dcm_cam_from_target
        @ Rotation.from_rotvec(model.view.attitude_sigma_rad * rng.normal(size=3)).as_matrix()
    )
    rate = RATE_SIGMA_RAD_S * rng.normal(size=3)
    velocity = np.array([*(0.002 * rng.normal(size=2)), -SPEED_M_S])
    position = np.array([*rng.uniform(-0.5, 0.5, 2), START_M])

    def image():
        spots = project(model.markers.points_m @ dcm.T + position, model.camera).spots_px
        return spots + model.camera.spot_noise_px * rng.normal(size=spots.shape)

    bank, left = starts(model, image()), []
    single = copy.deepcopy(bank[0])
    for step in range(1, STEPS + 1):
        dcm = dcm @ Rotation.from_rotvec(rate * DT_S).as_matrix()
        position = position + DT_S * velocity
        spots = image()
        for one in (single, *bank):
            one.predict()
            one.update(spots)
        if step % RENEWED_S == 0:
            fresh = [one for one in starts(model, spots) if not any(other.covers(one) for other in bank)]
            for one in fresh:
                one.score = min(other.score for other in bank)
            bank += fresh
        best = min(one.score for one in bank)
        bank = [one for one in bank if one.score - best < DROP]
        left.append(len(bank))
    best = min(bank, key=lambda one: one.score)
    return single.errors(dcm), best.errors(dcm), min(one.errors(dcm) for one in bank), left


def main() -> int:
    """Fly, count, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args()
    model = relnav.load_model("three_marker_vision_flat")
    singles, bests, banks, left = zip(*(fly(model, options.seed * 1000 + k) for k in range(options.runs)), strict=True)
    lost = {}
    for name, ends in (
        ("one filter, on the best root", singles),
        ("most credible of the bank", bests),
        ("any of the bank", banks),
    ):
        lost[name] = sum(ratio > 6.0 and angle > math.radians(1.0) for angle, ratio in ends)
        angles = [math.degrees(angle) for angle, _ in ends]
        print(
            f"{name:<30} truth lost in {lost[name]} of {options.runs}, attitude error at the end: "
            f"median {statistics.median(angles):.2f} deg, worst {max(angles):.1f} deg"
        )
    counts = np.array(left)
    shown = ", ".join(f"{counts[:, k].mean():.1f} after {k + 1} s" for k in (0, 29, 59, 99, STEPS - 1))
    print(f"hypotheses left: {shown}")
    return 1 if lost["any of the bank"] > 0.01 * options.runs else 0


if __name__ == "__main__":
    sys.exit(main())
