"""A solution as a file: the public `write`, whichever filter it comes from, in the format that the ending names."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from relnav.errors import UsageError
from relnav.files.systems import resolve
from relnav.files.tables import COLUMNS, INTEGERS, TRACKS, Table, check_format, head, rows_of, write_table
from relnav.navigation.in_frame import frame_words, in_frame
from relnav.navigation.pose_record import PoseSolution
from relnav.navigation.record import PER_EPOCH, Solution

ROWS_AT_ONCE = 65_536
EXCHANGE = {
    ".oem": "relnav.files.oem:write_oem",
    ".aem": "relnav.files.aem:write_aem",
    ".mat": "relnav.files.matlab:write_mat",
    ".nc": "relnav.files.netcdf:write_netcdf",
    ".h5": "relnav.files.netcdf:write_netcdf",
    ".mcap": "relnav.files.mcap_file:write_mcap",
    ".rosbag2": "relnav.files.ros_bag:write_bag",
    ".bsp": "relnav.files.spice:write_spk",
    ".bc": "relnav.files.spice:write_ck",
}
"""Ending -> what writes it, as a function of (solution, path, settings)."""
TURNED = (".oem", ".bsp")
"""Of these, those that turn states into another frame."""


def clock_beside(path: Path) -> Path | None:
    """Where the clock goes that an attitude kernel of SPICE (.bc) is read with; None beside any other format."""
    return path.with_suffix(".tsc") if path.suffix.lower() == ".bc" else None


def write(
    solution: Solution | PoseSolution,
    path: str | os.PathLike[str],
    *,
    frame: str = "lvlh_ccsds",
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
        Frame of states and covariances, as for `Solution.in_frame`; of tables of beacons, `.oem` and `.bsp`.
    epoch : str, optional
        UTC of the log's t = 0, ISO; `.oem`, `.aem`, `.bsp` and `.bc` need it.

    Raises
    ------
    UsageError
        For another ending, a folder that does not exist, a package that is missing, or a frame that cannot be.
    """
    target = Path(path)
    check_frame(target, frame)
    settings = {"frame": frame, "orientation_deg": orientation_deg, "model": model, "epoch": epoch}
    if target.suffix.lower() in EXCHANGE:
        write_exchange(solution, target, settings | {"clock": clock_beside(target)})
        return
    check_format(target, TRACKS)
    if not isinstance(solution, Solution):
        from relnav.files.marker_logs import write_track  # scipy's rotations, which a beacon log does not need

        if frame != "lvlh_ccsds":
            raise UsageError("the table of a marker track is in lvlh_ccsds; solution.in_frame(...) turns its states")
        write_track([solution], solution.model, target, {"smoothed": "yes"} if solution.smoothed else {})
        return
    from relnav.files.models import mission_of

    mission = mission_of(solution) if model is None else model
    turned = frame != "lvlh_ccsds"
    said = frame_words(frame, mission, orientation_deg)
    stated = head(solution.model, solution.method, solution.smoothed) | (said if turned else {})
    stated |= {key: str(value) for key, value in solution.metadata.items()}

    def parts() -> Iterator[Table]:
        """Part after part: a long solution's covariances are never all in memory."""
        for begin in range(0, len(solution), ROWS_AT_ONCE):
            part = solution.part(begin, begin + ROWS_AT_ONCE)
            yield rows_of(part, in_frame(part, frame, mission, orientation_deg) if turned else None)

    write_table(target, COLUMNS, parts(), stated, INTEGERS)


def check_frame(path: Path, frame: str) -> None:
    """Refuse another frame where a format has the states as the filter has them.

    Raises
    ------
    UsageError
        Naming the file.
    """
    ending = path.suffix.lower()
    if frame != "lvlh_ccsds" and ending in EXCHANGE and ending not in TURNED:
        raise UsageError(
            f"{path}: {ending} holds what the filter has, in lvlh_ccsds; frame {frame} is for .csv, .oem and .bsp"
        )


def write_exchange(solution: Any, path: Path, settings: dict[str, Any]) -> None:
    """Write a solution in one of the formats of `EXCHANGE`."""
    resolve(EXCHANGE[path.suffix.lower()])(solution, path, settings)


def joined(parts: list[Any]) -> Any:
    """Consecutive parts of a solution as one."""
    first = parts[0]
    if not isinstance(first, Solution):
        return replace(first, epochs=np.concatenate([part.epochs for part in parts]))
    names = [*PER_EPOCH, *(["lever_lvlh_m"] if len(first.lever_lvlh_m) == len(first) > 1 else [])]
    arrays: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return replace(first, restarts=parts[-1].restarts, **arrays)
