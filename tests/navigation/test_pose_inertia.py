"""The marker filter on tumbling targets whose inertia is not quite the model's: considered where its sigma is stated.

The truth is scipy's: Euler's equations of a body whose inertia is drawn once a run, an attitude that is a quaternion
from an inertial frame; the chaser hangs still in the orbit before a target whose markers are seen from all sides.
"""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

import relnav
from relnav.dynamics.error_state import POSE
from relnav.errors import ModelError
from relnav.estimation.consistency import chi_square_interval
from relnav.navigation.pose_log import MarkerLogFilter, filter_marker_epochs, smoothed_rows
from relnav.navigation.pose_memory import new_pose_memory, pose_views
from relnav.navigation.pose_record import PoseSolution
from relnav.navigation.pose_smoothing import PoseSmoother
from relnav.navigation.status import UPDATED
from relnav.simulation.as_built import markers_as_built
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

INERTIA = np.array([[3000.0, 150.0, -90.0], [150.0, 4200.0, 60.0], [-90.0, 60.0, 4700.0]])
MARKERS = np.array(
    [[0.0, 0.5, 0.5], [0.0, -0.5, 0.5], [0.5, 0.0, 0.0], [0.0, 0.4, -0.6], [-0.5, -0.3, -0.2], [-0.4, 0.6, 0.1]]
)
CHASER = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # its camera looks along x of lvlh
PLACE, RUNS = np.array([-12.0, 0.0, 0.0]), 20
SIGMA = [[60.0, 30.0, 10.0], [30.0, 90.0, 20.0], [10.0, 20.0, 120.0]]
SIGMAS = np.array([0.01, 0.001, np.radians(1.0)])


class Flight:
    """Images of a target whose inertia is off by a tolerance of its mean moment, each entry, and a filter."""

    def __init__(self, turning, tolerance, deg_s, seed, t=None, spot_px=0.3, told=True):
        shipped, rng = relnav.load_model("three_marker_vision"), np.random.default_rng(seed)
        self.t, sigma_rate = np.arange(0.0, 120.0, 0.5) if t is None else t, np.radians(deg_s) / np.sqrt(3.0)
        sigma, draw = tolerance * np.trace(INERTIA) / 3.0 * np.ones((3, 3)), np.tril(rng.normal(size=(3, 3)))
        self.mission = replace(
            shipped,
            markers=replace(shipped.markers, positions_m=tuple(map(tuple, MARKERS.tolist()))),
            target=replace(
                shipped.target,
                inertia_kg_m2=tuple(map(tuple, INERTIA.tolist())),
                inertia_sigma_kg_m2=tuple(map(tuple, ((sigma if told else 0.0) * np.ones((3, 3))).tolist())),
                rate_noise_density_rad2_s3=1e-14,
            ),
            chaser=replace(shipped.chaser, attitude_sigma_rad=0.0, attitude_noise_rad=1e-6),
            camera=replace(shipped.camera, spot_noise_px=spot_px),
            filter=replace(shipped.filter, initial_rate_sigma_rad_s=sigma_rate),
        )
        start, n, axis = Rotation.random(rng=rng), shipped.orbit.mean_motion_rad_s, rng.normal(size=3)
        rate = -n * start.as_matrix()[1] + np.radians(deg_s) * axis / np.linalg.norm(axis)
        true = INERTIA + sigma * (draw + np.tril(draw, -1).T)
        dcm, rate = turning(self.t, start, rate[None], true[None], n)
        self.dcm, self.rate = dcm[:, 0], rate[:, 0]
        seen = ((self.dcm @ MARKERS.T).transpose(0, 2, 1) - PLACE) @ CHASER.T
        focal, center = np.array(shipped.camera.focal_length_px), np.array(shipped.camera.principal_point_px)
        self.spots = focal * seen[..., :2] / seen[..., 2:] + center
        self.spots += spot_px * rng.normal(size=self.spots.shape)
        self.sigma = np.repeat([*SIGMAS, sigma_rate], 3)
        self.off = self.sigma * rng.normal(size=12)

    def begin(self, engine="compiled"):
        nav, e = relnav.PoseNavigator(self.mission, engine=engine), self.off
        dcm = self.dcm[0] @ Rotation.from_rotvec(-e[6:9]).as_matrix()
        nav.start(0.0, np.append(PLACE - e[:3], -e[3:6]), dcm, self.rate[0] - e[9:], np.diag(self.sigma**2))
        return nav

    def step(self, nav, k, **told):
        return nav.step(self.t[k], self.spots[k], dcm_chaser_from_lvlh=CHASER, **told)

    def nees(self, state, dcm, rate, covariance, k):
        turn = Rotation.from_matrix(dcm.T @ self.dcm[k]).as_rotvec()
        error = np.concatenate([np.append(PLACE, np.zeros(3)) - state, turn, self.rate[k] - rate])
        return error @ np.linalg.solve(covariance, error)

    def of(self, record, k):
        return self.nees(record.state, record.dcm_lvlh_from_target, record.rate_rad_s, record.covariance, k)


def flown(turning, tolerance, deg_s, told=True, runs=RUNS):
    """NEES / 12 every 20 s, mean of flights of two minutes, and the share of images used whole."""
    found, whole = [], []
    for seed in range(runs):
        flight = Flight(turning, tolerance, deg_s, seed, told=told)
        nav = flight.begin()
        records = [flight.step(nav, k) for k in range(len(flight.t))]
        whole.append(np.mean([record.status == UPDATED for record in records]))
        found.append([flight.of(records[k], k) / 12.0 for k in range(39, len(flight.t), 40)])
    return np.mean(found, axis=0), np.mean(whole)


@pytest.mark.parametrize("deg_s", [1.0, 5.0])
@pytest.mark.parametrize("tolerance", [0.002, 0.01, 0.05])
def test_nees_with_an_inertia_that_is_off(turning, tolerance, deg_s):
    """Every 20 s, of 20 runs; not far too careful either, which a filter that learns nothing would be."""
    mean, whole = flown(turning, tolerance, deg_s)
    print(f"{tolerance:.1%} {deg_s} deg/s: NEES / 12 {mean.round(2)}, used whole {whole:.4f}")
    assert mean.max() < chi_square_interval(12 * RUNS, 0.9999)[1]
    assert mean.mean() > 0.55
    assert whole > 0.99


@pytest.mark.parametrize(("tolerance", "deg_s"), [(0.002, 5.0), (0.01, 1.0), (0.05, 5.0)])
def test_nees_without_its_sigma(turning, tolerance, deg_s):
    """The reason for the sigma: the same flights, the inertia taken for exact."""
    mean, _ = flown(turning, tolerance, deg_s, told=False, runs=5)
    print(f"{tolerance:.1%} {deg_s} deg/s, not stated: NEES / 12 {mean.round(1)}")
    assert mean[-1] > 10.0


@pytest.mark.parametrize(("tolerance", "gap_s", "step_s"), [(0.002, 60.0, None), (0.01, 60.0, 2.0), (0.05, 30.0, None)])
def test_nees_after_a_gap(turning, tolerance, gap_s, step_s):
    """At its end, where the attitude is known to 1 to 23 deg, and after each of four images more."""
    t, found = np.concatenate([np.arange(0.0, 40.0, 0.5), 39.5 + gap_s + np.arange(4.0)]), []
    for seed in range(RUNS):
        flight = Flight(turning, tolerance, 5.0, seed, t=t)
        nav = flight.begin()
        for k in range(80):
            flight.step(nav, k)
        for now in np.arange(39.5, t[80], step_s)[1:] if step_s else []:
            nav.step(now, dcm_chaser_from_lvlh=CHASER)
        each = [flight.of(nav.step(t[80], dcm_chaser_from_lvlh=CHASER), 80)]
        each += [flight.of(flight.step(nav, k), k) for k in range(80, 84)]
        found.append(each)
    mean = np.mean(found, axis=0) / 12.0
    print(f"{tolerance:.1%}, gap of {gap_s:g} s: NEES / 12 {mean.round(2)}")
    assert mean.max() < chi_square_interval(12 * RUNS, 0.9999)[1]


def smoothed(flight):
    """A flight filtered and smoothed from its start: the two solutions."""
    log, e = MarkerLogFilter(flight.mission, keep=True), flight.off
    dcm = flight.dcm[0] @ Rotation.from_rotvec(-e[6:9]).as_matrix()
    log.start(0.0, np.append(PLACE - e[:3], -e[3:6]), dcm, flight.rate[0] - e[9:], np.diag(flight.sigma**2))
    held = np.tile(Rotation.from_matrix(CHASER).as_quat(), (len(flight.t), 1))
    epochs = log.forward(flight.t, flight.spots, np.zeros((len(flight.t), 6)), held)
    events, apart = log.passed(last=True)
    after = epochs.copy()
    for part in (slice(len(events) // 2, None), slice(0, len(events) // 2)):  # in chunks, the last first
        if part.start:
            smoother = PoseSmoother(flight.mission)
        smoother.backward(events[part], apart[part])
    smoothed_rows(after, events[events["row"] > 0])
    return PoseSolution(flight.mission, epochs), PoseSolution(flight.mission, after, smoothed=True)


@pytest.mark.parametrize(("tolerance", "deg_s"), [(0.002, 5.0), (0.01, 1.0), (0.05, 5.0)])
def test_nees_of_smoothed_states(turning, tolerance, deg_s):
    """They are twice as good as the filtered ones, and say so."""
    at, found, sizes = range(20, 221, 40), [], []
    for seed in range(RUNS):
        flight = Flight(turning, tolerance, deg_s, seed)
        filtered, after = smoothed(flight)
        told = [np.sqrt(one.covariance[at, 6, 6]) for one in (filtered, after)]
        sizes.append(np.median(told[1] / told[0]))
        found.append(
            [
                flight.nees(one.state[k], one.dcm_lvlh_from_target[k], one.rate_rad_s[k], one.covariance[k], k)
                for one in (after,)
                for k in at
            ]
        )
    mean = np.mean(found, axis=0) / 12.0
    print(f"{tolerance:.1%} {deg_s} deg/s smoothed: NEES / 12 {mean.round(2)}, sigma {np.mean(sizes):.2f} of filtered")
    assert mean.max() < chi_square_interval(12 * RUNS, 0.9999)[1]
    assert mean.mean() > 0.5
    assert np.mean(sizes) < 0.8


def test_smoothed_states_of_an_inertia_as_good_as_exact(turning):
    """Both smoothers are one where there is nothing to tell them apart."""
    exact, nearly = (smoothed(Flight(turning, 1e-9, 1.0, 4, told=told))[1] for told in (False, True))
    sigma = np.sqrt(np.diagonal(exact.covariance, axis1=1, axis2=2))
    assert np.abs((exact.state - nearly.state) / sigma[:, :6]).max() < 1e-3
    assert np.abs((exact.rate_rad_s - nearly.rate_rad_s) / sigma[:, 9:]).max() < 1e-2
    assert_allclose(np.diagonal(nearly.covariance, axis1=1, axis2=2), sigma**2, rtol=3e-3)


def test_engines_agree(turning):
    """In flight, in a gap in which errors bend, and at the image after it: each by its own equations of motion."""
    flight = Flight(turning, 0.02, 5.0, 3, t=np.array([*np.arange(0.0, 8.0, 0.5), 20.0, 28.0, 28.5]))
    flight.spots[[16, 17]] = np.nan
    ours, theirs = flight.begin(), flight.begin("filterpy")
    for k in range(len(flight.t)):
        one, other = flight.step(ours, k), flight.step(theirs, k)
        sigma = np.sqrt(np.diag(one.covariance))
        turn = Rotation.from_matrix(one.dcm_lvlh_from_target.T @ other.dcm_lvlh_from_target).as_rotvec()
        off = np.concatenate([other.state - one.state, turn, other.rate_rad_s - one.rate_rad_s]) / sigma
        spread = (other.covariance - one.covariance) / sigma / sigma[:, None]
        print(k, np.abs(off).max(), np.abs(spread).max())
        assert one.status == other.status
        assert np.abs(off).max() < (2e-3 if k < 16 else 2e-2)
        assert np.abs(spread).max() < (1e-3 if k < 16 else 2e-2)


def test_a_late_image_is_as_in_order_and_a_copy_goes_on(turning):
    """What the inertia has done, and what it bends, is in the memory that is gone back to, and in what is saved."""
    flight = Flight(turning, 0.01, 5.0, 4, t=np.array([*np.arange(0.0, 20.0, 0.5), 60.0, 60.5]))
    late, ordered = flight.begin(), flight.begin()
    for k in range(40):
        flight.step(late, k)
        flight.step(ordered, k)
    for nav in (late, ordered):
        nav.step(50.0, dcm_chaser_from_lvlh=CHASER)
    flight.step(ordered, 40)
    ordered.step(60.25, dcm_chaser_from_lvlh=CHASER)
    expected = ordered.step(60.5, dcm_chaser_from_lvlh=CHASER)
    late.step(60.25, dcm_chaser_from_lvlh=CHASER)
    for nav in (pickle.loads(pickle.dumps(late)), late):
        record = nav.step(60.5, flight.spots[40], image_t_s=60.0, dcm_chaser_from_lvlh=CHASER)
        assert_array_equal(record.covariance, expected.covariance)
        assert_array_equal(record.rate_rad_s, expected.rate_rad_s)


@pytest.mark.parametrize("considered", [False, True])
def test_three_markers_from_a_start_of_their_own(considered):
    """Cold starts, tolerances of the camera considered or not; flights of the product's simulator, which draws both."""
    shipped, found = relnav.load_model("three_marker_vision"), []
    sigma = tuple(map(tuple, (0.02 * np.diag([3000.0, 4200.0, 4700.0])).tolist()))
    mission = replace(
        shipped,
        target=replace(shipped.target, inertia_sigma_kg_m2=sigma),
        tolerances=replace(shipped.tolerances, considered=considered),
        filter=replace(shipped.filter, initial_rate_sigma_rad_s=np.radians(1.0)),
    )
    for seed in range(RUNS):
        flown = markers_as_built(mission, seed) if considered else mission
        flight = simulate_flight(flown, Approach(duration_s=60.0, rate_hz=2.0), seed=seed)
        solution = filter_marker_epochs(
            mission, flight.t_s, flight.spots_px, acceleration_m_s2=flight.acceleration_m_s2
        )
        at = np.arange(39, 120, 40)
        turn = [
            Rotation.from_matrix(solution.dcm_lvlh_from_target[k].T @ flight.dcm_lvlh_from_target[k]).as_rotvec()
            for k in at
        ]
        error = np.hstack([flight.motion[at] - solution.state[at], turn, (flight.rate_rad_s - solution.rate_rad_s)[at]])
        found.append(np.einsum("ki,kij,kj->k", error, np.linalg.inv(solution.covariance[at]), error) / 12.0)
    mean = np.mean(found, axis=0)
    print(f"three markers, considered {considered}: NEES / 12 {mean.round(2)}")
    assert mean.max() < chi_square_interval(12 * RUNS, 0.9999)[1]


def test_what_is_stated_is_carried():
    """Six errors more, behind all others; none where no sigma is stated."""
    shipped = relnav.load_model("three_marker_vision")
    told = relnav.load_model("three_marker_vision", {"target.inertia_sigma_kg_m2": SIGMA})
    layout, plain = relnav.PoseNavigator(told).layout, relnav.PoseNavigator(shipped).layout
    assert layout.size - plain.size == 6
    assert layout.by_name["inertia_xx"].start == plain.size
    assert layout.prior[plain.size + 3, plain.size + 3] == SIGMA[1][2] ** 2
    assert layout.considered[plain.size :].all()
    assert len(pose_views(new_pose_memory(told)).bank_sensitivities[0]) == layout.size - POSE


@pytest.mark.parametrize("sigma", [[[1.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], (-np.eye(3)).tolist()])
def test_a_sigma_of_no_inertia(sigma):
    with pytest.raises(ModelError, match="inertia_sigma_kg_m2 is symmetric and nowhere below zero"):
        relnav.load_model("three_marker_vision", {"target.inertia_sigma_kg_m2": sigma})
