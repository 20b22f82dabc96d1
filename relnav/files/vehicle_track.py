"""A vehicle's track, one row a second: the chaser's port from the target's, and how each sensor fares."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.accuracy.rendezvous import true_port
from relnav.dynamics.in_frame import AXES, frame_words
from relnav.files.tables import Table, Writer, relnav_version, write_table
from relnav.simulation.vehicle_sensors import VehicleRun
from relnav.spacecraft import RESERVED, Vehicle
from relnav.vehicle.estimate import VehicleEstimate

_UPPER = np.triu_indices(12)
_NAMES = ("x", "y", "z", "vx", "vy", "vz", *(f"{kind}_{axis}" for kind in ("turn", "rate") for axis in "xyz"))
_UNITS = ("m",) * 3 + ("m_s",) * 3 + ("deg",) * 3 + ("deg_s",) * 3
_ATTITUDE = tuple(f"q_target_from_chaser_{axis}" for axis in "xyzw")
_PORT = tuple(f"{_NAMES[k]}_{_UNITS[k]}" for k in (0, 1, 2, 3, 4, 5, 9, 10, 11))
TRUTH_COLUMNS = ("t_s", *_PORT, *_ATTITUDE)
PROTECTION_COLUMNS = tuple(f"protection_{axis}_m" for axis in "xyz")
OF_A_SENSOR = ("used", "refused", "nis", "deviation", "drift", "alarm")
OF_NO_SENSOR = ("drift", "alarm")
SEEKING = "ambiguous"
TRACK_COLUMNS = (
    *TRUTH_COLUMNS,
    *(f"sigma_{name}_{unit}" for name, unit in zip(_NAMES, _UNITS, strict=True)),
    "gyro_lost",
    *PROTECTION_COLUMNS,
    *(f"cov_{_NAMES[i]}_{_NAMES[j]}" for i, j in zip(*_UPPER, strict=True)),
    SEEKING,
)
"""Port from port, target axes; the covariance in SI (m, m/s, rad, rad/s), turn as in `PortState`.

`ambiguous` is 1 while the target is looked for, at a start or after a lock-out: the state is not to be used. Of every
sensor there follow `OF_A_SENSOR`, as in `used_camera`: whether something of it was believed since the row before (0 or
1), observations in a row refused, NIS per degree of freedom, deviation of the squared innovations and of its drift in
the filter that watches, and whether it is among what may be at fault. Of gyro and thrusters `OF_NO_SENSOR` follow.
"""
_CENTRE = tuple(f"{_NAMES[k]}_{_UNITS[k]}" for k in range(6))
_DEGREES = np.array([1.0] * 6 + [180.0 / math.pi] * 6)


def frame_columns(frame: str | None) -> tuple[str, ...]:
    """What a frame adds to a track: centre of mass and the target's attitude in it; nothing for None."""
    if frame is None:
        return ()
    return (
        *(f"com_{name}" for name in _CENTRE),
        *(f"q_{AXES[frame]}_from_target_{axis}" for axis in "xyzw"),
        *(f"target_rate_{axis}_deg_s" for axis in "xyz"),
        *(f"sigma_com_{name}_{unit}" for name, unit in zip(_NAMES, _UNITS, strict=True)),
        *(f"cov_com_{_NAMES[i]}_{_NAMES[j]}" for i, j in zip(*_UPPER, strict=True)),
    )


def _framed_row(one: VehicleEstimate, frame: str) -> list[float]:
    """What an estimate has in the columns that a frame adds."""
    track = one.in_frame(frame)
    attitude, rate = track.q_frame_from_target, track.rate_rad_s
    assert attitude is not None
    assert rate is not None
    row = [*track.state[0], *attitude[0], *np.degrees(rate[0]), *(_DEGREES * track.sigma[0])]
    return [*row, *track.covariance[0][_UPPER]]


def _framed_head(vehicle: Vehicle, frame: str | None) -> dict[str, str]:
    """What the head says of these columns."""
    if frame is None:
        return {}
    stated = frame_words(frame, vehicle, vehicle.orbit.orientation_deg)
    of_columns = f"{stated.pop('frame')}; turn and rate of the target in its own axes"
    return {"frame of com_, q_ and cov_com_ columns": of_columns} | stated


class TrackRows:
    """Estimates as rows of a track, one after the other."""

    def __init__(self, vehicle: Vehicle, frame: str | None = None) -> None:
        """Take the names of the sensors, and a frame for further columns."""
        self._last, self._frame = dict.fromkeys(vehicle.sensor, math.nan), frame
        of_sensors = [f"{what}_{name}" for name in self._last for what in OF_A_SENSOR]
        of_sensors += [f"{what}_{name}" for name in RESERVED for what in OF_NO_SENSOR]
        self.columns = (*TRACK_COLUMNS, *of_sensors, *frame_columns(frame))

    @property
    def whole_numbers(self) -> tuple[int, ...]:
        """Which columns hold whole numbers."""
        whole = ("used", "refused", "alarm")
        of_sensors = {f"{what}_{name}" for name in self._last for what in whole} | {
            f"alarm_{name}" for name in RESERVED
        }
        return tuple(k for k, name in enumerate(self.columns) if name in {"gyro_lost", SEEKING} | of_sensors)

    def of(self, estimate: VehicleEstimate) -> list[float]:
        """The row of the next one."""
        port = estimate.port
        attitude = Rotation.from_matrix(port.dcm_target_from_chaser).as_quat(canonical=True)
        row = [estimate.t_s, *port.position_m, *port.velocity_m_s, *np.degrees(port.rate_rad_s), *attitude]
        row += [*(_DEGREES * port.sigma), float(estimate.gyro_lost), *port.protection_level_m()]
        row += [*port.covariance[_UPPER], float(estimate.ambiguous)]
        alarms, drifts = estimate.alarms, estimate.drifts.deviations
        for name, before in self._last.items():
            health = estimate.sensors[name]
            used = health.last_used_s == health.last_used_s and health.last_used_s != before
            self._last[name] = health.last_used_s
            row += [float(used), health.refused, health.nis_ratio, health.deviation]
            row += [drifts.get(name, math.nan), float(name in alarms)]
        for name in RESERVED:
            row += [drifts.get(name, math.nan), float(name in alarms)]
        return row if self._frame is None else [*row, *_framed_row(estimate, self._frame)]


def write_port_track(
    estimates: Iterable[VehicleEstimate],
    vehicle: Vehicle,
    path: Path,
    metadata: dict[str, str],
    writer: Writer = write_table,
    frame: str | None = None,
) -> None:
    """Write estimates (.csv, .jsonl or .parquet), one row each, in the columns of `TrackRows`."""
    rows = TrackRows(vehicle, frame)

    def parts() -> Iterator[Table]:
        for one in estimates:
            yield np.array([rows.of(one)], dtype=np.float64).T

    stated = _head({"model": vehicle.name} | metadata) | _framed_head(vehicle, frame)
    writer(path, rows.columns, parts(), stated, rows.whole_numbers)


def write_port_truth(run: VehicleRun, path: Path, metadata: dict[str, str]) -> None:
    """Write the true port from port (.csv or .parquet) every second, in `TRUTH_COLUMNS`."""

    def parts() -> Iterator[Table]:
        for t in range(1, math.floor(run.truth.end_s)):
            port, dcm = true_port(run, float(t))
            attitude = Rotation.from_matrix(dcm).as_quat(canonical=True)
            row = [float(t), *port[:6], *np.degrees(port[9:]), *attitude]
            yield [np.array([value]) for value in row]

    write_table(path, TRUTH_COLUMNS, parts(), _head(metadata), ())


def _head(metadata: dict[str, str]) -> dict[str, str]:
    return {"relnav": relnav_version(), "frame": "target axes: the chaser's port from the target's"} | metadata
