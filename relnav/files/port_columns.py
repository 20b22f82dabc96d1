"""Port from port as columns to look at, under one name for tracks of markers and of vehicles."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.arrays import Vector
from relnav.files.approach_view import PORT_COVARIANCE, STATE_COVARIANCE

QUATERNION = tuple(f"q_target_from_chaser_{axis}" for axis in "xyzw")
_OF_VEHICLES = {
    **{f"{axis}_m": f"port_{axis}_m" for axis in "xyz"},
    **{f"v{axis}_m_s": f"port_v{axis}_m_s" for axis in "xyz"},
    **{f"turn_{axis}_deg": f"port_turn_{axis}_deg" for axis in "xyz"},
    **{f"rate_{axis}_deg_s": f"port_rate_{axis}_deg_s" for axis in "xyz"},
}
_KINDS = ("", "sigma_", "protection_")
RENAMED = {f"{kind}{old}": f"{kind}{new}" for old, new in _OF_VEHICLES.items() for kind in _KINDS}
RENAMED |= dict(zip(STATE_COVARIANCE, PORT_COVARIANCE, strict=True))
"""Columns of a vehicle's track, all of which are port from port, as a marker track calls them."""


class PortColumns:
    """Columns of the port's attitude and rate of consecutive parts of one track."""

    def __init__(self) -> None:
        """Begin before the first epoch."""
        self._aligned: Rotation | None = None

    def of(self, columns: Mapping[str, Any]) -> dict[str, Vector]:
        """`port_turn_...` (rotation vector, target axes) and `port_rate_...` of a track that has an attitude.

        The turn is told from the attitude with parallel axes that is nearest the first: docked, ports face each other,
        and a vehicle file may call any axis the one out of the port.
        """
        if QUATERNION[0] not in columns:
            return {}
        quaternion = np.stack([np.asarray(columns[name], dtype=np.float64) for name in QUATERNION], axis=1)
        known = np.isfinite(quaternion).all(axis=1) & (np.abs(quaternion).sum(axis=1) > 0.5)
        turn = np.full((len(quaternion), 3), np.nan)
        if known.any():
            attitude = Rotation.from_quat(quaternion[known])
            if self._aligned is None:
                parallel = Rotation.create_group("O")
                self._aligned = parallel[int((attitude[0] * parallel.inv()).magnitude().argmin())]
            turn[known] = np.degrees((attitude * self._aligned.inv()).as_rotvec())
        out = {f"port_turn_{axis}_deg": turn[:, k] for k, axis in enumerate("xyz")}
        rates = {f"port_rate_{axis}_deg_s": f"relative_rate_{axis}_deg_s" for axis in "xyz"}
        return out | {name: np.asarray(columns[given]) for name, given in rates.items() if given in columns}
