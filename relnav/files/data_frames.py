"""Solutions for the libraries that people work with: pandas (a table) and xarray (arrays with units)."""

from typing import Any

import numpy as np

from relnav.dynamics.in_frame import AXES, FramedTrack
from relnav.files.optional import require
from relnav.files.tables import COLUMNS, STATE, STATE_COLUMNS, STATE_UNITS, head, rows_of
from relnav.files.units import split_unit
from relnav.navigation.record import Solution

CF_UNITS = {"": "1", "deg": "degree", "m_s": "m s-1", "deg_s": "degree s-1", "rad_s": "rad s-1", "um": "um"}
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
    errors = STATE_ERRORS if isinstance(solution, Solution) else POSE_ERRORS
    time = ("time", np.asarray(columns["t_s"]), {"units": "s", "long_name": "time of the log's own clock"})
    variables: dict[str, Any] = {
        _base(name): ("time", np.asarray(column), {"units": unit_of(name), "long_name": name})
        for name, column in columns.items()
        if name != "t_s" and not name.startswith("cov_")
    }
    variables["status"] = ("time", np.asarray(solution.status), {"units": "1", **_status_flags()})
    variables["covariance"] = (("time", "component", "component_2"), covariance, _covariance_words(len(errors)))
    named = {"component": list(errors), "component_2": list(errors)}
    stated = {key.replace(" ", "_"): value for key, value in stated.items()}
    return xarray.Dataset(variables, coords={"time": time, **named}, attrs={"Conventions": "CF-1.11", **stated})


def _framed_columns(track: FramedTrack) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Columns of a track in a frame without its covariance, by name, and the names of its errors."""
    errors = POSE_ERRORS if track.covariance.shape[-1] == len(POSE_ERRORS) else STATE_ERRORS
    units = (*STATE_UNITS, *("rad",) * 3, *("rad_s",) * 3)
    columns = {"t_s": track.t_s} | dict(zip(STATE_COLUMNS, track.state.T, strict=True))
    attitude = track.q_frame_from_target
    if attitude is not None and track.rate_rad_s is not None:
        columns |= {f"q_{AXES[track.frame]}_from_target_{axis}": q for axis, q in zip("xyzw", attitude.T, strict=True)}
        columns |= {f"rate_{axis}_rad_s": rate for axis, rate in zip("xyz", track.rate_rad_s.T, strict=True)}
    sigmas = zip(errors, units, track.sigma.T, strict=False)
    return columns | {f"sigma_{name}_{unit}": sigma for name, unit, sigma in sigmas}, errors


def framed_dataframe(track: FramedTrack) -> Any:
    """As `FramedTrack.to_dataframe` describes it."""
    pandas = require("pandas", "pandas", "A data frame needs pandas")
    columns, errors = _framed_columns(track)
    rows, others = np.triu_indices(len(errors))
    columns |= {f"cov_{errors[i]}_{errors[j]}": track.covariance[:, i, j] for i, j in zip(rows, others, strict=True)}
    frame = pandas.DataFrame(columns)
    frame.attrs = {**track.metadata, "units": {name: unit_of(name) for name in columns}}
    return frame


def framed_xarray(track: FramedTrack) -> Any:
    """As `FramedTrack.to_xarray` describes it."""
    xarray = require("xarray", "xarray", "A Dataset needs xarray")
    columns, errors = _framed_columns(track)
    variables: dict[str, Any] = {
        _base(name): ("time", column, {"units": unit_of(name), "long_name": name})
        for name, column in columns.items()
        if name != "t_s"
    }
    variables["covariance"] = (("time", "component", "component_2"), track.covariance, _covariance_words(len(errors)))
    time = ("time", track.t_s, {"units": "s", "long_name": "time of the log's own clock"})
    named = {"component": list(errors), "component_2": list(errors)}
    stated = {key.replace(" ", "_"): value for key, value in track.metadata.items()}
    return xarray.Dataset(variables, coords={"time": time, **named}, attrs={"Conventions": "CF-1.11", **stated})


def _covariance_words(errors: int) -> dict[str, str]:
    return {"long_name": "covariance of the state's error", "units_of_component": " | ".join(POSE_UNITS[:errors])}


def _base(column: str) -> str:
    return column if column.startswith("q_") else split_unit(column)[0]


def _status_flags() -> dict[str, Any]:
    from relnav.navigation.status import EpochStatus

    return {
        "flag_values": np.array([int(s) for s in EpochStatus], dtype=np.int64),
        "flag_meanings": " ".join(s.name.lower() for s in EpochStatus),
    }
