"""A polarised beacon on the target, seen through the birefringent sensor: the roll about the line of sight, one row.

The light of a beacon behind a polariser is split by its polarisation
(`relnav.sensors.birefringent_sun.polarised`). With the beacon at p and the polarisation along a, both in sensor axes,
and e1, e2 the fields across s = p / |p| (`polarisation_basis`), its angle is psi = atan2(a e2, a e1). Off by small
errors (theta of the target, alpha of the chaser, e of the mounting, drho of the motion), with r and a_T the beacon's
place and the polarisation in the target, b = C_BT a_T, and q from the chaser's centre of mass to the beacon:

    dp = C_SB (-C_BL drho - C_BT [r x] theta + [q x] alpha) + [p x] e
    da = C_SB (-C_BT [a_T x] theta + [b x] alpha) + [a x] e
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, numbers
from relnav.estimation.gating import gate_limits
from relnav.estimation.state_layout import Role, StateLayout
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.geometry.rotation_vector import turned
from relnav.sensors.birefringent_sun.crystal import polarisation_basis
from relnav.sensors.birefringent_sun.polarised import PolarisedRoll
from relnav.spacecraft import Vehicle
from relnav.vehicle.layout import CHASER_ATTITUDE, POSITION, TARGET_ATTITUDE, LastingError
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.rows import Rows
from relnav.vehicle.state import VehicleState


class PolarisedBeacon:
    """A flying sensor for `VehicleNavigator(vehicle, sensors={name: PolarisedBeacon(...)})`.

    `observe(name, t_s, roll)` takes what `relnav.birefringent_sun.polarised_roll` returns; of its two candidates the
    one nearer to the estimate is believed, and refused by the gate if it is not credible. An image of which both are
    credible tells nothing: the wrong one would be believed at every image from then on. Candidates are mirrored about
    the crystal's axes: mount a polariser such that it is seen some 45 deg from them.
    """

    most_rows = 1

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        q_sensor_from_chaser: ArrayLike,
        position_m: ArrayLike,
        beacon_m: ArrayLike,
        polarisation: ArrayLike,
        mount_sigma_rad: float = 1e-4,
        mount_role: Role = "considered",
    ) -> None:
        """Say where everything is.

        Parameters
        ----------
        vehicle : Vehicle
        q_sensor_from_chaser : (4,)
            Scalar last.
        position_m : (3,)
            The sensor in the chaser, from its centre of mass, chaser axes.
        beacon_m, polarisation : (3,)
            The beacon in the target, from its centre of mass, and the direction of its field, target axes.
        mount_sigma_rad, mount_role
            1-sigma of the sensor's alignment about each axis, and whether the filter estimates it.

        Raises
        ------
        ValueError
            For another shape, or a polarisation of no length.
        """
        self.lasting = (LastingError("mount", 3, mount_sigma_rad, mount_role),)
        self._frame = OrbitFrame(vehicle.orbit)
        self._limit = float(gate_limits(vehicle.filter.gate_probability, 1)[0])
        places = {"position_m": position_m, "beacon_m": beacon_m, "polarisation": polarisation}
        taken = {key: numbers(key, value) for key, value in places.items()}
        for key, value in taken.items():
            if value.shape != (3,) or not np.isfinite(value).all():
                raise ValueError(f"{key}: three finite numbers are expected; got {value.tolist()}")
        length = float(np.linalg.norm(taken["polarisation"]))
        if not length > 0.0:
            raise ValueError("polarisation: the direction of a field is expected; got no length")
        self._lens, self._beacon, self._field = taken["position_m"], taken["beacon_m"], taken["polarisation"] / length
        self._mounted = dcm_from_quaternion(numbers("q_sensor_from_chaser", q_sensor_from_chaser))

    def placed(self, name: str, layout: StateLayout) -> None:
        """As of `FlyingSensor`."""
        self._mount, self._size = layout.by_name[f"{name}.mount"], layout.size

    def taken(self, value: Any, covariance: ArrayLike | None) -> tuple[Vector, Matrix]:
        """Both candidates, rad, and their variances; a covariance (2, 2) of theirs replaces that of counting.

        Raises
        ------
        ValueError
            For what is no `PolarisedRoll`.
        """
        if not isinstance(value, PolarisedRoll):
            raise ValueError(
                "what relnav.birefringent_sun.polarised_roll returns, a PolarisedRoll, is expected; "
                f"got a {type(value).__name__}"
            )
        own = np.diag(np.square(value.sigma_rad)) if covariance is None else numbers("covariance", covariance)
        if own.shape != (2, 2) or not (np.diagonal(own) > 0.0).all():
            raise ValueError(f"covariance: (2, 2) rad^2 with variances above zero is expected; got {own.tolist()}")
        return value.psi_rad, own

    def rows(self, state: VehicleState, value: Vector, noise: Matrix) -> Rows:
        """As of `FlyingSensor`.

        Nothing where the field points along the line of sight, which has no angle then, or where both candidates are
        credible.
        """
        C_LT, C_BI = state.dcm_lvlh_from_target, state.dcm_inertial_from_chaser.T
        C_BL = C_BI @ self._frame.dcm_lvlh_from_inertial(state.t_s).T
        C_SB = turned(np.eye(3), -state.values[self._mount]) @ self._mounted
        q = C_BL @ (C_LT @ self._beacon - state.values[POSITION])
        b = C_BL @ C_LT @ self._field
        p, a = C_SB @ (q - self._lens), C_SB @ b
        psi, by_p, by_a = angle_of(p, a)
        H, none = np.zeros((1, self._size)), np.array([math.nan])
        if not math.isfinite(psi):
            return Rows(none, H, noise[:1, :1], 1)
        C_BT = C_BL @ C_LT
        H[0, POSITION] = -by_p @ C_SB @ C_BL
        H[0, TARGET_ATTITUDE] = -(by_p @ C_SB @ C_BT @ cross_matrix(self._beacon))
        H[0, TARGET_ATTITUDE] -= by_a @ C_SB @ C_BT @ cross_matrix(self._field)
        H[0, CHASER_ATTITUDE] = by_p @ C_SB @ cross_matrix(q) + by_a @ C_SB @ cross_matrix(b)
        H[0, self._mount] = by_p @ cross_matrix(p) + by_a @ cross_matrix(a)
        off = np.remainder(value - psi + 0.5 * np.pi, np.pi) - 0.5 * np.pi
        best = int(np.argmin(np.abs(off)))
        variance = float((H @ state.covariance @ H.T)[0, 0]) + np.diagonal(noise)
        if (off * off < self._limit * variance).all():
            return Rows(none, H, noise[:1, :1], 1)
        return Rows(off[best : best + 1], H, noise[best : best + 1, best : best + 1], 1)


def angle_of(p: Vector, a: Vector) -> tuple[float, Vector, Vector]:
    """Angle of a field along a (3,) from a beacon at p (3,), rad, and its derivatives by both; NaN if there is none."""
    distance = float(np.linalg.norm(p))
    s = p / distance
    e1, e2 = polarisation_basis(s).T
    u, v = float(a @ e1), float(a @ e2)
    length = u * u + v * v
    if not (length > 1e-6 and s[2] > 0.0):
        return math.nan, np.zeros(3), np.zeros(3)
    by_s = np.empty(3)
    width = math.sqrt(1.0 - s[0] * s[0])
    for k, ds in enumerate(np.eye(3) - np.outer(s, s)):
        off = -ds[0] * s - s[0] * ds
        de1 = (off - (e1 @ off) * e1) / width
        de2 = np.cross(ds, e1) + np.cross(s, de1)
        by_s[k] = (u * float(a @ de2) - v * float(a @ de1)) / length
    return math.atan2(v, u), by_s / distance, (u * e2 - v * e1) / length
