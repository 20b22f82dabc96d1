"""`relnav simulate` and `relnav filter` for a vehicle: a log of all its sensors, and the port's track."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from relnav.cli.epoch_bar import epoch_bar
from relnav.cli.printing import say
from relnav.cli.settings import given_options
from relnav.errors import UsageError

if TYPE_CHECKING:
    from relnav.cli.picture import Picture
    from relnav.files.vehicle_log import Row
    from relnav.spacecraft import Vehicle
    from relnav.vehicle.estimate import VehicleEstimate

OPTIONS = (
    "model", "out", "truth", "seed", "final_range_m", "quiet", "log", "json_path", "follow", "row_format",
    "frame", "plot", "corridor_deg", "smooth",
)  # fmt: skip


NOTED = 1000
"""Observations whose times are looked at."""


def simulate_vehicle(
    vehicle: "Vehicle", out: Path, truth: Path | None, seed: int, final_range_m: float | None, *, quiet: bool
) -> None:
    """Fly a rendezvous from the file's hand-over and write what its sensors see."""
    from relnav.files.atomic import Outputs
    from relnav.files.vehicle_log import write_vehicle_log
    from relnav.files.vehicle_track import write_port_truth
    from relnav.simulation.rendezvous import Rendezvous
    from relnav.simulation.vehicle_sensors import simulate_rendezvous

    start = vehicle.hand_over.port_distance_m[0]
    final = Rendezvous.final_m if final_range_m is None else final_range_m
    try:
        run = simulate_rendezvous(vehicle, Rendezvous(start_m=start, final_m=final), seed=seed)
    except ValueError as error:
        raise UsageError(str(error)) from error
    metadata = {"model": vehicle.name, "seed": str(seed)}
    with Outputs() as outputs:
        write_vehicle_log(run, outputs.path(out, ".csv"), metadata)
        if truth is not None:
            write_port_truth(run, outputs.path(truth, ".csv"), metadata)
    if not quiet:
        log = f"log: {out} ({len(run.observations)} observations, model {vehicle.name}, seed {seed})"
        say([log, *([f"truth: {truth}"] if truth is not None else [])], out, truth)


def asked_frame() -> str | None:
    """The frame on the command line; None if none stands there, and a track holds port from port alone."""
    given = any(name == "frame" for name, _ in given_options())
    return str(click.get_current_context().params["frame"]) if given else None


def filter_vehicle(
    log: Path,
    vehicle: "Vehicle",
    out: Path | None,
    json_path: Path | None,
    picture: "Picture",
    *,
    smooth: bool,
    quiet: bool,
) -> int:
    """Filter LOG, or smooth it, write what was asked for, print a summary."""
    from relnav.files.atomic import Outputs
    from relnav.files.tables import TRACKS, check_format, write_json
    from relnav.files.vehicle_log import filter_rows, read_vehicle_log, smoothed_rows
    from relnav.files.vehicle_track import write_port_track

    if out is not None:
        check_format(out, TRACKS)
    summary = Summary(vehicle)
    picture.of(vehicle)
    rows = read_vehicle_log(log, vehicle, summary.said.append)
    with Outputs() as outputs, epoch_bar(log, quiet=quiet, note=", one a second", from_bytes=200_000) as progress:
        estimates = (smoothed_rows if smooth else filter_rows)(summary.counted(rows), vehicle)
        parts = picture.passing(summary.passing(estimates, progress))
        if out is not None:
            head = {"log": log.name} | ({"method": "smoothed"} if smooth else {})
            write_port_track(parts, vehicle, outputs.path(out, ".csv"), head, frame=asked_frame())
        for _ in parts:
            pass
        picture.draw(outputs, log)
        if json_path is not None:
            write_json(summary.figures(), outputs.path(json_path))
    if not quiet:
        say([*summary.lines(log.name), *picture.said([("track", out)])], out, picture.path, json_path)
    return 0


class Summary:
    """What became of a vehicle's observations: how many, and the last estimate.

    Attributes
    ----------
    late : Counter of str
        How many of each sensor came too late for the filter's window.
    said : list of str
        What is odd about the log's order.
    """

    def __init__(self, vehicle: "Vehicle") -> None:
        from relnav.files.vehicle_notes import GyroTimes

        self.late, self.said = Counter[str](), list[str]()
        self._vehicle, self._rows, self._gyro = vehicle, 0, GyroTimes(vehicle)
        self._times: dict[str, list[float]] = {}
        self._last: VehicleEstimate | None = None
        self._estimates = 0
        self._ambiguous = 0
        self._alarms = Counter[str]()
        self._raised: dict[str, tuple[float, float]] = {}
        self._readings: dict[str, str] = {}
        self._latest: dict[str, Row] = {}

    def counted(self, rows: "Iterable[Row]") -> "Iterator[Row]":
        """The observations, counted; the first and the last of each sensor looked at."""
        from relnav.files.vehicle_notes import attitude_note

        for row in rows:
            self._rows += 1
            self._latest[row[0]] = row
            self._gyro.take(row[0], row[1])
            if self._rows <= NOTED:
                self._times.setdefault(row[0], []).append(row[1])
                if row[0] not in self._readings:
                    self._readings[row[0]] = attitude_note(row, self._vehicle)
            yield row

    def passing(
        self, estimates: "Iterable[VehicleEstimate]", progress: Callable[[int], None] | None = None
    ) -> "Iterator[VehicleEstimate]":
        """The estimates, the last one kept."""
        for estimate in estimates:
            self._last = estimate
            self._estimates += 1
            self._ambiguous += estimate.ambiguous
            self._alarms.update(estimate.alarms)
            for name, last_s in estimate.last_alarm_s.items():
                first_s, before_s = self._raised.get(name, (estimate.first_alarm_s[name], last_s))
                self._raised[name] = first_s, max(before_s, last_s)
            if progress is not None:
                progress(1)
            yield estimate

    def figures(self) -> dict[str, Any]:
        """As plain values."""
        assert self._last is not None
        alarms = {
            name: {"first_s": first_s, "last_s": last_s, "estimates": self._alarms[name]}
            for name, (first_s, last_s) in self._raised.items()
        }
        said = {"estimates": self._estimates, "ambiguous": self._ambiguous, "alarms": alarms, "notes": self._notes()}
        return _figures(self._last, self._vehicle, self._rows) | said

    def _notes(self) -> list[str]:
        """What is odd about times, of the gyro and of the sensor seen most often, about attitudes; what is refused."""
        import numpy as np

        from relnav.files.filter_file import spacing_note
        from relnav.files.vehicle_log import too_late
        from relnav.files.vehicle_notes import refused_note

        assert self._last is not None
        late = [
            f"{count} row{'s' if count > 1 else ''} of {name} {too_late(self._vehicle)}"
            for name, count in self.late.items()
        ]
        seen = [(self._latest[name], health) for name, health in self._last.sensors.items() if name in self._latest]
        said = [*self._gyro.notes(), *self._readings.values(), *(refused_note(*one, self._vehicle) for one in seen)]
        most = max(self._times.values(), key=len, default=[])
        return [*self.said, *late, *spacing_note(np.array(most), "divide them by 1000"), *filter(None, said)]

    def lines(self, name: str) -> list[str]:
        """For a reader."""
        return _lines(self.figures(), name)


def refuse_others() -> None:
    """Refuse options that a vehicle has no use for.

    Raises
    ------
    UsageError
        Naming the first.
    """
    for name, option in given_options():
        if name not in OPTIONS:
            raise UsageError(f"{option} is not for a vehicle: its file and log say what there is to say")


def _figures(last: "VehicleEstimate", vehicle: "Vehicle", observations: int) -> dict[str, Any]:
    import numpy as np

    sigma = last.port.sigma
    return {
        "model": vehicle.name,
        "observations": observations,
        "t_s": last.t_s,
        "restarts": last.restarts,
        "port_m": last.port.position_m.tolist(),
        "sigma_port_m": sigma[:3].tolist(),
        "sigma_port_velocity_m_s": sigma[3:6].tolist(),
        "sigma_turn_deg": np.degrees(sigma[6:9]).tolist(),
        "sigma_rate_deg_s": np.degrees(sigma[9:]).tolist(),
        "sensors": {
            name: {"last_used_s": health.last_used_s, "refused": health.refused, "nis_per_dof": health.nis_ratio}
            for name, health in last.sensors.items()
        },
    }


def _lines(figures: dict[str, Any], name: str) -> list[str]:
    def triple(key: str, factor: float = 1.0, digits: str = ".4g") -> str:
        return ", ".join(format(factor * value, digits) for value in figures[key])

    lines = [
        f"{name}: {figures['observations']} observations, model {figures['model']}",
        *figures["notes"],
        f"port from port at {figures['t_s']:.2f} s, target axes: {triple('port_m', digits='.3f')} m",
        f"  1-sigma {triple('sigma_port_m', 1e3)} mm, {triple('sigma_port_velocity_m_s', 1e3)} mm/s, attitude "
        f"{triple('sigma_turn_deg')} deg, rate {triple('sigma_rate_deg_s')} deg/s",
    ]
    for sensor, health in figures["sensors"].items():
        if health["last_used_s"] != health["last_used_s"]:
            lines.append(f"{sensor}: never used")
        else:
            lines.append(f"{sensor}: last used at {health['last_used_s']:.2f} s, NIS/n {health['nis_per_dof']:.2f}")
    lines.append("NIS/n is a mean over some ten observations; constant errors move it from 1, a fault raises an alarm")
    if figures["ambiguous"]:
        lines.append(
            f"the target was looked for in {figures['ambiguous']} of {figures['estimates']} estimates, at the start or "
            "after a lock-out: where the column ambiguous is 1, do not use the states"
        )
    for sensor, alarm in figures["alarms"].items():
        lines.append(
            f"ALARM {sensor} in {alarm['estimates']} of {figures['estimates']} estimates, raised first at "
            f"{alarm['first_s']:.2f} s and last at {alarm['last_s']:.2f} s: it may be at fault; do not use the states "
            "from then on, unless the fault is known to be over"
        )
    return lines
