"""From a log file to a solution: the offline use of the filter."""

import os
from collections.abc import Callable
from pathlib import Path

from relnav.files.filter_file import log_metadata
from relnav.files.logs import check_beacons, read_log
from relnav.files.models import load_mission
from relnav.files.raw_filter import filter_raw_log
from relnav.files.raw_logs import is_raw_log
from relnav.mission import Model
from relnav.navigation.log import filter_epochs
from relnav.navigation.record import Solution


def filter_log(
    path: str | os.PathLike[str],
    model: Model | str,
    *,
    method: str = "spots",
    projection: str | None = None,
    smooth: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Solution:
    """Filter a CSV log of spots into a track.

    Parameters
    ----------
    path : str or path
        The log: `t_s`, `spot_a_x_um`, ... (any length unit; empty = not seen), optionally `sigma_spot_a_x_um`, ... (all
        of them; empty = as before), `accel_x_m_s2`, ...,
        `delta_v_x_m_s`, ..., `q_cam_from_lvlh_x`, ... Or a raw log, a row a slot: `t_s`, `beacon`, four currents.
    model : Model or str
        A loaded model, or what `load_model` takes.
    method : {"spots", "fix"}
        Measurement model, as for `Navigator`.
    projection : {"perspective", "parallel"}, optional
        As for `Navigator`.
    smooth : bool
        Run backward too: every state then rests on all measurements of its unbroken piece of track.
    progress : callable, optional
        Called with (epochs just done, epochs in all).

    Returns
    -------
    Solution
        One entry a row of the log, rejected and empty ones included.

    Raises
    ------
    LogError
        If the log cannot be read; names file, line and column.
    ModelError
        If the model cannot be loaded.
    """
    mission = load_mission(model) if isinstance(model, str) else model
    if is_raw_log(Path(path)):
        return filter_raw_log(Path(path), mission, method=method, projection=projection, smooth=smooth)
    log = read_log(Path(path))
    check_beacons(log.path, log.spots_m.shape[1], mission.name, len(mission.beacons_lvlh_m))
    total = len(log.t_s)
    solution = filter_epochs(
        mission,
        log.t_s,
        log.spots_m,
        acceleration_m_s2=log.acceleration_m_s2,
        delta_v_m_s=log.delta_v_m_s,
        q_cam_from_lvlh=log.q_cam_from_lvlh,
        spot_sigma_m=log.spot_sigma_m,
        method=method,
        projection=projection,
        smooth=smooth,
        progress=None if progress is None else lambda done: progress(done, total),
    )
    solution.metadata.update(log_metadata(log.path, log.metadata, log.ignored))
    return solution
