"""Solutions for the libraries that people work with: pandas (a table) and xarray (arrays with units)."""

from typing import Any

import numpy as np

from relnav.dynamics.in_frame import FramedTrack
from relnav.files.optional import require
from relnav.files.tables import COLUMNS, STATE, head, rows_of
from relnav.files.units import split_unit
from relnav.navigation.record import Solution

CF_UNITS = {"": "1", "deg": "degree", "m_s": "m s-1", "deg_s": "degree s-1", "um": "um"}
"""Spelling of the CF conventions (UDUNITS), where it is not ours."""
STATE_ERRORS = STATE
POSE_ERRORS = (*STATE, "turn_x", "turn_y", "turn_z", "rate_x", "rate_y", "rate_z")
POSE_UNITS = ("m",) * 3 + ("m s-1",) * 3 + ("rad",) * 3 + ("rad s-1",) * 3


def unit_of(column: str) -> str:
    """Unit of a track's column, as CF spells it; "1" for a number without one."""
    unit = "" if column.startswith(("q_", "cov_")) else split_unit(column)[1]
    return CF_UNITS.get(unit, unit)


def track_table(solution: Any, turned: FramedTrack | None = None) -> tuple[dict[str, Any], dict[str, str]]:
    """Columns of the track by name, and what its head states; in another frame, if that is given."""
    if isinstance(solution, Solution):
        stated = head(solution.model, solution.method, solution.smoothed)
        columns = dict(zip(COLUMNS, rows_of(solution, turned), strict=True))
        stated |= {} if turned is None else turned.metadata
    else:
        from relnav.files.marker_logs import track_columns, track_head

        columns, stated = track_columns(solution, turned), track_head(solution, turned)
    stated |= {key: str(value) for key, value in solution.metadata.items()}
    return columns, stated


def to_dataframe(solution: Any) -> Any:
    """As `Solution.to_dataframe` describes it."""
    pandas = require("pandas", "pandas", "A data frame needs pandas")
    columns, stated = track_table(solution)
    frame = pandas.DataFrame({name: np.asarray(column) for name, column in columns.items()})
    frame["status"] = np.asarray(solution.status)
    frame.attrs = {**stated, "units": {name: unit_of(name) for name in frame.columns}}
    return frame


def to_xarray(solution: Any, turned: FramedTrack | None = None) -> Any:
    """As `Solution.to_xarray` describes it; in another frame if that is given."""
    xarray = require("xarray", "xarray", "A Dataset needs xarray")
    columns, stated = track_table(solution, turned)
    covariance = solution.covariance if turned is None else turned.covariance
    errors, units = (STATE, POSE_UNITS[:6]) if isinstance(solution, Solution) else (POSE_ERRORS, POSE_UNITS)
    time = ("time", np.asarray(columns["t_s"]), {"units": "s", "long_name": "time of the log's own clock"})
    variables: dict[str, Any] = {
        _base(name): ("time", np.asarray(column), {"units": unit_of(name), "long_name": name})
        for name, column in columns.items()
        if name != "t_s" and not name.startswith("cov_")
    }
    variables["status"] = ("time", np.asarray(solution.status), {"units": "1", **_status_flags()})
    said = {"long_name": "covariance of the state's error", "units_of_component": " | ".join(units)}
    variables["covariance"] = (("time", "component", "component_2"), covariance, said)
    named = {"component": list(errors), "component_2": list(errors)}
    stated = {key.replace(" ", "_"): value for key, value in stated.items()}
    return xarray.Dataset(variables, coords={"time": time, **named}, attrs={"Conventions": "CF-1.11", **stated})


def _base(column: str) -> str:
    return column if column.startswith("q_") else split_unit(column)[0]


def _status_flags() -> dict[str, Any]:
    from relnav.navigation.status import EpochStatus

    return {
        "flag_values": np.array([int(s) for s in EpochStatus], dtype=np.int64),
        "flag_meanings": " ".join(s.name.lower() for s in EpochStatus),
    }
