"""A chaser that swings sideways and turns about one place, in closed form: truth for what depends on speed and rate."""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.mission import Model


@dataclass(frozen=True)
class Swing:
    """Truth at given times.

    Attributes
    ----------
    truth : (n, 6)
        Relative states, `lvlh_ccsds`.
    acceleration_m_s2 : (n, 3)
        Commanded; held over the interval that ends at the row it gives this motion to (interval)^2 / 24.
    dcm_cam_from_lvlh : (n, 3, 3)
        Camera attitude.
    """

    truth: Matrix
    acceleration_m_s2: Matrix
    dcm_cam_from_lvlh: Stack


def swing(
    model: Model,
    t_s: Vector,
    range_m: float,
    speed_m_s: float = 0.0,
    turn_rate_rad_s: float = 0.0,
    period_s: float = 10.0,
) -> Swing:
    """Swing along y of the docking frame with a peak speed, and turn about the camera's y axis with a peak rate.

    The chaser's centre of mass swings, about a place `range_m` out on the docking axis.
    """
    w, n = 2.0 * math.pi / period_s, model.orbit.mean_motion_rad_s
    axis_x, axis_y = model.dcm_dock_from_lvlh[0], model.dcm_dock_from_lvlh[1]

    def motion(t: Vector) -> tuple[Matrix, Matrix, Matrix]:
        side = -speed_m_s / w * np.cos(w * t)[:, None] * axis_y
        place = model.port_position_m + range_m * axis_x
        return place + side, speed_m_s * np.sin(w * t)[:, None] * axis_y, -(w**2) * side

    x, v, _ = motion(t_s)
    middle = t_s - 0.5 * np.diff(t_s, prepend=t_s[0])
    xm, vm, am = motion(middle)
    natural = np.stack([2.0 * n * vm[:, 2], -(n**2) * xm[:, 1], 3.0 * n**2 * xm[:, 2] - 2.0 * n * vm[:, 0]], axis=1)
    angle = turn_rate_rad_s / w * np.sin(w * t_s)
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    pan = np.stack([c, zero, s, zero, one, zero, -s, zero, c], axis=-1).reshape(-1, 3, 3)
    return Swing(np.concatenate([x, v], axis=1), am - natural, pan @ model.dcm_cam_from_lvlh)
