"""A simulated log as files: the log as `relnav filter` reads it, and its truth."""

import os
from pathlib import Path

from relnav.files.log_columns import ACCELERATION, SPOTS
from relnav.files.tables import STATE_COLUMNS, Table, check_format, relnav_version, write_table
from relnav.simulation.scenario import SimulatedLog

LOG_COLUMNS = ("t_s", *(f"{base}_um" for base in SPOTS), *(f"{base}_m_s2" for base in ACCELERATION))
TRUTH_COLUMNS = ("t_s", *STATE_COLUMNS)


def write_log(log: SimulatedLog, path: str | os.PathLike[str], metadata: dict[str, str] | None = None) -> None:
    """Write a simulated log (.csv or .parquet) in the columns that `relnav filter` reads."""
    spots = log.spots_m.reshape(len(log.t_s), 6) * 1e6
    _write(Path(path), LOG_COLUMNS, [log.t_s, *spots.T, *log.acceleration_m_s2.T], metadata)


def write_truth(log: SimulatedLog, path: str | os.PathLike[str], metadata: dict[str, str] | None = None) -> None:
    """Write a simulated log's true states (.csv or .parquet)."""
    _write(Path(path), TRUTH_COLUMNS, [log.t_s, *log.truth.T], metadata)


def _write(path: Path, columns: tuple[str, ...], table: Table, metadata: dict[str, str] | None) -> None:
    check_format(path)
    head = {"relnav": relnav_version(), "frame": "lvlh_ccsds"} | (metadata or {})
    write_table(path, columns, iter([table]), head, ())
