"""From a log file to a solution: the offline use of the filter."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, overload

from relnav.errors import UsageError
from relnav.files.filter_file import engine_words, refuse_late, refuse_raw
from relnav.files.frame_logs import FrameLog, log_in_memory
from relnav.files.late_log import filter_late_log, says_exposures
from relnav.files.log_columns import log_metadata
from relnav.files.logs import LogFile, check_beacons, opened, read_log
from relnav.files.marker_logs import filter_marker_log
from relnav.files.models import BeaconName, MarkerName, flown, load_model
from relnav.files.raw_filter import filter_raw_log
from relnav.files.raw_logs import is_raw_log
from relnav.mission import Model, VisionMission
from relnav.navigation.log import filter_epochs
from relnav.navigation.pose_record import PoseSolution
from relnav.navigation.record import Solution


@overload
def filter_log(
    path: Any,
    model: Model | BeaconName,
    *,
    method: str | None = ...,
    projection: str | None = ...,
    smooth: bool = ...,
    engine: str = ...,
    progress: Callable[[int, int], None] | None = ...,
) -> Solution: ...


@overload
def filter_log(
    path: Any, model: VisionMission | MarkerName, *, smooth: bool = ..., engine: str = ...
) -> PoseSolution: ...


@overload  # which of the two, only the model's file tells
def filter_log(
    path: Any,
    model: str,
    *,
    method: str | None = ...,
    projection: str | None = ...,
    smooth: bool = ...,
    engine: str = ...,
    progress: Callable[[int, int], None] | None = ...,
) -> Any: ...


def filter_log(
    path: Any,
    model: Model | VisionMission | str,
    *,
    method: str | None = None,
    projection: str | None = None,
    smooth: bool = False,
    engine: str = "compiled",
    progress: Callable[[int, int], None] | None = None,
) -> Solution | PoseSolution:
    """Filter a log of spots (CSV or Parquet) into a track.

    A log of a marker model becomes a `PoseSolution`; its columns are those of `filter_marker_log`, and `method`,
    `projection` and `progress` are for beacons alone.

    Parameters
    ----------
    path : str, path or DataFrame
        The log, a file, a ROS bag or a table in memory (pandas, polars): `t_s`,
        `spot_a_x_um`, ... (any length unit; empty = not seen), optionally `sigma_spot_a_x_um`, ... (all
        of them; empty = as before), `accel_x_m_s2`, ...,
        `delta_v_x_m_s`, ..., `q_cam_from_lvlh_x`, ..., `image_t_s` (middle of the exposure, where images come late).
        Or a raw log, a row a slot: `t_s`, `beacon`, four currents.
    model : Model, VisionMission or str
        A loaded model, or what `load_model` takes.
    method : {"fix", "spots"}, optional
        Measurement model, as for `Navigator`; "fix" if left out.
    projection : {"perspective", "parallel"}, optional
        As for `Navigator`.
    smooth : bool
        Add a backward pass: every state is then estimated from all measurements of its segment of the track.
    engine : {"compiled", "filterpy"}
        As for `Navigator` and `PoseNavigator`: the second is for comparison. It does not read raw logs; of markers it
        neither takes late images nor smooths.
    progress : callable, optional
        Called with (epochs just done, epochs in all).

    Returns
    -------
    Solution or PoseSolution
        One entry a row of the log, rejected and empty ones included.

    Raises
    ------
    LogError
        If the log cannot be read; names file, line and column.
    ModelError
        If the model cannot be loaded, or is not one of beacons or markers.
    UsageError
        For a keyword that does not apply to a marker model, or that the engine does not support.
    """
    mission = flown(load_model(model) if isinstance(model, str) else model)
    if isinstance(mission, VisionMission):
        given = {"method": method is not None, "projection": projection, "progress": progress}
        for keyword in (name for name, value in given.items() if value):
            raise UsageError(f"{keyword} is for three-beacon models; {mission.name} has one filter, on its spots")
        return filter_marker_log(path, mission, smooth=smooth, engine=engine)
    method = "fix" if method is None else method
    source = log_in_memory(path) or opened(Path(path))
    if not isinstance(source, FrameLog) and is_raw_log(source):
        refuse_raw(engine)
        return filter_raw_log(source, mission, method=method, projection=projection, smooth=smooth)
    opened_log = source if isinstance(source, LogFile) else LogFile(source)
    if says_exposures(opened_log):
        refuse_late(engine)
        return filter_late_log(opened_log, mission, method=method, projection=projection, smooth=smooth)
    log = read_log(opened_log)
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
        engine=engine,
        progress=None if progress is None else lambda done: progress(done, total),
    )
    solution.metadata.update(engine_words(engine) | log_metadata(log.path, log.metadata, log.ignored))
    return solution
