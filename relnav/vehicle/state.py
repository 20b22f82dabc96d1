"""The estimate of a vehicle: values that never change once made, so that any of them can be gone back to."""

from dataclasses import dataclass, replace

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.dynamics.relative_motion import orbit_vector, true_anomaly_at
from relnav.estimation.attitude import reset
from relnav.geometry.rotation_vector import turned
from relnav.spacecraft import InertialOrbit, Vehicle
from relnav.vehicle.layout import CHASER_ATTITUDE, TARGET_ATTITUDE, TARGET_RATE, Layout

RESET_FROM_RAD = 1e-3
"""Below this correction the covariance is the same about the old and the new attitude to 5e-4 of itself."""


@dataclass(frozen=True)
class VehicleState:
    """An estimate.

    Attributes
    ----------
    t_s : float
        Of the chaser's attitude, which follows every gyro sample.
    settled_s : float
        Of all else. Not later than t_s.
    values : (n,)
        Additive values by the layout: position, velocity (`lvlh_ccsds` of the stated orbit), rate, bias and what lasts;
        zero where the error is that of an attitude.
    dcm_lvlh_from_target, dcm_inertial_from_chaser : (3, 3)
    dcm_at_settled : (3, 3)
        dcm_inertial_from_chaser at settled_s.
    covariance : (n, n)
        Of the errors at settled_s, truth = estimate and error.
    sample_rad_s : (3,)
        The last gyro sample; NaN before the first.
    sample_s : float
        Its time.
    bias_known : (6,)
        What the bias and its variance were when the gyro was lost; NaN while it is not.
    command_m_s2 : (3,)
        To the thrusters, chaser axes.
    """

    t_s: float
    settled_s: float
    values: Vector
    dcm_lvlh_from_target: Matrix
    dcm_inertial_from_chaser: Matrix
    dcm_at_settled: Matrix
    covariance: Matrix
    sample_rad_s: Vector
    sample_s: float
    bias_known: Vector
    command_m_s2: Vector

    def corrected(self, correction: Vector, covariance: Matrix) -> "VehicleState":
        """The estimate with a correction (n,) of its errors taken in; it must be settled."""
        values = self.values + correction
        values[TARGET_ATTITUDE] = values[CHASER_ATTITUDE] = 0.0
        for place in (TARGET_ATTITUDE, CHASER_ATTITUDE):
            if np.linalg.norm(correction[place]) > RESET_FROM_RAD:
                covariance = reset(covariance, correction[place], place.start)
        dcm = turned(self.dcm_inertial_from_chaser, correction[CHASER_ATTITUDE])
        return replace(
            self,
            values=values,
            dcm_lvlh_from_target=turned(self.dcm_lvlh_from_target, correction[TARGET_ATTITUDE]),
            dcm_inertial_from_chaser=dcm,
            dcm_at_settled=dcm,
            covariance=covariance,
        )


class OrbitFrame:
    """The stated orbit as a frame: `lvlh_ccsds` in inertial axes at any time."""

    def __init__(self, orbit: InertialOrbit) -> None:
        self.vector = orbit_vector(orbit.mean_motion_rad_s, orbit.eccentricity, orbit.true_anomaly_rad)
        ci, si = np.cos(orbit.inclination_rad), np.sin(orbit.inclination_rad)
        cn, sn = np.cos(orbit.ascending_node_rad), np.sin(orbit.ascending_node_rad)
        cp, sp = np.cos(orbit.perigee_argument_rad), np.sin(orbit.perigee_argument_rad)
        node = np.array([[cn, -sn * ci], [sn, cn * ci], [0.0, si]])
        self._plane = node @ np.array([[cp, -sp], [sp, cp]])  # columns: toward perigee, and a quarter turn on
        self._normal = np.cross(self._plane[:, 0], self._plane[:, 1])

    def dcm_lvlh_from_inertial(self, t_s: float) -> Matrix:
        """v_lvlh = dcm @ v_inertial, (3, 3)."""
        sine, cosine = true_anomaly_at(self.vector, t_s)
        out, dcm = self._plane @ np.array([cosine, sine]), np.empty((3, 3))
        dcm[0], dcm[1], dcm[2] = self._plane @ np.array([-sine, cosine]), -self._normal, -out
        return dcm


def start_state(
    vehicle: Vehicle, layout: Layout, frame: OrbitFrame, t_s: float, position_m: Vector, velocity_m_s: Vector
) -> VehicleState:
    """The estimate at hand-over: attitudes and rate as held, everything that lasts as stated."""
    values = np.zeros(layout.size)
    values[:3], values[3:6], values[TARGET_RATE] = position_m, velocity_m_s, vehicle.start_rate_rad_s
    dcm = (vehicle.chaser.dcm_chaser_from_lvlh @ frame.dcm_lvlh_from_inertial(t_s)).T.copy()
    return VehicleState(
        t_s=t_s,
        settled_s=t_s,
        values=values,
        dcm_lvlh_from_target=vehicle.target.dcm_target_from_lvlh.T.copy(),
        dcm_inertial_from_chaser=dcm,
        dcm_at_settled=dcm,
        covariance=layout.prior.copy(),
        sample_rad_s=np.full(3, np.nan),
        sample_s=-np.inf,
        bias_known=np.full(6, np.nan),
        command_m_s2=np.zeros(3),
    )
