"""A log of beacons whose images arrived some time after their exposure."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Stack, Vector, one_piece
from relnav.estimation.factored import factorize
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.mission import Model
from relnav.navigation.docking_view import LOWER
from relnav.navigation.log import LogFilter, filter_epochs
from relnav.navigation.record import Solution
from relnav.navigation.relative_position import Navigator
from relnav.navigation.status import STARTED
from relnav.sensors.measurement import TOO_LATE


def filter_late_images(
    model: Model,
    t_s: Vector,
    spots_m: Stack,
    image_t_s: Vector,
    *,
    acceleration_m_s2: Matrix | None = None,
    delta_v_m_s: Matrix | None = None,
    q_cam_from_lvlh: Matrix | None = None,
    method: str = "fix",
    spot_sigma_m: Stack | None = None,
    projection: str | None = None,
    smooth: bool = False,
) -> Solution:
    """Filter a log as it was lived: an entry says what was known at its time, of the images that had come by then.

    Smoothed, every state rests on all images, each where it was exposed; status, NIS and alarms stay those of the way
    forward.

    Parameters
    ----------
    model : Model
        From `relnav.load_model`, with a `longest_delay_s`; an image that is later is not used.
    t_s : (n,)
        Strictly increasing times of the rows.
    spots_m : (n, beacons, 2)
        The image that arrived with each.
    image_t_s : (n,)
        Middle of its exposure, s, at t_s or before.
    acceleration_m_s2, delta_v_m_s, q_cam_from_lvlh, method, spot_sigma_m, projection, smooth
        As for `filter_epochs`; attitude and noise are of the exposure.

    Raises
    ------
    ValueError
        As `filter_epochs` and `Navigator.step`.
    """
    t, exposed = one_piece("t_s", t_s), one_piece("image_t_s", image_t_s)
    if exposed.shape != t.shape:
        raise ValueError(f"image_t_s has shape {t.shape}, one time a row; got {exposed.shape}")
    navigator = Navigator(model, method, projection=projection)
    log = LogFilter(model, method, projection=projection)
    epochs = log.room(len(t), smooth=False)

    def row(values: Any, k: int) -> Any:
        return None if values is None else values[k]

    for k in range(len(t)):
        q = row(q_cam_from_lvlh, k)
        record = navigator.step(
            float(t[k]),
            spots_m[k],
            image_t_s=float(exposed[k]),
            acceleration_m_s2=row(acceleration_m_s2, k),
            delta_v_m_s=row(delta_v_m_s, k),
            dcm_cam_from_lvlh=None if q is None else dcm_from_quaternion(q),
            spot_sigma_m=row(spot_sigma_m, k),
        )
        epochs.codes[k] = record.dof, record.status, record.measurement_status, record.alarm
        epochs.nis[k], epochs.innovation[k], epochs.state[k] = record.nis, record.innovation, record.state
        epochs.factor[k] = factorize(record.covariance)[LOWER] if record.has_state else math.nan
    quaternion = np.empty((0, 4)) if q_cam_from_lvlh is None else one_piece("q_cam_from_lvlh", q_cam_from_lvlh)
    starts = int(np.count_nonzero(epochs.codes[:, 1] == STARTED))
    solution = replace(log.solution(t, quaternion, epochs, smoothed=smooth), restarts=max(0, starts - 1))
    if smooth:
        used = epochs.codes[:, 2] != TOO_LATE
        arrays = {"spots_m": spots_m, "acceleration_m_s2": acceleration_m_s2, "delta_v_m_s": delta_v_m_s}
        arrays |= {"q_cam_from_lvlh": q_cam_from_lvlh, "spot_sigma_m": spot_sigma_m}
        given = {name: one_piece(name, value) for name, value in arrays.items() if value is not None}
        times, ordered = _in_order(t, exposed, used, given)
        track = filter_epochs(model, times, **ordered, method=method, projection=projection, smooth=True)
        rows = np.searchsorted(times, t)
        solution.state[:], solution.factor[:] = track.state[rows], track.factor[rows]
    return solution


def _in_order(t: Vector, exposed: Vector, used: Vector, given: dict[str, Any]) -> tuple[Vector, dict[str, Any]]:
    """Times of rows and exposures in order, and what `filter_epochs` is given at each.

    An acceleration is held over its row's whole interval, an impulse acts at the row, attitude and noise are those of
    the exposure.
    """
    times = np.union1d(t, exposed[used])
    held = np.minimum(np.searchsorted(t, times), len(t) - 1)  # the row in whose interval each time lies
    rows, images = np.searchsorted(times, t), np.searchsorted(times, exposed[used])
    out: dict[str, Any] = {}
    for name, values in given.items():
        if name == "acceleration_m_s2":
            out[name] = values[held]
        elif name == "delta_v_m_s":
            out[name] = np.zeros((len(times), 3))
            out[name][rows] = values
        elif name == "q_cam_from_lvlh":
            out[name] = values[held]
            out[name][images] = values[used]
        else:
            out[name] = np.full((len(times), *values.shape[1:]), np.nan)
            out[name][images] = values[used]
    return times, out
