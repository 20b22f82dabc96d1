"""The marker filter through long gaps on tumbling targets of unequal moments: honest at the end, both engines alike.

The truth is scipy's: Euler's equations, the attitude a quaternion from an inertial frame; the chaser hangs still in the
orbit before a target whose markers are seen from all sides.
"""

import copy
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

import relnav
from relnav.estimation.consistency import chi_square_interval
from relnav.navigation.status import UPDATED

SLENDER, BROAD = np.diag([1000.0, 3000.0, 3800.0]), np.diag([1000.0, 1400.0, 1570.0])
MARKERS = np.array(
    [[0.0, 0.5, 0.5], [0.0, -0.5, 0.5], [0.5, 0.0, 0.0], [0.0, 0.4, -0.6], [-0.5, -0.3, -0.2], [-0.4, 0.6, 0.1]]
)
CHASER = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # its camera looks along x of lvlh
PLACE, RUNS = np.array([-12.0, 0.0, 0.0]), 30
SIGMAS = np.array([0.01, 0.001, np.radians(1.0)])


class Flight:
    """A target that tumbles, images a second apart, a gap, three images more; and a filter that was handed over."""

    def __init__(self, turning, inertia, deg_s, spot_px, images, gap_s, seed):
        shipped, rng = relnav.load_model("three_marker_vision"), np.random.default_rng(seed)
        self.n, sigma_rate = shipped.orbit.mean_motion_rad_s, np.radians(deg_s)
        self.mission = replace(
            shipped,
            markers=replace(shipped.markers, positions_m=tuple(map(tuple, MARKERS.tolist()))),
            target=replace(
                shipped.target, inertia_kg_m2=tuple(map(tuple, inertia.tolist())), rate_noise_density_rad2_s3=1e-16
            ),
            chaser=replace(shipped.chaser, attitude_sigma_rad=0.0, attitude_noise_rad=1e-6),
            camera=replace(shipped.camera, spot_noise_px=spot_px),
            filter=replace(shipped.filter, initial_rate_sigma_rad_s=sigma_rate),
        )
        self.images, last = images, images - 1.0 + gap_s
        self.t = np.concatenate([np.arange(images), last + np.arange(3)]).astype(float)
        start = Rotation.random(rng=rng)
        rate = -self.n * start.as_matrix()[1] + sigma_rate * rng.normal(size=3)
        dcm, rate = turning(self.t, start, rate[None], inertia[None], self.n)
        self.dcm, self.rate = dcm[:, 0], rate[:, 0]
        seen = ((self.dcm @ MARKERS.T).transpose(0, 2, 1) - PLACE) @ CHASER.T
        focal, center = np.array(shipped.camera.focal_length_px), np.array(shipped.camera.principal_point_px)
        self.spots = focal * seen[..., :2] / seen[..., 2:] + center + spot_px * rng.normal(size=(len(self.t), 6, 2))
        self.sigma = np.repeat([*SIGMAS, sigma_rate], 3)
        self.off = self.sigma * rng.normal(size=12)

    def begin(self, engine="compiled"):
        nav, e = relnav.PoseNavigator(self.mission, engine=engine), self.off
        dcm = self.dcm[0] @ Rotation.from_rotvec(-e[6:9]).as_matrix()
        nav.start(0.0, np.append(PLACE - e[:3], -e[3:6]), dcm, self.rate[0] - e[9:], np.diag(self.sigma**2))
        for k in range(self.images):
            record = nav.step(self.t[k], self.spots[k], dcm_chaser_from_lvlh=CHASER)
        return nav, record

    def through_the_gap(self, nav, step_s):
        for now in np.arange(self.t[self.images - 1], self.t[self.images], step_s)[1:] if step_s else []:
            nav.step(now, dcm_chaser_from_lvlh=CHASER)
        return nav.step(self.t[self.images], dcm_chaser_from_lvlh=CHASER)

    def nees(self, record, k):
        turn = Rotation.from_matrix(record.dcm_lvlh_from_target.T @ self.dcm[k]).as_rotvec()
        moved = np.append(PLACE, np.zeros(3)) - record.state
        error = np.concatenate([moved, turn, self.rate[k] - record.rate_rad_s])
        return error @ np.linalg.solve(record.covariance, error)


@pytest.mark.parametrize(
    ("inertia", "deg_s", "spot_px", "images", "gap_s", "step_s"),
    [
        (SLENDER, 5.0, 0.5, 20, 60.0, None),
        (SLENDER, 5.0, 0.5, 20, 60.0, 2.0),
        (SLENDER, 5.0, 0.5, 5, 30.0, 0.5),
        (BROAD, 5.0, 0.5, 20, 60.0, None),
        (SLENDER, 0.5, 0.5, 20, 120.0, None),
    ],
)
def test_nees_after_a_gap(turning, inertia, deg_s, spot_px, images, gap_s, step_s):
    """At its end, after the next image and after two more."""
    found = []
    for seed in range(RUNS):
        flight = Flight(turning, inertia, deg_s, spot_px, images, gap_s, seed)
        nav, _ = flight.begin()
        k, each = images, [flight.nees(flight.through_the_gap(nav, step_s), images)]
        for k in range(images, images + 3):
            record = nav.step(flight.t[k], flight.spots[k], dcm_chaser_from_lvlh=CHASER)
            assert record.status == UPDATED
            each.append(flight.nees(record, k))
        found.append(each)
    mean = np.mean(found, axis=0) / 12.0
    print(mean.round(2), (np.max(found, axis=0) / 12.0).round(1))
    assert mean.max() <= chi_square_interval(12 * RUNS, 0.9999)[1]


@pytest.mark.parametrize("step_s", [None, 6.0])
def test_engines_agree_after_a_gap(turning, step_s):
    """Both follow the same bending, each by its own equations of motion."""
    flight = Flight(turning, SLENDER, 5.0, 0.5, 12, 30.0, 3)
    records = []
    for engine in ("compiled", "filterpy"):
        nav, _ = flight.begin(engine)
        before = flight.through_the_gap(nav, step_s)
        poses = nav.hypotheses[0].state
        assert_allclose(poses.covariance, before.covariance, rtol=0.0, atol=1e-12)
        after = nav.step(flight.t[12], flight.spots[12], dcm_chaser_from_lvlh=CHASER)
        records.append((before, after))
    for ours, theirs in zip(*records, strict=True):
        sigma = np.sqrt(np.diag(ours.covariance))
        assert_allclose(theirs.covariance / sigma / sigma[:, None], ours.covariance / sigma / sigma[:, None], atol=2e-3)
        assert_allclose(theirs.rate_rad_s, ours.rate_rad_s, atol=1e-3 * sigma[9:].max())


def test_a_late_image_in_a_gap_is_as_in_order(turning):
    """What bends is part of the memory that is gone back to; a copy holds it too."""
    flight = Flight(turning, SLENDER, 5.0, 0.5, 12, 30.0, 4)
    (late, _), (ordered, _) = flight.begin(), flight.begin()
    for nav in (late, ordered):
        nav.step(20.0, dcm_chaser_from_lvlh=CHASER)
    ordered.step(41.0, flight.spots[12], dcm_chaser_from_lvlh=CHASER)
    predicted = late.step(41.5, dcm_chaser_from_lvlh=CHASER)
    at_once = ordered.step(41.5, dcm_chaser_from_lvlh=CHASER)
    assert predicted.covariance[6, 6] > 4.0 * at_once.covariance[6, 6]
    expected = ordered.step(42.0, dcm_chaser_from_lvlh=CHASER)
    for nav in (copy.copy(late), late):
        record = nav.step(42.0, flight.spots[12], image_t_s=41.0, dcm_chaser_from_lvlh=CHASER)
        assert_array_equal(record.covariance, expected.covariance)
