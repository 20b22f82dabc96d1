"""Stated attitudes that do not fit, tried again with their quaternions read another way."""

import math

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.geometry.rotation import dcm_from_quaternion, quaternion_from_dcm
from relnav.navigation.log import LogFilter, filter_epochs

ROWS_TRIED = 200
READINGS = {
    "scalar first (w, x, y, z)": ([1, 2, 3, 0], [1.0, 1.0, 1.0, 1.0]),
    "the inverse rotation (lvlh_from_cam)": ([0, 1, 2, 3], [-1.0, -1.0, -1.0, 1.0]),
}
"""Name: which column of the log is x, y, z, w, and its sign."""


FAR_DEG, NEAR_DEG = 60.0, 20.0
"""From the attitude in which the model sees its target: no flight looks so far away, and most stay as near."""


def reading_that_looks(dcm_chaser_from_lvlh: Matrix, expected: Matrix) -> str:
    """A sentence on the reading of q_chaser_from_lvlh that is near the model's attitude (3, 3); empty if it is near."""
    away = _away_deg(dcm_chaser_from_lvlh, expected)
    quaternion = quaternion_from_dcm(dcm_chaser_from_lvlh)
    for name, (columns, signs) in READINGS.items():
        read = _away_deg(dcm_from_quaternion(quaternion[columns] * signs), expected)
        if away > FAR_DEG and read < NEAR_DEG:
            words = name.replace("cam", "chaser")
            return (
                f"q_chaser_from_lvlh turns {away:.0f} deg away from the attitude in which the model sees the target; "
                f"read as {words} it is {read:.0f} deg: x, y, z, w of v_chaser = R v_lvlh is expected"
            )
    return ""


def _away_deg(one: Matrix, other: Matrix) -> float:
    return math.degrees(math.acos(min(1.0, max(-1.0, 0.5 * (float(np.trace(one @ other.T)) - 1.0)))))


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
