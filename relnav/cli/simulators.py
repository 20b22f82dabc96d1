"""Which simulator flies a model: beacons on a PSD, or markers before a camera that sees the target turn."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from relnav.errors import ModelError, UsageError
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


Simulator = Callable[[Any, Approach, float, float, tuple[str, ...], int], Simulated]


def simulator_of(mission: Any) -> Simulator:
    """The simulator of a loaded model.

    Raises
    ------
    ModelError
        For a model that does not fly.
    """
    if isinstance(mission, VisionMission):
        return _markers
    if isinstance(mission, Model):
        return _beacons
    raise ModelError(
        f"{mission.path}: a relative navigation mission is expected (sensor_type three_beacon or three_marker); this "
        f"model describes a {type(mission).__name__}"
    )


def _beacons(
    mission: Model, approach: Approach, dropout: float, outliers: float, hidden: tuple[str, ...], seed: int
) -> Simulated:
    from relnav.files.simulated import write_log, write_truth
    from relnav.simulation.detector import Faults
    from relnav.simulation.scenario import simulate

    if hidden:
        raise UsageError(f"--hide is for marker models; {mission.name} has beacons: use --dropout")
    log = simulate(mission, approach, Faults(dropout, outliers), seed)
    return Simulated(
        len(log.t_s),
        lambda path, metadata: write_log(log, path, metadata),
        lambda path, metadata: write_truth(log, path, metadata),
    )


def _markers(
    mission: VisionMission, approach: Approach, dropout: float, outliers: float, hidden: tuple[str, ...], seed: int
) -> Simulated:
    from relnav.files.marker_logs import write_marker_log, write_marker_truth
    from relnav.simulation.marker_flight import MarkerFaults, simulate_flight

    letters = "abcdefghijklmnopqrstuvwxyz"[: len(mission.markers.positions_m)]
    spans = tuple(_span(text, letters) for text in hidden)
    flight = simulate_flight(mission, approach, MarkerFaults(dropout, outliers, spans), seed)
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
