"""Marker logs as files: simulated ones and their truth out, a log in, its track of position and attitude out."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.dynamics.in_frame import AXES, OWN, FramedTrack, Turning
from relnav.files.approach_view import PORT_COVARIANCE
from relnav.files.frame_logs import log_in_memory
from relnav.files.log_columns import ACCELERATION, DELTA_V, IMAGE_TIME, Columns, markers, parse_header
from relnav.files.logs import LogFile
from relnav.files.spool import Spool
from relnav.files.tables import STATE_COLUMNS, TRACKS, Table, Writer, check_format, relnav_version, write_table
from relnav.files.text_table import TextTable
from relnav.geometry.rotation import quaternions_from_dcm_into
from relnav.mission import VisionMission
from relnav.navigation.arguments import controls, quaternions
from relnav.navigation.pose_call import AS_STATED
from relnav.navigation.pose_epoch import EPOCH
from relnav.navigation.pose_log import CHUNK, MarkerLogFilter, smoothed_rows, with_usable
from relnav.navigation.pose_record import PoseSolution
from relnav.navigation.pose_smoothing import PoseSmoother
from relnav.simulation.marker_flight import MarkerFlight

_XYZ, _XYZW = ("x", "y", "z"), ("x", "y", "z", "w")
QUATERNION_COLUMNS = tuple(f"q_lvlh_from_target_{axis}" for axis in _XYZW)
RATE_COLUMNS = tuple(f"rate_{axis}_deg_s" for axis in _XYZ)
TRUTH_COLUMNS = ("t_s", *STATE_COLUMNS, *QUATERNION_COLUMNS, *RATE_COLUMNS)
PORT_COLUMNS = (
    *(f"port_{axis}_m" for axis in _XYZ),
    *(f"port_v{axis}_m_s" for axis in _XYZ),
    *(f"q_target_from_chaser_{axis}" for axis in _XYZW),
    *(f"relative_rate_{axis}_deg_s" for axis in _XYZ),
)
_ERRORS = ("x", "y", "z", "vx", "vy", "vz", "turn_x", "turn_y", "turn_z", "rate_x", "rate_y", "rate_z")
_ERROR_UNITS = ("m",) * 3 + ("m_s",) * 3 + ("deg",) * 3 + ("deg_s",) * 3
_UPPER, _UPPER_3 = np.triu_indices(12), np.triu_indices(3)
TRACK_COLUMNS = (
    *TRUTH_COLUMNS,
    *(f"sigma_{name}_{unit}" for name, unit in zip(_ERRORS, _ERROR_UNITS, strict=True)),
    *PORT_COLUMNS,
    *(f"sigma_port_{name}_{unit}" for name, unit in zip(_ERRORS, _ERROR_UNITS, strict=True)),
    *("nis", "dof", "used", "status", "hypotheses", "ambiguity", "observable", "too_late", "alarm"),
    *(f"cov_{_ERRORS[i]}_{_ERRORS[j]}" for i, j in zip(*_UPPER, strict=True)),
    *PORT_COVARIANCE,
)
_WHOLE_NUMBERS = ("dof", "used", "status", "hypotheses", "observable", "too_late", "alarm")
_INTEGERS = tuple(TRACK_COLUMNS.index(name) for name in _WHOLE_NUMBERS)


def filter_marker_log(
    path: Any, mission: VisionMission, *, smooth: bool = False, engine: str = "compiled"
) -> PoseSolution:
    """Filter a log of marker spots (CSV, Parquet or a DataFrame, one row an epoch).

    Columns: `t_s`; `spot_a_x_px`, `spot_a_y_px`, ... one pair a marker in the model's order (empty = not seen);
    optionally `sigma_spot_a_x_px`, ... (1-sigma of each coordinate's noise, all or none; empty = the camera's),
    `image_t_s` (middle of the exposure, if not t_s), `accel_{x,y,z}_m_s2`, `delta_v_{x,y,z}_m_s` (`lvlh_ccsds`),
    `q_chaser_from_lvlh_{x,y,z,w}`.

    Raises
    ------
    LogError
        If the log cannot be read; names file, line and column.
    UsageError
        For late images, or smoothing, with `engine="filterpy"`.
    """
    parts = list(marker_solutions(path, mission, smooth=smooth, engine=engine))
    metadata = {} if engine == "compiled" else {"engine": engine}
    seen = [part.spots_px for part in parts if part.spots_px is not None]
    spots = np.concatenate(seen) if len(seen) == len(parts) else None
    epochs = np.concatenate([part.epochs for part in parts])
    own = [part.spot_covariance_px2 for part in parts]
    told = np.concatenate(own) if own[0].shape[1] else own[0]
    return replace(parts[0], epochs=epochs, metadata=metadata, spots_px=spots, spot_covariance_px2=told)


def marker_solutions(
    path: Any, mission: VisionMission, *, smooth: bool = False, engine: str = "compiled"
) -> Iterator[PoseSolution]:
    """The same, piece after piece, in bounded memory: filtered as the log is read, or smoothed at its end.

    To be smoothed, what passed is kept in a temporary file (1.5 kB an epoch), gone through backward, and handed out.

    Raises
    ------
    LogError, UsageError
        As `filter_marker_log`.
    """
    log = MarkerLogFilter(mission, keep=smooth, engine=engine)
    if not smooth:
        for chunk in _chunks(path, mission):
            exposed, own = chunk[-2:]
            seen = chunk[1] if exposed is None else None
            yield PoseSolution(mission, log.forward(*chunk), spots_px=seen, spot_covariance_px2=own)
        return
    with Spool() as rows, Spool() as events:
        for chunk in _chunks(path, mission):
            rows.append(log.forward(*chunk))
            events.append(*log.passed())
        events.append(*log.passed(last=True))
        smoother = PoseSmoother(mission)
        for k in range(len(events) - 1, -1, -1):
            part, apart = events[k]
            smoother.backward(part, apart)
            events.replace(k, part, apart)
        smoothed, at = np.zeros(0, EPOCH), 0
        for k in range(len(rows)):
            (epochs,) = rows[k]
            while len(smoothed) < len(epochs):
                part, _ = events[at]
                smoothed, at = np.concatenate([smoothed, part[part["row"] > 0]]), at + 1
            smoothed_rows(epochs, smoothed[: len(epochs)])
            smoothed = smoothed[len(epochs) :]
            yield PoseSolution(mission, epochs, smoothed=True)


def marker_header(mission: VisionMission) -> Callable[[list[str], str], Columns]:
    """What finds the columns in the header of a log of this model's markers."""
    return partial(parse_header, layout=markers(len(mission.markers.positions_m)))


def marker_log(path: Any, mission: VisionMission) -> LogFile:
    """The log, opened: a file, a table in memory, a ROS bag, or one that is open already."""
    parse = marker_header(mission)
    if isinstance(path, TextTable):
        return LogFile(path, parse)
    return path if isinstance(path, LogFile) else log_in_memory(path, parse) or LogFile(Path(path), parse)


def is_controlled(log: LogFile) -> bool:
    """Whether a log says what the thrusters do."""
    return log.columns.has(ACCELERATION) or log.columns.has(DELTA_V)


def _chunks(path: Any, mission: VisionMission) -> Iterator[tuple[Vector, Stack, Matrix, Matrix, Vector | None, Stack]]:
    """Times, spots, control, chaser attitude, exposures and covariances of a log, a few thousand rows at a time."""
    log = marker_log(path, mission)
    layout = log.columns.layout
    for values in log.tables():
        t, spots = log.group(values, ("t",)), log.group(values, layout.spots)
        assert t is not None
        assert spots is not None
        image, quaternion = log.group(values, IMAGE_TIME), log.group(values, layout.quaternion)
        sigma = log.group(values, layout.sigmas)
        control = controls(len(t), log.group(values, ACCELERATION), log.group(values, DELTA_V))
        attitude = quaternions("q_chaser_from_lvlh", len(t), quaternion)
        for begin in range(0, len(t), CHUNK):
            cut = slice(begin, begin + CHUNK)
            exposed = None if image is None else np.ascontiguousarray(image[cut, 0])
            seen = np.ascontiguousarray(spots[cut]).reshape(-1, len(layout.spots) // 2, 2)
            own = AS_STATED if sigma is None else _covariances(sigma[cut], mission.camera.spot_noise_px)
            seen = seen if sigma is None else with_usable(seen, own)
            yield np.ascontiguousarray(t[cut, 0]), seen, control[cut], attitude[cut], exposed, own


def _covariances(sigma_px: Matrix, stated_px: float) -> Stack:
    """Of spots by the sigmas of their coordinates (n, 2 markers), (n, markers, 2, 2); NaN: as the camera states."""
    variance = np.where(np.isnan(sigma_px), stated_px, sigma_px) ** 2
    out: Stack = variance.reshape(len(variance), -1, 2, 1) * np.eye(2)
    return out


def _quaternions(dcm: Stack) -> Matrix:
    """Scalar last, (n, 4); NaN where dcm is."""
    out = np.empty((len(dcm), 4))
    quaternions_from_dcm_into(np.ascontiguousarray(dcm), out)
    return out


def _sigmas(covariance: Stack) -> Matrix:
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)).copy()
    sigma[:, 6:] = np.degrees(sigma[:, 6:])
    return sigma


def write_track(
    parts: Iterable[PoseSolution],
    model: str,
    path: Path,
    metadata: dict[str, str] | None = None,
    writer: Writer = write_table,
    turning: Turning | None = None,
) -> None:
    """Write consecutive solutions (.csv, .jsonl or .parquet), one row an epoch; in another frame, if one is given.

    Covariances are in SI (m, m/s, rad, rad/s): `cov_x_x` of the state, `cov_port_x_x` of port from port. An
    empty `ambiguity`: no other pose is possible. `alarm`: codes of `Alarm`, 0 = none.
    """
    check_format(path, TRACKS)
    turning = turning or Turning()
    tables = (np.vstack(_blocks(part, turning(part)), dtype=np.float64) for part in parts)
    stated = _head({"model": model} | _words(turning.stated) | (metadata or {}))
    writer(path, columns_in(turning.frame), tables, stated, _INTEGERS)


def columns_in(frame: str) -> tuple[str, ...]:
    """The columns of a track in a frame: quaternions are named for its axes."""
    return tuple(name.replace("q_lvlh_", f"q_{AXES[frame]}_") for name in TRACK_COLUMNS)


def track_columns(solution: PoseSolution, turned: FramedTrack | None = None) -> dict[str, Vector]:
    """The columns of a track by their names; in another frame, if that is given."""
    frame = OWN if turned is None else turned.frame
    return dict(zip(columns_in(frame), _rows(solution, turned), strict=True))


def _words(stated: dict[str, str]) -> dict[str, str]:
    """What a frame states of itself, with what it leaves as it is."""
    return stated | ({"frame": f"{stated['frame']}; ports and turns in target axes"} if stated else {})


def _rows(solution: PoseSolution, turned: FramedTrack | None = None) -> list[Vector]:
    """The columns one by one, each with numbers of its own kind."""
    blocks = _blocks(solution, turned)
    return [column for block in blocks for column in (block if block.ndim == 2 else (block,))]


def _blocks(solution: PoseSolution, turned: FramedTrack | None = None) -> list[Any]:
    """The columns by what they are of, (k, n) or (n,)."""
    state, covariance, attitude = solution.state, solution.covariance, solution.dcm_lvlh_from_target
    if turned is not None and turned.dcm_frame_from_target is not None:
        state, covariance, attitude = turned.state, turned.covariance, turned.dcm_frame_from_target
    turns = _quaternions(np.concatenate([attitude, solution.dcm_target_from_chaser]))
    doubtful = np.where(np.isfinite(solution.ambiguity), solution.ambiguity, np.nan)
    return [
        solution.t_s,
        state.T,
        turns[: len(solution)].T,
        np.degrees(solution.rate_rad_s).T,
        _sigmas(covariance).T,
        solution.port_m.T,
        solution.port_velocity_m_s.T,
        turns[len(solution) :].T,
        np.degrees(solution.relative_rate_rad_s).T,
        _sigmas(solution.docking_covariance).T,
        *(solution.nis, solution.dof, solution.used, solution.status, solution.hypotheses, doubtful),
        *(solution.observable, solution.too_late, solution.alarm),
        covariance[:, _UPPER[0], _UPPER[1]].T,
        solution.docking_covariance[:, _UPPER_3[0], _UPPER_3[1]].T,
    ]


def write_marker_log(flight: MarkerFlight, path: Path, metadata: dict[str, str] | None = None) -> None:
    """Write a simulated log in the columns that `filter_marker_log` reads."""
    layout = markers(flight.spots_px.shape[1])
    columns = ("t_s", *layout.spots, *(f"{base}_m_s2" for base in ACCELERATION), *layout.quaternion)
    spots = flight.spots_px.reshape(len(flight.t_s), -1)
    chaser = _quaternions(np.array(flight.dcm_chaser_from_lvlh))
    table: Table = [flight.t_s, *spots.T, *flight.acceleration_m_s2.T, *chaser.T]
    _write(path, columns, table, metadata or {})


def write_marker_truth(flight: MarkerFlight, path: Path, metadata: dict[str, str] | None = None) -> None:
    """Write a simulated log's true states."""
    attitude, rate = _quaternions(flight.dcm_lvlh_from_target), np.degrees(flight.rate_rad_s)
    table: Table = [flight.t_s, *flight.motion.T, *attitude.T, *rate.T]
    _write(path, TRUTH_COLUMNS, table, metadata or {})


def _write(path: Path, columns: tuple[str, ...], table: Table, metadata: dict[str, str]) -> None:
    check_format(path)
    write_table(path, columns, iter([table]), _head(metadata), ())


def _head(metadata: dict[str, str]) -> dict[str, str]:
    return {"relnav": relnav_version(), "frame": "lvlh_ccsds; ports and turns in target axes"} | metadata


def track_head(solution: PoseSolution, turned: FramedTrack | None = None) -> dict[str, str]:
    """What the head of its track states."""
    said = {} if turned is None else _words(turned.metadata)
    return _head({"model": solution.model} | said | ({"smoothed": "yes"} if solution.smoothed else {}))
