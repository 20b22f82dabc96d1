"""Faults of markers that last: as `faults.py`, for the filter of position and attitude.

Sensors are flown as drawn, the filter knowing of noise and of the chaser's attitude sigma alone, and built within the
model's tolerances, which the filter considers. The chaser's attitude error is drawn where built. Position and
attitude are judged where records say that the pose is to be relied on, `ambiguity` of 18.4 or more.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.accuracy.faults import BUILT, DRAWN, FROM_S, RUNS, TOLD, FaultsReport, Verdict, fly_faults, judge
from relnav.arrays import Matrix
from relnav.mission import VisionMission
from relnav.navigation.pose_log import filter_marker_epochs
from relnav.navigation.pose_record import PoseSolution
from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT
from relnav.simulation.as_built import markers_as_built
from relnav.simulation.lasting_faults import (
    ATTITUDE_RAD,
    FOCAL_LENGTH_SHARE,
    PLACED_M,
    Fault,
    direction,
    end_of,
    faulty_camera,
    with_fault,
)
from relnav.simulation.marker_flight import MarkerFlight, simulate_flight, true_spots
from relnav.simulation.trajectory import Approach

METHOD = "pose"
NAMES = {
    Fault.STUCK: "one spot frozen for 20 s",
    Fault.REFLECTION: "static reflection for 10 s",
    Fault.ATTITUDE: "chaser attitude off by 1 deg",
    Fault.LATE: "images 0.5 s late",
    Fault.PLACED: "one marker off by 5 mm",
}
"""Where the word for beacons is another."""
UNSEEN = (Fault.ATTITUDE, Fault.FOCAL_LENGTH, Fault.PLACED)
NOT_OBSERVABLE = {(DRAWN, Fault.LATE), *((flown, fault) for flown in (DRAWN, BUILT) for fault in UNSEEN)}
"""What images cannot tell (`docs/validation.md` says why); told as a sigma it is in the covariance."""


def cases() -> list[tuple[str, Fault]]:
    """Every way to fly with every fault."""
    return [*((flown, fault) for flown in (DRAWN, BUILT) for fault in Fault), *((TOLD, fault) for fault in UNSEEN)]


def told_mission(mission: VisionMission, flown: str, fault: Fault) -> VisionMission:
    """What the filter is told."""
    t, chaser = mission.tolerances, mission.chaser
    if t is None:
        raise ValueError(f"model {mission.name} has no [tolerances]: what a built sensor may be like is not known")
    t = dataclasses.replace(t, considered=flown != DRAWN)
    if flown == TOLD and fault == Fault.FOCAL_LENGTH:
        t = dataclasses.replace(t, focal_length_relative_sigma=FOCAL_LENGTH_SHARE)
    if flown == TOLD and fault == Fault.PLACED:
        t = dataclasses.replace(t, marker_placement_sigma_m=PLACED_M / math.sqrt(3.0))
    if flown == TOLD and fault == Fault.ATTITUDE:
        chaser = dataclasses.replace(chaser, attitude_sigma_rad=ATTITUDE_RAD / math.sqrt(3.0))
    return dataclasses.replace(mission, tolerances=t, chaser=chaser)


def run_once(mission: VisionMission, flown: str, fault: Fault, seed: int) -> Verdict:
    """One flight with a fault, judged."""
    told, rng = told_mission(mission, flown, fault), np.random.default_rng([seed, list(Fault).index(fault)])
    real = mission if flown == DRAWN else markers_as_built(mission, seed)
    if flown == DRAWN:
        real = dataclasses.replace(real, chaser=dataclasses.replace(real.chaser, attitude_sigma_rad=0.0))
    real = faulty_camera(real, fault, rng)
    start = (10.0, float(rng.uniform(-0.4, 0.4)), float(rng.uniform(-0.4, 0.4)))
    thrust = float(rng.normal()) * told.process_noise.control_magnitude_sigma
    approach = Approach(
        start_m=start,
        final_range_m=4.2,
        thrust_scale_error=thrust,
        assumed_noise=True,
        assumed_start=fault == Fault.HEALTHY,  # a velocity that the filter does not know
    )
    flight = simulate_flight(real, approach, seed=int(rng.integers(2**62)))
    known = flight.dcm_chaser_from_lvlh
    from_s, noise = float(rng.uniform(*FROM_S)), real.camera.spot_noise_px
    last = true_spots(real, flight.motion, flight.dcm_lvlh_from_target, known)[:, 2]
    t_log, spots = with_fault(flight.t_s, flight.spots_px, fault, from_s, noise, last, 0.0, rng)
    if fault == Fault.ATTITUDE:
        known = Rotation.from_rotvec(ATTITUDE_RAD * direction(rng, 3)).as_matrix() @ known
    track = filter_marker_epochs(
        told,
        t_log,
        spots,
        acceleration_m_s2=flight.acceleration_m_s2,
        q_chaser_from_lvlh=Rotation.from_matrix(known).as_quat(),
    )
    sigma = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))[:, [0, 1, 2, 6, 7, 8]]
    errors = pose_errors(track, flight)
    errors[track.ambiguity < AMBIGUITY_LIMIT] = 0.0  # said to be not relied on
    return judge(flight.t_s, errors, sigma, track.alarm, track.status, end_of(fault, from_s))


def pose_errors(track: PoseSolution, flight: MarkerFlight) -> Matrix:
    """Errors of position m, `lvlh_ccsds`, and attitude rad, target axes, (n, 6); NaN without a state."""
    known = np.isfinite(track.state[:, 0])
    errors = np.full((len(track), 6), np.nan)
    errors[:, :3] = (track.state - flight.motion)[:, :3]
    estimated = Rotation.from_matrix(track.dcm_lvlh_from_target[known])
    errors[known, 3:] = (estimated.inv() * Rotation.from_matrix(flight.dcm_lvlh_from_target[known])).as_rotvec()
    return errors


def measure_faults(
    mission: VisionMission, *, runs: int = RUNS, seed: int = 7, progress: Callable[[int], None] | None = None
) -> FaultsReport:
    """Fly `runs` approaches for every fault, sensors as drawn and as built.

    Raises
    ------
    ValueError
        For fewer than two runs, or a model without tolerances.
    """

    def once(flown: str, fault: Fault, seed: int) -> tuple[Verdict, ...]:
        return (run_once(mission, flown, fault, seed),)

    rows = fly_faults(cases(), once, (METHOD,), NOT_OBSERVABLE, NAMES, runs, seed, progress)
    return FaultsReport(mission.name, runs, seed, rows)
