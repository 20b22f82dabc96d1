"""A filter that does not start on stated attitudes, tried again with their quaternions read another way."""

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.navigation.log import LogFilter, filter_epochs

ROWS_TRIED = 200
READINGS = {
    "scalar first (w, x, y, z)": ([1, 2, 3, 0], [1.0, 1.0, 1.0, 1.0]),
    "the inverse rotation (lvlh_from_cam)": ([0, 1, 2, 3], [-1.0, -1.0, -1.0, 1.0]),
}
"""Name: which column of the log is x, y, z, w, and its sign."""


def reading_that_starts(log_filter: LogFilter, t_s: Vector, spots_m: Stack, quaternion: Matrix) -> str:
    """A sentence on the reading of q_cam_from_lvlh with which the first rows start a filter; empty if none does."""
    if len(quaternion) == 0:
        return ""
    for name, (columns, signs) in READINGS.items():
        other = quaternion[:, columns] * signs
        track = filter_epochs(log_filter.model, t_s, spots_m, q_cam_from_lvlh=other)
        if np.isfinite(track.state).any():
            return f"read as {name} q_cam_from_lvlh does start the filter; x, y, z, w of v_cam = R v_lvlh is expected"
    return ""
