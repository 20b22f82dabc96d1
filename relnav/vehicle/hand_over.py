"""What a vehicle starts from: the hand-over of its file, or what another navigation system knows in its place.

Errors of relative GPS, filtered along an orbit, differ by axis, and those of position and velocity hang together: an
image, which shows the position, then tells the velocity too. The file's sigmas say nothing of that.
"""

import math
from dataclasses import replace
from typing import NamedTuple, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import LARGEST, Matrix, Vector, numbers, vector
from relnav.dynamics.error_state import MOTION, POSE
from relnav.estimation.factored import stated_covariance
from relnav.estimation.state_layout import StateLayout
from relnav.geometry.rotation import rotation
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.spacecraft import FASTEST_TARGET_RAD_S, FORESEEN_RAD, POINTS, Vehicle
from relnav.vehicle.arguments import three
from relnav.vehicle.layout import CHASER_ATTITUDE, TARGET_ATTITUDE, TARGET_RATE
from relnav.vehicle.orbit_frame import OrbitFrame

SIZES = MOTION, POSE, CHASER_ATTITUDE.stop
"""Of a covariance: of position and velocity, of the target's attitude and rate too, and of the chaser's attitude."""


class Told(TypedDict, total=False):
    """What a caller knows at the start, as of `VehicleNavigator`; what is left out, or None, is as the file has it."""

    position_m: ArrayLike | None
    velocity_m_s: ArrayLike | None
    covariance: ArrayLike | None
    dcm_lvlh_from_target: ArrayLike | None
    target_rate_rad_s: ArrayLike | None
    dcm_inertial_from_chaser: ArrayLike | None


class Start(NamedTuple):
    """Where a vehicle's filters begin.

    Attributes
    ----------
    t_s : float
    motion : (6,)
        Position and velocity.
    dcm_lvlh_from_target, target_rate_rad_s : (3, 3), (3,)
    dcm_inertial_from_chaser, dcm_lvlh_from_chaser : (3, 3)
    covariance : (k, k) or None
        Of the first errors, one of `SIZES`; None: as the file has it.
    target_sigma_rad : float
        Of its attitude, as the file has it.
    seeks_attitude : bool
        Whether so little is known of the target's attitude that it is looked for (`acquisition`).
    tells_target, tells_rate : bool
        Whether any of the target's attitude and rate is not the file's, and whether the rate is stated.
    """

    t_s: float
    motion: Vector
    dcm_lvlh_from_target: Matrix
    target_rate_rad_s: Vector
    dcm_inertial_from_chaser: Matrix
    dcm_lvlh_from_chaser: Matrix
    covariance: Matrix | None
    target_sigma_rad: float
    seeks_attitude: bool
    tells_target: bool
    tells_rate: bool

    def told_in(self, layout: StateLayout) -> StateLayout:
        """The layout with 1-sigma of what is stated, each block's the root mean square of its axes."""
        if self.covariance is None:
            return layout
        variances = self.covariance.diagonal()
        sigma = {b.name: math.sqrt(variances[b.place].mean()) for b in layout.blocks if b.place.stop <= len(variances)}
        return StateLayout(tuple(replace(b, sigma=sigma.get(b.name, b.sigma)) for b in layout.blocks))

    def prior(self, layout: StateLayout) -> Matrix:
        """Covariance of all errors at the start, (n, n)."""
        covariance = layout.prior.copy()
        if self.covariance is not None:
            k = len(self.covariance)
            covariance[:k, :k] = self.covariance
        return covariance

    def contradiction(self, dcm_lvlh_from_target: Matrix, now: Matrix, covariance: Matrix) -> float:
        """How much an attitude of the target contradicts what the start says of it: squared, in 1-sigma.

        now, covariance (3, 3): what has become of the stated one since; the file's is one that is held.
        """
        if not self.tells_target:
            angle = rotation_vector_between(dcm_lvlh_from_target, self.dcm_lvlh_from_target)
            return float(angle @ angle) / self.target_sigma_rad**2
        angle = rotation_vector_between(dcm_lvlh_from_target, now)
        return float(angle @ np.linalg.lstsq(covariance, angle)[0])  # nothing of directions that are known for sure


def start_of(vehicle: Vehicle, frame: OrbitFrame, t_s: float, told: Told) -> Start:
    """The start of a vehicle, from its file and what a caller knows.

    Raises
    ------
    ValueError
        For another shape, attitudes that are none, an invalid covariance, or attitudes known too little.
    """
    position, velocity = told.get("position_m"), told.get("velocity_m_s")
    place = three("position_m", vehicle.start_position_m if position is None else position)
    speed = three("velocity_m_s", vehicle.hand_over.velocity_m_s if velocity is None else velocity)
    target, rate = told.get("dcm_lvlh_from_target"), told.get("target_rate_rad_s")
    rate = vehicle.hand_over.target_rate_rad_s if rate is None else rate
    C_LT = vehicle.target.dcm_target_from_lvlh.T
    if target is not None:
        C_LT = rotation("dcm_lvlh_from_target", target).copy()
    w = frame.held_rate(C_LT, t_s) if rate is None else np.array(three("target_rate_rad_s", rate))
    C_LB, inertial = vehicle.chaser.dcm_chaser_from_lvlh.T, told.get("dcm_inertial_from_chaser")
    C_IB = (vehicle.chaser.dcm_chaser_from_lvlh @ frame.dcm_lvlh_from_inertial(t_s)).T
    if inertial is not None:
        C_IB = rotation("dcm_inertial_from_chaser", inertial).copy()
        C_LB = frame.dcm_lvlh_from_inertial(t_s) @ C_IB
    given = told.get("covariance")
    covariance = None if given is None else _covariance(given)
    tells, seeks = target is not None or rate is not None, vehicle.seeks_attitude
    if covariance is not None and len(covariance) > MOTION:
        tells, seeks = True, _seeks(vehicle, covariance)
    motion, sigma = np.concatenate([place, speed]), vehicle.hand_over.target_attitude_sigma_rad
    return Start(t_s, motion, C_LT, w, C_IB, C_LB, covariance, sigma, seeks, tells, rate is not None)


def _covariance(given: ArrayLike) -> Matrix:
    """A caller's covariance of the first errors, (k, k); ValueError for what is none."""
    array = numbers("covariance", given)
    if array.shape not in {(k, k) for k in SIZES}:
        raise ValueError(
            "covariance has shape (6, 6) of position and velocity, (12, 12) with the target's attitude and rate, or "
            f"(15, 15) with the chaser's attitude too; got {array.shape}"
        )
    covariance, _ = stated_covariance(vector("covariance", array, array.shape, LARGEST))
    return covariance


def _seeks(vehicle: Vehicle, covariance: Matrix) -> bool:
    """Whether the target's attitude is looked for; ValueError for attitudes and a rate that are known too little."""
    turn, rate = _largest(covariance, TARGET_ATTITUDE), _largest(covariance, TARGET_RATE)
    if turn > math.pi:
        raise ValueError(f"covariance: 1-sigma of the target's attitude is up to pi in every direction; got {turn:.4g}")
    if rate > FASTEST_TARGET_RAD_S:
        raise ValueError(
            f"covariance: 1-sigma of the target's rate is up to {FASTEST_TARGET_RAD_S:g} rad/s in every direction; "
            f"got {rate:.4g}"
        )
    if len(covariance) > POSE and (turned := _largest(covariance, CHASER_ATTITUDE)) > FORESEEN_RAD:
        raise ValueError(
            f"covariance: 1-sigma of the chaser's attitude is up to {FORESEEN_RAD:g} rad in every direction; got "
            f"{turned:.4g}"
        )
    seeks = turn > FORESEEN_RAD
    if seeks and not any(vehicle.kind(name) == POINTS for name in vehicle.sensor):
        raise ValueError(
            f"covariance: above {math.degrees(FORESEEN_RAD):.3g} deg, 1-sigma, the target's attitude is found from its "
            "lights; no sensor sees any"
        )
    return seeks


def _largest(covariance: Matrix, place: slice) -> float:
    """1-sigma of three errors in the direction in which it is largest."""
    return math.sqrt(max(np.linalg.eigvalsh(covariance[place, place])[-1], 0.0))
