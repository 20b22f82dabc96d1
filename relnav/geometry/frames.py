"""The two orbital frames of relative motion, by axis equations, and the way between them.

`lvlh_ccsds`: origin target's centre of mass, x = V-bar (completes the set, along velocity), y = H-bar = -h,
z = R-bar, to nadir. `rsw` (= RTN = RIC = Hill): x radial out, y along-track, z = +h. Hence
x_l = y_rsw, y_l = -z_rsw, z_l = -x_rsw. Velocities are as seen in the rotating frame. There is no bare `lvlh` here:
Orekit and JEOD mean opposite frames by that name.
"""

import numpy as np

from relnav.arrays import Matrix, Vector

DCM_LVLH_CCSDS_FROM_RSW: Matrix = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
"""v_lvlh_ccsds = dcm @ v_rsw."""
DCM_LVLH_CCSDS_FROM_RSW.setflags(write=False)


def _turn(state: Vector, dcm: Matrix) -> Vector:
    state = np.asarray(state, dtype=np.float64)
    if state.shape[-1:] != (6,):
        raise ValueError(f"a relative state has 6 components in its last axis (m, m/s); got shape {state.shape}")
    return np.concatenate([state[..., :3] @ dcm.T, state[..., 3:] @ dcm.T], axis=-1)


def lvlh_ccsds_from_rsw(state: Vector) -> Vector:
    """Turn relative states (..., 6) (m, m/s) from `rsw` into `lvlh_ccsds` axes."""
    return _turn(state, DCM_LVLH_CCSDS_FROM_RSW)


def rsw_from_lvlh_ccsds(state: Vector) -> Vector:
    """Turn relative states (..., 6) (m, m/s) from `lvlh_ccsds` into `rsw` axes."""
    return _turn(state, DCM_LVLH_CCSDS_FROM_RSW.T)


def relative_state_rsw(target_r: Vector, target_v: Vector, chaser_r: Vector, chaser_v: Vector) -> Vector:
    """Relative state of the chaser in the target's `rsw` frame from two inertial states, exact.

    Parameters
    ----------
    target_r, target_v, chaser_r, chaser_v : (3,)
        Inertial positions and velocities, any one length unit and that unit per second.

    Returns
    -------
    (6,) position and velocity seen in the rotating frame, in the same units.

    Notes
    -----
    The frame turns at omega = h / r^2 about z (h = |r x v|), so rho' = C (dv - omega x dr).
    """
    r, v = np.asarray(target_r, dtype=np.float64), np.asarray(target_v, dtype=np.float64)
    momentum = np.cross(r, v)
    x_axis = r / np.linalg.norm(r)
    z_axis = momentum / np.linalg.norm(momentum)
    dcm_rsw_from_inertial = np.array([x_axis, np.cross(z_axis, x_axis), z_axis])
    omega = momentum / np.dot(r, r)
    dr, dv = np.asarray(chaser_r) - r, np.asarray(chaser_v) - v
    return np.concatenate([dcm_rsw_from_inertial @ dr, dcm_rsw_from_inertial @ (dv - np.cross(omega, dr))])
