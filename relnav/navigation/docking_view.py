"""The state as the docking sensor describes it: range, azimuth, elevation, with the covariance J P J^T."""

import numpy as np

from relnav.arrays import Matrix, Stack, Vector


def docking_view(
    state: Matrix, covariance: Stack, dcm_dock_from_lvlh: Matrix, port_m: Vector, lever_lvlh_m: Vector
) -> tuple[Matrix, Stack]:
    """Range m, azimuth rad, elevation rad of the camera in the docking frame (seed 000 eq. (13)), and covariance.

    Parameters
    ----------
    state : (n, 6)
        Relative states, `lvlh_ccsds`.
    covariance : (n, 6, 6)
        Their covariances.
    dcm_dock_from_lvlh : (3, 3)
        Orientation of the docking frame.
    port_m : (3,)
        O from the target's centre of mass, `lvlh_ccsds`.
    lever_lvlh_m : (3,) or (n, 3)
        Camera from the chaser's centre of mass, `lvlh_ccsds`.

    Returns
    -------
    (n, 3) values and (n, 3, 3) covariances; NaN at the poles x = y = 0.
    """
    p = (state[:, :3] + lever_lvlh_m - port_m) @ dcm_dock_from_lvlh.T
    x, y, z = p[:, 0], p[:, 1], p[:, 2]
    h = np.hypot(x, y)
    r = np.hypot(h, z)
    with np.errstate(divide="ignore", invalid="ignore"):
        rae = np.stack([r, np.arctan2(y, x), np.arctan2(-z, h)], axis=-1)
        zero = np.zeros_like(x)
        jacobian = np.stack(
            [
                np.stack([x / r, y / r, z / r], axis=-1),
                np.stack([-y / h**2, x / h**2, zero], axis=-1),
                np.stack([x * z / (h * r**2), y * z / (h * r**2), -h / r**2], axis=-1),
            ],
            axis=-2,
        )
    j = jacobian @ dcm_dock_from_lvlh
    return rae, j @ covariance[:, :3, :3] @ np.swapaxes(j, -1, -2)
