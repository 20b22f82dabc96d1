"""One call of the filter: what a caller tells of an epoch is taken in, the step made, and what readers ask written out.

All of it is compiled as one function (`navigate`), because a call that validates and reads in Python costs ten times
the filter. Who tells nothing hands over empty arrays, and `told` says what is told.
"""

import math

import numpy as np

from relnav.arrays import LARGEST, Matrix, Record, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.dynamics.error_state import MOTION, factor_size
from relnav.estimation.considered import join_considered
from relnav.estimation.rows import copy_track
from relnav.navigation.docking_view import VIEW_ROWS, view_epoch
from relnav.navigation.memory import Memory, views
from relnav.navigation.observation.beacon_geometry import attitude_changed
from relnav.navigation.packed_factors import pack_factors
from relnav.navigation.step import step, wrong_use
from relnav.navigation.told import are_credible, is_an_attitude

ACCELERATION, DELTA_V, ATTITUDE, SPOT_SIGMA, ATTITUDE_NOISE, ATTITUDE_SIGMA = 1, 2, 4, 8, 16, 32
"""Bits of `told`."""

_F, _I = np.float64, np.int64
REPORT = np.dtype(
    [
        ("t", _F),
        ("nis", _F),
        ("dof", _I),
        ("status", _I),
        ("reason", _I),
        ("rejected", _I),
        ("has_state", _I),
        ("alarm", _I),
        ("docking", _F, 3),  # range, azimuth, elevation
        ("docking_sigma", _F, 3),
        ("docking_covariance", _F, (3, 3)),
        ("state", _F, MOTION),
        ("covariance", _F, (MOTION, MOTION)),
    ]
)
"""What a record says; behind it stand the innovations, two numbers a beacon."""
REPORT_SIZE = REPORT.itemsize // 8
_LOWER_SIZE = factor_size(MOTION)
_SCRATCH = VIEW_ROWS + _LOWER_SIZE + MOTION


def new_report(beacons: int) -> tuple[Vector, Vector]:
    """Room for what `navigate` writes, and the part of it that a record keeps."""
    report = np.zeros(REPORT_SIZE + 2 * beacons + _SCRATCH)
    return report, report[: REPORT_SIZE + 2 * beacons]


@kernel
def _can_be_taken(
    m: Memory,
    told: int,
    acceleration: Vector,
    delta_v: Vector,
    dcm: Matrix,
    spot_sigma: Matrix,
    attitude_noise: float,
    attitude_sigma: float,
) -> bool:
    """Whether what is told has the shapes and values that `Navigator.step` asks for."""
    if told & ACCELERATION and not are_credible(acceleration):
        return False
    if told & DELTA_V and not are_credible(delta_v):
        return False
    if told & ATTITUDE_NOISE and not 0.0 <= attitude_noise <= LARGEST:
        return False
    if told & ATTITUDE_SIGMA and not 0.0 <= attitude_sigma <= LARGEST:
        return False
    if told & ATTITUDE and not is_an_attitude(dcm):
        return False
    if told & SPOT_SIGMA:
        if spot_sigma.shape[0] != m.beacons.shape[0] or spot_sigma.shape[1] != 2:
            return False
        for i in range(spot_sigma.shape[0]):
            for k in range(2):
                if spot_sigma[i, k] <= 0.0 or spot_sigma[i, k] > LARGEST:
                    return False
    return True


@entry
def take_inputs(
    block: Vector,
    told: int,
    acceleration: Vector,
    delta_v: Vector,
    dcm: Matrix,
    spot_sigma: Matrix,
    attitude_noise: float,
    attitude_sigma: float,
) -> bool:
    """Write this step's control, attitude and noise; what is not told is zero, the model's, or the last one.

    False, and nothing is written, if something that is told cannot be taken.
    """
    m = views(block)
    if not _can_be_taken(m, told, acceleration, delta_v, dcm, spot_sigma, attitude_noise, attitude_sigma):
        return False
    push, impulse, mount, held = m.motion["acceleration"], m.motion["delta_v"], m.kept["mount"], m.sensor["held"]
    for j in range(3):
        push[j] = acceleration[j] if told & ACCELERATION else 0.0
        impulse[j] = delta_v[j] if told & DELTA_V else 0.0
    if told & ATTITUDE or m.sensor["turned"] > 0:
        for i in range(3):
            for j in range(3):
                mount[i, j] = dcm[i, j] if told & ATTITUDE else held[i, j]
        m.sensor["turned"] = 1 if told & ATTITUDE else 0
        m.sensor["attitude_known"] = 1 if told & ATTITUDE else m.sensor["held_known"]
        attitude_changed(m.kept, m.sensor)
    if told & ATTITUDE_NOISE:
        m.sensor["attitude_noise"] = attitude_noise
    if told & ATTITUDE_SIGMA:
        m.sensor["attitude_sigma"] = attitude_sigma
    if told & SPOT_SIGMA:
        for i in range(spot_sigma.shape[0]):
            own = m.beacons[i]["spot_sigma"]
            for k in range(2):
                if spot_sigma[i, k] > 0.0:
                    own[k] = spot_sigma[i, k]
    return True


@kernel
def _view(m: Memory, scratch: Vector, view: Vector) -> None:
    """Write the state, with what is considered, as the docking sensor sees it (`docking_view`)."""
    track, mount, dock = m.track, m.kept["mount"], m.kept["dock"]
    ld = track["ld"]
    if m.sensitivities.shape[0] > 0:
        copy_track(track, m.work)
        ld = m.work["ld"]
        join_considered(ld, m.sensitivities)
    packed, lever, port = scratch[:_LOWER_SIZE], scratch[_LOWER_SIZE : _LOWER_SIZE + 3], scratch[_LOWER_SIZE + 3 :]
    for i in range(3):
        lever[i] = mount[0, i] * mount[0, 3] + mount[1, i] * mount[1, 3] + mount[2, i] * mount[2, 3]
        port[i] = dock[i, 3]
    pack_factors(ld, packed)
    view_epoch(track["state"], packed, dock[:, :3], port, lever, view)


@kernel
def _describe(view: Vector, out: Record) -> None:
    """Write range, azimuth, elevation and both covariances of a view."""
    docking, sigma, joint = out["docking"], out["docking_sigma"], out["docking_covariance"]
    covariance, at = out["covariance"], 3
    for i in range(3):
        docking[i] = view[i]
        sigma[i] = math.sqrt(view[at])
        for k in range(i, 3):
            joint[i, k], joint[k, i] = view[at], view[at]
            at += 1
    for i in range(MOTION):
        for k in range(i, MOTION):
            covariance[i, k], covariance[k, i] = view[at], view[at]
            at += 1


@entry
def write_report(block: Vector, report: Vector) -> None:
    """Write what readers may ask of the last epoch (`new_report`)."""
    m = views(block)
    out = report[:REPORT_SIZE].view(REPORT)[0]
    clock, result = m.clock, m.result
    out["t"], out["nis"], out["dof"] = clock["t"], result["nis"], result["dof"]
    out["status"], out["reason"], out["rejected"] = result["status"], result["reason"], clock["rejected"]
    out["has_state"] = clock["running"]
    out["alarm"] = m.watch["alarm"] if clock["running"] > 0 else 0
    numbers, state = m.innovations.shape[0], out["state"]
    for k in range(numbers):
        report[REPORT_SIZE + k] = m.innovations[k]
    scratch = report[REPORT_SIZE + numbers :]
    view = scratch[:VIEW_ROWS]
    if clock["running"] > 0:
        _view(m, scratch[VIEW_ROWS:], view)
    else:
        for k in range(VIEW_ROWS):
            view[k] = math.nan
    _describe(view, out)
    for i in range(MOTION):
        state[i] = m.track["state"][i] if clock["running"] > 0 else math.nan


@entry
def navigate(
    block: Vector,
    t: float,
    spots: Matrix,
    told: int,
    acceleration: Vector,
    delta_v: Vector,
    dcm: Matrix,
    spot_sigma: Matrix,
    attitude_noise: float,
    attitude_sigma: float,
    report: Vector,
) -> bool:
    """`take_inputs`, `step` and `write_report`; False, and nothing is done, for wrong use."""
    if wrong_use(views(block), t, spots) != 0:
        return False
    if not take_inputs(block, told, acceleration, delta_v, dcm, spot_sigma, attitude_noise, attitude_sigma):
        return False
    step(block, t, spots)
    write_report(block, report)
    return True
