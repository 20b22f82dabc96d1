"""A vehicle's start that does not know how the target is turned, against truth: how long, how often wrong."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.arrays import Vector
from relnav.estimation.consistency import nees
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import VehicleRun, simulate_rendezvous
from relnav.spacecraft import Vehicle
from relnav.vehicle.filters import VehicleFilters
from relnav.vehicle.layout import TARGET_ATTITUDE


@dataclass(frozen=True)
class Start:
    """What became of one start.

    Attributes
    ----------
    most : int
        Explanations at once.
    found_s : float
        When one was left that images agreed with; NaN if that did not happen.
    error_rad, nees : float
        Of the target's attitude then; NEES has three degrees of freedom.
    """

    most: int
    found_s: float
    error_rad: float = float("nan")
    nees: float = float("nan")


def turned_vehicle(vehicle: Vehicle, turn: Rotation, sensors: Sequence[str], sigma_rad: float) -> Vehicle:
    """A vehicle with these sensors alone whose file says that the target is held otherwise by `turn`, within sigma."""
    told = vehicle.target.q_target_from_lvlh
    target = replace(vehicle.target, q_target_from_lvlh=tuple((turn * Rotation.from_quat(told)).as_quat().tolist()))
    return replace(
        vehicle,
        target=target,
        hand_over=replace(vehicle.hand_over, target_attitude_sigma_rad=sigma_rad),
        sensor={name: vehicle.sensor[name] for name in sensors},
        models={name: vehicle.models[name] for name in sensors},
    )


def rolled(vehicle: Vehicle, start_m: float, roll_rad: float, tilt_rad: Sequence[float], seed: int) -> VehicleRun:
    """A flight of ten seconds along the port's axis, rolled about it; target and chaser tilted alike, (2,)."""
    tilt = Rotation.from_rotvec([0.0, *tilt_rad])
    held = [Rotation.from_quat(q) for q in (vehicle.chaser.q_chaser_from_lvlh, vehicle.target.q_target_from_lvlh)]
    chaser, target = held[0] * tilt, Rotation.from_rotvec([roll_rad, 0.0, 0.0]) * held[1] * tilt
    flown = replace(
        vehicle,
        chaser=replace(vehicle.chaser, q_chaser_from_lvlh=tuple(chaser.as_quat().tolist())),
        target=replace(vehicle.target, q_target_from_lvlh=tuple(target.as_quat().tolist())),
        hand_over=replace(vehicle.hand_over, port_distance_m=(start_m, 0.0, 0.0)),
    )
    return simulate_rendezvous(flown, Rendezvous(start_m=start_m, final_m=start_m - 3.0), seed=seed)


def search(run: VehicleRun, vehicle: Vehicle) -> Start:
    """Start with the observations of a flight that this vehicle's sensors made, until the attitude is found."""
    filters = VehicleFilters(vehicle, 0.0, {"position_m": run.truth.vehicle.start_position_m}, monitor=False)
    filters.samples.fill(run.samples)
    tracked, most = filters.start, 0
    for seen in sorted(run.others, key=lambda one: one.t_s):
        event = filters.event(seen.sensor, seen.t_s, seen.value, None) if seen.sensor in filters.places else None
        if event is not None:
            tracked, _ = filters.apply(tracked, event)
        if tracked.search is None:
            break
        most = max(most, len(tracked.search.hypotheses))
    else:
        return Start(most, float("nan"))
    at = tracked.estimates.of(0)
    true = run.truth.dcm_frame_from_target(np.array([at.t_s]))[0]
    error: Vector = rotation_vector_between(true, at.dcm_lvlh_from_target)
    off = float(nees(error, at.covariance[TARGET_ATTITUDE, TARGET_ATTITUDE]))
    return Start(most, at.t_s, float(np.linalg.norm(error)), off)
