"""How far the pose filter is off the truth of simulated flights, and whether its covariance says so."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.arrays import Flags, Matrix, Stack, Vector
from relnav.dynamics.rigid_body import RigidBody
from relnav.estimation.attitude import joseph, reset
from relnav.estimation.consistency import nees
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.mission import VisionMission
from relnav.navigation.pose_log import filter_marker_epochs
from relnav.navigation.pose_state import PoseState, camera_pose, state_from_pose, time_update
from relnav.navigation.relative_pose import PoseNavigator
from relnav.sensors.three_marker.measure import measure
from relnav.sensors.three_marker.pose import Pose
from relnav.simulation.marker_flight import MarkerFaults, MarkerFlight, simulate_flight
from relnav.simulation.trajectory import Approach


@dataclass(frozen=True)
class PoseErrors:
    """Errors at the epochs of one or more flights.

    Attributes
    ----------
    t_s, range_m : (k,)
        Time in the flight, true distance of the centres of mass.
    error : (k, 12)
        Truth against estimate: position m, velocity m/s (`lvlh_ccsds`), attitude rad, rate rad/s (target axes).
    covariance : (k, 12, 12)
    nis_ratio : (k,)
        NIS over its degrees of freedom; NaN where nothing was seen.
    hypotheses : (k,)
    """

    t_s: Vector
    range_m: Vector
    error: Matrix
    covariance: Stack
    nis_ratio: Vector
    hypotheses: Vector

    def where(self, chosen: Flags) -> "PoseErrors":
        """The epochs for which chosen (k,) holds."""
        return PoseErrors(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    @property
    def position_rms_m(self) -> float:
        """Of the whole position error."""
        return float(np.sqrt(np.mean(np.sum(self.error[:, :3] ** 2, axis=-1))))

    @property
    def attitude_rms_rad(self) -> float:
        """Of the whole attitude error."""
        return float(np.sqrt(np.mean(np.sum(self.error[:, 6:9] ** 2, axis=-1))))

    @property
    def nees_ratio(self) -> float:
        """Mean NEES / 12."""
        return float(np.mean(nees(self.error, self.covariance))) / 12.0


def _errors(flight: MarkerFlight, k: int, state: PoseState) -> Vector:
    truth = PoseState(flight.motion[k], flight.dcm_lvlh_from_target[k], flight.rate_rad_s[k], state.covariance)
    return state.error_of(truth)


def tight_errors(mission: VisionMission, flight: MarkerFlight) -> PoseErrors:
    """Of the navigator on a flight, at the epochs at which it has a state."""
    nav, rows = PoseNavigator(mission), []
    for k, t in enumerate(flight.t_s):
        record = nav.step(
            float(t),
            flight.spots_px[k],
            acceleration_m_s2=flight.acceleration_m_s2[k],
            dcm_chaser_from_lvlh=flight.dcm_chaser_from_lvlh[k],
        )
        if record.hypotheses:
            state = PoseState(record.state, record.dcm_lvlh_from_target, record.rate_rad_s, record.covariance)
            ratio = record.nis / record.dof if record.dof else math.nan
            rows.append((k, _errors(flight, k, state), record.covariance, ratio, record.hypotheses))
    return _gathered(flight, rows)


def smoothed_errors(mission: VisionMission, flight: MarkerFlight) -> PoseErrors:
    """Of the smoother over a whole flight, at the epochs at which the filter has a state."""
    smoothed = filter_marker_epochs(
        mission,
        flight.t_s,
        flight.spots_px,
        acceleration_m_s2=flight.acceleration_m_s2,
        q_chaser_from_lvlh=Rotation.from_matrix(flight.dcm_chaser_from_lvlh).as_quat(),
        smooth=True,
    )
    rows = []
    for k in np.flatnonzero(smoothed.hypotheses > 0).tolist():
        covariance, hypotheses = smoothed.covariance[k], int(smoothed.hypotheses[k])
        state = PoseState(smoothed.state[k], smoothed.dcm_lvlh_from_target[k], smoothed.rate_rad_s[k], covariance)
        ratio = smoothed.nis[k] / smoothed.dof[k] if smoothed.dof[k] else math.nan
        rows.append((k, _errors(flight, k, state), covariance, ratio, hypotheses))
    return _gathered(flight, rows)


def loose_errors(mission: VisionMission, flight: MarkerFlight) -> PoseErrors:
    """Of a filter that takes finished poses, and so needs three spots: what the tight coupling is compared with."""
    body = RigidBody(np.array(mission.target.inertia_kg_m2), mission.orbit.mean_motion_rad_s)
    state: PoseState | None = None
    rows = []
    for k, t in enumerate(flight.t_s):
        dcm = flight.dcm_chaser_from_lvlh[k]
        if state is not None:
            dt = float(t - flight.t_s[k - 1])
            state, _, _ = time_update(state, dt, body, mission, flight.acceleration_m_s2[k], np.zeros(3))
        pose = measure(flight.spots_px[k], mission)
        if pose.ok and state is None:
            state = state_from_pose(pose.pose, mission, dcm, t_s=float(t))
        elif pose.ok and state is not None:
            state = pose_update(state, pose.pose, mission, dcm)
        if state is not None:
            rows.append((k, _errors(flight, k, state), state.covariance, math.nan, 1))
    return _gathered(flight, rows)


def pose_update(state: PoseState, pose: Pose, mission: VisionMission, dcm_chaser_from_lvlh: Matrix) -> PoseState:
    """Use a finished pose of one image (loosely coupled), as a textbook's extended Kalman filter does."""
    expected, here = camera_pose(state, mission, dcm_chaser_from_lvlh), slice(6, 9)
    h = np.zeros((6, 12))
    h[:3, :3], h[3:, here] = -mission.camera.dcm_cam_from_chaser @ dcm_chaser_from_lvlh, np.eye(3)
    alpha = np.empty((6, 3))  # how a chaser attitude error moves the pose that is seen
    alpha[:3] = mission.camera.dcm_cam_from_chaser @ cross_matrix(-dcm_chaser_from_lvlh @ state.motion[:3])
    alpha[3:] = -(dcm_chaser_from_lvlh @ state.dcm_lvlh_from_target).T
    noise = pose.covariance + mission.chaser.attitude_sigma_rad**2 * alpha @ alpha.T
    turn = rotation_vector_between(pose.dcm_cam_from_target, expected[:3])
    gain = np.linalg.solve(h @ state.covariance @ h.T + noise, h @ state.covariance).T
    correction = gain @ np.concatenate([pose.position_m - expected[3], turn])
    updated = joseph(state.covariance, np.asarray(gain), h, noise)
    return state.moved(correction, reset(updated, correction[here], at=6))


def _gathered(flight: MarkerFlight, rows: list[tuple[int, Vector, Matrix, float, int]]) -> PoseErrors:
    at = np.array([row[0] for row in rows], dtype=np.int64)
    return PoseErrors(
        flight.t_s[at],
        np.linalg.norm(flight.motion[at, :3], axis=-1),
        np.array([row[1] for row in rows]).reshape(-1, 12),
        np.array([row[2] for row in rows]).reshape(-1, 12, 12),
        np.array([row[3] for row in rows]),
        np.array([row[4] for row in rows], dtype=np.float64),
    )


def joined(parts: list[PoseErrors]) -> PoseErrors:
    """Several flights as one."""
    return PoseErrors(*(np.concatenate([getattr(part, name) for part in parts]) for name in PoseErrors.__annotations__))


def flown(
    mission: VisionMission,
    approach: Approach,
    faults: MarkerFaults,
    runs: int,
    seed: int,
    errors: Callable[[VisionMission, MarkerFlight], PoseErrors] = tight_errors,
) -> PoseErrors:
    """Errors over flights of seeds seed, seed + 1, ...; errors: of the navigator, or another of the above."""
    return joined([errors(mission, simulate_flight(mission, approach, faults, seed + run)) for run in range(runs)])
