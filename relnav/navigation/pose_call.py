"""One call of the marker filter: what is told of an epoch is taken in, the step made, and what is kept of it written.

All of it is compiled as one function, because a call that validates and reads in Python costs as much as the filter.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.dynamics.error_state import POSE
from relnav.estimation.factored import compose_into
from relnav.navigation.pose_epoch import EPOCH, write_epoch
from relnav.navigation.pose_filter import pose_step
from relnav.navigation.pose_memory import PoseMemory, pose_views
from relnav.navigation.told import are_credible, is_an_attitude

NO_SPOTS, NO_COVARIANCES = np.empty((0, 2)), np.empty((0, 2, 2))
AS_STATED = np.empty((1, 0, 2, 2))
"""Covariances of a log in which no image tells its own: one entry, NO_COVARIANCES, for all epochs."""
REFUSED = -1
"""Instead of what is to be looked for: nothing was done."""
EPOCH_SIZE = EPOCH.itemsize // 8
NOTHING_APART = np.zeros((0, POSE))
"""No room for what is considered: it goes into the factors."""


def new_report(markers: int) -> Vector:
    """Room for what a record says: an `EPOCH`, the covariance (12, 12), and which spots were used, 1 or 0 a marker."""
    return np.zeros(EPOCH_SIZE + POSE * POSE + markers)


class Event(NamedTuple):
    """What happens at one time: the control over the interval that ends there, and what was seen there.

    Attributes
    ----------
    t_s : float
    acceleration_m_s2, delta_v_m_s : (3,)
        `lvlh_ccsds`.
    dcm_chaser_from_lvlh : (3, 3)
    attitude_noise_rad, attitude_sigma_rad : float
        1-sigma of what is new in the chaser's attitude, and of what lasts in its error.
    spots_px : (n, 2), or (0, 2): none
    covariance_px2 : (n, 2, 2), or (0, 2, 2): the camera's noise
    row : bool
        An epoch of the log, not the exposure of a late image.
    """

    t_s: float
    acceleration_m_s2: Vector
    delta_v_m_s: Vector
    dcm_chaser_from_lvlh: Matrix
    attitude_noise_rad: float
    attitude_sigma_rad: float
    spots_px: Matrix = NO_SPOTS
    covariance_px2: Stack = NO_COVARIANCES
    row: bool = True


def views_of_report(report: Vector) -> tuple[Any, Matrix, Vector]:
    """Its epoch, covariance and flags, to be read and written."""
    epoch = report[:EPOCH_SIZE].view(EPOCH)[0]
    return epoch, report[EPOCH_SIZE : EPOCH_SIZE + POSE * POSE].reshape(POSE, POSE), report[EPOCH_SIZE + POSE * POSE :]


@kernel
def _describe(m: PoseMemory, report: Vector, apart: Matrix) -> None:
    """Write what a record says of the last event; apart: NOTHING_APART."""
    write_epoch(m, report[:EPOCH_SIZE].view(EPOCH)[0], apart)
    squares = POSE * POSE
    covariance, accepted = report[EPOCH_SIZE : EPOCH_SIZE + squares], report[EPOCH_SIZE + squares :]
    for i in range(m.accepted.shape[0]):
        accepted[i] = m.accepted[i]
    if m.clock["running"] == 0:
        for k in range(squares):
            covariance[k] = math.nan
        return
    P = m.scratch["noise"]
    compose_into(m.work["ld"], P)  # joined factors: `write_epoch` has left them there
    for i in range(POSE):
        for j in range(POSE):
            covariance[POSE * i + j] = P[i, j]


@entry
def describe_pose(block: Vector, report: Vector, apart: Matrix) -> None:
    """Write what a record says of a filter's last event into `new_report`; apart: NOTHING_APART."""
    _describe(pose_views(block), report, apart)


@entry
def navigate_pose(
    block: Vector,
    t: float,
    acceleration: Vector,
    delta_v: Vector,
    chaser: Matrix,
    attitude_noise: float,
    attitude_sigma: float,
    spots: Matrix,
    covariances: Stack,
    report: Vector,
    apart: Matrix,
) -> int:
    """Take an event in, the arguments after block being its own: what is to be looked for afterwards (`pose_step`).

    What a record says is written as `describe_pose` does. REFUSED, and nothing is done, for a time, a control or an
    attitude that cannot be; shapes are those of an `Event`.
    """
    if not (math.isfinite(t) and are_credible(acceleration) and are_credible(delta_v) and is_an_attitude(chaser)):
        return REFUSED
    m = pose_views(block)
    push, impulse = m.motion["acceleration"], m.motion["delta_v"]
    for j in range(3):
        push[j], impulse[j] = acceleration[j], delta_v[j]
    m.camera["attitude_noise"], m.lasting["attitude"] = attitude_noise, attitude_sigma
    wants = pose_step(block, t, chaser, spots, covariances)
    _describe(m, report, apart)
    return int(wants)
