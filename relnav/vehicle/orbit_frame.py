"""The stated orbit as a frame: `lvlh_ccsds` in inertial axes at any time."""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import entry
from relnav.dynamics.relative_motion import frame_rate, orbit_vector, true_anomaly_at
from relnav.dynamics.rigid_body import lvlh_rate
from relnav.spacecraft import InertialOrbit


@entry
def lvlh_from_inertial_into(orbit: Vector, axes: Matrix, t: float, out: Matrix) -> None:
    """Write the dcm of v_lvlh = dcm @ v_inertial at t s on the log's clock into out (3, 3).

    orbit (4,): `relative_motion`; columns of axes (3, 3): toward perigee, a quarter turn on, and the orbit's normal.
    """
    sine, cosine = true_anomaly_at(orbit, t)
    for c in range(3):
        out[0, c] = axes[c, 1] * cosine - axes[c, 0] * sine
        out[1, c] = -axes[c, 2]
        out[2, c] = -(axes[c, 0] * cosine + axes[c, 1] * sine)


class OrbitFrame:
    """The stated orbit of a vehicle.

    Attributes
    ----------
    vector : (4,)
        As `relative_motion.orbit_vector`.
    axes : (3, 3)
        Inertial, in columns: toward perigee, a quarter turn on, normal.
    """

    def __init__(self, orbit: InertialOrbit) -> None:
        self.vector = orbit_vector(orbit.mean_motion_rad_s, orbit.eccentricity, orbit.true_anomaly_rad)
        ci, si = np.cos(orbit.inclination_rad), np.sin(orbit.inclination_rad)
        cn, sn = np.cos(orbit.ascending_node_rad), np.sin(orbit.ascending_node_rad)
        cp, sp = np.cos(orbit.perigee_argument_rad), np.sin(orbit.perigee_argument_rad)
        node = np.array([[cn, -sn * ci], [sn, cn * ci], [0.0, si]])
        plane = node @ np.array([[cp, -sp], [sp, cp]])
        self.axes = np.column_stack([plane, np.cross(plane[:, 0], plane[:, 1])])

    def dcm_lvlh_from_inertial(self, t_s: float) -> Matrix:
        """v_lvlh = dcm @ v_inertial, (3, 3)."""
        out = np.empty((3, 3))
        lvlh_from_inertial_into(self.vector, self.axes, t_s, out)
        return out

    def held_rate(self, dcm_lvlh_from_body: Matrix, t_s: float) -> Vector:
        """Inertial rate of a body that is held in `lvlh_ccsds`, as that turns at t_s, body axes, (3,) rad/s."""
        return lvlh_rate(dcm_lvlh_from_body, frame_rate(self.vector, t_s))
