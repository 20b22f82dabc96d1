"""A solution as a file: the public `write`, whichever filter it comes from, in the format that the ending names."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from relnav.dynamics.in_frame import OWN, Turning
from relnav.errors import UsageError
from relnav.files.paths import path_of
from relnav.files.systems import resolve
from relnav.files.tables import COLUMNS, INTEGERS, TRACKS, Table, check_format, head, rows_of, write_table
from relnav.navigation.lasting_words import marker_words
from relnav.navigation.pose_record import PoseSolution
from relnav.navigation.record import PER_EPOCH, Solution

ROWS_AT_ONCE = 65_536
EXCHANGE = {
    ".oem": ("relnav.files.oem:check_oem", "relnav.files.oem:write_oem"),
    ".aem": ("relnav.files.aem:check_aem", "relnav.files.aem:write_aem"),
    ".mat": ("relnav.files.tracks:check_turning", "relnav.files.matlab:write_mat"),
    ".nc": ("relnav.files.netcdf:check_netcdf", "relnav.files.netcdf:write_netcdf"),
    ".h5": ("relnav.files.netcdf:check_netcdf", "relnav.files.netcdf:write_netcdf"),
    ".mcap": ("relnav.files.mcap_file:check_mcap", "relnav.files.mcap_file:write_mcap"),
    ".rosbag2": ("relnav.files.ros_bag:check_bag", "relnav.files.ros_bag:write_bag"),
    ".bsp": ("relnav.files.spice:check_spk", "relnav.files.spice:write_spk"),
    ".bc": ("relnav.files.spice:check_ck", "relnav.files.spice:write_ck"),
}
"""Ending -> what refuses settings before there is a track, and what writes it: functions of (settings) and of
(solution, path, settings). Settings: `frame`, `orientation_deg`, `model`, `epoch`, `attitude` (whether the track has
one), `clock` (where a second file goes)."""


def clock_beside(path: Path) -> Path | None:
    """Where the clock goes that an attitude kernel of SPICE (.bc) is read with; None beside any other format."""
    return path.with_suffix(".tsc") if path.suffix.lower() == ".bc" else None


def write(
    solution: Solution | PoseSolution,
    path: str | os.PathLike[str],
    *,
    frame: str = OWN,
    orientation_deg: tuple[float, float, float] | None = None,
    model: Any = None,
    epoch: str | None = None,
) -> None:
    """Write a solution, one row an epoch; in a table numbers are exact (read back, they are the same).

    Parameters
    ----------
    solution : Solution or PoseSolution
        From `filter_log`.
    path : str or path
        Its ending is the format; a file appears whole or not at all. Tables are `.csv`, `.jsonl` (an object a row) and
        `.parquet` (needs pyarrow); empty or null: no state yet. `.mat` is MATLAB. `.nc` and `.h5` are netCDF-4, which
        is HDF5, with CF units (needs xarray, h5netcdf and h5py). `.mcap` has poses with covariance for Foxglove (needs
        mcap), `.rosbag2` is a bag of ROS 2 (needs rosbags). `.oem` and `.aem` are CCSDS ephemeris with covariance, and
        attitude of the target. `.bsp` and `.bc` are SPICE's ephemeris, and attitudes of target and chaser with the
        clock `.tsc` beside them (needs spiceypy).
    frame, orientation_deg, model
        Frame of states, attitudes and covariances, as for `Solution.in_frame`. `.aem` and `.bc` hold attitudes in
        inertial axes alone.
    epoch : str, optional
        UTC of the log's t = 0, ISO; `.oem`, `.aem`, `.bsp` and `.bc` need it.

    Raises
    ------
    UsageError
        For another ending, a folder that does not exist, a package that is missing, or a frame that the format does not
        support.
    """
    if not isinstance(solution, Solution | PoseSolution):
        raise UsageError(f"a solution as relnav.filter_log returns it is expected; got a {type(solution).__name__}")
    from relnav.files.models import mission_of

    target, mission = path_of(path, "an output's path"), mission_of(solution) if model is None else model
    settings = {"frame": frame, "orientation_deg": orientation_deg, "model": mission, "epoch": epoch}
    settings["attitude"] = isinstance(solution, PoseSolution)
    if target.suffix.lower() in EXCHANGE:
        check_exchange(target, settings)
        write_exchange(solution, target, settings | {"clock": clock_beside(target)})
        return
    check_format(target, TRACKS, EXCHANGE)
    turning = Turning(frame, mission, orientation_deg)
    if isinstance(solution, PoseSolution):
        from relnav.files.marker_logs import write_track  # scipy's rotations, which a beacon log does not need

        said = ({"smoothed": "yes"} if solution.smoothed else {}) | marker_words(solution.mission)
        write_track([solution], solution.model, target, said, turning=turning)
        return
    stated = head(solution.model, solution.method, solution.smoothed) | turning.stated
    stated |= {key: str(value) for key, value in solution.metadata.items()}

    def parts() -> Iterator[Table]:
        """Part after part: a long solution's covariances are never all in memory."""
        for begin in range(0, len(solution), ROWS_AT_ONCE):
            part = solution.part(begin, begin + ROWS_AT_ONCE)
            yield rows_of(part, turning(part))

    write_table(target, COLUMNS, parts(), stated, INTEGERS)


def check_exchange(path: Path, settings: dict[str, Any]) -> None:
    """Refuse, before there is a track, what a format of `EXCHANGE`, or a table, cannot hold or needs.

    Raises
    ------
    UsageError
        In one sentence.
    """
    ending = path.suffix.lower()
    if ending in EXCHANGE:
        resolve(EXCHANGE[ending][0])(settings)
    check_turning(settings)


def check_turning(settings: dict[str, Any]) -> None:
    """Refuse a frame that needs what was not given.

    Raises
    ------
    UsageError
        As `Turning`.
    """
    Turning(settings["frame"], settings["model"], settings["orientation_deg"])


def write_exchange(solution: Any, path: Path, settings: dict[str, Any]) -> None:
    """Write a solution in one of the formats of `EXCHANGE`."""
    resolve(EXCHANGE[path.suffix.lower()][1])(solution, path, settings)


def joined(parts: list[Any]) -> Any:
    """Consecutive parts of a solution as one."""
    first = parts[0]
    if not isinstance(first, Solution):
        kind = first.epochs.dtype  # as bytes: of records numpy would look at every field of every part
        rows = [np.ascontiguousarray(part.epochs).view(np.uint8) for part in parts]
        return replace(first, epochs=np.concatenate(rows).view(kind))
    turning = all(len(part.lever_lvlh_m) == len(part) for part in parts)
    names = [*PER_EPOCH, *(["lever_lvlh_m"] if turning else [])]
    arrays: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return replace(first, restarts=parts[-1].restarts, **arrays)
