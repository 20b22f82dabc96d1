"""A track read back, part after part, for whoever looks at it: by its columns, of whichever filter it is."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Vector
from relnav.errors import LogError
from relnav.files.approach_view import PORT_COVARIANCE, STATE_COVARIANCE
from relnav.files.log_columns import Columns
from relnav.files.logs import LogFile
from relnav.files.text_table import TextTable
from relnav.files.wording import listed
from relnav.navigation.status import PREDICTED, REJECTED, STARTED, UPDATED, WAITING, Alarm, EpochStatus

NEEDED = ("t_s", "x_m", "y_m", "z_m", "sigma_x_m", "nis", "dof")
NEEDED_OF_VEHICLE = (*NEEDED[:5], "gyro_lost")
CODES = {"status": max(EpochStatus), "alarm": sum(Alarm)}
"""Columns of codes, and the largest of each."""


def is_track(names: list[str]) -> bool:
    """Whether a table's columns are those of a track."""
    return {"sigma_x_m", "nis", "dof"} <= set(names) or _is_vehicles(names)


def _is_vehicles(names: list[str]) -> bool:
    return {"sigma_x_m", "gyro_lost"} <= set(names)


class TrackFile:
    """An opened track.

    Attributes
    ----------
    path, metadata : Path, dict
        The file, and what its head states.
    names : tuple of str
        Its columns that are read.
    of_vehicle : bool
        Whether it is a vehicle's: port from port in target axes.

    Raises
    ------
    LogError
        For a file that is none.
    """

    def __init__(self, opened: Path | TextTable) -> None:
        """Read the head, if it has not been read already."""
        self._file = LogFile(opened, _parse)
        self.path, self.metadata = self._file.path, self._file.metadata
        self.names = tuple(self._file.columns.index)
        self.of_vehicle = _is_vehicles(list(self.names))
        if not self.of_vehicle and not self.metadata.get("frame", "lvlh_ccsds").startswith("lvlh_ccsds"):
            raise LogError(f"{self.path}: a track in lvlh_ccsds is expected; its head says {self.metadata['frame']}")
        self._started = False

    def parts(self) -> Iterator[dict[str, Any]]:
        """Columns by name, part after part, but for a vehicle's `status` among them; at least one.

        Raises
        ------
        LogError
            Naming file and line, for times that are not finite or do not increase.
        """
        before = -np.inf
        for values, lines in self._file.rows():
            columns: dict[str, Any] = {name: values[:, k] for k, name in enumerate(self.names)}
            t = columns["t_s"]
            last = np.concatenate([[before], t[:-1]])  # a vehicle's last row may be at the time of the one before
            late = np.flatnonzero(~((t >= last) if self.of_vehicle else (t > last)))
            if late.size:
                where = f"{self.path}:{int(lines[late[0]])}"
                raise LogError(f"{where}: t_s does not increase; a track has one row an epoch")
            self._check_codes(columns, lines)
            before = float(t[-1])
            if "status" not in columns and not self.of_vehicle:
                columns["status"] = self._status(columns)
            yield columns
        if before == -np.inf:
            raise LogError(f"{self.path}: no rows after the header; at least one epoch is expected")

    def _check_codes(self, columns: dict[str, Any], lines: Vector) -> None:
        """Refuse codes that are none: of another program, or damaged."""
        for name, most in CODES.items():
            codes = columns.get(name, np.zeros(0))
            whole = (codes >= 0) & (codes <= most) & (codes == np.floor(codes))
            if (bad := np.flatnonzero(~(whole | (np.isnan(codes) & (name != "status"))))).size:
                raise LogError(
                    f"{self.path}:{int(lines[bad[0]])}: column '{name}': a code, a whole number from 0 to {most}, is "
                    f"expected; got {codes[bad[0]]:.6g}"
                )

    def _status(self, columns: dict[str, Any]) -> Any:
        """Codes of EpochStatus as far as a beacon track tells them: refused is REJECTED, in part or whole."""
        known, seen = np.isfinite(columns["x_m"]), columns["dof"] > 0
        accepted = columns.get("accepted", np.where(seen, 1.0, 0.0)) > 0
        status = np.where(accepted, UPDATED, np.where(seen, REJECTED, PREDICTED))
        status = np.where(known, status, WAITING)
        first = np.flatnonzero(known)
        if first.size and not self._started:
            status[first[0]], self._started = STARTED, True
        return status


def _parse(names: list[str], where: str) -> Columns:
    for name in NEEDED_OF_VEHICLE if _is_vehicles(names) else NEEDED:
        if name not in names:
            raise LogError(
                f"{where}: column '{name}' is missing; a track as `relnav filter --out` writes it is expected, and the "
                f"columns are {listed(names)}"
            )
    drawn = PORT_COVARIANCE if PORT_COVARIANCE[0] in names else STATE_COVARIANCE
    index = {name: k for k, name in enumerate(names) if not name.startswith("cov_") or name in drawn}
    return Columns(tuple(names), index, dict.fromkeys(index, 1.0), ())
