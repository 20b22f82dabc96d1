"""Which simulator flies a model: beacons on a PSD, or markers before a camera that sees the target turn."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from relnav.errors import UsageError
from relnav.files.models import flown
from relnav.mission import Model, VisionMission
from relnav.simulation.trajectory import Approach


class Write(Protocol):
    """Writes one file with metadata at its head."""

    def __call__(self, path: Path, metadata: dict[str, str]) -> None:
        """Write."""
        ...


@dataclass(frozen=True)
class Simulated:
    """A flight, ready to be written."""

    epochs: int
    write_log: Write
    write_truth: Write
    rows: str = "epochs"


@dataclass(frozen=True)
class Options:
    """What the command line asks for besides the approach."""

    dropout: float
    outliers: float
    hidden: tuple[str, ...]
    received_power: bool
    raw: bool
    as_built: bool
    distortion_m: float
    seed: int


Simulator = Callable[[Any, Approach, Options], Simulated]


def simulator_of(mission: Any) -> Simulator:
    """The simulator of a loaded model.

    Raises
    ------
    ModelError
        For a model that does not fly.
    """
    return _markers if isinstance(flown(mission), VisionMission) else _beacons


def _beacons(mission: Model, approach: Approach, options: Options) -> Simulated:
    from relnav.files.simulated import write_log, write_truth
    from relnav.simulation.detector import Faults
    from relnav.simulation.scenario import simulate

    if options.hidden:
        raise UsageError(f"--hide is for marker models; {mission.name} has beacons: use --dropout")
    if options.as_built:
        from relnav.simulation.as_built import as_built

        mission = as_built(mission, options.seed)
    if options.raw:
        return _raw(mission, approach, options)
    if options.distortion_m:
        raise UsageError("--distortion belongs to --raw: a log of spots has none")
    if options.received_power and (mission.detector is None or mission.light is None):
        raise UsageError(f"--received-power needs [detector] and [light]; model {mission.name} has not both")
    faults = Faults(options.dropout, options.outliers)
    log = simulate(mission, approach, faults, options.seed, by_received_power=options.received_power)
    return Simulated(
        len(log.t_s),
        lambda path, metadata: write_log(log, path, metadata),
        lambda path, metadata: write_truth(log, path, metadata),
    )


def simulated_run(mission: Any, scenario: Any, seed: int, run: int) -> Simulated:
    """A run of a scenario."""
    from relnav.simulation.dispersed import simulate
    from relnav.simulation.marker_flight import MarkerFlight
    from relnav.simulation.vehicle_sensors import VehicleRun

    log = simulate(mission, scenario, seed, run)
    if isinstance(log, VehicleRun):
        from relnav.files.vehicle_log import write_vehicle_log
        from relnav.files.vehicle_track import write_port_truth

        return _written(log, len(log.observations), write_vehicle_log, write_port_truth, "observations")
    if isinstance(log, MarkerFlight):
        from relnav.files.marker_logs import write_marker_log, write_marker_truth

        return _written(log, len(log.t_s), write_marker_log, write_marker_truth)
    from relnav.files.simulated import write_log, write_truth

    return _written(log, len(log.t_s), write_log, write_truth)


def _written(log: Any, count: int, write_log: Any, write_truth: Any, rows: str = "epochs") -> Simulated:
    return Simulated(
        count,
        lambda path, metadata: write_log(log, path, metadata),
        lambda path, metadata: write_truth(log, path, metadata),
        rows,
    )


def _raw(mission: Model, approach: Approach, options: Options) -> Simulated:
    """A raw log; the detector's distortion comes from the same seed."""
    from relnav.files.simulated import write_raw_log, write_truth
    from relnav.simulation.distortion import typical_distortion
    from relnav.simulation.raw import simulate_raw

    if options.dropout or options.outliers:
        raise UsageError("--dropout and --outliers are faults of spots, not of --raw logs")
    half, size = 0.5 * max(mission.sensor.detector_size_m), options.distortion_m
    distortion = typical_distortion(half, size, seed=options.seed) if size else None
    log = simulate_raw(mission, approach, options.seed, distortion=distortion)
    return Simulated(
        len(log.t_s),
        lambda path, metadata: write_raw_log(log, path, metadata),
        lambda path, metadata: write_truth(log, path, metadata),
        "slots",
    )


def _markers(mission: VisionMission, approach: Approach, options: Options) -> Simulated:
    from relnav.files.marker_logs import write_marker_log, write_marker_truth
    from relnav.simulation.as_built import markers_as_built
    from relnav.simulation.marker_flight import MarkerFaults, simulate_flight

    if options.raw or options.received_power or options.distortion_m:
        raise UsageError(f"--raw, --received-power and --distortion are for beacon models; {mission.name} has markers")
    if options.as_built:
        mission = markers_as_built(mission, options.seed)
    letters = "abcdefghijklmnopqrstuvwxyz"[: len(mission.markers.positions_m)]
    spans = tuple(_span(text, letters) for text in options.hidden)
    faults = MarkerFaults(options.dropout, options.outliers, spans)
    flight = simulate_flight(mission, approach, faults, options.seed)
    return Simulated(
        len(flight.t_s),
        lambda path, metadata: write_marker_log(flight, path, metadata),
        lambda path, metadata: write_marker_truth(flight, path, metadata),
    )


def _span(text: str, letters: str) -> tuple[int, float, float]:
    """Marker and times of MARKER:FROM:TO."""
    try:
        marker, begin, end = text.split(":")
        return letters.index(marker), float(begin), float(end)
    except ValueError:
        known = ", ".join(letters)
        raise UsageError(f"--hide {text}: MARKER:FROM:TO is expected, a marker of {known} and two times in s") from None
