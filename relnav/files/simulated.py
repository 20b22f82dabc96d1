"""A simulated log as files: the log as `relnav filter` reads it, and its truth."""

import csv
import os
from pathlib import Path

import numpy as np

from relnav.errors import UsageError
from relnav.files.atomic import is_stream, replacing
from relnav.files.log_columns import ACCELERATION, sigma_columns, spot_columns
from relnav.files.raw_logs import COUNTS
from relnav.files.tables import STATE_COLUMNS, Table, check_format, relnav_version, write_table
from relnav.files.wording import printable
from relnav.sensors.three_beacon.pulses import NAMES
from relnav.simulation.raw import RawLog
from relnav.simulation.scenario import SimulatedLog

LOG_COLUMNS = ("t_s", *(f"{base}_um" for base in spot_columns(3)), *(f"{base}_m_s2" for base in ACCELERATION))
"""Of a log of three beacons."""
TRUTH_COLUMNS = ("t_s", *STATE_COLUMNS)


def write_log(log: SimulatedLog, path: str | os.PathLike[str], metadata: dict[str, str] | None = None) -> None:
    """Write a simulated log (.csv or .parquet) in the columns that `relnav filter` reads."""
    n, beacons = log.spots_m.shape[:2]
    spots = log.spots_m.reshape(n, -1) * 1e6
    columns = ("t_s", *(f"{base}_um" for base in spot_columns(beacons)), *(f"{base}_m_s2" for base in ACCELERATION))
    table = [log.t_s, *spots.T, *log.acceleration_m_s2.T]
    if log.sigma_m is not None:
        columns = (*columns, *(f"{base}_um" for base in sigma_columns(beacons)))
        table.extend(log.sigma_m.reshape(n, -1).T * 1e6)
    _write(Path(path), columns, table, metadata)


def write_raw_log(log: RawLog, path: str | os.PathLike[str], metadata: dict[str, str] | None = None) -> None:
    """Write a simulated raw log (.csv), a row a slot, in the columns that `relnav filter` reads.

    Raises
    ------
    UsageError
        For another ending: a raw log names its beacons in words.
    """
    target = Path(path)
    if target.suffix.lower() != ".csv" and not (target.suffix == "" and is_stream(target)):
        raise UsageError(f"{target}: a raw log ends in .csv; got '{target.suffix}'")
    head = {"relnav": relnav_version(), "frame": "lvlh_ccsds"} | (metadata or {})
    rows = np.column_stack([log.counts, log.acceleration_m_s2]).tolist()
    with replacing(target, ".csv") as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {printable(key)} = {printable(value)}\n" for key, value in head.items())
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("t_s", "beacon", *COUNTS, *(f"{base}_m_s2" for base in ACCELERATION)))
        for t, beacon, row in zip(log.t_s.tolist(), log.beacon.tolist(), rows, strict=True):
            writer.writerow((repr(t), NAMES[beacon], *(f"{count:.10g}" for count in row[:4]), *map(repr, row[4:])))


def write_truth(
    log: SimulatedLog | RawLog, path: str | os.PathLike[str], metadata: dict[str, str] | None = None
) -> None:
    """Write a simulated log's true states (.csv or .parquet)."""
    _write(Path(path), TRUTH_COLUMNS, [log.t_s, *log.truth.T], metadata)


def _write(path: Path, columns: tuple[str, ...], table: Table, metadata: dict[str, str] | None) -> None:
    check_format(path)
    head = {"relnav": relnav_version(), "frame": "lvlh_ccsds"} | (metadata or {})
    write_table(path, columns, iter([table]), head, ())
