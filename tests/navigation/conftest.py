"""Flights, and how they are judged: errors and covariances are compared here with plain numpy, not with the product."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import relnav
from relnav.accuracy.campaign import noise_alone
from relnav.files.filter_log import filter_log
from relnav.navigation.docking_port import DockingState, docking_states
from relnav.navigation.observation.marker_poses import state_of, write_state
from relnav.navigation.observation.marker_rows import aim_camera, observe_markers
from relnav.navigation.pose_memory import new_pose_memory, pose_views
from relnav.navigation.pose_update import spot_update
from relnav.simulation.detector import Faults
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach

LOW_ORBIT_RAD_S = 1.1313666536110223e-3
"""Mean motion of the shipped models."""
EXAMPLES = Path(__file__).parents[2] / "examples" / "basilisk_approach"
ACCEPTED = (relnav.EpochStatus.UPDATED, relnav.EpochStatus.STARTED)


def nees_of(error, covariance):
    """e^T P^-1 e by the Cholesky factor of P, (n,); NaN where there is no state."""
    out = np.full(len(error), np.nan)
    for k in np.flatnonzero(np.isfinite(error).all(axis=1)):
        whitened = np.linalg.solve(np.linalg.cholesky(covariance[k]), error[k])
        out[k] = whitened @ whitened
    return out


@dataclass(frozen=True)
class Flight:
    """A filtered log beside its truth."""

    t_s: Any
    spots_m: Any
    acceleration_m_s2: Any
    truth: Any
    solution: Any

    @property
    def error(self):
        return self.solution.state - self.truth

    def nees(self, after_s=50.0):
        late = self.t_s >= after_s
        return nees_of(self.error[late], self.solution.covariance[late])

    def nis_per_dof(self, after_s=50.0):
        used = (self.t_s >= after_s) & np.isin(self.solution.status, ACCEPTED)
        return self.solution.nis[used].sum() / self.solution.dof[used].sum()


@pytest.fixture(scope="session")
def vbar():
    """The shipped model, its attitude believed without error: as simulated here."""
    return noise_alone(relnav.load_model("three_beacon_psd"), "spots")


@pytest.fixture(scope="session")
def rbar():
    return noise_alone(relnav.load_model("three_beacon_psd_rbar"), "spots")


@pytest.fixture(scope="session")
def unknown_attitude(vbar):
    return replace(vbar, attitude=replace(vbar.attitude, mode="unknown"))


@pytest.fixture(scope="session")
def nees():
    return nees_of


@pytest.fixture(scope="session")
def basilisk(vbar):
    """The flown example log through the file interface, by method."""
    truth = np.loadtxt(EXAMPLES / "vbar_truth.csv", delimiter=",", skiprows=1)

    def run(method):
        solution = filter_log(EXAMPLES / "vbar_log.csv", vbar, method=method)
        np.testing.assert_array_equal(solution.t_s, truth[:, 0])
        return Flight(solution.t_s, None, None, truth[:, 1:], solution)

    return run


@pytest.fixture(scope="session")
def fly():
    """Simulate an approach on integrated orbits and filter it: fly(model, method, faults, seed, edit, **approach)."""

    def run(model, *, method="spots", faults=None, seed=0, edit=None, **approach):
        log = simulate(model, Approach(**approach), faults or Faults(), seed)
        spots = log.spots_m.copy()
        if edit is not None:
            edit(log.t_s, spots)
        solution = relnav.filter_epochs(model, log.t_s, spots, acceleration_m_s2=log.acceleration_m_s2, method=method)
        return Flight(log.t_s, spots, log.acceleration_m_s2, log.truth, solution)

    return run


def clohessy_wiltshire(n):
    """The equations of motion as a matrix, axes x V-bar, y = -h, z nadir."""
    a = np.zeros((6, 6))
    a[:3, 3:] = np.eye(3)
    a[3, 5], a[4, 1], a[5, 2], a[5, 3] = 2 * n, -n * n, 3 * n * n, -2 * n
    return a


@pytest.fixture(scope="session")
def drift():
    """Truth by matrix exponential: drift(model, t, x0, acceleration, impulse), control as in the log contract."""

    def run(model, t, x0, acceleration=None, impulse=None):
        a = np.zeros((9, 9))
        a[:6, :6] = clohessy_wiltshire(model.orbit.mean_motion_rad_s)
        a[3:6, 6:] = np.eye(3)
        truth = np.empty((len(t), 6))
        truth[0] = x0
        steps = {}
        for k in range(1, len(t)):
            dt = round(t[k] - t[k - 1], 9)
            if dt not in steps:
                steps[dt] = expm(a * dt)
            held = np.zeros(3) if acceleration is None else acceleration[k]
            truth[k] = (steps[dt] @ np.concatenate([truth[k - 1], held]))[:6]
            if impulse is not None:
                truth[k, 3:] += impulse[k]
        return truth

    return run


@pytest.fixture(scope="session")
def look():
    """Spots of true states, by a camera written out here: look(model, truth, seed, dcm_cam_from_lvlh, noise_m)."""

    def run(model, truth, seed=0, dcm=None, noise_m=None):
        held = model.dcm_cam_from_lvlh
        q_mount = np.array(model.camera.q_cam_from_chaser)
        lever_cam = rotation(q_mount) @ np.array(model.camera.position_m)
        dock = rotation(np.array(model.docking.q_dock_from_lvlh))
        a, b = model.sensor.beacon_half_spacing_m, model.sensor.beacon_c_distance_m
        beacons = np.array(model.docking.port_position_m) + np.array([[0, a, 0], [0, -a, 0], [b, 0, 0]]) @ dock
        half = 0.5 * np.array(model.sensor.detector_size_m)
        rng = np.random.default_rng(seed)
        sigma = model.sensor.spot_noise_m if noise_m is None else noise_m
        spots = np.full((len(truth), 3, 2), np.nan)
        for k, state in enumerate(truth):
            c = held if dcm is None else dcm[k]
            for i in range(3):
                u = c @ (beacons[i] - state[:3]) - lever_cam
                spot = model.sensor.focal_length_m * u[:2] / u[2] + sigma * rng.normal(size=2)
                if u[2] > 0.0 and np.all(np.abs(spot) <= half):
                    spots[k, i] = spot
        return spots

    return run


def rotation(q):
    """Matrix of a unit quaternion (x, y, z, w), by Rodrigues' formula."""
    v, w = q[:3], q[3]
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


@pytest.fixture(scope="session")
def rotation_of():
    return rotation


@dataclass(frozen=True)
class MarkerImage:
    """One image about one state: what the marker filter sees in it, and what it makes of it."""

    innovation: Any
    rows: Any
    noise: Any
    state: Any
    accepted: Any
    score: float


def _of_groups(m, count, name):
    return m.groups[name][:count, :2].reshape(2 * count, -1)


@pytest.fixture(scope="session")
def marker_image():
    """marker_image(state, spots, mission, dcm_chaser_from_lvlh, limit): the limit is the gate's, for any dof."""

    def run(state, spots, mission, dcm, limit=1e9):
        m, none = pose_views(new_pose_memory(mission)), np.empty((0, 2, 2))
        m.gate[:] = limit
        write_state(m.bank[0], state)
        aim_camera(m.camera, np.ascontiguousarray(dcm))
        track = m.bank[0]
        _, count = observe_markers(m, track, m.bank_sensitivities[0], np.ascontiguousarray(spots), none)
        residual, rows = _of_groups(m, count, "residual")[:, 0].copy(), _of_groups(m, count, "gradient").copy()
        noise = m.noise[: 2 * count, : 2 * count].copy()
        _, groups, _, _ = spot_update(
            m, track, m.bank_sensitivities[0], m.bank_evidence[0, :0], np.ascontiguousarray(spots), none, True
        )
        accepted = np.zeros(len(spots), dtype=bool)
        accepted[m.which[:groups][m.groups["tested"][:groups] > 0].astype(int)] = True
        return MarkerImage(
            residual, rows, noise, state_of(track, m.bank_sensitivities[0]), accepted, float(track["score"])
        )

    return run


@pytest.fixture(scope="session")
def docking_of():
    """docking_of(state, mission, dcm_chaser_from_lvlh, chaser_rate): the docking state of one estimate."""

    def run(state, mission, dcm, rate=None):
        whole = docking_states(
            state.motion[None],
            state.dcm_lvlh_from_target[None],
            state.rate_rad_s[None],
            state.covariance[None],
            mission,
            dcm[None],
            np.zeros(1),
            None if rate is None else rate[None],
        )
        return DockingState(*(values[0] for values in vars(whole).values()))

    return run


def tumbling_bodies(t, start, rate, inertia, n=LOW_ORBIT_RAD_S):
    """Attitudes dcm_lvlh_from_target (n, runs, 3, 3) and inertial rates (n, runs, 3) of bodies of inertia (runs, 3, 3).

    At t = 0 the inertial frame is `lvlh_ccsds`, which turns at -n about its y.
    """
    runs, inverse = len(rate), np.linalg.inv(inertia)

    def derivative(now, x):
        q, w = x[: 4 * runs].reshape(runs, 4), x[4 * runs :].reshape(runs, 3)
        v, s = q[:, :3], q[:, 3:]
        turn = np.hstack([0.5 * (s * w + np.cross(v, w)), -0.5 * np.sum(v * w, axis=1, keepdims=True)])
        nadir = Rotation.from_quat(q).inv().apply(Rotation.from_rotvec([0.0, -n * now, 0.0]).apply([0.0, 0.0, 1.0]))
        of_nadir, of_rate = (np.einsum("rij,rj->ri", inertia, one) for one in (nadir, w))
        torque = 3.0 * n**2 * np.cross(nadir, of_nadir) - np.cross(w, of_rate)
        return np.concatenate([turn.ravel(), np.einsum("rij,rj->ri", inverse, torque).ravel()])

    x = np.concatenate([start.as_quat().ravel(), rate.ravel()])
    x = solve_ivp(derivative, (t[0], t[-1]), x, method="DOP853", t_eval=t, rtol=1e-10, atol=1e-12).y.T
    frames = Rotation.from_rotvec(np.outer(t, [0.0, n, 0.0])).as_matrix()
    attitudes = Rotation.from_quat(x[:, : 4 * runs].reshape(-1, 4)).as_matrix().reshape(len(t), runs, 3, 3)
    return frames[:, None] @ attitudes, x[:, 4 * runs :].reshape(len(t), runs, 3)


@pytest.fixture(scope="session")
def turning():
    """turning(t, start, rate, inertia): the attitudes of `tumbling_bodies`, which share nothing with the product."""
    return tumbling_bodies
