"""Stated attitudes that do not fit, tried again with their quaternions read another way."""

import math

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.geometry.linear_algebra import lengths
from relnav.geometry.rotation import dcm_from_quaternion, quaternion_from_dcm
from relnav.navigation.log import LogFilter, filter_epochs

ROWS_TRIED = 200
READINGS = {
    "scalar first (w, x, y, z)": ([1, 2, 3, 0], [1.0, 1.0, 1.0, 1.0]),
    "the inverse rotation (lvlh_from_cam)": ([0, 1, 2, 3], [-1.0, -1.0, -1.0, 1.0]),
}
"""Name: which column of the log is x, y, z, w, and its sign."""


STEPS = 5
"""Times that an attitude stays and then turns, among the rows tried, before that is said."""
LEAST_STEP = 0.1
"""Of the angle that a spot's noise is: what an attitude turns by at once, and nobody sees."""

FAR_DEG, NEAR_DEG = 60.0, 20.0
"""From the attitude in which the model sees its target: no flight looks so far away, and most stay as near."""


def reading_that_looks(
    dcm_a_from_b: Matrix,
    expected: Matrix,
    name: str = "q_chaser_from_lvlh",
    frames: tuple[str, str] = ("chaser", "lvlh"),
    expects: str = "the attitude in which the model sees the target",
    far_deg: float = FAR_DEG,
) -> str:
    """A sentence on the reading of a quaternion that is near the expected attitude (3, 3); empty if it is near.

    name, frames, expects: what the quaternion is called, a and b, and what the expected attitude is; far_deg: from when
    on it does not fit.
    """
    away = away_deg(dcm_a_from_b, expected)
    quaternion = quaternion_from_dcm(dcm_a_from_b)
    for reading, (columns, signs) in READINGS.items():
        read = away_deg(dcm_from_quaternion(quaternion[columns] * signs), expected)
        if away > far_deg and read < NEAR_DEG:
            a, b = frames
            words = reading.replace("cam", a).replace("lvlh", b)
            return (
                f"{name} turns {away:.0f} deg away from {expects}; "
                f"read as {words} it is {read:.0f} deg: x, y, z, w of v_{a} = R v_{b} is expected"
            )
    return ""


def away_deg(one: Matrix, other: Matrix) -> float:
    """By what angle two attitudes (3, 3) of one thing differ."""
    return math.degrees(math.acos(min(1.0, max(-1.0, 0.5 * (float(np.trace(one @ other.T)) - 1.0)))))


def stepped(angles_rad: Vector, noise_rad: float, spot_rad: float) -> tuple[str, ...]:
    """A note on attitudes that were stated more seldom than images were taken, each repeated until the next one came.

    angles_rad (n - 1,): by how much the attitude turns from row to row, exactly 0 where it is the same; noise_rad: what
    the model takes it to be off at every image; spot_rad: angle of one spot's noise.
    """
    turns = angles_rad[:ROWS_TRIED]
    steps = turns[turns > 0.0]
    if len(steps) < STEPS or 2 * len(steps) > len(turns):
        return ()
    size = float(np.sqrt(np.mean(steps**2)))
    off = size / math.sqrt(3.0)  # from 0 to a whole step, evenly
    if off < max(noise_rad, LEAST_STEP * spot_rad):
        return ()
    return (
        f"the attitude stays for {len(turns) / len(steps):.2g} rows and then turns by {math.degrees(size):.2g} deg: it "
        "was stated more seldom than the images; interpolate it, or state the error that this is in every image, "
        f"{math.degrees(off):.2g} deg, as the model's noise of the attitude",
    )


def turns_of(quaternion: Matrix) -> Vector:
    """Angles (n - 1,) rad from row to row of small turns between unit quaternions (n, 4), either sign."""
    one, next_one = quaternion[:-1], quaternion[1:]
    return 2.0 * np.minimum(lengths(next_one - one), lengths(next_one + one))


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
