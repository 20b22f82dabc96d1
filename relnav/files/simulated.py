"""A simulated log as files: the log as `relnav filter` reads it, and its truth."""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from relnav.arrays import Matrix
from relnav.files.log_columns import ACCELERATION, SPOTS
from relnav.files.tables import STATE_COLUMNS, check_format, relnav_version, write_table
from relnav.simulation.scenario import SimulatedLog

LOG_COLUMNS = ("t_s", *(f"{base}_um" for base in SPOTS), *(f"{base}_m_s2" for base in ACCELERATION))
TRUTH_COLUMNS = ("t_s", *STATE_COLUMNS)


def write_log(log: SimulatedLog, path: str | os.PathLike[str], metadata: dict[str, str] | None = None) -> None:
    """Write a simulated log (.csv or .parquet) in the columns that `relnav filter` reads."""
    spots = log.spots_m.reshape(len(log.t_s), 6) * 1e6
    _write(Path(path), LOG_COLUMNS, np.column_stack([log.t_s, spots, log.acceleration_m_s2]), metadata)


def write_truth(log: SimulatedLog, path: str | os.PathLike[str], metadata: dict[str, str] | None = None) -> None:
    """Write a simulated log's true states (.csv or .parquet)."""
    _write(Path(path), TRUTH_COLUMNS, np.column_stack([log.t_s, log.truth]), metadata)


def _write(path: Path, columns: tuple[str, ...], rows: Matrix, metadata: dict[str, str] | None) -> None:
    check_format(path)
    head = {"relnav": relnav_version(), "frame": "lvlh_ccsds"} | (metadata or {})

    def parts() -> Iterator[Matrix]:
        yield rows

    write_table(path, columns, parts(), head, ())
